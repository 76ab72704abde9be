use super::*;
use crate::autopilot::mission::NewPlan;
use crate::mission::course::CourseOptions;
use crate::mission::fixture;
use crate::mission::mav_items::Autopilot;

fn mission(rig: &str) -> Arc<Mission> {
    let corners: Vec<[f64; 3]> = (0..12).map(|k| [50.0 * f64::from(k % 4), 60.0 * f64::from(k / 4), 40.0]).collect();
    let new = NewPlan { epoch: 7, plan: Arc::new(fixture::plan(rig, &corners)), differs_from: None };
    let options = CourseOptions { sortie_s: Some(3000.0), ..CourseOptions::default() };
    Arc::new(
        Mission::new(
            &new,
            &crate::autopilot::mission::MissionOptions { course: &options, free: None, sortie: 1, autopilot: Autopilot::Px4 },
            None,
        )
        .unwrap(),
    )
}

/// What the wire says of an aircraft at a local place.
fn wire(mission: &Mission, at: &Point3<f64>, velocity_mps: &Vector3<f64>) -> GLOBAL_POSITION_INT_DATA {
    let place = mission.frame.geodetic_from_local(at).unwrap();
    GLOBAL_POSITION_INT_DATA {
        lat: (place.lat_deg * 1e7).round() as i32,
        lon: (place.lon_deg * 1e7).round() as i32,
        relative_alt: ((at.z - mission.home_z_m) * 1000.0).round() as i32,
        vx: (velocity_mps.y * 100.0) as i16,
        vy: (velocity_mps.x * 100.0) as i16,
        vz: (-velocity_mps.z * 100.0) as i16,
        ..GLOBAL_POSITION_INT_DATA::DEFAULT
    }
}

/// Flies the plan as it is timed, in tenths of a second; `each` sees the flight after each of them.
fn fly(progress: &mut Progress, mut each: impl FnMut(&mut Progress, f64)) {
    let mission = Arc::clone(&progress.mission);
    let profile = mission.plan.profile().unwrap();
    let steps = (profile.duration_s() * 10.0) as usize;
    for step in 0..=steps {
        let time_s = step as f64 / 10.0;
        let passage = profile.at(time_s).unwrap();
        let stop = mission.stop_from(passage.leg + 1).unwrap();
        progress.current(stop.item);
        progress.moved(&wire(&mission, &passage.position_m, &passage.velocity_mps), Duration::from_secs_f64(time_s));
        each(progress, time_s);
    }
}

#[test]
fn images_count_as_they_are_passed() {
    for rig in ["panoramic", "m300-oblique", "phantom4-rtk"] {
        let mission = mission(rig);
        let mut progress = Progress::new(Arc::clone(&mission), None, None, false);
        assert_eq!((progress.images_taken(), progress.report(Duration::ZERO, Duration::ZERO)), (0, None), "on the ground");
        progress.current(0);
        assert!(!progress.is_under_way());
        let first = mission.stops[0].item;
        progress.reached(first);
        fly(&mut progress, |progress, time_s| {
            let passed = mission.plan.images.iter().filter(|image| image.time_s <= time_s).count();
            let cameras = mission.plan.cameras.len();
            let taken = progress.images_taken();
            assert!(passed.abs_diff(taken) <= cameras, "{rig}: {taken} of {passed} at {time_s} s");
            let report = progress.report(Duration::from_secs_f64(time_s), Duration::ZERO).expect("it is under way");
            assert_eq!((report.epoch, report.images_taken), (7, taken as u64));
            assert_eq!(report.check(), Ok(()));
            assert_eq!(report.view_deg.is_some(), rig == "phantom4-rtk");
        });
        assert!(!progress.is_flown());
        progress.reached(mission.last_item());
        assert!(progress.is_flown());
        assert_eq!(progress.images_taken(), mission.plan.images.len());
    }
}

