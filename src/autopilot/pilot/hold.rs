//! When an aircraft is told to stay where it is, and what ends that.

use std::time::Duration;

use super::{Pilot, Work};
use crate::autopilot::command::Order;
use crate::autopilot::dialect::GLOBAL_POSITION_INT_DATA;
use crate::autopilot::notice::Notice;

/// At rest it is no faster than this in any direction, cm/s, and it is after this time.
const REST_CMPS: u16 = 50;
const BRAKES: Duration = Duration::from_secs(10);

/// Why an aircraft was told to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// There is no flight in the scene: only a plan that is flown ends it.
    NoFlight,
    /// The path of a plan is far away. Without that plan it flies on.
    FarOff,
}

impl Pilot {
    /// There is no flight in the scene any more: the aircraft is not to go on.
    pub fn hold(&mut self) {
        self.wanted = None;
        if let Work::Uploading { upload, .. } = &self.work {
            self.out.push(upload.cancel());
            self.work = Work::Idle;
        }
        let is_ours = self.is_in_flight() && !self.is_by_hand();
        if self.options.holds && is_ours && self.held.replace(Held::NoFlight).is_none() {
            self.orders.push_back(Order::Hold);
        }
    }

    /// Whether it flies a mission of ours: along the plan or to where that begins, or would if it did not hold.
    pub(super) fn is_in_flight(&self) -> bool {
        let is_on_mission = self.vehicle.is_some_and(|vehicle| vehicle.is_on_mission == Some(true));
        let is_on_its_way = self.held.is_some() || (is_on_mission && self.is_airborne());
        self.progress.as_ref().is_some_and(|progress| progress.is_under_way() || (is_on_its_way && !progress.is_flown()))
    }

    /// Whether it flies otherwise than we have told it to: its pilot, or a failsafe, has it, and gets no orders from here.
    pub(super) fn is_by_hand(&self) -> bool {
        self.held.is_none() && self.vehicle.is_some_and(|vehicle| vehicle.is_on_mission == Some(false))
    }

    /// Whether an aircraft is at rest; one that is not is told to hold.
    pub(super) fn is_at_rest(&mut self, off_m: f64, now: Duration) -> bool {
        if self.held.is_none() {
            self.held = Some(Held::FarOff);
            self.orders.push_back(Order::Hold);
            self.notices.push(Notice::FarOff { off_m });
        }
        let latest = *self.at_rest.get_or_insert(now + BRAKES);
        let is_slow = |position: &GLOBAL_POSITION_INT_DATA| {
            [position.vx, position.vy, position.vz].iter().all(|speed| speed.unsigned_abs() <= REST_CMPS)
        };
        let is_still = || self.position.as_ref().is_some_and(|(position, _)| is_slow(position));
        self.has_obeyed() && (now >= latest || is_still())
    }

    pub(super) fn has_obeyed(&self) -> bool {
        self.command.is_none() && self.orders.is_empty()
    }

    /// A plan will not be flown. The one before is flown on, by an aircraft that holds for this one alone as well.
    pub(super) fn keep(&mut self, epoch: u64, why: String) {
        if self.held == Some(Held::FarOff) {
            (self.held, self.at_rest) = (None, None);
            self.orders.push_back(Order::Mission);
        }
        self.notices.push(Notice::Kept { epoch, why, is_held: self.held.is_some() });
    }

    /// The aircraft does not hold, or not any longer: it flies on, and not to a path that it was to hold for.
    pub(super) fn let_go(&mut self, why: &str) {
        let held = self.held.take();
        self.at_rest = None;
        // A mission that is there already is what it flies on along.
        if held != Some(Held::FarOff) || matches!(self.work, Work::Setting { .. }) {
            return;
        }
        if let Work::Uploading { upload, .. } = &self.work {
            self.out.push(upload.cancel());
            self.work = Work::Idle;
        }
        if let Some(new) = self.wanted.take() {
            self.keep(new.epoch, why.to_owned());
        }
    }
}
