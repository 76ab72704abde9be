//! What every file of a mission has to keep, whatever the plan.

use std::io::{Cursor, Read};
use std::time::Instant;

use proptest::prelude::*;
use roxmltree::{Document, Node};
use serde_json::Value;

use super::course::{Altitudes, Course, CourseError, CourseOptions, Ground};
use super::fixture::{over_a_hill, plan, rough_corners};
use super::mav_items::{self, Autopilot};
use super::{colmap, dji, footprints, geojson, kml, litchi, qgc, tables, waypoints};
use crate::quality::Which;
use crate::scene::free_space::FreeSpace;
use crate::settings::Settings;
use crate::trajectory::plan::Plan;

const RIGS: [&str; 4] = ["panoramic", "m300-oblique", "phantom4-rtk", "mavic3e"];

fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap()
}

fn unpacked(kmz: Vec<u8>, name: &str) -> String {
    let mut content = String::new();
    zip::ZipArchive::new(Cursor::new(kmz)).unwrap().by_name(name).unwrap().read_to_string(&mut content).unwrap();
    content
}

/// The text of the first element of that name within another one.
fn value<'a>(node: &Node<'a, '_>, name: &str) -> Option<&'a str> {
    node.descendants().find(|node| node.tag_name().name() == name).and_then(|node| node.text())
}

fn number(node: &Node, name: &str) -> f64 {
    value(node, name).and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("no number {name}"))
}

