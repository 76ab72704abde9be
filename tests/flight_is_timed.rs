//! The times of images and flight, and what the flight draws from the battery, are those of the waypoints.

mod support;

use overfly::camera::{Pose, Rig};
use overfly::planner::{Method, PlanOptions, StopToken, plan};
use overfly::settings::Settings;
use overfly::trajectory::plan::Plan;
use overfly::trajectory::profile::Profile;
use support::{rigs, session, small_block, small_settings, snapshot};

fn plans() -> (Settings, Vec<(Rig, Plan)>) {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(5), &settings));
    let planned = rigs().into_iter().map(|rig| {
        let options = PlanOptions { iterations: Some(80), ..PlanOptions::new(rig.clone(), Method::Paper, 6) };
        let plan = plan(&snapshot, &settings, &options, &StopToken::default(), &mut |_| {}).expect("the block can be flown");
        assert!(plan.waypoints.len() > 3);
        (rig, plan)
    });
    let planned = planned.collect();
    (settings, planned)
}

#[test]
fn images_are_taken_one_after_the_other_and_the_last_one_at_the_end_of_the_flight() {
    let (settings, plans) = plans();
    for (rig, plan) in plans {
        let cameras = plan.cameras.len();
        let exposures: Vec<_> = plan.images.chunks(cameras).collect();
        assert_eq!((exposures[0][0].time_s, rig.camera_count()), (0.0, cameras));
        for exposure in &exposures {
            // The shutters of all cameras are released together.
            assert!(exposure.iter().enumerate().all(|(camera, image)| image.camera as usize == camera));
            assert!(
                exposure.iter().all(|image| (image.time_s, image.position_m) == (exposure[0].time_s, exposure[0].position_m))
            );
        }
        for pair in exposures.windows(2) {
            let (before, after) = (&pair[0][0], &pair[1][0]);
            assert!(after.time_s > before.time_s, "{} s, then {} s", before.time_s, after.time_s);
            let apart_m = (after.position_m - before.position_m).norm();
            assert!(apart_m > settings.search.image_spacing_m - 1e-6, "{apart_m} m apart");
        }
        let last_s = exposures[exposures.len() - 1][0].time_s;
        assert!((last_s - plan.metrics.profile_s).abs() < 1e-9, "{last_s} s of {} s", plan.metrics.profile_s);
        assert!(plan.metrics.profile_s >= plan.metrics.movement_s, "faster than {} m/s", settings.flight.cruise_speed_mps);
    }
}

#[test]
fn the_reported_profile_time_is_that_of_the_waypoints() {
    let (settings, plans) = plans();
    for (rig, plan) in plans {
        let path: Vec<Pose> =
            plan.waypoints.iter().map(|waypoint| Pose { position: waypoint.position_m, direction: waypoint.direction }).collect();
        let profile = Profile::new(&path, &rig, &settings.flight, &settings.dynamics);
        assert_eq!(plan.metrics.profile_s.to_bits(), profile.duration_s().to_bits(), "{}", rig.name);
    }
}

#[test]
fn the_battery_is_drawn_by_movement_and_turning() {
    // Worked out by hand: 10 minutes straight and 2 minutes of turns.
    for (name, expected) in [
        // (600 s * 185 W + 120 s * 200 W) / (89.2 Wh * 3600 s/h) = 135000 / 321120
        ("phantom4-rtk", Some(42.040358744395)),
        // (600 * 850 + 120 * 920) / (548 * 3600) = 620400 / 1972800
        ("m300-oblique", Some(31.447688564477)),
        // (600 * 115 + 120 * 125) / (77 * 3600) = 84000 / 277200
        ("mavic3e", Some(30.303030303030)),
        ("panoramic", None),
    ] {
        let drawn = Rig::preset(name).unwrap().battery.map(|battery| battery.percent(600.0, 120.0));
        assert!(
            drawn.zip(expected).map_or(drawn == expected, |(drawn, expected): (f64, f64)| (drawn - expected).abs() < 1e-9),
            "{drawn:?}"
        );
    }
    for (rig, plan) in plans().1 {
        let metrics = &plan.metrics;
        let expected = rig.battery.map(|battery| battery.percent(metrics.movement_s, metrics.turning_s));
        assert_eq!((metrics.battery_percent, expected.is_some()), (expected, rig.name != "panoramic"));
    }
}
