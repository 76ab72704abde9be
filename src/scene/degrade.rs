//! Imperfect proxies (paper, section 6.1): heights that are off by a share, and boundaries that are dilated. Names and ids stay, so that
//! a degraded scene can be compared with the true one structure by structure.

use std::sync::Arc;

use geo::buffer::{BufferStyle, LineJoin};
use geo::orient::{Direction, Orient};
use geo::{
    Area, Buffer, Coord, CoordsIter, Distance, Euclidean, Length, LineString, MapCoords, MultiPolygon, Point, Polygon,
    Validation, unary_union,
};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::proxy::{Scene, Shape, Structure};
use crate::fingerprint::fnv1a;

/// Heights are off by at most this, percent: beyond it hardly a structure would be left.
pub const MOST_HEIGHT_PERCENT: f64 = 90.0;

/// Arcs around corners are cut into pieces of this angle, rad: the chords lie within 3 % of the distance.
const ARC_PIECE_RAD: f64 = 0.5;

/// How the proxy is made worse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Degradation {
    /// Each structure's height is multiplied by 1 + x, x uniform between minus and plus this, percent (0 to 90).
    pub heights_percent: f64,
    pub boundary: Boundary,
    pub seed: u64,
}

/// How far boundaries are dilated: the three degrees of the paper's Table 2. The paper dilates in image space and gives no distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boundary {
    Original,
    Minor,
    Medium,
    Rough,
}

impl Boundary {
    /// All degrees, the mildest first.
    pub const ALL: [Self; 4] = [Self::Original, Self::Minor, Self::Medium, Self::Rough];

    pub fn name(self) -> &'static str {
        match self {
            Self::Original => "original",
            Self::Minor => "minor",
            Self::Medium => "medium",
            Self::Rough => "rough",
        }
    }

    /// How far the boundary moves outward, m.
    pub fn outward_m(self) -> f64 {
        match self {
            Self::Original => 0.0,
            Self::Minor => 1.0,
            Self::Medium => 2.0,
            Self::Rough => 4.0,
        }
    }
}

/// A scene made worse, and by how much.
#[derive(Clone, Debug, PartialEq)]
pub struct Degraded {
    pub scene: Scene,
    pub largest_error_m: LargestError,
}

/// The largest errors that were made on any structure, m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LargestError {
    /// How far a top moved up or down.
    pub vertical: f64,
    /// How far a boundary moved outward. Air under the overhangs and over the lower roofs of a mesh that became a prism is not counted:
    /// it adds to the structure, so nothing true sticks out of it.
    pub lateral: f64,
}

impl LargestError {
    /// Whether the proxy may be wrong by more than the safety distance, m: then keeping that distance from the proxy does not keep
    /// clear of what really stands there.
    pub fn exceeds(&self, safety_distance_m: f64) -> bool {
        self.vertical.max(self.lateral) > safety_distance_m
    }

    fn or_larger(self, other: Self) -> Self {
        Self { vertical: self.vertical.max(other.vertical), lateral: self.lateral.max(other.lateral) }
    }
}

/// The scene with every structure degraded by itself: what becomes of one depends on the seed and on its id alone.
///
/// Heights above a structure's own base are multiplied, in a mesh those of all its vertices. Dilation moves outlines outward with rounded
/// corners, so that courts shrink and narrow ones close; a mesh becomes the prism over its dilated outline, from its base to its top.
pub fn degrade(scene: &Scene, degradation: &Degradation) -> Degraded {
    let degraded: Vec<(Arc<Structure>, LargestError)> =
        scene.structures.iter().map(|structure| degrade_structure(structure, degradation)).collect();
    let largest_error_m = degraded.iter().map(|(_, error)| *error).fold(LargestError::default(), LargestError::or_larger);
    let structures = degraded.into_iter().map(|(structure, _)| structure).collect();
    Degraded { scene: Scene { structures, ..scene.clone() }, largest_error_m }
}

