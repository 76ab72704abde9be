//! QGroundControl's `.plan`: mission, geofence and rally points of one sortie, as simple items.

use serde_json::{Value, json};

use super::course::{Altitudes, Course, Fence, Place, Sortie};
use super::mav_items::{Autopilot, FRAME_ABSOLUTE, FRAME_MISSION, FRAME_TERRAIN, MavItem, items};
use crate::frame::Geodetic;

/// MAV_AUTOPILOT and, for all, the vehicle's type: a multicopter.
const FIRMWARE_PX4: u32 = 12;
const FIRMWARE_ARDUPILOT: u32 = 3;
const MULTICOPTER: u32 = 2;
/// AltitudeMode: each item its own, above the take-off place, above mean sea level, above the terrain that the aircraft knows.
const MODE_MIXED: u32 = 0;
const MODE_RELATIVE: u32 = 1;
const MODE_ABSOLUTE: u32 = 2;
const MODE_TERRAIN: u32 = 4;

/// The file's content, with a final newline.
pub fn to_bytes(course: &Course, sortie: &Sortie, autopilot: Autopilot) -> Vec<u8> {
    let altitude_mode = match course.altitudes {
        Altitudes::Relative => MODE_RELATIVE,
        Altitudes::Absolute => MODE_ABSOLUTE,
        Altitudes::Terrain => MODE_MIXED,
    };
    let items = items(course, sortie, autopilot);
    let items: Vec<Value> = items.iter().enumerate().map(|(index, item)| simple_item(index + 1, item)).collect();
    let home = &course.home.geodetic;
    let file = json!({
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": match autopilot {
                Autopilot::Px4 => FIRMWARE_PX4,
                Autopilot::ArduPilot => FIRMWARE_ARDUPILOT,
            },
            "vehicleType": MULTICOPTER,
            "cruiseSpeed": course.cruise_mps,
            "hoverSpeed": course.cruise_mps,
            "globalPlanAltitudeMode": altitude_mode,
            "plannedHomePosition": [home.lat_deg, home.lon_deg, home.alt_m],
            "items": items,
        },
        "geoFence": {
            "version": 2,
            "circles": [],
            "polygons": course.fences.iter().map(polygon).collect::<Vec<_>>(),
        },
        "rallyPoints": {
            "version": 2,
            "points": course.rally.iter().map(|place| rally(course, place)).collect::<Vec<_>>(),
        },
    });
    let mut bytes = serde_json::to_vec_pretty(&file).expect("values have string keys");
    bytes.push(b'\n');
    bytes
}

/// Parameters that are left to the autopilot (NaN) become null.
fn simple_item(number: usize, item: &MavItem) -> Value {
    let [p1, p2, p3, p4] = item.params;
    let mut value = json!({
        "type": "SimpleItem",
        "autoContinue": true,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": [p1, p2, p3, p4, item.lat_deg, item.lon_deg, item.alt_m],
    });
    if item.frame != FRAME_MISSION {
        value["Altitude"] = json!(item.alt_m);
        value["AltitudeMode"] = json!(match item.frame {
            FRAME_ABSOLUTE => MODE_ABSOLUTE,
            FRAME_TERRAIN => MODE_TERRAIN,
            _ => MODE_RELATIVE,
        });
        value["AMSLAltAboveTerrain"] = Value::Null;
    }
    value
}

fn polygon(fence: &Fence) -> Value {
    let corner = |corner: &Geodetic| json!([corner.lat_deg, corner.lon_deg]);
    json!({ "inclusion": false, "polygon": fence.corners.iter().map(corner).collect::<Vec<_>>(), "version": 1 })
}

/// A rally point lies above the take-off place, at the height of transit.
fn rally(course: &Course, place: &Place) -> Value {
    json!([place.geodetic.lat_deg, place.geodetic.lon_deg, place.above_takeoff_m + course.transit_m])
}
