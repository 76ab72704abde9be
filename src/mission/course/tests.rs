use geo::polygon;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::mission::fixture::{ORIGIN, corners, over_a_hill, plan};
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
        let [out, back] = [&sortie.out, &sortie.back].map(|way| way.iter().map(|place| place.position_m).collect::<Vec<_>>());
        let way = [vec![low, above_home], out, back, vec![above_home]].concat();
        for (a, b) in way.windows(2).map(|ends| (ends[0], ends[1])) {
            assert!(free.clearance.segment_distance_m(&a, &b, 100.0) >= free.safety_distance_m);
        }
    }
    // A low path beside the block still goes home above all of it.
    let mut low_plan = self::plan("panoramic", &[[-40.0, -95.0, 12.0], [40.0, -95.0, 12.0]]);
    low_plan.scene.origin = scene.frame.origin;
    let low_course = Course::new(&low_plan, Some(&free), &CourseOptions::default()).unwrap();
    assert!(low_course.transit_m >= top_m + free.safety_distance_m && top_m > 20.0, "{} m", low_course.transit_m);
    let unaware = Course::new(&low_plan, None, &CourseOptions::default()).unwrap();
    assert!(unaware.transit_m < 20.0 && unaware.notes.iter().any(|note| note.contains("the scene is not known")));
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
    let free = free(&scene);
    let refused = Course::new(&plan, Some(&free), &CourseOptions::default()).and_then(|course| course.check(&plan, &free));
    assert!(matches!(&refused, Err(CourseError::Obstructed { obstruction: Obstruction::Zone(zone), .. }) if zone == "across"));
}

/// Take-off on flat ground at a local place.
fn at(scene: &Scene, x: f64, y: f64) -> CourseOptions {
    let place = scene.frame.geodetic_from_local(&nalgebra::Point3::new(x, y, 0.0)).unwrap();
    let home = Some(HomeChoice { lat_deg: place.lat_deg, lon_deg: place.lon_deg, alt_m: None });
    CourseOptions { home, ..CourseOptions::default() }
}

fn between(p: &Point3<f64>) -> geo::Coord {
    geo::Coord { x: p.x, y: p.y }
}

proptest! {
    #[test]
    fn the_ways_out_and_home_lead_around_zones(
        corners in prop::collection::vec([-1.0..1.0f64, -1.0..1.0f64], 3..9), size_m in 60.0..250.0f64, second: bool,
    ) {
        use geo::{Area, Distance, Euclidean, Intersects, Validation};
        let (mut scene, _, _) = above_a_block();
        let ring = corners.iter().map(|[x, y]| geo::Coord { x: -500.0 + size_m * x, y: size_m * y }).collect::<Vec<_>>();
        let outline = geo::MultiPolygon(vec![geo::Polygon::new(geo::LineString::new(ring), Vec::new())]);
        prop_assume!(outline.is_valid() && outline.unsigned_area() > 100.0);
        scene.zones.push(NoFlyZone { outline, ..zone("odd", [0.0; 4], 0.0, f64::MAX) });
        if second {
            scene.zones.push(zone("low", [-620.0, -900.0, -600.0, 100.0], 0.0, 300.0));
        }
        let mut plan = self::plan("panoramic", &[[-150.0, -40.0, 30.0], [-150.0, 40.0, 30.0]]);
        plan.scene.origin = scene.frame.origin;
        let free = free(&scene);
        let is_barred = |p: &Point3<f64>| free.zones().iter().any(|zone| Euclidean.distance(&geo::Point::from(between(p)), &zone.outline) < 50.0);
        let home = Point3::new(-850.0, 0.0, 0.0);
        prop_assume!(![home, plan.waypoints[0].position_m, plan.waypoints[1].position_m].iter().any(is_barred));
        let course = match Course::new(&plan, Some(&free), &at(&scene, home.x, home.y)) {
            Ok(course) => course,
            // A zone may enclose a place in a bay whose mouth is narrower than the margins.
            Err(CourseError::Obstructed { obstruction: Obstruction::Zone(_), .. }) if corners.len() > 4 => return Ok(()),
            Err(other) => panic!("{other}"),
        };
        let sortie = &course.sorties[0];
        let points = |way: &[Place]| way.iter().map(|place| place.position_m).collect::<Vec<_>>();
        for way in [[vec![course.above_home().position_m], points(&sortie.out)].concat(), [points(&sortie.back), vec![course.above_home().position_m]].concat()] {
            for ends in way.windows(2) {
                let line = geo::Line::new(between(&ends[0]), between(&ends[1]));
                prop_assert!(ends[0].z == ends[1].z);
                for zone in free.zones() {
                    prop_assert!(!zone.outline.intersects(&line) && Euclidean.distance(&line, &zone.outline) > 9.99, "{way:?}");
                }
            }
        }
        let straight_m = (home.xy() - plan.waypoints[0].position_m.xy()).norm();
        let above = course.above_home();
        let length_m: f64 = std::iter::once(&above).chain(&sortie.out).zip(&sortie.out).map(|(a, b)| (b.position_m - a.position_m).norm()).sum();
        prop_assert!(length_m < straight_m + 4.0 * size_m + 2000.0 * f64::from(u8::from(second)) + 200.0);
        prop_assert_eq!(sortie.out.len().max(sortie.back.len()) > 1, course.notes.iter().any(|note| note.contains("straight way home")));
    }
}

