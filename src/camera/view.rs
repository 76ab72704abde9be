//! The frustum of one image.

use multiversion::multiversion;
use nalgebra::{Point3, Unit, Vector3};

/// A frustum with its apex at `position`: what an image frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    position: Point3<f64>,
    forward: Vector3<f64>,
    /// The image's right and up divided by the tangents of half the field of view: a target is framed when it lies less far along
    /// either of them than forward.
    right: Vector3<f64>,
    up: Vector3<f64>,
}

impl View {
    /// A camera at `position` that looks along `direction`, its image upright: the horizon is level, and seen straight down or up the
    /// top of the image is `up_hint`.
    pub fn new(position: Point3<f64>, direction: &Unit<Vector3<f64>>, up: &Vector3<f64>, half_tangents: [f64; 2]) -> Self {
        let right = direction.cross(up);
        Self { position, forward: direction.into_inner(), right: right / half_tangents[0], up: up / half_tangents[1] }
    }

    /// Whether the target lies within the frustum.
    pub fn frames(&self, target: &Point3<f64>) -> bool {
        self.frames_towards(&(target - self.position))
    }

    /// Whether a target lies within the frustum that is so far from its apex, m: also for a view like this one from elsewhere.
    #[inline]
    pub fn frames_towards(&self, to_target: &Vector3<f64>) -> bool {
        let depth = to_target.dot(&self.forward);
        to_target.dot(&self.right).abs() <= depth && to_target.dot(&self.up).abs() <= depth
    }
}

/// Places by coordinate, so that many of them are tested against a frustum at once.
#[derive(Clone, Debug, Default)]
pub struct Targets {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Targets {
    pub fn push(&mut self, target: &Point3<f64>) {
        self.x.push(target.x);
        self.y.push(target.y);
        self.z.push(target.z);
    }

    pub fn len(&self) -> usize {
        self.x.len()
    }

    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
}

impl View {
    /// Marks the targets that lie within the frustum; marks that are there already stay.
    pub fn mark_framed(&self, targets: &Targets, marks: &mut [bool]) {
        mark_kernel(self, &targets.x, &targets.y, &targets.z, marks);
    }
}

#[multiversion(targets("x86_64+avx2", "aarch64+neon"))]
fn mark_kernel(view: &View, x: &[f64], y: &[f64], z: &[f64], marks: &mut [bool]) {
    let View { position, forward, right, up } = view;
    for (((x, y), z), mark) in x.iter().zip(y).zip(z).zip(marks) {
        let (x, y, z) = (x - position.x, y - position.y, z - position.z);
        // In the order of a dot product, so that it rounds as `View::frames` does.
        let along = |axis: &Vector3<f64>| x * axis.x + y * axis.y + z * axis.z;
        let depth = along(forward);
        *mark |= (along(right).abs() <= depth) & (along(up).abs() <= depth);
    }
}

/// The top of a level image along `direction`; looking straight down or up it is `heading`, a horizontal unit vector.
pub(super) fn level_up(direction: &Unit<Vector3<f64>>, heading: &Vector3<f64>) -> Vector3<f64> {
    let right = direction.cross(&Vector3::z());
    let right = if right.norm() > 1e-6 { right.normalize() } else { heading.cross(&Vector3::z()) };
    right.cross(direction)
}

/// The direction of an azimuth (clockwise from north) and a pitch (up from the horizon), degrees.
pub fn direction_of(azimuth_deg: f64, pitch_deg: f64) -> Unit<Vector3<f64>> {
    let (sin_a, cos_a) = libm::sincos(azimuth_deg.to_radians());
    let (sin_p, cos_p) = libm::sincos(pitch_deg.to_radians());
    Unit::new_normalize(Vector3::new(sin_a * cos_p, cos_a * cos_p, sin_p))
}

/// Pitch of a direction above the horizon, rad.
pub fn pitch_rad(direction: &Unit<Vector3<f64>>) -> f64 {
    libm::atan2(direction.z, libm::hypot(direction.x, direction.y))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_target_is_framed_when_both_its_angles_are_within_half_the_field_of_view(
            azimuth_deg in -180.0..180.0f64, pitch_deg in -80.0..80.0f64, across_deg in -60.0..60.0f64, upward_deg in -60.0..60.0f64,
            depth in 1.0..100.0f64,
        ) {
            let direction = direction_of(azimuth_deg, pitch_deg);
            let up = level_up(&direction, &Vector3::y());
            // Level: the right of the image is horizontal, and up is not downwards.
            prop_assert!(direction.cross(&up).z.abs() < 1e-9 && up.z >= 0.0);
            let view = View::new(Point3::new(5.0, 6.0, 7.0), &direction, &up, [30f64.to_radians().tan(), 20f64.to_radians().tan()]);
            let right = direction.cross(&up);
            let target = Point3::new(5.0, 6.0, 7.0)
                + (direction.into_inner() + right * across_deg.to_radians().tan() + up * upward_deg.to_radians().tan()) * depth;
            prop_assume!((across_deg.abs() - 30.0).abs() > 1e-6 && (upward_deg.abs() - 20.0).abs() > 1e-6);
            let mut targets = Targets::default();
            [target, Point3::new(5.0, 6.0, 7.0) + (target - Point3::new(5.0, 6.0, 7.0)) * 2.0, target].iter().for_each(|target| targets.push(target));
            let mut marks = vec![false, false, true];
            view.mark_framed(&targets, &mut marks);
            prop_assert_eq!(marks, vec![view.frames(&target), view.frames(&target), true]);
            prop_assert_eq!(view.frames(&target), across_deg.abs() < 30.0 && upward_deg.abs() < 20.0);
            let behind = Point3::new(5.0, 6.0, 7.0) - direction.into_inner() * depth;
            prop_assert!(!view.frames(&behind));
        }
    }
}