fn degrade_structure(structure: &Arc<Structure>, degradation: &Degradation) -> (Arc<Structure>, LargestError) {
    let factor = height_factor(structure, degradation);
    let outward_m = degradation.boundary.outward_m();
    if (factor == 1.0 && outward_m == 0.0) || structure.terrain().is_some() {
        return (Arc::clone(structure), LargestError::default());
    }
    let stretched = stretched(structure, factor);
    let vertical = (stretched.bounds().max.z - structure.bounds().max.z).abs();
    if outward_m == 0.0 {
        return (Arc::new(stretched), LargestError { vertical, lateral: 0.0 });
    }
    let outline = structure.outlines();
    let footprint = dilated(&outline, outward_m);
    let lateral = farthest_m(&footprint, &outline);
    let bounds = stretched.bounds();
    let shape = Shape::Prism { footprint, base_m: bounds.min.z.max(0.0), top_m: bounds.max.z };
    (Arc::new(Structure { shape, ..stretched }), LargestError { vertical, lateral })
}

/// What the height is multiplied by; the same for a structure in whatever scene it stands.
fn height_factor(structure: &Structure, degradation: &Degradation) -> f64 {
    let share = degradation.heights_percent.clamp(0.0, MOST_HEIGHT_PERCENT) / 100.0;
    let both = [degradation.seed.to_le_bytes(), structure.id.0.to_le_bytes()].concat();
    let draw = ChaCha8Rng::seed_from_u64(fnv1a(&both)).next_u64();
    let unit = (draw >> 11) as f64 / (1u64 << 53) as f64;
    1.0 + share * (2.0 * unit - 1.0)
}

/// The structure with its heights above its base multiplied.
fn stretched(structure: &Structure, factor: f64) -> Structure {
    let base_m = structure.bounds().min.z;
    let height_m = |z: f64| base_m + (z - base_m) * factor;
    let shape = match &structure.shape {
        Shape::Prism { footprint, base_m, top_m } => {
            Shape::Prism { footprint: footprint.clone(), base_m: *base_m, top_m: height_m(*top_m) }
        }
        Shape::Mesh { triangles } => {
            let mut triangles = triangles.clone();
            triangles.iter_mut().flatten().for_each(|corner| corner.z = height_m(corner.z));
            Shape::Mesh { triangles }
        }
        // It was measured in flight.
        Shape::Obstacle { .. } | Shape::Terrain(_) => structure.shape.clone(),
    };
    Structure { shape, ..structure.clone() }
}

/// A court that is left narrower than this is closed, m: in whole millimetres, or in a file, its walls may touch.
const LEAST_COURT_M: f64 = 0.05;

/// The outline moved outward, corners to whole millimetres where it stays a sound outline by that. An outline that is too small for the
/// offsetting to work on stays.
fn dilated(outline: &MultiPolygon<f64>, outward_m: f64) -> MultiPolygon<f64> {
    let style = BufferStyle::new(outward_m).line_join(LineJoin::Round(ARC_PIECE_RAD));
    let mut grown = outline.buffer_with_style(style).orient(Direction::Default);
    for part in &mut grown {
        let is_open = |court: &LineString| {
            let area_m2 = Polygon::new(court.clone(), Vec::new()).unsigned_area();
            2.0 * area_m2 >= LEAST_COURT_M * Euclidean.length(court)
        };
        let courts = part.interiors().iter().filter(|court| is_open(court)).cloned().collect();
        *part = Polygon::new(part.exterior().clone(), courts);
    }
    let rounded = grown.map_coords(|corner| Coord { x: round_mm(corner.x), y: round_mm(corner.y) });
    let is_sound = |outline: &MultiPolygon<f64>| !outline.0.is_empty() && outline.is_valid();
    let united = || unary_union(&grown.0).orient(Direction::Default);
    [rounded, grown.clone()]
        .into_iter()
        .find(is_sound)
        .or_else(|| Some(united()).filter(is_sound))
        .unwrap_or_else(|| outline.clone())
}

/// How far the grown outline reaches beyond the one that it contains, m: the greatest distance is at a corner.
fn farthest_m(grown: &MultiPolygon<f64>, outline: &MultiPolygon<f64>) -> f64 {
    grown.coords_iter().map(|corner| Euclidean.distance(&Point::from(corner), outline)).fold(0.0, f64::max)
}

fn round_mm(metres: f64) -> f64 {
    (metres * 1000.0).round() / 1000.0
}

#[cfg(test)]
mod tests {
    use geo::{Contains, polygon};
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;
    use crate::frame::LocalFrame;
    use crate::scene::{BlockSettings, StructureId, generate_block, read, to_geojson};
    use crate::settings::Settings;

