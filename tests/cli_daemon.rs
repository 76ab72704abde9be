//! Commands against a daemon of their own, and the demo that starts one.

mod program;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use overfly_client::Domain;
use program::Place;
use serde_json::Value;

#[test]
fn the_daemon_and_the_process_itself_write_the_same_plan() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    place.json(&["load", &scene]);
    let order = ["--seed", "7", "--method", "paper", "--iterations", "60"];
    let by_daemon = place.json(&[&["plan", "town", "--out", "daemon"], order.as_slice()].concat());
    let in_process = place.json(&[&["plan", &scene, "--out", "process"], order.as_slice()].concat());
    assert_eq!((&by_daemon["engine"], &in_process["engine"]), (&"daemon".into(), &"in_process".into()));
    assert_eq!(place.read("daemon/plan.json"), place.read("process/plan.json"));
    assert_eq!(place.read("daemon/plan.svg"), place.read("process/plan.svg"));
}

#[test]
fn every_rig_gives_the_same_plan_by_the_daemon_and_in_the_process_itself() {
    let place = Place::new();
    let scene = place.scene();
    let phantom = program::stdout(&place.run(&["rigs", "phantom4-rtk"]))
        .replace("[-90.0, 30.0]", "[-60.0, -10.0]")
        .replace("\"phantom4-rtk\"", "\"mine\"");
    // The path of a rig file may be longer than a name on the wire.
    let folder = "f".repeat(150);
    std::fs::create_dir(place.path(&folder)).unwrap();
    let file = format!("{folder}/my-rig.toml");
    std::fs::write(place.path(&file), phantom).unwrap();
    for (rig, look) in [("phantom4-rtk", true), ("m300-oblique", false), ("mavic3e", true), (file.as_str(), true)] {
        let look = if look { ["--look", "200,-40"].as_slice() } else { &["--overlap", "75"] };
        let order = [&["--rig", rig, "--seed", "7", "--method", "paper", "--iterations", "40"], look].concat();
        let _daemon = place.serve(&["--rig", rig]);
        place.json(&["load", &scene]);
        place.json(&[&["plan", "town", "--out", "daemon"], order.as_slice()].concat());
        place.json(&[&["plan", &scene, "--out", "process"], order.as_slice()].concat());
        assert!(place.read("daemon/plan.json") == place.read("process/plan.json"), "{rig}");
        assert_eq!(place.read("daemon/plan.svg"), place.read("process/plan.svg"), "{rig}");
        let plan: Value = serde_json::from_slice(&place.read("daemon/plan.json")).unwrap();
        assert!(plan["images"][0]["direction"].is_array() && plan["metrics"]["images"].as_u64().unwrap() > 5, "{rig}");
        let cruises_slowly = plan["limits"]["cruise_mps"].as_f64().unwrap() < 8.0;
        assert_eq!(cruises_slowly, look.contains(&"--overlap"), "{rig}");
    }
}

#[test]
fn a_daemon_that_serves_another_sight_says_so() {
    let place = Place::new();
    let _daemon = place.serve(&[]);
    place.json(&["load", &place.scene()]);
    let remark = || place.json(&["status"])["scenes"][0]["remark"].as_str().map(str::to_owned);
    place.json(&["plan", "town", "--rig", "phantom4-rtk", "--method", "paper", "--iterations", "5"]);
    assert_eq!(remark(), None);
    place.json(&["plan", "town", "--rig", "m300-oblique", "--method", "paper", "--iterations", "5"]);
    assert!(remark().is_some_and(|remark| remark.contains("serve --rig")), "{:?}", place.json(&["status"]));
}

