//! Prisms for what stands on the ground: roofs, and obstacles that flights keep clear of and nobody wants to capture.

use geo::orient::Direction;
use geo::{Area, Coord, LineString, MultiPolygon, Orient, Polygon};

use super::Heights;
use super::grid::Affine;
use super::outline::{self, Labels, Outline};
use super::regions::{self, LEAST_ROOF_M2, Regions, Surface};
use crate::scene::bounds::Bounds;
use crate::scene::footprint;
use crate::scene::proxy::{Shape, Structure, StructureId};
use crate::scene::report::{ImportReport, ItemKind};
use crate::scene::terrain::Terrain;

/// What stands less than this above the ground is no roof, m: cars, hedges, garden walls.
pub(super) const LEAST_HEIGHT_M: f64 = 2.5;

/// Corners of outlines are moved by up to so many cells, and by this at least, m.
const TOLERANCE_CELLS: f64 = 0.9;
const LEAST_TOLERANCE_M: f64 = 0.8;

/// A prism ends at the height that this share of its cells does not exceed ...
const TOP_SHARE: f64 = 0.95;

/// ... and cells that stand more than this above it, m, become obstacles on it: chimneys, antennas, branches.
const MOST_OVER_M: f64 = 2.0;

/// Prisms and obstacles at most; of more the largest. What is beyond the prisms becomes an obstacle.
const MOST_ROOFS: usize = 4000;
const MOST_OBSTACLES: usize = 12_000;

/// What is smaller, and stands on the ground, is noise of the survey, m^2.
const LEAST_OBSTACLE_M2: f64 = 2.0;

/// Prisms reach so deep into the terrain, m.
const FOOTING_M: f64 = 0.5;

/// Holes of an outline below this are filled, m^2.
const LEAST_COURT_M2: f64 = 10.0;

/// Heights and ground of a scene, m in the file, and where they lie.
pub(super) struct Standing<'a> {
    pub heights: &'a Heights,
    pub ground_m: &'a [f32],
    /// In the local frame.
    pub terrain: &'a Terrain,
    /// From places in cells to the local frame.
    pub local: &'a Affine,
    pub cell_m: f64,
    /// Where the local frame has z = 0, m in the file.
    pub zero_m: f64,
}

/// What becomes of a region.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fate {
    Roof,
    Obstacle,
    Dropped,
}

/// The prisms and obstacles, named in the order of their first cells.
pub(super) fn structures(standing: &Standing, report: &mut ImportReport) -> Vec<Structure> {
    let heights_m = &standing.heights.surface.heights;
    let high = heights_m.iter().zip(standing.ground_m).map(|(z, ground)| f64::from(*z - *ground) >= LEAST_HEIGHT_M);
    let found = standing.regions(&high.collect::<Vec<bool>>(), standing.heights.is_building.as_deref());
    let fates = fates(&found, standing.cell_m);
    let tops_m = tops(&found, heights_m);
    note_fates(standing, &found, &fates, report);
    let mut structures = standing.prisms(&found, &fates, &tops_m, [0; 2]);
    let obstacles = structures.iter().filter(|structure| !structure.is_captured()).count();

    let is_over = |(z, label): (&f32, &u32)| {
        let region = (*label as usize).checked_sub(1).filter(|region| fates[*region] == Fate::Roof);
        region.is_some_and(|region| f64::from(*z) > tops_m[region][0] + MOST_OVER_M)
    };
    let over = standing.regions(&heights_m.iter().zip(&found.labels).map(is_over).collect::<Vec<bool>>(), None);
    let left = MOST_OBSTACLES - obstacles.min(MOST_OBSTACLES);
    let mut order: Vec<usize> = (0..over.regions.len()).collect();
    order.sort_by_key(|&index| (std::cmp::Reverse(over.regions[index].cells), index));
    let mut fates_over = vec![Fate::Dropped; over.regions.len()];
    order.iter().take(left).for_each(|&index| fates_over[index] = Fate::Obstacle);
    structures.extend(standing.prisms(&over, &fates_over, &tops(&over, heights_m), [0, obstacles]));
    report.notes.push(format!(
        "prisms end where {:.0} % of their cells do; {} places on them that stand {MOST_OVER_M} m higher and more are obstacles too{}",
        100.0 * TOP_SHARE,
        over.regions.len().min(left),
        if over.regions.len() > left { format!(", {} are left out", over.regions.len() - left) } else { String::new() }
    ));
    structures
}

