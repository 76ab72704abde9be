//! Every published plan is safe along its whole curve, by a check of its own: dense points against every triangle.

mod support;

use nalgebra::{Point3, Vector3};
use overfly::camera::{Cameras, Rig, direction_of};
use overfly::field::Snapshot;
use overfly::planner::{Method, PlanError, PlanOptions, StopToken, plan};
use overfly::settings::{NoFlySetting, Settings};
use overfly::trajectory::plan::{Image, Plan};
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
        for leg in plan.waypoints.windows(2) {
            let (a, b) = (leg[0].position_m, leg[1].position_m);
            let steps = ((b - a).norm() / 0.5).ceil() as usize;
            for k in 0..=steps {
                let p = a + (b - a) * (k as f64 / steps as f64);
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
                    for (leg, images) in by_leg(&plan) {
                        let along = plan.waypoints[leg + 1].position_m - plan.waypoints[leg].position_m;
                        let azimuth = along.x.atan2(along.y);
                        for image in images {
                            let mount = &mounts[image.camera as usize];
                            let (yaw, pitch) = (azimuth + mount.yaw_deg.to_radians(), mount.pitch_deg.to_radians());
                            let axis = Vector3::new(yaw.sin() * pitch.cos(), yaw.cos() * pitch.cos(), pitch.sin());
                            prop_assert!((axis - image.direction.unwrap().into_inner()).norm() < 1e-9, "{} on leg {leg}", mount.name);
                            let ahead = Vector3::new(yaw.sin(), yaw.cos(), 0.0);
                            prop_assert!(image.up.z > -1e-9 && image.up.dot(&ahead) > 0.0 && image.up.dot(&axis).abs() < 1e-9);
                        }
                    }
                }
            }
        }
    }
}

/// The images taken on each leg, without those at the start of the flight: they lie on it in the order of the flight.
fn by_leg(plan: &Plan) -> Vec<(usize, Vec<Image>)> {
    let mut images = plan.images.iter().skip(plan.cameras.len());
    let mut legs = Vec::new();
    for (leg, ends) in plan.waypoints.windows(2).enumerate() {
        let mut of_leg = Vec::new();
        // Every leg ends with one image of each camera at its end.
        for image in images.by_ref() {
            of_leg.push(*image);
            let is_last = image.camera as usize + 1 == plan.cameras.len();
            if is_last && image.position_m == ends[1].position_m {
                break;
            }
        }
        assert!(of_leg.last().is_some_and(|image| image.position_m == ends[1].position_m), "leg {leg} has no image at its end");
        legs.push((leg, of_leg));
    }
    assert!(images.next().is_none(), "an image lies on no leg");
    legs
}

fn keeps_turning_limits(plan: &Plan, rig: &Rig, settings: &Settings) -> Result<(), TestCaseError> {
    let dynamics = &settings.dynamics;
    let most_rad_s = dynamics.yaw_rate_dps.min(dynamics.gimbal_rate_dps).to_radians().min(rig.blur_limit_rad_s);
    let most_rad_per_m = most_rad_s / settings.flight.cruise_speed_mps;
    prop_assert_eq!(plan.images[0].direction, plan.waypoints[0].direction);
    let mut before = plan.images[0];
    for (leg, images) in by_leg(plan) {
        let mut turned_rad = 0.0;
        for image in images {
            let turn_rad = before.direction.unwrap().angle(&image.direction.unwrap());
            let flown_m = (image.position_m - before.position_m).norm();
            prop_assert!(turn_rad <= flown_m * most_rad_per_m + 1e-7, "{turn_rad} rad on {flown_m} m of leg {leg}");
            turned_rad += turn_rad;
            before = image;
        }
        prop_assert!(turned_rad <= settings.search.view_turn_deg.to_radians() + 1e-6, "{turned_rad} rad on leg {leg}");
        prop_assert_eq!(before.direction, plan.waypoints[leg + 1].direction);
    }
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