#[test]
fn a_file_of_any_name_gives_the_same_plan_by_the_daemon_and_in_the_process_itself() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    std::fs::create_dir(place.path("old town (1)")).unwrap();
    let long = format!("{}.geojson", "ä".repeat(100));
    for (index, file) in ["town (1).geojson", "old town (1)/buildings.geojson", "~.GeoJSON", &long].into_iter().enumerate() {
        std::fs::copy(place.path(&scene), place.path(file)).unwrap();
        let name = place.json(&["load", file])["scene"].as_str().unwrap().to_owned();
        let (daemon, process) = (format!("daemon-{index}"), format!("process-{index}"));
        place.json(&["plan", &name, "--method", "paper", "--iterations", "20", "--out", &daemon]);
        place.json(&["plan", file, "--method", "paper", "--iterations", "20", "--out", &process]);
        let read = |folder: &str| place.read(&format!("{folder}/plan.json"));
        assert_eq!(read(&daemon), read(&process), "{file}");
    }
}

#[test]
fn a_file_that_the_daemon_cannot_read_is_sent() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    std::fs::create_dir(place.path("harbour")).unwrap();
    // What comes out of a pipe can be read once, and not by the daemon.
    let pipe = place.path("harbour/buildings.geojson");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR).unwrap();
    let content = place.read(&scene);
    let output = std::thread::scope(|threads| {
        threads.spawn(|| std::fs::write(&pipe, content).unwrap());
        place.run(&["load", "harbour/buildings.geojson"])
    });
    let remarks = program::stderr(&output);
    assert!(output.status.success() && remarks.contains("its content is sent"), "{remarks}");
    let loaded = &place.json(&["status"])["scenes"][0];
    assert_eq!((&loaded["name"], &loaded["structures"]), (&"harbour".into(), &4.into()));
}

#[test]
fn a_search_is_cancelled_and_a_scene_unloaded() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    place.json(&["load", &scene]);
    let plan = place
        .command(&["plan", "town", "--method", "paper", "--iterations", "10000000", "--json"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    while place.json(&["status"])["scenes"][0]["state"] != "planning" {}
    assert_eq!(place.json(&["cancel", "town"])["cancelled"], true);
    let output = plan.wait_with_output().unwrap();
    let plan: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(output.status.success() && plan["waypoints"].as_u64().unwrap() >= 1, "{plan}");
    assert_eq!(place.json(&["unload", "town"])["unloaded"], true);
    assert_eq!(place.json(&["status"])["scenes"], serde_json::json!([]));
}

#[test]
fn a_scene_is_loaded_listed_edited_and_replanned() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&["--domain", "other"]);
    let at = ["--domain", "other"];
    let json = |words: &[&str]| place.json(&[words, at.as_slice()].concat());

    assert_eq!(json(&["load", &scene, "--name", "harbour"])["scene"], "harbour");
    let structures = json(&["status", "harbour"]);
    let names: Vec<&str> = structures["structures"].as_array().unwrap().iter().map(|row| row["name"].as_str().unwrap()).collect();
    assert_eq!((names.len(), names.contains(&"tower")), (4, true), "{names:?}");
    let id = structures["structures"][0]["id"].as_str().unwrap().to_owned();

    assert_eq!(json(&["edit", "harbour", "lower", "tower", "--by", "2"])["replan_follows"], false);
    json(&["plan", "harbour", "--method", "paper", "--iterations", "40"]);
    let replan = json(&["edit", "harbour", "raise", &id, "--by", "15", "--out", "replan"]);
    assert_eq!(
        (&replan["revision"], place.files("replan")),
        (&3.into(), vec!["plan.html".into(), "plan.json".into(), "plan.svg".into(), "run.json".into()])
    );
    let run: Value = serde_json::from_slice(&place.read("replan/run.json")).unwrap();
    assert!(run["times"]["edit_to_plan_s"].as_f64().unwrap() > 0.0);

    json(&["edit", "harbour", "add", "--name", "crane", "--outline", "70,0 78,0 78,8 70,8", "--height", "20", "--no-wait"]);
    json(&["edit", "harbour", "move", "crane", "--by", "-1,2.5"]);
    let last = json(&["edit", "harbour", "remove", "crane"]);
    assert_eq!(last["revision"], 6);
    let status = json(&["status"]);
    assert_eq!((&status["domain"], &status["scenes"][0]["revision"]), (&"other".into(), &6.into()));
}