impl Standing<'_> {
    fn regions(&self, is_high: &[bool], is_building: Option<&[bool]>) -> Regions {
        let surface = &self.heights.surface;
        regions::find(&Surface {
            columns: surface.columns,
            rows: surface.rows,
            cell_m: self.cell_m,
            heights_m: &surface.heights,
            is_high,
            is_building,
        })
    }

    /// The prisms of regions that are kept; `numbers` are those of the roofs and obstacles that there are already.
    fn prisms(&self, found: &Regions, fates: &[Fate], tops_m: &[[f64; 2]], mut numbers: [usize; 2]) -> Vec<Structure> {
        let surface = &self.heights.surface;
        let tolerance = TOLERANCE_CELLS.max(LEAST_TOLERANCE_M / self.cell_m);
        // Only what is kept has an outline, and only that shares walls.
        let is_kept = |label: &u32| *label != 0 && fates[*label as usize - 1] != Fate::Dropped;
        let kept: Vec<u32> = found.labels.iter().map(|label| if is_kept(label) { *label } else { 0 }).collect();
        let cells = Labels { labels: &kept, columns: surface.columns, rows: surface.rows };
        let outlines = outline::outlines(&cells, found.regions.len(), tolerance);
        let mut structures = Vec::new();
        for (index, outline) in outlines.iter().enumerate().filter(|(index, _)| fates[*index] != Fate::Dropped) {
            let area_m2 = found.regions[index].cells as f64 * self.cell_m * self.cell_m;
            let Some(footprint) = footprint(outline, self.local, area_m2) else { continue };
            let is_roof = fates[index] == Fate::Roof;
            let ground_m = Bounds::above(&footprint, 0.0, 0.0).map_or(0.0, |bounds| self.terrain.range_within_m(&bounds)[0]);
            let base_m = ((ground_m - FOOTING_M).max(0.0) * 100.0).floor() / 100.0;
            // Nothing of an obstacle is left out. At the foot of a slope the terrain, which is coarser, may lie above a low roof.
            let top_m = (tops_m[index][usize::from(!is_roof)] - self.zero_m).max(base_m + LEAST_HEIGHT_M);
            let top_m = (top_m * 100.0).ceil() / 100.0;
            let (number, kind) = if is_roof { (&mut numbers[0], "roof") } else { (&mut numbers[1], "obstacle") };
            *number += 1;
            let name = format!("{kind}-{number:03}");
            let shape = match is_roof {
                true => Shape::Prism { footprint, base_m, top_m },
                false => Shape::Obstacle { footprint, base_m, top_m },
            };
            structures.push(Structure { id: StructureId::of_name(&name), name, shape });
        }
        structures
    }
}

/// The largest regions become structures, those that are no buildings or small obstacles.
fn fates(found: &Regions, cell_m: f64) -> Vec<Fate> {
    let cell_m2 = cell_m * cell_m;
    let mut order: Vec<usize> = (0..found.regions.len()).collect();
    order.sort_by_key(|&index| (std::cmp::Reverse(found.regions[index].cells), index));
    let mut fates = vec![Fate::Dropped; found.regions.len()];
    let (mut roofs, mut obstacles) = (0, 0);
    for index in order {
        let region = &found.regions[index];
        let area_m2 = region.cells as f64 * cell_m2;
        let (count, fate) = match region.is_building && area_m2 >= LEAST_ROOF_M2 && roofs < MOST_ROOFS {
            true => (&mut roofs, Fate::Roof),
            false => (&mut obstacles, Fate::Obstacle),
        };
        if *count < MOST_OBSTACLES && area_m2 >= LEAST_OBSTACLE_M2 {
            *count += 1;
            fates[index] = fate;
        }
    }
    fates
}

