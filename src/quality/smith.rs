//! Reconstructability after Smith et al. 2018 (Aerial path planning for urban scene reconstruction): a sum over pairs of views.
//!
//! With alpha the parallax of the views at the point, d their distances, phi their angles from the normal and d_max the range:
//! w1 = 1/(1+exp(-32(alpha-pi/16))), w2 = 1-min(max(d1,d2)/d_max,1), w3 = 1-1/(1+exp(-8(alpha-pi/4))),
//! q = w1 w2 w3 min(cos phi1, cos phi2). The reconstructability of a point is the sum of q over all pairs of views that see it.

use std::f64::consts::PI;

/// What a view contributes to its pairs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Weight {
    /// 1 - min(d / dmax, 1): of a pair the farther view counts.
    pub nearness: f64,
    /// Cosine of the angle of incidence.
    pub cosine: f64,
}

/// The weights of parallax, tabulated.
///
/// Thousands of pairs see a sample, so the two exponentials are looked up by the chord between the directions (linear interpolation;
/// off by less than 1e-5 of the weight's largest value).
#[derive(Clone, Debug)]
pub struct Smith {
    range_m: f64,
    by_chord: Vec<f64>,
}

/// Steps of the table over chords from 0 to 2.
const STEPS: usize = 4096;

impl Smith {
    /// `range_m` is d_max.
    pub fn new(range_m: f64) -> Self {
        let weight = |step: usize| parallax_weight(2.0 * libm::asin((step as f64 / STEPS as f64).min(1.0)));
        Self { range_m, by_chord: (0..=STEPS + 1).map(weight).collect() }
    }

    pub(super) fn weight(&self, distance_m: f64, cosine: f64) -> Weight {
        Weight { nearness: self.nearness(distance_m), cosine }
    }

    /// The pair's part of the sum; `chord` is the distance of the unit vectors to the views.
    pub(super) fn pair(&self, chord: f64, first: &Weight, second: &Weight) -> f64 {
        self.parallax(chord) * first.nearness.min(second.nearness) * first.cosine.min(second.cosine)
    }

    /// w1 w3 of two views whose unit vectors are `chord` apart.
    pub fn parallax(&self, chord: f64) -> f64 {
        let place = chord * (STEPS as f64 / 2.0);
        let below = (place as usize).min(STEPS);
        let share = (place - below as f64).min(1.0);
        self.by_chord[below] + (self.by_chord[below + 1] - self.by_chord[below]) * share
    }

    /// 1 - min(d / d_max, 1); of a pair the farther view's is w2.
    pub fn nearness(&self, distance_m: f64) -> f64 {
        1.0 - (distance_m / self.range_m).min(1.0)
    }
}

/// w1 w3: rises at a parallax of pi/16, falls at pi/4.
fn parallax_weight(alpha_rad: f64) -> f64 {
    let rises = 1.0 / (1.0 + libm::exp(-32.0 * (alpha_rad - PI / 16.0)));
    let falls = 1.0 - 1.0 / (1.0 + libm::exp(-8.0 * (alpha_rad - PI / 4.0)));
    rises * falls
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(alpha_rad: f64, distances_m: [f64; 2], cosines: [f64; 2]) -> f64 {
        let smith = Smith::new(80.0);
        let [first, second] = [0, 1].map(|k| smith.weight(distances_m[k], cosines[k]));
        smith.pair(2.0 * (alpha_rad / 2.0).sin(), &first, &second)
    }

    #[test]
    fn a_pair_is_worth_what_the_formula_says() {
        // At alpha = pi/16 the first factor is 1/2; w3 = 1 - 1/(1 + exp(8 * 3 pi/16)) = 0.991097; w2 = 1 - 40/80; cosine 0.8.
        let expected = 0.5 * (1.0 - 1.0 / (1.0 + (1.5 * PI).exp())) * 0.5 * 0.8;
        assert!((expected - 0.198_220).abs() < 1e-6, "{expected}");
        assert!((pair(PI / 16.0, [20.0, 40.0], [0.9, 0.8]) - expected).abs() < 1e-5);
        // At alpha = pi/4 the third factor is 1/2 and the first is 1 - 6.5e-9.
        assert!((pair(PI / 4.0, [20.0, 20.0], [1.0, 1.0]) - 0.5 * 0.75).abs() < 1e-5);
        // Opposite views and far views are worth nothing.
        assert!(pair(PI, [20.0, 20.0], [1.0, 1.0]) < 1e-5);
        assert_eq!(pair(0.4, [20.0, 90.0], [1.0, 1.0]), 0.0);
        // Without parallax: 1/(1 + exp(2 pi)) = 0.001864, times 0.998.
        assert!((pair(0.0, [0.0, 0.0], [1.0, 1.0]) - 0.001_860).abs() < 1e-5);
    }

    #[test]
    fn the_table_follows_the_formula_everywhere() {
        for step in 0..20_000 {
            let alpha_rad = PI * f64::from(step) / 20_000.0;
            let by_table = pair(alpha_rad, [0.0, 0.0], [1.0, 1.0]);
            assert!((by_table - parallax_weight(alpha_rad)).abs() < 1e-5, "{alpha_rad}");
        }
    }
}
