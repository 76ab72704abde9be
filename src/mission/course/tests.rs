use geo::polygon;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::mission::fixture::{ORIGIN, corners, plan};
use crate::scene::{BlockSettings, NoFlyZone, Scene, ZoneSource, generate_block};
use crate::settings::Settings;

proptest! {
    #[test]
    fn sorties_together_fly_the_plan_and_each_keeps_its_time(
        corners in corners(2..60), rig in 0usize..3, sortie_s in 250.0..600.0f64,
    ) {
        let plan = plan(["panoramic", "m300-oblique", "phantom4-rtk"][rig], &corners);
        let options = CourseOptions { sortie_s: Some(sortie_s), ..CourseOptions::default() };
        let course = match Course::new(&plan, None, &options) {
            Ok(course) => course,
            Err(CourseError::SortieTooShort { needs_s, has_s, .. }) => {
                prop_assert!(needs_s > has_s && has_s == sortie_s);
                return Ok(());
            }
            Err(other) => panic!("{other}"),
        };
        let mut next = 0;
        for (index, sortie) in course.sorties.iter().enumerate() {
            let waypoints: Vec<usize> = sortie.stops.iter().map(|stop| stop.waypoint).collect();
            prop_assert_eq!((sortie.number, waypoints[0]), (index + 1, next));
            prop_assert!(waypoints.windows(2).all(|pair| pair[0] + 1 == pair[1]), "{waypoints:?}");
            next = waypoints[waypoints.len() - 1];
            prop_assert!(sortie.duration_s <= sortie_s);
            let ends = [&sortie.stops[0], &sortie.stops[sortie.stops.len() - 1]];
            prop_assert!(ends.iter().all(|stop| stop.deviation_m == 0.0 && stop.cut_m == 0.0));
            for stop in &sortie.stops {
                let place = plan.waypoints[stop.waypoint].position_m;
                prop_assert_eq!(stop.at.position_m, place);
                prop_assert!((stop.at.geodetic.alt_m - ORIGIN.alt_m - place.z).abs() < 1e-9 && stop.at.above_takeoff_m == place.z);
                prop_assert!(stop.at.above_takeoff_m < course.transit_m && (0.0..360.0).contains(&stop.heading_deg));
                prop_assert_eq!(stop.gimbal_pitch_deg.is_some(), rig == 2);
            }
        }
        prop_assert_eq!(next, plan.waypoints.len() - 1);
        prop_assert_eq!(course.exposures() * plan.cameras.len(), plan.images.len());
    }
}

#[test]
fn a_battery_flies_what_its_reserve_leaves() {
    let corners: Vec<[f64; 3]> = (0..200).map(|k| [f64::from(k % 20) * 20.0, f64::from(k / 20) * 20.0, 40.0]).collect();
    let plan = plan("phantom4-rtk", &corners);
    let sorties = |reserve_percent: f64| {
        let course = Course::new(&plan, None, &CourseOptions { reserve_percent, ..CourseOptions::default() }).unwrap();
        assert!(course.sorties.iter().all(|sortie| sortie.battery_percent.unwrap() <= 100.0 - reserve_percent));
        course.sorties.len()
    };
    assert!(sorties(20.0) >= 1 && sorties(75.0) > sorties(20.0));
    let none = Course::new(&plan, None, &CourseOptions { reserve_percent: 100.0, ..CourseOptions::default() });
    assert!(matches!(none, Err(CourseError::SortieTooShort { .. })), "{none:?}");
}

#[test]
fn views_and_images_are_those_of_the_plan() {
    let plan = plan("phantom4-rtk", &[[0.0, 0.0, 30.0], [60.0, 0.0, 40.0], [60.0, 90.0, 40.0]]);
    let course = Course::new(&plan, None, &CourseOptions::default()).unwrap();
    let stops = &course.sorties[0].stops;
    let views: Vec<(f64, f64)> =
        stops.iter().map(|stop| (stop.heading_deg.round(), stop.gimbal_pitch_deg.unwrap().round())).collect();
    assert_eq!(views, [(0.0, -20.0), (37.0, -37.0), (74.0, -54.0)]);
    assert_eq!(stops[1].deviation_m, plan.waypoints[1].deviation_m);
    assert!(stops[1].cut_m > 0.5 && stops[1].cut_m < 30.0);
    // 60.8 m and 90 m in pieces of at least 8.5 m.
    let spacings: Vec<f64> = stops.iter().filter_map(|stop| stop.spacing_m).collect();
    assert!(spacings.len() == 2 && spacings.iter().all(|spacing_m| (8.5..12.0).contains(spacing_m)), "{spacings:?}");
    let Trigger { distance_m, interval_s } = course.trigger.unwrap();
    assert!((8.5..10.5).contains(&distance_m) && (1.0..2.0).contains(&interval_s), "{distance_m} m, {interval_s} s");
}

