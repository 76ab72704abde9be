//! `overfly bound` as a user runs it: what it prints and writes, that its figures agree with one another, and how it fails.

mod program;

use std::process::{Child, Output, Stdio};

use program::{Place, stderr, stdout};
use serde_json::Value;

/// A graph on which a round takes a fraction of a second.
const SMALL: [&str; 8] = ["--samples", "30", "--viewpoints", "60", "--waypoints", "60", "--rounds", "60"];

/// Writes a block of two low buildings, and settings with so many rounds of the bound; returns the line up to the sizes.
fn small_block(place: &Place, most_rounds: u32) -> Vec<&'static str> {
    let block = ["generate", "--extent", "60,60", "--buildings", "2", "--tallest", "20", "--out", "block.geojson"];
    assert!(place.run(&block).status.success());
    std::fs::write(place.path("few.toml"), format!("[bound]\nmost_rounds = {most_rounds}\n")).unwrap();
    [&["bound", "block.geojson", "--config", "few.toml"], &SMALL[..]].concat()
}

fn number(answer: &Value, key: &str) -> f64 {
    answer[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {answer}"))
}

/// Length of the way through the places, m.
fn flown_m(places: &Value) -> f64 {
    let places: Vec<[f64; 3]> = serde_json::from_value(places.clone()).unwrap();
    let leg_m = |ends: &[[f64; 3]]| (0..3).map(|k| (ends[1][k] - ends[0][k]).powi(2)).sum::<f64>().sqrt();
    places.windows(2).map(leg_m).sum()
}

/// The answer without what depends on the machine.
fn timeless(mut answer: Value) -> Value {
    answer.as_object_mut().unwrap().remove("total_s").expect("the time is told");
    answer
}

#[test]
fn the_ratio_is_that_of_a_flown_plan_to_a_bound_below_it() {
    let place = Place::new();
    let words = small_block(&place, 8);
    let answer = place.json(&words);
    let (bound_m, plan_m, ratio) = (number(&answer, "bound_m"), number(&answer["plan"], "length_m"), number(&answer, "ratio"));
    assert!(bound_m > 0.0 && bound_m <= plan_m, "{answer}");
    assert!((ratio - plan_m / bound_m).abs() < 1e-9, "{answer}");
    // Legs are rounded down to whole micrometres.
    let way_m = flown_m(&answer["plan"]["waypoints_m"]);
    let legs = answer["plan"]["waypoints_m"].as_array().unwrap().len() - 1;
    assert!(way_m >= plan_m - 1e-9 && way_m - plan_m < 1e-6 * legs as f64 + 1e-9, "{way_m} m, {answer}");
    assert!(number(&answer["plan"], "captured") >= number(&answer, "sufficient"), "{answer}");
    assert!(number(&answer, "sufficient") <= number(&answer, "capturable") && number(&answer, "waypoints") <= 60.0);
}

#[test]
fn table_json_and_file_tell_the_same() {
    let place = Place::new();
    let words = small_block(&place, 4);
    let answer = place.json(&[&words[..], &["--out", "out"]].concat());
    assert_eq!(place.files("out"), ["bound.json"]);
    assert_eq!(serde_json::from_slice::<Value>(&place.read("out/bound.json")).unwrap(), answer);
    assert_eq!(
        (&answer["format"], &answer["scene"], &answer["rig"]),
        (&"overfly-bound/1".into(), &"block".into(), &"panoramic".into())
    );
    assert_eq!((&answer["rounds"], &answer["ended"]), (&4.into(), &"most_rounds".into()));

    let table = stdout(&place.run(&words));
    let value_of = |row: &str| -> f64 {
        let line = table.lines().find(|line| line.trim_start().starts_with(row)).unwrap_or_else(|| panic!("no {row} in {table}"));
        line.split_whitespace().last().and_then(|value| value.parse().ok()).unwrap_or_else(|| panic!("{line}"))
    };
    assert!((value_of("certified lower bound, m") - number(&answer, "bound_m")).abs() <= 0.051, "{table}");
    assert!((value_of("plan on the same graph, m") - number(&answer["plan"], "length_m")).abs() <= 0.051, "{table}");
    // The factor is rounded up, so that the sentence holds.
    let over = value_of("times the optimum, at most") - number(&answer, "ratio");
    assert!((-1e-9..0.01 + 1e-9).contains(&over), "{table}");
    assert!(table.contains(answer["statement"].as_str().unwrap()) && table.contains("`bound.most_rounds`"), "{table}");
}

#[test]
fn more_rounds_never_lower_the_bound_and_threads_change_nothing() {
    let place = Place::new();
    let one = place.json(&small_block(&place, 1));
    let words = small_block(&place, 6);
    let on_threads = |threads: &str| -> Value {
        let output = place.command(&[&words[..], &["--json"]].concat()).env("RAYON_NUM_THREADS", threads).output().unwrap();
        timeless(serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stderr(&output))))
    };
    let six = on_threads("1");
    assert_eq!(six, on_threads("3"));
    assert!(number(&one, "bound_m") < number(&six, "bound_m") && one["plan"] == six["plan"], "{one} {six}");
}

