//! Rig files: the cameras of a drone as TOML, and the presets.

use std::f64::consts::TAU;

use serde::Deserialize;

use super::Intrinsics;
use super::rig::{Battery, Cameras, MOST_CAMERAS, Mount, Rig};

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
}

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
    #[serde(default = "usual_exposure_s")]
    exposure_s: f64,
    blur_px: f64,
    yaw_deg: Option<f64>,
    pitch_deg: Option<f64>,
}

/// 1/1000 s: common advice for mapping in daylight, and short enough for the flight at 8 m/s.
fn usual_exposure_s() -> f64 {
    0.001
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
            exposure_s: self.camera.iter().map(|camera| camera.exposure_s).reduce(f64::max).unwrap_or_else(usual_exposure_s),
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
    use super::*;

    #[test]
    fn every_preset_is_sound_and_bears_its_name() {
        for name in Rig::PRESETS {
            assert_eq!(Rig::preset(name).map(|rig| rig.name).as_deref(), Ok(name));
        }
        assert!(matches!(Rig::preset("phantom5"), Err(RigError::Unknown(_))));
    }

    #[test]
    fn a_camera_that_states_no_exposure_takes_the_usual_one() {
        let phantom = include_str!("../../config/rigs/phantom4-rtk.toml");
        let exposure_s = |line: &str| Rig::parse(&phantom.replacen("exposure_s = 0.001 ", line, 1)).map(|rig| rig.exposure_s);
        assert_eq!(["#", "exposure_s = 0.002 "].map(exposure_s), [Ok(0.001), Ok(0.002)]);
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
