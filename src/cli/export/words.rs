//! What `overfly export` says of the missions that it has written.

use serde_json::{Value, json};

use super::name;
use crate::cli::answer;
use crate::cli::arguments::Format;
use crate::mission::course::{Altitudes, CameraMount, Course, Sortie};
use crate::mission::mav_items::{self, Autopilot};
use crate::mission::{dji, litchi};

/// What a reader of a mission file has to know of its format.
pub fn remarks(format: Format, course: &Course) -> Vec<String> {
    let mut remarks = Vec::new();
    let is_absolute = course.altitudes == Altitudes::Absolute;
    let longest = course.sorties.iter().map(|sortie| sortie.stops.len() + 2).max().unwrap_or(0);
    match format {
        Format::Ardupilot => {
            let items = |sortie: &Sortie| mav_items::items(course, sortie, Autopilot::ArduPilot).len();
            let most = course.sorties.iter().map(items).max().unwrap_or(0);
            if most > mav_items::MANY_ITEMS {
                remarks.push(format!(
                    "a sortie has {most} mission items, and many ArduPilot boards without an SD card hold about {}; shorter sorties have fewer (`--sortie-time`)",
                    mav_items::MANY_ITEMS
                ));
            }
        }
        Format::Dji if !dji::knows(&course.rig) => remarks.push(format!(
            "DJI's WPML has no name for the aircraft of the rig {:?}: the file says Mavic 3 Enterprise; choose your own in Pilot 2",
            course.rig
        )),
        Format::Litchi if longest > litchi::MANY_WAYPOINTS => remarks.push(format!(
            "a sortie has {longest} waypoints, and for many aircraft Litchi takes {}; shorter sorties have fewer (`--sortie-time`)",
            litchi::MANY_WAYPOINTS
        )),
        _ => {}
    }
    if is_absolute && matches!(format, Format::Dji | Format::Litchi) {
        remarks.push(format!("the heights of {} files are above the take-off place always", name(format)));
    }
    if course.altitudes == Altitudes::Terrain && format == Format::Dji {
        remarks.push(
            "DJI's aircraft fly heights above the take-off place, worked out over the scene's ground; those above the ground are in the template, for \
             Pilot 2: when it saves the mission anew, it takes them above its own model of the surface"
                .to_owned(),
        );
    }
    if course.mount == CameraMount::Fixed && matches!(format, Format::Dji | Format::Litchi) {
        remarks.push(format!("{} files trigger one camera; the others of the rig have to follow it", name(format)));
    }
    remarks
}

fn ends(sortie: &Sortie) -> [usize; 2] {
    let waypoint = |index: usize| sortie.stops.get(index).map_or(0, |stop| stop.waypoint);
    [waypoint(0), waypoint(sortie.stops.len().saturating_sub(1))]
}

fn exposures(sortie: &Sortie) -> usize {
    sortie.stops.iter().map(|stop| stop.exposures).sum()
}

pub fn sorties_table(course: &Course) -> String {
    let header = ["sortie", "waypoints", "exposures", "time, s", "battery, %"].map(str::to_owned).to_vec();
    let row = |sortie: &Sortie| {
        let [first, last] = ends(sortie);
        vec![
            sortie.number.to_string(),
            format!("{first}-{last}"),
            exposures(sortie).to_string(),
            format!("{:.0}", sortie.duration_s),
            sortie.battery_percent.map_or("-".to_owned(), |percent| format!("{percent:.0}")),
        ]
    };
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(course.sorties.iter().map(row)).collect();
    answer::table(&rows)
}

pub fn sortie_json(sortie: &Sortie) -> Value {
    let [first, last] = ends(sortie);
    json!({
        "number": sortie.number,
        "first_waypoint": first,
        "last_waypoint": last,
        "exposures": exposures(sortie),
        "duration_s": sortie.duration_s,
        "battery_percent": sortie.battery_percent,
    })
}
