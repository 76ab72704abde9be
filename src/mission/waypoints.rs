//! ArduPilot's and Mission Planner's `.waypoints`: one sortie, its take-off place first.

use super::course::{Course, Sortie};
use super::mav_items::{Autopilot, FRAME_ABSOLUTE, MavItem, WAYPOINT, items};

const HEADER: &str = "QGC WPL 110";

/// The file's content: fields between tabs, numbers with eight decimals, zero for what is left to the autopilot.
pub fn to_bytes(course: &Course, sortie: &Sortie) -> Vec<u8> {
    let home = &course.home.geodetic;
    let home = MavItem {
        command: WAYPOINT,
        frame: FRAME_ABSOLUTE,
        params: [0.0; 4],
        lat_deg: home.lat_deg,
        lon_deg: home.lon_deg,
        alt_m: home.alt_m,
        waypoint: None,
    };
    let mut text = format!("{HEADER}\n");
    for (index, item) in std::iter::once(home).chain(items(course, sortie, Autopilot::ArduPilot)).enumerate() {
        text.push_str(&row(index, &item));
    }
    text.into_bytes()
}

fn row(index: usize, item: &MavItem) -> String {
    let MavItem { command, frame, params, lat_deg, lon_deg, alt_m, .. } = item;
    let [p1, p2, p3, p4] = params.map(|value| if value.is_nan() { 0.0 } else { value });
    let current = u8::from(index == 0);
    format!(
        "{index}\t{current}\t{frame}\t{command}\t{p1:.8}\t{p2:.8}\t{p3:.8}\t{p4:.8}\t{lat_deg:.8}\t{lon_deg:.8}\t{alt_m:.8}\t1\n"
    )
}
