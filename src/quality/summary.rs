//! The figures that are reported of an assessed plan.

use serde::Serialize;

use super::statistics::{COMPLETENESS_M, Quality};

/// Figures over the whole exposed surface, by area; those that do not exist (nothing reconstructed, nothing seen) are `None`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    pub images: usize,
    pub samples: usize,
    /// Exposed surface, m^2.
    pub area_m2: f64,
    /// Share of it that some image sees, and that is reconstructed, percent.
    pub seen_percent: f64,
    pub reconstructed_percent: f64,
    pub error_90_m: Option<f64>,
    pub error_95_m: Option<f64>,
    /// Within [`COMPLETENESS_M`].
    pub completeness_percent: [f64; 3],
    pub median_views: f64,
    /// Of what two images see.
    pub median_parallax_deg: Option<f64>,
    /// Of what is seen: best ground sampling distance, m.
    pub median_gsd_m: Option<f64>,
    /// Of what is reconstructed: standard deviation along the normal, and over all three axes, m.
    pub median_deviation_m: Option<f64>,
    pub median_deviation_rms_m: Option<f64>,
    /// Mean of r (Eq. 1) with K = 256, percent of the hemisphere.
    pub mean_r_percent: f64,
    pub threshold_percent: f64,
    /// Share of the surface with r > h, percent.
    pub above_threshold_percent: f64,
    pub mean_smith: f64,
    pub smith_target: f64,
    /// Share of the surface above Smith's target, percent.
    pub smith_above_target_percent: f64,
}

impl Summary {
    pub(super) fn of(quality: &Quality) -> Self {
        let all = |_: usize| true;
        let samples = &quality.samples;
        Self {
            images: quality.images,
            samples: samples.len(),
            area_m2: quality.areas_mm2.iter().sum::<u64>() as f64 / 1e6,
            seen_percent: quality.share_percent(|i| samples[i].views > 0),
            reconstructed_percent: quality.share_percent(|i| quality.is_reconstructed(i)),
            error_90_m: quality.error_m(90.0, all),
            error_95_m: quality.error_m(95.0, all),
            completeness_percent: COMPLETENESS_M.map(|within_m| quality.completeness_percent(within_m)),
            median_views: quality.median(|sample| Some(f64::from(sample.views))).unwrap_or(0.0),
            median_parallax_deg: quality.median(|sample| (sample.views > 1).then_some(sample.parallax_rad.to_degrees())),
            median_gsd_m: quality.median(|sample| sample.gsd_m),
            median_deviation_m: quality.median(|sample| sample.deviation.map(|deviation| deviation.normal_m)),
            median_deviation_rms_m: quality.median(|sample| sample.deviation.map(|deviation| deviation.rms_m)),
            mean_r_percent: quality.mean(|i| samples[i].covered.reconstructability_percent()),
            threshold_percent: quality.threshold_percent,
            above_threshold_percent: quality.share_percent(|i| quality.is_captured(i)),
            mean_smith: quality.mean(|i| samples[i].smith),
            smith_target: quality.smith_target,
            smith_above_target_percent: quality.share_percent(|i| samples[i].smith > quality.smith_target),
        }
    }
}

/// The weighted median.
pub(super) struct Median;

impl Median {
    /// The smallest value at or below which half of the weight lies.
    pub fn of(weighted: impl Iterator<Item = (f64, u64)>) -> Option<f64> {
        let mut values: Vec<(f64, u64)> = weighted.collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: u64 = values.iter().map(|(_, weight)| weight).sum();
        let mut passed = 0;
        let middle = values.iter().find(|(_, weight)| {
            passed += weight;
            2 * passed >= all
        });
        middle.map(|(value, _)| *value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_median_is_weighted() {
        assert_eq!(Median::of([(3.0, 1), (1.0, 1), (2.0, 1)].into_iter()), Some(2.0));
        assert_eq!(Median::of([(3.0, 5), (1.0, 1), (2.0, 1)].into_iter()), Some(3.0));
        assert_eq!(Median::of(std::iter::empty()), None);
    }
}