#[test]
fn shapes_zones_and_lists_of_edits_are_made_by_commands() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    place.json(&["load", &scene]);
    let roof = "o a\nv 80 0 0\nv 90 0 0\nv 90 10 0\nv 85 5 9\no b\nf 1 2 4\nf 2 3 4\n";
    std::fs::write(place.path("roof.obj"), roof).unwrap();
    place.json(&["edit", "town", "add", "--name", "roof", "--mesh", "roof.obj"]);
    place.json(&["edit", "town", "add", "--name", "hook", "--centre", "-60,0,30", "--size", "2,3,4", "--yaw", "-30"]);
    place.json(&["edit", "town", "add-zone", "--name", "pad", "--outline", "-9,-90 9,-90 0,-70", "--ceiling", "50"]);
    let walls = ["--outline", "60,60 70,60 70,70", "--height", "20"];
    place.json(&[&["edit", "town", "replace", "shed"], walls.as_slice()].concat());
    let content = place.json(&["status", "town"]);
    let kind = |name: &str| {
        let rows = content["structures"].as_array().unwrap();
        rows.iter().find(|row| row["name"] == name).map(|row| (row["kind"].clone(), row["top_m"].clone()))
    };
    assert_eq!(kind("roof"), Some(("mesh".into(), 9.0.into())));
    assert_eq!(kind("hook"), Some(("obstacle".into(), 32.0.into())));
    assert_eq!(kind("shed"), Some(("prism".into(), 20.0.into())));
    assert_eq!(content["zones"], serde_json::json!([{ "name": "pad", "floor_m": 0.0, "ceiling_m": 50.0, "by_edit": true }]));

    let batch = |name: &str, last: Value| {
        let list =
            serde_json::json!([{ "raise": { "structure": "tower", "by_m": 3 } }, { "remove-zone": { "name": "pad" } }, last]);
        std::fs::write(place.path(name), list.to_string()).unwrap();
    };
    batch("bad.json", serde_json::json!({ "remove": { "structure": "gone" } }));
    let message = place.fails(5, "refused", &["edit", "town", "batch", "bad.json"]);
    assert!(message.starts_with("edit 3 of 3: ") && message.contains("gone"), "{message}");
    batch("good.json", serde_json::json!({ "move": { "structure": "roof", "by_m": [1, 1] } }));
    assert_eq!(place.json(&["edit", "town", "batch", "good.json"])["revision"], 6);
    batch("wrong.json", serde_json::json!({ "remove": { "name": "roof" } }));
    let message = place.fails(3, "input_file", &["edit", "town", "batch", "wrong.json"]);
    assert!(message.contains("wrong.json") && message.contains("[2].remove"), "{message}");
    place.fails(3, "input_file", &["edit", "town", "replace", "roof", "--mesh", &scene]);
    place.fails(2, "usage", &["edit", "town", "replace", "roof", "--mesh", "roof.obj", "--height", "3"]);
    assert_eq!(place.json(&["status"])["scenes"][0]["revision"], 6);
}

