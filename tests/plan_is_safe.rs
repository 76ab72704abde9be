//! Every published plan is safe along its whole curve, by a check of its own: dense points against every triangle.

mod support;

use nalgebra::Point3;
use overfly::planner::{PlanError, StopToken, plan};
use overfly::settings::{NoFlySetting, Settings};
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use proptest::prelude::*;
use support::{options, session, small_block, small_settings, snapshot};

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
        let plan = plan(&snapshot, &settings, &options(seed, 80), &StopToken::default(), &mut |_| {}).expect("the block can be flown");
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
