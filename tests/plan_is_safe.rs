//! Every published plan is safe along its whole curve, by a check of its own: dense points against every triangle.

mod support;

use nalgebra::{Point3, Vector3};
use overfly::camera::{Cameras, Rig, direction_of};
use overfly::field::Snapshot;
use overfly::planner::{Method, PlanError, PlanOptions, StopToken, plan};
use overfly::settings::{NoFlySetting, Settings};
use overfly::trajectory::plan::Plan;
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use proptest::prelude::*;
use support::{options, rigs, session, small_block, small_settings, snapshot};

fn single(p: &Point3<f64>) -> Vector {
    Vector::new(p.x as f32, p.y as f32, p.z as f32)
}

fn zone() -> NoFlySetting {
    let outline_m = vec![[-20.0, -20.0], [25.0, -20.0], [25.0, 15.0], [-20.0, 15.0]];
    NoFlySetting { name: "helipad".into(), outline_deg: vec![], outline_m, floor_m: 0.0, ceiling_m: 60.0 }
}

fn settings_with_zone() -> Settings {
    let mut settings = small_settings();
    settings.flight.no_fly.push(zone());
    settings.flight.legal_ceiling_m = 70.0;
    settings
}

fn plan_with(rig: &Rig, snapshot: &Snapshot, settings: &Settings, seed: u64) -> Plan {
    let options = PlanOptions { iterations: Some(80), ..PlanOptions::new(rig.clone(), Method::Paper, seed) };
    plan(snapshot, settings, &options, &StopToken::default(), &mut |_| {}).expect("the block can be flown")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn the_whole_curve_keeps_its_distance_its_altitudes_and_out_of_zones(block in 0u64..4, seed in 0u64..1000) {
        let settings = settings_with_zone();
        let scene = small_block(block);
        let triangles: Vec<_> = scene.structures.iter().flat_map(|s| s.triangles())
            .map(|[a, b, c]| parry3d::shape::Triangle::new(single(&a), single(&b), single(&c)))
            .collect();
        let snapshot = snapshot(&session(scene, &settings));
        let plan = plan_with(&rigs()[seed as usize % rigs().len()], &snapshot, &settings, seed);
        prop_assert!(plan.waypoints.len() > 2);
        let mut least = f64::INFINITY;
        let profile = plan.profile().expect("a plan says how it was timed");
        let steps = (profile.duration_s() / 0.05).ceil() as usize;
        {
            for k in 0..=steps {
                let p = profile.at(profile.duration_s() * k as f64 / steps as f64).unwrap().position_m;
                let distance = triangles.iter().map(|t| t.distance_to_local_point(single(&p), false)).fold(f32::INFINITY, f32::min);
                least = least.min(f64::from(distance)).min(p.z);
                prop_assert!(f64::from(distance) >= 5.0 - 1e-3, "{p} is {distance} m from a structure");
                prop_assert!((5.0..=70.0).contains(&p.z), "altitude {}", p.z);
                let inside = (-20.0..=25.0).contains(&p.x) && (-20.0..=15.0).contains(&p.y) && p.z <= 60.0;
                prop_assert!(!inside, "{p} lies in the zone");
                prop_assert!(snapshot.scene.structures.iter().all(|s| !s.contains(&p)), "{p} lies inside a structure");
            }
        }
        prop_assert!(plan.clearance_m <= least + 1e-3 && plan.clearance_m >= least - 0.5, "{} against {least}", plan.clearance_m);
        for (waypoint, arc) in plan.waypoints.iter().zip(&profile.curve().arcs) {
            let passed_m = (arc.at(arc.deviation_rad / 2.0).0 - waypoint.position_m).norm();
            prop_assert!(passed_m <= waypoint.deviation_m + 1e-9 && waypoint.deviation_m <= settings.dynamics.corner_deviation_m);
        }
    }

    #[test]
    fn no_camera_turns_beyond_its_gimbal_or_faster_than_its_limits(block in 0u64..4, seed in 0u64..1000) {
        let mut settings = small_settings();
        // Now the widest turn is what binds, now a slow gimbal, now the shutter.
        match seed % 3 {
            0 => settings.search.view_turn_deg = 60.0,
            1 => settings.dynamics.gimbal_rate_dps = 8.0,
            _ => settings.dynamics.yaw_rate_dps = 20.0,
        }
        let snapshot = snapshot(&session(small_block(block), &settings));
        for rig in rigs() {
            let plan = plan_with(&rig, &snapshot, &settings, seed);
            match &rig.cameras {
                Cameras::Panoramic { .. } => prop_assert!(plan.images.iter().all(|image| image.direction.is_none())),
                Cameras::Gimbal { sin_pitch, .. } => {
                    let [low_deg, high_deg] = sin_pitch.map(|sin| sin.asin().to_degrees());
                    for image in &plan.images {
                        let pitch_deg = image.direction.unwrap().z.asin().to_degrees();
                        prop_assert!((low_deg - 1e-5..=high_deg + 1e-5).contains(&pitch_deg), "{pitch_deg} by {}", rig.name);
                    }
                    keeps_turning_limits(&plan, &rig, &settings)?;
                }
                Cameras::Rigid(mounts) => {
                    let profile = plan.profile().unwrap();
                    for image in plan.images.iter().skip(mounts.len()) {
                        let ahead = profile.at(image.time_s).unwrap().velocity_mps;
                        if ahead.xy().norm() < 1e-3 {
                            continue;
                        }
                        let azimuth = ahead.x.atan2(ahead.y);
                        let mount = &mounts[image.camera as usize];
                        let (yaw, pitch) = (azimuth + mount.yaw_deg.to_radians(), mount.pitch_deg.to_radians());
                        let axis = Vector3::new(yaw.sin() * pitch.cos(), yaw.cos() * pitch.cos(), pitch.sin());
                        prop_assert!((axis - image.direction.unwrap().into_inner()).norm() < 1e-6, "{} at {} s", mount.name, image.time_s);
                        let ahead = Vector3::new(yaw.sin(), yaw.cos(), 0.0);
                        prop_assert!(image.up.z > -1e-9 && image.up.dot(&ahead) > 0.0 && image.up.dot(&axis).abs() < 1e-6);
                    }
                }
            }
        }
    }
}

