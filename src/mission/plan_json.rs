//! `plan.json`: the plan as users, tests and other tools read it. Metres, seconds, degrees where the key says so; the local ENU frame
//! at `origin`.
//!
//! The bytes depend on the plan alone: keys stand in a fixed order, every number is written in the shortest form that reads back as
//! the same f64, and every waypoint and image stands on a line of its own, so that two plans can be compared with `diff`.

use nalgebra::{Point3, Vector3};
use serde::Serialize;
use serde_json::Value;

use crate::camera::Intrinsics;
use crate::frame::Geodetic;
use crate::trajectory::plan::{Camera, Image, Plan, Waypoint};
use crate::trajectory::samples::{Sample, samples};

/// Version of the format, the first key of the file.
pub const FORMAT: &str = "overfly-plan/1";

/// The file's content, with a final newline.
pub fn to_bytes(plan: &Plan) -> Vec<u8> {
    let scene = SceneEntry { name: &plan.scene.name, origin: plan.scene.origin, revision: plan.scene.revision };
    let waypoints: Vec<String> = plan.waypoints.iter().map(|waypoint| json(&waypoint_entry(waypoint))).collect();
    let images: Vec<String> = plan.images.iter().map(|image| json(&image_entry(plan, image))).collect();
    let profile = plan.profile();
    let trajectory: Option<Vec<String>> =
        profile.map(|profile| samples(&profile).iter().map(|sample| json(&sample_entry(sample))).collect());
    let members = [
        ("format", json(&FORMAT)),
        ("scene", json(&scene)),
        ("seed", json(&plan.seed)),
        ("rig", json(&plan.rig)),
        ("method", json(&plan.method)),
        ("cameras", json(&plan.cameras.iter().map(camera_entry).collect::<Vec<_>>())),
        ("waypoints", one_per_line(&waypoints)),
        ("images", one_per_line(&images)),
        ("limits", plan.limits.map_or(String::new(), |limits| json(&limits))),
        ("egress", if plan.egress.legs() > 0 { json(&plan.egress) } else { String::new() }),
        ("trajectory", trajectory.map_or(String::new(), |rows| one_per_line(&rows))),
        ("metrics", json(&metrics_entry(plan))),
    ];
    let given = members.iter().filter(|(_, value)| !value.is_empty());
    let lines: Vec<String> = given.map(|(key, value)| format!("  \"{key}\": {value}")).collect();
    format!("{{\n{}\n}}\n", lines.join(",\n")).into_bytes()
}

/// The figures of a plan, as they stand under `metrics`.
pub fn metrics(plan: &Plan) -> Value {
    serde_json::to_value(metrics_entry(plan)).expect("an entry has string keys and no failing serialiser")
}

#[derive(Serialize)]
struct SceneEntry<'a> {
    name: &'a str,
    origin: Option<Geodetic>,
    revision: u64,
}

#[derive(Serialize)]
struct CameraEntry<'a> {
    name: &'a str,
    #[serde(flatten)]
    intrinsics: Option<Intrinsics>,
    pixel_rad: f64,
}

#[derive(Serialize)]
struct WaypointEntry {
    position_m: [f64; 3],
    direction: Option<[f64; 3]>,
    deviation_m: f64,
}

#[derive(Serialize)]
struct SampleEntry {
    time_s: f64,
    position_m: [f64; 3],
    velocity_mps: [f64; 3],
}

#[derive(Serialize)]
struct ImageEntry<'a> {
    position_m: [f64; 3],
    direction: Option<[f64; 3]>,
    up: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    fov_deg: Option<[f64; 2]>,
    camera: &'a str,
    time_s: f64,
    selected: bool,
}

#[derive(Serialize)]
struct MetricsEntry {
    length_m: f64,
    waypoints: usize,
    movement_s: f64,
    turning_s: f64,
    flight_s: f64,
    profile_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    battery_percent: Option<f64>,
    images: usize,
    selected_images: usize,
    delayed_exposures: u32,
    dropped_exposures: u32,
    blur_px: f64,
    coverage_percent: f64,
    coverage_exposed_percent: f64,
    capturable_percent: f64,
    matched_percent: f64,
    information: f64,
    objective: f64,
}

fn camera_entry(camera: &Camera) -> CameraEntry<'_> {
    CameraEntry { name: &camera.name, intrinsics: camera.intrinsics, pixel_rad: camera.pixel_rad }
}

fn waypoint_entry(waypoint: &Waypoint) -> WaypointEntry {
    WaypointEntry {
        position_m: point(&waypoint.position_m),
        direction: waypoint.direction.map(|direction| vector(&direction)),
        deviation_m: plain_zero(waypoint.deviation_m),
    }
}

fn sample_entry(sample: &Sample) -> SampleEntry {
    SampleEntry {
        time_s: plain_zero(sample.time_s),
        position_m: point(&sample.position_m),
        velocity_mps: vector(&sample.velocity_mps),
    }
}

fn image_entry<'a>(plan: &'a Plan, image: &Image) -> ImageEntry<'a> {
    ImageEntry {
        position_m: point(&image.position_m),
        direction: image.direction.map(|direction| vector(&direction)),
        up: vector(&image.up),
        fov_deg: image.fov_deg,
        camera: plan.cameras.get(image.camera as usize).map_or("unknown", |camera| camera.name.as_str()),
        time_s: plain_zero(image.time_s),
        selected: image.selected,
    }
}

fn metrics_entry(plan: &Plan) -> MetricsEntry {
    let metrics = &plan.metrics;
    MetricsEntry {
        length_m: metrics.length_m,
        waypoints: plan.waypoints.len(),
        movement_s: metrics.movement_s,
        turning_s: metrics.turning_s,
        flight_s: metrics.flight_s,
        profile_s: metrics.profile_s,
        battery_percent: metrics.battery_percent,
        images: plan.images.len(),
        selected_images: plan.selected_images(),
        delayed_exposures: metrics.delayed_exposures,
        dropped_exposures: metrics.dropped_exposures,
        blur_px: metrics.blur_px,
        coverage_percent: metrics.coverage_percent,
        coverage_exposed_percent: metrics.coverage_exposed_percent,
        capturable_percent: metrics.capturable_percent,
        matched_percent: metrics.matched_percent,
        information: metrics.information,
        objective: metrics.objective,
    }
}

fn point(point: &Point3<f64>) -> [f64; 3] {
    vector(&point.coords)
}

fn vector(vector: &Vector3<f64>) -> [f64; 3] {
    [plain_zero(vector.x), plain_zero(vector.y), plain_zero(vector.z)]
}

/// Minus zero reads as a mistake in a file; adding zero turns it into zero and changes nothing else.
fn plain_zero(value: f64) -> f64 {
    value + 0.0
}

fn one_per_line(rows: &[String]) -> String {
    if rows.is_empty() {
        return "[]".to_owned();
    }
    format!("[\n    {}\n  ]", rows.join(",\n    "))
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("entries have string keys and no failing serialiser")
}
