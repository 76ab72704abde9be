//! Unions of disks and what they gain (Eq. 2 and 3): the innermost loops of the search.
//!
//! Compiled for several instruction sets and chosen at run time: counting bits is one instruction on every machine that flies, but
//! not in the baseline that Rust builds for. The results are integers, so all versions agree.

use multiversion::multiversion;

use super::{Information, Mask};

/// What a set of views covers: samples in ascending order, each with its cells.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observations {
    samples: Vec<u32>,
    masks: Vec<Mask>,
}

impl Observations {
    /// `samples` and `masks` belong together pairwise.
    pub fn new(samples: Vec<u32>, masks: Vec<Mask>) -> Self {
        debug_assert_eq!(samples.len(), masks.len());
        Self { samples, masks }
    }

    pub fn len(&self) -> usize {
        self.samples.len()
    }

    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    pub fn iter(&self) -> impl Iterator<Item = (usize, Mask)> + '_ {
        self.samples.iter().map(|&i| i as usize).zip(self.masks.iter().copied())
    }
}

/// Area-weighted cells that `seen` adds to `covered`; `areas_mm2` by sample.
pub fn gain(covered: &[Mask], seen: &Observations, areas_mm2: &[u64]) -> Information {
    gain_kernel(covered, &seen.samples, &seen.masks, areas_mm2)
}

/// What a union has gained.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gained {
    pub information: Information,
    /// Samples that crossed their threshold.
    pub captured: u32,
}

/// Adds `seen` to `covered`. A sample counts as captured when more cells are covered than `thresholds` has for it; a sample that
/// cannot be captured has a threshold that no number of cells exceeds.
pub fn cover(covered: &mut [Mask], seen: &Observations, areas_mm2: &[u64], thresholds: &[u32]) -> Gained {
    cover_kernel(covered, &seen.samples, &seen.masks, areas_mm2, thresholds)
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+popcnt", "x86_64+popcnt", "aarch64+neon"))]
fn gain_kernel(covered: &[Mask], samples: &[u32], masks: &[Mask], areas_mm2: &[u64]) -> Information {
    let mut information = 0;
    for (&i, &mask) in samples.iter().zip(masks) {
        let i = i as usize;
        information += u64::from((mask & !covered[i]).count_ones()) * areas_mm2[i];
    }
    information
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+popcnt", "x86_64+popcnt", "aarch64+neon"))]
fn cover_kernel(covered: &mut [Mask], samples: &[u32], masks: &[Mask], areas_mm2: &[u64], thresholds: &[u32]) -> Gained {
    let mut gained = Gained::default();
    for (&i, &mask) in samples.iter().zip(masks) {
        let i = i as usize;
        let before = covered[i].count_ones();
        covered[i] |= mask;
        let after = covered[i].count_ones();
        gained.information += u64::from(after - before) * areas_mm2[i];
        gained.captured += u32::from(before <= thresholds[i] && after > thresholds[i]);
    }
    gained
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn covering_gains_what_was_promised_and_counts_each_sample_once(
            rows in proptest::collection::vec((any::<u128>(), any::<u128>(), 1u64..1000, 0u32..130), 1..200),
        ) {
            let areas: Vec<u64> = rows.iter().map(|row| row.2).collect();
            let thresholds: Vec<u32> = rows.iter().map(|row| row.3).collect();
            let seen = Observations::new((0..rows.len() as u32).collect(), rows.iter().map(|row| row.1).collect());
            let mut covered: Vec<Mask> = rows.iter().map(|row| row.0).collect();
            let promised = gain(&covered, &seen, &areas);
            let first = cover(&mut covered, &seen, &areas, &thresholds);
            prop_assert_eq!(first.information, promised);
            let crossed = |row: &(u128, u128, u64, u32)| row.0.count_ones() <= row.3 && (row.0 | row.1).count_ones() > row.3;
            prop_assert_eq!(first.captured as usize, rows.iter().filter(|row| crossed(row)).count());
            prop_assert_eq!(cover(&mut covered, &seen, &areas, &thresholds), Gained::default());
        }
    }
}
