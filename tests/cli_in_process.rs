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
fn a_flight_goes_on_from_an_aircraft_in_the_air() {
    let place = Place::new();
    let scene = place.scene();
    let plan = ["plan", &scene, "--samples", "150", "--viewpoints", "200", "--iterations", "4"];
    place.json(&[&plan[..], &["--out", "whole"]].concat());
    let whole: Value = serde_json::from_slice(&place.read("whole/plan.json")).unwrap();
    let images = whole["images"].as_array().unwrap();
    let taken = images.len() / 2;
    let typed = |place: &Value| place.as_array().unwrap().iter().map(Value::to_string).collect::<Vec<_>>().join(",");
    let (pose, count) = (typed(&images[taken - 1]["position_m"]), taken.to_string());
    let aloft = ["--pose", &pose, "--taken", &count];
    let on = place.json(&[&plan[..], &aloft, &["--flown", "whole/plan.json", "--out", "on"]].concat());
    let on_plan: Value = serde_json::from_slice(&place.read("on/plan.json")).unwrap();
    assert_eq!(on_plan["waypoints"][0]["position_m"], images[taken - 1]["position_m"]);
    assert!(on_plan["images"].as_array().unwrap().len() < images.len(), "{on}");
    let run: Value = serde_json::from_slice(&place.read("on/run.json")).unwrap();
    assert_eq!(run["order"]["en_route"]["images_taken"], taken, "{run}");

    let home = typed(&whole["waypoints"][0]["position_m"]);
    let late = [&plan[..], &aloft, &["--flown", "whole/plan.json", "--landing", &home, "--time-left", "0.1"]].concat();
    let message = place.fails(6, "no_plan", &late);
    assert!(message.starts_with("land now"), "{message}");
    let message = place.fails(2, "usage", &[&plan[..], &aloft].concat());
    assert!(message.contains("--flown"), "{message}");
    let inside = [&plan[..], &["--pose", "0,0,0", "--velocity", "nan,0,0"]].concat();
    assert_eq!(place.run(&inside).status.code(), Some(2));
}

#[test]
fn a_plan_of_a_file_writes_its_four_files() {
    let place = Place::new();
    let scene = place.scene();
    let answer = place.json(&["plan", &scene, "--method", "paper", "--iterations", "60", "--out", "out"]);
    assert_eq!(place.files("out"), ["plan.html", "plan.json", "plan.svg", "run.json"]);
    assert_eq!((&answer["scene"], &answer["engine"]), (&"town".into(), &"in_process".into()));
    let plan: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    assert_eq!(plan["format"], "overfly-plan/1");
    assert_eq!(plan["metrics"]["length_m"], answer["length_m"]);
    let run: Value = serde_json::from_slice(&place.read("out/run.json")).unwrap();
    assert_eq!((&run["format"], &run["import"]["structures"]), (&"overfly-run/1".into(), &4.into()));
    assert_eq!(
        run["convergence"]["length_m"].as_array().map(Vec::len),
        answer["iterations"].as_u64().map(|count| count as usize)
    );
    let drawing = String::from_utf8(place.read("out/plan.svg")).unwrap();
    assert!(roxmltree::Document::parse(&drawing).is_ok());
}

#[test]
fn plan_json_is_the_same_on_any_number_of_threads() {
    let place = Place::new();
    let scene = place.scene();
    for threads in ["1", "2", "3"] {
        let words = ["plan", &scene, "--seed", "5", "--method", "paper", "--iterations", "80", "--out", threads];
        let output = place.command(&words).env("RAYON_NUM_THREADS", threads).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
    }
    let read = |threads: &str| place.read(&format!("{threads}/plan.json"));
    assert_eq!(read("1"), read("2"));
    assert_eq!(read("1"), read("3"));
}

