//! Rigs: the cameras that a drone carries and how they can be turned.

use std::f64::consts::TAU;

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

/// Why there is no such rig.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RigError {
    #[error("there is no rig {0:?}; known rigs: {known}; or give a rig file ending with .toml", known = Rig::PRESETS.join(", "))]
    Unknown(String),
    #[error(
        "the rig file cannot be read as TOML of a rig: {0}; `overfly rigs phantom4-rtk` prints a rig file to begin with; `config/rigs/` holds more"
    )]
    Syntax(String),
    #[error("the rig {rig:?} cannot be flown: {fault}")]
    Impossible { rig: String, fault: String },
}

/// The distances of the coverage model belong to the camera of the paper's Phantom: 13.2 mm and 5472 pixels behind 8.8 mm.
const REFERENCE_PIXEL_RAD: f64 = 13.2 / 5472.0 / 8.8;

/// Cameras on one rig.
const MOST_CAMERAS: usize = 8;

/// Rings of view directions: pitch and first azimuth, degrees. With the nadir they are V = 17.
const RINGS: [(f64, f64); 2] = [(-15.0, 0.0), (-50.0, 22.5)];
const RING_DIRECTIONS: u32 = 8;

/// Headings that stand for all headings where it is asked what a rig can capture at all.
const HEADINGS: u32 = 16;

impl Rig {
    /// Names of the presets.
    pub const PRESETS: [&str; 4] = ["panoramic", "phantom4-rtk", "m300-oblique", "mavic3e"];

    /// The preset called `name`.
    pub fn preset(name: &str) -> Result<Self, RigError> {
        Self::parse(Self::preset_file(name)?)
    }

    /// The rig file of the preset called `name`, as it stands in `config/rigs/`.
    pub fn preset_file(name: &str) -> Result<&'static str, RigError> {
        Ok(match name {
            "panoramic" => include_str!("../../config/rigs/panoramic.toml"),
            "phantom4-rtk" => include_str!("../../config/rigs/phantom4-rtk.toml"),
            "m300-oblique" => include_str!("../../config/rigs/m300-oblique.toml"),
            "mavic3e" => include_str!("../../config/rigs/mavic3e.toml"),
            _ => return Err(RigError::Unknown(name.to_owned())),
        })
    }

    /// The rig that a file describes. Every number is checked.
    pub fn parse(text: &str) -> Result<Self, RigError> {
        let file: RigFile = toml::from_str(text).map_err(|error| syntax(text, &error))?;
        file.check().and_then(|()| file.rig()).map_err(|fault| RigError::Impossible { rig: shortened(&file.name), fault })
    }

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

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    name: String,
    #[serde(default, rename = "drone")]
    _drone: String,
    #[serde(default, rename = "source")]
    _source: String,
    shutter_interval_s: f64,
    panorama_pixels: Option<u32>,
    gimbal: Option<GimbalEntry>,
    #[serde(default)]
    camera: Vec<CameraEntry>,
    battery: Option<Battery>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct GimbalEntry {
    pitch_deg: [f64; 2],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    name: String,
    focal_mm: f64,
    sensor_mm: [f64; 2],
    pixels: [u32; 2],
    exposure_s: f64,
    blur_px: f64,
    yaw_deg: Option<f64>,
    pitch_deg: Option<f64>,
}

