//! Plans of scene files without a daemon: what is printed and written, how they repeat themselves, and what a search shows before its end.

mod program;

use program::{Place, stderr, stdout};
use serde_json::Value;

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
