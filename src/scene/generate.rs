//! Procedural city blocks: for the demo, for tests and for benchmarks. The same settings give the same scene on every machine.

use std::sync::Arc;

use geo::orient::{Direction, Orient};
use geo::{Coord, LineString, MapCoords, MultiPolygon, Polygon};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::proxy::{Scene, Shape, Structure, StructureId};
use crate::frame::{Geodetic, LocalFrame};

/// What a generated block looks like.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockSettings {
    pub seed: u64,
    /// Size of the box around the block, east and north, m.
    pub extent_m: [f64; 2],
    /// Number of building lots; a tower on a podium makes two structures of one lot.
    pub buildings: u32,
    pub min_height_m: f64,
    /// Height of the tallest tower.
    pub max_height_m: f64,
    /// Share of the lots that are built on; the others are parks and squares. Lots at the border of the block are built on first.
    pub built_share: f64,
}

impl Default for BlockSettings {
    fn default() -> Self {
        Self { seed: 1, extent_m: [300.0, 300.0], buildings: 60, min_height_m: 8.0, max_height_m: 90.0, built_share: 1.0 }
    }
}

/// A block of the size that the paper gives for its scene NY-1: 428 x 302 m, tallest building 95 m.
///
/// The paper does not say how much is built there, but how many views of the Phantom capture it: 248 after Zhou 2020, 252 with its own
/// method (Table 3). So much is built here that a greedy choice of free views needs about as many (`tests/reference_scene.rs`); fully
/// built, the block would need 700.
pub fn ny1_size() -> BlockSettings {
    BlockSettings { seed: 1, extent_m: [428.0, 302.0], buildings: 84, min_height_m: 8.0, max_height_m: 95.0, built_share: 0.2 }
}

/// Where generated blocks stand: flat land, so that exported missions open at a sensible place.
const ORIGIN: Geodetic = Geodetic { lat_deg: 52.0116, lon_deg: 4.3571, alt_m: 0.0 };

/// Share of the lots that carry a tower.
const TOWER_SHARE: f64 = 0.08;

/// The common buildings stay below this share of the tallest tower.
const COMMON_SHARE: f64 = 0.4;

/// A block of streets in a grid, lots with setbacks, L- and U-shapes, courtyards, and a few towers on podiums; mostly low. The
/// whole is turned a little against north.
pub fn generate_block(settings: &BlockSettings) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let angle_rad = between(&mut rng, 3.0, 8.0).to_radians();
    let size_m = turned_inside(settings.extent_m.map(|extent_m| extent_m.max(30.0)), angle_rad);
    let lots = lots(&mut rng, size_m, settings.buildings.max(1) as usize);
    let lots = built(&mut rng, lots, settings.built_share);
    let tops = tops(&mut rng, &lots, settings);
    let mut structures: Vec<Arc<Structure>> = Vec::new();
    for (index, (lot, top)) in lots.iter().zip(tops).enumerate() {
        for (name, shape) in build_lot(&mut rng, index + 1, lot, top) {
            structures.push(Arc::new(Structure { id: StructureId::of_name(&name), name, shape: turned(shape, angle_rad) }));
        }
    }
    structures.sort_by_key(|structure| structure.id);
    let name = format!("block-{}", settings.seed);
    Scene { name, frame: LocalFrame { origin: Some(ORIGIN) }, structures, zones: Vec::new() }
}

/// A rectangle along the streets, m from the middle of the block.
#[derive(Clone, Copy, Debug)]
struct Lot {
    min: [f64; 2],
    max: [f64; 2],
}

impl Lot {
    fn size(&self) -> [f64; 2] {
        [self.max[0] - self.min[0], self.max[1] - self.min[1]]
    }

    fn area(&self) -> f64 {
        self.size()[0] * self.size()[1]
    }

    fn narrow(&self) -> f64 {
        self.size()[0].min(self.size()[1])
    }

