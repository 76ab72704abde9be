//! What the data of a page say.

use std::collections::HashSet;
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use geo::polygon;
use serde_json::Value;

use super::*;
use crate::camera::Rig;
use crate::planner::{self, Conduct, Method, PlanOptions};
use crate::scene::terrain::tests::hill;
use crate::scene::{BlockSettings, NoFlyZone, Scene, Shape, Structure, StructureId, TERRAIN_NAME, ZoneSource, generate_block};
use crate::session::{Session, Snapshot};
use crate::settings::Settings;
use crate::stop::StopToken;
use crate::trajectory::plan::Plan;

fn settings() -> Settings {
    let mut settings = Settings::default();
    (settings.surface.samples, settings.field.viewpoints) = (200, 250);
    settings
}

fn block() -> Scene {
    generate_block(&BlockSettings { seed: 3, extent_m: [120.0, 120.0], buildings: 8, ..Default::default() })
}

fn snapshot(scene: Scene) -> Snapshot {
    let stop = StopToken::default();
    let session = Session::new(scene, Arc::new(settings()), &stop).unwrap();
    session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).unwrap()
}

fn made(snapshot: &Snapshot, rig: &str) -> planner::Made {
    let options = PlanOptions { iterations: Some(30), ..PlanOptions::new(Rig::preset(rig).unwrap(), Method::Paper, 1) };
    planner::replan(snapshot, &settings(), &options, None, Conduct::unheard(&StopToken::default())).unwrap()
}

fn json(data: &[u8]) -> Value {
    serde_json::from_slice(data).unwrap()
}

fn f32s(value: &Value) -> Vec<f64> {
    let bytes = STANDARD.decode(value.as_str().unwrap()).unwrap();
    bytes.chunks_exact(4).map(|four| f64::from(f32::from_le_bytes(four.try_into().unwrap()))).collect()
}

fn u32s(value: &Value) -> Vec<u32> {
    u8s(value).chunks_exact(4).map(|four| u32::from_le_bytes(four.try_into().unwrap())).collect()
}

fn u8s(value: &Value) -> Vec<u8> {
    STANDARD.decode(value.as_str().unwrap()).unwrap()
}

/// Captured and capturable samples at a time; times have the digits of an f32.
fn captured_until(coverage: &Value, time_s: f64) -> [usize; 2] {
    let capturable = u8s(&coverage["capturable"]);
    let captured = f32s(&coverage["captured_s"]);
    let is_captured = |i: &usize| (0.0..=time_s + 1e-3).contains(&captured[*i]);
    let counts = (0..captured.len()).filter(|i| capturable[*i] == 1);
    [counts.clone().filter(is_captured).count(), counts.count()]
}

fn coverage_percent(plan: &Plan) -> f64 {
    plan.metrics.coverage_percent
}

#[test]
fn what_is_captured_in_the_end_is_what_the_plan_says_by_rays_and_by_rows() {
    let snapshot = snapshot(block());
    for rig in ["panoramic", "m300-oblique"] {
        let made = made(&snapshot, rig);
        let (field, plan) = (snapshot.field(), &made.plan);
        let rays = Sighted::by_rays(&field, plan, made.record.sightings()).unwrap();
        let rows = Sighted::by_field(&field, plan, Some(false)).unwrap();
        let flights = [flight("rays", plan, Some(rays)), flight("rows", plan, Some(rows))];
        let data = json(&data(&Scene3d::of_scene(&snapshot.scene), &flights));
        assert_eq!(data["surfaces"].as_array().map(Vec::len), Some(1), "both have the same samples");
        let [rays, rows] = [0, 1].map(|k| &data["flights"][k]["coverage"]);
        assert_eq!((&rays["by"], &rows["by"]), (&"rays".into(), &"field".into()));
        let duration_s = data["flights"][0]["duration_s"].as_f64().unwrap();
        for coverage in [rays, rows] {
            let [captured, capturable] = captured_until(coverage, duration_s);
            assert!((100.0 * captured as f64 / capturable as f64 - coverage_percent(plan)).abs() < 1e-9, "{rig}");
            let [early, _] = captured_until(coverage, 0.4 * duration_s);
            assert!(0 < early && early < captured, "{rig}: {early} of {captured} after two fifths");
        }
        // Rows are those of a viewpoint some metres off: the curves differ a little, not much.
        let apart = (0..10).map(|k| {
            let at = |coverage: &Value| captured_until(coverage, duration_s * f64::from(k) / 10.0)[0] as f64;
            (at(rays) - at(rows)).abs()
        });
        let most = apart.fold(0.0, f64::max);
        assert!(most < 0.1 * captured_until(rays, duration_s)[1] as f64, "{rig}: {most}");
    }
}