    fn prism(name: &str, outline: Polygon<f64>, base_m: f64, top_m: f64) -> Arc<Structure> {
        let shape = Shape::Prism { footprint: MultiPolygon(vec![outline]), base_m, top_m };
        Arc::new(Structure { id: StructureId::of_name(name), name: name.to_owned(), shape })
    }

    fn scene_of(structures: Vec<Arc<Structure>>) -> Scene {
        Scene { name: "test".to_owned(), frame: LocalFrame { origin: None }, structures, zones: Vec::new() }
    }

    fn square() -> Polygon<f64> {
        polygon![(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)]
    }

    const NOTHING: Degradation = Degradation { heights_percent: 0.0, boundary: Boundary::Original, seed: 1 };

    #[test]
    fn nothing_to_degrade_gives_the_same_scene() {
        let scene = generate_block(&BlockSettings::default());
        assert_eq!(degrade(&scene, &NOTHING), Degraded { scene, largest_error_m: LargestError::default() });
    }

    #[test]
    fn a_dilated_square_has_the_area_of_its_offset() {
        let scene = scene_of(vec![prism("a", square(), 3.0, 9.0)]);
        let Degraded { scene, largest_error_m } = degrade(&scene, &Degradation { boundary: Boundary::Medium, ..NOTHING });
        let grown = scene.structures[0].outlines();
        // The square, four strips of 2 m, and four quarters of a circle cut into chords.
        let (least_m2, most_m2) = (100.0 + 80.0 + 0.95 * 4.0 * std::f64::consts::PI, 180.0 + 4.0 * std::f64::consts::PI);
        assert!((least_m2..most_m2).contains(&grown.signed_area()), "{}", grown.signed_area());
        assert!((largest_error_m.lateral - 2.0).abs() < 1e-3 && largest_error_m.vertical == 0.0, "{largest_error_m:?}");
        assert_eq!((scene.structures[0].bounds().min.z, scene.structures[0].bounds().max.z), (3.0, 9.0));
    }

    #[test]
    fn a_narrow_court_closes() {
        let court = Polygon::new(
            square().exterior().clone(),
            vec![polygon![(x: 4.0, y: 4.0), (x: 4.0, y: 6.0), (x: 6.0, y: 6.0), (x: 6.0, y: 4.0)].exterior().clone()],
        );
        let holes = |boundary| {
            let degraded = degrade(&scene_of(vec![prism("a", court.clone(), 0.0, 9.0)]), &Degradation { boundary, ..NOTHING });
            degraded.scene.structures[0].outlines().0[0].interiors().len()
        };
        assert_eq!((holes(Boundary::Original), holes(Boundary::Medium)), (1, 0));
    }

    #[test]
    fn a_court_that_all_but_closes_leaves_a_sound_outline() {
        // To whole millimetres one of its courts would cross itself.
        let block = BlockSettings { seed: 3_852_719_170_365_941_968, buildings: 49, ..Default::default() };
        let degraded = degrade(&generate_block(&block), &Degradation { boundary: Boundary::Rough, ..NOTHING });
        assert!(degraded.scene.structures.iter().all(|structure| structure.outlines().is_valid()));
        let (_, report) = read("block.geojson", to_geojson(&degraded.scene).as_bytes(), &Settings::default().proxy).unwrap();
        assert_eq!(report.items, Vec::new());
    }

    #[test]
    fn a_mesh_is_stretched_above_its_base_and_dilated_into_a_prism() {
        let box_above = prism("a", square(), 20.0, 30.0);
        let shape = Shape::Mesh { triangles: box_above.triangles() };
        let mesh = scene_of(vec![Arc::new(Structure { shape, ..(*box_above).clone() })]);
        let taller = Degradation { heights_percent: 20.0, ..NOTHING };
        let stretched = &degrade(&mesh, &taller).scene.structures[0];
        let as_prism = &degrade(&scene_of(vec![box_above]), &taller).scene.structures[0];
        assert!(matches!(stretched.shape, Shape::Mesh { .. }));
        assert_eq!(stretched.bounds(), as_prism.bounds());
        assert!(stretched.bounds().min.z == 20.0 && stretched.bounds().max.z != 30.0);

        let dilated = &degrade(&mesh, &Degradation { boundary: Boundary::Rough, ..taller }).scene.structures[0];
        assert!(matches!(dilated.shape, Shape::Prism { .. }));
        assert_eq!((dilated.bounds().min.z, dilated.bounds().max.z), (20.0, stretched.bounds().max.z));
        assert!(dilated.contains(&Point3::new(-3.9, 5.0, 25.0)) && !dilated.contains(&Point3::new(-4.1, 5.0, 25.0)));
    }

