//! Post-selection of images (section 5.3): a subset that captures as much, for the reconstruction. The flight stays whole.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::evaluate::{Sighting, Sightings};
use crate::coverage::union::{cover, gain};
use crate::coverage::{Bearing, Information, Mask, MatchedViews, Observations};
use crate::search::Problem;

/// Which of `images` images are selected: always the one of the largest gain (Eq. 2) over those selected before, the earlier one of two
/// equals, until the goal of Algorithm 2 is reached, or as many samples as all images together capture when they miss it. Beyond the paper, of the
/// other images those stay without which fewer than `matched` samples would have enough matched views, as far as all images give them.
pub fn select(problem: &Problem, sightings: &Sightings, images: usize, matched: u32) -> Vec<bool> {
    let goal = problem.sufficient.min(sightings.capture(problem, |_| true).captured);
    let mut selected = vec![false; images];
    greedy(problem, sightings, images, goal).into_iter().for_each(|image| selected[image] = true);
    if matched > 0 {
        keep_matches(problem, sightings, &mut selected, matched);
    }
    selected
}

/// Selects the images that are not selected yet but for those that can go, one after the other and first the ones that see least.
fn keep_matches(problem: &Problem, sightings: &Sightings, selected: &mut [bool], matched: u32) {
    let mut seen: Vec<Vec<(u32, Bearing)>> = vec![Vec::new(); selected.len()];
    let mut views = vec![MatchedViews::default(); sightings.0.len()];
    for (sample, views) in views.iter_mut().enumerate().filter(|&(sample, _)| problem.matchable[sample]) {
        problem.captured_views(sample).iter().for_each(|&(_, bearing)| views.add(&problem.matching, bearing));
    }
    for (sample, sightings) in sightings.0.iter().enumerate().filter(|&(sample, _)| problem.matchable[sample]) {
        for &Sighting { image, bearing, .. } in sightings {
            seen[image as usize].push((sample as u32, bearing));
            views[sample].add(&problem.matching, bearing);
        }
    }
    let is_matched = |views: &MatchedViews| views.matched() >= problem.matching.least_views;
    let mut left = views.iter().filter(|views| is_matched(views)).count() as u32;
    let goal = matched.min(left);
    let mut others: Vec<usize> = (0..selected.len()).filter(|&image| !selected[image]).collect();
    others.sort_by_key(|&image| seen[image].len());
    for image in others {
        let before = left;
        for &(sample, bearing) in &seen[image] {
            let of_sample = &mut views[sample as usize];
            let was_matched = is_matched(of_sample);
            of_sample.remove(&problem.matching, bearing);
            left -= u32::from(was_matched && !is_matched(of_sample));
        }
        if left < goal {
            seen[image].iter().for_each(|&(sample, bearing)| views[sample as usize].add(&problem.matching, bearing));
            (left, selected[image]) = (before, true);
        }
    }
}

/// All images in the order in which they would be selected were there no goal; those without any gain stand last, as they were taken.
/// The selected images are its beginning.
pub fn ranking(problem: &Problem, sightings: &Sightings, images: usize) -> Vec<usize> {
    let mut order = greedy(problem, sightings, images, u32::MAX);
    let mut is_ranked = vec![false; images];
    order.iter().for_each(|&image| is_ranked[image] = true);
    order.extend((0..images).filter(|&image| !is_ranked[image]));
    order
}

/// The images of the largest gain, one after the other, until they capture `goal` samples or none gains anything.
///
/// Gains only fall as images are added, so an old gain is an upper bound and an image whose fresh gain still leads needs no comparison
/// with the others (lazy greedy).
fn greedy(problem: &Problem, sightings: &Sightings, images: usize, goal: u32) -> Vec<usize> {
    let seen = by_image(sightings, images);
    let (mut covered, mut captured) = problem.captured_cells();
    let mut queue: BinaryHeap<(Information, Reverse<usize>)> =
        seen.iter().enumerate().map(|(image, seen)| (gain(&covered, seen, &problem.areas_mm2), Reverse(image))).collect();
    let mut order = Vec::new();
    while captured < goal {
        let Some((_, Reverse(image))) = queue.pop() else { break };
        let fresh = gain(&covered, &seen[image], &problem.areas_mm2);
        if queue.peek().is_some_and(|next| *next > (fresh, Reverse(image))) {
            queue.push((fresh, Reverse(image)));
            continue;
        }
        if fresh == 0 {
            break;
        }
        captured += cover(&mut covered, &seen[image], &problem.areas_mm2, &problem.thresholds).captured;
        order.push(image);
    }
    order
}

fn by_image(sightings: &Sightings, images: usize) -> Vec<Observations> {
    let mut rows: Vec<(Vec<u32>, Vec<Mask>)> = vec![Default::default(); images];
    for (sample, seen) in sightings.0.iter().enumerate() {
        for &Sighting { image, mask, .. } in seen {
            let (samples, masks) = &mut rows[image as usize];
            samples.push(sample as u32);
            masks.push(mask);
        }
    }
    rows.into_iter().map(|(samples, masks)| Observations::new(samples, masks)).collect()
}
