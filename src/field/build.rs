//! Building the field in place (Algorithm 1).

use std::ops::Range;
use std::sync::Arc;

use geo::Coord;
use nalgebra::Point3;
use overfly_table::field::{FieldCounts, FieldFacts, RingRow, SampleRow, StructureRow, ViewpointRow};
use overfly_table::{Block, FieldTableMut};
use rayon::prelude::*;

use super::viewpoints::Viewpoint;
use crate::coverage::{DiskModel, Mask, SampleFrame};
use crate::scene::clearance::Clearance;
use crate::scene::differences::Differences;
use crate::scene::{Bounds, Scene, Structure};
use crate::stop::StopToken;
use crate::surface::Samples;

/// What the field of one revision is built from.
#[derive(Clone, Copy, Debug)]
pub struct FieldInputs<'a> {
    pub scene: &'a Scene,
    pub outlines: &'a Outlines,
    pub clearance: &'a Clearance,
    pub samples: &'a Samples,
    pub viewpoints: &'a [Viewpoint],
    pub disks: &'a DiskModel,
    pub facts: FieldFacts,
    /// How far in front of a sample a line of sight ends, m, so that it does not end in the sample's own surface.
    pub offset_m: f64,
}

/// The rings of every structure seen from above, without the repeated last corner.
#[derive(Debug)]
pub struct Outlines(Vec<Arc<Vec<Vec<Coord>>>>);

impl Outlines {
    /// Casts the shadows of all structures, in parallel: that of a mesh is a union of its triangles.
    pub fn new(scene: &Scene) -> Self {
        Self(scene.structures.par_iter().map(|structure| Arc::new(rings(structure))).collect())
    }

    /// The same of a scene that differs from an earlier one with the outlines `before`.
    pub fn after(before: &Self, scene: &Scene, differences: &Differences) -> Self {
        let of_structure = |(structure, kept): (&Arc<Structure>, &Option<usize>)| match kept {
            Some(old) => Arc::clone(&before.0[*old]),
            None => Arc::new(rings(structure)),
        };
        Self(scene.structures.iter().zip(&differences.kept).map(of_structure).collect())
    }

    /// The rings of structure `index` of the scene, m.
    pub fn rings(&self, index: usize) -> &[Vec<Coord>] {
        &self.0[index]
    }
}

/// The size of the field's table.
pub fn counts(scene: &Scene, outlines: &Outlines, samples: usize, viewpoints: usize) -> FieldCounts {
    let rings = || outlines.0.iter().flat_map(|rings| rings.iter());
    FieldCounts {
        samples,
        viewpoints,
        structures: scene.structures.len(),
        rings: rings().count(),
        points: rings().map(Vec::len).sum(),
        name_bytes: scene.structures.iter().map(|structure| structure.name.len()).sum(),
    }
}

/// Fills `blocks` in parallel over viewpoints: what is seen from where by `visibility`, which is given the empty rows and the words of each and
/// returns what all viewpoints together cover of each sample. `None` when stopped; the blocks then hold nothing of use.
pub fn fill_table(
    inputs: &FieldInputs,
    counts: &FieldCounts,
    blocks: &mut [Block],
    visibility: impl FnOnce(&mut [u64], usize) -> Option<Vec<Mask>>,
) -> Option<Vec<Mask>> {
    let mut table = FieldTableMut::create(blocks, counts, inputs.facts);
    write_structures(inputs, &mut table);
    for (row, sample) in table.samples.iter_mut().zip(&inputs.samples.samples) {
        *row = SampleRow {
            position_m: sample.position.coords.into(),
            normal: sample.normal.into(),
            area_mm2: sample.area_mm2,
            structure: sample.structure,
            exposed: u32::from(sample.exposed),
        };
    }
    for (row, viewpoint) in table.viewpoints.iter_mut().zip(inputs.viewpoints) {
        *row = ViewpointRow { position_m: viewpoint.position.coords.into(), clearance_m: viewpoint.clearance_m };
    }
    let unions = visibility(table.visibility, table.words_per_row)?;
    for (cells, mask) in table.ceilings.iter_mut().zip(&unions) {
        *cells = mask.count_ones() as u16;
    }
    Some(unions)
}