    #[test]
    fn an_error_beyond_the_safety_distance_is_told_from_one_within() {
        let error = LargestError { vertical: 4.9, lateral: 5.0 };
        assert!(!error.exceeds(5.0) && error.exceeds(4.95) && error.exceeds(1.0));
        assert!(LargestError { vertical: 5.1, lateral: 0.0 }.exceeds(5.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn a_degraded_block_keeps_its_names_and_its_stated_errors(
            block in any::<u64>(), seed in any::<u64>(), percent in 0.0..MOST_HEIGHT_PERCENT, degree in 0usize..4, buildings in 1u32..60,
        ) {
            let truth = generate_block(&BlockSettings { seed: block, buildings, ..Default::default() });
            let degradation = Degradation { heights_percent: percent, boundary: Boundary::ALL[degree], seed };
            let degraded = degrade(&truth, &degradation);
            prop_assert_eq!(&degraded, &degrade(&truth, &degradation));
            prop_assert_eq!(degraded.scene.structures.len(), truth.structures.len());
            let outward_m = degradation.boundary.outward_m();
            let mut vertical = 0.0f64;
            for (after, before) in degraded.scene.structures.iter().zip(&truth.structures) {
                prop_assert_eq!((after.id, &after.name), (before.id, &before.name));
                let [high, low] = [after, before].map(|structure| structure.bounds().max.z - structure.bounds().min.z);
                prop_assert!((high / low - 1.0).abs() <= percent / 100.0 + 1e-9);
                vertical = vertical.max((after.bounds().max.z - before.bounds().max.z).abs());
                let [grown, outline] = [after, before].map(|structure| structure.outlines());
                prop_assert!(grown.is_valid() && grown.signed_area() > 0.0);
                for corner in outline.coords_iter() {
                    let at = Point::from(corner);
                    prop_assert!(outward_m == 0.0 || grown.contains(&at));
                    // A wall is as far inside as it was told to be moved, less what the chords of a corner cut off.
                    let to_wall_m = grown.iter().map(|part| {
                        let rings = std::iter::once(part.exterior()).chain(part.interiors());
                        rings.map(|ring| Euclidean.distance(&at, ring)).fold(f64::MAX, f64::min)
                    }).fold(f64::MAX, f64::min);
                    prop_assert!(to_wall_m >= 0.96 * outward_m, "{} of {}", to_wall_m, outward_m);
                }
                prop_assert!(farthest_m(&grown, &outline) <= outward_m + 2e-3);
            }
            prop_assert_eq!(degraded.largest_error_m.vertical, vertical);
            prop_assert!(degraded.largest_error_m.lateral <= outward_m + 2e-3);
            prop_assert!(outward_m == 0.0 || degraded.largest_error_m.lateral > 0.96 * outward_m);
            let (back, report) = read("block.geojson", to_geojson(&degraded.scene).as_bytes(), &Settings::default().proxy).unwrap();
            prop_assert_eq!(&report.items, &Vec::new());
            prop_assert!(back.structures.iter().zip(&degraded.scene.structures).all(|(a, b)| a.name == b.name));
        }

        #[test]
        fn another_seed_gives_other_heights_and_what_else_stands_there_does_not_matter(seed in 0..u64::MAX) {
            let truth = generate_block(&BlockSettings::default());
            let of = |scene: &Scene, seed| degrade(scene, &Degradation { heights_percent: 10.0, seed, ..NOTHING }).scene;
            prop_assert_ne!(of(&truth, seed), of(&truth, seed + 1));
            let first = Scene { structures: truth.structures[..1].to_vec(), ..truth.clone() };
            prop_assert_eq!(&of(&first, seed).structures[0], &of(&truth, seed).structures[0]);
        }
    }
}
