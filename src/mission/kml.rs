//! KML of a plan for Google Earth and the like: the curve that is flown, its waypoints, its images. Heights are above the ground, which the plan takes for flat, or
//! absolute.

use super::course::Altitudes;
use super::pictures::{Picture, pictures};
use super::xml::Element;
use crate::camera::pitch_rad;
use crate::frame::{Geodetic, LocalFrame};
use crate::quality::Which;
use crate::trajectory::plan::{Image, Plan, Waypoint};

/// The file's content; `None` for a plan without georeference.
pub fn to_bytes(plan: &Plan, which: Which, altitudes: Altitudes) -> Option<Vec<u8>> {
    let frame = LocalFrame { origin: plan.scene.origin };
    let origin = frame.origin?;
    let coordinates = |place: &Geodetic| {
        let height_m = match altitudes {
            Altitudes::Relative => place.alt_m - origin.alt_m,
            Altitudes::Absolute => place.alt_m,
        };
        format!("{:.9},{:.9},{height_m:.3}", place.lon_deg, place.lat_deg)
    };
    let mode = match altitudes {
        Altitudes::Relative => "relativeToGround",
        Altitudes::Absolute => "absolute",
    };
    let line: Option<Vec<String>> =
        plan.flown_points().iter().map(|(point, _)| frame.geodetic_from_local(point).map(|place| coordinates(&place))).collect();
    let line = Element::new("LineString").with_value("altitudeMode", mode).with_value("coordinates", line?.join(" "));
    let point =
        |place: &Geodetic| Element::new("Point").with_value("altitudeMode", mode).with_value("coordinates", coordinates(place));
    let waypoint = |(index, waypoint): (usize, &Waypoint)| {
        let place = frame.geodetic_from_local(&waypoint.position_m).unwrap_or(origin);
        placemark(&format!("waypoint {index}"), &waypoint_text(waypoint), "#waypoint", point(&place))
    };
    let picture = |picture: &Picture| {
        placemark(&picture.name, &image_text(picture.image), "#image", point(&picture.place.unwrap_or(origin)))
    };
    let document = Element::new("Document")
        .with_value("name", &plan.scene.name)
        .with(style_line())
        .with(style_icon("waypoint", "ff2a2ac8", "0.7"))
        .with(style_icon("image", "ff7a6a10", "0.35"))
        .with(placemark("path", &format!("{:.0} m", plan.metrics.length_m), "#path", line))
        .with(Element::new("Folder").with_value("name", "waypoints").with_all(plan.waypoints.iter().enumerate().map(waypoint)))
        .with(
            Element::new("Folder")
                .with_value("name", "images")
                .with_value("visibility", 0)
                .with_all(pictures(plan, which).iter().map(picture)),
        );
    Some(Element::new("kml").attribute("xmlns", "http://www.opengis.net/kml/2.2").with(document).to_bytes())
}

fn placemark(name: &str, description: &str, style: &str, geometry: Element) -> Element {
    Element::new("Placemark")
        .with_value("name", name)
        .with_value("description", description)
        .with_value("styleUrl", style)
        .with(geometry)
}

fn style_line() -> Element {
    let line = Element::new("LineStyle").with_value("color", "ffc83296").with_value("width", 2);
    Element::new("Style").attribute("id", "path").with(line)
}

/// Colours are alpha, blue, green, red.
fn style_icon(id: &'static str, colour: &'static str, scale: &'static str) -> Element {
    let icon = Element::new("IconStyle").with_value("color", colour).with_value("scale", scale);
    let label = Element::new("LabelStyle").with_value("scale", 0);
    Element::new("Style").attribute("id", id).with(icon).with(label)
}

fn waypoint_text(waypoint: &Waypoint) -> String {
    let p = &waypoint.position_m;
    let view = waypoint.direction.map_or(String::new(), |view| format!(", {}", view_text(&view)));
    format!("{:.1} m above the ground{view}, corner rounded by up to {:.2} m", p.z, waypoint.deviation_m)
}

fn image_text(image: &Image) -> String {
    let view = image.direction.map_or("panorama".to_owned(), |view| view_text(&view));
    format!("{:.1} s, {:.1} m above the ground, {view}", image.time_s, image.position_m.z)
}

fn view_text(view: &nalgebra::Unit<nalgebra::Vector3<f64>>) -> String {
    let azimuth_deg = libm::atan2(view.x, view.y).to_degrees().rem_euclid(360.0);
    format!("azimuth {azimuth_deg:.0} degrees, pitch {:.0} degrees", pitch_rad(view).to_degrees())
}
