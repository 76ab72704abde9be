mod holds;

use nalgebra::{Point3, Vector3};

use super::*;
use crate::autopilot::dialect::{
    COMMAND_ACK_DATA, HEARTBEAT_DATA, MISSION_ACK_DATA, MISSION_CURRENT_DATA, MISSION_REQUEST_INT_DATA, MavAutopilot, MavCmd,
    MavMissionResult, MavModeFlag, MavResult, MavType,
};
use crate::mission::fixture;
use crate::trajectory::plan::Plan;

const AIRCRAFT: Address = Address { system: 1, component: 1 };
const OTHER: Address = Address { system: 255, component: 190 };
const STEP: Duration = Duration::from_millis(20);
/// PX4's modes, and the orders to go over to them.
const MISSION: u32 = 0x0404_0000;
const LOITER: u32 = 0x0304_0000;
const FLY: [f32; 3] = [1.0, 4.0, 4.0];
const HOLD: [f32; 3] = [1.0, 4.0, 3.0];

fn options() -> PilotOptions {
    PilotOptions {
        system: None,
        autopilot: None,
        course: CourseOptions { sortie_s: Some(3000.0), ..CourseOptions::default() },
        free: None,
        sortie: 1,
        starts: false,
        holds: true,
        follows: true,
        wait: Duration::from_secs(10),
        lost: Duration::from_secs(60),
    }
}

fn corners(bend_m: f64) -> Vec<[f64; 3]> {
    (0..12).map(|k| [50.0 * f64::from(k), if k > 6 { bend_m } else { 0.0 }, 40.0]).collect()
}

fn plan(corners: &[[f64; 3]]) -> Arc<Plan> {
    Arc::new(fixture::plan("panoramic", corners))
}

/// An autopilot that answers at once, and its flight.
struct Field {
    pilot: Pilot,
    now: Duration,
    mission: Vec<dialect::MISSION_ITEM_INT_DATA>,
    arriving: Vec<dialect::MISSION_ITEM_INT_DATA>,
    count: usize,
    current: usize,
    is_armed: bool,
    is_silent: bool,
    /// It answers no more than so many items.
    stops_at: usize,
    position: GLOBAL_POSITION_INT_DATA,
    commands: Vec<[f32; 3]>,
    /// It takes no mission, does not hold, and does not go on with the item that it is told to.
    rejects: bool,
    refuses_hold: bool,
    ignores_set: bool,
    mode: u32,
    kind: MavAutopilot,
    notices: Vec<Notice>,
}

impl Field {
    fn new(options: PilotOptions) -> Self {
        Self {
            pilot: Pilot::new(options, Duration::ZERO),
            now: Duration::ZERO,
            mission: Vec::new(),
            arriving: Vec::new(),
            count: 0,
            current: 0,
            is_armed: false,
            is_silent: false,
            stops_at: usize::MAX,
            position: GLOBAL_POSITION_INT_DATA::DEFAULT,
            commands: Vec::new(),
            rejects: false,
            refuses_hold: false,
            ignores_set: false,
            mode: MISSION,
            kind: MavAutopilot::MAV_AUTOPILOT_PX4,
            notices: Vec::new(),
        }
    }

    fn fly(&mut self, epoch: u64, plan: &Arc<Plan>, differs_from: Option<(u64, usize)>) {
        self.pilot.fly(NewPlan { epoch, plan: Arc::clone(plan), differs_from });
    }

    /// Puts the aircraft at a local place of a plan.
    fn place(&mut self, plan: &Plan, at: [f64; 3]) {
        let frame = crate::frame::LocalFrame { origin: plan.scene.origin };
        let place = frame.geodetic_from_local(&Point3::from(at)).unwrap();
        self.position = GLOBAL_POSITION_INT_DATA {
            lat: (place.lat_deg * 1e7).round() as i32,
            lon: (place.lon_deg * 1e7).round() as i32,
            relative_alt: (at[2] * 1000.0) as i32,
            vy: 500,
            ..GLOBAL_POSITION_INT_DATA::DEFAULT
        };
    }