#[test]
fn a_sample_is_seen_before_it_is_captured_and_at_the_time_of_an_image() {
    let snapshot = snapshot(block());
    let made = made(&snapshot, "phantom4-rtk");
    let sighted = Sighted::by_rays(&snapshot.field(), &made.plan, made.record.sightings()).unwrap();
    let data = json(&data(&Scene3d::of_scene(&snapshot.scene), &[flight("a", &made.plan, Some(sighted))]));
    let coverage = &data["flights"][0]["coverage"];
    let times: HashSet<u32> = made.plan.images.iter().map(|image| (image.time_s as f32).to_bits()).collect();
    let (seen, captured, r) = (f32s(&coverage["seen_s"]), f32s(&coverage["captured_s"]), f32s(&coverage["r_percent"]));
    let threshold = coverage["threshold_percent"].as_f64().unwrap();
    assert!(captured.iter().any(|time_s| *time_s > 0.0) && captured.iter().any(|time_s| *time_s < 0.0));
    for i in 0..seen.len() {
        assert_eq!(captured[i] >= 0.0, r[i] > threshold, "sample {i}");
        assert_eq!(seen[i] >= 0.0, r[i] > 0.0, "sample {i}");
        assert!(captured[i] < 0.0 || (0.0..=captured[i]).contains(&seen[i]), "sample {i}");
        let is_of_image = |time_s: f64| time_s < 0.0 || times.contains(&(time_s as f32).to_bits());
        assert!(is_of_image(seen[i]) && is_of_image(captured[i]), "sample {i}");
    }
}

#[test]
fn a_plan_of_another_field_is_refused() {
    let (field, other) = (snapshot(block()), snapshot(generate_block(&BlockSettings { seed: 9, ..Default::default() })));
    let made = made(&field, "panoramic");
    assert!(Sighted::by_field(&other.field(), &made.plan, None).is_err());
    assert!(Sighted::by_rays(&other.field(), &made.plan, made.record.sightings()).is_err());
}

/// Volume within triangles that point outwards; those on the ground have no floor and need none, being at z = 0.
fn volume_m3(data: &Value) -> f64 {
    let corners = f32s(&data["corners"]);
    let indices = u8s(&data["triangles"]);
    let corner = |bytes: &[u8]| {
        let k = 3 * u32::from_le_bytes(bytes.try_into().unwrap()) as usize;
        nalgebra::Vector3::new(corners[k], corners[k + 1], corners[k + 2])
    };
    indices
        .chunks_exact(12)
        .map(|three| {
            let [a, b, c] = [0, 4, 8].map(|k| corner(&three[k..k + 4]));
            a.cross(&b).dot(&c) / 6.0
        })
        .sum()
}