/// A plan of some rig over a rough path, and its course; `None` where no sortie is long enough.
fn course(corners: &[[f64; 3]], rig: usize, sortie_s: Option<f64>) -> Option<(Plan, Course)> {
    let plan = plan(RIGS[rig], corners);
    match Course::new(&plan, None, &CourseOptions { sortie_s, ..CourseOptions::default() }) {
        Ok(course) => Some((plan, course)),
        Err(CourseError::SortieTooShort { .. }) => None,
        Err(other) => panic!("{other}"),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn waylines_count_from_zero_and_leave_room_for_their_corners(
        corners in rough_corners(0..40), rig in 0usize..4, sortie_s in prop::option::of(300.0..900.0f64),
    ) {
        let Some((_, course)) = course(&corners, rig, sortie_s) else { return Ok(()) };
        for sortie in &course.sorties {
            let kmz = dji::to_bytes(&course, sortie, 1_700_000_000_000);
            let waylines = unpacked(kmz.clone(), "wpmz/waylines.wpml");
            let template = unpacked(kmz, "wpmz/template.kml");
            let (waylines, template) = (Document::parse(&waylines).unwrap(), Document::parse(&template).unwrap());
            fn placemarks<'a>(document: &'a Document) -> Vec<Node<'a, 'a>> {
                document.descendants().filter(|node| node.tag_name().name() == "Placemark").collect()
            }
            let marks = placemarks(&waylines);
            prop_assert_eq!(marks.len(), sortie.stops.len() + 2);
            prop_assert_eq!(placemarks(&template).len(), marks.len());
            let places: Vec<_> = sortie.out.iter().chain(sortie.stops.iter().map(|stop| &stop.at)).chain(&sortie.back).collect();
            let damping_m = |k: usize| value(&marks[k], "waypointTurnDampingDist").map_or(0.0, |text| text.parse::<f64>().unwrap());
            let mut groups = 0;
            for (k, mark) in marks.iter().enumerate() {
                prop_assert_eq!(number(mark, "index"), k as f64);
                prop_assert!((number(mark, "executeHeight") - places[k].above_takeoff_m).abs() < 1e-3);
                prop_assert!((0.1..=15.0).contains(&number(mark, "waypointSpeed")));
                prop_assert_eq!(damping_m(k) > 0.0, value(mark, "waypointTurnMode") == Some("toPointAndPassWithContinuityCurvature"));
                if k > 0 {
                    let leg_m = (places[k].position_m - places[k - 1].position_m).norm();
                    prop_assert!(damping_m(k - 1) + damping_m(k) < leg_m, "{} and {} m on {} m", damping_m(k - 1), damping_m(k), leg_m);
                }
                for group in mark.children().filter(|node| node.tag_name().name() == "actionGroup") {
                    prop_assert_eq!(number(&group, "actionGroupId"), f64::from(groups));
                    groups += 1;
                    let [from, to] = ["actionGroupStartIndex", "actionGroupEndIndex"].map(|name| number(&group, name) as usize);
                    prop_assert!(from == k && from <= to && to < marks.len());
                }
            }
            let has = |word: &str| marks.iter().any(|mark| value(mark, "actionActuatorFunc") == Some(word));
            prop_assert_eq!(has("gimbalRotate"), rig >= 2);
        }
    }

    #[test]
    fn every_sortie_sets_what_it_needs_and_no_file_holds_what_is_no_number(
        corners in rough_corners(0..40), rig in 0usize..4, sortie_s in prop::option::of(300.0..900.0f64), is_ardupilot: bool,
    ) {
        let Some((plan, course)) = course(&corners, rig, sortie_s) else { return Ok(()) };
        let autopilot = if is_ardupilot { Autopilot::ArduPilot } else { Autopilot::Px4 };
        for sortie in &course.sorties {
            let rows = text(waypoints::to_bytes(&course, sortie));
            prop_assert!(rows.starts_with("QGC WPL 110\n") && !rows.contains("NaN") && !rows.contains("inf"));
            for (index, row) in rows.lines().skip(1).enumerate() {
                let fields: Vec<&str> = row.split('\t').collect();
                let (number, current) = (index.to_string(), if index == 0 { "1" } else { "0" });
                prop_assert_eq!((fields.len(), fields[0], fields[1]), (12, number.as_str(), current));
                prop_assert!(fields[8..10].iter().all(|field| field.split('.').nth(1).is_some_and(|decimals| decimals.len() >= 8)));
            }
            let file: Value = serde_json::from_slice(&qgc::to_bytes(&course, sortie, autopilot)).unwrap();
            let items = file["mission"]["items"].as_array().unwrap();
            let first = |command: u64| items.iter().position(|item| item["command"] == command).unwrap_or(usize::MAX);
            prop_assert!(items.iter().enumerate().all(|(index, item)| item["doJumpId"] == index + 1 && item["params"].as_array().unwrap().len() == 7));
            prop_assert!(first(178) < first(16) && first(206) < items.len());
            let has_exposures = sortie.stops.iter().any(|stop| stop.exposures > 0);
            prop_assert_eq!(items[first(206)]["params"][0].as_f64() > Some(0.0), has_exposures);
            prop_assert!(items.iter().all(|item| !item["params"][4].is_null() && !item["params"][5].is_null() && !item["params"][6].is_null()));
            let rows = text(litchi::to_bytes(&course, sortie));
            prop_assert!(rows.lines().all(|row| row.split(',').count() == 46) && !rows.contains("NaN") && !rows.contains("inf"));
            prop_assert_eq!(rows.lines().count(), sortie.stops.len() + 3);
        }
        let files = [
            kml::to_bytes(&plan, Which::All, course.altitudes, Ground::default()).unwrap(),
            geojson::to_bytes(&plan, Which::All).unwrap(),
            tables::images(&plan, Which::All),
            tables::waypoints(&plan),
            tables::metashape(&plan, Which::All),
            footprints::to_bytes(&plan, Which::All).unwrap_or_default(),
        ];
        prop_assert_eq!(colmap::to_files(&plan, Which::All).is_some(), rig > 0);
        for file in files.into_iter().chain(colmap::to_files(&plan, Which::All).into_iter().flatten().map(|(_, bytes)| bytes)) {
            prop_assert!(!text(file).split(|c: char| !c.is_alphanumeric()).any(|word| word == "NaN" || word == "inf"));
        }
    }
}

