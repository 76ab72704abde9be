//! `plan.json` read back. Files come from anywhere: whatever is wrong is named with file and key, and nothing of a wrong file is used.

use nalgebra::{Point3, Unit, Vector3};
use serde::{Deserialize, Deserializer};

use super::plan_json::FORMAT;
use crate::camera::Intrinsics;
use crate::frame::Geodetic;
use crate::trajectory::egress::Egress;
use crate::trajectory::limits::{Limits, MOST_DEVIATION_M};
use crate::trajectory::plan::{Camera, Image, Metrics, Plan, SceneStamp, StopReason, Waypoint};

/// Most images, waypoints or cameras that a plan may have.
const MOST_ROWS: usize = 1_000_000;
/// Coordinates farther out than this are a mistake, m.
const FARTHEST_M: f64 = 1e6;
/// How far the length of a direction may be from one.
const UNIT_TOLERANCE: f64 = 1e-6;

/// Why a file is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanReadError {
    #[error("{file}: the file is empty; give the plan.json that `overfly plan --out DIR` has written")]
    Empty { file: String },
    #[error("{file}: this is {found}; give the plan.json that `overfly plan --out DIR` has written")]
    NoPlan { file: String, found: &'static str },
    #[error("{file}: the format is {found:?}, this program reads {FORMAT:?}; plan the flight again with this version")]
    Version { file: String, found: String },
    #[error("{file}: `{key}`: {what}; the file is damaged or was changed: plan the flight again")]
    Value { file: String, key: String, what: String },
}

/// Reads a plan. What the file does not hold (covered cells, ceilings, convergence, the goal, the clearance) is empty or zero.
pub fn read(file_name: &str, bytes: &[u8]) -> Result<Plan, PlanReadError> {
    let file = || file_name.to_owned();
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match bytes.iter().find(|byte| !byte.is_ascii_whitespace()) {
        None => return Err(PlanReadError::Empty { file: file() }),
        Some(b'{') => {}
        Some(_) if bytes.starts_with(&[0x1f, 0x8b]) => {
            return Err(PlanReadError::NoPlan { file: file(), found: "compressed with gzip: unpack it first" });
        }
        Some(_) => return Err(PlanReadError::NoPlan { file: file(), found: "no JSON object" }),
    }
    let head: Head = parse(file_name, bytes)?;
    match head {
        Head { format: Some(format), .. } if format == FORMAT => {}
        Head { format: Some(found), .. } => {
            return Err(PlanReadError::Version { file: file(), found: found.chars().take(40).collect() });
        }
        Head { kind: Some(_), .. } => return Err(PlanReadError::NoPlan { file: file(), found: "a scene and no plan" }),
        Head { .. } => return Err(PlanReadError::NoPlan { file: file(), found: "JSON without the key `format`" }),
    }
    let entry: PlanEntry = parse(file_name, bytes)?;
    entry.plan().map_err(|Wrong { key, what }| PlanReadError::Value { file: file(), key, what })
}

fn parse<'a, T: Deserialize<'a>>(file_name: &str, bytes: &'a [u8]) -> Result<T, PlanReadError> {
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let parsed =
        serde_path_to_error::deserialize(&mut json).map_err(|error| (error.path().to_string(), error.into_inner().to_string()));
    let ended = parsed.and_then(|value| json.end().map(|()| value).map_err(|error| (".".to_owned(), error.to_string())));
    ended.map_err(|(key, what)| {
        let key = if key == "." { "the whole file".to_owned() } else { key };
        PlanReadError::Value { file: file_name.to_owned(), key, what }
    })
}

/// A value that is well-formed and wrong.
struct Wrong {
    key: String,
    what: String,
}

fn wrong<T>(key: String, what: impl Into<String>) -> Result<T, Wrong> {
    Err(Wrong { key, what: what.into() })
}

