//! What a flight has to tell while it goes on, and how it ends.

use std::time::Duration;

use super::Address;
use super::command::{Order, OrderError};
use super::mission::MissionError;
use super::upload::UploadError;
use crate::mission::mav_items::Autopilot;

/// Something that has happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Notice {
    Found {
        vehicle: Address,
        autopilot: Autopilot,
        is_armed: bool,
    },
    /// A note on the mission: what its pilot has to know.
    Note(String),
    Uploading {
        epoch: u64,
        items: usize,
        attempt: u32,
    },
    Uploaded {
        epoch: u64,
        items: usize,
        took: Duration,
        sortie: usize,
        sorties: usize,
    },
    /// The aircraft flies on along a new plan, and was so far from it.
    Joined {
        epoch: u64,
        waypoint: usize,
        item: usize,
        off_m: f64,
    },
    /// The new path is so far from the aircraft that it holds, climbs above everything, flies across and comes down.
    FarOff {
        off_m: f64,
    },
    /// A newer plan has come while this one was on its way up.
    Superseded {
        epoch: u64,
        asked: usize,
    },
    /// An attempt has failed, and there will be another one.
    Again {
        epoch: u64,
        why: String,
    },
    /// A plan will not be flown; the one before is flown on, or the aircraft holds still because there was no flight.
    Kept {
        epoch: u64,
        why: String,
        is_held: bool,
    },
    LinkLost {
        silent: Duration,
    },
    LinkBack {
        silent: Duration,
    },
    Obeyed(Order),
    Disobeyed(OrderError),
    Mode {
        is_mission: bool,
        mode: u32,
    },
    /// What the autopilot says itself.
    Said(String),
}

/// How a flight that has gone well ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The mission is up, and nothing more was asked for.
    Uploaded,
    /// The last waypoint is reached; the mission's own items bring the aircraft home.
    Flown,
    /// It was disarmed before the last waypoint.
    Landed,
}

/// Why a flight cannot go on from here.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PilotError {
    #[error("no autopilot was heard within {seconds:.0} s{}; {remedy}", heard(.others))]
    NoVehicle { seconds: f64, others: Vec<Address>, remedy: &'static str },
    #[error(
        "nothing was heard of the autopilot for {seconds:.0} s; it flies its mission on by itself: bring the link back and start again"
    )]
    Lost { seconds: f64 },
    #[error(
        "the autopilot ({vehicle}) is of a kind ({code}) that this program does not know; give `--autopilot px4` or `--autopilot ardupilot`"
    )]
    Kind { vehicle: Address, code: u8 },
    #[error(
        "another station ({by}) has given the autopilot a mission, so that what it flies is no longer this plan; nothing more is sent: start again to \
         take over"
    )]
    Foreign { by: Address },
    #[error(transparent)]
    Mission(#[from] MissionError),
    #[error(transparent)]
    Upload(#[from] UploadError),
    #[error(transparent)]
    Order(#[from] OrderError),
}

fn heard(others: &[Address]) -> String {
    if others.is_empty() {
        return String::new();
    }
    let names: Vec<String> = others.iter().map(|other| other.to_string()).collect();
    format!(", only {}", names.join("; "))
}
