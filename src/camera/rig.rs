//! Rigs: the cameras that a drone carries and how they can be turned.

use arrayvec::ArrayVec;
use nalgebra::{Unit, Vector3};
use serde::Deserialize;

use super::view::{direction_of, level_up};
use super::{Intrinsics, Pose, View};

/// The cameras that a drone carries, with what else of the drone a plan depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    pub name: String,
    pub cameras: Cameras,
    /// Least time between two images of one camera, s.
    pub shutter_interval_s: f64,
    /// Most angular speed at which turning does not smear an image, rad/s; infinite for a panorama.
    pub blur_limit_rad_s: f64,
    /// The longest exposure of its cameras, s.
    pub exposure_s: f64,
    pub battery: Option<Battery>,
}

/// How the cameras sit on the drone.
#[derive(Clone, Debug, PartialEq)]
pub enum Cameras {
    /// A camera system that sees in all directions, so that a viewpoint is a position (paper, section 3).
    Panoramic { pixel_rad: f64 },
    /// One camera on a gimbal (section 5.4): its view direction is free within the pitch range, which is kept as sines of the pitch.
    Gimbal { name: String, intrinsics: Intrinsics, sin_pitch: [f64; 2] },
    /// Cameras bolted to the airframe, which flies nose first.
    Rigid(Vec<Mount>),
}

/// A camera bolted to the airframe.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    pub name: String,
    pub intrinsics: Intrinsics,
    /// Of the optical axis against the heading, clockwise seen from above, degrees.
    pub yaw_deg: f64,
    /// Of the optical axis against the horizon, degrees.
    pub pitch_deg: f64,
}

/// What a flight draws (Tables 4 and 5).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Battery {
    pub energy_wh: f64,
    /// Power on straight legs and in turns, W.
    pub cruise_w: f64,
    pub turning_w: f64,
}

/// How many times as far as the reference camera cameras see as sharply, in quarters; the coarsest of their pixels, rad, decides.
/// 1 for no camera.
pub fn sight_scale(pixels_rad: impl Iterator<Item = f64>) -> f64 {
    let coarsest = pixels_rad.fold(0.0, f64::max);
    if coarsest > 0.0 { ((4.0 * REFERENCE_PIXEL_RAD / coarsest).round() / 4.0).clamp(0.25, 4.0) } else { 1.0 }
}

impl Battery {
    /// Share of a full battery that a flight draws, by the travel costs of Eq. 4 and 5, percent. More than 100 means several batteries.
    pub fn percent(&self, movement_s: f64, turning_s: f64) -> f64 {
        100.0 * (movement_s * self.cruise_w + turning_s * self.turning_w) / (3600.0 * self.energy_wh)
    }
}

/// The distances of the coverage model belong to the camera of the paper's Phantom: 13.2 mm and 5472 pixels behind 8.8 mm.
const REFERENCE_PIXEL_RAD: f64 = 13.2 / 5472.0 / 8.8;

/// Cameras on one rig.
pub(super) const MOST_CAMERAS: usize = 8;

/// Rings of view directions: pitch and first azimuth, degrees. With the nadir they are V = 17.
const RINGS: [(f64, f64); 2] = [(-15.0, 0.0), (-50.0, 22.5)];
const RING_DIRECTIONS: u32 = 8;

/// Headings that stand for all headings where it is asked what a rig can capture at all.
const HEADINGS: u32 = 16;

impl Rig {
    /// Whether a waypoint has a view direction of its own, which turns along the legs (section 5.4).
    pub fn has_gimbal(&self) -> bool {
        matches!(self.cameras, Cameras::Gimbal { .. })
    }

    /// How many images one exposure yields.
    pub fn camera_count(&self) -> usize {
        match &self.cameras {
            Cameras::Rigid(mounts) => mounts.len(),
            _ => 1,
        }
    }

