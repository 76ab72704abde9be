//! `overfly view`: the page of a plan, with its scene and without, and of two plans.

mod program;
mod scene_files;

use std::collections::HashSet;

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
    let came = place.read("out/plan.html");
    let output = place.run(&["view", "out/plan.json", "--no-open"]);
    let (said, noted) = (stdout(&output), stderr(&output));
    assert!(output.status.success() && said.contains("out/plan.html") && !said.contains("wrote"), "{said}");
    assert!(
        noted.contains("the page that came with the plan") && noted.contains("--scene") && noted.contains("--out"),
        "{noted}"
    );
    assert_eq!(place.read("out/plan.html"), came, "a page that shows the scene is not overwritten by one that does not");
    let output = place.run(&["view", "out/plan.json", "--no-open", "--out", "alone.html"]);
    assert!(output.status.success() && stderr(&output).contains("--scene"), "{}", stderr(&output));
    let alone = data(&place.read("alone.html"));
    assert_eq!((&alone["flights"][0]["coverage"], &alone["scenes"][0]["structures"]), (&Value::Null, &serde_json::json!([])));
    assert!(f32s(&alone["flights"][0]["path"]["times_s"]).len() > 3);
    place.json(&["view", "out/plan.json", "--scene", "moved.geojson", "--no-open"]);
    assert!(!data(&place.read("out/plan.html"))["flights"][0]["coverage"].is_null());
}

#[test]
fn a_page_of_another_plan_is_not_taken_for_that_of_this_one() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "a", &[]);
    planned(&place, &scene, "b", &["--seed", "4"]);
    std::fs::rename(place.path(&scene), place.path("moved.geojson")).unwrap();
    std::fs::copy(place.path("b/plan.html"), place.path("a/plan.html")).unwrap();
    let output = place.run(&["view", "a/plan.json", "--no-open"]);
    assert!(stdout(&output).contains("wrote a/plan.html"), "{}", stdout(&output));
    assert_eq!(data(&place.read("a/plan.html"))["flights"][0]["coverage"], Value::Null);
}

#[test]
fn a_plan_that_follows_edits_is_shown_in_the_scene_that_is_given() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "out", &[]);
    let mut plan: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    plan["scene"]["revision"] = 3.into();
    std::fs::create_dir(place.path("edited")).unwrap();
    std::fs::write(place.path("edited/plan.json"), plan.to_string()).unwrap();
    place.json(&["view", "edited/plan.json", "--scene", &scene, "--no-open"]);
    let page = data(&place.read("edited/plan.html"));
    assert_eq!((&page["flights"][0]["revision"], &page["scenes"][0]["revision"]), (&3.into(), &3.into()));
    let note = page["flights"][0]["notes"][0].as_str().unwrap();
    assert!(note.contains("where the plan says"), "figures and picture are told apart on the page: {note}");
    assert!(!page["flights"][0]["coverage"].is_null());
}

#[test]
fn a_surface_model_is_read_over_the_ground_that_its_plan_was_made_on() {
    let place = Place::new();
    let slope = |column: u32| 3.0 + 0.15 * column as f32;
    let house = |column, row| (20..40).contains(&column) && (30..50).contains(&row);
    let surface = scene_files::raster(80, |column, row| slope(column) + if house(column, row) { 9.0 } else { 0.0 });
    // The ground is deeper than the surface lets anybody guess, so that it makes a difference.
    let ground = scene_files::raster(80, |column, _| slope(column) - 2.0);
    for (name, bytes) in
        [("surface.tif", &surface), ("ground.tif", &ground), ("town_dsm.tif", &surface), ("town_dtm.tif", &ground)]
    {
        std::fs::write(place.path(name), bytes).unwrap();
    }
    planned(&place, "surface.tif", "out", &["--dtm", "ground.tif"]);
    place.json(&["view", "out/plan.json", "--no-open", "--out", "again.html"]);
    let [came, again] = ["out/plan.html", "again.html"].map(|file| data(&place.read(file)));
    assert_eq!(came["scenes"][0], again["scenes"][0]);
    // The same model of the ground is found by its name.
    let figures = |words: &[&str]| {
        let mut quality = place.json(&[&["evaluate", "out/plan.json"], words].concat());
        quality["truth"] = Value::Null;
        quality
    };
    assert_eq!(figures(&[]), figures(&["--truth", "town_dsm.tif"]));
}

/// The three coordinates of each sample, as they stand in a page.
fn samples(surface: &Value) -> HashSet<[u32; 3]> {
    f32s(&surface["positions_m"]).chunks_exact(3).map(|at| [at[0], at[1], at[2]].map(f32::to_bits)).collect()
}

