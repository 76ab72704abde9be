//! Error and Completeness over all samples (section 6), by area.

use std::f64::consts::SQRT_2;

use super::assess::SampleQuality;
use super::summary::{Median, Summary};
use crate::coverage::FINE_CELLS;
use crate::settings::Settings;

/// The distances of Completeness in the paper's tables, m.
pub const COMPLETENESS_M: [f64; 3] = [0.020, 0.050, 0.075];

/// What a set of images makes of a truth, sample by sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    pub samples: Vec<SampleQuality>,
    /// Surface that each sample stands for, mm^2.
    pub areas_mm2: Vec<u64>,
    /// Images that were looked at.
    pub images: usize,
    /// The threshold h, percent.
    pub threshold_percent: f64,
    /// What Smith's reconstructability should reach.
    pub smith_target: f64,
}

/// A plan beside others on the same truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compared {
    /// Share of the exposed surface that all plans reconstruct, percent: Error is compared there.
    pub common_percent: f64,
    pub error_90_m: Option<f64>,
    pub error_95_m: Option<f64>,
    /// On the whole exposed surface, within [`COMPLETENESS_M`].
    pub completeness_percent: [f64; 3],
}

/// Compares plans on common samples: Error on those that all of them reconstruct, Completeness on all. `None` when the qualities are not
/// of one truth.
pub fn compare(qualities: &[&Quality]) -> Option<Vec<Compared>> {
    let first = qualities.first()?;
    if qualities.iter().any(|quality| quality.areas_mm2 != first.areas_mm2) {
        return None;
    }
    let is_common = |i: usize| qualities.iter().all(|quality| quality.is_reconstructed(i));
    let common_percent = first.share_percent(is_common);
    let compared = |quality: &&Quality| Compared {
        common_percent,
        error_90_m: quality.error_m(90.0, is_common),
        error_95_m: quality.error_m(95.0, is_common),
        completeness_percent: COMPLETENESS_M.map(|within_m| quality.completeness_percent(within_m)),
    };
    Some(qualities.iter().map(compared).collect())
}

impl Quality {
    pub fn new(samples: Vec<SampleQuality>, areas_mm2: Vec<u64>, images: usize, settings: &Settings) -> Self {
        let (threshold_percent, smith_target) = (settings.coverage.threshold_percent, settings.quality.smith_target);
        Self { samples, areas_mm2, images, threshold_percent, smith_target }
    }

    /// Whether enough views of sample `i` can be matched, and fix it.
    pub fn is_reconstructed(&self, i: usize) -> bool {
        self.samples[i].deviation.is_some()
    }

    /// Whether r of sample `i` exceeds the threshold h.
    pub fn is_captured(&self, i: usize) -> bool {
        f64::from(self.samples[i].covered.count()) > (self.threshold_percent * FINE_CELLS as f64 / 100.0).floor()
    }

    /// Predicted Error: the distance within which `share_percent` of the reconstructed surface lies, m, when every point is off along its
    /// normal with its own deviation (a mixture of half-normals). Only samples for which `among` holds count; `None` when none is
    /// reconstructed, or for a share that no distance reaches.
    pub fn error_m(&self, share_percent: f64, among: impl Fn(usize) -> bool) -> Option<f64> {
        let parts: Vec<(f64, f64)> = (0..self.samples.len())
            .filter(|&i| among(i))
            .filter_map(|i| Some((self.areas_mm2[i] as f64, self.samples[i].deviation?.normal_m)))
            .collect();
        if parts.is_empty() || !(0.0..100.0).contains(&share_percent) {
            return None;
        }
        let all: f64 = parts.iter().map(|(area, _)| area).sum();
        let wanted = all * share_percent / 100.0;
        let within =
            |distance_m: f64| parts.iter().map(|(area, deviation_m)| area * half_normal(distance_m, *deviation_m)).sum::<f64>();
        // A half-normal has all but 1e-15 of its weight within eight deviations.
        let widest_m = parts.iter().map(|(_, deviation_m)| *deviation_m).fold(0.0, f64::max);
        let (mut low, mut high) = (0.0, 8.0 * widest_m);
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            if within(middle) < wanted { low = middle } else { high = middle }
        }
        Some(high)
    }

    /// Predicted Completeness: share of the whole exposed surface that is reconstructed and off by less than `within_m`, percent.
    pub fn completeness_percent(&self, within_m: f64) -> f64 {
        let share = |i: usize| self.samples[i].deviation.map_or(0.0, |deviation| half_normal(within_m, deviation.normal_m));
        self.mean(share) * 100.0
    }

    /// Share of the exposed surface for whose samples `holds`, percent.
    pub fn share_percent(&self, holds: impl Fn(usize) -> bool) -> f64 {
        self.mean(|i| f64::from(u8::from(holds(i)))) * 100.0
    }

    /// Mean over the exposed surface.
    pub fn mean(&self, value: impl Fn(usize) -> f64) -> f64 {
        let all: u64 = self.areas_mm2.iter().sum();
        let sum: f64 = self.areas_mm2.iter().enumerate().map(|(i, &area)| area as f64 * value(i)).sum();
        if all == 0 { 0.0 } else { sum / all as f64 }
    }

    /// The value that half of the surface stays below, of the samples that have one.
    pub fn median(&self, value: impl Fn(&SampleQuality) -> Option<f64>) -> Option<f64> {
        let weighted = self.samples.iter().zip(&self.areas_mm2).filter_map(|(sample, &area)| Some((value(sample)?, area)));
        Median::of(weighted)
    }

    pub fn summary(&self) -> Summary {
        Summary::of(self)
    }
}

