//! How well two views together let a surface point be triangulated: the quality of [`Smith`], in whole units.

use nalgebra::{Point3, Vector3};

use crate::coverage::SampleFrame;
use crate::quality::Smith;

/// Quality of pairs in whole units, so that sums depend on no order.
pub type Quality = u64;

/// A pair of quality 1.
pub const UNIT: Quality = 4096;

/// A line of sight as its sample has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// From the sample to the view, unit length.
    pub direction: Vector3<f64>,
    pub distance_m: f64,
    /// Of the angle between the line and the sample's normal.
    pub cosine: f64,
}

impl Ray {
    pub fn new(sample: &SampleFrame, view: &Point3<f64>) -> Self {
        let to_view = view - sample.position;
        let distance_m = to_view.norm().max(1e-9);
        let direction = to_view / distance_m;
        Self { direction, distance_m, cosine: direction.dot(&sample.normal).max(0.0) }
    }
}

/// Smith's formula in whole units.
#[derive(Debug)]
pub struct PairModel(Smith);

impl PairModel {
    /// `range_m` is d_max.
    pub fn new(range_m: f64) -> Self {
        Self(Smith::new(range_m))
    }

    /// q of the two views whose lines these are.
    pub fn quality(&self, a: &Ray, b: &Ray) -> Quality {
        let parallax = self.0.parallax((a.direction - b.direction).norm());
        let nearness = self.0.nearness(a.distance_m.max(b.distance_m));
        (parallax * nearness * a.cosine.min(b.cosine) * UNIT as f64).round() as Quality
    }

    /// What a first view of a sample is worth where a choice has to begin: half of the best pair that it can be part of, as the first
    /// of k views has k - 1 pairs to come.
    pub fn promise(&self, ray: &Ray) -> Quality {
        (0.5 * self.0.nearness(ray.distance_m) * ray.cosine * UNIT as f64).round() as Quality
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Views in the plane of the normal, at angles from it.
    fn ray(angle_deg: f64, distance_m: f64) -> Ray {
        let sample = SampleFrame::new(Point3::new(1.0, 2.0, 3.0), Vector3::z());
        let (sin, cos) = libm::sincos(angle_deg.to_radians());
        Ray::new(&sample, &(sample.position + Vector3::new(sin, 0.0, cos) * distance_m))
    }

    /// By hand, with a range of 80 m.
    #[test]
    fn pairs_have_the_quality_computed_by_hand() {
        let model = PairModel::new(80.0);
        for (a, b, expected) in [
            // Parallax pi/6: w1 = 1/(1+exp(-10.471976)) = 0.9999717, w3 = 1-1/(1+exp(2.094395)) = 0.8903572; w2 = 1-40/80; cos 15 deg.
            (ray(-15.0, 20.0), ray(15.0, 40.0), 0.9999717 * 0.5 * 0.8903572 * 0.9659258),
            // Parallax pi/16: w1 = 1/2, w3 = 1-1/(1+exp(4.712389)) = 0.9910967; w2 = 1-20/80; cos 11.25 deg.
            (ray(0.0, 20.0), ray(11.25, 20.0), 0.5 * 0.75 * 0.9910967 * 0.9807853),
            // Parallax pi/4: w1 = 1/(1+exp(-18.849556)) = 1, w3 = 1/2; w2 = 1-60/80; cos 45 deg.
            (ray(0.0, 60.0), ray(45.0, 10.0), 0.5 * 0.25 * std::f64::consts::FRAC_1_SQRT_2),
            // Beyond the range nothing counts.
            (ray(0.0, 81.0), ray(30.0, 10.0), 0.0),
        ] {
            let quality = model.quality(&a, &b) as f64 / UNIT as f64;
            assert!((quality - expected).abs() < 2e-4, "{quality} instead of {expected}");
            assert_eq!(model.quality(&a, &b), model.quality(&b, &a));
        }
    }

    #[test]
    fn the_table_is_the_formula_for_every_parallax() {
        let model = PairModel::new(80.0);
        for tenth in 0..1700 {
            let parallax_deg = f64::from(tenth) / 10.0;
            let pair = [ray(-parallax_deg / 2.0, 20.0), ray(parallax_deg / 2.0, 20.0)];
            let alpha = parallax_deg.to_radians();
            let (w1, w3) =
                (1.0 / (1.0 + (-32.0 * (alpha - PI / 16.0)).exp()), 1.0 - 1.0 / (1.0 + (-8.0 * (alpha - PI / 4.0)).exp()));
            let expected = w1 * 0.75 * w3 * (alpha / 2.0).cos();
            let quality = model.quality(&pair[0], &pair[1]) as f64 / UNIT as f64;
            assert!((quality - expected).abs() < 2e-4, "{parallax_deg} degrees: {quality} instead of {expected}");
        }
    }
}