    fn run(&mut self, seconds: f64) {
        let end = self.now + Duration::from_secs_f64(seconds);
        let mut step = 0;
        while self.now < end && self.pilot.outcome().is_none() {
            self.now += STEP;
            step += 1;
            if !self.is_silent && step % 10 == 1 {
                self.say(&self.heartbeat());
                self.say(&MavMessage::GLOBAL_POSITION_INT(self.position.clone()));
                self.say(&MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
                    seq: self.current as u16,
                    ..MISSION_CURRENT_DATA::DEFAULT
                }));
            }
            self.pilot.tick(self.now);
            let mut sent = self.pilot.take_messages();
            while !sent.is_empty() && !self.is_silent {
                sent.iter().for_each(|message| self.answer(message));
                sent = self.pilot.take_messages();
            }
            self.notices.extend(self.pilot.take_notices());
        }
    }

    fn heartbeat(&self) -> MavMessage {
        let base_mode = if self.is_armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let MavMessage::HEARTBEAT(ours) = contact::heartbeat() else { panic!("a heartbeat") };
        let mavtype = MavType::MAV_TYPE_QUADROTOR;
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot: self.kind, mavtype, base_mode, custom_mode: self.mode, ..ours })
    }

    fn say(&mut self, message: &MavMessage) {
        self.pilot.hear(AIRCRAFT, message, self.now);
    }

    fn answer(&mut self, message: &MavMessage) {
        let us = self.pilot.us();
        let (target_system, target_component) = (us.system, us.component);
        let request = |seq: usize| {
            let data = MISSION_REQUEST_INT_DATA {
                seq: seq as u16,
                target_system,
                target_component,
                ..MISSION_REQUEST_INT_DATA::DEFAULT
            };
            MavMessage::MISSION_REQUEST_INT(data)
        };
        match message {
            MavMessage::MISSION_COUNT(_) if self.rejects => {
                let mavtype = MavMissionResult::MAV_MISSION_NO_SPACE;
                let ack = MISSION_ACK_DATA { target_system, target_component, mavtype, ..MISSION_ACK_DATA::DEFAULT };
                self.say(&MavMessage::MISSION_ACK(ack));
            }
            MavMessage::MISSION_COUNT(count) => {
                (self.count, self.arriving) = (usize::from(count.count), Vec::new());
                self.say(&request(0));
            }
            MavMessage::MISSION_ITEM_INT(item)
                if usize::from(item.seq) == self.arriving.len() && self.arriving.len() < self.stops_at =>
            {
                self.arriving.push(item.clone());
                if self.arriving.len() < self.count {
                    self.say(&request(self.arriving.len()));
                } else {
                    self.mission = std::mem::take(&mut self.arriving);
                    self.current = 0;
                    self.say(&MavMessage::MISSION_ACK(MISSION_ACK_DATA {
                        target_system,
                        target_component,
                        ..MISSION_ACK_DATA::DEFAULT
                    }));
                }
            }
            MavMessage::MISSION_SET_CURRENT(set) if !self.ignores_set => self.current = usize::from(set.seq),
            MavMessage::COMMAND_LONG(command) if command.command != MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let params = [command.param1, command.param2, command.param3];
                self.commands.push(params);
                let is_refused = self.refuses_hold && params == HOLD;
                let result = if is_refused { MavResult::MAV_RESULT_DENIED } else { MavResult::MAV_RESULT_ACCEPTED };
                let ack = COMMAND_ACK_DATA { command: command.command, result, ..COMMAND_ACK_DATA::DEFAULT };
                self.say(&MavMessage::COMMAND_ACK(ack));
            }
            _ => {}
        }
    }

    /// The item of a waypoint of the plan in the mission that the aircraft has.
    fn item_of(&self, plan: &Plan, waypoint: usize) -> usize {
        let frame = crate::frame::LocalFrame { origin: plan.scene.origin };
        let place = frame.geodetic_from_local(&plan.waypoints[waypoint].position_m).unwrap();
        let at = [place.lat_deg, place.lon_deg].map(|deg| (deg * 1e7).round() as i32);
        // The ways out and home lead over waypoints, higher up.
        let z = plan.waypoints[waypoint].position_m.z as f32;
        let is_there = |item: &dialect::MISSION_ITEM_INT_DATA| ([item.x, item.y], item.z) == (at, z);
        self.mission.iter().position(is_there).unwrap()
    }

    /// Lets it be on its way to a waypoint.
    fn head_to(&mut self, plan: &Arc<Plan>, waypoint: usize, at: [f64; 3]) {
        self.is_armed = true;
        self.place(plan, at);
        self.current = self.item_of(plan, waypoint);
        self.run(1.0);
    }

    /// A field whose aircraft is on its way to the fourth waypoint of a plan, epoch 5.
    fn on_the_way(options: PilotOptions, old: &Arc<Plan>) -> Self {
        let mut field = Self::new(options);
        field.place(old, [0.0, 0.0, 0.0]);
        field.fly(5, old, None);
        field.run(2.0);
        field.head_to(old, 4, [170.0, 1.0, 40.0]);
        field
    }

    /// The plans that are not flown, and whether the aircraft holds instead.
    fn kept(&self) -> Vec<(u64, bool)> {
        let kept = |notice: &Notice| match notice {
            Notice::Kept { epoch, is_held, .. } => Some((*epoch, *is_held)),
            _ => None,
        };
        self.notices.iter().filter_map(kept).collect()
    }

    fn joined(&self) -> Option<(u64, usize)> {
        self.notices.iter().rev().find_map(|notice| match notice {
            Notice::Joined { epoch, waypoint, .. } => Some((*epoch, *waypoint)),
            _ => None,
        })
    }
}