#[test]
fn outlines_of_a_field_are_extruded_to_the_solids_of_its_scene() {
    let mut scene = block();
    let ring = polygon!(exterior: [(x: 200.0, y: 0.0), (x: 240.0, y: 0.0), (x: 240.0, y: 30.0), (x: 200.0, y: 30.0)],
        interiors: [[(x: 210.0, y: 10.0), (x: 210.0, y: 20.0), (x: 230.0, y: 20.0), (x: 230.0, y: 10.0)]]);
    let shape = Shape::Prism { footprint: ring.into(), base_m: 0.0, top_m: 12.0 };
    scene.structures.push(Arc::new(Structure { id: StructureId(u64::MAX), name: "court".to_owned(), shape }));
    let snapshot = snapshot(scene);
    let data = [Scene3d::of_scene(&snapshot.scene), Scene3d::of_field(&snapshot.field())];
    let [scene, field] = data.map(|drawn| serde_json::to_value(drawn).unwrap());
    assert!(
        (volume_m3(&scene) - volume_m3(&field)).abs() < 1e-3 * volume_m3(&scene),
        "{} {}",
        volume_m3(&scene),
        volume_m3(&field)
    );
    assert_eq!((&scene["is_exact"], &field["is_exact"]), (&true.into(), &false.into()));
    let ids = |drawn: &Value| drawn["structures"].as_array().unwrap().iter().map(|body| body["id"].clone()).collect::<Vec<_>>();
    assert_eq!(ids(&scene), ids(&field));
    assert!(ids(&scene).contains(&u64::MAX.to_string().into()), "an id keeps all its digits");
}

#[test]
fn obstacles_terrain_and_zones_are_told_apart() {
    let mut scene = block();
    let pole = Shape::obstacle_box([0.0, 0.0, 20.0].into(), [1.0, 1.0, 40.0], 0.3);
    scene.structures.push(Arc::new(Structure { id: StructureId(u64::MAX), name: "pole".to_owned(), shape: pole }));
    let outline: geo::MultiPolygon<f64> = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 0.0, y: 9.0)].into();
    let zone = |ceiling_m| NoFlyZone {
        name: "closed".to_owned(),
        outline: outline.clone(),
        floor_m: 5.0,
        ceiling_m,
        source: ZoneSource::File,
    };
    scene.zones = vec![zone(60.0), zone(f64::MAX)];
    let snapshot = snapshot(scene);
    for drawn in [Scene3d::of_scene(&snapshot.scene), Scene3d::of_field(&snapshot.field())] {
        let drawn = serde_json::to_value(drawn).unwrap();
        let kind = |name: &str| {
            drawn["structures"].as_array().unwrap().iter().find(|body| body["name"] == name).map(|body| &body["kind"])
        };
        assert_eq!(kind("pole"), Some(&"obstacle".into()));
    }
    for drawn in [Scene3d::of_scene(&snapshot.scene).within(&snapshot.free, 120.0), Scene3d::of_field(&snapshot.field())] {
        let drawn = serde_json::to_value(drawn).unwrap();
        assert_eq!(drawn["ceiling_m"], 120.0);
        let zones = drawn["zones"].as_array().unwrap();
        let of_zones = |key: &str| zones.iter().map(|zone| zone[key].clone()).collect::<Vec<_>>();
        assert_eq!(of_zones("name"), ["closed", "closed"]);
        assert_eq!((of_zones("floor_m"), of_zones("ceiling_m")), (vec![5.0.into(); 2], vec![60.0.into(), Value::Null]));
        let areas = zones.iter().map(|zone| f32s(&zone["area"]));
        let twice_m2 = |area: Vec<f64>| {
            let [a, b, c] = [0, 2, 4].map(|k| [area[k], area[k + 1]]);
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        assert_eq!(areas.map(twice_m2).collect::<Vec<_>>(), [81.0, 81.0]);
    }
}

#[test]
fn a_field_draws_the_ground_of_its_scene() {
    let mut scene = block();
    let name = TERRAIN_NAME.to_owned();
    let shape = Shape::Terrain(hill(20.0, 200.0, 900.0, 15.0).into());
    scene.structures.push(Structure { id: StructureId::of_name(&name), name, shape }.into());
    scene.structures.sort_by_key(|structure| structure.id);
    let snapshot = snapshot(scene);
    let data = [Scene3d::of_scene(&snapshot.scene), Scene3d::of_field(&snapshot.field())];
    let [scene, field] = data.map(|drawn| serde_json::to_value(drawn).unwrap());
    let ground = |drawn: &Value| {
        let bodies = drawn["structures"].as_array().unwrap().clone();
        bodies.into_iter().find(|body| body["kind"] == "terrain").expect("the ground is drawn")
    };
    assert!(ground(&scene)["triangles"].as_u64() > Some(100));
    assert_eq!(ground(&scene), ground(&field));
    let corners_of_ground = |drawn: &Value| {
        let bodies = drawn["structures"].as_array().unwrap();
        let triangles = |body: &Value| body["triangles"].as_u64().unwrap() as usize;
        let first: usize = bodies.iter().take_while(|body| body["kind"] != "terrain").map(triangles).sum();
        let (corners, indices) = (f32s(&drawn["corners"]), u32s(&drawn["triangles"]));
        let own = indices[3 * first..][..3 * triangles(&ground(drawn))].iter();
        own.flat_map(|&index| corners[3 * index as usize..][..3].to_vec()).collect::<Vec<f64>>()
    };
    assert!(corners_of_ground(&scene).chunks(3).any(|corner| corner[2] > 15.0), "there is a hill");
    assert_eq!(corners_of_ground(&scene), corners_of_ground(&field));
}

