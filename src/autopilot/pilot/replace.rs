//! How a plan becomes the mission that is flown, in flight as well.

use std::sync::Arc;
use std::time::Duration;

use nalgebra::Point3;

use super::{AIRBORNE_MM, ATTEMPTS, MOST_LEAD, PAUSE, PLANNING, POSITION_WAIT, Pilot, Vehicle, Work};
use crate::autopilot::command::{Command, Order, OrderError, SetCurrent};
use crate::autopilot::follow::{self, Fix, Progress};
use crate::autopilot::mission::{self, Join, Joined, Mission, MissionError, MissionOptions, NewPlan};
use crate::autopilot::notice::{End, Notice};
use crate::autopilot::upload::Upload;
use crate::mission::course::{CourseOptions, HomeChoice};

/// An aircraft that is in the air without a mission of ours joins the plan where it is no farther from it than this, m.
const NEAR_M: f64 = 30.0;
/// An aircraft that is farther from the path that it goes over to does not fly there straight, m: nothing is known of what stands between.
const STRAIGHT_M: f64 = 10.0;

impl Pilot {
    /// Takes a plan to be flown from the next safe waypoint on. One that is on its way up gives way to it.
    pub fn fly(&mut self, new: NewPlan) {
        let flown = self.progress.as_ref().map(|progress| &progress.mission);
        if flown.is_some_and(|flown| is_same(flown.epoch, &flown.plan, &new)) && matches!(self.work, Work::Idle) {
            return;
        }
        if let Work::Uploading { upload, mission, .. } = &self.work {
            if is_same(mission.epoch, &mission.plan, &new) {
                return;
            }
            self.notices.push(Notice::Superseded { epoch: mission.epoch, asked: upload.asked() });
            self.clears = true;
            self.work = Work::Idle;
        }
        self.wanted = Some(new);
        self.attempt = 0;
    }

    /// Goes on with whatever has come to its end.
    pub(super) fn advance(&mut self, now: Duration) {
        let Some(vehicle) = self.vehicle.filter(|vehicle| !vehicle.is_lost) else { return };
        if self.outcome.is_some() {
            return;
        }
        match &self.work {
            Work::Uploading { upload, .. } => {
                if let Some(outcome) = upload.outcome().cloned() {
                    let Work::Uploading { mission, began, .. } = std::mem::replace(&mut self.work, Work::Idle) else { return };
                    match outcome {
                        Ok(()) => self.on_uploaded(mission, vehicle, began, now),
                        Err(error) => self.on_failed(&mission, error.may_pass(), error.into(), now),
                    }
                }
            }
            Work::Setting { set, .. } => {
                if let Some(outcome) = set.outcome.clone() {
                    let Work::Setting { mission, join, item, .. } = std::mem::replace(&mut self.work, Work::Idle) else { return };
                    match outcome {
                        Ok(()) => self.on_set(mission, join, item),
                        Err(error) => self.on_unset(mission, join, error, now),
                    }
                }
            }
            Work::Idle => self.begin(vehicle, now),
        }
        self.give_orders(vehicle, now);
        if self.progress.as_ref().is_some_and(Progress::is_flown) {
            self.end(Ok(End::Flown));
        }
    }

    /// Begins to upload the plan that is wanted.
    fn begin(&mut self, vehicle: Vehicle, now: Duration) {
        let Some(new) = self.wanted.clone().filter(|_| now >= self.not_before) else { return };
        // Where the aircraft stands is where it takes off: worth to be waited for.
        let knows_home = self.progress.is_some() || self.options.course.home.is_some() || self.place().is_some();
        if !knows_home && now < vehicle.found + POSITION_WAIT {
            return;
        }
        let mission = match self.mission(&new, vehicle, now) {
            Ok(Some(mission)) => Arc::new(mission),
            // It comes to rest first.
            Ok(None) => return,
            Err(error) => return self.on_unfit(&new, error),
        };
        self.attempt += 1;
        match Upload::begin(&mission.items, self.us(), vehicle.address, std::mem::take(&mut self.clears), now) {
            Ok((upload, first)) => {
                if self.attempt == 1 && self.progress.is_none() {
                    self.notices.extend(mission.notes.iter().cloned().map(Notice::Note));
                }
                self.notices.push(Notice::Uploading { epoch: new.epoch, items: mission.items.len(), attempt: self.attempt });
                self.out.extend(first);
                self.work = Work::Uploading { upload: Box::new(upload), mission, began: now };
            }
            Err(error) => self.on_failed(&mission, false, error.into(), now),
        }
    }