impl RigFile {
    /// Every number on its own; `NaN` is in no range.
    fn check(&self) -> Result<(), String> {
        let range = |what: &str, value: f64, least: f64, most: f64| {
            let fits = (least..=most).contains(&value);
            if fits { Ok(()) } else { Err(format!("`{what}` is {value}, but must lie between {least} and {most}")) }
        };
        if !is_plain(&self.name) {
            return Err("`name` must have 1 to 64 bytes and no control characters".to_owned());
        }
        for (index, camera) in self.camera.iter().enumerate() {
            if !is_plain(&camera.name) || self.camera[..index].iter().any(|other| other.name == camera.name) {
                let name = shortened(&camera.name);
                return Err(format!("`name` of camera {name:?} must be its own, with 1 to 64 bytes and no control characters"));
            }
        }
        range("shutter_interval_s", self.shutter_interval_s, 0.05, 60.0)?;
        for camera in &self.camera {
            let of = |key: &str| format!("{key} of camera {:?}", camera.name);
            range(&of("focal_mm"), camera.focal_mm, 0.5, 2000.0)?;
            for side in 0..2 {
                range(&of("sensor_mm"), camera.sensor_mm[side], 0.5, 200.0)?;
                range(&of("pixels"), f64::from(camera.pixels[side]), 16.0, 100_000.0)?;
                let half_tangent = camera.intrinsics().half_tangents()[side];
                range(&of("half the sensor over the focal length"), half_tangent, 0.01, 4.0)?;
            }
            range(&of("exposure_s"), camera.exposure_s, 1e-6, 1.0)?;
            range(&of("blur_px"), camera.blur_px, 0.01, 100.0)?;
            range(&of("yaw_deg"), camera.yaw_deg.unwrap_or(0.0), -360.0, 360.0)?;
            range(&of("pitch_deg"), camera.pitch_deg.unwrap_or(0.0), -90.0, 90.0)?;
        }
        if let Some(battery) = &self.battery {
            range("battery.energy_wh", battery.energy_wh, 0.1, 1e6)?;
            range("battery.cruise_w", battery.cruise_w, 0.1, 1e6)?;
            range("battery.turning_w", battery.turning_w, 0.1, 1e6)?;
        }
        Ok(())
    }

    fn rig(&self) -> Result<Rig, String> {
        let blur = |camera: &CameraEntry| camera.blur_px * camera.intrinsics().pixel_rad() / camera.exposure_s;
        Ok(Rig {
            name: self.name.clone(),
            cameras: self.cameras()?,
            shutter_interval_s: self.shutter_interval_s,
            blur_limit_rad_s: self.camera.iter().map(blur).fold(f64::INFINITY, f64::min),
            battery: self.battery,
        })
    }

    fn cameras(&self) -> Result<Cameras, String> {
        match (self.panorama_pixels, &self.gimbal, self.camera.as_slice()) {
            (Some(pixels), None, []) if pixels >= 16 => Ok(Cameras::Panoramic { pixel_rad: TAU / f64::from(pixels) }),
            (None, Some(gimbal), [camera]) => self.gimbal(gimbal, camera),
            (None, None, mounts) if !mounts.is_empty() && mounts.len() <= MOST_CAMERAS => mounts.iter().map(mount).collect(),
            _ => Err(format!(
                "a rig is one [[camera]] with a [gimbal], or 1 to {MOST_CAMERAS} [[camera]] entries without one, or `panorama_pixels` (at \
                 least 16) alone"
            )),
        }
    }

    fn gimbal(&self, gimbal: &GimbalEntry, camera: &CameraEntry) -> Result<Cameras, String> {
        if camera.yaw_deg.is_some() || camera.pitch_deg.is_some() {
            return Err(format!("camera {:?} hangs on the gimbal and has no `yaw_deg` or `pitch_deg` of its own", camera.name));
        }
        let [low, high] = gimbal.pitch_deg;
        if !(-90.0 <= low && low <= high && high <= 90.0) {
            return Err(format!("`gimbal.pitch_deg` is [{low}, {high}], but must rise and lie between -90 and 90"));
        }
        let lower_edge_deg = low - camera.intrinsics().fov_deg()[1] / 2.0;
        if lower_edge_deg >= 0.0 {
            return Err(format!(
                "`gimbal.pitch_deg` begins at {low} degrees, so that the camera never sees anything below the horizon; lower it below {:.0}",
                camera.intrinsics().fov_deg()[1] / 2.0
            ));
        }
        let sin_pitch = gimbal.pitch_deg.map(|pitch_deg| libm::sin(pitch_deg.to_radians()));
        Ok(Cameras::Gimbal { name: camera.name.clone(), intrinsics: camera.intrinsics(), sin_pitch })
    }
}

