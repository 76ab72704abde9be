//! A flight from the first sign of an autopilot to the plan's last waypoint: finds it, uploads, follows, and replaces the mission when there is a newer
//! plan.
//!
//! There is at most one upload. A newer plan that comes meanwhile ends it and takes its place; of several the newest is taken. Nothing is sent to an
//! autopilot that is not heard; when it is back, the plan that is wanted goes up again.

mod contact;
mod hold;
mod replace;

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use overfly_client::FlightReport;

use self::hold::Held;
use super::command::{Command, Order, SetCurrent};
use super::dialect::GLOBAL_POSITION_INT_DATA;
use super::follow::Progress;
use super::mission::{Join, Mission, NewPlan};
use super::notice::{End, Notice, PilotError};
use super::upload::Upload;
use super::{Address, MavMessage, ONBOARD_COMPUTER, dialect};
use crate::mission::course::CourseOptions;
use crate::mission::mav_items::Autopilot;
use crate::scene::free_space::FreeSpace;

/// How often this program says that it is there.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// The link counts as lost when so long no heartbeat came, of one a second.
const SILENCE: Duration = Duration::from_secs(5);
/// Before a mission without a take-off place is made, the aircraft may take so long to say where it stands.
const POSITION_WAIT: Duration = Duration::from_secs(3);
/// How often an upload that may pass is tried in all, and the pause between.
const ATTEMPTS: u32 = 3;
const PAUSE: Duration = Duration::from_secs(1);
/// What a daemon takes for a first safe plan, with the age of a report; and the longest that a plan is made ahead for.
const PLANNING: Duration = Duration::from_millis(500);
const MOST_LEAD: Duration = Duration::from_secs(15);
/// An armed aircraft that is higher above its take-off place flies, mm.
const AIRBORNE_MM: i32 = 2000;
/// Stations that are remembered for an error.
const MOST_OTHERS: usize = 8;

/// What the user decides on.
#[derive(Clone, Debug)]
pub struct PilotOptions {
    /// The aircraft's system id; without one the first autopilot that is heard.
    pub system: Option<u8>,
    pub autopilot: Option<Autopilot>,
    pub course: CourseOptions,
    /// The space around the ways out and home, where it is known.
    pub free: Option<Arc<FreeSpace>>,
    pub sortie: usize,
    /// Arm it, and let it fly.
    pub starts: bool,
    /// Let it hold when a changed scene leaves no flight.
    pub holds: bool,
    /// Go on after the first upload.
    pub follows: bool,
    /// How long to wait for its first heartbeat, and for one after the link was lost.
    pub wait: Duration,
    pub lost: Duration,
}

#[derive(Clone, Copy, Debug)]
struct Vehicle {
    address: Address,
    autopilot: Autopilot,
    found: Duration,
    heard: Duration,
    is_armed: bool,
    is_lost: bool,
    /// As the autopilot numbers it, and whether it is that of missions.
    mode: Option<u32>,
    is_on_mission: Option<bool>,
}

/// What is being done about a plan.
#[derive(Debug)]
enum Work {
    Idle,
    Uploading { upload: Box<Upload>, mission: Arc<Mission>, began: Duration },
    Setting { set: SetCurrent, mission: Arc<Mission>, join: Option<Join>, item: usize },
}

/// Which message tells of images: an autopilot may send both kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Camera {
    Captured,
    Feedback,
}

/// A flight.
#[derive(Debug)]
pub struct Pilot {
    options: PilotOptions,
    vehicle: Option<Vehicle>,
    others: Vec<Address>,
    began: Duration,
    beat: Option<Duration>,
    /// The newest plan that is not flown yet.
    wanted: Option<NewPlan>,
    attempt: u32,
    not_before: Duration,
    /// A transfer was given up that the autopilot may not know to be over.
    clears: bool,
    work: Work,
    progress: Option<Progress>,
    position: Option<(GLOBAL_POSITION_INT_DATA, Duration)>,
    camera: Option<(Camera, i64)>,
    orders: VecDeque<Order>,
    command: Option<Command>,
    held: Option<Held>,
    /// When an aircraft that was told to hold counts as being at rest, whatever it says.
    at_rest: Option<Duration>,
    /// How much later than a report a plan that follows from it is flown.
    lead: Duration,
    out: Vec<MavMessage>,
    notices: Vec<Notice>,
    outcome: Option<Result<End, PilotError>>,
}

impl Pilot {
    pub fn new(options: PilotOptions, now: Duration) -> Self {
        Self {
            options,
            vehicle: None,
            others: Vec::new(),
            began: now,
            beat: None,
            wanted: None,
            attempt: 0,
            not_before: now,
            clears: false,
            work: Work::Idle,
            progress: None,
            position: None,
            camera: None,
            orders: VecDeque::new(),
            command: None,
            held: None,
            at_rest: None,
            lead: PLANNING,
            out: Vec::new(),
            notices: Vec::new(),
            outcome: None,
        }
    }

    /// Who we are: a computer on board of the aircraft.
    pub fn us(&self) -> Address {
        let system = self.vehicle.map(|vehicle| vehicle.address.system).or(self.options.system).unwrap_or(1);
        Address { system, component: ONBOARD_COMPUTER }
    }

    pub fn take_messages(&mut self) -> Vec<MavMessage> {
        std::mem::take(&mut self.out)
    }

    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    pub fn outcome(&self) -> Option<&Result<End, PilotError>> {
        self.outcome.as_ref()
    }

    /// The flight along the mission that is flown.
    pub fn progress(&self) -> Option<&Progress> {
        self.progress.as_ref()
    }

    pub fn is_armed(&self) -> bool {
        self.vehicle.is_some_and(|vehicle| vehicle.is_armed)
    }

