//! `plan.json` and `run.json` have the documented form, read back to the same numbers, and keep what varies apart.

mod block;

use nalgebra::{Unit, Vector3};
use overfly::mission::run_json::{Engine, Machine, Run};
use overfly::mission::{plan_json, run_json};
use overfly::trajectory::plan::{Camera, Image, Plan, RunTimes};
use overfly_table::FieldTable;
use proptest::prelude::*;
use serde_json::Value;

#[test]
fn the_keys_stand_in_the_documented_order() {
    let text = String::from_utf8(plan_json::to_bytes(&plan())).unwrap();
    let keys = [
        "format",
        "scene",
        "name",
        "origin",
        "lat_deg",
        "lon_deg",
        "alt_m",
        "revision",
        "seed",
        "rig",
        "method",
        "waypoints",
        "position_m",
        "direction",
        "images",
        "up",
        "camera",
        "time_s",
        "selected",
        "metrics",
        "length_m",
        "movement_s",
        "turning_s",
        "flight_s",
        "profile_s",
        "images",
        "selected_images",
        "coverage_percent",
        "coverage_exposed_percent",
        "capturable_percent",
        "information",
        "objective",
    ];
    let mut rest = text.as_str();
    for key in keys {
        let place = rest.find(&format!("\"{key}\":")).unwrap_or_else(|| panic!("there is no {key} behind the keys before it"));
        rest = &rest[place + key.len()..];
    }
    assert!(!rest.contains("\": "), "there are more keys: {rest}");
}

#[test]
fn a_panoramic_plan_has_null_directions_and_no_field_of_view() {
    let plan = plan();
    let file = parse(&plan);
    assert_eq!(file["images"].as_array().unwrap().len(), plan.images.len());
    for image in file["images"].as_array().unwrap() {
        assert!(image["direction"].is_null() && image.get("fov_deg").is_none() && image["camera"] == "panorama");
    }
    assert!(file["waypoints"].as_array().unwrap().iter().all(|waypoint| waypoint["direction"].is_null()));
}

#[test]
fn each_camera_of_a_rig_has_a_row_with_its_name_direction_and_field_of_view() {
    let mut plan = plan();
    let camera = |name: &str| Camera { name: name.to_owned(), ..plan.cameras[0].clone() };
    plan.cameras = vec![camera("forward"), camera("nadir")];
    let down =
        Image { direction: Some(-Vector3::z_axis()), up: Vector3::y(), fov_deg: Some([73.7, 53.1]), camera: 1, ..plan.images[0] };
    let forward = Image { direction: Some(Unit::new_normalize(Vector3::new(0.0, 1.0, -1.0))), camera: 0, ..down };
    plan.images = vec![forward, down];
    let file = parse(&plan);
    assert_eq!((&file["images"][0]["camera"], &file["images"][1]["camera"]), (&"forward".into(), &"nadir".into()));
    assert_eq!(file["images"][1]["direction"], serde_json::json!([0.0, 0.0, -1.0]));
    assert_eq!(file["images"][1]["fov_deg"], serde_json::json!([73.7, 53.1]));
}

#[test]
fn a_scene_without_georeference_has_a_null_origin() {
    let mut plan = plan();
    plan.scene.origin = None;
    assert!(parse(&plan)["scene"]["origin"].is_null());
}

#[test]
fn a_plan_without_images_is_still_a_file_of_the_same_form() {
    let mut plan = plan();
    (plan.images, plan.waypoints) = (Vec::new(), Vec::new());
    let file = parse(&plan);
    assert_eq!((file["images"].as_array().map(Vec::len), &file["metrics"]["waypoints"]), (Some(0), &0.into()));
}

#[test]
fn run_json_holds_the_times_and_the_whole_convergence() {
    let plan = plan();
    let times = RunTimes { field_s: 0.1, search_s: 0.25, check_s: 0.05, total_s: 0.5, threads: 2 };
    let machine = Machine { platform: "linux-x86_64".to_owned(), processor: "a \"fast\" one".to_owned(), cores: 2 };
    let run = Run {
        engine: Engine::Daemon,
        machine,
        times,
        edit_to_plan_s: Some(0.75),
        import: None,
        order: None,
        settings: None,
        scene_file: None,
    };
    let file: Value = serde_json::from_slice(&run_json::to_bytes(&plan, &run)).unwrap();
    assert_eq!((&file["engine"], &file["threads"], &file["stop"]), (&"daemon".into(), &2.into(), &"goal_reached".into()));
    assert_eq!((&file["times"]["search_s"], &file["times"]["edit_to_plan_s"]), (&0.25.into(), &0.75.into()));
    for key in ["objective", "coverage_percent", "length_m", "turning_s"] {
        assert_eq!(file["convergence"][key].as_array().unwrap().len(), plan.convergence.len(), "{key}");
    }
    assert_eq!(file["convergence"]["length_m"][3], 15.0);
}

proptest! {
    #[test]
    fn numbers_read_back_to_the_same_bits(x in proptest::num::f64::NORMAL, time_s in 0.0..1e6f64) {
        let mut plan = plan();
        plan.waypoints[0].position_m.x = x;
        plan.images[0].time_s = time_s;
        let file = parse(&plan);
        prop_assert_eq!(file["waypoints"][0]["position_m"][0].as_f64().map(f64::to_bits), Some(x.to_bits()));
        prop_assert_eq!(file["images"][0]["time_s"].as_f64().map(f64::to_bits), Some(time_s.to_bits()));
    }
}

fn plan() -> Plan {
    let blocks = block::field(&block::city(2, 2));
    block::plan(&FieldTable::open(&blocks).unwrap())
}

fn parse(plan: &Plan) -> Value {
    serde_json::from_slice(&plan_json::to_bytes(plan)).unwrap()
}