fn is_plain(name: &str) -> bool {
    !name.trim().is_empty() && name.len() <= 64 && !name.chars().any(char::is_control)
}

/// Text of a file as it may stand in a message: somebody else may have written it.
fn shortened(text: &str) -> String {
    text.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

fn syntax(text: &str, error: &toml::de::Error) -> RigError {
    let before = error.span().map_or(0, |span| span.start.min(text.len()));
    let line = text.as_bytes()[..before].iter().filter(|&&byte| byte == b'\n').count() + 1;
    RigError::Syntax(format!("line {line}: {}", shortened(error.message())))
}

impl CameraEntry {
    fn intrinsics(&self) -> Intrinsics {
        Intrinsics { focal_mm: self.focal_mm, sensor_mm: self.sensor_mm, pixels: self.pixels }
    }
}

impl FromIterator<Mount> for Cameras {
    fn from_iter<I: IntoIterator<Item = Mount>>(mounts: I) -> Self {
        Self::Rigid(mounts.into_iter().collect())
    }
}

fn mount(camera: &CameraEntry) -> Result<Mount, String> {
    let missing = |key: &str| format!("camera {:?} is bolted to the airframe and needs `{key}`", camera.name);
    Ok(Mount {
        name: camera.name.clone(),
        intrinsics: camera.intrinsics(),
        yaw_deg: camera.yaw_deg.ok_or_else(|| missing("yaw_deg"))?,
        pitch_deg: camera.pitch_deg.ok_or_else(|| missing("pitch_deg"))?,
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn every_preset_is_sound_and_bears_its_name() {
        for name in Rig::PRESETS {
            assert_eq!(Rig::preset(name).map(|rig| rig.name).as_deref(), Ok(name));
        }
        assert!(matches!(Rig::preset("phantom5"), Err(RigError::Unknown(_))));
    }

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

    #[test]
    fn impossible_rigs_are_named() {
        let phantom = include_str!("../../config/rigs/phantom4-rtk.toml");
        let oblique = include_str!("../../config/rigs/m300-oblique.toml");
        for (text, from, to, named) in [
            (phantom, "focal_mm = 8.8", "focal_mm = 0.0", "focal_mm"),
            (phantom, "focal_mm = 8.8", "focal_mm = nan", "focal_mm"),
            (phantom, "sensor_mm = [13.2, 8.8]", "sensor_mm = [132.0, 8.8]", "half the sensor"),
            (phantom, "pixels = [5472, 3648]", "pixels = [0, 3648]", "pixels"),
            (phantom, "[-90.0, 30.0]", "[60.0, 80.0]", "below the horizon"),
            (phantom, "[-90.0, 30.0]", "[30.0, -90.0]", "gimbal.pitch_deg"),
            (phantom, "[gimbal]", "[gimball]", "gimball"),
            (phantom, "shutter_interval_s = 1.0", "shutter_interval_s = -1.0", "shutter_interval_s"),
            (oblique, "pitch_deg = -90.0", "pitch_deg = -91.0", "pitch_deg"),
            (oblique, "yaw_deg = 0.0", "#", "yaw_deg"),
            (oblique, "name = \"forward\"", "name = \"nadir\"", "nadir"),
            (phantom, "name = \"main\"", "name = \"\"", "1 to 64 bytes"),
            (phantom, "focal_mm = 8.8", "focal_mm = 'wide'", "line 1"),
        ] {
            assert!(text.contains(from));
            let error = Rig::parse(&text.replacen(from, to, 1)).expect_err("the rig is impossible").to_string();
            assert!(error.contains(named), "{to:?} gave {error}");
        }
        assert!(Rig::parse("").is_err() && Rig::parse("name = 'x'\nshutter_interval_s = 1.0").is_err());
    }
}
