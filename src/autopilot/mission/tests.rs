use super::*;
use crate::mission::fixture;

fn new(rig: &str) -> NewPlan {
    let corners: Vec<[f64; 3]> =
        (0..30).map(|k| [40.0 * f64::from(k % 6), 40.0 * f64::from(k / 6), 30.0 + f64::from(k)]).collect();
    NewPlan { epoch: 7, plan: Arc::new(fixture::plan(rig, &corners)), differs_from: None }
}

fn mission(rig: &str, autopilot: Autopilot, joined: Option<usize>) -> Mission {
    let joined = joined.map(|waypoint| Joined { waypoint, from_m: None });
    let course = &CourseOptions { sortie_s: Some(3000.0), ..CourseOptions::default() };
    Mission::new(&new(rig), &MissionOptions { course, free: None, sortie: 1, autopilot }, joined).unwrap()
}

#[test]
fn every_waypoint_of_the_plan_has_its_item_at_its_place() {
    for (rig, autopilot, joined) in [
        ("phantom4-rtk", Autopilot::Px4, None),
        ("phantom4-rtk", Autopilot::ArduPilot, Some(5)),
        ("m300-oblique", Autopilot::ArduPilot, None),
        ("panoramic", Autopilot::Px4, Some(12)),
    ] {
        let mission = mission(rig, autopilot, joined);
        assert_eq!(mission.stops.len(), mission.plan.waypoints.len());
        for stop in &mission.stops {
            let item = &mission.items[stop.item];
            let place = mission.frame.geodetic_from_local(&mission.plan.waypoints[stop.waypoint].position_m).unwrap();
            assert_eq!([item.x, item.y], [place.lat_deg, place.lon_deg].map(|deg| (deg * 1e7).round() as i32));
            assert_eq!(item.command, MavCmd::MAV_CMD_NAV_WAYPOINT);
            assert_eq!(mission.waypoint_ahead(stop.begins), Some(stop.waypoint));
            assert_eq!(mission.waypoint_ahead(stop.item), Some(stop.waypoint));
            assert_eq!(mission.stop_from(stop.waypoint), Some(*stop));
            let between = &mission.items[stop.begins..stop.item];
            assert!(between.iter().all(|item| item.command != MavCmd::MAV_CMD_NAV_WAYPOINT), "{rig}: {stop:?}");
        }
        assert_eq!(mission.waypoint_ahead(mission.last_item() + 1), None);
        let is_home_first = mission.items[0].command == MavCmd::MAV_CMD_NAV_WAYPOINT;
        assert_eq!(is_home_first, autopilot == Autopilot::ArduPilot, "ArduPilot's item 0 is its home");
    }
}

/// A plan over a hill, flown at heights above the ground in one sortie.
fn over_a_hill() -> (FreeSpace, NewPlan, CourseOptions) {
    let (scene, plan) = fixture::over_a_hill();
    let free = FreeSpace::new(&scene, &crate::settings::Settings::default().flight).unwrap();
    let altitudes = crate::mission::course::Altitudes::Terrain;
    let course = CourseOptions { altitudes, sortie_s: Some(3000.0), ..CourseOptions::default() };
    (free, NewPlan { epoch: 1, plan: Arc::new(plan), differs_from: None }, course)
}

