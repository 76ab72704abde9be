//! How well the geometry of its views fixes a point: pixel noise, carried over to metres.

use nalgebra::{Matrix3, Vector3};

/// A view of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Unit vector from the point to the view.
    pub direction: Vector3<f64>,
    /// How far off the ray may pass the point, m: angular noise times distance.
    pub spread_m: f64,
}

/// Standard deviation of a triangulated point, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Along the surface normal: what a surface made of such points is off by.
    pub normal_m: f64,
    /// Root mean square over all three axes.
    pub rms_m: f64,
}

/// The deviation of a point that is intersected from its views. Each view fixes the two directions across its ray: information matrix
/// sum of (I - d d^T) / spread^2, covariance its inverse. `None` when the views leave the depth open.
pub fn deviation(sights: impl IntoIterator<Item = Sight>, normal: &Vector3<f64>) -> Option<Deviation> {
    let across = |sight: Sight| {
        let ray = sight.direction;
        (Matrix3::identity() - ray * ray.transpose()) / (sight.spread_m * sight.spread_m)
    };
    let information = sights.into_iter().fold(Matrix3::zeros(), |sum, sight| sum + across(sight));
    let covariance = information.try_inverse()?;
    let variances = [normal.dot(&(covariance * normal)), covariance.trace() / 3.0];
    let all_sound = variances.iter().all(|variance| variance.is_finite() && *variance > 0.0);
    all_sound.then(|| Deviation { normal_m: variances[0].sqrt(), rms_m: variances[1].sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(x: f64, z: f64, spread_m: f64) -> Sight {
        Sight { direction: Vector3::new(x, 0.0, z).normalize(), spread_m }
    }

    #[test]
    fn two_views_at_a_known_base_give_the_depth_error_of_the_normal_case() {
        // Base 20 m at 30 m in front, symmetric: d = sqrt(30^2 + 10^2) = 31.623 m, sin a = 10/d = 0.31623, cos a = 0.94868.
        // Half a pixel of 0.3 mrad: spread = 0.15e-3 * d = 4.743 mm. Information: across z 2 sin^2 a / s^2, across x 2 cos^2 a / s^2,
        // across y 2 / s^2; so sigma_z = s / (sqrt 2 sin a) = 10.607 mm, sigma_x = 3.536 mm, sigma_y = 3.354 mm.
        let spread_m = 0.5 * 3e-4 * 1000f64.sqrt();
        let found = deviation([sight(-10.0, 30.0, spread_m), sight(10.0, 30.0, spread_m)], &Vector3::z()).unwrap();
        assert!((found.normal_m - 0.010_606_6).abs() < 1e-7, "{found:?}");
        let rms_m = ((0.010_606_6f64.powi(2) + 0.003_535_5f64.powi(2) + 0.003_354_1f64.powi(2)) / 3.0).sqrt();
        assert!((found.rms_m - rms_m).abs() < 1e-6, "{found:?}");
        let sideways = deviation([sight(-10.0, 30.0, spread_m), sight(10.0, 30.0, spread_m)], &Vector3::x()).unwrap();
        assert!((sideways.normal_m - 0.003_535_5).abs() < 1e-7, "{sideways:?}");
    }

    #[test]
    fn four_times_the_views_halve_the_deviation() {
        let pair = [sight(-10.0, 30.0, 0.005), sight(10.0, 30.0, 0.005)];
        let once = deviation(pair, &Vector3::z()).unwrap();
        let often = deviation(pair.repeat(4), &Vector3::z()).unwrap();
        assert!((often.normal_m * 2.0 - once.normal_m).abs() < 1e-12);
        assert!((often.rms_m * 2.0 - once.rms_m).abs() < 1e-12);
    }

    #[test]
    fn views_along_one_ray_leave_the_depth_open() {
        assert_eq!(deviation([sight(0.0, 1.0, 0.01), sight(0.0, 1.0, 0.02)], &Vector3::z()), None);
        assert_eq!(deviation([], &Vector3::z()), None);
    }
}
