//! The hemisphere over a sample in cells of equal weight.

use nalgebra::Vector3;

/// Cells K of a hemisphere. 128 gives r with an error of about one point; one machine word pair per sample.
pub const CELLS: usize = 128;

/// The covered cells of one hemisphere, one bit each: a union of disks is a bitwise or.
pub type Mask = u128;

/// Direction of cell `k` in the sample's own frame (z along the normal).
///
/// The weight omega of Eq. 1 is cos(phi)/pi, phi from the normal. Cells of equal weight are cells of equal area on the unit
/// disk below the hemisphere, here those of a sunflower spiral.
pub fn cell_direction(k: usize) -> Vector3<f64> {
    direction_among(k, CELLS)
}

/// Direction of cell `k` when a hemisphere has `cells` of them.
pub(super) fn direction_among(k: usize, cells: usize) -> Vector3<f64> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let u = (k as f64 + 0.5) / cells as f64;
    let (sin, cos) = libm::sincos(k as f64 * golden_angle);
    Vector3::new(u.sqrt() * cos, u.sqrt() * sin, (1.0 - u).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frontal_disk_covers_its_cosine_weighted_share() {
        // Under the cosine weight a disk of half-angle theta round the normal has the weight sin^2(theta).
        for theta_deg in [15.0f64, 25.0, 40.0, 60.0] {
            let inside = (0..CELLS).filter(|&k| cell_direction(k).z >= theta_deg.to_radians().cos()).count();
            let share = inside as f64 / CELLS as f64;
            let expected = theta_deg.to_radians().sin().powi(2);
            assert!((share - expected).abs() < 0.01, "{theta_deg} deg: {share} against {expected}");
        }
    }
}
