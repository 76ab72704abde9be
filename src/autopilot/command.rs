//! Orders to an autopilot that it confirms: commands (<https://mavlink.io/en/services/command.html>), and the item that a mission goes on with.

use std::time::Duration;

use super::dialect::{COMMAND_LONG_DATA, MISSION_SET_CURRENT_DATA, MavCmd, MavResult};
use super::upload::{RETRIES, WAIT};
use super::{Address, MavMessage};
use crate::mission::mav_items::Autopilot;

/// A command in progress says so now and then; it may take this long in all.
const LONGEST: Duration = Duration::from_secs(60);

/// What an aircraft is told to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    Arm,
    /// Fly the mission, from the item that is set.
    Mission,
    /// Stay where it is.
    Hold,
}

impl Order {
    pub fn name(self) -> &'static str {
        match self {
            Self::Arm => "arm",
            Self::Mission => "fly the mission",
            Self::Hold => "hold",
        }
    }

    /// The command and its first three parameters.
    fn command(self, autopilot: Autopilot) -> (MavCmd, [f32; 3]) {
        // MAV_MODE_FLAG_CUSTOM_MODE_ENABLED: the mode is the autopilot's own.
        const CUSTOM: f32 = 1.0;
        match (self, autopilot) {
            (Self::Arm, _) => (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0]),
            // Main mode AUTO, sub modes MISSION and LOITER.
            (Self::Mission, Autopilot::Px4) => (MavCmd::MAV_CMD_DO_SET_MODE, [CUSTOM, 4.0, 4.0]),
            (Self::Hold, Autopilot::Px4) => (MavCmd::MAV_CMD_DO_SET_MODE, [CUSTOM, 4.0, 3.0]),
            (Self::Mission, Autopilot::ArduPilot) => (MavCmd::MAV_CMD_MISSION_START, [0.0, 0.0, 0.0]),
            // Copter's mode BRAKE.
            (Self::Hold, Autopilot::ArduPilot) => (MavCmd::MAV_CMD_DO_SET_MODE, [CUSTOM, 17.0, 0.0]),
        }
    }

    /// What its pilot can do when it does not obey.
    fn remedy(self) -> &'static str {
        match self {
            Self::Arm => "see its pre-arm messages, or arm it by hand",
            Self::Mission => "put it into its mission mode (Mission, AUTO) by hand",
            Self::Hold => "hold by hand: the plan must not be flown on",
        }
    }
}

/// Why an order was not carried out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OrderError {
    #[error("the autopilot does not {} ({result:?}); {}", .order.name(), .order.remedy())]
    Refused { order: Order, result: MavResult },
    #[error("the autopilot does not answer the order to {}, given {tries} times; {}", .order.name(), .order.remedy())]
    Silent { order: Order, tries: u32 },
    #[error(
        "the autopilot does not go on with item {seq}, asked for {tries} times; it may fly another part of the mission: set item {seq} by hand"
    )]
    NotCurrent { seq: u16, tries: u32 },
}

/// An order under way.
#[derive(Clone, Debug)]
pub struct Command {
    pub order: Order,
    to: Address,
    autopilot: Autopilot,
    retries: u32,
    deadline: Duration,
    end: Duration,
    pub outcome: Option<Result<(), OrderError>>,
}

impl Command {
    pub fn begin(order: Order, to: Address, autopilot: Autopilot, now: Duration) -> (Self, MavMessage) {
        let command = Self { order, to, autopilot, retries: 0, deadline: now + WAIT, end: now + LONGEST, outcome: None };
        let message = command.message();
        (command, message)
    }

    pub fn hear(&mut self, from: Address, message: &MavMessage, now: Duration) {
        let MavMessage::COMMAND_ACK(ack) = message else { return };
        if from != self.to || ack.command != self.order.command(self.autopilot).0 || self.outcome.is_some() {
            return;
        }
        match ack.result {
            MavResult::MAV_RESULT_ACCEPTED => self.outcome = Some(Ok(())),
            MavResult::MAV_RESULT_IN_PROGRESS => self.deadline = now + 4 * WAIT,
            result => self.outcome = Some(Err(OrderError::Refused { order: self.order, result })),
        }
    }

    pub fn tick(&mut self, now: Duration) -> Option<MavMessage> {
        if self.outcome.is_some() || now < self.deadline {
            return None;
        }
        self.retries += 1;
        if self.retries > RETRIES || now >= self.end {
            self.outcome = Some(Err(OrderError::Silent { order: self.order, tries: self.retries }));
            return None;
        }
        self.deadline = now + WAIT;
        Some(self.message())
    }

    fn message(&self) -> MavMessage {
        let (command, [param1, param2, param3]) = self.order.command(self.autopilot);
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            command,
            target_system: self.to.system,
            target_component: self.to.component,
            confirmation: self.retries as u8,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    }
}

/// The item that a mission is to go on with: confirmed when the autopilot says that it is there.
#[derive(Clone, Debug)]
pub struct SetCurrent {
    seq: u16,
    /// Up to this item it may have come meanwhile.
    latest: u16,
    to: Address,
    retries: u32,
    deadline: Duration,
    pub outcome: Option<Result<(), OrderError>>,
}

impl SetCurrent {
    pub fn begin(seq: u16, latest: u16, to: Address, now: Duration) -> (Self, MavMessage) {
        let set = Self { seq, latest, to, retries: 0, deadline: now + WAIT, outcome: None };
        let message = set.message();
        (set, message)
    }

    pub fn hear(&mut self, from: Address, message: &MavMessage) {
        let MavMessage::MISSION_CURRENT(current) = message else { return };
        if from == self.to && self.outcome.is_none() && (self.seq..=self.latest).contains(&current.seq) {
            self.outcome = Some(Ok(()));
        }
    }

    pub fn tick(&mut self, now: Duration) -> Option<MavMessage> {
        if self.outcome.is_some() || now < self.deadline {
            return None;
        }
        self.retries += 1;
        if self.retries > RETRIES {
            self.outcome = Some(Err(OrderError::NotCurrent { seq: self.seq, tries: self.retries }));
            return None;
        }
        self.deadline = now + WAIT;
        Some(self.message())
    }

    fn message(&self) -> MavMessage {
        MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
            seq: self.seq,
            target_system: self.to.system,
            target_component: self.to.component,
        })
    }
}