    /// The mission of a plan for an aircraft that is where ours is; none while it has to come to rest for it.
    fn mission(&mut self, new: &NewPlan, vehicle: Vehicle, now: Duration) -> Result<Option<Mission>, MissionError> {
        let flown = self.progress.as_ref();
        let home = flown.map(|progress| progress.mission.home).or(self.options.course.home).or_else(|| self.place());
        let is_under_way = flown.is_some_and(Progress::is_under_way);
        let options = CourseOptions { home, in_flight: is_under_way, ..self.options.course.clone() };
        // A path from the pose of an aircraft in the air is the rest of a sortie.
        let sortie = if is_under_way { 1 } else { self.options.sortie };
        let free = self.options.free.clone();
        let options = MissionOptions { course: &options, free: free.as_deref(), sortie, autopilot: vehicle.autopilot };
        let plain = Mission::new(new, &options, None)?;
        let Some(join) = self.join(&plain, new, 0) else { return Ok(Some(plain)) };
        let from_m = self.far_off(&join, new, &plain);
        let joined = Joined { waypoint: join.waypoint, from_m };
        if from_m.is_some() && is_under_way {
            if self.is_by_hand() {
                // A mission that begins where it is now would be flown from wherever its pilot lets go of it.
                self.not_before = now + PAUSE;
                return Ok(None);
            }
            // Nothing holds for a path that it cannot reach.
            if self.held.is_none() {
                Mission::new(new, &options, Some(joined))?;
            }
            if !self.is_at_rest(join.off_m, now) {
                return Ok(None);
            }
        }
        Mission::new(new, &options, Some(joined)).map(Some)
    }

    /// Where an aircraft is that must not fly straight to the path that it goes over to.
    fn far_off(&self, join: &Join, new: &NewPlan, mission: &Mission) -> Option<Point3<f64>> {
        let (position, _) = self.position.as_ref().filter(|_| join.off_m > STRAIGHT_M)?;
        let position_m = follow::local(mission, position.lat, position.lon, position.relative_alt)?;
        // The leg that it flies may lead to where the new path begins.
        let flown =
            self.progress.as_ref().and_then(|progress| progress.ahead().map(|ahead| (&progress.mission.plan.waypoints, ahead)));
        let leads_there = flown.is_some_and(|(waypoints, ahead)| {
            let ends = ahead.checked_sub(1).and_then(|before| waypoints.get(before)).zip(waypoints.get(ahead));
            ends.is_some_and(|(from, to)| {
                let off_m = |p: &Point3<f64>| mission::away(p, &from.position_m, &to.position_m).norm();
                join.waypoint == 0
                    && off_m(&new.plan.waypoints[0].position_m) < STRAIGHT_M / 2.0
                    && off_m(&position_m) < STRAIGHT_M
            })
        });
        (!leads_there).then_some(position_m)
    }

    /// Where an aircraft that is under way goes over to a mission, looked for from a waypoint of it on.
    fn join(&self, mission: &Mission, new: &NewPlan, from: usize) -> Option<Join> {
        let (position, _) = self.position.as_ref()?;
        let position_m = follow::local(mission, position.lat, position.lon, position.relative_alt)?;
        let waypoints = &new.plan.waypoints;
        match &self.progress {
            Some(progress) if progress.is_under_way() => {
                let flown = &progress.mission;
                let changed = match new.differs_from {
                    Some((epoch, changed)) if epoch == flown.epoch => changed,
                    _ => mission::first_changed(&flown.plan.waypoints, waypoints),
                };
                Some(mission::join(waypoints, changed, progress.ahead(), &position_m, from))
            }
            Some(_) => None,
            // This program was started when the aircraft was in the air already.
            None => {
                let join = mission::join(waypoints, 0, None, &position_m, from);
                Some(join).filter(|join| self.is_airborne() && join.off_m <= NEAR_M)
            }
        }
    }

