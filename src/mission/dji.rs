//! DJI's WPML (`.kmz`) of one sortie: `wpmz/template.kml` for the planning app and `wpmz/waylines.wpml` for the aircraft. The aircraft flies heights above the take-off
//! place. Of heights above the ground the template says so and holds them, as the app does it that works them out with its own model of the surface; the wayline holds
//! what they come to over the ground of the scene. The mode in which an aircraft follows what its sensors see below (`realTimeFollowSurface`) would climb over
//! every roof and is not used.
//!
//! The aircraft passes rounded corners without a stop (continuity of curvature), turns nose and gimbal evenly along each leg, and takes images by distance. DJI
//! Fly ignores triggers by distance; Pilot 2 and the docks know them.

use std::io::{Cursor, Write};

use zip::write::SimpleFileOptions;

use super::course::{Altitudes, CameraMount, Course, Place, Sortie, Stop};
use super::xml::Element;

const KML: &str = "http://www.opengis.net/kml/2.2";
const WPML: &str = "http://www.dji.com/wpmz/1.0.2";
/// The fastest that a wayline may be flown, m/s.
const FASTEST_MPS: f64 = 15.0;
const SLOWEST_MPS: f64 = 0.1;
/// What height a safe take-off may have, m.
const TAKE_OFF_M: [f64; 2] = [1.2, 1500.0];
/// A smaller damping distance is a stop, m.
const LEAST_DAMPING_M: f64 = 0.2;
/// A leg is longer than what both of its corners take of it, by this share of it at least.
const MOST_OF_LEG: f64 = 0.495;
/// A trigger goes on over legs whose images are planned so far apart, as a share of its own distance.
const SAME_SPACING: [f64; 2] = [0.98, 1.18];

/// The fastest packing: the text repeats itself so much that more of it saves little.
const FAST: i64 = 1;

/// Which aircraft a rig stands for: its enumeration value and, where it has one, its kind, and the payload's.
struct Aircraft {
    drone: u32,
    sub: Option<u32>,
    payload: u32,
}

/// A waypoint of the wayline.
struct Point<'a> {
    place: &'a Place,
    stop: &'a Stop,
    /// 0 where the aircraft stops.
    damping_m: f64,
    speed_mps: f64,
    /// On the leg that follows.
    spacing_m: Option<f64>,
}

/// Whether DJI has a name for the rig's aircraft; others are written as a Mavic 3 Enterprise.
pub fn knows(rig: &str) -> bool {
    matches!(rig, "mavic3e" | "m300-oblique")
}

/// The file's content. `made_ms` is when the plan was made, in milliseconds since 1970.
pub fn to_bytes(course: &Course, sortie: &Sortie, made_ms: u64) -> Vec<u8> {
    let points = points(course, sortie);
    let groups = groups(course, &points);
    let files = [
        ("wpmz/template.kml", template(course, &points, &groups, made_ms)),
        ("wpmz/waylines.wpml", waylines(course, sortie, &points, &groups)),
    ];
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in files {
        let options =
            SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated).compression_level(Some(FAST));
        let written = archive.start_file(name, options).map(|()| archive.write_all(&content.to_bytes()));
        written.expect("two short names").expect("memory takes everything");
    }
    archive.finish().expect("memory takes everything").into_inner()
}

/// Down to the first stop, along the sortie, up from the last one.
fn points<'a>(course: &Course, sortie: &'a Sortie) -> Vec<Point<'a>> {
    let stops = &sortie.stops;
    let still = |place: &'a Place, stop: &'a Stop| Point {
        place,
        stop,
        damping_m: 0.0,
        speed_mps: bounded(course.cruise_mps),
        spacing_m: None,
    };
    let apart_m = |k: usize| (stops[k + 1].at.position_m - stops[k].at.position_m).norm();
    let point = |(k, stop): (usize, &'a Stop)| {
        let is_inner = 0 < k && k + 1 < stops.len();
        let most_m = if is_inner { MOST_OF_LEG * apart_m(k - 1).min(apart_m(k)) } else { 0.0 };
        let damping_m = stop.cut_m.min(most_m);
        Point {
            place: &stop.at,
            stop,
            damping_m: if damping_m >= LEAST_DAMPING_M { damping_m } else { 0.0 },
            speed_mps: bounded(stop.speed_mps),
            spacing_m: stop.spacing_m,
        }
    };
    let out = sortie.out.iter().map(|place| still(place, &stops[0]));
    let back = sortie.back.iter().map(|place| still(place, &stops[stops.len() - 1]));
    out.chain(stops.iter().enumerate().map(point)).chain(back).collect()
}