#[test]
fn where_the_camera_tells_of_its_images_those_count_that_it_has_taken() {
    let mission = mission("m300-oblique");
    let mut progress = Progress::new(Arc::clone(&mission), None, None, false);
    progress.reached(mission.stops[0].item);
    let exposures = exposures(&mission);
    let (mut next, mut taken) = (0, 0);
    fly(&mut progress, |progress, _| {
        let leg = progress.leg().unwrap();
        while let Some(exposure) = exposures.get(next).filter(|exposure| exposure.leg <= leg && progress.passed > next) {
            next += 1;
            // Every fifth one fails, and none is taken where the plan has it.
            if next % 5 != 0 {
                let at = wire(&mission, &(exposure.position_m + Vector3::new(1.0, -1.0, 0.5)), &Vector3::zeros());
                progress.captured(at.lat, at.lon, at.relative_alt);
                taken = next;
            }
        }
        if taken > 0 {
            assert_eq!(progress.images_taken(), exposures[taken - 1].images);
        }
    });
    assert!(exposures.len() > 30 && taken > 30);
    assert_eq!(progress.missed(), taken / 5);
    assert_eq!(progress.strays(), 0);
    progress.captured(510_000_000, 40_000_000, 0);
    assert_eq!(progress.strays(), 1);
}

#[test]
fn one_message_that_comes_late_ends_no_flight_and_an_unknown_place_is_none() {
    let mission = mission("panoramic");
    let mut progress = Progress::new(Arc::clone(&mission), Some(3), None, false);
    progress.current(mission.last_item() + 1);
    progress.current(mission.stops[3].item);
    progress.current(mission.last_item() + 1);
    assert!(!progress.is_flown());
    progress.moved(&GLOBAL_POSITION_INT_DATA::DEFAULT, Duration::ZERO);
    assert_eq!(progress.fix, None);
    progress.current(mission.last_item() + 1);
    assert!(progress.is_flown());
}

#[test]
fn an_old_position_is_not_reported() {
    let mission = mission("panoramic");
    let mut progress = Progress::new(Arc::clone(&mission), Some(2), None, false);
    let at = mission.plan.waypoints[1].position_m + Vector3::new(0.0, 0.0, 9.0);
    progress.moved(&wire(&mission, &at, &Vector3::new(3.0, 4.0, -1.0)), Duration::from_secs(10));
    let report = progress.report(Duration::from_secs(11), Duration::ZERO).unwrap();
    assert!((Point3::from(report.position_m) - at).norm() < 0.02);
    assert_eq!(report.velocity_mps, [3.0, 4.0, -1.0]);
    assert_eq!(progress.report(Duration::from_secs(13), Duration::ZERO), None);
}

#[test]
fn a_report_says_where_the_aircraft_will_be_when_a_new_plan_can_be_flown() {
    let mission = mission("panoramic");
    let profile = mission.plan.profile().unwrap();
    let mut progress = Progress::new(Arc::clone(&mission), None, None, false);
    progress.reached(mission.stops[0].item);
    let lead_s = 4.0;
    fly(&mut progress, |progress, time_s| {
        let report = progress.report(Duration::from_secs_f64(time_s), Duration::from_secs_f64(lead_s)).unwrap();
        let then = profile.at((time_s + lead_s).min(profile.duration_s())).unwrap();
        let off_m = (Point3::from(report.position_m) - then.position_m).norm();
        // On an arc it is not known exactly how far along its leg it is.
        assert!(off_m < 2.5, "{off_m} m off at {time_s} s");
        let passed = mission.plan.images.iter().filter(|image| image.time_s <= then.time_s).count();
        assert!((report.images_taken as usize).abs_diff(passed) <= 1, "{} of {passed} images at {time_s} s", report.images_taken);
    });
    // One that is not on its path is where it is.
    let aside = mission.plan.waypoints[5].position_m + Vector3::new(0.0, 0.0, 20.0);
    progress.moved(&wire(&mission, &aside, &Vector3::zeros()), Duration::from_secs(900));
    let report = progress.report(Duration::from_secs(900), Duration::from_secs_f64(lead_s)).unwrap();
    assert!((Point3::from(report.position_m) - aside).norm() < 0.05);
}