/// Probability that a normal error of this deviation is at most `distance_m` in size.
fn half_normal(distance_m: f64, deviation_m: f64) -> f64 {
    libm::erf(distance_m / (deviation_m * SQRT_2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::triangulation::Deviation;

    fn quality(samples: &[(u64, Option<f64>)]) -> Quality {
        let sample = |&(_, normal_m): &(u64, Option<f64>)| SampleQuality {
            deviation: normal_m.map(|normal_m| Deviation { normal_m, rms_m: normal_m }),
            ..Default::default()
        };
        let areas = samples.iter().map(|(area, _)| *area).collect();
        Quality::new(samples.iter().map(sample).collect(), areas, 0, &Settings::default())
    }

    #[test]
    fn the_error_of_a_single_normal_is_its_quantile() {
        let one = quality(&[(5, Some(0.01)), (7, Some(0.01)), (100, None)]);
        // Quantiles of |N(0, 1)|: 1.644854 at 90 %, 1.959964 at 95 %, 0.674490 at 50 %.
        for (share_percent, quantile) in [(90.0, 1.644_854), (95.0, 1.959_964), (50.0, 0.674_490)] {
            let error_m = one.error_m(share_percent, |_| true).unwrap();
            assert!((error_m - 0.01 * quantile).abs() < 1e-8, "{share_percent} %: {error_m}");
        }
        assert_eq!(one.error_m(90.0, |i| i == 2), None);
        assert_eq!(one.error_m(100.0, |_| true), None);
    }

    #[test]
    fn a_mixture_is_weighted_by_area() {
        // At x: 3/4 erf(x / (0.01 sqrt 2)) + 1/4 erf(x / (0.1 sqrt 2)) = 0.9 far beyond the first part, so the second is at 0.6:
        // 0.841621 deviations, where the first part has all but 2e-17.
        let two = quality(&[(3, Some(0.01)), (1, Some(0.1))]);
        assert!((two.error_m(90.0, |_| true).unwrap() - 0.084_162_1).abs() < 1e-7);
        assert!((two.error_m(90.0, |i| i == 0).unwrap() - 0.016_448_5).abs() < 1e-7);
    }

    #[test]
    fn completeness_counts_what_is_not_reconstructed() {
        // erf(1/sqrt 2) = 0.682689 within one deviation, on three quarters of the surface.
        let some = quality(&[(2, Some(0.02)), (1, Some(0.02)), (1, None)]);
        assert!((some.completeness_percent(0.02) - 75.0 * 0.682_689_5).abs() < 1e-5);
        assert!((some.completeness_percent(10.0) - 75.0).abs() < 1e-9);
        assert_eq!(quality(&[(1, None)]).completeness_percent(1.0), 0.0);
    }

    #[test]
    fn plans_are_compared_where_both_reconstruct() {
        let first = quality(&[(1, Some(0.01)), (1, Some(0.5)), (2, Some(0.01))]);
        let second = quality(&[(1, Some(0.02)), (1, None), (2, Some(0.02))]);
        let both = compare(&[&first, &second]).unwrap();
        assert_eq!(both[0].common_percent, 75.0);
        assert!((both[0].error_90_m.unwrap() - 0.016_448_5).abs() < 1e-7);
        assert!((both[1].error_90_m.unwrap() - 0.032_897_1).abs() < 1e-7);
        assert!(first.error_m(90.0, |_| true).unwrap() > 0.3);
        assert_eq!(both[1].completeness_percent, COMPLETENESS_M.map(|d| second.completeness_percent(d)));
        assert_eq!(compare(&[&first, &quality(&[(1, None)])]), None);
    }
}
