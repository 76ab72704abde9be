//! The rows of a plan's table, each with the way back.

use nalgebra::{Point3, Unit, Vector3};
use overfly_table::plan::{CameraRow, ImageRow, IterationRow, LimitsRow, MetricsRow, PlanFacts, SAFE, WaypointRow};

use super::PlanTableError;
use crate::camera::Intrinsics;
use crate::frame::Geodetic;
use crate::settings::DynamicsSettings;
use crate::trajectory::egress::Egress;
use crate::trajectory::limits::{Limits, MOST_DEVIATION_M, Turning};
use crate::trajectory::plan::{Camera, Image, Iteration, Metrics, Plan, RunTimes, StopReason, Waypoint};

pub fn metrics_row(metrics: &Metrics, waypoints: usize) -> MetricsRow {
    MetricsRow {
        length_m: metrics.length_m,
        waypoints: waypoints as u64,
        movement_s: metrics.movement_s,
        turning_s: metrics.turning_s,
        flight_s: metrics.flight_s,
        profile_s: metrics.profile_s,
        battery_percent: metrics.battery_percent.unwrap_or(-1.0),
        coverage_percent: metrics.coverage_percent,
        coverage_exposed_percent: metrics.coverage_exposed_percent,
        capturable_percent: metrics.capturable_percent,
        matched_percent: metrics.matched_percent,
        information: metrics.information,
        objective: metrics.objective,
        delayed_exposures: metrics.delayed_exposures.into(),
        dropped_exposures: metrics.dropped_exposures.into(),
        blur_px: metrics.blur_px,
    }
}

/// Of a flight of which nothing `is_counted` yet no figure is there of what it captures.
pub fn metrics(row: &MetricsRow, is_counted: bool) -> Result<Metrics, PlanTableError> {
    let figure = |value| finite("metrics", value);
    let counted = |value: f64| match (is_counted, value.is_nan()) {
        (true, _) => figure(value),
        (false, true) => Ok(value),
        (false, false) => Err(PlanTableError::Counted),
    };
    let count = |code| u32::try_from(code).map_err(|_| PlanTableError::Code { what: "metrics", code });
    Ok(Metrics {
        length_m: figure(row.length_m)?,
        movement_s: figure(row.movement_s)?,
        turning_s: figure(row.turning_s)?,
        flight_s: figure(row.flight_s)?,
        profile_s: figure(row.profile_s)?,
        battery_percent: Some(figure(row.battery_percent)?).filter(|&percent| percent >= 0.0),
        coverage_percent: counted(row.coverage_percent)?,
        coverage_exposed_percent: counted(row.coverage_exposed_percent)?,
        capturable_percent: counted(row.capturable_percent)?,
        matched_percent: counted(row.matched_percent)?,
        information: counted(row.information)?,
        objective: counted(row.objective)?,
        delayed_exposures: count(row.delayed_exposures)?,
        dropped_exposures: count(row.dropped_exposures)?,
        blur_px: figure(row.blur_px)?,
    })
}

pub fn limits_row(limits: &Limits) -> LimitsRow {
    let dynamics = &limits.dynamics;
    LimitsRow {
        turning: match limits.turning {
            Turning::Nothing => 1,
            Turning::View => 2,
            Turning::Nose => 3,
        },
        cruise_mps: limits.cruise_mps,
        acceleration_mps2: dynamics.acceleration_mps2,
        jerk_mps3: dynamics.jerk_mps3,
        lateral_mps2: dynamics.lateral_mps2,
        corner_deviation_m: dynamics.corner_deviation_m,
        yaw_rate_dps: dynamics.yaw_rate_dps,
        gimbal_rate_dps: dynamics.gimbal_rate_dps,
        entry_mps: limits.entry_mps,
    }
}

pub fn limits(row: &LimitsRow) -> Result<Option<Limits>, PlanTableError> {
    let turning = match row.turning {
        0 => return Ok(None),
        1 => Turning::Nothing,
        2 => Turning::View,
        3 => Turning::Nose,
        code => return Err(PlanTableError::Code { what: "limits", code }),
    };
    let dynamics = DynamicsSettings {
        acceleration_mps2: row.acceleration_mps2,
        jerk_mps3: row.jerk_mps3,
        lateral_mps2: row.lateral_mps2,
        corner_deviation_m: row.corner_deviation_m,
        yaw_rate_dps: row.yaw_rate_dps,
        gimbal_rate_dps: row.gimbal_rate_dps,
    };
    let limits = Limits { turning, cruise_mps: row.cruise_mps, dynamics, entry_mps: row.entry_mps };
    if limits.are_sound() { Ok(Some(limits)) } else { Err(PlanTableError::Limits { what: "limits" }) }
}

