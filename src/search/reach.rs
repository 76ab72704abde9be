//! What a rig can reach of each sample at all, by its views from all viewpoints together.

use nalgebra::Point3;
use overfly_table::{FieldTable, SampleSet};
use rayon::prelude::*;

use super::problem::is_framed;
use crate::camera::{Pose, Rig, View};
use crate::coverage::{Bearing, DiskModel, Mask, MatchedViews, Matching, SampleFrame};
use crate::field::Changes;
use crate::scene::Bounds;

/// What counts as seen and as matched.
#[derive(Clone, Copy)]
pub struct Seeing<'a> {
    pub field: &'a FieldTable<'a>,
    pub rig: &'a Rig,
    pub frames: &'a [SampleFrame],
    pub disks: &'a DiskModel,
    /// The disks reach less far than the field's.
    pub is_shorter: bool,
    pub matching: &'a Matching,
}

/// By sample, what no flight can exceed.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// Cells that the views cover.
    pub ceilings: Vec<u16>,
    /// Whether there are enough matched views.
    pub is_matchable: Vec<bool>,
}

impl Seeing<'_> {
    /// The viewpoints from which samples of `only` may be seen, in their order; all of them without it.
    fn viewpoints(&self, only: Option<&SampleSet>) -> Vec<(usize, Point3<f64>)> {
        let all = self.field.viewpoints.iter().map(|row| Point3::from(row.position_m)).enumerate();
        let Some(only) = only else { return all.collect() };
        let open = self.frames.iter().enumerate().filter(|(i, _)| only.contains(*i)).map(|(_, frame)| frame.position);
        let Some(bounds) = Bounds::of_points(open) else { return Vec::new() };
        let range_m = self.disks.range_m() * (1.0 + 1e-9);
        all.filter(|(_, position)| bounds.distance_squared(position) <= range_m * range_m).collect()
    }
}

impl Reach {
    pub fn new(seeing: &Seeing) -> Self {
        Self { ceilings: ceilings(seeing, None), is_matchable: matchable(seeing, None) }
    }

    /// The same from that of the field before, which differs by `changes`: only samples that are seen from elsewhere now are looked at.
    pub fn after(&self, seeing: &Seeing, changes: &Changes) -> Self {
        let mut open = SampleSet::none_of(changes.same.len());
        let looked_at = changes.same.iter().zip(&changes.is_touched).map(|(same, is_touched)| same.is_none() || *is_touched);
        looked_at.enumerate().filter(|(_, is_open)| *is_open).for_each(|(i, _)| open.insert(i));
        let (mut ceilings, mut is_matchable) = (ceilings(seeing, Some(&open)), matchable(seeing, Some(&open)));
        for (i, same) in changes.same.iter().enumerate().filter(|(i, _)| !open.contains(*i)) {
            let Some(old) = same.map(|old| old as usize) else { continue };
            (ceilings[i], is_matchable[i]) = (self.ceilings[old], self.is_matchable[old]);
        }
        Self { ceilings, is_matchable }
    }
}

/// Cells of each sample that the rig's views from all viewpoints, in all directions that it can take, cover; 0 for samples beyond `only` where
/// that is given. For a rig that sees in all directions this is a section of the field; for others the frustum is a further test on the same
/// visibility bits (section 5.4).
fn ceilings(seeing: &Seeing, only: Option<&SampleSet>) -> Vec<u16> {
    let Seeing { field, rig, frames, disks, is_shorter, .. } = *seeing;
    let directions = rig.pose_directions();
    let sees_all = directions == [None];
    if sees_all && !is_shorter {
        return field.ceilings.to_vec();
    }
    let nothing = || vec![0 as Mask; frames.len()];
    let unions = seeing.viewpoints(only).into_par_iter().fold(nothing, |mut union, (j, position)| {
        let row = field.row(j);
        let mut here = None;
        let mut see = |i: usize| {
            let views = here.get_or_insert_with(|| views(rig, position));
            if sees_all || is_framed(Some(views), &frames[i].position) {
                union[i] |= disks.mask(&frames[i], &position);
            }
        };
        match only {
            Some(only) => row.samples_in(only).for_each(&mut see),
            None => row.samples().for_each(&mut see),
        }
        union
    });
    let union = unions.reduce(nothing, |mut union, other| {
        union.iter_mut().zip(other).for_each(|(mask, other)| *mask |= other);
        union
    });
    union.into_iter().map(|mask| mask.count_ones() as u16).collect()
}

/// Which samples the rig's views from the viewpoints give enough matched views; none beyond `only` where that is given.
fn matchable(seeing: &Seeing, only: Option<&SampleSet>) -> Vec<bool> {
    let Seeing { field, rig, frames, disks, matching, .. } = *seeing;
    let mut samples = vec![MatchedViews::default(); frames.len()];
    let all = || {
        let mut all = SampleSet::none_of(frames.len());
        (0..frames.len()).for_each(|i| all.insert(i));
        all
    };
    let mut open = only.map_or_else(all, SampleSet::clone);
    let most_tried = MOST_TRIED_VIEWS.max(4 * matching.least_views as usize);
    let mut seen = Vec::new();
    for (j, position) in seeing.viewpoints(only) {
        seen.clear();
        seen.extend(field.row(j).samples_in(&open));
        if seen.is_empty() {
            continue;
        }
        let views = views(rig, position);
        for &i in &seen {
            let frame = &frames[i];
            if (views.is_empty() || is_framed(Some(&views), &frame.position)) && disks.faces(frame, &position) {
                samples[i].add(matching, Bearing::new(&frame.position, &position));
                if samples[i].matched() >= matching.least_views || samples[i].len() >= most_tried {
                    open.remove(i);
                }
            }
        }
    }
    samples.iter().map(|views| views.matched() >= matching.least_views).collect()
}

/// The frusta of a rig at a place, in all directions that it can take; none for one that sees in all directions.
fn views(rig: &Rig, position: Point3<f64>) -> Vec<View> {
    rig.pose_directions().iter().filter_map(|&direction| rig.frusta(&Pose { position, direction })).flatten().collect()
}

/// A sample with so many views, too few of which match, is given up; more where more are needed.
const MOST_TRIED_VIEWS: usize = 64;
