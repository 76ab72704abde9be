//! `plan.json` and `run.json` have the documented form, read back to the same numbers, and keep what varies apart.

mod block;

use nalgebra::{Point3, Unit, Vector3};
use overfly::camera::Rig;
use overfly::mission::run_json::{Engine, Machine, Run};
use overfly::mission::{plan_json, plan_read, run_json};
use overfly::settings::Settings;
use overfly::trajectory::limits::Limits;
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
        "deviation_m",
        "images",
        "up",
        "camera",
        "time_s",
        "selected",
        "limits",
        "turning",
        "cruise_mps",
        "dynamics",
        "jerk_mps3",
        "trajectory",
        "time_s",
        "position_m",
        "velocity_mps",
        "metrics",
        "length_m",
        "movement_s",
        "turning_s",
        "flight_s",
        "profile_s",
        "images",
        "selected_images",
        "delayed_exposures",
        "dropped_exposures",
        "blur_px",
        "coverage_percent",
        "coverage_exposed_percent",
        "capturable_percent",
        "matched_percent",
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
fn the_trajectory_follows_from_waypoints_and_limits_and_may_be_missing() {
    let plan = plan();
    let file = parse(&plan);
    let rows = file["trajectory"].as_array().unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let point = |value: &Value| Point3::new(number(&value[0]), number(&value[1]), number(&value[2]));
    let profile = plan.profile().unwrap();
    assert_eq!(point(&rows[0]["position_m"]), plan.waypoints[0].position_m);
    for row in rows {
        let passage = profile.at(number(&row["time_s"])).unwrap();
        assert!((point(&row["position_m"]) - passage.position_m).norm() < 1e-9);
        assert!((point(&row["velocity_mps"]).coords - passage.velocity_mps).norm() < 1e-9);
    }
    assert!((number(&rows[rows.len() - 1]["time_s"]) - profile.duration_s()).abs() < 1e-6);
    let read = plan_read::read("plan.json", &plan_json::to_bytes(&plan)).unwrap();
    assert_eq!(plan_json::to_bytes(&read), plan_json::to_bytes(&plan));
    let silent = Plan { limits: None, ..plan };
    let bytes = plan_json::to_bytes(&silent);
    assert!(parse(&silent).get("trajectory").is_none() && parse(&silent).get("limits").is_none());
    assert_eq!(plan_read::read("plan.json", &bytes).unwrap().limits, None);
}

#[test]
fn limits_that_no_drone_has_are_refused() {
    let text = String::from_utf8(plan_json::to_bytes(&plan())).unwrap();
    for (good, bad, named) in [
        ("\"jerk_mps3\":4.0", "\"jerk_mps3\":0.0", "limits"),
        ("\"cruise_mps\":8.0", "\"cruise_mps\":1e300", "limits"),
        ("\"turning\":\"nothing\"", "\"turning\":\"wings\"", "limits.turning"),
        ("\"deviation_m\":1.0", "\"deviation_m\":-1.0", "deviation_m"),
    ] {
        assert!(text.contains(good), "{good}");
        let error = plan_read::read("plan.json", text.replacen(good, bad, 1).as_bytes()).expect_err(bad).to_string();
        assert!(error.contains(named), "{bad} gave {error}");
    }
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
        ground_file: None,
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
    let Settings { flight, dynamics, .. } = Settings::default();
    let limits = Limits::new(&Rig::preset("panoramic").unwrap(), &flight, &dynamics);
    Plan { limits: Some(limits), ..block::plan(&FieldTable::open(&blocks, &[]).unwrap()) }
}

fn parse(plan: &Plan) -> Value {
    serde_json::from_slice(&plan_json::to_bytes(plan)).unwrap()
}
