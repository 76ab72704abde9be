//! Commands that need no daemon: what they print, what they write, and how they fail.

mod program;

use program::{Place, stderr, stdout};
use serde_json::Value;

#[test]
fn help_teaches_with_examples_units_and_exit_codes() {
    let place = Place::new();
    let help = stdout(&place.run(&["--help"]));
    for word in ["overfly demo", "overfly load town.geojson", "Exit codes", "  6  no plan", "metres"] {
        assert!(help.contains(word), "{word} is not in {help}");
    }
    let commands = [
        "demo",
        "serve",
        "load",
        "plan",
        "edit",
        "watch",
        "cancel",
        "unload",
        "status",
        "reload",
        "stop",
        "bench",
        "bound",
        "generate",
        "degrade",
        "inspect",
        "export",
        "fly",
        "reproduce",
        "evaluate",
        "view",
        "rigs",
        "completions",
        "man",
    ];
    for command in commands {
        let output = place.run(&[command, "--help"]);
        assert!(output.status.success() && stdout(&output).contains("--json"), "{command}");
    }
    let help = stdout(&place.run(&["plan", "--help"]));
    for word in [
        "--rig phantom4-rtk",
        "--look 90,-30",
        "--overlap 80",
        "not for those that are selected",
        "m300-oblique",
        "overfly rigs phantom4-rtk",
        "--pose 10,-40,35 --velocity 6,0,0 --taken 120",
    ] {
        assert!(help.contains(word), "{word} is not in {help}");
    }
}

#[test]
fn a_generated_block_can_be_planned_and_is_the_same_for_the_same_seed() {
    let place = Place::new();
    let answer = place.json(&["generate", "--seed", "3", "--out", "block.geojson"]);
    assert!(answer["structures"].as_u64().unwrap() > 20, "{answer}");
    assert_eq!(place.run(&["generate", "--seed", "3"]).stdout.trim_ascii_end(), place.read("block.geojson").trim_ascii_end());
    assert_ne!(place.run(&["generate", "--seed", "4"]).stdout, place.read("block.geojson"));
    let plan = place.json(&[
        "plan",
        "block.geojson",
        "--samples",
        "200",
        "--viewpoints",
        "200",
        "--method",
        "paper",
        "--iterations",
        "20",
    ]);
    assert!(plan["waypoints"].as_u64().unwrap() >= 1);
}

#[test]
fn benches_print_median_p99_and_limits() {
    let place = Place::new();
    let scene = place.scene();
    let small = ["--repeat", "2", "--samples", "100", "--viewpoints", "100"];
    for (subject, rig, step) in
        [("field", "panoramic", "build"), ("search", "panoramic", "tree search"), ("search", "phantom4-rtk", "tree search")]
    {
        let answer =
            place.json(&[&["bench", subject, scene.as_str()], small.as_slice(), &["--iterations", "20", "--rig", rig]].concat());
        assert!(subject == "field" || answer.to_string().contains(rig), "{answer}");
        let steps = answer["steps"].as_array().unwrap();
        let row = steps.iter().find(|row| row["step"] == step).unwrap_or_else(|| panic!("{answer}"));
        assert!(row["median"].as_f64().unwrap() > 0.0 && row["p99"].as_f64() >= row["median"].as_f64(), "{row}");
        assert_eq!((&row["repeats"], row["limit"].as_str().map(str::is_empty)), (&2.into(), Some(false)));
    }
}

#[test]
fn wrong_lines_are_usage_errors() {
    let place = Place::new();
    let scene = place.scene();
    for words in [
        vec!["fly"],
        vec!["plan"],
        vec!["plan", &scene, "--start", "1,2"],
        vec!["plan", &scene, "--rig", "phantom4-rtk", "--look", "90"],
        vec!["plan", &scene, "--rig", "phantom4-rtk", "--look", "90,-91"],
        vec!["plan", &scene, "--rig", "phantom4-rtk", "--look", "nan,0"],
        vec!["plan", &scene, "--method", "paper", "--iterations", "0"],
        vec!["plan", &scene, "--samples", "many"],
        vec!["edit", "town", "raise", "hall", "--by", "-3"],
        vec!["edit", "town", "add", "--name", "n", "--outline", "0,0 1,1", "--height", "3"],
        vec!["bench", "weather", &scene],
        vec!["serve", "--domain", "Not/A/Name"],
    ] {
        let message = place.fails(2, "usage", &words);
        assert!(!message.is_empty());
    }
}

