//! `overfly fly` against an aircraft at the other end of a UDP socket, with a real daemon: over a link that loses messages the mission goes up, is
//! followed, gives way to newer plans, survives the loss of link and daemon, and is refused in words that help.

mod autopilot;
mod served;

use std::collections::VecDeque;
use std::io::{BufRead, BufReader};
use std::net::{SocketAddr, UdpSocket};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use autopilot::Manner;
use autopilot::aircraft::{Aircraft, SPEED_MPS};
use nalgebra::{Point3, distance};
use overfly::autopilot::dialect::{MISSION_ITEM_INT_DATA, MavCmd, MavMissionResult};
use overfly::mission::plan_table;
use overfly_client::{Client, EditOrder, PlanOrder};
use serde_json::Value;
use served::{PATIENCE, Served, block};

/// Where the aircraft stands: at the origin of generated blocks.
const HOME: [f64; 3] = [52.0116, 4.3571, 0.0];
const HOME_WORDS: [&str; 4] = ["--home", "52.0116,4.3571", "--sortie-time", "3000"];

/// The program, and what it has said.
struct Fly {
    child: Child,
    lines: Receiver<Value>,
    seen: VecDeque<Value>,
}

impl Fly {
    fn start(served: &Served, link: SocketAddr, words: &[&str]) -> Self {
        let link = format!("udpin:{link}");
        let words = [&["fly", "block", "--domain", served.domain.name(), "--link", link.as_str(), "--json"], words].concat();
        let mut command = Command::new(env!("CARGO_BIN_EXE_overfly"));
        let mut child = command.args(words).stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            let lines = output.lines().map_while(Result::ok);
            lines.map(|line| serde_json::from_str(&line).unwrap()).try_for_each(|line| sender.send(line))
        });
        Self { child, lines, seen: VecDeque::new() }
    }

    /// The next line that `is_meant`; those before it are passed over.
    fn next(&mut self, what: &str, is_meant: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + 3 * PATIENCE;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let Ok(line) = self.lines.recv_timeout(left) else { panic!("no {what}; before: {:#?}", self.seen) };
            self.seen.push_back(line.clone());
            if self.seen.len() > 12 {
                self.seen.pop_front();
            }
            if is_meant(&line) {
                return line;
            }
            assert!(line["error"].is_null(), "instead of {what}: {line}");
        }
    }

    fn event(&mut self, name: &str) -> Value {
        self.next(name, |line| line["event"] == name)
    }

    /// Runs to its end.
    fn code(&mut self) -> i32 {
        let started = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code().expect("it was not killed");
            }
            assert!(started.elapsed() < PATIENCE, "it does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn interrupt(&self) {
        assert!(Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap().success());
    }
}