#[test]
fn an_aircraft_that_follows_the_ground_does_not_fly_back_to_be_told_its_height() {
    let (free, new, course) = over_a_hill();
    let options = MissionOptions { course: &course, free: Some(&free), sortie: 1, autopilot: Autopilot::ArduPilot };
    let mission = Mission::new(&new, &options, Some(Joined { waypoint: 1, from_m: None })).unwrap();
    let stop = mission.stops[1];
    let relief = stop.item - stop.begins;
    assert!(relief > 10 && mission.stops.len() == new.plan.waypoints.len(), "{:?}", mission.stops);
    assert_eq!(mission.goes_on(1, &Point3::new(-200.0, 60.0, 90.0)), Some([stop.begins, stop.item]));
    let [item, last] = mission.goes_on(1, &Point3::new(120.0, 60.0, 90.0)).unwrap();
    assert!(item > stop.begins + 5 && item < stop.item && last == stop.item, "{item} of {stop:?}");
    let next = mission.items[item..].iter().find(|item| item.command == MavCmd::MAV_CMD_NAV_WAYPOINT).unwrap();
    let alt_m = 0.0;
    let place = Geodetic { lat_deg: f64::from(next.x) / DEGREE, lon_deg: f64::from(next.y) / DEGREE, alt_m };
    assert!(mission.frame.local_from_geodetic(&place).unwrap().x > 119.0);
    assert_eq!(in_force(&mission, item, 1), in_force(&mission, 0, 1), "and has all settings");
    let px4 = MissionOptions { autopilot: Autopilot::Px4, ..options };
    let refused = Mission::new(&new, &px4, None).unwrap_err().to_string();
    assert!(refused.contains("--autopilot ardupilot") && refused.contains("--altitude relative"), "{refused}");
}

#[test]
fn an_aircraft_that_comes_down_to_a_path_flies_its_leg_from_the_beginning() {
    let (free, new, course) = over_a_hill();
    let options = MissionOptions { course: &course, free: Some(&free), sortie: 1, autopilot: Autopilot::ArduPilot };
    let whole = Mission::new(&new, &options, None).unwrap();
    let from_m = Some(Point3::new(150.0, 250.0, 100.0));
    for waypoint in 1..4 {
        let mission = Mission::new(&new, &options, Some(Joined { waypoint, from_m })).unwrap();
        let (way_in, stop) = (mission.way_in.unwrap(), mission.stops[waypoint - 1]);
        assert_eq!(mission.waypoint_ahead(way_in), Some(waypoint - 1));
        let way = &mission.items[way_in..stop.item];
        assert!(way.iter().all(|item| item.frame != MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT), "{waypoint}: no other way to it");
        let triggers = way.iter().filter(|item| item.command == MavCmd::MAV_CMD_DO_SET_CAM_TRIGG_DIST);
        assert!(triggers.clone().count() == 1 && triggers.clone().all(|item| item.param1 == 0.0), "{waypoint}: no images on it");
        assert!(way.iter().any(|item| item.command == MavCmd::MAV_CMD_DO_MOUNT_CONTROL), "{waypoint}: the first image is aimed");
        assert_eq!(in_force(&mission, way_in, waypoint), in_force(&whole, 0, waypoint), "{waypoint}");
        let relief = |mission: &Mission| mission.stops[waypoint].item - mission.stops[waypoint].begins;
        assert!(relief(&mission) >= relief(&whole), "{waypoint}: the leg is whole");
        assert!(waypoint == 2 || relief(&whole) > 10, "{waypoint}: it leads over the hill");
    }
}

#[test]
fn who_joins_a_later_sortie_does_not_fly_the_first_one_again() {
    let course = &CourseOptions { sortie_s: Some(300.0), ..CourseOptions::default() };
    let (new, sortie, autopilot) = (new("phantom4-rtk"), 1, Autopilot::Px4);
    let options = MissionOptions { course, free: None, sortie, autopilot };
    let mission = |waypoint: usize| Mission::new(&new, &options, Some(Joined { waypoint, from_m: None })).unwrap();
    let ends: Vec<usize> = (1..=mission(0).sorties)
        .map(|sortie| Mission::new(&new, &MissionOptions { sortie, ..options }, None).unwrap().stops.last().unwrap().waypoint)
        .collect();
    assert!(ends.len() > 1 && ends.last() == Some(&29), "{ends:?}");
    for waypoint in 0..30 {
        let joined = mission(waypoint);
        assert_eq!(joined.sortie, 1 + ends.partition_point(|&end| end < waypoint), "waypoint {waypoint} of {ends:?}");
        assert_eq!(joined.stop_from(waypoint).unwrap().waypoint, waypoint);
    }
}

