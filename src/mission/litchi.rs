//! Litchi's mission CSV: one sortie, heights above the take-off place or, for the waypoints, above the ground, which Litchi takes from its own elevation data for each
//! waypoint; between two of them the aircraft flies straight. Images are taken by distance, since actions may not be carried out where a corner is rounded; the
//! aircraft comes home by its own return, from above everything.

use super::course::{Altitudes, CameraMount, Course, Place, Sortie, Stop};

/// Actions that a row has room for.
const ACTIONS: usize = 15;
/// Litchi's word for "none" and "off".
const OFF: &str = "-1";
const GIMBAL_OFF: &str = "0";
const ABOVE_TAKEOFF: &str = "0";
const ABOVE_GROUND: &str = "1";
const GIMBAL_INTERPOLATE: &str = "2";
/// More waypoints than some aircraft hold.
pub const MANY_WAYPOINTS: usize = 99;

/// The file's content.
pub fn to_bytes(course: &Course, sortie: &Sortie) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut put = |record: Vec<String>| writer.write_record(&record).expect("memory takes everything, and rows are equally long");
    put(header());
    let stops = &sortie.stops;
    let (first, last) = (&stops[0], &stops[stops.len() - 1]);
    sortie.out.iter().for_each(|place| put(row(course, &above(place, first, course), Altitudes::Relative)));
    stops.iter().for_each(|stop| put(row(course, stop, course.altitudes)));
    sortie.back.iter().for_each(|place| put(row(course, &above(place, last, course), Altitudes::Relative)));
    writer.into_inner().expect("memory takes everything")
}

/// A place on the way to the first or from the last stop, where no images are taken.
fn above(place: &Place, stop: &Stop, course: &Course) -> Stop {
    let speed_mps = course.cruise_mps;
    Stop { at: *place, deviation_m: 0.0, cut_m: 0.0, exposures: 0, spacing_m: None, speed_mps, ..stop.clone() }
}

fn header() -> Vec<String> {
    let mut names: Vec<String> =
        ["latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode", "gimbalpitchangle"]
            .map(str::to_owned)
            .to_vec();
    names.extend((1..=ACTIONS).flat_map(|k| [format!("actiontype{k}"), format!("actionparam{k}")]));
    names.extend(
        [
            "altitudemode",
            "speed(m/s)",
            "poi_latitude",
            "poi_longitude",
            "poi_altitude(m)",
            "poi_altitudemode",
            "photo_timeinterval",
            "photo_distinterval",
        ]
        .map(str::to_owned),
    );
    names
}

fn row(course: &Course, stop: &Stop, altitudes: Altitudes) -> Vec<String> {
    let has_gimbal = course.mount == CameraMount::Gimbal;
    let (height_m, altitude_mode) = match altitudes {
        Altitudes::Terrain => (stop.at.above_ground_m, ABOVE_GROUND),
        Altitudes::Relative | Altitudes::Absolute => (stop.at.above_takeoff_m, ABOVE_TAKEOFF),
    };
    let mut fields = vec![
        format!("{:.9}", stop.at.geodetic.lat_deg),
        format!("{:.9}", stop.at.geodetic.lon_deg),
        format!("{height_m:.3}"),
        format!("{:.2}", stop.heading_deg),
        format!("{:.2}", floored(stop.cut_m)),
        "0".to_owned(),
        (if has_gimbal { GIMBAL_INTERPOLATE } else { GIMBAL_OFF }).to_owned(),
        format!("{:.2}", stop.gimbal_pitch_deg.unwrap_or(0.0)),
    ];
    fields.extend((0..ACTIONS).flat_map(|_| [OFF.to_owned(), "0".to_owned()]));
    let spacing = stop.spacing_m.map_or(OFF.to_owned(), |spacing_m| format!("{spacing_m:.2}"));
    let speed = format!("{:.2}", stop.speed_mps.max(0.1));
    fields.extend([altitude_mode.to_owned(), speed]);
    fields.extend(["0", "0", "0", "0", OFF].map(str::to_owned));
    fields.push(spacing);
    fields
}

/// Two corners may not take more of a leg than there is of it.
fn floored(cut_m: f64) -> f64 {
    (cut_m * 100.0).floor() / 100.0
}