#[test]
fn a_new_version_of_a_file_is_compared_and_taken_over() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    place.json(&["load", &scene]);
    place.json(&["plan", "town", "--method", "paper", "--iterations", "40"]);
    place.json(&["edit", "town", "add", "--name", "hook", "--centre", "-60,0,30", "--size", "2,3,4", "--no-wait"]);
    let mut version: Value = serde_json::from_slice(&place.read(&scene)).unwrap();
    let features = version["features"].as_array_mut().unwrap();
    features[1]["properties"]["height"] = 30.into();
    features.remove(2);
    std::fs::write(place.path("town-2.geojson"), version.to_string()).unwrap();
    let told = place.json(&["update", "town", "town-2.geojson", "--dry-run"]);
    assert_eq!((&told["revision"], &told["changes"]["changed"]), (&2.into(), &serde_json::json!(["tower"])));
    assert_eq!(told["changes"]["removed"], serde_json::json!(["shed"]));
    let text = program::stdout(&place.run(&["update", "town", "town-2.geojson", "--dry-run"]));
    assert!(text.contains("1 removed: shed") && text.contains("nothing was changed"), "{text}");
    let made = place.json(&["update", "town", "town-2.geojson", "--out", "after"]);
    assert_eq!((&made["revision"], &made["changes"]), (&3.into(), &told["changes"]));
    assert_eq!(place.files("after"), ["plan.html", "plan.json", "plan.svg", "run.json"]);
    let names: Vec<Value> =
        place.json(&["status", "town"])["structures"].as_array().unwrap().iter().map(|row| row["name"].clone()).collect();
    assert!(names.len() == 4 && names.contains(&"hook".into()), "{names:?}");
    let same = program::stdout(&place.run(&["update", "town", "town-2.geojson"]));
    assert!(same.contains("nothing was changed"), "{same}");
    place.fails(3, "input_file", &["update", "town", "missing.geojson"]);
    place.fails(5, "refused", &["update", "city", "town-2.geojson"]);
}

#[test]
fn a_configuration_is_read_again_on_request() {
    let place = Place::new();
    let scene = place.scene();
    std::fs::write(place.path("aircraft.toml"), "[surface]\nsamples = 100\n").unwrap();
    let _daemon = place.serve(&["--config", "aircraft.toml"]);
    let coarse = place.json(&["load", &scene])["samples"].as_u64().unwrap();
    std::fs::write(place.path("aircraft.toml"), "[surface]\nsamples = 800\n").unwrap();
    assert_eq!(place.json(&["reload"])["reloaded"], true);
    let fine = place.json(&["load", &scene])["samples"].as_u64().unwrap();
    assert!(fine > 4 * coarse, "{coarse}, then {fine}");

    std::fs::write(place.path("aircraft.toml"), "[surface]\nsamples = \"many\"\n").unwrap();
    let message = place.fails(3, "input_file", &["reload"]);
    assert!(message.contains("aircraft.toml"), "{message}");
}

