//! An autopilot that flies a plan, by MAVLink: the mission goes up, its progress comes back, a newer plan takes its place in flight.
//!
//! Everything but [`link`] is a state machine without a clock and without I/O: messages and times go in, messages and notices come out. Times are
//! counted from any one moment.

#![allow(deprecated, reason = "autopilots in the field speak messages that have newer ones beside them")]

pub mod command;
pub mod follow;
pub mod link;
pub mod mission;
pub mod notice;
pub mod pilot;
pub mod upload;

pub use mavlink::dialects::ardupilotmega as dialect;
pub use mavlink::dialects::ardupilotmega::MavMessage;

/// Who sends or receives on a MAVLink network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Address {
    pub system: u8,
    pub component: u8,
}

/// MAV_COMP_ID_ONBOARD_COMPUTER: what this program is on its aircraft.
pub const ONBOARD_COMPUTER: u8 = 191;

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "system {}, component {}", self.system, self.component)
    }
}

impl Address {
    /// Whether a message that names this target is meant for us; 0 means everybody.
    pub fn is_meant_by(&self, system: u8, component: u8) -> bool {
        (system == 0 || system == self.system) && (component == 0 || component == self.component)
    }
}
