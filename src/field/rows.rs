//! The visibility rows of a field (Algorithm 1).

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Point3;
use overfly_table::rows::PATCH;
use overfly_table::{Block, Segment, SegmentRows, TableMemory};
use rayon::prelude::*;

use super::build::FieldInputs;
use super::survey::FieldError;
use super::tiles::{Reach, Tile};
use crate::coverage::{Mask, SampleFrame};
use crate::scene::Bounds;
use crate::stop::{Part, StopToken};

/// Gives memory for a segment of so many blocks, all zero, and lets it be written once.
pub type Place<'p, E> = dyn Fn(usize, &dyn Fn(&mut [Block])) -> Result<Arc<dyn TableMemory>, E> + Sync + 'p;

/// What can be seen from where.
pub struct Visibility {
    /// By tile.
    pub segments: Vec<Segment>,
    /// By tile: first sample of each patch of its segment.
    pub patches: Vec<Vec<u32>>,
    /// What all viewpoints together cover of each sample.
    pub unions: Vec<Mask>,
    /// The samples with the axes of their hemispheres.
    pub frames: Vec<SampleFrame>,
}

/// Algorithm 1: for each viewpoint c_j, for each sample s_i, whether s_i is visible to c_j. Parallel over tiles.
pub fn build_rows<E: From<FieldError> + Send>(
    inputs: &FieldInputs,
    tiles: &[Tile],
    place: &Place<E>,
    stop: &StopToken,
) -> Result<Visibility, E> {
    let (targets, groups) = (Targets::new(inputs), Group::all(inputs));
    let unions = Mutex::new(vec![0; inputs.samples.samples.len()]);
    stop.begin(Part::Rays, tiles.iter().map(Tile::viewpoints).sum::<usize>() as u64);
    let of_tile = |tile: &Tile| {
        let reach = Reach::of(&tile.bounds, inputs.reach_m(), &groups);
        let (mut union, mut bits, mut rows) = (reach.masks(), reach.row(), SegmentRows::default());
        for site in tile.sites() {
            if stop.is_stopped() {
                return Err(FieldError::Stopped.into());
            }
            let view = site.viewpoint.position;
            targets.seen_from(inputs, &reach, &view, |i, patch, offset| {
                bits.mark(patch, offset);
                union[patch * PATCH + offset] |= inputs.disks.mask(&targets.frames[i], &view);
            });
            bits.end(&mut rows);
            stop.advance(1);
        }
        reach.merge(&union, &mut unions.lock().unwrap_or_else(PoisonError::into_inner));
        let patches = reach.number(&mut rows);
        Ok((write(&rows, place)?, patches))
    };
    let rows: Result<Vec<_>, E> = tiles.par_iter().with_max_len(1).map(of_tile).collect();
    let (segments, patches) = rows?.into_iter().unzip();
    let unions = unions.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Visibility { segments, patches, unions, frames: targets.frames })
}

/// Writes the rows of a tile into memory of their own.
pub fn write<E: From<FieldError>>(rows: &SegmentRows, place: &Place<E>) -> Result<Segment, E> {
    let memory = place(rows.blocks(), &|blocks| rows.write(blocks))?;
    Segment::open(memory).map_err(|error| FieldError::from(error).into())
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
        (0..inputs.scene.structures.len()).into_par_iter().filter_map(group).collect()
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
        let frames = samples.par_iter().map(|sample| SampleFrame::new(sample.position, sample.normal)).collect();
        let ends = samples.par_iter().map(|sample| sample.position + sample.normal * inputs.offset_m).collect();
        Self { frames, ends }
    }

    /// Calls `see` for each sample that can be seen from a place, with the first patch of its structure and its place among the structure's samples.
    pub fn seen_from(&self, inputs: &FieldInputs, reach: &Reach, view: &Point3<f64>, mut see: impl FnMut(usize, usize, usize)) {
        let reach_m = inputs.reach_m();
        for (group, patch) in &reach.groups {
            if group.bounds.distance_squared(view) > reach_m * reach_m {
                continue;
            }
            let seen = group.samples.clone().zip(0..).filter(|(i, _)| self.is_seen(inputs, *i, view));
            seen.for_each(|(i, offset)| see(i, *patch, offset));
        }
    }

    /// Whether a sample is seen from a place if nothing stands between.
    pub fn faces(&self, inputs: &FieldInputs, i: usize, view: &Point3<f64>) -> bool {
        inputs.samples.samples[i].exposed && inputs.disks.faces(&self.frames[i], view)
    }

    pub fn is_seen(&self, inputs: &FieldInputs, i: usize, view: &Point3<f64>) -> bool {
        self.faces(inputs, i, view) && !inputs.free.clearance.occluded(view, &self.ends[i])
    }
}