#[test]
fn a_thousand_waypoints_are_written_and_none_is_lost() {
    let corner = |k: u32| [f64::from(k % 40) * 12.0, f64::from(k / 40) * 12.0, 30.0 + f64::from(k % 7)];
    let plan = plan("phantom4-rtk", &(0..1000).map(corner).collect::<Vec<_>>());
    let options = CourseOptions { sortie_s: Some(80_000.0), ..CourseOptions::default() };
    let timed = |name: &str, write: &dyn Fn() -> Vec<u8>| {
        let started = Instant::now();
        let bytes = write();
        println!("{name}: {:.1} ms, {} bytes", started.elapsed().as_secs_f64() * 1e3, bytes.len());
        bytes
    };
    let started = Instant::now();
    let course = Course::new(&plan, None, &options).unwrap();
    println!("course: {:.1} ms", started.elapsed().as_secs_f64() * 1e3);
    let sortie = &course.sorties[0];
    assert_eq!((course.sorties.len(), sortie.stops.len()), (1, 1000));
    let file: Value = serde_json::from_slice(&timed("qgc", &|| qgc::to_bytes(&course, sortie, Autopilot::Px4))).unwrap();
    let count =
        |command: u64| file["mission"]["items"].as_array().unwrap().iter().filter(|item| item["command"] == command).count();
    assert_eq!(count(16), 1003);
    let rows = text(timed("ardupilot", &|| waypoints::to_bytes(&course, sortie)));
    // The take-off place is one as well.
    assert_eq!(rows.lines().filter(|row| row.split('\t').nth(3) == Some("16")).count(), 1004);
    let kmz = timed("dji", &|| dji::to_bytes(&course, sortie, 0));
    assert_eq!(unpacked(kmz, "wpmz/waylines.wpml").matches("<Placemark>").count(), 1002);
    assert_eq!(text(timed("litchi", &|| litchi::to_bytes(&course, sortie))).lines().count(), 1003);
    let map = text(timed("kml", &|| kml::to_bytes(&plan, Which::All, course.altitudes, Ground::default()).unwrap()));
    assert_eq!(map.matches("<Placemark>").count(), 1 + 1000 + plan.images.len());
    let map: Value = serde_json::from_slice(&timed("geojson", &|| geojson::to_bytes(&plan, Which::All).unwrap())).unwrap();
    assert_eq!(map["features"].as_array().map(Vec::len), Some(1 + 1000 + plan.images.len()));
    for (name, rows) in [
        ("csv, images", timed("csv, images", &|| tables::images(&plan, Which::All))),
        ("realitycapture", timed("realitycapture", &|| tables::reality_capture(&plan, Which::All))),
        ("metashape", timed("metashape", &|| tables::metashape(&plan, Which::All))),
    ] {
        assert_eq!(text(rows).lines().count(), plan.images.len() + 1, "{name}");
    }
    assert_eq!(text(timed("csv, waypoints", &|| tables::waypoints(&plan))).lines().count(), 1001);
    let poses = text(timed("colmap", &|| colmap::to_files(&plan, Which::All).unwrap()[1].1.clone()));
    assert_eq!(poses.matches(".jpg").count(), plan.images.len());
    let shown: Value =
        serde_json::from_slice(&timed("footprints", &|| footprints::to_bytes(&plan, Which::All).unwrap())).unwrap();
    assert_eq!(shown["features"].as_array().map(Vec::len), Some(plan.images.len()));
}