#[test]
fn a_watcher_receives_each_plan_on_a_line_of_its_own() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    place.json(&["load", &scene]);
    let mut watcher =
        place.command(&["watch", "town", "--count", "2", "--out", "seen", "--json"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(watcher.stdout.take().unwrap()).lines();
    // A watcher sees what is published after it has come; plan until it reports the first one.
    let first = std::thread::scope(|scope| {
        let first = scope.spawn(|| lines.next().unwrap().unwrap());
        while !first.is_finished() {
            place.json(&["plan", "town", "--method", "paper", "--iterations", "10"]);
        }
        first.join().unwrap()
    });
    place.json(&["plan", "town", "--method", "paper", "--iterations", "20", "--seed", "9"]);
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert!(watcher.wait().unwrap().success() && rest.len() == 1, "{rest:?}");
    for line in [&first, &rest[0]] {
        let plan: Value = serde_json::from_str(line).unwrap();
        assert_eq!(plan["scene"], "town", "{plan}");
    }
    assert!(place.files("seen").iter().any(|name| name == "revision-1-seed-1.json"));
}

#[test]
fn a_followed_status_shows_each_scene_that_comes() {
    let place = Place::new();
    let scene = place.scene();
    let _daemon = place.serve(&[]);
    let mut follower = place.command(&["status", "--follow", "--json"]).stdout(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(follower.stdout.take().unwrap()).lines();
    let mut seen = lines.map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap());
    assert_eq!(seen.next().unwrap()["scenes"], serde_json::json!([]));
    place.json(&["load", &scene]);
    assert!(seen.any(|status| status["scenes"][0]["name"] == "town" && status["scenes"][0]["state"] == "idle"));
    follower.kill().unwrap();
    follower.wait().unwrap();
}

#[test]
fn refusals_of_the_daemon_name_the_cause_and_have_their_exit_codes() {
    let place = Place::new();
    let scene = place.scene();
    std::fs::write(place.path("empty.geojson"), br#"{"type":"FeatureCollection","features":[]}"#).unwrap();
    let _daemon = place.serve(&[]);
    place.json(&["load", &scene]);
    for (code, kind, words, cause) in [
        (5, "refused", vec!["plan", "village"], "village"),
        (5, "refused", vec!["watch", "village"], "village"),
        (5, "refused", vec!["cancel", "village"], "village"),
        (5, "refused", vec!["unload", "village"], "village"),
        (3, "input_file", vec!["plan", "village.geojson"], "No such file"),
        (5, "refused", vec!["status", "village"], "village"),
        (5, "refused", vec!["edit", "town", "remove", "castle"], "castle"),
        (5, "refused", vec!["edit", "town", "lower", "shed", "--by", "50"], "shed"),
        (6, "no_plan", vec!["plan", "town", "--rig", "kite"], "panoramic"),
        (6, "no_plan", vec!["plan", "town", "--look", "90,-30"], "no gimbal"),
        (6, "no_plan", vec!["plan", "town", "--rig", "phantom4-rtk", "--start", "0,0,5000"], "start"),
        (3, "input_file", vec!["plan", "town", "--rig", "/dev/zero"], "65536 bytes"),
        (6, "no_plan", vec!["plan", "town", "--start", "0,0,5000"], "start"),
        (3, "input_file", vec!["load", "empty.geojson"], "empty.geojson"),
        (2, "usage", vec!["plan", "town", "--samples", "10"], "--samples"),
    ] {
        let message = place.fails(code, kind, &words);
        assert!(message.contains(cause), "{words:?}: {message}");
    }
    assert_eq!(place.json(&["status"])["scenes"][0]["revision"], 1);
}

#[test]
fn a_second_daemon_in_the_same_domain_says_so() {
    let place = Place::new();
    let daemon = place.serve(&[]);
    let message = place.fails(4, "no_daemon", &["serve"]);
    assert!(message.contains(&daemon.child.id().to_string()) && message.contains("--domain"), "{message}");
}

#[test]
fn a_stopped_daemon_ends_and_leaves_no_files() {
    let place = Place::new();
    let scene = place.scene();
    let mut daemon = place.serve(&[]);
    place.json(&["load", &scene]);
    assert_eq!(place.json(&["stop"])["stopped"], true);
    assert!(daemon.child.wait().unwrap().success());
    assert!(!place.path("overfly/overfly").exists(), "{:?}", place.files("overfly"));
}

#[test]
fn the_ipc_bench_measures_a_daemon_of_its_own() {
    let place = Place::new();
    let scene = place.scene();
    let answer = place.json(&["bench", "ipc", &scene, "--repeat", "1"]);
    let steps = answer["steps"].as_array().unwrap();
    assert!(steps.len() >= 3 && steps.iter().all(|row| row["median"].as_f64().unwrap() > 0.0), "{answer}");
    assert!(!place.path("overfly").exists());
}

#[test]
fn the_replan_bench_tells_how_long_the_first_safe_plan_takes_and_what_it_keeps() {
    let place = Place::new();
    let scene = place.scene();
    let small = ["--edits", "6", "--iterations", "3", "--repeat", "1", "--samples", "150", "--viewpoints", "200"];
    let answer = place.json(&[&["bench", "replan", scene.as_str()], small.as_slice()].concat());
    let steps = answer["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 7, "{answer}");
    assert!(steps.iter().all(|row| row["max"].as_f64().unwrap() >= row["median"].as_f64().unwrap()), "{answer}");
    // Each edit is followed by a plan that tells what it captures, and none before the one that is safe.
    let counted = &answer["first_counted_plan_ms"];
    assert!(steps[3]["repeats"] == 6 && counted["max"].as_f64() > answer["first_safe_plan_ms"]["max"].as_f64(), "{answer}");
    assert!(steps[..3].iter().all(|row| row["repeats"] == 2 && row["median"].as_f64().unwrap() > 0.0), "{answer}");
    assert!(answer["facts"]["least_coverage_kept_percent"].as_f64().unwrap() > 50.0, "{answer}");
    assert!(!place.path("overfly").exists());
}

#[test]
fn the_warm_bench_tells_when_a_flight_is_as_good_as_a_cold_one_and_when_a_cancelled_search_ends() {
    let place = Place::new();
    let scene = place.scene();
    let small = ["--iterations", "4", "--repeat", "2", "--samples", "150", "--viewpoints", "200"];
    let answer = place.json(&[&["bench", "warm", scene.as_str()], small.as_slice()].concat());
    let steps = answer["steps"].as_array().unwrap();
    // Three cold plans are made after each edit; searches of both kinds are cancelled.
    let repeats: Vec<Option<u64>> = steps.iter().map(|step| step["repeats"].as_u64()).collect();
    assert_eq!(repeats, [2, 2, 6, 2, 2, 4].map(Some), "{answer}");
    // What never became as good took no time that could be told.
    let never = answer["facts"]["never_as_good"].as_u64().unwrap();
    assert!(never > 0 || steps[0]["median"].as_f64().unwrap() > 0.0, "{answer}");
    assert!(steps[1..].iter().all(|row| row["median"].as_f64().unwrap() > 0.0), "{answer}");
}

#[test]
fn the_demo_writes_both_plans_and_leaves_nothing_else() {
    let place = Place::new();
    let demo = place.command(&["demo", "--json"]).stdout(Stdio::piped()).spawn().unwrap();
    let domain = Domain::in_directory(&format!("demo-{}", demo.id()), &place.path("overfly")).unwrap();
    let output = demo.wait_with_output().unwrap();
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        place.files("overfly-out/demo"),
        [
            "daemon.log",
            "flight.svg",
            "plan.html",
            "plan.json",
            "plan.svg",
            "replan-run.json",
            "replan-vs-plan.html",
            "replan.html",
            "replan.json",
            "replan.svg",
            "run.json",
            "scene.geojson"
        ]
    );
    let in_the_air = &answer["in_the_air"];
    assert_eq!(in_the_air["first_plan_ms"].as_array().unwrap().len(), 3, "{in_the_air}");
    let [landed, planned] = [in_the_air, &answer["replan"]].map(|flight| flight["coverage_percent"].as_f64().unwrap());
    assert!(landed > planned - 3.0, "{landed} % after three changes, {planned} % without");
    for (drawn, shown) in [("plan.svg", "demo.svg"), ("flight.svg", "flight.svg")] {
        let [drawn, shown] = [
            place.path("overfly-out/demo").join(drawn),
            Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pictures").join(shown),
        ];
        assert!(std::fs::read(&drawn).unwrap() == std::fs::read(&shown).unwrap(), "the README shows another {}", drawn.display());
    }
    assert_eq!((&answer["plan"]["revision"], &answer["replan"]["revision"]), (&1.into(), &2.into()));
    assert!(!place.path("overfly").exists());
    assert_eq!(domain.shared_memory_files(), Vec::<PathBuf>::new());
}

#[test]
fn a_demo_that_is_killed_takes_its_daemon_along() {
    let place = Place::new();
    let mut demo = place.command(&["demo"]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let log = place.path("overfly-out/demo/daemon.log");
    while !std::fs::read_to_string(&log).is_ok_and(|text| text.contains("serving")) {
        assert!(demo.try_wait().unwrap().is_none(), "the demo ended before it was killed");
    }
    demo.kill().unwrap();
    demo.wait().unwrap();
    while !std::fs::read_to_string(&log).unwrap().contains("ended") {
        std::thread::yield_now();
    }
}
