//! What a rig can reach of each sample at all, by its views from all viewpoints together.

use nalgebra::{Point3, Vector3};
use overfly_table::{FieldTable, Row, SampleSet};
use rayon::prelude::*;

use crate::camera::{Pose, Rig, View};
use crate::coverage::{Bearing, DiskModel, Mask, MatchedViews, Matching, SampleFrame};
use crate::field::Changes;
use crate::scene::Bounds;
use crate::stop::StopToken;

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
    pub stop: &'a StopToken,
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

/// Nobody looks at what comes of it once it is abandoned.
impl Reach {
    /// For who does not ask: no sample can be captured or matched.
    pub fn nothing(samples: usize) -> Self {
        Self { ceilings: vec![0; samples], is_matchable: vec![false; samples] }
    }

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
    let Seeing { field, rig, frames, disks, is_shorter, stop, .. } = *seeing;
    let views = Views::of(rig);
    if views.0.is_none() && !is_shorter {
        return field.ceilings.to_vec();
    }
    let nothing = || vec![0 as Mask; frames.len()];
    let unions = seeing.viewpoints(only).into_par_iter().fold(nothing, |mut union, (j, position)| {
        let row = if stop.is_abandoned() { Row::NOTHING } else { field.row(j) };
        let mut latest = 0;
        let mut see = |i: usize| {
            if views.frame(&(frames[i].position - position), &mut latest) {
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
    let Seeing { field, rig, frames, disks, matching, stop, .. } = *seeing;
    let mut samples = vec![MatchedViews::default(); frames.len()];
    let all = || {
        let mut all = SampleSet::none_of(frames.len());
        (0..frames.len()).for_each(|i| all.insert(i));
        all
    };
    let mut open = only.map_or_else(all, SampleSet::clone);
    let most_tried = MOST_TRIED_VIEWS.max(4 * matching.least_views as usize);
    let (views, mut latest, mut seen) = (Views::of(rig), 0, Vec::new());
    for (j, position) in seeing.viewpoints(only).into_iter().take_while(|_| !stop.is_abandoned()) {
        seen.clear();
        seen.extend(field.row(j).samples_in(&open));
        for &i in &seen {
            let frame = &frames[i];
            if views.frame(&(frame.position - position), &mut latest) && disks.faces(frame, &position) {
                samples[i].add(matching, Bearing::new(&frame.position, &position));
                if samples[i].matched() >= matching.least_views || samples[i].len() >= most_tried {
                    open.remove(i);
                }
            }
        }
    }
    samples.iter().map(|views| views.matched() >= matching.least_views).collect()
}

/// The frusta of a rig in all directions that it can take, wherever it is; `None` for one that sees in all directions.
struct Views(Option<Vec<View>>);

impl Views {
    fn of(rig: &Rig) -> Self {
        let frusta = |direction| rig.frusta(&Pose { position: Point3::origin(), direction });
        let frusta: Option<Vec<_>> = rig.pose_directions().into_iter().map(frusta).collect();
        Self(frusta.map(|frusta| frusta.into_iter().flatten().collect()))
    }

    /// Whether any of them frames a target that is so far away, m. Most targets are framed by the view that framed the one before: it is asked first.
    fn frame(&self, to_target: &Vector3<f64>, latest: &mut usize) -> bool {
        let Some(views) = &self.0 else { return true };
        let frames = |k: &usize| views[*k].frames_towards(to_target);
        let found = std::iter::once(*latest).chain(0..views.len()).find(frames);
        *latest = found.unwrap_or(*latest);
        found.is_some()
    }
}

/// A sample with so many views, too few of which match, is given up; more where more are needed.
const MOST_TRIED_VIEWS: usize = 64;