#[test]
fn a_zone_of_many_corners_is_gone_around_as_a_whole() {
    let (mut scene, _, _) = above_a_block();
    let ring = (0..5000).map(|k| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / 5000.0);
        geo::Coord { x: -500.0 + 200.0 * cos, y: 200.0 * sin }
    });
    let outline = geo::MultiPolygon(vec![geo::Polygon::new(geo::LineString::new(ring.collect()), Vec::new())]);
    scene.zones.push(NoFlyZone { outline, ..zone("round", [0.0; 4], 0.0, f64::MAX) });
    let mut plan = self::plan("panoramic", &[[-150.0, -40.0, 30.0], [-150.0, 40.0, 30.0]]);
    plan.scene.origin = scene.frame.origin;
    let course = Course::new(&plan, Some(&free(&scene)), &at(&scene, -850.0, 0.0)).unwrap();
    let way = [vec![course.above_home()], course.sorties[0].out.clone()].concat();
    let length_m: f64 = way.windows(2).map(|ends| (ends[1].position_m - ends[0].position_m).norm()).sum();
    // Straight it is 701 m, tightly around the circle 790 m.
    assert!(way.len() > 3 && (790.0..860.0).contains(&length_m), "{length_m} m by {} corners", way.len());
}

#[test]
fn an_aircraft_that_follows_the_ground_keeps_to_the_legs() {
    let (scene, plan) = over_a_hill();
    let free = free(&scene);
    let options = CourseOptions { altitudes: Altitudes::Terrain, ..CourseOptions::default() };
    let course = Course::new(&plan, Some(&free), &options).unwrap();
    course.check(&plan, &free).unwrap();
    let terrain = free.terrain().unwrap();
    let mut places = 0;
    for ends in course.sorties.iter().flat_map(|sortie| sortie.stops.windows(2)) {
        let told: Vec<&Place> = std::iter::once(&ends[0].at).chain(&ends[0].relief).chain([&ends[1].at]).collect();
        places += told.len();
        for place in &told {
            let ground_m = terrain.height_m(place.position_m.x, place.position_m.y);
            assert!((place.above_ground_m - (place.position_m.z - ground_m)).abs() < 1e-9);
        }
        for pair in told.windows(2) {
            for step in 0..=200 {
                let share = f64::from(step) / 200.0;
                let on_leg = pair[0].position_m + (pair[1].position_m - pair[0].position_m) * share;
                let flown_m = terrain.height_m(on_leg.x, on_leg.y)
                    + pair[0].above_ground_m
                    + (pair[1].above_ground_m - pair[0].above_ground_m) * share;
                assert!((flown_m - on_leg.z).abs() <= RELIEF_M + 1e-9, "{flown_m} m instead of {} m", on_leg.z);
            }
        }
    }
    assert!(places > 20, "{places}: the hill is 60 m high");
    assert!(course.notes.iter().any(|note| note.contains("terrain data")), "{:?}", course.notes);
    // Neither without the scene nor needlessly.
    let unknown = Course::new(&plan, None, &options).unwrap_err();
    assert!(unknown == CourseError::NoTerrain && unknown.to_string().contains("--scene"), "{unknown}");
    let relative = Course::new(&plan, Some(&free), &CourseOptions::default()).unwrap();
    assert!(relative.sorties.iter().flat_map(|sortie| &sortie.stops).all(|stop| stop.relief.is_empty()));
}

#[test]
fn on_a_hill_an_aircraft_takes_off_from_the_ground_there() {
    let (scene, plan) = over_a_hill();
    let free = free(&scene);
    let course = Course::new(&plan, Some(&free), &at(&scene, 0.0, 0.0)).unwrap();
    assert!((course.home.position_m.z - 60.0).abs() < 1e-9 && course.home.above_ground_m.abs() < 1e-9, "{:?}", course.home);
    let stop = &course.sorties[0].stops[0].at;
    assert!((stop.above_takeoff_m - 30.0).abs() < 1e-9, "{} m", stop.above_takeoff_m);
    let chosen = Course::new(&plan, Some(&free), &CourseOptions::default()).unwrap();
    assert!(chosen.home.above_ground_m.abs() < 1e-9, "{:?}", chosen.home);
}