fn bounded(speed_mps: f64) -> f64 {
    speed_mps.clamp(SLOWEST_MPS, FASTEST_MPS)
}

fn kml(document: Element) -> Element {
    Element::new("kml").attribute("xmlns", KML).attribute("xmlns:wpml", WPML).with(document)
}

fn template(course: &Course, points: &[Point], groups: &[(usize, Element)], made_ms: u64) -> Element {
    let is_above_ground = course.altitudes == Altitudes::Terrain;
    let coordinates = Element::new("wpml:waylineCoordinateSysParam")
        .with_value("wpml:coordinateMode", "WGS84")
        .with_value("wpml:heightMode", if is_above_ground { "aboveGroundLevel" } else { "relativeToStartPoint" });
    let folder = Element::new("Folder")
        .with_value("wpml:templateType", "waypoint")
        .with_value("wpml:templateId", 0)
        .with(coordinates)
        .with_value("wpml:autoFlightSpeed", decimal(bounded(course.cruise_mps)))
        .with_value("wpml:globalHeight", decimal(course.transit_m))
        .with_value("wpml:gimbalPitchMode", "usePointSetting")
        .with(heading(course, None, "wpml:globalWaypointHeadingParam"))
        .with_value("wpml:globalWaypointTurnMode", "toPointAndPassWithContinuityCurvature")
        .with_value("wpml:globalUseStraightLine", 1)
        .with_all(points.iter().enumerate().map(|(index, point)| {
            let height = decimal(if is_above_ground { point.place.above_ground_m } else { point.place.above_takeoff_m });
            let place = placemark(index, point)
                .with_value("wpml:ellipsoidHeight", &height)
                .with_value("wpml:height", &height)
                .with_value("wpml:useGlobalHeight", 0)
                .with_value("wpml:useGlobalSpeed", 0)
                .with_value("wpml:waypointSpeed", decimal(point.speed_mps))
                .with_value("wpml:useGlobalHeadingParam", 0)
                .with(heading(course, Some(point), "wpml:waypointHeadingParam"))
                .with_value("wpml:useGlobalTurnParam", 0)
                .with(turn(point))
                .with_value("wpml:useStraightLine", 1);
            let pitch = point.stop.gimbal_pitch_deg.map(|pitch_deg| Element::value("wpml:gimbalPitchAngle", decimal(pitch_deg)));
            place.with_all(pitch).with_all(groups_at(groups, index))
        }));
    let document = Element::new("Document")
        .with_value("wpml:author", "overfly")
        .with_value("wpml:createTime", made_ms)
        .with_value("wpml:updateTime", made_ms)
        .with(configuration(course))
        .with(folder);
    kml(document)
}

fn waylines(course: &Course, sortie: &Sortie, points: &[Point], groups: &[(usize, Element)]) -> Element {
    let lengths = points.windows(2).map(|pair| (pair[1].place.position_m - pair[0].place.position_m).norm());
    let folder = Element::new("Folder")
        .with_value("wpml:templateId", 0)
        .with_value("wpml:executeHeightMode", "relativeToStartPoint")
        .with_value("wpml:waylineId", 0)
        .with_value("wpml:distance", decimal(lengths.sum()))
        .with_value("wpml:duration", decimal(sortie.duration_s))
        .with_value("wpml:autoFlightSpeed", decimal(bounded(course.cruise_mps)))
        .with_all(points.iter().enumerate().map(|(index, point)| {
            placemark(index, point)
                .with_value("wpml:executeHeight", decimal(point.place.above_takeoff_m))
                .with_value("wpml:waypointSpeed", decimal(point.speed_mps))
                .with(heading(course, Some(point), "wpml:waypointHeadingParam"))
                .with(turn(point))
                .with_value("wpml:useStraightLine", 1)
                .with_all(groups_at(groups, index))
        }));
    kml(Element::new("Document").with(configuration(course)).with(folder))
}