#[test]
fn heights_above_the_ground_are_written_in_each_formats_way() {
    let (scene, plan) = over_a_hill();
    let free = FreeSpace::new(&scene, &Settings::default().flight).unwrap();
    let course = |altitudes| Course::new(&plan, Some(&free), &CourseOptions { altitudes, ..CourseOptions::default() }).unwrap();
    let (above_ground, above_takeoff) = (course(Altitudes::Terrain), course(Altitudes::Relative));
    let terrain = free.terrain().unwrap();
    let (course, sortie) = (&above_ground, &above_ground.sorties[0]);
    let expected: Vec<f64> = sortie
        .stops
        .iter()
        .map(|stop| {
            let at = plan.waypoints[stop.waypoint].position_m;
            at.z - terrain.height_m(at.x, at.y)
        })
        .collect();
    let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-3, "{found} instead of {expected}");

    assert!(Autopilot::Px4.check(Altitudes::Terrain).is_err() && Autopilot::Px4.check(Altitudes::Absolute).is_ok());
    let file: Value = serde_json::from_slice(&qgc::to_bytes(course, sortie, Autopilot::ArduPilot)).unwrap();
    let items = file["mission"]["items"].as_array().unwrap();
    let in_frame = |frame: u64| items.iter().filter(move |item| item["frame"] == frame);
    assert!(in_frame(10).all(|item| item["AltitudeMode"] == 4 && item["command"] == 16));
    assert!(in_frame(3).all(|item| item["AltitudeMode"] == 1) && file["mission"]["globalPlanAltitudeMode"] == 0);
    assert_eq!(in_frame(3).count(), 2 + sortie.out.len() + sortie.back.len(), "take-off, out, back and above home");
    let relief: usize = sortie.stops.iter().map(|stop| stop.relief.len()).sum();
    assert_eq!(in_frame(10).count(), sortie.stops.len() + relief);
    assert!(relief > 10);
    let leads = mav_items::items(course, sortie, Autopilot::ArduPilot).into_iter().filter(|item| item.waypoint.is_some());
    leads.zip(&expected).for_each(|(item, expected)| near(item.alt_m, *expected));
    let rows = text(waypoints::to_bytes(course, sortie));
    let frames: Vec<&str> = rows.lines().skip(1).filter_map(|row| row.split('\t').nth(2)).collect();
    assert_eq!(frames.iter().filter(|frame| **frame == "10").count(), sortie.stops.len() + relief);

    let rows = text(litchi::to_bytes(course, sortie));
    let fields = |row: &str| row.split(',').map(str::to_owned).collect::<Vec<_>>();
    let rows: Vec<Vec<String>> = rows.lines().skip(1).map(fields).collect();
    let (out, stops) = (sortie.out.len(), sortie.stops.len());
    assert!(rows[out..out + stops].iter().all(|row| row[38] == "1") && rows[..out].iter().all(|row| row[38] == "0"));
    rows[out..].iter().zip(&expected).for_each(|(row, expected)| near(row[2].parse().unwrap(), *expected));

    let kmz = dji::to_bytes(course, sortie, 0);
    let (template, waylines) = (unpacked(kmz.clone(), "wpmz/template.kml"), unpacked(kmz, "wpmz/waylines.wpml"));
    assert!(
        template.contains("<wpml:heightMode>aboveGroundLevel<")
            && waylines.contains("<wpml:executeHeightMode>relativeToStartPoint<")
    );
    let document = Document::parse(&template).unwrap();
    let heights: Vec<f64> =
        document.descendants().filter(|node| node.tag_name().name() == "Placemark").map(|mark| number(&mark, "height")).collect();
    heights[out..].iter().zip(&expected).for_each(|(height_m, expected)| near(*height_m, *expected));
    let flown = unpacked(dji::to_bytes(&above_takeoff, &above_takeoff.sorties[0], 0), "wpmz/waylines.wpml");
    assert_eq!(waylines, flown, "the aircraft flies the same");

    let map = text(kml::to_bytes(&plan, Which::All, Altitudes::Terrain, Ground::of(Some(&free))).unwrap());
    let document = Document::parse(&map).unwrap();
    let line = document.descendants().find(|node| node.tag_name().name() == "LineString").unwrap();
    let coordinates = value(&line, "coordinates").unwrap();
    assert!(coordinates.split(' ').count() > plan.flown_points().len() + 10, "the line follows the hill");
    near(coordinates.split(' ').next().unwrap().split(',').nth(2).unwrap().parse().unwrap(), expected[0]);
    assert_eq!(value(&line, "altitudeMode"), Some("relativeToGround"));
}