    /// The autopilot has a mission: an aircraft in the air is told where to go on with it, as it may have come farther meanwhile.
    fn on_uploaded(&mut self, mission: Arc<Mission>, vehicle: Vehicle, began: Duration, now: Duration) {
        let (epoch, items) = (mission.epoch, mission.items.len());
        let (sortie, sorties, took) = (mission.sortie, mission.sorties, now - began);
        self.lead = (PLANNING + took).min(MOST_LEAD);
        self.notices.push(Notice::Uploaded { epoch, items, took, sortie, sorties });
        let begun = mission.items.iter().position(|item| item.current == 1).unwrap_or(0);
        let from = mission.waypoint_ahead(begun).map_or(0, |waypoint| waypoint.saturating_sub(1));
        let new = self.wanted.clone().filter(|_| self.wants(&mission));
        let join = new.and_then(|new| self.join(&mission, &new, from));
        let way_in = mission.way_in.and_then(|item| Some([item, mission.stops.iter().find(|stop| stop.item > item)?.item]));
        // One that comes down to the path begins there, wherever the path is nearest.
        let comes_down = way_in.and_then(|[item, _]| mission.waypoint_ahead(item));
        // Where this sortie ends the next one begins, which is not in it.
        let last = mission.stops.last().map_or(0, |stop| stop.waypoint);
        let join = join.map(|join| Join { waypoint: comes_down.unwrap_or(join.waypoint.min(last)), ..join });
        let goes_on = join.and_then(|join| {
            if way_in.is_some() {
                return way_in;
            }
            let (position, _) = self.position.as_ref()?;
            let position_m = follow::local(&mission, position.lat, position.lon, position.relative_alt)?;
            mission.goes_on(join.waypoint, &position_m)
        });
        let target = match goes_on {
            Some([item, last]) => {
                let next = mission.stops.iter().find(|next| next.item > last);
                Some((item, next.map_or(last + 1, |next| next.item)))
            }
            // On its way to the beginning of the plan: the way out, not another take-off.
            None if self.is_airborne() => mission.stops.first().map(|stop| (stop.begins.saturating_sub(1), stop.item)),
            None => None,
        };
        match target {
            Some((item, latest)) => {
                let (set, first) = SetCurrent::begin(item as u16, latest as u16, vehicle.address, now);
                self.out.push(first);
                self.work = Work::Setting { set, mission, join, item };
            }
            None => self.on_set(mission, None, 0),
        }
    }

    /// The mission is the one that is flown from now on.
    fn on_set(&mut self, mission: Arc<Mission>, join: Option<Join>, item: usize) {
        let epoch = mission.epoch;
        if let Some(Join { waypoint, off_m }) = join {
            self.notices.push(Notice::Joined { epoch, waypoint, item, off_m });
        }
        let is_first = self.progress.is_none();
        let is_wanted = self.go_over(mission, join);
        if is_first && self.options.starts {
            self.orders.extend([Order::Arm, Order::Mission]);
        } else if is_wanted && self.held.take().is_some() {
            // Not where it was told to hold while this mission went up.
            self.orders.push_back(Order::Mission);
        }
    }

    /// The autopilot has a mission, and does not go on with the item that it was told to.
    fn on_unset(&mut self, mission: Arc<Mission>, join: Option<Join>, error: OrderError, now: Duration) {
        let is_wanted = self.wants(&mission);
        if self.progress.is_none() || (is_wanted && self.attempt < ATTEMPTS) {
            return self.on_failed(&mission, true, error.into(), now);
        }
        // The mission before is gone: this one is followed, from whatever item it is flown.
        self.notices.push(Notice::Disobeyed(error));
        self.go_over(mission, join);
    }