fn configuration(course: &Course) -> Element {
    let aircraft = match course.rig.as_str() {
        "m300-oblique" => Aircraft { drone: 60, sub: None, payload: 65_534 },
        _ => Aircraft { drone: 77, sub: Some(0), payload: 66 },
    };
    let sub = aircraft.sub.map(|sub| Element::value("wpml:droneSubEnumValue", sub));
    Element::new("wpml:missionConfig")
        .with_value("wpml:flyToWaylineMode", "safely")
        .with_value("wpml:finishAction", "goHome")
        .with_value("wpml:exitOnRCLost", "executeLostAction")
        .with_value("wpml:executeRCLostAction", "goBack")
        .with_value("wpml:takeOffSecurityHeight", decimal(course.transit_m.clamp(TAKE_OFF_M[0], TAKE_OFF_M[1])))
        .with_value("wpml:globalTransitionalSpeed", decimal(bounded(course.cruise_mps)))
        .with_value("wpml:globalRTHHeight", decimal(course.transit_m))
        .with(Element::new("wpml:droneInfo").with_value("wpml:droneEnumValue", aircraft.drone).with_all(sub))
        .with(
            Element::new("wpml:payloadInfo")
                .with_value("wpml:payloadEnumValue", aircraft.payload)
                .with_value("wpml:payloadPositionIndex", 0),
        )
}

fn placemark(index: usize, point: &Point) -> Element {
    let place = &point.place.geodetic;
    let coordinates = format!("{:.9},{:.9}", place.lon_deg, place.lat_deg);
    Element::new("Placemark").with(Element::new("Point").with_value("coordinates", coordinates)).with_value("wpml:index", index)
}

/// A camera on a gimbal is turned by the nose, evenly from one waypoint to the next; others follow the course.
fn heading(course: &Course, point: Option<&Point>, name: &'static str) -> Element {
    match point.filter(|_| course.mount == CameraMount::Gimbal) {
        Some(point) => {
            let angle_deg = (point.stop.heading_deg + 180.0).rem_euclid(360.0) - 180.0;
            Element::new(name)
                .with_value("wpml:waypointHeadingMode", "smoothTransition")
                .with_value("wpml:waypointHeadingAngle", decimal(angle_deg))
                .with_value("wpml:waypointHeadingPathMode", "followBadArc")
        }
        None => Element::new(name)
            .with_value("wpml:waypointHeadingMode", "followWayline")
            .with_value("wpml:waypointHeadingPathMode", "followBadArc"),
    }
}

fn turn(point: &Point) -> Element {
    let param = Element::new("wpml:waypointTurnParam");
    if point.damping_m > 0.0 {
        let damping = format!("{:.3}", (point.damping_m * 1000.0).floor() / 1000.0);
        return param
            .with_value("wpml:waypointTurnMode", "toPointAndPassWithContinuityCurvature")
            .with_value("wpml:waypointTurnDampingDist", damping);
    }
    param.with_value("wpml:waypointTurnMode", "toPointAndStopWithDiscontinuityCurvature")
}

/// The action groups that begin at a waypoint; their numbers follow each other.
fn groups_at<'a>(groups: &'a [(usize, Element)], index: usize) -> impl Iterator<Item = Element> + 'a {
    let first = groups.partition_point(|(at, _)| *at < index);
    groups[first..].iter().take_while(move |(at, _)| *at == index).map(|(_, group)| group.clone())
}

/// All action groups, by the waypoints at which they begin.
fn groups(course: &Course, points: &[Point]) -> Vec<(usize, Element)> {
    let mut groups: Vec<(usize, usize, Element)> = Vec::new();
    if course.mount == CameraMount::Gimbal {
        groups.extend(pitches(points));
    }
    groups.extend(photographs(points));
    groups.sort_by_key(|(from, ..)| *from);
    let numbered = groups.into_iter().enumerate();
    numbered.map(|(id, (from, to, content))| (from, group(id, from, to, content))).collect()
}

