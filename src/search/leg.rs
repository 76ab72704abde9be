//! Where the images of a leg are taken.

use nalgebra::{Point3, Unit, Vector3};

use super::spacing::ImageSpacing;
use crate::camera::{Cameras, Pose, Rig};

/// The images of a leg without the one at its start: evenly spaced, as many as `spacing` says, the last one at the end. The
/// viewpoints along an edge ARE the images of the flight.
pub fn image_poses(rig: &Rig, from: &Pose, to: &Pose, spacing: ImageSpacing) -> impl Iterator<Item = Pose> + use<> {
    let leg = to.position - from.position;
    let count = spacing.image_count(leg.norm());
    let start = from.position;
    let end = Pose { position: to.position, direction: end_direction(rig, &start, to) };
    // Cameras on a gimbal turn along the leg, all others keep the direction that they have at its end.
    let first = if rig.has_gimbal() { from.direction } else { end.direction };
    (1..=count).map(move |k| {
        if k == count {
            return end;
        }
        let share = k as f64 / count as f64;
        Pose { position: start + leg * share, direction: turned(first, end.direction, share) }
    })
}

/// Heading of a drone that flies nose first, horizontally; east on a leg that only climbs or sinks.
pub fn heading(from: &Point3<f64>, to: &Point3<f64>) -> Unit<Vector3<f64>> {
    let along = Vector3::new(to.x - from.x, to.y - from.y, 0.0);
    Unit::try_new(along, 1e-6).unwrap_or(Vector3::x_axis())
}

/// The path with the headings that bolted cameras take on it: that of the leg that arrives, at the start that of the first leg.
pub fn headed(rig: &Rig, path: &[Pose]) -> Vec<Pose> {
    if !matches!(rig.cameras, Cameras::Rigid(_)) {
        return path.to_vec();
    }
    let along = |k: usize| (k + 1 < path.len()).then(|| heading(&path[k].position, &path[k + 1].position));
    let headed = |k: usize| Pose { direction: along(k.saturating_sub(1)).or(path[k].direction), ..path[k] };
    (0..path.len()).map(headed).collect()
}

/// The direction part of the way along the great circle (section 5.4); between opposite directions there is no such circle.
fn turned(first: Option<Unit<Vector3<f64>>>, last: Option<Unit<Vector3<f64>>>, share: f64) -> Option<Unit<Vector3<f64>>> {
    match (first, last) {
        (Some(first), Some(last)) if first != last => Some(slerp(&first, &last, share)),
        _ => last,
    }
}

/// Spherical interpolation with the functions of `libm`, so that it is the same on every machine.
pub fn slerp(first: &Unit<Vector3<f64>>, last: &Unit<Vector3<f64>>, share: f64) -> Unit<Vector3<f64>> {
    let angle = angle_rad(first, last);
    let sin = libm::sin(angle);
    if sin.abs() < 1e-9 {
        return *last;
    }
    let blend =
        first.into_inner() * (libm::sin((1.0 - share) * angle) / sin) + last.into_inner() * (libm::sin(share * angle) / sin);
    Unit::new_normalize(blend)
}

/// Angle between two directions, rad.
pub fn angle_rad(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    libm::atan2(a.cross(b).norm(), a.dot(b))
}

fn end_direction(rig: &Rig, from: &Point3<f64>, to: &Pose) -> Option<Unit<Vector3<f64>>> {
    match rig.cameras {
        Cameras::Panoramic { .. } => None,
        Cameras::Gimbal { .. } => to.direction,
        Cameras::Rigid(_) => Some(heading(from, &to.position)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::direction_of;

    fn pose(x: f64, azimuth_deg: f64) -> Pose {
        Pose { position: Point3::new(x, 0.0, 30.0), direction: Some(direction_of(azimuth_deg, 0.0)) }
    }

    #[test]
    fn a_gimbal_turns_along_the_great_circle_and_bolted_cameras_with_the_heading() {
        let directions = |preset: &str| -> Vec<_> {
            let rig = Rig::preset(preset).unwrap();
            image_poses(&rig, &pose(0.0, 0.0), &pose(40.0, 60.0), ImageSpacing::at_least(10.0))
                .map(|pose| pose.direction)
                .collect()
        };
        assert_eq!(directions("panoramic"), [None; 4]);
        assert_eq!(directions("m300-oblique"), [Some(Vector3::x_axis()); 4]);
        for (k, direction) in directions("phantom4-rtk").into_iter().enumerate() {
            let expected = direction_of(15.0 * (k + 1) as f64, 0.0);
            assert!(angle_rad(&direction.unwrap(), &expected) < 1e-9, "image {k}");
        }
    }
}