/// What is in force on the way to a stop when the items from `from` on are carried out.
fn in_force(mission: &Mission, from: usize, stop: usize) -> BTreeMap<u32, String> {
    let items = &mission.items[from..mission.stops[stop].item];
    let settings = items.iter().filter(|item| item.frame == MavFrame::MAV_FRAME_MISSION);
    settings.map(|item| (item.command as u32, format!("{:?}", [item.param1, item.param2, item.x as f32, item.z]))).collect()
}

#[test]
fn an_aircraft_that_joins_in_flight_has_all_settings_of_one_that_has_flown_from_the_start() {
    for (rig, autopilot) in
        [("phantom4-rtk", Autopilot::Px4), ("phantom4-rtk", Autopilot::ArduPilot), ("panoramic", Autopilot::Px4)]
    {
        let whole = mission(rig, autopilot, None);
        let joined = mission(rig, autopilot, Some(9));
        assert!(joined.items.len() > whole.items.len(), "the settings are repeated");
        for stop in 9..9 + SET_ANEW {
            let from = joined.stops[stop].begins;
            assert_eq!(in_force(&joined, from, stop), in_force(&whole, 0, stop), "{rig}, stop {stop}");
        }
        assert_eq!(joined.items.iter().position(|item| item.current == 1), Some(joined.stops[9].begins));
    }
}

fn line(points: &[[f64; 3]]) -> Vec<Waypoint> {
    points.iter().map(|&at| Waypoint { position_m: at.into(), direction: None, deviation_m: 1.0 }).collect()
}

#[test]
fn what_has_not_changed_is_flown_on_and_a_new_path_is_joined_where_it_is_nearest() {
    let old = line(&[[0.0; 3], [10.0, 0.0, 0.0], [20.0, 0.0, 0.0], [30.0, 0.0, 0.0], [40.0, 0.0, 0.0]]);
    let mut new = old.clone();
    new[3].position_m.y = 8.0;
    assert_eq!(first_changed(&old, &new), 3);
    let here = Point3::new(13.0, 1.0, 0.0);
    assert_eq!(join(&new, 3, Some(2), &here, 0), Join { waypoint: 2, off_m: 1.0 });
    // On the way to what has changed: no longer along the old leg, but to where the new one leads.
    let there = Point3::new(25.0, 0.0, 0.0);
    let joined = join(&new, 3, Some(3), &there, 0);
    assert!(joined.waypoint == 3 && (joined.off_m - 3.12).abs() < 0.1, "{joined:?}");
    // A path from the pose begins with the leg behind it.
    let from_pose = line(&[[13.0, 0.0, 0.0], [18.0, 0.0, 0.0], [18.0, 50.0, 0.0], [13.0, 50.0, 0.0], [13.0, 2.0, 0.0]]);
    assert_eq!(join(&from_pose, 0, Some(2), &Point3::new(14.0, 0.3, 0.0), 0).waypoint, 1);
    assert_eq!(join(&from_pose, 0, Some(2), &Point3::new(18.5, 9.0, 0.0), 0).waypoint, 2);
    // It has not come to the pose yet that it was said to be at by now.
    assert_eq!(join(&from_pose, 0, Some(2), &Point3::new(9.0, 1.0, 0.0), 0).waypoint, 0);
}

#[test]
fn a_sortie_that_there_is_not_is_refused() {
    let course = &CourseOptions::default();
    let options = MissionOptions { course, free: None, sortie: 99, autopilot: Autopilot::Px4 };
    let refused = Mission::new(&new("panoramic"), &options, None).unwrap_err();
    assert!(matches!(refused, MissionError::NoSortie { wanted: 99, .. }), "{refused}");
}
