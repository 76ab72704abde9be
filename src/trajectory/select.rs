//! Post-selection of images (section 5.3): a subset that captures as much, for the reconstruction. The flight stays whole.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::evaluate::Sightings;
use crate::coverage::union::{cover, gain};
use crate::coverage::{Information, Mask, Observations};
use crate::search::Problem;

/// Which of `images` images are selected: always the one of the largest gain (Eq. 2) over those selected before, the earlier one of two
/// equals, until the goal of Algorithm 2 is reached, or as many samples as all images together capture when they miss it.
///
/// Gains only fall as images are added, so an old gain is an upper bound and an image whose fresh gain still leads needs no comparison
/// with the others (lazy greedy).
pub fn select(problem: &Problem, sightings: &Sightings, images: usize) -> Vec<bool> {
    let seen = by_image(sightings, images);
    let goal = problem.sufficient.min(sightings.capture(problem, |_| true).captured);
    let mut covered: Vec<Mask> = vec![0; sightings.0.len()];
    let mut queue: BinaryHeap<(Information, Reverse<usize>)> =
        seen.iter().enumerate().map(|(image, seen)| (gain(&covered, seen, &problem.areas_mm2), Reverse(image))).collect();
    let mut selected = vec![false; images];
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
        selected[image] = true;
    }
    selected
}

fn by_image(sightings: &Sightings, images: usize) -> Vec<Observations> {
    let mut rows: Vec<(Vec<u32>, Vec<Mask>)> = vec![Default::default(); images];
    for (sample, seen) in sightings.0.iter().enumerate() {
        for &(image, mask) in seen {
            let (samples, masks) = &mut rows[image as usize];
            samples.push(sample as u32);
            masks.push(mask);
        }
    }
    rows.into_iter().map(|(samples, masks)| Observations::new(samples, masks)).collect()
}