#[test]
fn a_plan_below_its_goal_is_a_result_with_a_note() {
    let place = Place::new();
    let scene = place.scene();
    let output = place.run(&["plan", &scene, "--method", "paper", "--iterations", "1"]);
    assert!(output.status.success() && stderr(&output).contains("--iterations"), "{}", stderr(&output));
    assert!(stdout(&output).contains("captured of capturable, %"));
}

#[test]
fn an_overlap_tells_what_it_costs_and_stands_in_the_order() {
    let place = Place::new();
    let scene = place.scene();
    let words = ["plan", &scene, "--rig", "phantom4-rtk", "--method", "paper", "--iterations", "40"];
    let cruise = |words: &[&str]| place.json(words)["cruise_mps"].as_f64().unwrap();
    assert_eq!(cruise(&words), 8.0);
    let words = [words.as_slice(), &["--overlap", "80", "--out", "out"]].concat();
    // 80 % of 20 m, an image a second and two thirds of the most apart.
    assert!((cruise(&words) - 8.0 / 3.0).abs() < 1e-9);
    let run: Value = serde_json::from_slice(&place.read("out/run.json")).unwrap();
    assert_eq!(run["order"]["overlap_percent"], 80.0);
    let output = place.run(&words);
    assert!(stdout(&output).contains("cruise, m/s") && stdout(&output).contains("2.67"), "{}", stdout(&output));
    assert!(
        stderr(&output).contains("overlap of 80 %") && stderr(&output).contains("2.67 m/s instead of 8 m/s"),
        "{}",
        stderr(&output)
    );
    assert!(stderr(&output).contains("--overlap 80"), "the next command keeps it: {}", stderr(&output));
    for (rig, more, named) in [
        ("phantom4-rtk", ["--overlap", "100"], "less than 100"),
        ("phantom4-rtk", ["--overlap", "99"], "less overlap"),
        ("panoramic", ["--overlap", "80"], "phantom4-rtk"),
    ] {
        let message = place.fails(6, "no_plan", &[&["plan", &scene, "--rig", rig], more.as_slice()].concat());
        assert!(message.contains(named), "{message}");
    }
    let message = place.fails(6, "no_plan", &["plan", &scene, "--rig", "phantom4-rtk", "--method", "op", "--overlap", "80"]);
    assert!(message.contains("refined"), "{message}");
    place.fails(2, "usage", &["plan", &scene, "--overlap", "-3"]);
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
fn figures_tell_profile_time_battery_and_selected_images() {
    let place = Place::new();
    let scene = place.scene();
    for (rig, has_battery) in [("panoramic", false), ("phantom4-rtk", true), ("m300-oblique", true)] {
        let words = ["plan", &scene, "--rig", rig, "--method", "paper", "--iterations", "40", "--out", "out"];
        let answer = place.json(&words);
        let file: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
        for (key, value) in file["metrics"].as_object().unwrap() {
            assert_eq!(&answer[key], value, "{key} of {rig}");
        }
        assert!(answer["profile_s"].as_f64().unwrap() > 0.0 && answer["selected_images"].as_u64() <= answer["images"].as_u64());
        assert_eq!(answer["battery_percent"].is_number(), has_battery, "{answer}");
        let table = stdout(&place.run(&words));
        assert!(table.contains("speed profile, s") && table.contains("selected images"), "{table}");
        assert_eq!(table.contains("battery, %"), has_battery, "{table}");
    }
}

#[test]
fn what_a_rig_cannot_reach_by_any_plan_is_said_with_remedies() {
    let place = Place::new();
    let scene = place.scene();
    let note =
        |words: &[&str]| stderr(&place.run(&[&["plan", &scene, "--method", "paper", "--iterations", "5"], words].concat()));
    let narrow = stdout(&place.run(&["rigs", "phantom4-rtk"])).replace("[-90.0, 30.0]", "[-90.0, -89.0]");
    std::fs::write(place.path("down.toml"), narrow).unwrap();
    std::fs::write(place.path("strict.toml"), "[coverage]\nthreshold_percent = 75.0\n").unwrap();
    let down = note(&["--rig", "down.toml"]);
    let reachable =
        place.json(&["plan", &scene, "--method", "paper", "--iterations", "5", "--rig", "down.toml"])["capturable_percent"]
            .as_f64()
            .unwrap();
    for part in [
        "coverage.threshold_percent",
        "--rig",
        &format!("{reachable:.1} % of the exposed"),
        "--rig down.toml --method paper --iterations",
    ] {
        assert!(reachable < 80.0 && down.contains(part), "{part} is not in {down}");
    }
    let strict = note(&["--config", "strict.toml"]);
    assert!(strict.contains("coverage.threshold_percent") && !strict.contains("another rig"), "nothing sees more: {strict}");
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
fn run_json_holds_what_repeats_the_run() {
    let place = Place::new();
    let scene = place.scene();
    place.json(&["plan", &scene, "--method", "paper", "--iterations", "30", "--samples", "150", "--seed", "9", "--out", "out"]);
    let run: Value = serde_json::from_slice(&place.read("out/run.json")).unwrap();
    assert_eq!(run["settings"], serde_json::json!({ "surface": { "samples": 150 } }));
    assert_eq!((&run["order"]["seed"], &run["order"]["iterations"]), (&9.into(), &30.into()));
    assert!(run["order"]["rig_file"].is_null(), "a preset needs no file");

    let file = stdout(&place.run(&["rigs", "mavic3e"])).trim_end().to_owned();
    std::fs::write(place.path("my-rig.toml"), &file).unwrap();
    place.json(&[
        "plan",
        &scene,
        "--method",
        "paper",
        "--iterations",
        "5",
        "--rig",
        "my-rig.toml",
        "--look",
        "90,-30",
        "--out",
        "out",
    ]);
    let run: Value = serde_json::from_slice(&place.read("out/run.json")).unwrap();
    assert_eq!((&run["order"]["rig_file"], &run["order"]["start_view_deg"]), (&file.into(), &serde_json::json!([90.0, -30.0])));
}

/// The signal is sent as soon as the process catches it: then it is either a plan with a note or the word that there is none yet.
#[test]
fn an_interrupted_plan_is_the_best_so_far_or_none_with_an_exit_code_of_its_own() {
    const CATCHES_INT: u64 = 1 << 1;
    let place = Place::new();
    let scene = place.scene();
    let words = ["plan", &scene, "--method", "paper", "--iterations", "9999999", "--out", "out"];
    let mut command = place.command(&words);
    let child = command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let caught = || {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap().trim().to_owned();
        u64::from_str_radix(&mask, 16).unwrap()
    };
    while caught() & CATCHES_INT == 0 {}
    rustix::process::kill_process(rustix::process::Pid::from_child(&child), rustix::process::Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    match output.status.code() {
        Some(0) => {
            assert!(stdout(&output).contains("of 9999999 iterations"), "{}", stdout(&output));
            assert_eq!(place.files("out"), ["plan.html", "plan.json", "plan.svg", "run.json"]);
        }
        Some(130) => assert!(!place.path("out").exists() && stderr(&output).contains("interrupted"), "{}", stderr(&output)),
        other => panic!("{other:?}: {}", stderr(&output)),
    }
}

/// Who does not say how long to search has something to look at all the same; what the search ends with takes its place.
#[test]
fn a_search_that_takes_long_shows_a_first_look() {
    let place = Place::new();
    let scene = place.scene();
    let words = ["plan", &scene, "--samples", "1500", "--viewpoints", "300", "--out", "out"];
    let mut command = place.command(&words);
    let mut child = command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    // The page is written last, and a file that is not whole yet has no end.
    let page = || std::fs::read_to_string(place.path("out/plan.html")).unwrap_or_default();
    while !page().ends_with("</html>\n") {
        assert_eq!(child.try_wait().unwrap(), None, "it ends without a first look");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(page().contains("The search goes on"));
    assert_eq!(place.files("out"), ["plan.html", "plan.json", "plan.svg", "run.json"]);
    let first: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    rustix::process::kill_process(rustix::process::Pid::from_child(&child), rustix::process::Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success() && stderr(&output).contains("a first look after"), "{}", stderr(&output));
    assert!(stdout(&output).contains("this is the best plan so far"), "{}", stdout(&output));
    assert!(!page().contains("The search goes on"));
    let last: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    let lack = |plan: &Value| 95.0 - plan["metrics"]["coverage_percent"].as_f64().unwrap();
    assert!(lack(&last) <= lack(&first).max(0.0), "{} {}", first["metrics"], last["metrics"]);
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

#[test]
fn a_refined_plan_keeps_what_is_asked_of_it_and_repeats_itself_from_its_rounds() {
    let place = Place::new();
    let scene = place.scene();
    let sizes = ["--samples", "200", "--viewpoints", "300"];
    let plan = |words: &[&str]| place.json(&[&["plan", &scene, "--rig", "phantom4-rtk"], &sizes[..], words].concat());

    let whole = plan(&["--iterations", "160", "--coverage", "70"]);
    assert_eq!((&whole["method"], &whole["goal_percent"]), (&"refined".into(), &70.0.into()));
    assert!(whole["goal_reached"] == true && whole["coverage_percent"].as_f64().unwrap() >= 70.0, "{whole}");

    // A flight of half the time captures less, and keeps its time.
    let half_s = (whole["profile_s"].as_f64().unwrap() / 2.0).to_string();
    let short = plan(&["--iterations", "240", "--max-time", &half_s]);
    assert!(short["profile_s"].as_f64().unwrap() <= half_s.parse().unwrap(), "{short}");
    let captured = |plan: &Value| plan["coverage_percent"].as_f64().unwrap();
    assert!(captured(&short) < captured(&whole) && captured(&short) > 20.0, "{short}");

    // The paper's objective has no goals, and lacks none.
    let eq6 = place.run(&[&["plan", &scene, "--iterations", "20", "--objective", "eq6"], &sizes[..]].concat());
    assert!(eq6.status.success() && !stderr(&eq6).contains("the goal is"), "{}", stderr(&eq6));
    place.fails(6, "no_plan", &["plan", &scene, "--objective", "eq6", "--coverage", "50"]);

    // Half of the scene has fewer samples to capture, and a shorter flight.
    let west = plan(&["--iterations", "160", "--coverage", "70", "--region", "-500,-500 0,-500 0,500 -500,500"]);
    assert!(west["capturable_percent"].as_f64().unwrap() < 0.8 * whole["capturable_percent"].as_f64().unwrap());
    assert!(west["profile_s"].as_f64().unwrap() < whole["profile_s"].as_f64().unwrap(), "{west}");

    // How many rounds fit into seconds is the machine's affair; that the same number gives the same plan is not.
    plan(&["--budget", "0.3", "--coverage", "70", "--out", "timed"]);
    let run: Value = serde_json::from_slice(&place.read("timed/run.json")).unwrap();
    let rounds = run["convergence"]["coverage_percent"].as_array().unwrap().len().to_string();
    plan(&["--iterations", &rounds, "--coverage", "70", "--out", "again"]);
    assert_eq!(place.read("timed/plan.json"), place.read("again/plan.json"), "{rounds} rounds");

    for (words, named) in [
        (vec!["--iterations", "9", "--max-time", "0.5"], "more time"),
        (vec!["--method", "paper", "--budget", "1"], "refined"),
        (vec!["--iterations", "9", "--region", "0,0 10,10 10,0 0,10"], "crosses itself"),
    ] {
        let message = place.fails(6, "no_plan", &[&["plan", &scene], &words[..]].concat());
        assert!(message.contains(named), "{message}");
    }
    place.fails(2, "usage", &["plan", &scene, "--budget", "1", "--iterations", "3"]);
    place.fails(2, "usage", &["plan", &scene, "--max-time", "100", "--coverage", "50"]);
}