#[test]
fn a_camera_on_a_gimbal_is_bounded_without_a_plan_beside_it() {
    let place = Place::new();
    let answer = place.json(&[&small_block(&place, 12)[..], &["--rig", "phantom4-rtk"]].concat());
    assert!(number(&answer, "bound_m") > 0.0 && answer["plan"].is_null() && answer["ratio"].is_null(), "{answer}");
    assert!(answer["statement"].as_str().unwrap().contains("one of the discretised directions"), "{answer}");
}

#[test]
fn what_cannot_be_bounded_says_why_and_what_helps() {
    let place = Place::new();
    let words = small_block(&place, 1);
    std::fs::write(place.path("narrow.toml"), "[bound]\nmost_sightings = 100\n").unwrap();
    let narrow = place.fails(6, "no_plan", &[&["bound", "block.geojson", "--config", "narrow.toml"], &SMALL[..]].concat());
    for part in ["too large", "more than 100 times", "`--samples`", "`--waypoints`", "`bound.most_sightings`"] {
        assert!(narrow.contains(part), "{part} is not in {narrow}");
    }
    let few = place.fails(6, "no_plan", &["bound", "block.geojson", "--waypoints", "2", "--samples", "30", "--viewpoints", "60"]);
    assert!(few.contains("`--waypoints`") && few.contains("`--viewpoints`"), "{few}");
    assert!(place.fails(6, "no_plan", &[&words[..], &["--rig", "kite"]].concat()).contains("known rigs: panoramic"));

    std::fs::write(place.path("wrong.toml"), "[bound]\nnested_cuts = 0\n").unwrap();
    let wrong = place.fails(3, "input_file", &["bound", "block.geojson", "--config", "wrong.toml"]);
    assert!(wrong.contains("bound.nested_cuts") && wrong.contains("between 1 and 1000"), "{wrong}");
    assert!(place.fails(3, "input_file", &["bound", "nothing.geojson"]).contains("nothing.geojson"));
    assert!(place.fails(2, "usage", &["bound", "block.geojson", "--waypoints", "1001"]).contains("1000"));
    place.fails(2, "usage", &["bound", "block.geojson", "--rounds", "0"]);
    std::fs::write(place.path("taken"), b"").unwrap();
    assert!(place.fails(1, "unexpected", &[&words[..], &["--out", "taken/out"]].concat()).contains("taken/out"));
}

/// A bound that never ends by itself.
fn endless(place: &Place) -> Child {
    let words = small_block(place, 1_000_000);
    let rows = "still_rounds = 1000000\nleast_violation = 0.000001\nleast_visit = 0.000001\n";
    std::fs::write(place.path("few.toml"), format!("[bound]\nmost_rounds = 1000000\n{rows}")).unwrap();
    let mut command = place.command(&[&words[..], &["--out", "out"]].concat());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn interrupted(child: Child) -> Output {
    rustix::process::kill_process(rustix::process::Pid::from_child(&child), rustix::process::Signal::INT).unwrap();
    child.wait_with_output().unwrap()
}

/// The first round stands after a tenth of a second of computing; the signal comes after two.
#[test]
fn an_interrupted_bound_is_the_best_so_far() {
    let place = Place::new();
    let mut child = endless(&place);
    let computed_ticks = |child: &Child| -> u64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
    };
    let enough = 2 * rustix::param::clock_ticks_per_second();
    while child.try_wait().unwrap().is_none() && computed_ticks(&child) < enough {
        std::thread::yield_now();
    }
    let output = interrupted(child);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stdout(&output).contains("stopped: the bound holds"), "{}", stdout(&output));
    let answer: Value = serde_json::from_slice(&place.read("out/bound.json")).unwrap();
    assert!(answer["ended"] == "stopped" && number(&answer, "bound_m") > 0.0, "{answer}");
    assert!(number(&answer, "bound_m") <= number(&answer["plan"], "length_m"), "{answer}");
}

/// The signal is sent as soon as the process catches it: hardly ever there is a bound by then.
#[test]
fn an_interrupt_before_there_is_a_bound_has_an_exit_code_of_its_own() {
    const CATCHES_INT: u64 = 1 << 1;
    let place = Place::new();
    let mut child = endless(&place);
    let catches = |child: &Child| {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap().trim().to_owned();
        u64::from_str_radix(&mask, 16).unwrap() & CATCHES_INT != 0
    };
    while child.try_wait().unwrap().is_none() && !catches(&child) {}
    let output = interrupted(child);
    match output.status.code() {
        Some(0) => assert_eq!(place.files("out"), ["bound.json"]),
        Some(130) => assert!(!place.path("out").exists() && stderr(&output).contains("interrupted"), "{}", stderr(&output)),
        other => panic!("{other:?}: {}", stderr(&output)),
    }
}