#[test]
fn a_new_plan_is_joined_at_the_next_waypoint_that_has_not_changed_and_else_where_it_is_nearest() {
    let (old, bent) = (plan(&corners(0.0)), plan(&corners(30.0)));
    let mut field = Field::new(options());
    field.place(&old, [0.0, 0.0, 0.0]);
    field.fly(5, &old, None);
    field.run(2.0);
    assert!(field.notices.iter().any(|notice| matches!(notice, Notice::Uploaded { epoch: 5, .. })), "{:?}", field.notices);
    assert_eq!((field.current, field.joined(), field.commands.len()), (0, None, 0), "nothing starts by itself");

    field.head_to(&old, 4, [170.0, 1.0, 40.0]);
    let report = field.pilot.report(field.now).expect("it is under way");
    // Where it will be on its path when a plan that follows can be flown.
    let [x, y, z] = report.position_m;
    assert!((171.0..185.0).contains(&x) && y.abs() < 0.05 && (z - 40.0).abs() < 0.05, "{report:?}");
    assert!(report.epoch == 5 && report.velocity_mps[0] > 2.0);
    field.fly(6, &bent, Some((5, 7)));
    field.run(1.0);
    assert_eq!(field.joined(), Some((6, 4)));
    let set = field.current;
    assert!(set <= field.item_of(&bent, 4) && set > field.item_of(&bent, 3), "item {set}");
    assert_eq!(field.pilot.report(field.now).unwrap().epoch, 6);

    // A path that begins at its pose.
    field.head_to(&bent, 5, [230.0, 0.0, 40.0]);
    let away = plan(&[[228.0, 0.0, 40.0], [240.0, 0.0, 40.0], [240.0, 80.0, 40.0], [180.0, 80.0, 40.0], [120.0, 80.0, 40.0]]);
    field.fly(9, &away, Some((6, 0)));
    field.run(1.0);
    assert_eq!(field.joined(), Some((9, 1)));
    assert!(field.pilot.outcome().is_none());
    field.pilot.hear(
        AIRCRAFT,
        &MavMessage::MISSION_ITEM_REACHED(dialect::MISSION_ITEM_REACHED_DATA { seq: field.item_of(&away, 4) as u16 }),
        field.now,
    );
    assert_eq!(field.pilot.outcome(), Some(&Ok(End::Flown)));
}

