//! How much of each wall and roof a plan captures.

use nalgebra::Vector2;
use overfly_table::FieldTable;
use overfly_table::field::{PointRow, SampleRow, StructureRow};

use crate::trajectory::plan::Plan;

/// Normals steeper than this against the horizontal belong to roofs (cosine of the angle to the vertical).
const ROOF_NORMAL_Z: f64 = 0.5;
/// A wall sample belongs to an edge whose outward normal deviates by less than 60 degrees.
const MATCHING_NORMAL: f64 = 0.5;

/// Counts of exposed samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub exposed: u32,
    /// Samples that all admissible views together would capture.
    pub capturable: u32,
    /// Samples that the plan captures.
    pub captured: u32,
}

/// The tallies of one structure.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StructureTally {
    /// By ring of the outline, then by edge: edge `k` runs from point `k` to the next one, the last edge back to the first point.
    pub walls: Vec<Vec<Tally>>,
    pub roof: Tally,
    /// Samples that belong to neither: undersides, and slanted faces of a mesh that match no edge of its outline.
    pub other: Tally,
}

impl Tally {
    /// Captured share of the exposed samples, 0 to 1; `None` where nothing is exposed.
    pub fn share(&self) -> Option<f64> {
        (self.exposed > 0).then(|| f64::from(self.captured) / f64::from(self.exposed))
    }

    fn count(&mut self, is_capturable: bool, is_captured: bool) {
        self.exposed += 1;
        self.capturable += u32::from(is_capturable);
        self.captured += u32::from(is_captured);
    }
}

impl StructureTally {
    /// The walls of all rings together.
    pub fn all_walls(&self) -> Tally {
        self.walls.iter().flatten().fold(Tally::default(), |sum, wall| Tally {
            exposed: sum.exposed + wall.exposed,
            capturable: sum.capturable + wall.capturable,
            captured: sum.captured + wall.captured,
        })
    }
}

/// Tallies the exposed samples of every structure of `field`, in its order.
pub fn tally(field: &FieldTable, plan: &Plan) -> Vec<StructureTally> {
    let mut tallies: Vec<StructureTally> = field.structures.iter().map(|structure| empty(field, structure)).collect();
    let threshold = field.facts.threshold_cells;
    for (index, sample) in field.samples.iter().enumerate().filter(|(_, sample)| sample.exposed == 1) {
        let is_captured = u32::from(plan.cells[index]) > threshold;
        let is_capturable = plan.is_capturable(index, threshold);
        let structure = &field.structures[sample.structure as usize];
        let tally = &mut tallies[sample.structure as usize];
        face(field, structure, sample, tally).count(is_capturable, is_captured);
    }
    tallies
}

/// Whether a sample counts for the roof of its structure.
pub fn is_roof(sample: &SampleRow) -> bool {
    sample.normal[2] > ROOF_NORMAL_Z
}

fn empty(field: &FieldTable, structure: &StructureRow) -> StructureTally {
    let walls = field.outline(structure).map(|ring| vec![Tally::default(); ring.len()]).collect();
    StructureTally { walls, ..Default::default() }
}

fn face<'a>(field: &FieldTable, structure: &StructureRow, sample: &SampleRow, tally: &'a mut StructureTally) -> &'a mut Tally {
    if is_roof(sample) {
        return &mut tally.roof;
    }
    match nearest_wall(field, structure, sample) {
        Some((ring, edge)) => &mut tally.walls[ring][edge],
        None => &mut tally.other,
    }
}

/// Ring and edge of the nearest edge that faces the same way as the sample; of equally near ones the first.
fn nearest_wall(field: &FieldTable, structure: &StructureRow, sample: &SampleRow) -> Option<(usize, usize)> {
    let position = Vector2::new(sample.position_m[0], sample.position_m[1]);
    let facing = Vector2::new(sample.normal[0], sample.normal[1]).try_normalize(1e-9)?;
    let mut nearest: Option<(f64, (usize, usize))> = None;
    for (ring_index, ring) in field.outline(structure).enumerate() {
        for edge_index in 0..ring.len() {
            let (from, to) = edge(ring, edge_index);
            // Exteriors run counter-clockwise and holes clockwise, so the outside is always to the right of an edge.
            let Some(along) = (to - from).try_normalize(1e-9) else { continue };
            if Vector2::new(along.y, -along.x).dot(&facing) <= MATCHING_NORMAL {
                continue;
            }
            let distance = distance_to_segment(&position, &from, &to);
            if nearest.is_none_or(|(least, _)| distance < least) {
                nearest = Some((distance, (ring_index, edge_index)));
            }
        }
    }
    nearest.map(|(_, wall)| wall)
}

/// Both ends of edge `index` of a ring.
pub fn edge(ring: &[PointRow], index: usize) -> (Vector2<f64>, Vector2<f64>) {
    (Vector2::from(ring[index]), Vector2::from(ring[(index + 1) % ring.len()]))
}

fn distance_to_segment(point: &Vector2<f64>, from: &Vector2<f64>, to: &Vector2<f64>) -> f64 {
    let along = to - from;
    let share = ((point - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (point - (from + along * share)).norm()
}
