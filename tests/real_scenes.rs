//! The whole pipeline on real towns: what a plan reports is what its images really capture, and nothing of it is unsafe.

mod support;

use nalgebra::Point3;
use overfly::camera::Rig;
use overfly::coverage::{DiskModel, SampleFrame};
use overfly::planner::{Method, PlanOptions, flown_rig};
use overfly::planner::{StopToken, plan};
use overfly::session::Snapshot;
use overfly::settings::Settings;
use overfly::trajectory::plan::{Plan, StopReason};
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use parry3d::shape::Triangle;
use support::{check_updates, crosses, options, real_scene, rig_options, session, snapshot};

fn check_town(file: &str) {
    let Some(path) = real_scene(file) else { return };
    let settings = Settings::default();
    let bytes = std::fs::read(&path).expect("the scene can be read");
    let (scene, _) = overfly::scene::read(&path.to_string_lossy(), &bytes, &settings.proxy).expect("a real town can be imported");
    let snapshot = snapshot(&session(scene, &settings));
    let plan =
        plan(&snapshot, &settings, &options(1, 150), &StopToken::default(), &mut |_| {}).expect("a real town can be flown");
    println!(
        "{}: {} structures, ceiling {:.1} %, captured {:.1} % of the capturable, {:.0} m",
        plan.scene.name,
        snapshot.scene.structures.len(),
        plan.metrics.capturable_percent,
        plan.metrics.coverage_percent,
        plan.metrics.length_m
    );
    assert!(plan.waypoints.len() > 5 && plan.images.len() > plan.waypoints.len());
    check_capture(&snapshot, &settings, &plan);
    check_distances(&snapshot, &settings, &plan);
}

fn check_updates_of(file: &str, edits: usize) {
    let Some(path) = real_scene(file) else { return };
    let settings = Settings::default();
    let bytes = std::fs::read(&path).expect("the scene can be read");
    let (scene, _) = overfly::scene::read(&path.to_string_lossy(), &bytes, &settings.proxy).expect("a real town can be imported");
    let made = check_updates(scene, &settings, edits, 7);
    assert!(made * 4 >= edits * 3, "{made} of {edits}");
}

/// One quarter in four formats: the flights take about as long at the same goals. The meshes are one body for each row of houses, so that samples and the
/// search differ, and with 60 rounds the flights of one format differ as much: the city model's takes 664 s, the meshes' 673 to 733 s.
#[test]
fn four_formats_of_one_quarter_are_flown_alike() {
    let settings = Settings::default();
    let rig = Rig::preset("panoramic").expect("a preset");
    let goals =
        PlanOptions { goal_percent: Some(90.0), matched_percent: Some(80.0), ..PlanOptions::new(rig, Method::Refined, 1) };
    let wanted = PlanOptions { iterations: Some(60), ..goals };
    let mut flown = Vec::new();
    for file in ["delfshaven.city.json", "delfshaven_mesh.obj", "delfshaven_mesh.ply", "delfshaven_mesh.glb"] {
        let Some(path) = real_scene(&format!("delfshaven/{file}")) else { return };
        let bytes = std::fs::read(&path).expect("the scene can be read");
        let (scene, _) = overfly::scene::read(file, &bytes, &settings.proxy).expect("it can be imported");
        let snapshot = snapshot(&session(scene, &settings));
        let plan = plan(&snapshot, &settings, &wanted, &StopToken::default(), &mut |_| {}).expect("it can be flown");
        println!("{file}: {:.1} % captured in {:.0} s", plan.metrics.coverage_percent, plan.metrics.profile_s);
        assert!((89.9..92.0).contains(&plan.metrics.coverage_percent));
        flown.push(plan.metrics.profile_s);
    }
    let (shortest, longest) = flown.iter().fold((f64::MAX, 0.0f64), |(least, most), &s| (least.min(s), most.max(s)));
    assert!(longest <= 1.15 * shortest, "{flown:?}");
}

#[test]
fn fields_of_real_towns_follow_edits_bit_for_bit() {
    check_updates_of("nihonbashi/buildings.geojson", 140);
    check_updates_of("delfshaven/delfshaven.city.json", 120);
}

