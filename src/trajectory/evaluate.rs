//! The figures of a finished plan, by exact rays from the images' true poses (never from rows of the field).

use nalgebra::Point3;
use overfly_table::field::SampleRow;
use rayon::prelude::*;

use super::places::Places;
use super::plan::Image;
use crate::camera::View;
use crate::coverage::{Bearing, DiskModel, Information, Mask, MatchedViews, SampleFrame};
use crate::field::Snapshot;
use crate::search::Problem;
use crate::stop::{StopToken, free_behind};

/// Which images see which samples: for each sample of the field the images that see it, in their order.
#[derive(Clone, Debug, PartialEq)]
pub struct Sightings(pub Vec<Vec<Sighting>>);

/// How an image sees a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sighting {
    pub image: u32,
    /// The cells of its disk.
    pub mask: Mask,
    pub bearing: Bearing,
}

/// What a set of images captures.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Covered cells of each sample.
    pub cells: Vec<u16>,
    pub information: Information,
    /// Capturable samples with r > h.
    pub captured: u32,
    /// Shares of samples with r > h, percent.
    pub coverage_percent: f64,
    pub coverage_exposed_percent: f64,
    /// Share of the exposed samples that can be captured at all, percent.
    pub capturable_percent: f64,
    /// Samples with enough matched views of those that can have them, and their share, percent.
    pub matched: u32,
    pub matched_percent: f64,
}

/// How many cells of each sample are covered, and which samples have enough matched views.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally {
    pub cells: Vec<u16>,
    pub is_matched: Vec<bool>,
    /// The samples whose matches were counted: those that can have enough.
    pub is_matchable: Vec<bool>,
    /// The samples that images show which were taken before the flight: they are counted as well.
    pub is_captured: Vec<bool>,
}

/// Casts every line of sight between the images and the exposed samples, in parallel over samples. `None` when abandoned.
pub fn sightings(snapshot: &Snapshot, disks: &DiskModel, images: &[Image], stop: &StopToken) -> Option<Sightings> {
    let caster = Caster::new(snapshot, disks, images);
    let places = Places::new((0..).zip(images.iter().map(|image| image.position_m)), disks.range_m());
    let rows = (0..caster.samples.len()).into_par_iter().map(|i| {
        if stop.is_abandoned() {
            return None;
        }
        let Some(sample) = caster.sample(i) else { return Some(Vec::new()) };
        let near = places.within(&sample.position);
        Some(caster.seen_by(&sample, &near).collect())
    });
    let rows: Vec<Option<Vec<Sighting>>> = rows.collect();
    if stop.is_abandoned() {
        free_behind(rows);
        return None;
    }
    rows.into_iter().collect::<Option<_>>().map(Sightings)
}

/// Casts lines of sight between images and samples.
pub struct Caster<'a> {
    pub images: &'a [Image],
    views: Vec<Option<View>>,
    samples: &'a [SampleRow],
    snapshot: &'a Snapshot,
    disks: &'a DiskModel,
}

impl<'a> Caster<'a> {
    pub fn new(snapshot: &'a Snapshot, disks: &'a DiskModel, images: &'a [Image]) -> Self {
        let views = images.par_iter().map(Image::view).collect();
        Self { images, views, samples: snapshot.field().samples, snapshot, disks }
    }

    /// Sample `i` if it lies on the outside of the scene.
    pub fn sample(&self, i: usize) -> Option<SampleFrame> {
        (self.samples[i].exposed != 0).then(|| self.snapshot.frames()[i])
    }

    /// Where the lines of sight to a sample end.
    pub fn end(&self, sample: &SampleFrame) -> Point3<f64> {
        sample.position + sample.normal * self.snapshot.offset_m
    }

    /// Whether an image shows a sample if nothing stands between.
    pub fn may_see(&self, sample: &SampleFrame, index: usize) -> bool {
        self.disks.faces(sample, &self.images[index].position_m) && self.is_framed(sample, index)
    }

    fn is_framed(&self, sample: &SampleFrame, index: usize) -> bool {
        self.views[index].as_ref().is_none_or(|view| view.frames(&sample.position))
    }