fn note_fates(standing: &Standing, found: &Regions, fates: &[Fate], report: &mut ImportReport) {
    let count = |fate: Fate| fates.iter().filter(|own| **own == fate).count();
    report.notes.push(format!(
        "{} roofs; {} small regions joined to their neighbours; {} regions that are no roofs, most of them smaller than {LEAST_ROOF_M2} m^2, are \
         obstacles: kept clear of, not captured",
        count(Fate::Roof),
        found.joined,
        count(Fate::Obstacle)
    ));
    let dropped = count(Fate::Dropped);
    if dropped > 0 {
        report.count_up(ItemKind::TooSmall, dropped);
        report.notes.push(format!(
            "{dropped} regions are dropped, below {LEAST_OBSTACLE_M2} m^2 or beyond the largest {MOST_OBSTACLES}: nothing keeps flights clear of them"
        ));
    }
    report.notes.push(match standing.heights.is_building {
        Some(_) => "roofs are where points are marked as buildings; all else that is high is an obstacle".into(),
        None => "nothing tells trees from roofs here: every region that is high and large enough is taken for a roof".into(),
    });
}

/// The height of each region that all but a few of its cells stay below, and that of its highest cell, m in the file.
fn tops(found: &Regions, heights_m: &[f32]) -> Vec<[f64; 2]> {
    let mut of_regions: Vec<Vec<f32>> = found.regions.iter().map(|region| Vec::with_capacity(region.cells)).collect();
    for (label, z) in found.labels.iter().zip(heights_m).filter(|(label, _)| **label != 0) {
        of_regions[*label as usize - 1].push(*z);
    }
    let top = |mut heights: Vec<f32>| {
        let at = (TOP_SHARE * (heights.len().saturating_sub(1)) as f64).round() as usize;
        let highest = heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        if heights.is_empty() {
            [0.0; 2]
        } else {
            [*heights.select_nth_unstable_by(at, f32::total_cmp).1, highest].map(f64::from)
        }
    };
    of_regions.into_iter().map(top).collect()
}

/// The outline as a footprint in the local frame; `None` where nothing with an area is left of it.
fn footprint(outline: &Outline, local: &Affine, area_m2: f64) -> Option<MultiPolygon<f64>> {
    let moved = |ring: &Vec<Coord<f64>>| {
        let corner = |corner: &Coord<f64>| {
            // Whole centimetres: more than the heights tell.
            let [x, y] = local.at(corner.x, corner.y).map(|length_m| (length_m * 100.0).round() / 100.0);
            Coord { x, y }
        };
        LineString(ring.iter().map(corner).collect())
    };
    let court = |ring: &LineString<f64>| Polygon::new(ring.clone(), Vec::new()).unsigned_area() >= LEAST_COURT_M2;
    let holes: Vec<LineString<f64>> = outline.holes.iter().map(moved).filter(court).collect();
    let mut polygons: Vec<Polygon<f64>> = outline.outer.iter().map(|ring| Polygon::new(moved(ring), Vec::new())).collect();
    polygons.sort_by(|a, b| b.unsigned_area().total_cmp(&a.unsigned_area()));
    if let Some(first) = polygons.first_mut() {
        *first = Polygon::new(first.exterior().clone(), holes);
    }
    let footprint = footprint::repair_closed(&polygons, &mut Vec::new()).ok()?.orient(Direction::Default);
    // A thin region that has lost its shape is not what was seen.
    (footprint.unsigned_area() >= 0.25 * area_m2).then_some(footprint)
}