    /// Follows another mission; whether it is the one that is wanted still.
    fn go_over(&mut self, mission: Arc<Mission>, join: Option<Join>) -> bool {
        let is_wanted = self.wants(&mission);
        if is_wanted {
            self.wanted = None;
        }
        self.attempt = 0;
        self.at_rest = None;
        let before = self.progress.take();
        let fix: Option<Fix> = before.as_ref().and_then(|before| before.fix);
        let is_fed = before.is_some_and(|before| before.is_fed);
        self.progress = Some(Progress::new(mission, join.map(|join| join.waypoint), fix, is_fed));
        is_wanted
    }

    fn wants(&self, mission: &Mission) -> bool {
        self.wanted.as_ref().is_some_and(|wanted| is_same(mission.epoch, &mission.plan, wanted))
    }

    /// An upload has failed: it is tried again if it may pass. Else an aircraft in the air flies on along the plan before.
    fn on_failed(&mut self, mission: &Mission, may_pass: bool, error: super::PilotError, now: Duration) {
        let epoch = mission.epoch;
        self.clears = true;
        if may_pass && self.attempt < ATTEMPTS {
            self.not_before = now + PAUSE;
            return self.notices.push(Notice::Again { epoch, why: error.to_string() });
        }
        self.wanted = None;
        if self.is_in_flight() { self.keep(epoch, error.to_string()) } else { self.end(Err(error)) }
    }

    /// A plan that does not become a mission.
    fn on_unfit(&mut self, new: &NewPlan, error: MissionError) {
        self.wanted = None;
        if self.progress.is_some() { self.keep(new.epoch, error.to_string()) } else { self.end(Err(error.into())) }
    }

    fn give_orders(&mut self, vehicle: Vehicle, now: Duration) {
        if let Some(outcome) = self.command.as_ref().and_then(|command| command.outcome.clone()) {
            let order = self.command.take().map(|command| command.order);
            match outcome {
                Ok(()) => self.notices.extend(order.map(Notice::Obeyed)),
                Err(error) => {
                    self.orders.clear();
                    if !self.is_in_flight() {
                        return self.end(Err(error.into()));
                    }
                    self.notices.push(Notice::Disobeyed(error));
                    if order == Some(Order::Hold) {
                        self.let_go("the aircraft is far from it and does not hold");
                    }
                }
            }
        }
        if self.command.is_none()
            && let Some(order) = self.orders.pop_front()
        {
            let (command, first) = Command::begin(order, vehicle.address, vehicle.autopilot, now);
            self.out.push(first);
            self.command = Some(command);
        }
        let is_done = self.has_obeyed() && matches!(self.work, Work::Idle);
        if !self.options.follows && is_done && self.progress.is_some() && self.wanted.is_none() {
            self.end(Ok(End::Uploaded));
        }
    }

    pub(super) fn is_airborne(&self) -> bool {
        let is_up = self.position.as_ref().is_some_and(|(position, _)| position.relative_alt > AIRBORNE_MM);
        is_up && self.vehicle.is_some_and(|vehicle| vehicle.is_armed)
    }

    /// Where an aircraft stands that has not taken off.
    fn place(&self) -> Option<HomeChoice> {
        let (position, _) = self.position.as_ref().filter(|(position, _)| [position.lat, position.lon] != [0, 0])?;
        let degrees = |value: i32| f64::from(value) * 1e-7;
        (!self.is_airborne()).then(|| HomeChoice { lat_deg: degrees(position.lat), lon_deg: degrees(position.lon), alt_m: None })
    }
}

fn is_same(epoch: u64, plan: &Arc<crate::trajectory::plan::Plan>, new: &NewPlan) -> bool {
    epoch == new.epoch && (Arc::ptr_eq(plan, &new.plan) || (epoch != 0 && plan.waypoints == new.plan.waypoints))
}
