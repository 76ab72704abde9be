//! What every planning method promises, with every rig that it supports.

mod support;

use nalgebra::Point3;
use overfly::camera::Rig;
use overfly::planner::{Method, PlanError, PlanOptions, StopToken, plan};
use overfly::scene::Scene;
use overfly::session::Snapshot;
use overfly::settings::{NoFlySetting, Settings};
use overfly::trajectory::plan::{Plan, StopReason};
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use support::{session, small_block, small_settings, snapshot};

/// A zone in the middle of the block, higher than any flight.
fn settings() -> Settings {
    let mut settings = small_settings();
    settings.flight.legal_ceiling_m = 150.0;
    let outline_m = vec![[-15.0, -12.0], [12.0, -12.0], [12.0, 14.0], [-15.0, 14.0]];
    settings.flight.no_fly.push(NoFlySetting {
        name: "helipad".into(),
        outline_deg: vec![],
        outline_m,
        floor_m: 0.0,
        ceiling_m: 140.0,
    });
    settings
}

fn options(method: Method, rig: &str, seed: u64) -> PlanOptions {
    PlanOptions { iterations: Some(40), ..PlanOptions::new(Rig::preset(rig).expect("a preset"), method, seed) }
}

fn is_supported(method: Method, rig: &str) -> bool {
    rig != "m300-oblique" || matches!(method, Method::Refined | Method::Paper | Method::Oblique)
}

/// Every method with every preset that it supports.
fn supported() -> impl Iterator<Item = (Method, &'static str)> {
    let pairs = Method::ALL.into_iter().flat_map(|method| Rig::PRESETS.map(|rig| (method, rig)));
    pairs.filter(|&(method, rig)| is_supported(method, rig))
}

fn flown(snapshot: &Snapshot, options: &PlanOptions) -> Plan {
    plan(snapshot, &settings(), options, &StopToken::default(), &mut |_| {}).expect("the block can be flown")
}

/// By dense points against every triangle, not by the planner's own check.
fn assert_safe(plan: &Plan, scene: &Scene) {
    let single = |p: &Point3<f64>| Vector::new(p.x as f32, p.y as f32, p.z as f32);
    let triangles: Vec<_> = scene
        .structures
        .iter()
        .flat_map(|s| s.triangles())
        .map(|[a, b, c]| parry3d::shape::Triangle::new(single(&a), single(&b), single(&c)))
        .collect();
    for ends in plan.flown_points().windows(2) {
        let (a, b) = (ends[0].0, ends[1].0);
        let steps = (b - a).norm().ceil().max(1.0) as usize;
        for k in 0..=steps {
            let p = a + (b - a) * (k as f64 / steps as f64);
            let distance = triangles.iter().map(|t| t.distance_to_local_point(single(&p), false)).fold(f32::INFINITY, f32::min);
            assert!(f64::from(distance) >= 5.0 - 0.011, "{} of {}: {p} is {distance} m from a structure", plan.method, plan.rig);
            assert!((5.0..=150.0).contains(&p.z), "altitude {}", p.z);
            let inside = (-15.0..=12.0).contains(&p.x) && (-12.0..=14.0).contains(&p.y) && p.z <= 140.0;
            assert!(!inside, "{} of {}: {p} lies in the zone", plan.method, plan.rig);
            assert!(scene.structures.iter().all(|s| !s.contains(&p)), "{p} lies inside a structure");
        }
    }
}

#[test]
fn every_method_is_safe_shows_what_its_rig_can_frame_and_repeats_itself_on_any_number_of_threads() {
    let snapshot = snapshot(&session(small_block(3), &settings()));
    for (method, rig) in supported() {
        let options = options(method, rig, 7);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
            pool.install(|| flown(&snapshot, &options))
        };
        let plan = on(1);
        assert_eq!(plan, on(2), "{} with {rig}", method.name());
        assert_eq!((plan.method.as_str(), plan.rig.as_str()), (method.name(), rig));
        assert!(plan.waypoints.len() > 2 && !plan.images.is_empty(), "{} with {rig}", method.name());
        // High above everything a long lens may see too little of any sample twice.
        let captures = plan.metrics.coverage_percent > 0.0 || method == Method::Oblique && plan.metrics.information > 0.0;
        assert!(captures, "{} with {rig} captures nothing", method.name());
        assert!(plan.images.iter().all(|image| image.direction.is_none_or(|direction| options.rig.reaches(&direction))));
        assert!(plan.images.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s), "{} with {rig}", method.name());
        let has_goal = matches!(method, Method::Refined | Method::Paper);
        assert_eq!(plan.stop == StopReason::Complete, !has_goal);
        assert_safe(&plan, &snapshot.scene);
    }
}

