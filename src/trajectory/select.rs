//! Post-selection of images (section 5.3): a subset that captures as much, for the reconstruction. The flight stays whole.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::evaluate::{Sighting, Sightings};
use crate::coverage::union::{cover, gain};
use crate::coverage::{Information, Mask, Observations};
use crate::search::Problem;

/// Which of `images` images are selected: always the one of the largest gain (Eq. 2) over those selected before, the earlier one of two
/// equals, until the goal of Algorithm 2 is reached, or as many samples as all images together capture when they miss it.
pub fn select(problem: &Problem, sightings: &Sightings, images: usize) -> Vec<bool> {
    let goal = problem.sufficient.min(sightings.capture(problem, |_| true).captured);
    let mut selected = vec![false; images];
    greedy(problem, sightings, images, goal).into_iter().for_each(|image| selected[image] = true);
    selected
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
    let mut covered: Vec<Mask> = vec![0; sightings.0.len()];
    let mut queue: BinaryHeap<(Information, Reverse<usize>)> =
        seen.iter().enumerate().map(|(image, seen)| (gain(&covered, seen, &problem.areas_mm2), Reverse(image))).collect();
    let mut order = Vec::new();
    let mut captured = 0;
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