    /// The frusta of one exposure, one for each camera; `None` when the rig sees in all directions.
    pub fn frusta(&self, pose: &Pose) -> Option<ArrayVec<View, MOST_CAMERAS>> {
        if matches!(self.cameras, Cameras::Panoramic { .. }) {
            return None;
        }
        let aims = (0..self.camera_count()).map(|camera| self.aim(camera, pose));
        Some(
            aims.map(|(direction, up, intrinsics)| View::new(pose.position, &direction, &up, intrinsics.half_tangents()))
                .collect(),
        )
    }

    /// Optical axis and top of the image of one camera at a pose; `None` for a panorama.
    pub fn optical_axis(&self, camera: usize, pose: &Pose) -> Option<(Unit<Vector3<f64>>, Vector3<f64>)> {
        (!matches!(self.cameras, Cameras::Panoramic { .. })).then(|| {
            let (direction, up, _) = self.aim(camera, pose);
            (direction, up)
        })
    }

    /// Name and inner geometry of each camera, in the order of the images that one exposure yields.
    pub fn camera(&self, index: usize) -> (&str, Option<&Intrinsics>) {
        match &self.cameras {
            Cameras::Panoramic { .. } => ("panorama", None),
            Cameras::Gimbal { name, intrinsics, .. } => (name, Some(intrinsics)),
            Cameras::Rigid(mounts) => (&mounts[index].name, Some(&mounts[index].intrinsics)),
        }
    }

    /// Angle that one pixel of a camera spans, rad.
    pub fn pixel_rad(&self, camera: usize) -> f64 {
        match (&self.cameras, self.camera(camera).1) {
            (Cameras::Panoramic { pixel_rad }, _) => *pixel_rad,
            (_, Some(intrinsics)) => intrinsics.pixel_rad(),
            (_, None) => unreachable!("only a panorama has no intrinsics"),
        }
    }

    /// The largest angle that one pixel of any of its cameras spans, rad.
    pub fn coarsest_pixel_rad(&self) -> f64 {
        (0..self.camera_count()).map(|camera| self.pixel_rad(camera)).fold(0.0, f64::max)
    }

    /// How many times as far as the reference camera the rig sees as sharply. A panorama is an idea of the paper without a lens, and
    /// counts as the reference.
    pub fn sight_scale(&self) -> f64 {
        let lenses = (0..self.camera_count()).filter(|&camera| self.camera(camera).1.is_some());
        sight_scale(lenses.map(|camera| self.pixel_rad(camera)))
    }

    /// The discretised view directions of section 5.4 that the gimbal can reach: two rings and the nadir, V = 17 for a camera that can
    /// look straight down. Empty for rigs without a gimbal.
    pub fn view_directions(&self) -> Vec<Unit<Vector3<f64>>> {
        let Cameras::Gimbal { sin_pitch, .. } = &self.cameras else { return Vec::new() };
        let [low_deg, high_deg] = sin_pitch.map(|sin| libm::asin(sin).to_degrees());
        let ring = |(pitch_deg, first_deg): (f64, f64)| {
            let pitch_deg = pitch_deg.clamp(low_deg, high_deg);
            let step_deg = 360.0 / f64::from(RING_DIRECTIONS);
            (0..RING_DIRECTIONS).map(move |k| direction_of(first_deg + step_deg * f64::from(k), pitch_deg))
        };
        let nadir = (low_deg <= -90.0 + 1e-6).then(|| Unit::new_unchecked(-Vector3::z()));
        RINGS.into_iter().flat_map(ring).chain(nadir).collect()
    }

    /// Directions that together stand for all that a pose at one position may have.
    pub fn pose_directions(&self) -> Vec<Option<Unit<Vector3<f64>>>> {
        match &self.cameras {
            Cameras::Panoramic { .. } => vec![None],
            Cameras::Gimbal { .. } => self.view_directions().into_iter().map(Some).collect(),
            Cameras::Rigid(_) => {
                (0..HEADINGS).map(|k| Some(direction_of(360.0 / f64::from(HEADINGS) * f64::from(k), 0.0))).collect()
            }
        }
    }

