//! The times of images and flight, and what the flight draws from the battery, are those of the waypoints.

mod support;

use nalgebra::Point3;
use overfly::camera::{Pose, Rig, direction_of};
use overfly::planner::{Method, PlanOptions, StopToken, plan};
use overfly::scene::clearance::Clearance;
use overfly::search::spacing::ImageSpacing;
use overfly::settings::Settings;
use overfly::trajectory::images::{blur_px, expose};
use overfly::trajectory::limits::Limits;
use overfly::trajectory::plan::{Image, Plan};
use overfly::trajectory::profile::Profile;
use overfly::trajectory::route::Route;
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
            let apart_s = after.time_s - before.time_s;
            assert!(apart_s >= rig.shutter_interval_s - 2e-9, "{apart_s} s apart with {}", rig.name);
            // Round a corner the way is shorter than along the legs, but not by more than twice what its arc cuts off.
            let apart_m = (after.position_m - before.position_m).norm();
            assert!(apart_m > settings.search.image_spacing_m / 2.0, "{apart_m} m apart");
        }
        let last_s = exposures[exposures.len() - 1][0].time_s;
        assert!((last_s - plan.metrics.profile_s).abs() < 1e-9, "{last_s} s of {} s", plan.metrics.profile_s);
        assert!(plan.metrics.profile_s >= plan.metrics.movement_s, "faster than {} m/s", settings.flight.cruise_speed_mps);
    }
}

#[test]
fn images_lie_on_the_timed_curve_at_their_instants() {
    for (rig, plan) in plans().1 {
        let profile = plan.profile().expect("a plan says how it was timed");
        let mut off_legs = 0;
        for image in &plan.images {
            let off_m = (profile.at(image.time_s).unwrap().position_m - image.position_m).norm();
            assert!(off_m < 1e-6, "{off_m} m off at {} s with {}", image.time_s, rig.name);
            let nearest_m = plan.waypoints.iter().map(|w| (w.position_m - image.position_m).norm()).fold(f64::INFINITY, f64::min);
            off_legs += usize::from(1e-6 < nearest_m && nearest_m < 1.1);
        }
        assert!(off_legs > 0, "no image lies beside a corner: {}", rig.name);
    }
}

#[test]
fn a_shutter_that_is_not_ready_delays_an_image_or_leaves_it_out() {
    let Settings { flight, dynamics, .. } = Settings::default();
    let path: Vec<Pose> = [[0.0, 0.0], [80.0, 0.0], [149.28, 40.0]]
        .map(|[x, y]| Pose { position: Point3::new(x, y, 30.0), direction: None })
        .to_vec();
    // A bend of 30 degrees is flown at cruise speed, and its arc is shorter than two times 8 m: too short for one image a second.
    for (interval_s, is_changed) in [(0.7, [false, false]), (1.0, [true, false]), (1.3, [true, true])] {
        let rig = Rig { shutter_interval_s: interval_s, ..Rig::preset("panoramic").unwrap() };
        let profile = Profile::new(&path, &rig, &flight, &dynamics);
        let route = Route::continuous(&path, &rig, ImageSpacing::at_least(8.0));
        let exposed = expose(&route, &rig, &profile);
        assert_eq!(
            [exposed.delayed > 0, exposed.dropped > 0],
            is_changed,
            "{interval_s} s: {} {}",
            exposed.delayed,
            exposed.dropped
        );
        assert_eq!(exposed.images.len() + exposed.dropped as usize, route.exposures.len());
        for pair in exposed.images.windows(2) {
            assert!(pair[1].time_s - pair[0].time_s >= interval_s - 2e-9);
        }
        for image in &exposed.images {
            assert!((profile.at(image.time_s).unwrap().position_m - image.position_m).norm() < 1e-6);
        }
    }
}

#[test]
fn blur_is_the_way_flown_in_an_exposure_in_pixels_at_the_nearest_surface() {
    let Settings { flight, dynamics, .. } = Settings::default();
    let rig = Rig::preset("phantom4-rtk").unwrap();
    let path = [0.0, 200.0].map(|x| Pose { position: Point3::new(x, 0.0, 30.0), direction: Some(direction_of(90.0, -90.0)) });
    let profile = Profile::new(&path, &rig, &flight, &dynamics);
    let exposed = expose(&Route::continuous(&path, &rig, ImageSpacing::at_least(8.0)), &rig, &profile);
    // 8 m/s for 1 ms are 8 mm; a pixel of the Phantom spans 13.2 / 5472 / 8.8 of the 30 m above the ground: 8.22 mm.
    let over_ground = blur_px(&exposed, &rig, &Clearance::of_triangles(Vec::new()));
    assert!((over_ground - 0.008 / (30.0 * 13.2 / 5472.0 / 8.8)).abs() < 1e-9, "{over_ground}");
    let roof = [Point3::new(90.0, -9.0, 20.0), Point3::new(110.0, -9.0, 20.0), Point3::new(100.0, 9.0, 20.0)];
    assert!((blur_px(&exposed, &rig, &Clearance::of_triangles(vec![roof])) / over_ground - 3.0).abs() < 0.1);
}

#[test]
fn the_most_smeared_image_is_found_without_looking_far_from_all_others() {
    let (settings, plans) = plans();
    let free = snapshot(&session(small_block(5), &settings)).free;
    for (rig, plan) in plans {
        let rig = Rig { shutter_interval_s: 0.1, ..rig };
        let profile = plan.profile().expect("a plan says how it was timed");
        let exposed = expose(&Route::continuous(&plan.poses(), &rig, ImageSpacing::at_least(1.0)), &rig, &profile);
        let smear_px = |image: &Image| {
            let way_m = profile.at(image.time_s).unwrap().velocity_mps.norm() * rig.exposure_s;
            let nearest_m = free.clearance.point_distance_m(&image.position_m, image.position_m.z);
            way_m / rig.pixel_rad(image.camera as usize) / nearest_m
        };
        let most_px = exposed.images.iter().map(smear_px).fold(0.0, f64::max);
        assert!(exposed.images.len() > 500 && most_px > 0.0, "{}: {} images, {most_px} px", rig.name, exposed.images.len());
        let found_px = blur_px(&exposed, &rig, &free.clearance);
        assert!((found_px - most_px).abs() <= 1e-9 * most_px, "{}: {found_px} px, but {most_px} px", rig.name);
    }
}

#[test]
fn the_reported_profile_time_is_that_of_the_waypoints() {
    let (settings, plans) = plans();
    for (rig, plan) in plans {
        let path: Vec<Pose> =
            plan.waypoints.iter().map(|waypoint| Pose { position: waypoint.position_m, direction: waypoint.direction }).collect();
        let limits = Limits::new(&rig, &settings.flight, &settings.dynamics);
        let deviations_m: Vec<f64> = plan.waypoints.iter().map(|waypoint| waypoint.deviation_m).collect();
        let profile = Profile::rounded(&path, &limits, &deviations_m);
        assert_eq!(Some(&profile), plan.profile().as_ref());
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