/// Algorithm 1: for each viewpoint c_j, for each sample s_i, whether s_i is visible to c_j. Returns the union of all disks of each
/// sample, which no path can exceed.
pub fn build_visibility(
    inputs: &FieldInputs,
    visibility: &mut [u64],
    words_per_row: usize,
    stop: &StopToken,
) -> Option<Vec<Mask>> {
    let (targets, groups) = (Targets::new(inputs), Group::all(inputs));
    let rows = visibility.par_chunks_mut(words_per_row.max(1)).zip(inputs.viewpoints);
    let nothing = || vec![0 as Mask; inputs.samples.samples.len()];
    rows.try_fold(nothing, |mut union, (row, viewpoint)| {
        if stop.is_stopped() {
            return None;
        }
        for i in targets.seen_from(inputs, &groups, &viewpoint.position) {
            row[i / 64] |= 1 << (i % 64);
            union[i] |= inputs.disks.mask(&targets.frames[i], &viewpoint.position);
        }
        Some(union)
    })
    .try_reduce(nothing, |mut union, other| {
        union.iter_mut().zip(other).for_each(|(mask, other)| *mask |= other);
        Some(union)
    })
}

/// The samples of one structure with the box around them and the ends of their lines of sight.
pub struct Group {
    pub samples: Range<usize>,
    pub bounds: Bounds,
}

impl Group {
    pub fn all(inputs: &FieldInputs) -> Vec<Self> {
        let group = |index: usize| {
            let samples = inputs.samples.range(index);
            let bounds = Bounds::of_points(inputs.samples.samples[samples.clone()].iter().map(|sample| sample.position))?;
            Some(Self { samples, bounds: bounds.grown(inputs.offset_m) })
        };
        (0..inputs.scene.structures.len()).filter_map(group).collect()
    }
}

/// The samples as targets of lines of sight.
pub struct Targets {
    pub frames: Vec<SampleFrame>,
    pub ends: Vec<Point3<f64>>,
}

impl Targets {
    pub fn new(inputs: &FieldInputs) -> Self {
        let samples = &inputs.samples.samples;
        let frames: Vec<_> = samples.iter().map(|sample| SampleFrame::new(sample.position, sample.normal)).collect();
        let ends = samples.iter().map(|sample| sample.position + sample.normal * inputs.offset_m).collect();
        Self { frames, ends }
    }

    /// The samples that can be seen from a place, in ascending order.
    pub fn seen_from<'a>(
        &'a self,
        inputs: &'a FieldInputs,
        groups: &'a [Group],
        view: &'a Point3<f64>,
    ) -> impl Iterator<Item = usize> + 'a {
        // Rounding must not cut off a sample at the very end of the range.
        let range_m = inputs.disks.range_m() * (1.0 + 1e-9);
        let in_range = move |group: &&Group| group.bounds.distance_squared(view) <= range_m * range_m;
        groups.iter().filter(in_range).flat_map(|group| group.samples.clone()).filter(move |&i| self.is_seen(inputs, i, view))
    }

    pub fn is_seen(&self, inputs: &FieldInputs, i: usize, view: &Point3<f64>) -> bool {
        inputs.samples.samples[i].exposed
            && inputs.disks.faces(&self.frames[i], view)
            && !inputs.clearance.occluded(view, &self.ends[i])
    }
}

fn write_structures(inputs: &FieldInputs, table: &mut FieldTableMut) {
    let (mut ring, mut point, mut name_byte) = (0, 0, 0);
    for (index, (row, structure)) in table.structures.iter_mut().zip(&inputs.scene.structures).enumerate() {
        let outlines = &inputs.outlines.0[index];
        let name = structure.name.as_bytes();
        let samples = inputs.samples.range(index);
        *row = structure_row(structure, [samples.start, samples.len(), ring, outlines.len(), name_byte, name.len()]);
        for outline in outlines.iter() {
            table.rings[ring] = RingRow { first_point: point as u32, points: outline.len() as u32 };
            for &Coord { x, y } in outline {
                table.points[point] = [x, y];
                point += 1;
            }
            ring += 1;
        }
        table.names[name_byte..name_byte + name.len()].copy_from_slice(name);
        name_byte += name.len();
    }
}

fn rings(structure: &Structure) -> Vec<Vec<Coord>> {
    let open = |ring: &geo::LineString| ring.0[..ring.0.len().saturating_sub(1)].to_vec();
    let outlines = structure.outlines();
    outlines.iter().flat_map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(open)).collect()
}

fn structure_row(structure: &Structure, places: [usize; 6]) -> StructureRow {
    let bounds = structure.bounds();
    let [first_sample, samples, first_ring, rings, first_name_byte, name_bytes] = places.map(|v| v as u32);
    StructureRow {
        id: structure.id.0,
        base_m: bounds.min.z,
        top_m: bounds.max.z,
        first_sample,
        samples,
        first_ring,
        rings,
        first_name_byte,
        name_bytes,
    }
}