    /// Whether the gimbal can be pitched to `direction`; always true without one.
    pub fn reaches(&self, direction: &Unit<Vector3<f64>>) -> bool {
        match &self.cameras {
            Cameras::Gimbal { sin_pitch: [low, high], .. } => {
                *low - PITCH_TOLERANCE <= direction.z && direction.z <= *high + PITCH_TOLERANCE
            }
            _ => true,
        }
    }

    fn aim(&self, camera: usize, pose: &Pose) -> (Unit<Vector3<f64>>, Vector3<f64>, &Intrinsics) {
        // A rig with frusta is never posed without a direction; north is as good as any where it were.
        let direction = pose.direction.unwrap_or(Vector3::y_axis());
        match &self.cameras {
            Cameras::Gimbal { intrinsics, .. } => (direction, level_up(&direction, &Vector3::y()), intrinsics),
            Cameras::Rigid(mounts) => {
                let mount = &mounts[camera];
                let heading_deg = libm::atan2(direction.x, direction.y).to_degrees();
                let axis = direction_of(heading_deg + mount.yaw_deg, mount.pitch_deg);
                let ahead = direction_of(heading_deg + mount.yaw_deg, 0.0);
                (axis, level_up(&axis, &ahead), &mount.intrinsics)
            }
            Cameras::Panoramic { .. } => unreachable!("a panorama has no optical axis"),
        }
    }
}

/// Directions are unit vectors with rounding; one whose height is this far beyond the limit is at the limit.
const PITCH_TOLERANCE: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn a_camera_that_can_look_down_has_seventeen_view_directions() {
        let phantom = Rig::preset("phantom4-rtk").unwrap();
        let directions = phantom.view_directions();
        assert_eq!(directions.len(), 17);
        let closest = |a: &Unit<Vector3<f64>>| directions.iter().filter(|b| *b != a).map(|b| a.dot(b)).fold(-1.0, f64::max);
        assert!(directions.iter().all(|direction| phantom.reaches(direction) && closest(direction) < 28f64.to_radians().cos()));
    }

    #[test]
    fn turning_blurs_the_phantoms_images_beyond_seventy_degrees_on_thirty_metres() {
        let limit_deg_s = Rig::preset("phantom4-rtk").unwrap().blur_limit_rad_s.to_degrees();
        assert!((limit_deg_s * 30.0 / 8.0 - 70.0).abs() < 1.5, "{limit_deg_s}");
    }

    #[test]
    fn a_longer_lens_sees_farther() {
        let scales = Rig::PRESETS.map(|name| Rig::preset(name).unwrap().sight_scale());
        assert_eq!(scales, [1.0, 1.0, 2.5, 1.0]);
    }

    #[test]
    fn bolted_cameras_turn_with_the_heading() {
        let rig = Rig::preset("m300-oblique").unwrap();
        let pose = |heading| Pose { position: Point3::new(0.0, 0.0, 50.0), direction: Some(heading) };
        let axis = |camera, heading| rig.optical_axis(camera, &pose(heading)).unwrap().0;
        let expected = [
            Vector3::new(0.0, 0.0, -1.0),
            Vector3::new(1.0, 0.0, -1.0),
            Vector3::new(0.0, -1.0, -1.0),
            Vector3::new(-1.0, 0.0, -1.0),
            Vector3::new(0.0, 1.0, -1.0),
        ];
        for (camera, direction) in expected.into_iter().enumerate() {
            assert!(
                (axis(camera, Vector3::x_axis()).into_inner() - direction.normalize()).norm() < 1e-9,
                "camera {camera} flying east"
            );
        }
        let ground_ahead = Point3::new(50.0, 0.0, 0.0);
        let framed = |heading| rig.frusta(&pose(heading)).unwrap().iter().filter(|view| view.frames(&ground_ahead)).count();
        assert_eq!(framed(Vector3::x_axis()), 1);
        assert_eq!(framed(direction_of(45.0, 0.0)), 0, "between two cameras");
    }
}