#[test]
fn a_plan_that_is_no_mission_is_refused_with_the_reason() {
    let sound = plan("panoramic", &[[0.0, 0.0, 30.0], [60.0, 0.0, 40.0]]);
    let refused = |plan: &Plan, options: &CourseOptions| Course::new(plan, None, options).unwrap_err();
    let options = CourseOptions::default();
    let mut other = sound.clone();
    other.scene.origin = None;
    assert!(matches!(refused(&other, &options), CourseError::NoGeoreference { .. }));
    other = sound.clone();
    other.waypoints[1].position_m = other.waypoints[0].position_m;
    assert_eq!(refused(&other, &options), CourseError::TooFewWaypoints { count: 1 });
    other = sound.clone();
    other.limits = None;
    assert_eq!(refused(&other, &options), CourseError::NoLimits);
    let at = |lat_deg: f64, lon_deg: f64| CourseOptions {
        home: Some(HomeChoice { lat_deg, lon_deg, alt_m: None }),
        ..CourseOptions::default()
    };
    assert!(matches!(refused(&sound, &at(4.0, 52.0)), CourseError::FarHome { .. }));
    assert!(matches!(refused(&sound, &at(91.0, 4.0)), CourseError::NoPlace { .. }));
    assert!(matches!(refused(&sound, &at(f64::NAN, 4.0)), CourseError::NoPlace { .. }));
}

/// A block, and the plan of a path well above it.
fn above_a_block() -> (Scene, Plan, f64) {
    let scene = generate_block(&BlockSettings { extent_m: [130.0, 130.0], buildings: 9, ..Default::default() });
    let top_m = scene.bounds().unwrap().max.z;
    let mut plan = plan("panoramic", &[[-40.0, 0.0, top_m + 8.0], [40.0, 0.0, top_m + 8.0], [40.0, 60.0, top_m + 9.0]]);
    plan.scene.origin = scene.frame.origin;
    (scene, plan, top_m)
}

fn free(scene: &Scene) -> FreeSpace {
    FreeSpace::new(scene, &Settings::default().flight).unwrap()
}

fn zone(name: &str, [west, south, east, north]: [f64; 4], floor_m: f64, ceiling_m: f64) -> NoFlyZone {
    let outline = polygon![(x: west, y: south), (x: east, y: south), (x: east, y: north), (x: west, y: north)].into();
    NoFlyZone { name: name.to_owned(), outline, floor_m, ceiling_m, source: ZoneSource::Edit }
}

#[test]
fn the_ways_out_and_home_keep_clear_of_all_that_stands() {
    let (scene, plan, top_m) = above_a_block();
    let free = free(&scene);
    let course = Course::new(&plan, Some(&free), &CourseOptions::default()).unwrap();
    let home = course.home.position_m;
    assert!(home.z == 0.0 && course.transit_m >= top_m + free.safety_distance_m);
    let above_home = home + Vector3::z() * course.transit_m;
    let low = home + Vector3::z() * 0.5;
    for sortie in &course.sorties {
        for (a, b) in [(low, above_home), (above_home, sortie.entry.position_m), (sortie.exit.position_m, above_home)] {
            assert!(free.clearance.segment_distance_m(&a, &b, 100.0) >= free.safety_distance_m);
        }
    }
    // In the middle of a building nobody takes off.
    let building = scene.structures.iter().map(|structure| structure.bounds()).find(|bounds| bounds.min.z <= 0.0).unwrap();
    let inside = scene.frame.geodetic_from_local(&nalgebra::center(&building.min, &building.max)).unwrap();
    let home = Some(HomeChoice { lat_deg: inside.lat_deg, lon_deg: inside.lon_deg, alt_m: None });
    let refused = Course::new(&plan, Some(&free), &CourseOptions { home, ..CourseOptions::default() });
    assert!(matches!(&refused, Err(CourseError::Obstructed { what, .. }) if what.contains("take-off")), "{refused:?}");
}

#[test]
fn zones_bar_the_course_or_fence_it_in() {
    let (mut scene, plan, top_m) = above_a_block();
    scene.zones.push(zone("aside", [90.0, -60.0, 120.0, -30.0], 0.0, f64::MAX));
    scene.zones.push(zone("yard", [-10.0, -10.0, 10.0, 10.0], 0.0, top_m));
    let course = Course::new(&plan, Some(&free(&scene)), &CourseOptions::default()).unwrap();
    assert_eq!(course.fences.iter().map(|fence| (fence.name.as_str(), fence.corners.len())).collect::<Vec<_>>(), [("aside", 4)]);
    assert!(course.notes.iter().any(|note| note.contains("\"yard\"")), "{:?}", course.notes);
    scene.zones.push(zone("across", [-10.0, -10.0, 10.0, 10.0], 0.0, f64::MAX));
    let refused = Course::new(&plan, Some(&free(&scene)), &CourseOptions::default());
    assert!(matches!(&refused, Err(CourseError::Obstructed { obstruction: Obstruction::Zone(zone), .. }) if zone == "across"));
}