fn keeps_turning_limits(plan: &Plan, rig: &Rig, settings: &Settings) -> Result<(), TestCaseError> {
    let dynamics = &settings.dynamics;
    let most_rad_s = dynamics.yaw_rate_dps.min(dynamics.gimbal_rate_dps).to_radians().min(rig.blur_limit_rad_s);
    prop_assert_eq!(plan.images[0].direction, plan.waypoints[0].direction);
    for pair in plan.images.windows(2) {
        let turn_rad = pair[0].direction.unwrap().angle(&pair[1].direction.unwrap());
        let flown_s = pair[1].time_s - pair[0].time_s;
        prop_assert!(turn_rad <= flown_s * most_rad_s + 1e-6, "{} rad in {} s before {} s", turn_rad, flown_s, pair[1].time_s);
    }
    for (leg, ends) in plan.waypoints.windows(2).enumerate() {
        let turn_rad = ends[0].direction.unwrap().angle(&ends[1].direction.unwrap());
        prop_assert!(turn_rad <= settings.search.view_turn_deg.to_radians() + 1e-6, "{} rad on leg {}", turn_rad, leg);
    }
    has_an_image_at_every_corner(plan)
}

/// Where an arc passes the corner, the camera looks as the waypoint says.
fn has_an_image_at_every_corner(plan: &Plan) -> Result<(), TestCaseError> {
    let profile = plan.profile().unwrap();
    let mut found = 1;
    for (leg, ends) in plan.waypoints.windows(2).enumerate() {
        let passed = profile.passing(leg, (ends[1].position_m - ends[0].position_m).norm()).unwrap();
        let image = plan.images.iter().find(|image| (image.time_s - passed.time_s).abs() < 1e-9);
        found += usize::from(image.is_some());
        if let Some(image) = image {
            prop_assert_eq!(image.direction, ends[1].direction);
            prop_assert!((image.position_m - passed.position_m).norm() < 1e-9);
            prop_assert!((image.position_m - ends[1].position_m).norm() <= ends[1].deviation_m + 1e-9);
        }
    }
    let shifted = (plan.metrics.delayed_exposures + plan.metrics.dropped_exposures) as usize;
    prop_assert!(found + shifted >= plan.waypoints.len(), "{} of {} corners, {} shifted", found, plan.waypoints.len(), shifted);
    Ok(())
}

#[test]
fn a_start_that_cannot_be_flown_is_refused_with_its_reason() {
    let settings = settings_with_zone();
    let scene = small_block(0);
    let inside = scene.structures[0].triangles()[0].iter().fold(Point3::origin(), |sum, p| sum + p.coords / 3.0);
    let snapshot = snapshot(&session(scene, &settings));
    for (start, reason) in [
        (Point3::new(inside.x, inside.y, 6.0), "inside the structure"),
        (Point3::new(0.0, 0.0, 500.0), "outside of the flight limits"),
        (Point3::new(f64::NAN, 0.0, 40.0), "not a finite position"),
    ] {
        let mut options = options(1, 10);
        options.start_m = Some(start);
        let error = plan(&snapshot, &settings, &options, &StopToken::default(), &mut |_| {}).expect_err("the start is bad");
        assert!(matches!(error, PlanError::Start { .. }) && error.to_string().contains(reason), "{error}");
    }
}

#[test]
fn a_view_at_the_start_is_flown_or_refused() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(0), &settings));
    let options = |rig: &Rig, pitch_deg: f64| PlanOptions {
        iterations: Some(5),
        start_view: Some(direction_of(30.0, pitch_deg)),
        ..PlanOptions::new(rig.clone(), Method::Paper, 1)
    };
    for rig in rigs().iter().filter(|rig| rig.has_gimbal()) {
        let plan = plan(&snapshot, &settings, &options(rig, -35.0), &StopToken::default(), &mut |_| {}).expect("a good view");
        assert_eq!(plan.waypoints[0].direction, Some(direction_of(30.0, -35.0)));
        assert_eq!(plan.images[0].direction, Some(direction_of(30.0, -35.0)));
    }
    let narrow = &rigs()[4];
    for pitch_deg in [-5.0, -61.0, 80.0] {
        let error =
            plan(&snapshot, &settings, &options(narrow, pitch_deg), &StopToken::default(), &mut |_| {}).expect_err("beyond");
        assert!(matches!(error, PlanError::StartView { .. }) && error.to_string().contains("narrow"), "{error}");
    }
    for rigid in ["panoramic", "m300-oblique"].map(|name| Rig::preset(name).unwrap()) {
        let error =
            plan(&snapshot, &settings, &options(&rigid, -35.0), &StopToken::default(), &mut |_| {}).expect_err("no gimbal");
        assert!(matches!(error, PlanError::NoGimbal { .. }) && error.to_string().contains(&rigid.name), "{error}");
    }
}
