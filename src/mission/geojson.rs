//! GeoJSON of a plan: the curve that is flown, its waypoints, its images. Heights are those of the origin's reference plus the height above its ground.

use serde::Serialize;
use serde_json::{Value, json};

use super::pictures::{Picture, pictures};
use crate::camera::pitch_rad;
use crate::frame::{Geodetic, LocalFrame};
use crate::quality::Which;
use crate::trajectory::plan::{Plan, Waypoint};

/// The file's content, one feature a line; `None` for a plan without georeference.
pub fn to_bytes(plan: &Plan, which: Which) -> Option<Vec<u8>> {
    let frame = LocalFrame { origin: plan.scene.origin };
    let origin = frame.origin?;
    let position = |place: &Geodetic| json!([degrees(place.lon_deg), degrees(place.lat_deg), metres(place.alt_m)]);
    let line: Option<Vec<Value>> =
        plan.flown_points().iter().map(|(point, _)| frame.geodetic_from_local(point).map(|place| position(&place))).collect();
    let path = json!({
        "type": "Feature",
        "geometry": { "type": "LineString", "coordinates": line? },
        "properties": { "kind": "path", "scene": plan.scene.name, "rig": plan.rig, "length_m": plan.metrics.length_m, "flight_s": plan.metrics.profile_s },
    });
    let waypoint = |(index, waypoint): (usize, &Waypoint)| {
        let place = frame.geodetic_from_local(&waypoint.position_m).unwrap_or(origin);
        json!({
            "type": "Feature",
            "geometry": { "type": "Point", "coordinates": position(&place) },
            "properties": {
                "kind": "waypoint",
                "waypoint": index,
                "height_m": waypoint.position_m.z,
                "azimuth_deg": waypoint.direction.map(|view| libm::atan2(view.x, view.y).to_degrees().rem_euclid(360.0)),
                "pitch_deg": waypoint.direction.map(|view| pitch_rad(&view).to_degrees()),
                "deviation_m": waypoint.deviation_m,
            },
        })
    };
    let picture = |picture: &Picture| {
        let image = picture.image;
        json!({
            "type": "Feature",
            "geometry": { "type": "Point", "coordinates": position(&picture.place.unwrap_or(origin)) },
            "properties": {
                "kind": "image",
                "name": picture.name,
                "camera": plan.cameras.get(image.camera as usize).map(|camera| &camera.name),
                "time_s": image.time_s,
                "height_m": image.position_m.z,
                "azimuth_deg": image.direction.map(|view| libm::atan2(view.x, view.y).to_degrees().rem_euclid(360.0)),
                "pitch_deg": image.direction.map(|view| pitch_rad(&view).to_degrees()),
                "selected": image.selected,
            },
        })
    };
    let pictures = pictures(plan, which);
    let features =
        std::iter::once(path).chain(plan.waypoints.iter().enumerate().map(waypoint)).chain(pictures.iter().map(picture));
    Some(collection(features))
}

/// A collection with each feature on a line of its own.
pub fn collection(features: impl Iterator<Item = impl Serialize>) -> Vec<u8> {
    let mut bytes = b"{\"type\": \"FeatureCollection\", \"features\": [".to_vec();
    for (index, feature) in features.enumerate() {
        bytes.extend_from_slice(if index == 0 { b"\n" } else { b",\n" });
        serde_json::to_writer(&mut bytes, &feature).expect("memory takes everything, and keys are strings");
    }
    bytes.extend_from_slice(b"\n]}\n");
    bytes
}

/// A tenth of a millimetre on the ground.
pub fn degrees(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

pub fn metres(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