#[test]
fn directions_that_come_back_rounded_do_not_make_another_plan_of_it() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "out", &["--rig", "phantom4-rtk"]);
    std::fs::rename(place.path(&scene), place.path("moved.geojson")).unwrap();
    let viewed = |page: &str| {
        std::fs::write(place.path("out/plan.html"), page).unwrap();
        place.json(&["view", "out/plan.json", "--no-open"]);
        place.read("out/plan.html") == page.as_bytes()
    };
    let page = String::from_utf8(place.read("out/plan.html")).unwrap();
    // The first six bits of an array are the last ones of its first number.
    let changed = |array: &str| {
        let images = page.find("\"images\":{").unwrap();
        let begins = images + page[images..].find(array).unwrap() + array.len();
        let other = if page[begins..].starts_with('B') { "C" } else { "B" };
        format!("{}{other}{}", &page[..begins], &page[begins + 1..])
    };
    assert!(viewed(&changed("\"directions\":\"")));
    assert!(!viewed(&changed("\"times_s\":\"")), "the page of another flight is made anew");
}

#[test]
fn two_plans_share_a_page_and_their_scene_where_it_is_the_same() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "a", &[]);
    planned(&place, &scene, "b", &["--seed", "4"]);
    let answer = place.json(&["view", "a/plan.json", "b/plan.json", "--no-open"]);
    assert_eq!(answer["files"], serde_json::json!(["a/plan-vs-b.html"]));
    let page = data(&place.read("a/plan-vs-b.html"));
    assert_eq!([page["scenes"].as_array().unwrap().len(), page["surfaces"].as_array().unwrap().len()], [1, 1]);
    assert_ne!(page["flights"][0]["path"], page["flights"][1]["path"]);
}

#[test]
fn plans_of_two_scenes_are_shown_in_one_frame_and_on_the_samples_that_both_have() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "a", &[]);
    // The inn is moved to the east and north, and so is the middle of the town, its origin.
    let mut town: Value = serde_json::from_slice(&place.read(&scene)).unwrap();
    for corner in town["features"][3]["geometry"]["coordinates"][0].as_array_mut().unwrap() {
        *corner = serde_json::json!([corner[0].as_f64().unwrap() + 0.0004, corner[1].as_f64().unwrap() + 0.0002]);
    }
    std::fs::write(place.path("moved.geojson"), town.to_string()).unwrap();
    planned(&place, "moved.geojson", "b", &[]);
    let alone = data(&place.read("b/plan.html"));
    place.json(&["view", "a/plan.json", "b/plan.json", "--no-open", "--out", "both.html"]);
    let page = data(&place.read("both.html"));
    let [a, b] = [&page["scenes"][0], &page["scenes"][1]];
    assert_eq!(a["origin"], b["origin"]);
    assert_ne!(b["origin"], alone["scenes"][0]["origin"]);
    let start = |page: &Value, flight: usize| f32s(&page["flights"][flight]["waypoints_m"])[0];
    assert!((start(&page, 1) - start(&alone, 0)).abs() > 5.0, "the path is shifted with its scene");
    let [first, second] = [0, 1].map(|k| samples(&page["surfaces"][k]));
    let common = first.intersection(&second).count();
    assert!(2 * common > first.len() && common < first.len(), "{common} of {} and {}", first.len(), second.len());
    assert_eq!(page["flights"][1]["apart"], Value::Null);
    // Other settings mean other samples, and nobody is told that they are the same.
    std::fs::write(place.path("near.toml"), "[coverage]\nrange_m = 60.0\n").unwrap();
    planned(&place, "moved.geojson", "near", &["--config", "near.toml"]);
    place.json(&["view", "a/plan.json", "near/plan.json", "--no-open", "--out", "apart.html"]);
    let page = data(&place.read("apart.html"));
    assert_eq!(page["scenes"][0]["origin"], page["scenes"][1]["origin"]);
    assert!(
        page["flights"][1]["apart"].as_str().is_some_and(|why| why.contains("other samples")),
        "{}",
        page["flights"][1]["apart"]
    );
    // One without its scene is put into the frame of the other.
    std::fs::remove_file(place.path(&scene)).unwrap();
    for words in [["a/plan.json", "b/plan.json"], ["b/plan.json", "a/plan.json"]] {
        place.json(&[&["view"], &words[..], &["--no-open", "--out", "mixed.html"]].concat());
        let page = data(&place.read("mixed.html"));
        assert!(
            page["scenes"].as_array().unwrap().iter().all(|scene| scene["origin"] == alone["scenes"][0]["origin"]),
            "{words:?}"
        );
    }
}

#[test]
fn plans_that_have_no_common_frame_are_refused_with_a_remedy() {
    let place = Place::new();
    let scene = place.scene();
    planned(&place, &scene, "a", &[]);
    let obj = "v 0 0 0\nv 20 0 0\nv 20 15 0\nv 0 15 0\nv 0 0 9\nv 20 0 9\nv 20 15 9\nv 0 15 9\n\
               f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    std::fs::write(place.path("hall.obj"), obj).unwrap();
    planned(&place, "hall.obj", "b", &[]);
    let message = place.fails(3, "input_file", &["view", "a/plan.json", "b/plan.json", "--no-open"]);
    assert!(message.contains("hall.obj") && message.contains("--scene"), "{message}");
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