    /// Nothing is known any more of the space around the ways out and home.
    pub fn forget_space(&mut self) {
        self.options.free = None;
    }

    /// What the daemon is to know of the flight; nothing while it goes over to another plan. A plan is flown when it is made and uploaded, which takes as long
    /// as it took the last time.
    pub fn report(&self, now: Duration) -> Option<FlightReport> {
        let is_known = !matches!(self.work, Work::Setting { .. });
        self.progress.as_ref().filter(|_| is_known).and_then(|progress| progress.report(now, self.lead))
    }

    /// Takes a message of anybody.
    pub fn hear(&mut self, from: Address, message: &MavMessage, now: Duration) {
        if self.outcome.is_some() {
            return;
        }
        if let MavMessage::HEARTBEAT(heartbeat) = message {
            self.on_heartbeat(from, heartbeat, now);
        }
        let Some(vehicle) = self.vehicle else { return };
        if from.system != vehicle.address.system {
            return;
        }
        self.on_camera(message);
        if from != vehicle.address {
            return;
        }
        match message {
            MavMessage::GLOBAL_POSITION_INT(position) => {
                self.position = Some((position.clone(), now));
                if let Some(progress) = &mut self.progress {
                    progress.moved(position, now);
                }
            }
            // While the mission changes it is not known which one an item belongs to.
            MavMessage::MISSION_CURRENT(current) if !matches!(self.work, Work::Setting { .. }) => {
                let (item, is_changing) = (usize::from(current.seq), matches!(self.work, Work::Uploading { .. }));
                // An item behind the last one may be one of the mission that has just gone up.
                if let Some(progress) =
                    self.progress.as_mut().filter(|progress| !is_changing || item <= progress.mission.last_item())
                {
                    progress.current(item);
                }
            }
            MavMessage::MISSION_ITEM_REACHED(reached) if !matches!(self.work, Work::Setting { .. }) => {
                if let Some(progress) = &mut self.progress {
                    progress.reached(usize::from(reached.seq));
                }
            }
            MavMessage::MISSION_ACK(ack) => self.on_foreign(ack),
            MavMessage::STATUSTEXT(text) if text.severity as u8 <= dialect::MavSeverity::MAV_SEVERITY_WARNING as u8 => {
                let text = text.text.to_str().unwrap_or_default().trim().to_owned();
                self.notices.push(Notice::Said(text));
            }
            _ => {}
        }
        match &mut self.work {
            Work::Uploading { upload, .. } => self.out.extend(upload.hear(from, message, now)),
            Work::Setting { set, .. } => set.hear(from, message),
            Work::Idle => {}
        }
        if let Some(command) = &mut self.command {
            command.hear(from, message, now);
        }
        self.advance(now);
    }

    /// Does what is due.
    pub fn tick(&mut self, now: Duration) {
        if self.outcome.is_some() {
            return;
        }
        if self.beat.is_none_or(|beat| now >= beat + HEARTBEAT) {
            self.beat = Some(now);
            self.out.push(contact::heartbeat());
        }
        match self.vehicle {
            None if now >= self.began + self.options.wait => return self.end(Err(self.nobody())),
            None => return,
            Some(vehicle) => self.watch_link(vehicle, now),
        }
        if self.vehicle.is_some_and(|vehicle| vehicle.is_lost) {
            return;
        }
        match &mut self.work {
            Work::Uploading { upload, .. } => self.out.extend(upload.tick(now)),
            Work::Setting { set, .. } => self.out.extend(set.tick(now)),
            Work::Idle => {}
        }
        if let Some(command) = &mut self.command {
            self.out.extend(command.tick(now));
        }
        self.advance(now);
    }

    /// Ends what can be ended before the program does.
    pub fn leave(&mut self) {
        if let Work::Uploading { upload, .. } = &self.work {
            self.out.push(upload.cancel());
        }
    }

    /// Images that the camera tells of. Messages that come twice count once.
    fn on_camera(&mut self, message: &MavMessage) {
        let (camera, index, [lat, lon, relative_mm]) = match message {
            MavMessage::CAMERA_IMAGE_CAPTURED(image) => {
                if !image.capture_result.as_bool() {
                    return;
                }
                (Camera::Captured, i64::from(image.image_index), [image.lat, image.lon, image.relative_alt])
            }
            MavMessage::CAMERA_FEEDBACK(image) => {
                (Camera::Feedback, i64::from(image.img_idx), [image.lat, image.lng, (image.alt_rel * 1000.0) as i32])
            }
            _ => return,
        };
        if self.camera.is_some_and(|(known, last)| known != camera || last == index) {
            return;
        }
        self.camera = Some((camera, index));
        if let Some(progress) = &mut self.progress {
            progress.captured(lat, lon, relative_mm);
        }
    }

    /// The autopilot confirms a mission that is not ours.
    fn on_foreign(&mut self, ack: &dialect::MISSION_ACK_DATA) {
        let is_other = !self.us().is_meant_by(ack.target_system, ack.target_component)
            && ack.mavtype == dialect::MavMissionResult::MAV_MISSION_ACCEPTED
            && ack.mission_type == dialect::MavMissionType::MAV_MISSION_TYPE_MISSION;
        // Before our own mission is there, another one is what it will replace.
        if is_other && self.progress.is_some() {
            self.leave();
            let by = Address { system: ack.target_system, component: ack.target_component };
            self.end(Err(PilotError::Foreign { by }));
        }
    }

    fn end(&mut self, outcome: Result<End, PilotError>) {
        self.outcome.get_or_insert(outcome);
    }
}

#[cfg(test)]
mod tests;