fn group(id: usize, from: usize, to: usize, content: Element) -> Element {
    let mut group = Element::new("wpml:actionGroup")
        .with_value("wpml:actionGroupId", id)
        .with_value("wpml:actionGroupStartIndex", from)
        .with_value("wpml:actionGroupEndIndex", to)
        .with_value("wpml:actionGroupMode", "sequence");
    group = group.with_all(content.into_children());
    group
}

/// The gimbal's pitch: set where the wayline begins, then turned evenly along each leg.
fn pitches(points: &[Point]) -> Vec<(usize, usize, Element)> {
    let pitch = |point: &Point| point.stop.gimbal_pitch_deg.unwrap_or(0.0);
    let first = Element::new("wpml:actionActuatorFuncParam")
        .with_value("wpml:gimbalHeadingYawBase", "north")
        .with_value("wpml:gimbalRotateMode", "absoluteAngle")
        .with_value("wpml:gimbalPitchRotateEnable", 1)
        .with_value("wpml:gimbalPitchRotateAngle", decimal(pitch(&points[0])))
        .with_value("wpml:gimbalRollRotateEnable", 0)
        .with_value("wpml:gimbalRollRotateAngle", 0)
        .with_value("wpml:gimbalYawRotateEnable", 0)
        .with_value("wpml:gimbalYawRotateAngle", 0)
        .with_value("wpml:gimbalRotateTimeEnable", 0)
        .with_value("wpml:gimbalRotateTime", 0)
        .with_value("wpml:payloadPositionIndex", 0);
    let mut groups = vec![(0, 0, content(trigger("reachPoint", None), "gimbalRotate", first))];
    for (index, pair) in points.windows(2).enumerate() {
        if (pitch(&pair[1]) - pitch(&pair[0])).abs() < 0.05 {
            continue;
        }
        let param = Element::new("wpml:actionActuatorFuncParam")
            .with_value("wpml:gimbalPitchRotateAngle", decimal(pitch(&pair[1])))
            .with_value("wpml:payloadPositionIndex", 0);
        let even = content(trigger("betweenAdjacentPoints", None), "gimbalEvenlyRotate", param);
        groups.push((index, index + 1, even));
    }
    groups
}

/// Images by distance: one group for legs that follow each other with the same way between their images.
fn photographs(points: &[Point]) -> Vec<(usize, usize, Element)> {
    let mut runs: Vec<(usize, usize, f64)> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        let Some(spacing_m) = point.spacing_m else { continue };
        match runs.last_mut() {
            Some((_, to, set_m))
                if *to == index && (SAME_SPACING[0] * *set_m..=SAME_SPACING[1] * *set_m).contains(&spacing_m) =>
            {
                *to = index + 1;
            }
            _ => runs.push((index, index + 1, spacing_m)),
        }
    }
    let photograph = |(from, to, spacing_m): (usize, usize, f64)| {
        let param = Element::new("wpml:actionActuatorFuncParam")
            .with_value("wpml:payloadPositionIndex", 0)
            .with_value("wpml:useGlobalPayloadLensIndex", 0);
        (from, to, content(trigger("multipleDistance", Some(spacing_m)), "takePhoto", param))
    };
    runs.into_iter().map(photograph).collect()
}

fn trigger(kind: &'static str, param: Option<f64>) -> Element {
    let param = param.map(|param| Element::value("wpml:actionTriggerParam", decimal(param)));
    Element::new("wpml:actionTrigger").with_value("wpml:actionTriggerType", kind).with_all(param)
}

/// What a group holds beside its numbers: its trigger and its only action.
fn content(trigger: Element, function: &'static str, param: Element) -> Element {
    let action =
        Element::new("wpml:action").with_value("wpml:actionId", 0).with_value("wpml:actionActuatorFunc", function).with(param);
    Element::new("content").with(trigger).with(action)
}

/// Lengths, speeds and angles to a thousandth.
fn decimal(value: f64) -> String {
    format!("{value:.3}")
}
