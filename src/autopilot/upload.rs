//! The upload of a mission, as the MAVLink mission protocol has it (<https://mavlink.io/en/services/mission.html>): its length is announced, the autopilot
//! asks for one item after the other and confirms the last one.
//!
//! Answers are idempotent: an item that is asked for again is sent again. What the autopilot has asked for before it has heard of this mission never
//! counts: a transfer begins with item 0, and goes on without a gap. So an autopilot that is still busy with another mission cannot mix the two; it is
//! told to give that one up.

use std::time::Duration;

use super::dialect::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_DATA, MISSION_REQUEST_INT_DATA,
    MavMissionResult, MavMissionType,
};
use super::{Address, MavMessage};

/// How long to wait for what follows an item, and for everything else, before saying it again, and how often to say it again.
pub const ITEM_WAIT: Duration = Duration::from_millis(250);
pub const WAIT: Duration = Duration::from_millis(1500);
pub const RETRIES: u32 = 5;

/// A transfer that the autopilot has got wrong is begun again so often.
const ROUNDS: u32 = 3;
/// No upload takes longer than this, and this for each item: an autopilot that asks for ever ends here.
const LONGEST: Duration = Duration::from_secs(60);
const LONGEST_ITEM: Duration = Duration::from_millis(500);

/// A mission on its way up.
#[derive(Clone, Debug)]
pub struct Upload {
    items: Vec<MISSION_ITEM_INT_DATA>,
    to: Address,
    us: Address,
    state: State,
    /// The first item that was not asked for yet.
    next: usize,
    round: u32,
    retries: u32,
    deadline: Duration,
    /// When the whole upload has failed.
    end: Duration,
    /// The last item was sent again without being asked for.
    is_repeated: bool,
    /// Somebody else that the autopilot exchanges a mission with.
    other: Option<Address>,
}

#[derive(Clone, Debug, PartialEq)]
enum State {
    /// The autopilot was told to give up another transfer.
    Clearing,
    /// It was told how many items there are.
    Announced,
    /// It has asked for the first item.
    Sending,
    Finished(Result<(), UploadError>),
}

/// Why a mission did not get to the autopilot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UploadError {
    #[error("the mission has {count} items; MAVLink carries 1 to 65535: fly the plan in several sorties")]
    Length { count: usize },
    #[error(
        "the autopilot ({to}) did not ask for the mission that was announced to it {tries} times; see that it is on, that the link carries both ways and \
         that its system id is meant{}", busy(.other)
    )]
    Silent { to: Address, tries: u32, other: Option<Address> },
    #[error(
        "the autopilot asked for {asked} of {count} items and then for nothing more, although the last one was sent {tries} times; the link loses too \
         much or is gone{}", busy(.other)
    )]
    Stalled { asked: usize, count: usize, tries: u32, other: Option<Address> },
    #[error(
        "the autopilot has all {count} items and does not confirm them; what it flies now is not known: look at its mission before flying"
    )]
    Unconfirmed { count: usize },
    #[error(
        "the autopilot asked for item {found} when item {expected} was next, {rounds} times over: it is confused by another transfer; end the other \
         ground stations' transfers and try again{}", busy(.other)
    )]
    Disorder { expected: usize, found: usize, rounds: u32, other: Option<Address> },
    #[error("the autopilot kept asking and was not finished after {seconds:.0} s; see what else is on the link")]
    TooLong { seconds: f64 },
    #[error("the autopilot refused the mission{}: {}", at(.item), reason(.result, *.count))]
    Refused { result: MavMissionResult, item: Option<(usize, String)>, count: usize },
}

impl UploadError {
    /// Whether the same mission may well be taken at another attempt.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Length { .. } => false,
            Self::Refused { result, .. } => matches!(
                result,
                MavMissionResult::MAV_MISSION_ERROR
                    | MavMissionResult::MAV_MISSION_OPERATION_CANCELLED
                    | MavMissionResult::MAV_MISSION_INVALID_SEQUENCE
            ),
            _ => true,
        }
    }
}

fn busy(other: &Option<Address>) -> String {
    other.map_or(String::new(), |other| {
        format!(" (it exchanges a mission with another station, {other}: wait for that, or end it)")
    })
}

fn at(item: &Option<(usize, String)>) -> String {
    item.as_ref().map_or(String::new(), |(seq, command)| format!(" at item {seq} ({command})"))
}