#[test]
fn bad_input_files_are_named_with_a_remedy() {
    let place = Place::new();
    std::fs::write(place.path("picture.json"), b"\x89PNG").unwrap();
    std::fs::write(place.path("empty.geojson"), br#"{"type":"FeatureCollection","features":[]}"#).unwrap();
    std::fs::write(place.path("broken.toml"), "[surface]\nsample = 3\n").unwrap();
    std::fs::write(place.path("latin.toml"), b"name = \"m\xe9lange\"").unwrap();
    std::fs::write(place.path("large.toml"), "#".repeat(65_537)).unwrap();
    let scene = place.scene();
    for (words, file) in [
        (vec!["plan", "picture.json"], "picture.json"),
        (vec!["plan", "empty.geojson"], "empty.geojson"),
        (vec!["bench", "field", "missing.geojson"], "missing.geojson"),
        (vec!["load", "missing.geojson"], "missing.geojson"),
        (vec!["plan", "missing.geojson"], "No such file"),
        (vec!["plan", "scenes/town"], "No such file"),
        (vec!["plan", "missing.obj", "--out", "out"], "missing.obj"),
        (vec!["plan", &scene, "--config", "missing.toml"], "missing.toml"),
        (vec!["plan", &scene, "--config", "broken.toml"], "sample"),
        (vec!["serve", "--config", "broken.toml"], "broken.toml"),
        (vec!["plan", &scene, "--rig", "missing.toml"], "missing.toml"),
        (vec!["plan", "town", "--rig", "missing.toml"], "missing.toml"),
        (vec!["plan", &scene, "--rig", "./"], "directory"),
        (vec!["plan", &scene, "--rig", "/dev/zero"], "more than 65536 bytes"),
        (vec!["plan", &scene, "--rig", "latin.toml"], "not UTF-8"),
        (vec!["plan", &scene, "--rig", "large.toml"], "more than 65536 bytes"),
        (vec!["plan", &scene, "--rig", "broken.toml"], "surface"),
        (vec!["bench", "search", &scene, "--rig", "broken.toml"], "surface"),
    ] {
        let message = place.fails(3, "input_file", &words);
        assert!(message.contains(file) && message.contains(';'), "{message}");
    }
}

#[test]
fn without_a_daemon_the_client_says_how_to_start_one() {
    let place = Place::new();
    let scene = place.scene();
    for words in [
        vec!["status"],
        vec!["stop"],
        vec!["reload"],
        vec!["load", &scene],
        vec!["plan", "town"],
        vec!["watch", "town"],
        vec!["cancel", "town"],
        vec!["unload", "town"],
        vec!["edit", "town", "remove", "hall"],
    ] {
        let message = place.fails(4, "no_daemon", &words);
        assert!(message.contains("overfly serve"), "{words:?}: {message}");
    }
    let message = place.fails(4, "no_daemon", &["plan", "twon"]);
    assert!(message.contains("there is no file \"twon\""), "{message}");
}

#[test]
fn what_cannot_be_planned_says_why() {
    let place = Place::new();
    let scene = place.scene();
    for (words, cause) in [
        (vec!["plan", &scene, "--rig", "kite"], "panoramic"),
        (vec!["plan", &scene, "--method", "magic"], "paper"),
        (vec!["plan", &scene, "--start", "0,0,-5"], "start"),
        (vec!["plan", &scene, "--start", "0,0,5000"], "start"),
        (vec!["plan", &scene, "--rig", "phantom4-rtk", "--start", "0,0,5000"], "flight limits"),
        (vec!["plan", &scene, "--rig", "phantom4-rtk", "--look", "90,31"], "a pitch from -90.0 to 30.0"),
        (vec!["plan", &scene, "--rig", "m300-oblique", "--look", "90,-30"], "no gimbal"),
        (vec!["plan", &scene, "--look", "90,-30"], "no gimbal"),
        (vec!["rigs", "kite"], "known rigs: panoramic"),
    ] {
        let message = place.fails(6, "no_plan", &words);
        assert!(message.contains(cause), "{message}");
    }
}

#[test]
fn an_impossible_rig_is_refused_by_what_makes_it_so() {
    let place = Place::new();
    let scene = place.scene();
    let phantom = stdout(&place.run(&["rigs", "phantom4-rtk"]));
    let deep = format!("name = {}", "[".repeat(60_000));
    for (text, named) in [
        (phantom.replace("focal_mm = 8.8", "focal_mm = nan"), "focal_mm"),
        (phantom.replace("[-90.0, 30.0]", "[30.0, -90.0]"), "gimbal.pitch_deg"),
        (phantom.replace("[gimbal]\npitch_deg = [-90.0, 30.0]", ""), "needs `yaw_deg`"),
        (phantom.replace("[gimbal]", "[gimball]"), "gimball"),
        (String::new(), "name"),
        (deep, "rig.toml"),
    ] {
        std::fs::write(place.path("rig.toml"), text).unwrap();
        let message = place.fails(3, "input_file", &["plan", &scene, "--rig", "rig.toml"]);
        assert!(message.contains(named) && message.contains("rig.toml") && message.len() < 2000, "{message}");
    }
}

#[test]
fn rigs_are_listed_and_the_file_of_one_flies_like_its_preset() {
    let place = Place::new();
    let scene = place.scene();
    let listed = place.json(&["rigs"]);
    let names: Vec<&str> = listed["rigs"].as_array().unwrap().iter().map(|rig| rig["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["panoramic", "phantom4-rtk", "m300-oblique", "mavic3e"]);
    let phantom = &listed["rigs"][1];
    assert!((phantom["fov_deg"][0].as_f64().unwrap() - 73.74).abs() < 0.01 && phantom["battery_wh"] == 89.2, "{phantom}");
    let table = stdout(&place.run(&["rigs"]));
    assert!(names.iter().all(|name| table.contains(name)) && table.contains("-90 to 30"), "{table}");
    for name in names {
        let file = place.run(&["rigs", name]).stdout;
        std::fs::write(place.path("my-rig.toml"), file).unwrap();
        let plan = |rig: &str, out: &str| {
            place.json(&["plan", &scene, "--rig", rig, "--method", "paper", "--iterations", "15", "--out", out])
        };
        plan(name, "preset");
        plan("my-rig.toml", "file");
        assert_eq!(place.read("preset/plan.json"), place.read("file/plan.json"), "{name}");
    }
}

#[test]
fn an_output_folder_that_cannot_be_made_is_named() {
    let place = Place::new();
    let scene = place.scene();
    let message =
        place.fails(1, "unexpected", &["plan", &scene, "--method", "paper", "--iterations", "2", "--out", "town.geojson/out"]);
    assert!(message.contains("town.geojson/out") && message.contains("--out"), "{message}");
}

#[test]
fn what_cannot_succeed_is_refused_before_the_scene_is_read() {
    let place = Place::new();
    std::fs::write(place.path("broken.geojson"), b"{").unwrap();
    std::fs::write(place.path("taken"), b"").unwrap();
    let message = place.fails(1, "unexpected", &["plan", "broken.geojson", "--out", "taken/flights"]);
    assert!(message.contains("taken/flights") && message.contains("--out"), "{message}");
    assert!(place.fails(6, "no_plan", &["plan", "broken.geojson", "--rig", "stereo"]).contains("panoramic"));
    assert!(place.fails(6, "no_plan", &["plan", "broken.geojson", "--method", "magic"]).contains("paper"));
    place.fails(3, "input_file", &["plan", "broken.geojson", "--out", "new/flights"]);
    assert!(!place.path("new").exists(), "an empty folder was left behind");
}

#[test]
fn a_result_that_cannot_be_printed_is_a_failure() {
    let place = Place::new();
    let scene = place.scene();
    for words in [vec!["plan", &scene, "--method", "paper", "--iterations", "5", "--json"], vec!["generate"]] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = place.command(&words).stdout(full).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{words:?}");
        assert!(stderr(&output).contains("standard output"), "{}", stderr(&output));
    }
}

#[test]
fn a_degraded_scene_keeps_its_structures_and_warns_when_the_safety_distance_cannot_cover_it() {
    let place = Place::new();
    let scene = place.scene();
    let degrade = |heights: &str, more: &[&str]| {
        let output = place.run(&[&["degrade", &scene, "--heights", heights, "--out", "rough.geojson"], more].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        output
    };
    let mild = degrade("10", &["--boundary", "rough"]);
    assert!(stdout(&mild).contains("4 structures") && stdout(&mild).contains("walls by up to 4.00 m"), "{}", stdout(&mild));
    assert!(!stderr(&mild).contains("warning"), "{}", stderr(&mild));
    place.run(&["plan", "rough.geojson", "--method", "paper", "--iterations", "20", "--out", "out"]);
    let plan: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    assert_eq!(plan["format"], "overfly-plan/1");

    std::fs::write(place.path("close.toml"), "[flight]\nsafety_distance_m = 1.5\n").unwrap();
    let rough = degrade("0", &["--boundary", "medium", "--config", "close.toml"]);
    assert!(stderr(&rough).contains("warning: the proxy is wrong by up to 2.00 m"), "{}", stderr(&rough));

    let answer = place.json(&["degrade", &scene, "--heights", "90", "--seed", "4", "--out", "rough.geojson"]);
    let vertical = answer["largest_error_m"]["vertical"].as_f64().unwrap();
    assert!(vertical <= 0.9 * 24.0 && (answer["warning"].is_null() == (vertical <= 5.0)), "{answer}");
    let refused = place.run(&["degrade", &scene, "--heights", "91", "--out", "x.geojson"]);
    assert!(refused.status.code() == Some(2) && stderr(&refused).contains("0 to 90"), "{}", stderr(&refused));
}