pub fn egress(code: u64, waypoints: usize) -> Result<Egress, PlanTableError> {
    let egress = Egress { brakes: code & 1 != 0, escapes: code & 2 != 0 };
    if code > 3 || egress.legs() >= waypoints.max(1) {
        return Err(PlanTableError::Code { what: "egress", code });
    }
    Ok(egress)
}

pub fn run_times(facts: &PlanFacts) -> Result<RunTimes, PlanTableError> {
    Ok(RunTimes {
        field_s: finite("times", facts.field_s)?,
        search_s: finite("times", facts.search_s)?,
        check_s: finite("times", facts.check_s)?,
        total_s: finite("times", facts.total_s)?,
        threads: u32::try_from(facts.threads).map_err(|_| PlanTableError::Code { what: "threads", code: facts.threads })?,
    })
}

pub fn origin(facts: &PlanFacts) -> Result<Option<Geodetic>, PlanTableError> {
    let (lat, lon, alt) = (facts.origin_lat_deg, facts.origin_lon_deg, facts.origin_alt_m);
    Ok(flag("origin", facts.georeferenced)?.then_some(Geodetic {
        lat_deg: finite("origin", lat)?,
        lon_deg: finite("origin", lon)?,
        alt_m: finite("origin", alt)?,
    }))
}

pub fn waypoint_row(waypoint: &Waypoint) -> WaypointRow {
    WaypointRow {
        position_m: waypoint.position_m.into(),
        direction: waypoint.direction.map_or([0.0; 3], |direction| direction.into_inner().into()),
        has_direction: waypoint.direction.is_some().into(),
        deviation_m: waypoint.deviation_m,
    }
}

pub fn waypoint(row: &WaypointRow) -> Result<Waypoint, PlanTableError> {
    Ok(Waypoint {
        position_m: Point3::from(finite3("waypoints", row.position_m)?),
        direction: direction("waypoints", row.has_direction, row.direction)?,
        deviation_m: Some(row.deviation_m)
            .filter(|deviation_m| (0.0..=MOST_DEVIATION_M).contains(deviation_m))
            .ok_or(PlanTableError::Limits { what: "arcs" })?,
    })
}

pub fn image_row(image: &Image) -> ImageRow {
    ImageRow {
        position_m: image.position_m.into(),
        direction: image.direction.map_or([0.0; 3], |direction| direction.into_inner().into()),
        up: image.up.into(),
        fov_deg: image.fov_deg.unwrap_or([0.0; 2]),
        time_s: image.time_s,
        camera: image.camera,
        has_direction: image.direction.is_some().into(),
        selected: image.selected.into(),
    }
}

pub fn image(row: &ImageRow, cameras: usize) -> Result<Image, PlanTableError> {
    if row.camera as usize >= cameras {
        return Err(PlanTableError::Camera { camera: row.camera, cameras });
    }
    let [width, height] = [finite("images", row.fov_deg[0])?, finite("images", row.fov_deg[1])?];
    Ok(Image {
        position_m: Point3::from(finite3("images", row.position_m)?),
        direction: direction("images", row.has_direction.into(), row.direction)?,
        up: Vector3::from(finite3("images", row.up)?),
        fov_deg: (width != 0.0 || height != 0.0).then_some([width, height]),
        camera: row.camera,
        time_s: finite("images", row.time_s)?,
        selected: flag("images", row.selected.into())?,
    })
}

pub fn camera_row(camera: &Camera) -> CameraRow {
    let intrinsics = camera.intrinsics.unwrap_or(Intrinsics { focal_mm: 0.0, sensor_mm: [0.0; 2], pixels: [0; 2] });
    let Intrinsics { focal_mm, sensor_mm, pixels } = intrinsics;
    CameraRow { pixel_rad: camera.pixel_rad, focal_mm, sensor_mm, pixels }
}

