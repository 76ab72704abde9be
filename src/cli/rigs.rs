//! `overfly rigs`: what the presets are, and their files to begin a rig of one's own with.

use serde_json::{Value, json};

use super::answer::{self, Answer};
use super::arguments::RigsArgs;
use super::failure::Failure;
use crate::camera::{Cameras, Rig};

pub fn run(arguments: &RigsArgs) -> Result<Answer, Failure> {
    if let Some(name) = &arguments.name {
        let text = Rig::preset_file(name)?;
        return Ok(Answer { text: text.to_owned(), json: json!({ "name": name, "file": text }) });
    }
    let rigs: Vec<Rig> = Rig::PRESETS.into_iter().map(Rig::preset).collect::<Result<_, _>>()?;
    let head = ["rig", "cameras", "field of view, deg", "pitch, deg", "interval, s", "battery, Wh"].map(str::to_owned).to_vec();
    let rows: Vec<Vec<String>> = [head].into_iter().chain(rigs.iter().map(row)).collect();
    Ok(Answer { text: answer::table(&rows), json: json!({ "rigs": rigs.iter().map(entry).collect::<Vec<_>>() }) })
}

fn row(rig: &Rig) -> Vec<String> {
    let [cameras, pitch] = match &rig.cameras {
        Cameras::Panoramic { .. } => ["all directions".to_owned(), "any".to_owned()],
        Cameras::Gimbal { .. } => {
            ["1 on a gimbal".to_owned(), pitch_deg(rig).map(|[low, high]| format!("{low:.0} to {high:.0}")).unwrap_or_default()]
        }
        Cameras::Rigid(mounts) => [format!("{} bolted on", mounts.len()), "fixed".to_owned()],
    };
    let fov = fov_deg(rig).map_or("-".to_owned(), |[width, height]| format!("{width:.1} x {height:.1}"));
    let battery = rig.battery.map_or("-".to_owned(), |battery| battery.energy_wh.to_string());
    vec![rig.name.clone(), cameras, fov, pitch, rig.shutter_interval_s.to_string(), battery]
}

fn entry(rig: &Rig) -> Value {
    json!({
        "name": rig.name,
        "cameras": (0..rig.camera_count()).map(|index| rig.camera(index).0).collect::<Vec<_>>(),
        "fov_deg": fov_deg(rig),
        "gimbal_pitch_deg": pitch_deg(rig),
        "shutter_interval_s": rig.shutter_interval_s,
        "battery_wh": rig.battery.map(|battery| battery.energy_wh),
    })
}

/// Of the first camera: those of a preset are all alike.
fn fov_deg(rig: &Rig) -> Option<[f64; 2]> {
    rig.camera(0).1.map(|intrinsics| intrinsics.fov_deg())
}

fn pitch_deg(rig: &Rig) -> Option<[f64; 2]> {
    match &rig.cameras {
        Cameras::Gimbal { sin_pitch, .. } => Some(sin_pitch.map(|sin| libm::asin(sin).to_degrees())),
        _ => None,
    }
}