    /// Which of the `near` images see a sample.
    pub fn seen_by<'b>(&'b self, sample: &'b SampleFrame, near: &'b [usize]) -> impl Iterator<Item = Sighting> + 'b {
        let end = self.end(sample);
        // The cameras of a rig stand at one place, so that one ray does for all of them.
        let mut known: Option<(Point3<f64>, Mask)> = None;
        let mut mask = move |position: Point3<f64>| match known {
            Some((at, mask)) if at == position => mask,
            _ => {
                let is_seen = self.disks.faces(sample, &position) && !self.snapshot.free.clearance.occluded(&position, &end);
                let mask = if is_seen { self.disks.exact_mask(sample, &position) } else { 0 };
                known = Some((position, mask));
                mask
            }
        };
        near.iter().filter_map(move |&index| {
            let position = self.images[index].position_m;
            let mask = if self.is_framed(sample, index) { mask(position) } else { 0 };
            (mask != 0).then(|| Sighting { image: index as u32, mask, bearing: Bearing::new(&sample.position, &position) })
        })
    }
}

impl Tally {
    pub fn nothing(samples: usize) -> Self {
        let none = || vec![false; samples];
        Self { cells: vec![0; samples], is_matched: none(), is_matchable: none(), is_captured: none() }
    }

    /// Counts the images for which `counts` holds, and those that were taken before the flight.
    pub fn of(sightings: &Sightings, problem: &Problem, counts: &(dyn Fn(u32) -> bool + Sync)) -> Self {
        let of_sample =
            |(i, seen): (usize, &Vec<Sighting>)| Self::of_sample(problem, i, seen.iter().filter(|one| counts(one.image)));
        let (cells, is_matched) = sightings.0.par_iter().enumerate().map(of_sample).unzip();
        Self { cells, is_matched, is_matchable: problem.matchable.clone(), is_captured: Self::captured(problem) }
    }

    /// The samples that images show which were taken before the flight.
    pub fn captured(problem: &Problem) -> Vec<bool> {
        (0..problem.frames.len()).map(|i| !problem.captured_views(i).is_empty()).collect()
    }

    /// Covered cells of one sample, and whether it has enough matched views if it can have them, with the images that were taken before the flight.
    pub fn of_sample<'s>(problem: &Problem, i: usize, seen: impl Iterator<Item = &'s Sighting> + Clone) -> (u16, bool) {
        let cells = seen.clone().fold(problem.captured_mask(i), |mask, one| mask | one.mask).count_ones() as u16;
        let before = problem.captured_views(i).iter().map(|&(_, bearing)| bearing);
        let mut views = MatchedViews::default();
        // More views never match less.
        let is_matched = problem.matchable[i]
            && before.chain(seen.map(|one| one.bearing)).any(|bearing| {
                views.add(&problem.matching, bearing);
                views.matched() >= problem.matching.least_views
            });
        (cells, is_matched)
    }
}

impl Sightings {
    /// What the images for which `counts` holds capture together with those that were taken before the flight.
    pub fn capture(&self, problem: &Problem, counts: impl Fn(u32) -> bool + Sync) -> Capture {
        Capture::of(problem, &Tally::of(self, problem, &counts))
    }
}

impl Capture {
    pub fn of(problem: &Problem, tally: &Tally) -> Self {
        let Tally { cells, is_matched, .. } = tally;
        let samples = problem.field.samples;
        let threshold = problem.field.facts.threshold_cells;
        let number = |counts: &dyn Fn(usize) -> bool| (0..cells.len()).filter(|&i| counts(i)).count() as f64;
        let above = |i: usize| u32::from(cells[i]) > threshold;
        let exposed = number(&|i| samples[i].exposed == 1);
        let capturable = f64::from(problem.capturable);
        let captured = number(&|i| problem.is_capturable(i) && above(i));
        let matchable = number(&|i| problem.matchable[i]);
        let matched = number(&|i| is_matched[i]);
        Self {
            matched: matched as u32,
            matched_percent: percent(matched, matchable),
            captured: captured as u32,
            information: cells.iter().zip(samples).map(|(&cells, row)| u64::from(cells) * row.area_mm2).sum(),
            coverage_percent: percent(captured, capturable),
            coverage_exposed_percent: percent(number(&above), exposed),
            capturable_percent: percent(capturable, exposed),
            cells: cells.clone(),
        }
    }
}

fn percent(part: f64, whole: f64) -> f64 {
    if whole == 0.0 { 100.0 } else { 100.0 * part / whole }
}
