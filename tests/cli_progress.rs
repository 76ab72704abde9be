//! What a terminal sees while a command works, and that nobody else does.

mod program;

use std::fs::File;
use std::io::Read;
use std::process::Stdio;

use program::{Daemon, Place};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

const FINE: [&str; 4] = ["--samples", "4000", "--viewpoints", "9000"];

/// What `words` write to a terminal as standard error.
fn on_terminal(place: &Place, words: &[&str]) -> String {
    let own = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&own).unwrap();
    unlockpt(&own).unwrap();
    let name = ptsname(&own, Vec::new()).unwrap();
    let terminal = rustix::fs::open(name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap();
    let mut command = place.command(words);
    command.env("TERM", "xterm").stdout(Stdio::null()).stderr(Stdio::from(terminal));
    let mut child = command.spawn().unwrap();
    // The command holds the other end; without it, reading ends with the child.
    drop(command);
    let (mut seen, mut part, mut own) = (Vec::new(), [0; 4096], File::from(own));
    while let Ok(count) = own.read(&mut part) {
        seen.extend_from_slice(&part[..count]);
    }
    assert!(child.wait().unwrap().success());
    String::from_utf8_lossy(&seen).into_owned()
}

fn block(place: &Place) {
    place.json(&["generate", "--seed", "3", "--buildings", "40", "--out", "block.geojson"]);
}

/// Steps of steps as they are told with `unit`, without those that repeat.
fn told(seen: &str, part: &str, unit: &str) -> Vec<(u64, u64)> {
    let begin = format!("{part} [");
    let bars = seen.split(&begin).skip(1).filter_map(|bar| bar.split_once("] ")?.1.split_once(unit));
    let mut steps: Vec<(u64, u64)> = bars
        .filter_map(|(steps, _)| {
            let (done, of) = steps.trim().split_once('/')?;
            Some((done.parse().ok()?, of.parse().ok()?))
        })
        .collect();
    steps.dedup();
    steps
}

#[test]
fn a_field_and_a_search_tell_how_far_they_are_and_how_long_they_take() {
    let place = Place::new();
    block(&place);
    let seen = on_terminal(&place, &[&["plan", "block.geojson", "--iterations", "40"], FINE.as_slice()].concat());
    for (part, unit) in [("field", "viewpoints"), ("search", "iterations")] {
        let steps = told(&seen, part, unit);
        // The field may stand before it is told twice how far it is.
        let least = if part == "field" { 1 } else { 2 };
        assert!(steps.len() >= least && steps.is_sorted(), "{part}: {steps:?} in {seen:?}");
        assert!(steps.iter().all(|(done, of)| done <= of && *of > 0), "{part}: {steps:?}");
    }
    assert!(seen.contains(" s left"), "{seen:?}");
}

#[test]
fn the_daemon_tells_how_far_the_field_is_that_it_loads() {
    let place = Place::new();
    block(&place);
    std::fs::write(place.path("fine.toml"), "[surface]\nsamples = 4000\n[field]\nviewpoints = 9000\n").unwrap();
    let _daemon: Daemon = place.serve(&["--config", "fine.toml"]);
    let steps = told(&on_terminal(&place, &["load", "block.geojson"]), "field", "viewpoints");
    assert!(!steps.is_empty() && steps.is_sorted(), "{steps:?}");
}

#[test]
fn scripts_and_files_see_no_progress() {
    let place = Place::new();
    let scene = place.scene();
    let plan = ["plan", &scene, "--iterations", "4"];
    assert_eq!(on_terminal(&place, &[&plan, ["--json"].as_slice()].concat()), "");
    let output = place.run(&plan);
    assert!(!program::stderr(&output).contains("iterations"), "{}", program::stderr(&output));
}
