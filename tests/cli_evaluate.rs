//! `overfly evaluate` from end to end, with good and bad inputs.

mod program;

use program::{Place, stderr, stdout};
use serde_json::Value;

/// A place with `town.geojson` and its plan in `out`.
fn planned() -> Place {
    let place = Place::new();
    let scene = place.scene();
    place.json(&[
        "plan",
        &scene,
        "--rig",
        "phantom4-rtk",
        "--method",
        "paper",
        "--iterations",
        "120",
        "--seed",
        "2",
        "--out",
        "out",
    ]);
    place
}

#[test]
fn a_plan_is_evaluated_on_its_own_scene() {
    let place = planned();
    let answer = place.json(&["evaluate", "out/plan.json", "--samples", "1500", "--out", "quality"]);
    assert_eq!(
        (&answer["format"], &answer["truth"], &answer["images_used"]),
        (&"overfly-quality/1".into(), &"town".into(), &"all".into())
    );
    let number = |key: &str| answer[key].as_f64().unwrap_or_else(|| panic!("{key} in {answer}"));
    assert!((1300.0..1700.0).contains(&number("samples")) && number("reconstructed_percent") > 5.0);
    assert!(number("error_90_m") > 0.0 && number("error_90_m") < number("error_95_m"));
    assert_eq!((&answer["collides"], &answer["below_safety_distance"]), (&false.into(), &false.into()));
    assert_eq!(place.files("quality"), ["quality.json", "quality.svg"]);
    let file: Value = serde_json::from_slice(&place.read("quality/quality.json")).unwrap();
    assert_eq!((&file["error_95_m"], &file["settings"]["pixel_noise_px"]), (&answer["error_95_m"], &0.5.into()));

    let drawing = String::from_utf8(place.read("quality/quality.svg")).unwrap();
    let document = roxmltree::Document::parse(&drawing).unwrap();
    let dots = |state: &str| {
        let paths = document.descendants().filter(|node| node.attribute("data-state") == Some(state));
        paths.map(|path| path.attribute("d").unwrap_or("").matches('M').count()).sum::<usize>()
    };
    let all = dots("reconstructed") + dots("not-reconstructed") + dots("not-seen");
    assert_eq!(all as f64, number("samples"), "every sample is drawn once");
    assert!(dots("reconstructed") > 0);

    let selected = place.json(&["evaluate", "out/plan.json", "--samples", "1500", "--images", "selected"]);
    assert!(selected["images"].as_u64() < answer["images"].as_u64());
    assert!(selected["reconstructed_percent"].as_f64() <= answer["reconstructed_percent"].as_f64());
    let output = place.run(&["evaluate", "out/plan.json", "--samples", "300"]);
    for label in ["predicted Error 90 %, m", "predicted Completeness 0.075 m, %", "mean Smith reconstructability"] {
        assert!(stdout(&output).contains(label), "{}", stdout(&output));
    }
}

#[test]
fn quality_files_are_the_same_on_any_number_of_threads() {
    let place = planned();
    for threads in ["1", "2", "3"] {
        let words = ["evaluate", "out/plan.json", "--samples", "800", "--out", threads];
        let output = place.command(&words).env("RAYON_NUM_THREADS", threads).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
    }
    for file in ["quality.json", "quality.svg"] {
        let read = |threads: &str| place.read(&format!("{threads}/{file}"));
        assert!(read("1") == read("2") && read("1") == read("3"), "{file}");
    }
}

/// The scene with other heights and shifted to the north, degrees.
fn variant(place: &Place, name: &str, height: f64, north_deg: f64) {
    let mut scene: Value = serde_json::from_slice(&place.read("town.geojson")).unwrap();
    for feature in scene["features"].as_array_mut().unwrap() {
        feature["properties"]["height"] = height.into();
        for corner in feature["geometry"]["coordinates"][0].as_array_mut().unwrap() {
            corner[1] = (corner[1].as_f64().unwrap() + north_deg).into();
        }
    }
    std::fs::write(place.path(name), scene.to_string()).unwrap();
}

