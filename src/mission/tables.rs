//! Tables of a plan: one row for each image, one for each waypoint. And what reconstruction software reads of it: names, places and angles of the images.

use super::pictures::{Attitude, Picture, pictures};
use crate::camera::pitch_rad;
use crate::frame::{Geodetic, LocalFrame};
use crate::quality::Which;
use crate::trajectory::plan::Plan;

/// One row for each image. Columns of degrees on the Earth are empty for a plan without georeference, those of the view for a panorama.
pub fn images(plan: &Plan, which: Which) -> Vec<u8> {
    let header = [
        "image",
        "camera",
        "time_s",
        "x_m",
        "y_m",
        "z_m",
        "lat_deg",
        "lon_deg",
        "alt_m",
        "direction_x",
        "direction_y",
        "direction_z",
        "up_x",
        "up_y",
        "up_z",
        "azimuth_deg",
        "pitch_deg",
        "fov_horizontal_deg",
        "fov_vertical_deg",
        "selected",
    ];
    let row = |picture: &Picture| {
        let image = picture.image;
        let camera = plan.cameras.get(image.camera as usize).map_or(String::new(), |camera| camera.name.clone());
        let mut fields = vec![picture.name.clone(), camera, format!("{:.4}", image.time_s)];
        fields.extend(image.position_m.iter().map(|value| format!("{value:.4}")));
        fields.extend(place_fields(picture.place.as_ref()));
        fields.extend(of_view(image.direction.map(|direction| [direction.x, direction.y, direction.z]), 9));
        fields.extend(of_view(image.direction.map(|_| [image.up.x, image.up.y, image.up.z]), 9));
        fields.extend(of_view(image.direction.map(|view| [azimuth_deg(view.x, view.y), pitch_rad(&view).to_degrees()]), 4));
        fields.extend(of_view(image.fov_deg, 4));
        fields.push(u8::from(image.selected).to_string());
        fields
    };
    table(header.map(str::to_owned).to_vec(), pictures(plan, which).iter().map(row))
}

/// One row for each waypoint.
pub fn waypoints(plan: &Plan) -> Vec<u8> {
    let frame = LocalFrame { origin: plan.scene.origin };
    let header = ["waypoint", "x_m", "y_m", "z_m", "lat_deg", "lon_deg", "alt_m", "azimuth_deg", "pitch_deg", "deviation_m"];
    let rows = plan.waypoints.iter().enumerate().map(|(index, waypoint)| {
        let mut fields = vec![index.to_string()];
        fields.extend(waypoint.position_m.iter().map(|value| format!("{value:.4}")));
        fields.extend(place_fields(frame.geodetic_from_local(&waypoint.position_m).as_ref()));
        fields.extend(of_view(waypoint.direction.map(|view| [azimuth_deg(view.x, view.y), pitch_rad(&view).to_degrees()]), 4));
        fields.push(format!("{:.4}", waypoint.deviation_m));
        fields
    });
    table(header.map(str::to_owned).to_vec(), rows)
}

/// RealityCapture's flight log (names, x, y, height, yaw, pitch, roll): longitude and latitude, or metres of the local frame without a georeference. Its first line
/// is a comment. Panoramas have no angles.
pub fn reality_capture(plan: &Plan, which: Which) -> Vec<u8> {
    prior(plan, which, "#name", ["x", "y", "alt"], ["yaw", "pitch", "roll"])
}

/// Metashape's reference: labels, longitude, latitude, height (or metres of the local frame), yaw, pitch, roll.
pub fn metashape(plan: &Plan, which: Which) -> Vec<u8> {
    let axes = if plan.scene.origin.is_some() { ["longitude", "latitude", "altitude"] } else { ["x", "y", "z"] };
    prior(plan, which, "label", axes, ["yaw", "pitch", "roll"])
}

fn prior(plan: &Plan, which: Which, name: &str, axes: [&str; 3], angles: [&str; 3]) -> Vec<u8> {
    let is_turned = plan.images.iter().all(|image| image.direction.is_some());
    let mut header = vec![name.to_owned()];
    header.extend(axes.map(str::to_owned));
    if is_turned {
        header.extend(angles.map(str::to_owned));
    }
    let row = |picture: &Picture| {
        let p = &picture.image.position_m;
        let mut fields = vec![picture.name.clone()];
        match &picture.place {
            Some(place) => {
                fields.extend([place.lon_deg, place.lat_deg].map(|value| format!("{value:.9}")));
                fields.push(format!("{:.4}", place.alt_m));
            }
            None => fields.extend(p.iter().map(|value| format!("{value:.4}"))),
        }
        if let Some(attitude) = Attitude::of(picture.image).filter(|_| is_turned) {
            // Adding zero turns what has been rounded to minus zero into zero.
            let rounded = |value: f64| (value * 1e4).round() / 1e4 + 0.0;
            fields
                .extend([attitude.yaw_deg, attitude.pitch_deg, attitude.roll_deg].map(|value| format!("{:.4}", rounded(value))));
        }
        fields
    };
    table(header, pictures(plan, which).iter().map(row))
}

fn azimuth_deg(x: f64, y: f64) -> f64 {
    libm::atan2(x, y).to_degrees().rem_euclid(360.0)
}

fn place_fields(place: Option<&Geodetic>) -> [String; 3] {
    match place {
        Some(place) => [format!("{:.9}", place.lat_deg), format!("{:.9}", place.lon_deg), format!("{:.4}", place.alt_m)],
        None => Default::default(),
    }
}

/// Numbers of a view; empty fields for a panorama.
fn of_view<const N: usize>(values: Option<[f64; N]>, digits: usize) -> Vec<String> {
    match values {
        Some(values) => values.iter().map(|value| format!("{value:.digits$}")).collect(),
        None => vec![String::new(); N],
    }
}

fn table(header: Vec<String>, rows: impl Iterator<Item = Vec<String>>) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for record in std::iter::once(header).chain(rows) {
        writer.write_record(&record).expect("memory takes everything, and rows are equally long");
    }
    writer.into_inner().expect("memory takes everything")
}
