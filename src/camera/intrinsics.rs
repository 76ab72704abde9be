//! A camera's inner geometry: a pinhole without distortion.

use serde::{Deserialize, Serialize};

/// Focal length, sensor and resolution; width before height.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    pub focal_mm: f64,
    pub sensor_mm: [f64; 2],
    pub pixels: [u32; 2],
}

impl Intrinsics {
    /// Tangents of half the field of view, horizontally and vertically.
    pub fn half_tangents(&self) -> [f64; 2] {
        self.sensor_mm.map(|side_mm| side_mm / 2.0 / self.focal_mm)
    }

    /// Field of view, horizontally and vertically, degrees.
    pub fn fov_deg(&self) -> [f64; 2] {
        self.half_tangents().map(|tangent| (2.0 * libm::atan(tangent)).to_degrees())
    }

    /// Angle that one pixel in the middle of the image spans, rad: times a distance it is the ground sampling distance.
    pub fn pixel_rad(&self) -> f64 {
        self.sensor_mm[0] / f64::from(self.pixels[0]) / self.focal_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn field_of_view_and_pixel_of_the_phantom_are_those_of_the_data_sheet() {
        let phantom = Intrinsics { focal_mm: 8.8, sensor_mm: [13.2, 8.8], pixels: [5472, 3648] };
        let [width, height] = phantom.fov_deg();
        assert!((width - 73.74).abs() < 0.01 && (height - 53.13).abs() < 0.01, "{width} {height}");
        // DJI gives the ground sampling distance as height / 36.5 in centimetres.
        assert!((phantom.pixel_rad() * 100.0 - 100.0 / 36.5 * 0.01).abs() < 0.0001);
    }
}