#[derive(Deserialize)]
struct Head {
    format: Option<String>,
    /// What GeoJSON and CityJSON say of themselves.
    #[serde(rename = "type")]
    kind: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
struct PlanEntry {
    scene: SceneEntry,
    seed: u64,
    rig: String,
    method: String,
    cameras: Vec<CameraEntry>,
    waypoints: Vec<WaypointEntry>,
    images: Vec<ImageEntry>,
    /// The trajectory follows from limits and waypoints, and is not read.
    limits: Option<Limits>,
    egress: Option<Egress>,
    metrics: MetricsEntry,
}

#[derive(Deserialize)]
struct SceneEntry {
    name: String,
    #[serde(deserialize_with = "present")]
    origin: Option<Geodetic>,
    revision: u64,
}

#[derive(Deserialize)]
struct CameraEntry {
    name: String,
    pixel_rad: f64,
    focal_mm: Option<f64>,
    sensor_mm: Option<[f64; 2]>,
    pixels: Option<[u32; 2]>,
}

#[derive(Deserialize)]
struct WaypointEntry {
    position_m: [f64; 3],
    #[serde(deserialize_with = "present")]
    direction: Option<[f64; 3]>,
    #[serde(default)]
    deviation_m: f64,
}

#[derive(Deserialize)]
struct ImageEntry {
    position_m: [f64; 3],
    #[serde(deserialize_with = "present")]
    direction: Option<[f64; 3]>,
    up: [f64; 3],
    fov_deg: Option<[f64; 2]>,
    camera: String,
    time_s: f64,
    selected: bool,
}

#[derive(Deserialize)]
struct MetricsEntry {
    length_m: f64,
    movement_s: f64,
    turning_s: f64,
    flight_s: f64,
    #[serde(default)]
    profile_s: f64,
    battery_percent: Option<f64>,
    coverage_percent: f64,
    coverage_exposed_percent: f64,
    capturable_percent: f64,
    #[serde(default)]
    matched_percent: f64,
    information: f64,
    objective: f64,
    #[serde(default)]
    delayed_exposures: u32,
    #[serde(default)]
    dropped_exposures: u32,
    #[serde(default)]
    blur_px: f64,
}

/// A key that may be null, but must stand there.
fn present<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    Option::deserialize(deserializer)
}

impl PlanEntry {
    fn plan(self) -> Result<Plan, Wrong> {
        let counts =
            [("cameras", self.cameras.len(), 1), ("waypoints", self.waypoints.len(), 1), ("images", self.images.len(), 1)];
        for (key, count, least) in counts {
            if !(least..=MOST_ROWS).contains(&count) {
                return wrong(key.to_owned(), format!("it has {count} entries, and must have {least} to {MOST_ROWS}"));
            }
        }
        if let Some(origin) = &self.scene.origin {
            let fits = origin.lat_deg.abs() <= 90.0 && origin.lon_deg.abs() <= 180.0 && origin.alt_m.abs() <= 10_000.0;
            if !fits {
                return wrong("scene.origin".to_owned(), "it is no place on the Earth");
            }
        }
        if self.limits.is_some_and(|limits| !limits.are_sound()) {
            return wrong("limits".to_owned(), "they lie beyond what a drone can fly by");
        }
        let cameras = self.cameras.into_iter().enumerate().map(|(index, camera)| camera.camera(index));
        let cameras: Vec<Camera> = cameras.collect::<Result<_, _>>()?;
        let waypoints = self.waypoints.into_iter().enumerate().map(|(index, waypoint)| waypoint.waypoint(index));
        let images = self.images.into_iter().enumerate().map(|(index, image)| image.image(index, &cameras));
        Ok(Plan {
            scene: SceneStamp { name: self.scene.name, origin: self.scene.origin, revision: self.scene.revision },
            seed: self.seed,
            rig: self.rig,
            method: self.method,
            waypoints: waypoints.collect::<Result<_, _>>()?,
            images: images.collect::<Result<_, _>>()?,
            cameras,
            metrics: self.metrics.metrics(),
            limits: self.limits,
            cells: Vec::new(),
            ceilings: Vec::new(),
            goal_percent: 0.0,
            matched_goal_percent: 0.0,
            egress: self.egress.unwrap_or_default(),
            clearance_m: 0.0,
            convergence: Vec::new(),
            stop: StopReason::Complete,
        })
    }
}

