//! How often each hemisphere cell of each sample is covered, so that views can be taken away again.

use std::sync::Arc;

use multiversion::multiversion;

use super::sights::Sights;
use crate::coverage::{Information, Mask};

/// Counters of all cells of all samples with what they add up to.
#[derive(Clone, Debug)]
pub struct CellCounts {
    samples: Vec<SampleCounts>,
    /// Cells that a sample must exceed; no number of cells exceeds that of a sample that does not count.
    thresholds: Arc<[u32]>,
    areas_mm2: Arc<[u64]>,
    totals: Totals,
    /// Samples that count, and the cells that all of them need.
    countable: u32,
    wanted_cells: u32,
    images: usize,
}

/// What a set of views is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Samples above their thresholds.
    pub captured: u32,
    /// Covered cells of the samples that count, up to one more than their thresholds.
    pub cells: u32,
    /// Covered cells of all samples, by area (Eq. 2).
    pub information: Information,
}

/// The counters of one sample, bit-sliced: bit c of plane k is bit k of the number of views that cover cell c. Adding a view ripples a
/// carry through the planes and touches two of them on average, however many cells its disk has.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
struct SampleCounts {
    covered: Mask,
    /// Planes that ever were in use.
    used: u32,
    views: u32,
    planes: [Mask; PLANES],
}

/// A cell counts up to 2^14 - 1 views.
const PLANES: usize = 14;

/// Views of a sample with which its counters are full: half of what they can hold, so that there is room for the changes of other workers in a round.
const FULL: usize = 1 << (PLANES - 1);

impl CellCounts {
    /// `thresholds` in cells, by sample, and the area that each stands for.
    pub fn new(thresholds: Arc<[u32]>, areas_mm2: Arc<[u64]>) -> Self {
        let samples = vec![SampleCounts::default(); thresholds.len()];
        let wanted = |threshold: &u32| counted(Mask::BITS, *threshold);
        let countable = thresholds.iter().filter(|threshold| wanted(threshold) > 0).count() as u32;
        let wanted_cells = thresholds.iter().map(wanted).sum();
        Self { samples, thresholds, areas_mm2, totals: Totals::default(), countable, wanted_cells, images: 0 }
    }

    /// Samples that count.
    pub fn countable(&self) -> u32 {
        self.countable
    }

    /// The cells that are missing, counted in samples that miss all of theirs.
    pub fn missing_samples(&self) -> f64 {
        let of_sample = f64::from(self.wanted_cells) / f64::from(self.countable.max(1));
        f64::from(self.wanted_cells - self.totals.cells) / of_sample.max(1.0)
    }

    /// What the images of `seen` cover by themselves, by area.
    pub fn information_of(&self, seen: &Sights) -> Information {
        let mut covered: Vec<(usize, Mask)> = seen.masks().collect();
        covered.sort_unstable_by_key(|&(i, _)| i);
        let unions = covered.chunk_by(|a, b| a.0 == b.0).map(|of_sample| {
            let union = of_sample.iter().fold(0, |union, (_, mask)| union | mask);
            u64::from(Mask::count_ones(union)) * self.areas_mm2[of_sample[0].0]
        });
        unions.sum()
    }

    /// Every cell of every sample.
    pub fn most_information(&self) -> Information {
        self.areas_mm2.iter().map(|area_mm2| area_mm2 * u64::from(Mask::BITS)).sum()
    }

    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// Covered cells of a sample.
    pub fn cells(&self, sample: usize) -> u32 {
        self.samples[sample].covered.count_ones()
    }

    /// Whether a sample counts and has too few covered cells.
    pub fn is_missing(&self, sample: usize) -> bool {
        self.thresholds[sample] < Mask::BITS && self.cells(sample) <= self.thresholds[sample]
    }