#[test]
fn a_truth_that_the_path_violates_is_told_and_no_error() {
    let place = planned();
    variant(&place, "towers.geojson", 90.0, 0.0);
    let words = ["evaluate", "out/plan.json", "--truth", "towers.geojson", "--samples", "400"];
    let answer = place.json(&words);
    assert_eq!((&answer["below_safety_distance"], &answer["truth"]), (&true.into(), &"towers".into()));
    let output = place.run(&words);
    assert!(output.status.success());
    assert!(stderr(&output).contains("collides") || stderr(&output).contains("safety distance"), "{}", stderr(&output));
}

#[test]
fn settings_that_only_the_plan_had_are_pointed_out() {
    let place = planned();
    std::fs::write(place.path("wide.toml"), "[coverage]\nrange_m = 100.0\n").unwrap();
    place.json(&["plan", "town.geojson", "--method", "paper", "--iterations", "20", "--config", "wide.toml", "--out", "wide"]);
    let notes =
        |words: &[&str]| place.json(&[&["evaluate", "wide/plan.json", "--samples", "200"], words].concat())["notes"].to_string();
    assert!(notes(&[]).contains("--config"), "{}", notes(&[]));
    assert!(!notes(&["--config", "wide.toml"]).contains("--config"));
}

#[test]
fn inputs_that_do_not_fit_are_refused_with_the_remedy() {
    let place = planned();
    let refused = |words: &[&str], named: &[&str]| {
        let message = place.fails(3, "input_file", &[&["evaluate"], words].concat());
        named.iter().for_each(|word| assert!(message.contains(word), "{word} is not in {message}"));
    };
    variant(&place, "far.geojson", 10.0, 0.1);
    refused(&["out/plan.json", "--truth", "far.geojson"], &["far", "--truth", "m away"]);
    let cube = "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nv 0 0 9\nv 9 0 9\nv 9 9 9\nv 0 9 9\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    std::fs::write(place.path("cube.obj"), cube).unwrap();
    refused(&["out/plan.json", "--truth", "cube.obj"], &["georeference", "--truth"]);
    refused(&["out/plan.json", "--truth", "nowhere.geojson"], &["nowhere.geojson"]);
    refused(&["nowhere.json"], &["nowhere.json"]);
    refused(&["town.geojson"], &["a scene and no plan"]);

    let plan = place.read("out/plan.json");
    std::fs::write(place.path("out/cut.json"), &plan[..plan.len() / 2]).unwrap();
    refused(&["out/cut.json"], &["out/cut.json", "damaged"]);
    let other = String::from_utf8(plan.clone()).unwrap().replacen("overfly-plan/1", "overfly-plan/9", 1);
    std::fs::write(place.path("out/other.json"), other).unwrap();
    refused(&["out/other.json"], &["overfly-plan/9", "overfly-plan/1"]);

    std::fs::create_dir(place.path("alone")).unwrap();
    std::fs::write(place.path("alone/plan.json"), &plan).unwrap();
    refused(&["alone/plan.json"], &["--truth", "run.json"]);
    let answer = place.json(&["evaluate", "alone/plan.json", "--truth", "town.geojson", "--samples", "200"]);
    assert_eq!(answer["notes"].as_array().map(Vec::len), Some(0));
    std::fs::rename(place.path("town.geojson"), place.path("gone.geojson")).unwrap();
    refused(&["out/plan.json"], &["town.geojson", "--truth"]);
    assert!(!place.path("nothing").exists());
    place.fails(3, "input_file", &["evaluate", "out/plan.json", "--out", "nothing"]);
    assert!(!place.path("nothing").exists(), "what failed leaves nothing");
    place.fails(2, "usage", &["evaluate", "alone/plan.json", "--truth", "gone.geojson", "--samples", "0"]);
}

/// What never ends is refused before it has filled the memory.
#[test]
fn a_truth_without_end_is_refused() {
    let place = planned();
    let output = place.run(&["evaluate", "out/plan.json", "--truth", "/dev/zero"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("/dev/zero") && stderr(&output).contains("bytes"), "{}", stderr(&output));
}

#[test]
fn an_interrupted_evaluation_writes_nothing() {
    let place = planned();
    let mut child = place
        .command(&["evaluate", "out/plan.json", "--samples", "1000000", "--out", "quality", "--json"])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // The folder is made once a signal can be caught.
    let folder = place.path("quality");
    while !folder.exists() && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    rustix::process::kill_process(rustix::process::Pid::from_child(&child), rustix::process::Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(answer["error"]["kind"], "interrupted");
    assert!(!folder.join("quality.json").exists());
}
