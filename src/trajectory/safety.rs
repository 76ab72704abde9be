//! The final safety check: no plan is published whose curve leaves the safe space anywhere.

use nalgebra::Point3;

use super::corner::Corner;
use super::curve::{Arc, Curve};
use super::limits::Limits;
use super::plan::Image;
use crate::camera::{Pose, Rig, pitch_rad};
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
    #[error("the arc at waypoint {index} is not safe: {cause}")]
    Arc { index: usize, cause: Obstruction },
}

/// Arcs are checked by the triangles of chords and tangents; a chord keeps this close to its arc, m. All sides of the triangles keep the safety
/// distance, so that an arc between them falls short of it by no more than 5 mm squared over twice that distance: micrometres.
const SAGITTA_M: f64 = 5e-3;
/// An arc that is not safe is tried again at half the distance from its corner, this often; then the drone stops there.
const HALVINGS: i32 = 5;

/// How far the arc at each waypoint may pass from it, m: as far as the settings say, less where that arc would not be safe, and not at all
/// where none is. The legs of the path are safe, so there is always a way to fly it.
pub fn deviations_m(path: &[Pose], limits: &Limits, free: &FreeSpace) -> Vec<f64> {
    let widest_m = limits.dynamics.corner_deviation_m;
    let safe_m = |at: &[Pose]| {
        let (before, corner, after) = (&at[0].position, &at[1].position, &at[2].position);
        let is_safe = |deviation_m: &f64| {
            let rounded = Corner::new(&(corner - before), &(after - corner), *deviation_m);
            arc_obstruction(&Arc::new(before, corner, after, &rounded), free).is_none()
        };
        (0..=HALVINGS).map(|halved| widest_m / f64::from(1 << halved)).find(is_safe).unwrap_or(0.0)
    };
    let mut deviations_m = vec![0.0; path.len()];
    for (deviation_m, at) in deviations_m.iter_mut().skip(1).zip(path.windows(3)) {
        *deviation_m = safe_m(at);
    }
    deviations_m
}

/// Checks the whole of the curve, its arcs included, and every waypoint; returns the smallest distance of the curve to a structure or to the
/// ground, m: up to a centimetre too small where that lies on an arc.
pub fn check(curve: &Curve, free: &FreeSpace) -> Result<f64, UnsafeCurve> {
    for (index, p) in curve.waypoints.iter().enumerate() {
        if let Some(cause) = free.obstruction_at(p) {
            return Err(UnsafeCurve::Waypoint { index, position: format!("{:.1}, {:.1}, {:.1}", p.x, p.y, p.z), cause });
        }
    }
    for from in 0..curve.legs() {
        let [start, end] = curve.straight(from);
        if let Some(cause) = free.obstruction_between(&start, &end) {
            return Err(UnsafeCurve::Leg { from, cause });
        }
    }
    for (index, arc) in curve.arcs.iter().enumerate() {
        if let Some(cause) = arc_obstruction(arc, free) {
            return Err(UnsafeCurve::Arc { index, cause });
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

/// Why an arc between two safe legs is not safe. It lies within the triangle of its corner and its ends, so that it keeps the limits of the
/// flight, which are convex, where these do.
fn arc_obstruction(arc: &Arc, free: &FreeSpace) -> Option<Obstruction> {
    arc.hull(SAGITTA_M).flatten().find_map(|[from, to]| free.obstruction_between(&from, &to))
}

fn least_distance_m(curve: &Curve, free: &FreeSpace) -> f64 {
    let arcs = curve.arcs.iter().flat_map(|arc| arc.hull(SAGITTA_M)).flatten();
    let segments: Vec<[Point3<f64>; 2]> = (0..curve.legs()).map(|leg| curve.straight(leg)).chain(arcs).collect();
    let ground = segments.iter().flatten().chain(curve.waypoints.first()).map(|p| p.z).fold(f64::INFINITY, f64::min);
    let first = curve.waypoints.first().map_or(ground, |p| free.clearance.point_distance_m(p, ground));
    segments.iter().fold(first, |least, [from, to]| free.clearance.segment_distance_m(from, to, least))
}