    /// The rectangle less `by` on its west, south, east and north side.
    fn inset(&self, by: [f64; 4]) -> Self {
        Self { min: [self.min[0] + by[0], self.min[1] + by[1]], max: [self.max[0] - by[2], self.max[1] - by[3]] }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Top {
    Common { top_m: f64 },
    Tower { podium_m: f64, top_m: f64 },
}

/// The rectangle that fills a box of `extent_m` when it is turned by `angle_rad`.
fn turned_inside(extent_m: [f64; 2], angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = (libm::sin(angle_rad), libm::cos(angle_rad));
    let squeeze = cos * cos - sin * sin;
    let side = |along: f64, across: f64| ((along * cos - across * sin) / squeeze).max(0.4 * along);
    [side(extent_m[0], extent_m[1]), side(extent_m[1], extent_m[0])]
}

/// Cuts the block by streets, then its quarters into `count` lots, always halving the largest.
fn lots(rng: &mut ChaCha8Rng, size_m: [f64; 2], count: usize) -> Vec<Lot> {
    let most_quarters = (count / 3).max(1);
    let mut across = size_m.map(|side_m| ((side_m / 75.0).round() as usize).max(1));
    while across[0] * across[1] > most_quarters && across != [1, 1] {
        let longer = usize::from(across[1] > across[0]);
        across[longer] -= 1;
    }
    let columns = strips(rng, size_m[0], across[0]);
    let rows = strips(rng, size_m[1], across[1]);
    let mut lots: Vec<Lot> = columns
        .iter()
        .flat_map(|&[west, east]| rows.iter().map(move |&[south, north]| Lot { min: [west, south], max: [east, north] }))
        .collect();
    while lots.len() < count {
        let largest = (0..lots.len()).fold(0, |best, index| if lots[index].area() > lots[best].area() { index } else { best });
        let lot = lots[largest];
        let axis = usize::from(lot.size()[1] > lot.size()[0]);
        let at = round_mm(lot.min[axis] + lot.size()[axis] * between(rng, 0.4, 0.6));
        let (mut low, mut high) = (lot, lot);
        low.max[axis] = at;
        high.min[axis] = at;
        lots[largest] = low;
        lots.push(high);
    }
    lots
}

/// The lots that are built on: one at each side of the block, so that it keeps its size, then others by lot.
fn built(rng: &mut ChaCha8Rng, lots: Vec<Lot>, share: f64) -> Vec<Lot> {
    let count = ((lots.len() as f64 * share).round() as usize).clamp(1, lots.len());
    if count == lots.len() {
        return lots;
    }
    let outermost = |reach: fn(&Lot) -> f64| {
        (0..lots.len()).fold(0, |best, index| if reach(&lots[index]) > reach(&lots[best]) { index } else { best })
    };
    let mut chosen = vec![
        outermost(|lot| -lot.min[0]),
        outermost(|lot| lot.max[0]),
        outermost(|lot| -lot.min[1]),
        outermost(|lot| lot.max[1]),
    ];
    let mut others: Vec<usize> = (0..lots.len()).collect();
    for index in (1..others.len()).rev() {
        others.swap(index, (rng.next_u64() % (index as u64 + 1)) as usize);
    }
    for index in others {
        if chosen.len() >= count {
            break;
        }
        if !chosen.contains(&index) {
            chosen.push(index);
        }
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|index| lots[index]).collect()
}

/// `count` strips of varied width with streets between them, centred.
fn strips(rng: &mut ChaCha8Rng, length_m: f64, count: usize) -> Vec<[f64; 2]> {
    let streets: Vec<f64> = (1..count).map(|_| pick(rng, &[9.0, 12.0, 14.0, 20.0])).collect();
    let shares: Vec<f64> = (0..count).map(|_| between(rng, 0.8, 1.25)).collect();
    let built_m = (length_m - streets.iter().sum::<f64>()).max(0.5 * length_m);
    let unit_m = built_m / shares.iter().sum::<f64>();
    let mut at = -length_m / 2.0;
    let mut strips = Vec::with_capacity(count);
    for (index, share) in shares.iter().enumerate() {
        let end = at + share * unit_m;
        strips.push([round_mm(at), round_mm(end)]);
        at = end + streets.get(index).copied().unwrap_or(0.0);
    }
    strips
}

/// Mostly low buildings and a few towers on the wider lots; the first tower is the tallest of all.
fn tops(rng: &mut ChaCha8Rng, lots: &[Lot], settings: &BlockSettings) -> Vec<Top> {
    let low_m = settings.min_height_m.max(2.0);
    let high_m = settings.max_height_m.max(low_m + 1.0);
    let common_m = (COMMON_SHARE * high_m).max(low_m + 1.0).min(high_m);
    let mut tops: Vec<Top> = lots
        .iter()
        .map(|_| {
            let share = between(rng, 0.0, 1.0);
            Top::Common { top_m: round_dm(low_m + (common_m - low_m) * share * share) }
        })
        .collect();
    let towers = ((lots.len() as f64 * TOWER_SHARE).round() as usize).max(1);
    let mut wide: Vec<usize> = (0..lots.len()).collect();
    wide.sort_by(|&a, &b| lots[b].narrow().total_cmp(&lots[a].narrow()));
    wide.truncate((towers * 3).max(lots.len() / 2).max(1));
    for number in 0..towers.min(wide.len()) {
        let chosen = number + (rng.next_u64() % (wide.len() - number) as u64) as usize;
        wide.swap(number, chosen);
        let share = if number == 0 { 1.0 } else { between(rng, 0.55, 0.95) };
        let top_m = round_dm((high_m * share).max(low_m));
        let podium_m = round_dm((between(rng, 0.12, 0.2) * top_m).max(low_m).min(0.5 * top_m));
        tops[wide[number]] = Top::Tower { podium_m, top_m };
    }
    tops
}

fn build_lot(rng: &mut ChaCha8Rng, number: usize, lot: &Lot, top: Top) -> Vec<(String, Shape)> {
    let setback_m = |rng: &mut ChaCha8Rng| if between(rng, 0.0, 1.0) < 0.25 { 0.0 } else { round_dm(between(rng, 0.8, 3.0)) };
    let most_m = round_dm(0.12 * lot.narrow());
    let plot = lot.inset([0; 4].map(|_| setback_m(rng).min(most_m)));
    match top {
        Top::Common { top_m } => vec![(format!("building-{number:03}"), prism(common_outline(rng, &plot), 0.0, top_m))],
        Top::Tower { podium_m, top_m } => {
            let shaft = plot.inset([0; 4].map(|_| round_dm(between(rng, 0.12, 0.25) * plot.narrow())));
            vec![
                (format!("tower-{number:03}-podium"), prism(rectangle(&plot), 0.0, podium_m)),
                (format!("tower-{number:03}"), prism(rectangle(&shaft), podium_m, top_m)),
            ]
        }
    }
}

/// A rectangle, L, U or court, as the plot allows, facing any way.
fn common_outline(rng: &mut ChaCha8Rng, plot: &Lot) -> Polygon<f64> {
    let outline = outline_facing_north(rng, plot);
    let mirror = rng.next_u64() % 4;
    let flip = |axis: usize, at: f64| if mirror >> axis & 1 == 1 { plot.min[axis] + plot.max[axis] - at } else { at };
    outline.map_coords(|corner| Coord { x: flip(0, corner.x), y: flip(1, corner.y) }).orient(Direction::Default)
}

fn outline_facing_north(rng: &mut ChaCha8Rng, plot: &Lot) -> Polygon<f64> {
    let draw = between(rng, 0.0, 1.0);
    // Wings of at least 8 m, so that small plots stay rectangles.
    let wing = |rng: &mut ChaCha8Rng| round_dm((plot.narrow() * between(rng, 0.28, 0.36)).max(8.0));
    let narrow_m = plot.narrow();
    if draw < 0.18 && narrow_m > 18.0 {
        let wing_m = wing(rng);
        notched(plot, [plot.min[0] + wing_m, plot.max[0]], plot.min[1] + wing_m)
    } else if draw < 0.32 && narrow_m > 24.0 {
        let wing_m = wing(rng);
        notched(plot, [plot.min[0] + wing_m, plot.max[0] - wing_m], plot.min[1] + wing_m)
    } else if draw < 0.5 && narrow_m > 26.0 {
        let court = plot.inset([wing(rng); 4]);
        Polygon::new(LineString(ring(plot)), vec![LineString(ring(&court).into_iter().rev().collect())])
    } else {
        rectangle(plot)
    }
}

/// A plot with a notch from its north side: an L when the notch reaches the east side, else a U.
fn notched(plot: &Lot, notch_x: [f64; 2], notch_y: f64) -> Polygon<f64> {
    let [west, south] = plot.min;
    let [east, north] = plot.max;
    let mut corners = vec![[west, south], [east, south]];
    if notch_x[1] < east {
        corners.extend([[east, north], [notch_x[1], north]]);
    }
    corners.extend([[notch_x[1], notch_y], [notch_x[0], notch_y], [notch_x[0], north], [west, north]]);
    Polygon::new(LineString::from(corners), Vec::new())
}

fn rectangle(plot: &Lot) -> Polygon<f64> {
    Polygon::new(LineString(ring(plot)), Vec::new())
}

fn ring(plot: &Lot) -> Vec<Coord<f64>> {
    let ([west, south], [east, north]) = (plot.min, plot.max);
    [[west, south], [east, south], [east, north], [west, north], [west, south]].map(Coord::from).to_vec()
}

fn prism(outline: Polygon<f64>, base_m: f64, top_m: f64) -> Shape {
    Shape::Prism { footprint: MultiPolygon(vec![outline]), base_m, top_m }
}

fn turned(shape: Shape, angle_rad: f64) -> Shape {
    let (sin, cos) = (libm::sin(angle_rad), libm::cos(angle_rad));
    let turn =
        |corner: Coord<f64>| Coord { x: round_mm(corner.x * cos - corner.y * sin), y: round_mm(corner.x * sin + corner.y * cos) };
    match shape {
        Shape::Prism { footprint, base_m, top_m } => Shape::Prism { footprint: footprint.map_coords(turn), base_m, top_m },
        mesh => mesh,
    }
}

fn between(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    let unit = (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    low + (high - low) * unit
}

fn pick(rng: &mut ChaCha8Rng, choices: &[f64]) -> f64 {
    choices[(rng.next_u64() % choices.len() as u64) as usize]
}

fn round_mm(metres: f64) -> f64 {
    (metres * 1000.0).round() / 1000.0
}

fn round_dm(metres: f64) -> f64 {
    (metres * 10.0).round() / 10.0
}

#[cfg(test)]
mod tests {
    use geo::{Area, Validation};
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{read, to_geojson};
    use crate::settings::Settings;

    fn heights(scene: &Scene) -> Vec<f64> {
        scene.structures.iter().map(|structure| structure.bounds().max.z).collect()
    }

    #[test]
    fn the_default_block_looks_like_a_town() {
        let settings = BlockSettings::default();
        let scene = generate_block(&settings);
        assert_eq!(scene, generate_block(&settings));
        assert_ne!(scene, generate_block(&BlockSettings { seed: 2, ..settings }));
        assert!((60..=70).contains(&scene.structures.len()), "{}", scene.structures.len());
        let bounds = scene.bounds().unwrap();
        for axis in 0..2 {
            let side_m = bounds.max[axis] - bounds.min[axis];
            assert!((280.0..=300.5).contains(&side_m), "{side_m} m");
        }
        assert_eq!(bounds.max.z, 90.0);
        let low = heights(&scene).iter().filter(|top_m| **top_m < 25.0).count();
        assert!(low * 2 > scene.structures.len(), "mostly low");
        let holes: usize = scene.structures.iter().flat_map(|s| s.outlines().0).map(|polygon| polygon.interiors().len()).sum();
        assert!(holes >= 1, "a court at least");
        assert!(scene.structures.iter().any(|s| s.bounds().min.z > 0.0), "a tower on a podium");
    }

    #[test]
    fn the_paper_s_scene_has_its_published_size() {
        let bounds = generate_block(&ny1_size()).bounds().unwrap();
        assert!((405.0..=428.5).contains(&(bounds.max.x - bounds.min.x)), "{bounds:?}");
        assert!((280.0..=302.5).contains(&(bounds.max.y - bounds.min.y)), "{bounds:?}");
        assert_eq!(bounds.max.z, 95.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn every_block_is_sound_and_survives_its_file(
            seed in any::<u64>(), east in 30.0..900.0f64, north in 30.0..900.0f64, buildings in 1u32..150, tallest in 10.0..300.0f64,
            built_share in prop_oneof![Just(1.0), 0.0..1.0f64],
        ) {
            let settings = BlockSettings { seed, extent_m: [east, north], buildings, min_height_m: 4.0, max_height_m: tallest, built_share };
            let scene = generate_block(&settings);
            prop_assert!(scene.structures.len() as f64 >= (f64::from(buildings) * built_share).floor());
            prop_assert!(scene.structures.is_sorted_by(|a, b| a.id < b.id));
            for structure in &scene.structures {
                let outline = structure.outlines();
                prop_assert!(outline.is_valid() && outline.signed_area() > 0.0);
            }
            let proxy = Settings::default().proxy;
            let (back, report) = read("block.geojson", to_geojson(&scene).as_bytes(), &proxy).unwrap();
            prop_assert_eq!(&report.items, &Vec::new());
            prop_assert_eq!(report.overlapping_pairs, 0);
            prop_assert_eq!(&back.frame, &scene.frame);
            prop_assert_eq!(back.structures.len(), scene.structures.len());
            for (a, b) in scene.structures.iter().zip(&back.structures) {
                prop_assert_eq!(&a.name, &b.name);
                let [a, b] = [a, b].map(|structure| structure.triangles());
                prop_assert_eq!(a.len(), b.len());
                prop_assert!(a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).norm() < 0.01));
            }
        }
    }
}
