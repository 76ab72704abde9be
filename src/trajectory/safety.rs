//! The final safety check: no plan is published whose curve leaves the safe space anywhere.

use nalgebra::Point3;

use super::plan::Image;
use crate::camera::{Rig, pitch_rad};
use crate::scene::free_space::{FreeSpace, Obstruction};

/// A leg or waypoint that is not safe.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnsafeCurve {
    #[error("waypoint {index} at ({position}) is not safe: {cause}")]
    Waypoint { index: usize, position: String, cause: Obstruction },
    #[error("image {index} looks to pitch {pitch_deg:.2} degrees, beyond the gimbal's range")]
    View { index: usize, pitch_deg: f64 },
    #[error("the leg from waypoint {from} to the next is not safe: {cause}")]
    Leg { from: usize, cause: Obstruction },
}

/// Checks every waypoint and the whole of every leg; returns the smallest distance of the curve to a structure or to the ground, m.
pub fn check(curve: &[Point3<f64>], free: &FreeSpace) -> Result<f64, UnsafeCurve> {
    for (index, p) in curve.iter().enumerate() {
        if let Some(cause) = free.obstruction_at(p) {
            return Err(UnsafeCurve::Waypoint { index, position: format!("{:.1}, {:.1}, {:.1}", p.x, p.y, p.z), cause });
        }
    }
    for (from, leg) in curve.windows(2).enumerate() {
        if let Some(cause) = free.obstruction_between(&leg[0], &leg[1]) {
            return Err(UnsafeCurve::Leg { from, cause });
        }
    }
    Ok(least_distance_m(curve, free))
}

/// Checks that the gimbal can be pitched to every image.
pub fn check_views(rig: &Rig, images: &[Image]) -> Result<(), UnsafeCurve> {
    let beyond = images.iter().enumerate().find_map(|(index, image)| {
        let direction = image.direction.filter(|direction| !rig.reaches(direction))?;
        Some(UnsafeCurve::View { index, pitch_deg: pitch_rad(&direction).to_degrees() })
    });
    beyond.map_or(Ok(()), Err)
}

fn least_distance_m(curve: &[Point3<f64>], free: &FreeSpace) -> f64 {
    let ground = curve.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    let first = curve.first().map_or(ground, |p| free.clearance.point_distance_m(p, ground));
    curve.windows(2).fold(first, |least, leg| free.clearance.segment_distance_m(&leg[0], &leg[1], least))
}
