//! The figures of a finished plan, by exact rays from the images' true poses (never from rows of the field).

use nalgebra::Point3;
use rayon::prelude::*;

use super::plan::Image;
use crate::camera::View;
use crate::coverage::{Bearing, DiskModel, Information, Mask, MatchedViews, SampleFrame};
use crate::field::Snapshot;
use crate::search::Problem;
use crate::stop::StopToken;

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

/// Casts every line of sight between the images and the exposed samples, in parallel over samples. `None` when abandoned.
pub fn sightings(snapshot: &Snapshot, disks: &DiskModel, images: &[Image], stop: &StopToken) -> Option<Sightings> {
    let field = snapshot.field();
    let views: Vec<Option<View>> = images.iter().map(Image::view).collect();
    let strip = Strip::new(images);
    let rows = field.samples.par_iter().map(|row| {
        if row.exposed == 0 {
            return Some(Vec::new());
        }
        let sample = SampleFrame::new(row.position_m.into(), row.normal.into());
        let near = || strip.within(sample.position.x, disks.range_m());
        (!stop.is_abandoned()).then(|| seen_by(snapshot, disks, images, &views, &sample, near()))
    });
    rows.collect::<Option<_>>().map(Sightings)
}

/// Images from west to east, so that a sample need not look at those of the whole town.
struct Strip(Vec<(f64, usize)>);

impl Strip {
    fn new(images: &[Image]) -> Self {
        let mut places: Vec<_> = images.iter().enumerate().map(|(index, image)| (image.position_m.x, index)).collect();
        places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        Self(places)
    }

    /// The images no farther than `range_m` to the east or west, in their order.
    fn within(&self, x_m: f64, range_m: f64) -> Vec<usize> {
        let reach_m = range_m * (1.0 + 1e-9);
        let [from, to] = [x_m - reach_m, x_m + reach_m].map(|x_m| self.0.partition_point(|place| place.0 < x_m));
        let mut near: Vec<usize> = self.0[from..to].iter().map(|place| place.1).collect();
        near.sort_unstable();
        near
    }
}

fn seen_by(
    snapshot: &Snapshot,
    disks: &DiskModel,
    images: &[Image],
    views: &[Option<View>],
    sample: &SampleFrame,
    near: Vec<usize>,
) -> Vec<Sighting> {
    let end: Point3<f64> = sample.position + sample.normal * snapshot.offset_m;
    // The cameras of a rig stand at one place, so that one ray does for all of them.
    let mut known: Option<(Point3<f64>, Mask)> = None;
    let mut mask = |position: Point3<f64>| match known {
        Some((at, mask)) if at == position => mask,
        _ => {
            let is_seen = disks.faces(sample, &position) && !snapshot.free.clearance.occluded(&position, &end);
            let mask = if is_seen { disks.exact_mask(sample, &position) } else { 0 };
            known = Some((position, mask));
            mask
        }
    };
    let sighting = |index: usize| {
        let (position, view) = (images[index].position_m, &views[index]);
        let is_framed = view.as_ref().is_none_or(|view| view.frames(&sample.position));
        let mask = if is_framed { mask(position) } else { 0 };
        (mask != 0).then(|| Sighting { image: index as u32, mask, bearing: Bearing::new(&sample.position, &position) })
    };
    near.into_iter().filter_map(sighting).collect()
}

impl Sightings {
    /// What the images for which `counts` holds capture together.
    pub fn capture(&self, problem: &Problem, counts: impl Fn(u32) -> bool) -> Capture {
        let union = |seen: &Vec<Sighting>| seen.iter().filter(|one| counts(one.image)).fold(0, |mask, one| mask | one.mask);
        let cells: Vec<u16> = self.0.iter().map(|seen| union(seen).count_ones() as u16).collect();
        let samples = problem.field.samples;
        let threshold = problem.field.facts.threshold_cells;
        let number = |counts: &dyn Fn(usize) -> bool| (0..cells.len()).filter(|&i| counts(i)).count() as f64;
        let above = |i: usize| u32::from(cells[i]) > threshold;
        let exposed = number(&|i| samples[i].exposed == 1);
        let capturable = f64::from(problem.capturable);
        let captured = number(&|i| problem.is_capturable(i) && above(i));
        let is_matched = |i: usize| {
            let mut views = MatchedViews::default();
            // More views never match less.
            self.0[i].iter().filter(|one| counts(one.image)).any(|one| {
                views.add(&problem.matching, one.bearing);
                views.matched() >= problem.matching.least_views
            })
        };
        let matchable = number(&|i| problem.matchable[i]);
        let matched = number(&|i| problem.matchable[i] && is_matched(i));
        Capture {
            matched: matched as u32,
            matched_percent: percent(matched, matchable),
            captured: captured as u32,
            information: cells.iter().zip(samples).map(|(&cells, row)| u64::from(cells) * row.area_mm2).sum(),
            coverage_percent: percent(captured, capturable),
            coverage_exposed_percent: percent(number(&above), exposed),
            capturable_percent: percent(capturable, exposed),
            cells,
        }
    }
}

fn percent(part: f64, whole: f64) -> f64 {
    if whole == 0.0 { 100.0 } else { 100.0 * part / whole }
}