impl Drop for Fly {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An address of this machine that is free.
fn free_address() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// A daemon with a block that is planned.
fn planned() -> (Served, Client) {
    let served = Served::start();
    let client = served.client();
    plan(&client, 1);
    (served, client)
}

fn plan(client: &Client, seed: u64) -> u64 {
    client.load(block(1, 9), Some("block"), &mut |_| {}).unwrap();
    let order = PlanOrder { iterations: Some(6), goal_percent: Some(80.0), seed, ..PlanOrder::default() };
    client.plan("block", &order, &mut |_| {}).unwrap().epoch()
}

fn highest(client: &Client) -> String {
    let structures = client.structures("block").unwrap();
    structures.into_iter().max_by(|a, b| a.top_m.total_cmp(&b.top_m)).unwrap().name
}

/// What `--dry-run` prints, and what the aircraft has.
fn rows(mission: &[MISSION_ITEM_INT_DATA]) -> Vec<Value> {
    let number = |value: f32| (!value.is_nan()).then_some(value);
    let row = |item: &MISSION_ITEM_INT_DATA| {
        let params = [item.param1, item.param2, item.param3, item.param4].map(number);
        serde_json::json!([item.command as u32, item.frame as u8, params, item.x, item.y, item.z])
    };
    mission.iter().map(row).collect()
}

#[test]
fn a_flight_is_followed_and_goes_over_to_the_plan_after_an_edit_without_a_pause() {
    let (served, client) = planned();
    let link = free_address();
    let aircraft = Aircraft::start(link, Manner::default(), HOME, 50);
    let mut fly = Fly::start(&served, link, &HOME_WORDS);
    assert_eq!(fly.event("found")["autopilot"], "px4");
    let first = fly.event("uploaded");

    let words = [&["fly", "block", "--domain", served.domain.name(), "--dry-run", "--json"][..], &HOME_WORDS].concat();
    let output = Command::new(env!("CARGO_BIN_EXE_overfly")).args(words).output().unwrap();
    let shown: Value = serde_json::from_slice(&output.stdout).unwrap();
    let shown = shown["items"].as_array().unwrap().iter();
    let shown: Vec<Value> =
        shown.map(|row| serde_json::json!([row["command"], row["frame"], row["params"], row["x"], row["y"], row["z"]])).collect();
    assert_eq!(aircraft.with(|control| rows(&control.model.mission)), shown, "the aircraft has what was to be sent");
    assert_eq!(first["items"], shown.len());

    let watch = client.watch("block").unwrap();
    aircraft.take_off();
    let progress = fly.next("progress to waypoint 3", |line| line["waypoint"].as_u64().is_some_and(|waypoint| waypoint >= 3));
    // Time for a report.
    std::thread::sleep(Duration::from_millis(700));
    let edited = client.edit("block", &EditOrder::Raise { structure: highest(&client), by_m: 15.0 }).unwrap();
    let edit_s = Instant::now();
    let safe = watch.next(PATIENCE).unwrap().expect("a plan after the edit");
    let (new, _) = plan_table::from_table(&safe.table()).unwrap();
    let was: Vec<f64> = serde_json::from_value(progress["position_m"].clone()).unwrap();
    let off_m = distance(&new.waypoints[0].position_m, &Point3::new(was[0], was[1], was[2]));
    assert!(off_m < 80.0, "the new path begins {off_m} m from where the aircraft was a second before");
    let joined = fly.event("joined");
    assert!(joined["epoch"].as_u64() > first["epoch"].as_u64(), "{joined}");
    // No farther than it flies in the time that planning and upload have taken more or less than was reckoned with.
    let most_m = SPEED_MPS * (edit_s.elapsed().as_secs_f64() + 2.0);
    assert!(joined["off_path_m"].as_f64().unwrap() < most_m, "{joined}, {most_m}");
    println!("joined {} m off the path, {:.1} s after the edit", joined["off_path_m"], edit_s.elapsed().as_secs_f64());
    client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();

    // Nothing happens on the rest of the way.
    aircraft.with(|control| control.speed_mps *= 4.0);
    let flown = fly.event("flown");
    let stood = aircraft.with(|control| control.longest_stand);
    assert!(stood < 3, "it stood still for {stood} steps of 20 ms");
    assert!(flown["waypoint"].is_null() && flown["images_taken"].as_u64() > Some(0), "{flown}");
    assert_eq!(flown["camera_tells"], true);
    assert!(aircraft.with(|control| control.model.received >= 2 && control.orders.is_empty()), "nothing was started or held");
    assert_eq!(fly.code(), 0);
}

#[test]
fn a_link_that_comes_back_takes_up_the_plan_that_came_meanwhile_and_ctrl_c_ends_cleanly() {
    let (served, client) = planned();
    let link = free_address();
    let manner = Manner { asks_by_request: true, naks_disorder: true, ..Manner::default() };
    let aircraft = Aircraft::start(link, manner, HOME, 100);
    let mut fly = Fly::start(&served, link, &HOME_WORDS);
    let first = fly.event("uploaded");
    aircraft.with(|control| control.is_silent = true);
    fly.event("link_lost");
    let edited = client.edit("block", &EditOrder::Raise { structure: highest(&client), by_m: 5.0 }).unwrap();
    let last = client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap().epoch();
    aircraft.with(|control| control.is_silent = false);
    let back = fly.event("link_back");
    assert!(back["silent_s"].as_f64().unwrap() >= 5.0, "{back}");
    fly.next("the last plan", |line| line["event"] == "uploaded" && line["epoch"] == last);
    assert!(first["epoch"].as_u64().unwrap() < last);
    fly.interrupt();
    fly.event("stopped");
    assert_eq!(fly.code(), 0);
}

#[test]
fn a_refusal_and_a_wrong_system_id_end_with_words_that_help() {
    let (served, _client) = planned();
    let link = free_address();
    let manner = Manner { rejects: Some((4, MavMissionResult::MAV_MISSION_INVALID)), ..Manner::default() };
    let _aircraft = Aircraft::start(link, manner, HOME, 0);
    let error = |fly: &mut Fly| {
        let line = fly.lines.iter().find(|line| !line["error"].is_null()).expect("an error");
        assert_eq!((fly.code(), line["error"]["kind"].as_str()), (7, Some("autopilot")), "{line}");
        line["error"]["message"].as_str().unwrap().to_owned()
    };
    let refused = error(&mut Fly::start(&served, link, &HOME_WORDS));
    assert!(refused.contains("item 4") && refused.contains("geofence"), "{refused}");
    let unheard = error(&mut Fly::start(&served, link, &[&HOME_WORDS[..], &["--system", "9", "--wait", "1.5"]].concat()));
    assert!(unheard.contains("only system 1, component 1") && unheard.contains("--system"), "{unheard}");
}

#[test]
fn without_the_daemon_the_flight_goes_on_and_its_return_is_noticed() {
    let (mut served, client) = planned();
    let link = free_address();
    let aircraft = Aircraft::start(link, Manner { is_busy: true, ..Manner::default() }, HOME, 20);
    let mut fly = Fly::start(&served, link, &HOME_WORDS);
    fly.event("uploaded");
    aircraft.take_off();
    fly.next("progress", |line| line["waypoint"].as_u64() >= Some(1));
    drop(client);
    served.signal("-KILL");
    fly.event("daemon_lost");
    let before = aircraft.with(|control| control.model.current);
    fly.event("progress");
    assert!(aircraft.with(|control| control.model.current) >= before);
    served.restart();
    plan(&served.client(), 2);
    fly.event("daemon_back");
    // Its plan is one for an aircraft on the ground, and is joined where the aircraft is.
    fly.event("uploaded");
    fly.event("joined");
}

#[test]
fn where_a_change_leaves_no_flight_the_aircraft_is_told_to_hold() {
    let (served, client) = planned();
    let link = free_address();
    let aircraft = Aircraft::start(link, Manner::default(), HOME, 20);
    // The time is over before the aircraft is under way, and the landing place is not where it is.
    let words = [&HOME_WORDS[..], &["--start", "--air-time", "0.5", "--landing", "-60,-60,100"]].concat();
    let mut fly = Fly::start(&served, link, &words);
    fly.next("its start", |line| line["event"] == "obeyed" && line["order"] == "fly the mission");
    assert!(aircraft.with(|control| control.is_armed && control.is_flying));
    fly.next("progress", |line| line["waypoint"].as_u64() >= Some(2));
    // Time for a report.
    std::thread::sleep(Duration::from_millis(700));
    client.edit("block", &EditOrder::Raise { structure: highest(&client), by_m: 5.0 }).unwrap();
    let reason = fly.event("infeasible")["infeasible"].as_str().unwrap().to_owned();
    assert!(reason.contains("land now"), "{reason}");
    fly.next("the hold", |line| line["event"] == "obeyed" && line["order"] == "hold");
    assert!(!aircraft.with(|control| control.is_flying));
    let modes = aircraft.with(|control| control.orders.iter().filter(|order| **order == MavCmd::MAV_CMD_DO_SET_MODE).count());
    assert_eq!(modes, 2, "to fly its mission, and to hold");
}
