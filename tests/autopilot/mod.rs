//! A model of an autopilot, for tests: its side of the mission protocol, and an aircraft that flies what it was given. It has no clock and no I/O of its own.
#![allow(dead_code, reason = "each test uses its own part of this module")]
#![allow(deprecated, reason = "autopilots in the field speak messages that have newer ones beside them")]

pub mod aircraft;

use std::time::Duration;

use overfly::autopilot::dialect::*;
use overfly::autopilot::{Address, MavMessage};

pub const AIRCRAFT: Address = Address { system: 1, component: 1 };

/// How an autopilot does what the protocol leaves open.
#[derive(Clone, Debug)]
pub struct Manner {
    /// Asks by the old MISSION_REQUEST.
    pub asks_by_request: bool,
    /// Answers an item that is not the next one with MAV_MISSION_INVALID_SEQUENCE.
    pub naks_disorder: bool,
    /// What it says to an item when it has finished: its confirmation once more, an error, or nothing.
    pub on_stray: Option<MavMissionResult>,
    /// Does not take an announcement while it asks for the items of another.
    pub is_busy: bool,
    pub reask: Duration,
    pub reasks: u32,
    pub rejects: Option<(usize, MavMissionResult)>,
    pub capacity: usize,
}

impl Default for Manner {
    fn default() -> Self {
        Self {
            asks_by_request: false,
            naks_disorder: false,
            on_stray: Some(MavMissionResult::MAV_MISSION_ACCEPTED),
            is_busy: false,
            reask: Duration::from_millis(250),
            reasks: 5,
            rejects: None,
            capacity: 2000,
        }
    }
}

#[derive(Clone, Debug)]
struct Receiving {
    from: Address,
    count: usize,
    items: Vec<MISSION_ITEM_INT_DATA>,
    deadline: Duration,
    reasks: u32,
}

/// The mission protocol of one vehicle.
#[derive(Clone, Debug, Default)]
pub struct Model {
    pub manner: Manner,
    pub mission: Vec<MISSION_ITEM_INT_DATA>,
    /// Missions that were received to their end.
    pub received: usize,
    pub current: usize,
    receiving: Option<Receiving>,
    /// Whose mission came to its end last, if nothing was begun since.
    done: Option<Address>,
}

impl Model {
    pub fn new(manner: Manner) -> Self {
        Self { manner, ..Self::default() }
    }

    pub fn hear(&mut self, from: Address, message: &MavMessage, now: Duration) -> Vec<MavMessage> {
        match message {
            MavMessage::MISSION_COUNT(count) if is_ours(count.target_system) => {
                self.on_count(from, usize::from(count.count), now)
            }
            MavMessage::MISSION_ITEM_INT(item) if is_ours(item.target_system) => self.on_item(from, item, now),
            MavMessage::MISSION_ACK(ack) if self.receiving.as_ref().is_some_and(|receiving| receiving.from == from) => {
                if ack.mavtype == MavMissionResult::MAV_MISSION_OPERATION_CANCELLED {
                    self.receiving = None;
                }
                Vec::new()
            }
            MavMessage::MISSION_SET_CURRENT(set) if is_ours(set.target_system) && usize::from(set.seq) < self.mission.len() => {
                self.current = usize::from(set.seq);
                vec![self.mission_current()]
            }
            _ => Vec::new(),
        }
    }

    pub fn tick(&mut self, now: Duration) -> Vec<MavMessage> {
        let Some(receiving) = &mut self.receiving else { return Vec::new() };
        if now < receiving.deadline {
            return Vec::new();
        }
        receiving.reasks += 1;
        if receiving.reasks > self.manner.reasks {
            self.receiving = None;
            return Vec::new();
        }
        self.ask(now)
    }

    pub fn mission_current(&self) -> MavMessage {
        MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA { seq: self.current as u16, ..MISSION_CURRENT_DATA::DEFAULT })
    }

    fn on_count(&mut self, from: Address, count: usize, now: Duration) -> Vec<MavMessage> {
        let is_other = self.receiving.as_ref().is_some_and(|receiving| receiving.from != from);
        let has_begun = self.receiving.as_ref().is_some_and(|receiving| !receiving.items.is_empty());
        if is_other || (self.manner.is_busy && has_begun) {
            return Vec::new();
        }
        if count > self.manner.capacity {
            return vec![ack(from, MavMissionResult::MAV_MISSION_NO_SPACE)];
        }
        self.done = None;
        self.receiving = Some(Receiving { from, count, items: Vec::new(), deadline: now, reasks: 0 });
        self.ask(now)
    }

    fn on_item(&mut self, from: Address, item: &MISSION_ITEM_INT_DATA, now: Duration) -> Vec<MavMessage> {
        let Some(receiving) = self.receiving.as_mut().filter(|receiving| receiving.from == from) else {
            // Only what was received is confirmed once more.
            let is_done = self.done == Some(from);
            let result = self.manner.on_stray.filter(|result| is_done || *result != MavMissionResult::MAV_MISSION_ACCEPTED);
            return result.map(|result| ack(from, result)).into_iter().collect();
        };
        let seq = usize::from(item.seq);
        if seq != receiving.items.len() {
            let naks = self.manner.naks_disorder;
            return naks.then(|| ack(from, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE)).into_iter().collect();
        }
        if let Some((rejected, result)) = self.manner.rejects
            && rejected == seq
        {
            self.receiving = None;
            return vec![ack(from, result)];
        }
        receiving.items.push(item.clone());
        receiving.reasks = 0;
        if receiving.items.len() < receiving.count {
            return self.ask(now);
        }
        let items = std::mem::take(&mut receiving.items);
        self.receiving = None;
        self.current = items.iter().position(|item| item.current == 1).unwrap_or(0);
        self.mission = items;
        self.received += 1;
        self.done = Some(from);
        vec![ack(from, MavMissionResult::MAV_MISSION_ACCEPTED)]
    }

    fn ask(&mut self, now: Duration) -> Vec<MavMessage> {
        let (reask, by_request) = (self.manner.reask, self.manner.asks_by_request);
        let Some(receiving) = &mut self.receiving else { return Vec::new() };
        receiving.deadline = now + reask;
        vec![request(receiving.from, receiving.items.len(), by_request)]
    }
}

pub fn request(to: Address, seq: usize, by_request: bool) -> MavMessage {
    let (seq, target_system, target_component) = (seq as u16, to.system, to.component);
    if by_request {
        MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
            seq,
            target_system,
            target_component,
            ..MISSION_REQUEST_DATA::DEFAULT
        })
    } else {
        let data = MISSION_REQUEST_INT_DATA { seq, target_system, target_component, ..MISSION_REQUEST_INT_DATA::DEFAULT };
        MavMessage::MISSION_REQUEST_INT(data)
    }
}

pub fn ack(to: Address, result: MavMissionResult) -> MavMessage {
    MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: to.system,
        target_component: to.component,
        mavtype: result,
        ..MISSION_ACK_DATA::DEFAULT
    })
}

fn is_ours(system: u8) -> bool {
    system == 0 || system == AIRCRAFT.system
}