/// What an answer means, and what to do about it.
fn reason(result: &MavMissionResult, count: usize) -> String {
    use MavMissionResult::*;
    let parameter = |which: &str| format!("parameter {which} is wrong for it; give `--autopilot` if another kind was detected");
    match result {
        MAV_MISSION_NO_SPACE => {
            format!("it has no room for {count} items; fly shorter sorties (`--sortie-time`), or give the board an SD card")
        }
        MAV_MISSION_UNSUPPORTED_FRAME => "it does not know the frame of the heights; update its firmware".to_owned(),
        MAV_MISSION_UNSUPPORTED => {
            "it does not know the command; give `--autopilot` if another kind was detected, or update its firmware".to_owned()
        }
        MAV_MISSION_DENIED => {
            "it takes no mission from this program now; see its messages, and whether it is armed or in a failsafe".to_owned()
        }
        MAV_MISSION_INVALID => {
            "it finds the item invalid; see its messages: often it is too far from home, or outside of a geofence".to_owned()
        }
        MAV_MISSION_INVALID_PARAM1 => parameter("1"),
        MAV_MISSION_INVALID_PARAM2 => parameter("2"),
        MAV_MISSION_INVALID_PARAM3 => parameter("3"),
        MAV_MISSION_INVALID_PARAM4 => parameter("4"),
        MAV_MISSION_INVALID_PARAM5_X => parameter("5 (latitude)"),
        MAV_MISSION_INVALID_PARAM6_Y => parameter("6 (longitude)"),
        MAV_MISSION_INVALID_PARAM7 => parameter("7 (height)"),
        MAV_MISSION_INVALID_SEQUENCE => "it lost count of the items; try again".to_owned(),
        MAV_MISSION_OPERATION_CANCELLED => {
            "the transfer was cancelled; another station or a failsafe did that: try again".to_owned()
        }
        MAV_MISSION_ERROR => "it gives no reason; see its messages, and whether another station transfers a mission".to_owned(),
        MAV_MISSION_ACCEPTED => "it accepted it".to_owned(),
    }
}

impl Upload {
    /// An upload that begins now, and its first message. With `clears`, a transfer that was given up before is ended first.
    pub fn begin(
        items: &[MISSION_ITEM_INT_DATA],
        us: Address,
        to: Address,
        clears: bool,
        now: Duration,
    ) -> Result<(Self, Vec<MavMessage>), UploadError> {
        let count = items.len();
        if u16::try_from(count).ok().is_none_or(|count| count == 0) {
            return Err(UploadError::Length { count });
        }
        let addressed = |(seq, item): (usize, &MISSION_ITEM_INT_DATA)| MISSION_ITEM_INT_DATA {
            seq: seq as u16,
            target_system: to.system,
            target_component: to.component,
            ..item.clone()
        };
        let mut upload = Self {
            items: items.iter().enumerate().map(addressed).collect(),
            to,
            us,
            state: State::Announced,
            next: 0,
            round: 1,
            retries: 0,
            deadline: now,
            end: now + LONGEST + LONGEST_ITEM * count as u32,
            is_repeated: false,
            other: None,
        };
        let first = if clears { upload.clear(now) } else { upload.announce(now) };
        Ok((upload, first))
    }

    /// `None` while it goes on.
    pub fn outcome(&self) -> Option<&Result<(), UploadError>> {
        match &self.state {
            State::Finished(outcome) => Some(outcome),
            _ => None,
        }
    }

    /// Items that were asked for so far.
    pub fn asked(&self) -> usize {
        self.next
    }

    /// What ends the transfer before its time.
    pub fn cancel(&self) -> MavMessage {
        self.acknowledge(MavMissionResult::MAV_MISSION_OPERATION_CANCELLED)
    }