#[test]
fn images_at_views_are_no_nearer_than_the_shutter_allows() {
    let snapshot = snapshot(&session(small_block(3), &settings()));
    for (method, rig) in supported().filter(|(method, _)| matches!(method, Method::Smith | Method::Zhou)) {
        let plan = flown(&snapshot, &options(method, rig, 1));
        for (index, image) in plan.images.iter().enumerate() {
            let nearest = plan.images[..index]
                .iter()
                .map(|other| (other.position_m - image.position_m).norm())
                .fold(f64::INFINITY, f64::min);
            // The views are 8 m apart; an image at a corner lies on its arc, within a metre of its view.
            assert!(nearest >= 8.0 - 2.0, "{} with {rig}: image {index} is {nearest} m from another", method.name());
        }
        for pair in plan.images.chunks(plan.cameras.len()).collect::<Vec<_>>().windows(2) {
            let apart_s = pair[1][0].time_s - pair[0][0].time_s;
            let interval_s = Rig::preset(rig).unwrap().shutter_interval_s;
            assert!(apart_s >= interval_s - 2e-9, "{} with {rig}: {apart_s} s apart", method.name());
        }
    }
}

#[test]
fn every_method_stops_when_told_and_reports_how_far_it_has_come() {
    let snapshot = snapshot(&session(small_block(3), &settings()));
    for (method, rig) in supported() {
        let stop = StopToken::default();
        let mut told = 0;
        let mut on_progress = |progress: &overfly::planner::Progress| {
            assert!(progress.iteration <= progress.iterations);
            told += 1;
            stop.stop();
        };
        let plan = plan(&snapshot, &settings(), &options(method, rig, 1), &stop, &mut on_progress).expect("a stop is no error");
        assert!(told > 0, "{} with {rig}", method.name());
        assert_eq!(plan.stop, StopReason::Cancelled, "{} with {rig}", method.name());
        assert!(!plan.waypoints.is_empty() && !plan.images.is_empty());
        assert_safe(&plan, &snapshot.scene);
    }
}

#[test]
fn an_abandoned_plan_is_none() {
    let snapshot = snapshot(&session(small_block(3), &settings()));
    for (method, rig) in supported().filter(|(_, rig)| *rig != "mavic3e") {
        let stop = StopToken::default();
        stop.abandon();
        let outcome = plan(&snapshot, &settings(), &options(method, rig, 1), &stop, &mut |_| {});
        assert!(matches!(outcome, Err(PlanError::Abandoned)), "{} with {rig}", method.name());
    }
}

#[test]
fn what_a_method_cannot_do_is_refused_with_the_remedy() {
    let snapshot = snapshot(&session(small_block(3), &settings()));
    let refusal = |settings: &Settings, method: Method, rig: &str| {
        let outcome = plan(&snapshot, settings, &options(method, rig, 1), &StopToken::default(), &mut |_| {});
        outcome.expect_err("it cannot be done").to_string()
    };
    for method in Method::ALL.into_iter().filter(|&method| !is_supported(method, "m300-oblique")) {
        let text = refusal(&settings(), method, "m300-oblique");
        assert!(text.contains("gimbal") && text.contains("phantom4-rtk") && text.contains(method.name()), "{text}");
    }
    let mut height = settings();
    height.baseline.op_height_m = 6.0;
    assert!(refusal(&height, Method::Oblique, "phantom4-rtk").contains("baseline.op_height_m"));
    let mut dense = settings();
    dense.search.image_spacing_m = 0.5;
    dense.flight.cruise_speed_mps = 0.1;
    dense.baseline.op_focal_mm = 150.0;
    dense.baseline.op_side_overlap = 0.95;
    dense.baseline.op_forward_overlap = 0.95;
    assert!(refusal(&dense, Method::Oblique, "m300-oblique").contains("baseline.op_focal_mm"));
}

#[test]
fn oblique_photography_needs_room_above_the_tallest_structure() {
    let mut settings = small_settings();
    let scene = small_block(3);
    settings.flight.legal_ceiling_m = scene.bounds().expect("the block has structures").max.z + 4.0;
    let snapshot = snapshot(&session(scene, &settings));
    let outcome = plan(&snapshot, &settings, &options(Method::Oblique, "phantom4-rtk", 1), &StopToken::default(), &mut |_| {});
    let text = outcome.expect_err("there is no room").to_string();
    assert!(text.contains("flight.legal_ceiling_m"), "{text}");
}

#[test]
fn oblique_images_have_the_field_of_view_of_the_lens_that_was_asked_for() {
    let snapshot = snapshot(&session(small_block(3), &settings()));
    let plan = flown(&snapshot, &options(Method::Oblique, "phantom4-rtk", 1));
    let expected_deg = [13.2f64, 8.8].map(|side_mm| (2.0 * (side_mm / 2.0 / 30.0).atan()).to_degrees());
    for image in &plan.images {
        let fov_deg = image.fov_deg.expect("a directed camera");
        assert!((0..2).all(|side| (fov_deg[side] - expected_deg[side]).abs() < 1e-9), "{fov_deg:?}");
    }
    assert_eq!(plan.cameras[0].intrinsics.map(|intrinsics| intrinsics.focal_mm), Some(30.0));
    let height_m = plan.waypoints[0].position_m.z;
    assert!(plan.waypoints.iter().all(|waypoint| waypoint.position_m.z == height_m));
}