pub fn camera(name: String, row: &CameraRow) -> Result<Camera, PlanTableError> {
    let [width, height] = row.sensor_mm;
    let focal_mm = finite("cameras", row.focal_mm)?;
    let sensor_mm = [finite("cameras", width)?, finite("cameras", height)?];
    let intrinsics = (focal_mm != 0.0).then_some(Intrinsics { focal_mm, sensor_mm, pixels: row.pixels });
    Ok(Camera { name, intrinsics, pixel_rad: finite("cameras", row.pixel_rad)? })
}

pub fn iteration_row(iteration: &Iteration) -> IterationRow {
    IterationRow {
        objective: iteration.objective,
        coverage_percent: iteration.coverage_percent,
        length_m: iteration.length_m,
        turning_s: iteration.turning_s,
    }
}

pub fn iteration(row: &IterationRow) -> Result<Iteration, PlanTableError> {
    let figure = |value| finite("iterations", value);
    Ok(Iteration {
        objective: figure(row.objective)?,
        coverage_percent: figure(row.coverage_percent)?,
        length_m: figure(row.length_m)?,
        turning_s: figure(row.turning_s)?,
    })
}

pub fn stop_code(stop: StopReason) -> u64 {
    match stop {
        StopReason::GoalReached => 0,
        StopReason::IterationsUsed => 1,
        StopReason::Cancelled => 2,
        StopReason::MemoryUsed => 3,
        StopReason::SpaceExhausted => 4,
        StopReason::Complete => 5,
        StopReason::Repaired => 6,
        StopReason::Improved => 7,
        StopReason::Safe => SAFE,
    }
}

pub fn stop_reason(code: u64) -> Result<StopReason, PlanTableError> {
    match code {
        0 => Ok(StopReason::GoalReached),
        1 => Ok(StopReason::IterationsUsed),
        2 => Ok(StopReason::Cancelled),
        3 => Ok(StopReason::MemoryUsed),
        4 => Ok(StopReason::SpaceExhausted),
        5 => Ok(StopReason::Complete),
        6 => Ok(StopReason::Repaired),
        7 => Ok(StopReason::Improved),
        SAFE => Ok(StopReason::Safe),
        code => Err(PlanTableError::Code { what: "stop reason", code }),
    }
}

/// Scene, rig, method and cameras, one line each; a line break in a name is written as `\n`.
pub fn text(plan: &Plan) -> String {
    let names = [&plan.scene.name, &plan.rig, &plan.method].into_iter().chain(plan.cameras.iter().map(|camera| &camera.name));
    names.map(|name| escape(name) + "\n").collect()
}

pub fn escape(line: &str) -> String {
    line.replace('\\', "\\\\").replace('\n', "\\n")
}

pub fn unescape(line: &str) -> String {
    let mut name = String::with_capacity(line.len());
    let mut letters = line.chars();
    while let Some(letter) = letters.next() {
        match (letter, letter == '\\') {
            (_, true) => name.push(if letters.next() == Some('n') { '\n' } else { '\\' }),
            (plain, false) => name.push(plain),
        }
    }
    name
}

pub fn direction(what: &'static str, has: u64, vector: [f64; 3]) -> Result<Option<Unit<Vector3<f64>>>, PlanTableError> {
    if !flag(what, has)? {
        return Ok(None);
    }
    let vector = Vector3::from(finite3(what, vector)?);
    // Taken as it is, so that the way there and back changes no bit.
    if (vector.norm() - 1.0).abs() > 1e-9 {
        return Err(PlanTableError::Direction { what });
    }
    Ok(Some(Unit::new_unchecked(vector)))
}

pub fn flag(what: &'static str, code: u64) -> Result<bool, PlanTableError> {
    match code {
        0 => Ok(false),
        1 => Ok(true),
        code => Err(PlanTableError::Code { what, code }),
    }
}

pub fn finite3(what: &'static str, values: [f64; 3]) -> Result<[f64; 3], PlanTableError> {
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(PlanTableError::NotFinite { what }) }
}

pub fn finite(what: &'static str, value: f64) -> Result<f64, PlanTableError> {
    if value.is_finite() { Ok(value) } else { Err(PlanTableError::NotFinite { what }) }
}
