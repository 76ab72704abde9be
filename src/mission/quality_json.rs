//! `quality.json`: the predicted quality of a plan's images on a scene, without the samples.

use serde::Serialize;
use serde_json::{Value, json};

use crate::quality::{COMPLETENESS_M, Flown, Summary};
use crate::settings::QualitySettings;
use crate::trajectory::plan::Plan;

/// Version of the format, the first key of the file.
pub const FORMAT: &str = "overfly-quality/1";

/// Everything that is told of an assessed plan.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    pub plan: &'a Plan,
    /// Name of the scene that the plan was held against.
    pub truth: &'a str,
    /// `all` or `selected`.
    pub images: &'static str,
    pub summary: &'a Summary,
    pub flown: &'a Flown,
    pub settings: &'a QualitySettings,
    /// What a reader should know about the figures.
    pub notes: &'a [String],
}

/// The report as one object.
pub fn to_json(report: &Report) -> Value {
    let Report { plan, flown, .. } = report;
    let mut object = json!({
        "format": FORMAT,
        "plan": {
            "scene": plan.scene.name, "revision": plan.scene.revision, "rig": plan.rig, "method": plan.method, "seed": plan.seed,
            "length_m": plan.metrics.length_m, "flight_s": plan.metrics.flight_s, "waypoints": plan.waypoints.len(),
        },
        "truth": report.truth,
        "images_used": report.images,
        "completeness_within_m": COMPLETENESS_M,
        "clearance_m": flown.clearance_m,
        "collides": flown.collides,
        "below_safety_distance": flown.too_near,
        "nearest_m": flown.nearest_m.map(|point| <[f64; 3]>::from(point.coords)),
        "nearest_after_waypoint": flown.leg,
        "settings": report.settings,
        "notes": report.notes,
    });
    merge(&mut object, report.summary);
    object
}

/// The file's content, with a final newline.
pub fn to_bytes(report: &Report) -> Vec<u8> {
    format!("{:#}\n", to_json(report)).into_bytes()
}

fn merge(object: &mut Value, figures: &impl Serialize) {
    let figures = serde_json::to_value(figures).expect("figures have string keys and no failing serialiser");
    if let (Value::Object(object), Value::Object(figures)) = (object, figures) {
        object.extend(figures);
    }
}