/// Recounts the cells of every hundredth sample image by image, with a ray against every triangle.
fn check_capture(snapshot: &Snapshot, settings: &Settings, plan: &Plan) {
    let (field, disks) = (snapshot.field(), DiskModel::new(&settings.coverage));
    let triangles: Vec<_> = snapshot.scene.structures.iter().flat_map(|structure| structure.triangles()).collect();
    let mut seen = 0;
    for (i, row) in field.samples.iter().enumerate().step_by(100).filter(|(_, row)| row.exposed == 1) {
        let sample = SampleFrame::new(row.position_m.into(), row.normal.into());
        let end = sample.position + sample.normal * settings.surface.exposure_offset_m;
        let mut cells = 0u128;
        for image in &plan.images {
            if disks.faces(&sample, &image.position_m) && !triangles.iter().any(|t| crosses(&image.position_m, &end, t)) {
                cells |= disks.exact_mask(&sample, &image.position_m);
            }
        }
        assert_eq!(u32::from(plan.cells[i]), cells.count_ones(), "sample {i}");
        seen += cells.count_ones();
    }
    assert!(seen > 0, "the recount saw something");
    let above = |cells: u16| u32::from(cells) > field.facts.threshold_cells;
    let exposed = field.samples.iter().filter(|row| row.exposed == 1).count() as f64;
    let captured = plan.cells.iter().filter(|&&cells| above(cells)).count() as f64;
    assert!((plan.metrics.coverage_exposed_percent - 100.0 * captured / exposed).abs() < 1e-9);
}

/// Walks along the curve and measures with parry's own triangles, one by one.
fn check_distances(snapshot: &Snapshot, settings: &Settings, plan: &Plan) {
    let single = |p: &Point3<f64>| Vector::new(p.x as f32, p.y as f32, p.z as f32);
    let triangles: Vec<Triangle> = snapshot
        .scene
        .structures
        .iter()
        .flat_map(|structure| structure.triangles())
        .map(|[a, b, c]| Triangle::new(single(&a), single(&b), single(&c)))
        .collect();
    let profile = plan.profile().expect("a plan says how it was timed");
    for piece in profile.pieces() {
        // Fast or slow, no more than 4 m from point to point.
        let steps = ((piece.end_s - piece.start_s) * settings.flight.cruise_speed_mps / 4.0).ceil().max(1.0);
        for k in 0..=steps as usize {
            let p = profile.at(piece.start_s + (piece.end_s - piece.start_s) * (k as f64 / steps)).unwrap().position_m;
            let distances = triangles.iter().map(|triangle| triangle.distance_to_local_point(single(&p), false));
            let distance_m = f64::from(distances.fold(f32::INFINITY, f32::min)).min(p.z);
            assert!(distance_m >= settings.flight.safety_distance_m - 1e-3, "{p} is {distance_m} m from a structure");
            assert!(distance_m >= plan.clearance_m - 1e-3, "{p}: {distance_m} m is less than the plan says");
            assert!(snapshot.scene.structures.iter().all(|structure| !structure.contains(&p)), "{p} lies inside a structure");
        }
    }
}

#[test]
fn real_scene_delfshaven() {
    check_town("delfshaven/delfshaven.city.json");
}

#[test]
fn real_scene_nihonbashi() {
    check_town("nihonbashi/buildings.geojson");
}

#[test]
fn real_scene_manhattan() {
    check_town("manhattan/buildings.geojson");
}

#[test]
fn real_scene_marunouchi() {
    check_town("marunouchi/buildings.geojson");
}

#[test]
fn real_scene_delft_campus() {
    check_town("delft-campus/3dbag_5910_lod22.city.json");
}

/// A flight of another rig or method over a real town: safe, the same twice, and not far below what it captured when this was written.
fn check_flight(file: &str, options: &PlanOptions, least_percent: f64) -> Option<Plan> {
    let path = real_scene(file)?;
    let settings = Settings::default();
    let settings = settings.clone().with_sight(flown_rig(options, &settings).sight_scale());
    let bytes = std::fs::read(&path).expect("the scene can be read");
    let (scene, _) = overfly::scene::read(&path.to_string_lossy(), &bytes, &settings.proxy).expect("a real town can be imported");
    let snapshot = snapshot(&session(scene, &settings));
    let fly = || plan(&snapshot, &settings, options, &StopToken::default(), &mut |_| {}).expect("a real town can be flown");
    let plan = fly();
    println!(
        "{file}, {} by {}: ceiling {:.1} %, captured {:.1} % of the capturable, {:.0} m, {} images",
        plan.method,
        plan.rig,
        plan.metrics.capturable_percent,
        plan.metrics.coverage_percent,
        plan.metrics.length_m,
        plan.images.len()
    );
    assert!(plan.metrics.coverage_percent >= least_percent, "{} %", plan.metrics.coverage_percent);
    assert_eq!(plan.images.len() % options.rig.camera_count(), 0);
    check_views(&snapshot, &flown_rig(options, &settings), &plan);
    check_distances(&snapshot, &settings, &plan);
    assert_eq!(fly(), plan, "the same flight again");
    Some(plan)
}

