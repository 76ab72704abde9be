//! `overfly view`: the page of a plan, with its scene and without, and of two plans.

mod program;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use program::{Place, stderr, stdout};
use serde_json::Value;

const PLAN: [&str; 8] = ["--method", "paper", "--iterations", "40", "--samples", "150", "--viewpoints", "200"];

/// The data within a page.
fn data(page: &[u8]) -> Value {
    let page = String::from_utf8(page.to_vec()).unwrap();
    let (_, rest) = page.split_once("<script id=\"data\" type=\"application/json\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

fn f32s(value: &Value) -> Vec<f32> {
    let bytes = STANDARD.decode(value.as_str().unwrap()).unwrap();
    bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
}

fn planned(place: &Place, scene: &str, out: &str, more: &[&str]) {
    place.json(&[&["plan", scene][..], &PLAN, more, &["--out", out]].concat());
}

#[test]
fn a_page_made_again_is_the_page_that_the_plan_came_with() {
    let place = Place::new();
    let scene = place.scene();
    for (out, more) in [("plain", &[][..]), ("region", &["--rig", "phantom4-rtk", "--region", "0,-30 30,-30 30,30 0,30"][..])] {
        planned(&place, &scene, out, more);
        let plan = format!("{out}/plan.json");
        let answer = place.json(&["view", &plan, "--no-open", "--out", "again.html"]);
        assert_eq!((&answer["opened"], &answer["notes"]), (&false.into(), &serde_json::json!([])), "{answer}");
        let (mut came, mut again) = (data(&place.read(&format!("{out}/plan.html"))), data(&place.read("again.html")));
        assert_eq!(again["flights"][0]["label"], plan.as_str());
        for page in [&mut came, &mut again] {
            page["flights"][0]["label"] = Value::Null;
        }
        assert_eq!(came, again, "{out}");
        assert_eq!(came["scenes"][0]["structures"].as_array().map(Vec::len), Some(4));
    }
}

#[test]
fn a_plan_whose_scene_is_gone_is_shown_alone_with_a_remark() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "out", &[]);
    std::fs::rename(place.path(&scene), place.path("moved.geojson")).unwrap();
    let output = place.run(&["view", "out/plan.json", "--no-open"]);
    assert!(output.status.success() && stderr(&output).contains("--scene"), "{}", stderr(&output));
    assert!(stdout(&output).contains("wrote out/plan.html"), "{}", stdout(&output));
    let alone = data(&place.read("out/plan.html"));
    assert_eq!((&alone["flights"][0]["coverage"], &alone["scenes"][0]["structures"]), (&Value::Null, &serde_json::json!([])));
    assert!(f32s(&alone["flights"][0]["path"]["times_s"]).len() > 3);
    place.json(&["view", "out/plan.json", "--scene", "moved.geojson", "--no-open"]);
    assert!(!data(&place.read("out/plan.html"))["flights"][0]["coverage"].is_null());
}

#[test]
fn two_plans_share_a_page_and_their_scene_where_it_is_the_same() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "a", &[]);
    planned(&place, &scene, "b", &["--seed", "4"]);
    let taller = String::from_utf8(place.read(&scene)).unwrap().replace("24.0", "31.0");
    std::fs::write(place.path("taller.geojson"), taller).unwrap();
    planned(&place, "taller.geojson", "c", &[]);
    let answer = place.json(&["view", "a/plan.json", "b/plan.json", "--no-open"]);
    assert_eq!(answer["files"], serde_json::json!(["a/plan-vs-b.html"]));
    let page = data(&place.read("a/plan-vs-b.html"));
    assert_eq!([page["scenes"].as_array().unwrap().len(), page["surfaces"].as_array().unwrap().len()], [1, 1]);
    assert_ne!(page["flights"][0]["path"], page["flights"][1]["path"]);
    place.json(&["view", "a/plan.json", "c/plan.json", "--no-open", "--out", "ac.html"]);
    let page = data(&place.read("ac.html"));
    assert_eq!([page["scenes"].as_array().unwrap().len(), page["surfaces"].as_array().unwrap().len()], [2, 2]);
}

#[test]
fn what_is_no_plan_is_refused_with_its_remedy() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "out", &[]);
    let text = String::from_utf8(place.read("out/plan.json")).unwrap();
    std::fs::write(place.path("old.json"), text.replace("overfly-plan/1", "overfly-plan/0")).unwrap();
    std::fs::write(place.path("damaged.json"), text.replace("\"waypoints\": [", "\"waypoints\": [7,")).unwrap();
    std::fs::write(place.path("far.json"), text.replace("\"lat_deg\":51", "\"lat_deg\":41")).unwrap();
    for (words, remedy) in [
        (&["view", "old.json", "--no-open"][..], "plan the flight again with this version"),
        (&["view", "out/plan.json", "damaged.json", "--no-open"], "waypoints[0]"),
        (&["view", "missing.json", "--no-open"], "plan.json that `overfly plan --out DIR` has written"),
        (&["view", &scene, "--no-open"], "a scene and no plan"),
        (&["view", "far.json", "--scene", &scene, "--no-open"], "--scene"),
    ] {
        let message = place.fails(3, "input_file", words);
        assert!(message.contains(remedy), "{words:?}: {message}");
    }
    assert_eq!(place.files("."), ["damaged.json", "far.json", "old.json", "out", "town.geojson"], "nothing was written");
}

#[test]
fn without_a_desktop_it_says_how_to_open_the_page() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "out", &[]);
    let mut command = place.command(&["view", "out/plan.json"]);
    let output = command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    let said = stdout(&output);
    assert!(output.status.success() && said.contains("file:///") && said.contains("out/plan.html in one"), "{said}");
}