#[test]
fn no_name_ends_the_element_that_holds_the_data() {
    let mut scene = block();
    scene.name = "</script><script>alert(1)</script><!--".to_owned();
    let plan = crate::mission::fixture::plan("phantom4-rtk", &[[0.0, 0.0, 30.0], [40.0, 0.0, 30.0], [40.0, 50.0, 40.0]]);
    let data = data(&Scene3d::of_scene(&scene), &[flight("</SCRIPT >", &plan, None)]);
    assert!(!data.contains(&b'<'));
    let data = json(&data);
    assert_eq!((&data["scenes"][0]["name"], &data["flights"][0]["label"]), (&scene.name.into(), &"</SCRIPT >".into()));
}

#[test]
fn flights_through_the_same_scene_share_it_and_others_bring_theirs() {
    let plan = crate::mission::fixture::plan("panoramic", &[[0.0, 0.0, 30.0], [40.0, 0.0, 30.0]]);
    let scene = Scene3d::of_scene(&block());
    let same = flight("same", &plan, None).through(scene.clone());
    let other = flight("other", &plan, None).through(scene.clone().called("later", 2));
    let data = json(&data(&scene, &[flight("own", &plan, None), same, other]));
    let scenes: Vec<&Value> = data["flights"].as_array().unwrap().iter().map(|flight| &flight["scene"]).collect();
    assert_eq!((scenes, data["scenes"].as_array().map(Vec::len)), (vec![&0.into(), &0.into(), &1.into()], Some(2)));
}

#[test]
fn the_path_is_that_of_the_profile_and_sorties_follow_each_other() {
    let corners: Vec<[f64; 3]> = (0..60).map(|k| [f64::from(k % 8) * 90.0, f64::from(k) * 12.0, 40.0]).collect();
    let plan = crate::mission::fixture::plan("phantom4-rtk", &corners);
    let data = json(&data(&Scene3d::empty("town", plan.scene.origin), &[flight("a", &plan, None)]));
    let flight = &data["flights"][0];
    let profile = plan.profile().unwrap();
    let (times, positions) = (f32s(&flight["path"]["times_s"]), f32s(&flight["path"]["positions_m"]));
    assert!((times.last().unwrap() - profile.duration_s()).abs() < 1e-2);
    for k in (0..times.len()).step_by(7) {
        let at = profile.at(times[k]).unwrap().position_m;
        assert!((nalgebra::Point3::new(positions[3 * k], positions[3 * k + 1], positions[3 * k + 2]) - at).norm() < 0.02);
    }
    let sorties = flight["sorties"].as_array().unwrap();
    assert!(sorties.len() > 1, "{sorties:?}");
    for pair in sorties.windows(2) {
        assert_eq!(pair[0]["last_waypoint"], pair[1]["first_waypoint"]);
        assert_eq!(pair[0]["end_s"], pair[1]["start_s"]);
    }
    assert_eq!(sorties[0]["start_s"], 0.0);
    let second = sorties[1]["first_waypoint"].as_u64().unwrap() as usize;
    assert_eq!(sorties[1]["start_s"].as_f64(), Some(profile.time_at_s(second, 0.0)));
    let end_s = sorties.last().unwrap()["end_s"].as_f64().unwrap();
    assert!((end_s - profile.duration_s()).abs() < 1e-9);
}