    /// Takes a message of anybody; what is to be sent because of it.
    pub fn hear(&mut self, from: Address, message: &MavMessage, now: Duration) -> Vec<MavMessage> {
        if from != self.to || self.outcome().is_some() {
            return Vec::new();
        }
        match message {
            // Old autopilots ask by MISSION_REQUEST; the answer is the same.
            MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA { seq, target_system, target_component, mission_type })
            | MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA { seq, target_system, target_component, mission_type })
                if self.is_ours(*target_system, *target_component, *mission_type) =>
            {
                return self.asked_for(usize::from(*seq), now);
            }
            MavMessage::MISSION_ACK(ack) if self.is_ours(ack.target_system, ack.target_component, ack.mission_type) => {
                return self.answered(ack.mavtype, now);
            }
            _ => {}
        }
        Vec::new()
    }

    /// What is to be sent because time has passed.
    pub fn tick(&mut self, now: Duration) -> Vec<MavMessage> {
        if self.outcome().is_none() && now >= self.end {
            let seconds = (LONGEST + LONGEST_ITEM * self.items.len() as u32).as_secs_f64();
            return self.fail(UploadError::TooLong { seconds });
        }
        if self.outcome().is_some() || now < self.deadline {
            return Vec::new();
        }
        self.retries += 1;
        let is_given_up = self.retries > RETRIES;
        match self.state {
            // Quiet now, or as quiet as it will become.
            State::Clearing => self.announce_again(now),
            State::Announced if is_given_up => {
                self.fail(UploadError::Silent { to: self.to, tries: RETRIES + 1, other: self.other })
            }
            State::Announced => {
                self.deadline = now + WAIT;
                vec![self.count()]
            }
            State::Sending if is_given_up && self.next == self.items.len() => {
                // The confirmation may be what was lost, and not every autopilot repeats it.
                self.restart(UploadError::Unconfirmed { count: self.items.len() }, now)
            }
            State::Sending if is_given_up => self.fail(UploadError::Stalled {
                asked: self.next,
                count: self.items.len(),
                tries: RETRIES + 1,
                other: self.other,
            }),
            State::Sending => {
                self.is_repeated = true;
                self.send(self.next - 1, now)
            }
            State::Finished(_) => Vec::new(),
        }
    }

    fn is_ours(&mut self, system: u8, component: u8, mission_type: MavMissionType) -> bool {
        if mission_type != MavMissionType::MAV_MISSION_TYPE_MISSION {
            return false;
        }
        let is_ours = self.us.is_meant_by(system, component);
        if !is_ours {
            self.other = Some(Address { system, component });
        }
        is_ours
    }

    fn asked_for(&mut self, seq: usize, now: Duration) -> Vec<MavMessage> {
        match self.state {
            State::Clearing => {
                // The other transfer is alive yet.
                self.retries += 1;
                if self.retries > RETRIES {
                    let rounds = self.round;
                    return self.restart(UploadError::Disorder { expected: 0, found: seq, rounds, other: self.other }, now);
                }
                self.deadline = now + ITEM_WAIT;
                vec![self.cancel()]
            }
            State::Announced if seq == 0 => {
                self.state = State::Sending;
                self.next = 1;
                self.retries = 0;
                self.send(0, now)
            }
            State::Sending if seq < self.next => self.send(seq, now),
            State::Sending if seq == self.next && seq < self.items.len() => {
                self.next += 1;
                self.retries = 0;
                self.is_repeated = false;
                self.send(seq, now)
            }
            State::Announced | State::Sending => {
                // It asks for an item of another transfer.
                let expected = if self.state == State::Announced { 0 } else { self.next };
                let error = UploadError::Disorder { expected, found: seq, rounds: self.round, other: self.other };
                self.restart(error, now)
            }
            State::Finished(_) => Vec::new(),
        }
    }

    fn answered(&mut self, result: MavMissionResult, now: Duration) -> Vec<MavMessage> {
        let has_all = self.state == State::Sending && self.next == self.items.len();
        match result {
            MavMissionResult::MAV_MISSION_ACCEPTED if has_all => {
                self.state = State::Finished(Ok(()));
                Vec::new()
            }
            // The confirmation of an earlier transfer; the echo of our own word in one that was given up.
            MavMissionResult::MAV_MISSION_ACCEPTED => Vec::new(),
            MavMissionResult::MAV_MISSION_OPERATION_CANCELLED if self.state != State::Sending => Vec::new(),
            _ if self.state == State::Clearing => Vec::new(),
            // It got an item twice, or not the one that it waits for, and will ask for that.
            MavMissionResult::MAV_MISSION_INVALID_SEQUENCE => {
                self.deadline = now + WAIT;
                Vec::new()
            }
            // It has finished, and takes the last item, when it is sent again, for the stray of no transfer.
            MavMissionResult::MAV_MISSION_ERROR if has_all && self.is_repeated => {
                self.restart(UploadError::Unconfirmed { count: self.items.len() }, now)
            }
            _ => {
                let last = (self.state == State::Sending).then(|| self.next.saturating_sub(1));
                let item = last.map(|last| (last, format!("{:?}", self.items[last].command)));
                self.fail(UploadError::Refused { result, item, count: self.items.len() })
            }
        }
    }

    fn clear(&mut self, now: Duration) -> Vec<MavMessage> {
        self.state = State::Clearing;
        self.deadline = now + ITEM_WAIT;
        vec![self.cancel()]
    }

    /// Begins again after the autopilot was told to give up, unless that was tried often enough.
    fn restart(&mut self, error: UploadError, now: Duration) -> Vec<MavMessage> {
        self.round += 1;
        self.retries = 0;
        self.next = 0;
        if self.round > ROUNDS { self.fail(error) } else { self.clear(now) }
    }

    fn announce_again(&mut self, now: Duration) -> Vec<MavMessage> {
        self.retries = 0;
        self.announce(now)
    }

    fn announce(&mut self, now: Duration) -> Vec<MavMessage> {
        self.state = State::Announced;
        self.next = 0;
        self.is_repeated = false;
        self.deadline = now + WAIT;
        vec![self.count()]
    }

    fn count(&self) -> MavMessage {
        MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: self.items.len() as u16,
            target_system: self.to.system,
            target_component: self.to.component,
            ..MISSION_COUNT_DATA::DEFAULT
        })
    }

    fn send(&mut self, seq: usize, now: Duration) -> Vec<MavMessage> {
        self.deadline = now + if self.next == self.items.len() { WAIT } else { ITEM_WAIT };
        vec![MavMessage::MISSION_ITEM_INT(self.items[seq].clone())]
    }

    fn acknowledge(&self, result: MavMissionResult) -> MavMessage {
        MavMessage::MISSION_ACK(MISSION_ACK_DATA {
            target_system: self.to.system,
            target_component: self.to.component,
            mavtype: result,
            ..MISSION_ACK_DATA::DEFAULT
        })
    }

    fn fail(&mut self, error: UploadError) -> Vec<MavMessage> {
        self.state = State::Finished(Err(error));
        vec![self.cancel()]
    }
}