#[test]
fn without_the_scene_the_height_of_the_take_off_place_is_said_to_be_guessed() {
    let plan = plan("panoramic", &[[0.0, 0.0, 30.0], [60.0, 0.0, 40.0]]);
    let is_noted = |home: Option<HomeChoice>| {
        let course = Course::new(&plan, None, &CourseOptions { home, ..CourseOptions::default() }).unwrap();
        course.notes.iter().any(|note| note.contains("lowest ground") && note.contains("--home LAT,LON,ALT"))
    };
    let home = |alt_m: Option<f64>| Some(HomeChoice { lat_deg: ORIGIN.lat_deg, lon_deg: ORIGIN.lon_deg, alt_m });
    assert!(is_noted(None) && is_noted(home(None)) && !is_noted(home(Some(3.5))));
    let (scene, plan, _) = above_a_block();
    let known = Course::new(&plan, Some(&free(&scene)), &CourseOptions::default()).unwrap();
    assert!(known.notes.iter().all(|note| !note.contains("lowest ground")), "{:?}", known.notes);
}

#[test]
fn a_take_off_place_that_was_measured_under_the_terrain_is_taken_as_it_is() {
    let (scene, plan) = over_a_hill();
    let free = free(&scene);
    let alt_m = Some(scene.frame.origin.unwrap().alt_m + 57.0);
    let top = at(&scene, 0.0, 0.0).home.unwrap();
    let home = Some(HomeChoice { alt_m, ..top });
    let course = Course::new(&plan, Some(&free), &CourseOptions { home, ..CourseOptions::default() }).unwrap();
    assert!((course.home.position_m.z - 57.0).abs() < 1e-6, "{:?}", course.home);
}

#[test]
fn a_descent_through_a_zone_is_no_way_to_a_path() {
    let (mut scene, plan, top_m) = above_a_block();
    let course = Course::new(&plan, Some(&free(&scene)), &CourseOptions::default()).unwrap();
    let (from_m, to_m) = (Point3::new(-100.0, 0.0, top_m + 8.0), Point3::new(40.0, 0.0, top_m + 8.0));
    let way = course.way_over(&plan, Some(&free(&scene)), &from_m, &to_m).unwrap();
    let above_m = way.last().unwrap().position_m.z;
    scene.zones.push(zone("lid", [35.0, -5.0, 45.0, 5.0], top_m + 8.5, above_m - 0.5));
    let refused = course.way_over(&plan, Some(&free(&scene)), &from_m, &to_m);
    assert!(matches!(&refused, Err(CourseError::Obstructed { what, .. }) if what.contains("descent")), "{refused:?}");
}

#[test]
fn a_flight_that_goes_on_needs_no_way_out_to_where_it_begins() {
    let (mut scene, plan, top_m) = above_a_block();
    scene.zones.push(zone("lid", [-45.0, -5.0, -35.0, 5.0], top_m + 8.5, f64::MAX));
    let free = free(&scene);
    let options = CourseOptions { home: at(&scene, -100.0, -100.0).home, ..CourseOptions::default() };
    let refused = Course::new(&plan, Some(&free), &options).unwrap_err();
    let words = refused.to_string();
    assert!(words.contains("the climb above waypoint 0") && !words.contains("--home"), "{words}");
    let course = Course::new(&plan, Some(&free), &CourseOptions { in_flight: true, ..options }).unwrap();
    let sortie = &course.sorties[0];
    assert!(sortie.out.is_empty() && !sortie.back.is_empty() && sortie.stops.len() == plan.waypoints.len());
}

#[test]
fn only_zones_count_as_zones_on_the_way_home() {
    let (scene, _, top_m) = above_a_block();
    let inside = scene.structures.iter().map(|structure| structure.bounds()).find(|bounds| bounds.min.z <= 0.0).unwrap();
    let inside = nalgebra::center(&inside.min, &inside.max);
    let z = top_m + 8.0;
    let mut plan = self::plan("panoramic", &[[-40.0, 0.0, z], inside.into(), [40.0, 60.0, z]]);
    plan.scene.origin = scene.frame.origin;
    let course = Course::new(&plan, Some(&free(&scene)), &CourseOptions::default()).unwrap();
    assert!(course.notes.iter().all(|note| !note.contains("straight way home")), "{:?}", course.notes);
}