impl CameraEntry {
    fn camera(self, index: usize) -> Result<Camera, Wrong> {
        let key = |name: &str| format!("cameras[{index}].{name}");
        if !(1e-9..=0.1).contains(&self.pixel_rad) {
            return wrong(key("pixel_rad"), format!("{} is no angle of a pixel in radians", self.pixel_rad));
        }
        let intrinsics = match (self.focal_mm, self.sensor_mm, self.pixels) {
            (None, None, None) => None,
            (Some(focal_mm), Some(sensor_mm), Some(pixels)) => Some(Intrinsics { focal_mm, sensor_mm, pixels }),
            _ => return wrong(key("focal_mm"), "`focal_mm`, `sensor_mm` and `pixels` stand together or not at all"),
        };
        if intrinsics.is_some_and(|lens| !lens.half_tangents().iter().all(|half_tangent| (0.01..=4.0).contains(half_tangent))) {
            return wrong(key("focal_mm"), "focal length and sensor give no field of view that a camera has");
        }
        Ok(Camera { name: self.name, intrinsics, pixel_rad: self.pixel_rad })
    }
}

impl WaypointEntry {
    fn waypoint(self, index: usize) -> Result<Waypoint, Wrong> {
        let key = |name: &str| format!("waypoints[{index}].{name}");
        if !(0.0..=MOST_DEVIATION_M).contains(&self.deviation_m) {
            return wrong(key("deviation_m"), format!("{} m is no distance of an arc from its corner", self.deviation_m));
        }
        Ok(Waypoint {
            deviation_m: self.deviation_m,
            position_m: position(self.position_m, || key("position_m"))?,
            direction: self.direction.map(|direction| unit(direction, || key("direction"))).transpose()?,
        })
    }
}

impl ImageEntry {
    fn image(self, index: usize, cameras: &[Camera]) -> Result<Image, Wrong> {
        let key = |name: &str| format!("images[{index}].{name}");
        let direction = self.direction.map(|direction| unit(direction, || key("direction"))).transpose()?;
        let up = unit(self.up, || key("up"))?;
        if direction.is_some() != self.fov_deg.is_some() {
            return wrong(key("fov_deg"), "an image has a direction and a field of view, or, as a panorama, neither");
        }
        if direction.is_some_and(|direction| direction.dot(&up).abs() > 1e-3) {
            return wrong(key("up"), "it does not stand at a right angle to the direction");
        }
        if self.fov_deg.is_some_and(|sides| sides.iter().any(|side| !(0.01..=179.0).contains(side))) {
            return wrong(key("fov_deg"), "a field of view lies between 0.01 and 179 degrees");
        }
        if !(self.time_s.is_finite() && self.time_s >= 0.0) {
            return wrong(key("time_s"), format!("{} is no time", self.time_s));
        }
        let Some(camera) = cameras.iter().position(|camera| camera.name == self.camera) else {
            return wrong(key("camera"), format!("there is no camera {:?} among `cameras`", self.camera));
        };
        Ok(Image {
            position_m: position(self.position_m, || key("position_m"))?,
            direction,
            up: up.into_inner(),
            fov_deg: self.fov_deg,
            camera: camera as u32,
            time_s: self.time_s,
            selected: self.selected,
        })
    }
}

impl MetricsEntry {
    fn metrics(self) -> Metrics {
        Metrics {
            length_m: self.length_m,
            movement_s: self.movement_s,
            turning_s: self.turning_s,
            flight_s: self.flight_s,
            profile_s: self.profile_s,
            battery_percent: self.battery_percent,
            coverage_percent: self.coverage_percent,
            coverage_exposed_percent: self.coverage_exposed_percent,
            capturable_percent: self.capturable_percent,
            matched_percent: self.matched_percent,
            information: self.information,
            objective: self.objective,
            delayed_exposures: self.delayed_exposures,
            dropped_exposures: self.dropped_exposures,
            blur_px: self.blur_px,
        }
    }
}

fn position(position_m: [f64; 3], key: impl Fn() -> String) -> Result<Point3<f64>, Wrong> {
    if position_m.iter().all(|value| value.is_finite() && value.abs() <= FARTHEST_M) {
        return Ok(position_m.into());
    }
    wrong(key(), format!("{position_m:?} is no position within {FARTHEST_M} m of the origin"))
}

/// A direction keeps its digits when it has unit length to within rounding.
fn unit(direction: [f64; 3], key: impl Fn() -> String) -> Result<Unit<Vector3<f64>>, Wrong> {
    let vector = Vector3::from(direction);
    if (vector.norm() - 1.0).abs() <= UNIT_TOLERANCE {
        return Ok(Unit::new_unchecked(vector));
    }
    wrong(key(), format!("{direction:?} has not the length 1"))
}