#[test]
fn an_upload_gives_way_to_a_newer_plan_and_begins_again_when_the_link_is_back() {
    let (old, bent) = (plan(&corners(0.0)), plan(&corners(30.0)));
    let mut field = Field::new(options());
    field.place(&old, [0.0, 0.0, 0.0]);
    field.stops_at = 5;
    field.fly(5, &old, None);
    field.run(0.6);
    field.stops_at = usize::MAX;
    field.fly(6, &bent, None);
    field.run(2.0);
    assert!(
        field.notices.iter().any(|notice| matches!(notice, Notice::Superseded { epoch: 5, asked } if *asked >= 5)),
        "{:?}",
        field.notices
    );
    let waypoints: Vec<usize> = (0..bent.waypoints.len()).map(|waypoint| field.item_of(&bent, waypoint)).collect();
    assert!(waypoints.is_sorted(), "the newer one is there whole: {waypoints:?}");

    field.is_silent = true;
    field.run(6.0);
    assert!(matches!(field.notices.last(), Some(Notice::LinkLost { .. })), "{:?}", field.notices.last());
    field.fly(7, &old, None);
    field.run(20.0);
    assert!(field.pilot.outcome().is_none(), "a lost link is waited for");
    field.is_silent = false;
    field.run(4.0);
    assert!(field.notices.iter().any(|notice| matches!(notice, Notice::LinkBack { .. })));
    assert!(matches!(field.notices.last(), Some(Notice::Uploaded { epoch: 7, .. })), "{:?}", field.notices.last());
    field.is_silent = true;
    field.run(100.0);
    assert!(matches!(field.pilot.outcome(), Some(Err(PilotError::Lost { .. }))), "not for ever");
}

#[test]
fn another_station_that_gives_it_a_mission_ends_the_flight() {
    let old = plan(&corners(0.0));
    let mut field = Field::new(options());
    field.place(&old, [0.0, 0.0, 0.0]);
    field.fly(5, &old, None);
    field.run(2.0);
    let (target_system, target_component) = (OTHER.system, OTHER.component);
    let mavtype = MavMissionResult::MAV_MISSION_ACCEPTED;
    field.say(&MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system,
        target_component,
        mavtype,
        ..MISSION_ACK_DATA::DEFAULT
    }));
    assert_eq!(field.pilot.outcome(), Some(&Err(PilotError::Foreign { by: OTHER })));
}

#[test]
fn who_is_not_the_aircraft_is_named() {
    let mut field = Field::new(PilotOptions { system: Some(4), ..options() });
    field.run(20.0);
    let error = field.pilot.outcome().unwrap().clone().unwrap_err().to_string();
    assert!(error.contains("only system 1, component 1") && error.contains("--system"), "{error}");

    let mut field = Field::new(options());
    field.kind = MavAutopilot::MAV_AUTOPILOT_PPZ;
    field.run(1.0);
    assert!(matches!(field.pilot.outcome(), Some(Err(PilotError::Kind { code: 9, .. }))), "{:?}", field.pilot.outcome());
    let mut field = Field::new(PilotOptions { autopilot: Some(Autopilot::ArduPilot), starts: true, ..options() });
    field.kind = MavAutopilot::MAV_AUTOPILOT_PPZ;
    let old = plan(&corners(0.0));
    field.place(&old, [0.0, 0.0, 0.0]);
    field.fly(5, &old, None);
    field.run(2.0);
    assert_eq!(field.commands, [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], "armed and started, as was asked");
}

#[test]
fn an_aircraft_that_is_disarmed_on_its_way_has_landed() {
    let old = plan(&corners(0.0));
    let mut field = Field::new(options());
    field.place(&old, [0.0, 0.0, 0.0]);
    field.fly(5, &old, None);
    field.run(2.0);
    field.head_to(&old, 3, [120.0, 0.0, 40.0]);
    field.is_armed = false;
    field.run(1.0);
    assert_eq!(field.pilot.outcome(), Some(&Ok(End::Landed)));
    let fix = field.pilot.progress().unwrap().fix.unwrap();
    assert_eq!(fix.velocity_mps, Vector3::new(5.0, 0.0, 0.0));
}