/// Every image lies on the path, looks where the rig can look, and comes after the one before.
fn check_views(snapshot: &Snapshot, rig: &Rig, plan: &Plan) {
    let profile = plan.profile().expect("a plan says how it was timed");
    for image in &plan.images {
        let direction = image.direction.expect("these cameras look somewhere");
        assert!(!rig.has_gimbal() || rig.reaches(&direction), "{direction:?}");
        let off_m = (image.position_m - profile.at(image.time_s).unwrap().position_m).norm();
        assert!(off_m < 1e-6, "{} is not on the path", image.position_m);
        assert!(snapshot.free.obstruction_at(&image.position_m).is_none());
    }
    assert!(plan.images.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s));
}

#[test]
fn real_scene_delfshaven_by_a_camera_on_a_gimbal() {
    check_flight("delfshaven/delfshaven.city.json", &rig_options("phantom4-rtk", 1, 150), 25.0);
}

#[test]
fn real_scene_delfshaven_by_five_bolted_cameras() {
    let plan = check_flight("delfshaven/delfshaven.city.json", &rig_options("m300-oblique", 1, 150), 20.0);
    assert!(plan.is_none_or(|plan| plan.images.iter().any(|image| image.camera == 4)));
}

#[test]
fn real_scene_nihonbashi_by_a_camera_on_a_gimbal() {
    check_flight("nihonbashi/buildings.geojson", &rig_options("phantom4-rtk", 1, 150), 12.0);
}

#[test]
fn real_scene_refined_flights_reach_their_goals() {
    for (file, rig, rounds, goal_percent) in [
        ("delfshaven/delfshaven.city.json", "phantom4-rtk", 160, 70.0),
        ("delfshaven/delfshaven.city.json", "m300-oblique", 160, 50.0),
        ("nihonbashi/buildings.geojson", "phantom4-rtk", 240, 60.0),
    ] {
        let options = PlanOptions { method: Method::Refined, goal_percent: Some(goal_percent), ..rig_options(rig, 1, rounds) };
        let plan = check_flight(file, &options, goal_percent);
        assert!(plan.is_none_or(|plan| plan.stop == StopReason::GoalReached), "{file} by {rig}");
    }
}

/// A flight over a city takes more images than the counter of a cell holds, 2^14: they do not end the search.
#[test]
fn real_scene_tokyo_is_flown_whole() {
    let Some(path) = real_scene("tokyo-2km/buildings.geojson") else { return };
    let mut settings = Settings::default();
    (settings.surface.samples, settings.field.viewpoints) = (20_000, 20_000);
    let bytes = std::fs::read(&path).expect("the scene can be read");
    let (scene, _) = overfly::scene::read("tokyo.geojson", &bytes, &settings.proxy).expect("a real town can be imported");
    let snapshot = snapshot(&session(scene, &settings));
    let options = PlanOptions { method: Method::Refined, ..options(1, 200) };
    let plan = plan(&snapshot, &settings, &options, &StopToken::default(), &mut |_| {}).expect("a city can be flown");
    println!("tokyo-2km: captured {:.1} %, {} images", plan.metrics.coverage_percent, plan.images.len());
    assert!(plan.images.len() > 1 << 14 && plan.metrics.coverage_percent > 80.0);
}

#[test]
fn real_scene_delfshaven_by_oblique_photography() {
    let of = |rig| PlanOptions { method: Method::Oblique, ..rig_options(rig, 1, 1) };
    check_flight("delfshaven/delfshaven.city.json", &of("phantom4-rtk"), 20.0);
    check_flight("delfshaven/delfshaven.city.json", &of("m300-oblique"), 40.0);
}

#[test]
fn real_scene_powerplant_after_zhou() {
    let zhou = PlanOptions { method: Method::Zhou, ..rig_options("phantom4-rtk", 1, 1) };
    check_flight("powerplant/powerplant.obj", &zhou, 60.0);
}

#[test]
fn real_scene_powerplant_by_five_bolted_cameras() {
    check_flight("powerplant/powerplant.obj", &rig_options("m300-oblique", 1, 150), 25.0);
}
