//! KML of a plan for Google Earth and the like: the curve that is flown, its waypoints, its images. Heights are absolute, or those above the ground of the scene,
//! which a viewer counts from its own; without a scene the ground is the plane z = 0.

use nalgebra::Point3;

use super::course::{Altitudes, Ground};
use super::pictures::{Picture, pictures};
use super::xml::Element;
use crate::camera::pitch_rad;
use crate::frame::{Geodetic, LocalFrame};
use crate::quality::Which;
use crate::trajectory::plan::{Image, Plan, Waypoint};

/// The file's content; `None` for a plan without georeference.
pub fn to_bytes(plan: &Plan, which: Which, altitudes: Altitudes, ground: Ground) -> Option<Vec<u8>> {
    let frame = LocalFrame { origin: plan.scene.origin };
    let origin = frame.origin?;
    let above_ground_m = |at: &Point3<f64>| at.z - ground.height_m(at.x, at.y);
    let coordinates = |at: &Point3<f64>, place: &Geodetic| {
        let height_m = match altitudes {
            Altitudes::Relative | Altitudes::Terrain => above_ground_m(at),
            Altitudes::Absolute => place.alt_m,
        };
        format!("{:.9},{:.9},{height_m:.3}", place.lon_deg, place.lat_deg)
    };
    let mode = match altitudes {
        Altitudes::Relative | Altitudes::Terrain => "relativeToGround",
        Altitudes::Absolute => "absolute",
    };
    let of_point = |at: &Point3<f64>| coordinates(at, &frame.geodetic_from_local(at).unwrap_or(origin));
    let line: Vec<String> = flown_over(plan, ground).iter().map(of_point).collect();
    let line = Element::new("LineString").with_value("altitudeMode", mode).with_value("coordinates", line.join(" "));
    let point = |at: String| Element::new("Point").with_value("altitudeMode", mode).with_value("coordinates", at);
    let waypoint = |(index, waypoint): (usize, &Waypoint)| {
        let at = &waypoint.position_m;
        let text = waypoint_text(waypoint, above_ground_m(at));
        placemark(&format!("waypoint {index}"), &text, "#waypoint", point(of_point(at)))
    };
    let picture = |picture: &Picture| {
        let at = &picture.image.position_m;
        let text = image_text(picture.image, above_ground_m(at));
        placemark(&picture.name, &text, "#image", point(coordinates(at, &picture.place.unwrap_or(origin))))
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

/// Points of the curve that is flown, and of its legs where the ground makes a line that follows it leave them.
fn flown_over(plan: &Plan, ground: Ground) -> Vec<Point3<f64>> {
    let points: Vec<Point3<f64>> = plan.flown_points().into_iter().map(|(point, _)| point).collect();
    let with_relief =
        |ends: &[Point3<f64>]| ground.relief(&ends[0], &ends[1]).into_iter().chain([ends[1]]).collect::<Vec<Point3<f64>>>();
    points.first().copied().into_iter().chain(points.windows(2).flat_map(with_relief)).collect()
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

fn waypoint_text(waypoint: &Waypoint, above_ground_m: f64) -> String {
    let view = waypoint.direction.map_or(String::new(), |view| format!(", {}", view_text(&view)));
    format!("{above_ground_m:.1} m above the ground{view}, corner rounded by up to {:.2} m", waypoint.deviation_m)
}

fn image_text(image: &Image, above_ground_m: f64) -> String {
    let view = image.direction.map_or("panorama".to_owned(), |view| view_text(&view));
    format!("{:.1} s, {above_ground_m:.1} m above the ground, {view}", image.time_s)
}

fn view_text(view: &nalgebra::Unit<nalgebra::Vector3<f64>>) -> String {
    let azimuth_deg = libm::atan2(view.x, view.y).to_degrees().rem_euclid(360.0);
    format!("azimuth {azimuth_deg:.0} degrees, pitch {:.0} degrees", pitch_rad(view).to_degrees())
}