    /// Whether some sample has too many views to be counted with these as well. A flight over a city may have any number of images.
    pub fn is_full<'s>(&self, more: impl Iterator<Item = &'s Sights> + Clone) -> bool {
        let images: usize = more.clone().map(Sights::images).sum();
        // No sample has more views than there are images.
        self.images + images > FULL && more.flat_map(Sights::masks).any(|(i, _)| self.samples[i].views as usize + images > FULL)
    }

    /// Adds what images see.
    pub fn add(&mut self, seen: &Sights) {
        self.images += seen.images();
        add_kernel(&mut self.samples, &self.thresholds, &self.areas_mm2, &mut self.totals, seen);
    }

    /// Takes away what was added before.
    pub fn remove(&mut self, seen: &Sights) {
        self.images -= seen.images();
        remove_kernel(&mut self.samples, &self.thresholds, &self.areas_mm2, &mut self.totals, seen);
    }
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+popcnt", "x86_64+popcnt", "aarch64+neon"))]
fn add_kernel(samples: &mut [SampleCounts], thresholds: &[u32], areas_mm2: &[u64], totals: &mut Totals, seen: &Sights) {
    for (i, mask) in seen.masks() {
        let counts = &mut samples[i];
        let (mut carry, mut k) = (mask, 0);
        while carry != 0 {
            let both = counts.planes[k] & carry;
            counts.planes[k] ^= carry;
            carry = both;
            k += 1;
        }
        counts.views += 1;
        counts.used = counts.used.max(k as u32);
        let before = counts.covered;
        counts.covered |= mask;
        if counts.covered != before {
            totals.change(before, counts.covered, thresholds[i], areas_mm2[i]);
        }
    }
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+popcnt", "x86_64+popcnt", "aarch64+neon"))]
fn remove_kernel(samples: &mut [SampleCounts], thresholds: &[u32], areas_mm2: &[u64], totals: &mut Totals, seen: &Sights) {
    for (i, mask) in seen.masks() {
        let counts = &mut samples[i];
        let (mut borrow, mut k) = (mask, 0);
        while borrow != 0 {
            let missing = !counts.planes[k] & borrow;
            counts.planes[k] ^= borrow;
            borrow = missing;
            k += 1;
        }
        counts.views -= 1;
        let before = counts.covered;
        counts.covered = counts.planes[..counts.used as usize].iter().fold(0, |covered, plane| covered | plane);
        if counts.covered != before {
            totals.change(before, counts.covered, thresholds[i], areas_mm2[i]);
        }
    }
}

impl Totals {
    #[inline(always)]
    fn change(&mut self, before: Mask, after: Mask, threshold: u32, area_mm2: u64) {
        let (before, after) = (before.count_ones(), after.count_ones());
        self.information = self.information + u64::from(after) * area_mm2 - u64::from(before) * area_mm2;
        self.captured = self.captured + u32::from(after > threshold) - u32::from(before > threshold);
        self.cells = self.cells + counted(after, threshold) - counted(before, threshold);
    }
}

/// Cells up to one more than the threshold; none of a sample that no number of cells captures.
#[inline(always)]
fn counted(cells: u32, threshold: u32) -> u32 {
    if threshold >= Mask::BITS { 0 } else { cells.min(threshold + 1) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::coverage::Bearing;

    /// An image that sees one sample.
    fn image(sample: u32, mask: Mask) -> Sights {
        let mut seen: Sights = [(sample, mask, Bearing::default())].into_iter().collect();
        seen.begin_image();
        seen
    }

    #[test]
    fn a_flight_may_have_any_number_of_images_as_long_as_no_sample_is_in_too_many() {
        let mut counts = CellCounts::new([0, 0].as_slice().into(), [1, 1].as_slice().into());
        let [one, other] = [0, 1].map(|sample| image(sample, 1));
        (0..FULL - 1).for_each(|_| counts.add(&one));
        assert!(!counts.is_full(std::iter::once(&one)) && counts.is_full([&one, &one].into_iter()));
        (0..2 * FULL).for_each(|_| counts.add(&image(1, 0)));
        counts.add(&one);
        assert!(counts.is_full(std::iter::once(&one)) && counts.is_full(std::iter::once(&other)));
        (0..2 * FULL).for_each(|_| counts.remove(&image(1, 0)));
        assert!(!counts.is_full(std::iter::once(&other)) && counts.is_full([&other, &one].into_iter()));
        (0..FULL).for_each(|_| counts.remove(&one));
        assert_eq!(counts.totals(), Totals::default());
    }

    proptest! {
        #[test]
        fn counters_agree_with_a_recount_after_any_additions_and_removals(
            views in proptest::collection::vec(proptest::collection::vec((0u32..6, any::<u128>(), Just(Bearing::default())), 0..8), 1..40),
            leaves in proptest::collection::vec(any::<bool>(), 40),
            thresholds in proptest::collection::vec(0u32..=128, 6),
        ) {
            let views: Vec<Sights> = views.into_iter().map(|pairs| pairs.into_iter().collect()).collect();
            let areas_mm2: Arc<[u64]> = (1..=6).map(|i| 1000 * i).collect();
            let mut counts = CellCounts::new(thresholds.as_slice().into(), Arc::clone(&areas_mm2));
            views.iter().for_each(|seen| counts.add(seen));
            views.iter().zip(&leaves).filter(|(_, leaves)| **leaves).for_each(|(seen, _)| counts.remove(seen));
            let mut covered = [0u128; 6];
            for (seen, _) in views.iter().zip(&leaves).filter(|(_, leaves)| !**leaves) {
                seen.masks().for_each(|(i, mask)| covered[i] |= mask);
            }
            let cells: Vec<u32> = covered.iter().map(|mask| mask.count_ones()).collect();
            prop_assert_eq!((0..6).map(|i| counts.cells(i)).collect::<Vec<_>>(), cells.clone());
            let captured = cells.iter().zip(&thresholds).filter(|(cells, threshold)| cells > threshold).count() as u32;
            let worth = cells.iter().zip(&thresholds).filter(|(_, t)| **t < 128).map(|(cells, t)| (*cells).min(t + 1)).sum();
            let information = cells.iter().zip(areas_mm2.iter()).map(|(cells, area)| u64::from(*cells) * area).sum();
            prop_assert_eq!(counts.totals(), Totals { captured, cells: worth, information });
        }
    }
}
