//! How far a flight has come: where the aircraft is on its plan, which images it has taken, and what the daemon is told of it.
//!
//! An exposure is passed when the aircraft is level with it on its leg. Where the camera tells of its images (CAMERA_IMAGE_CAPTURED, CAMERA_FEEDBACK), an
//! image of the plan was taken when one was taken near it; those up to the last of them count, as a report can only count from the first image on, and
//! those that none was taken near are told beside it. Without such messages what was passed counts as taken.

use std::sync::Arc;
use std::time::Duration;

use nalgebra::{Point3, Vector3};
use overfly_client::FlightReport;

use super::dialect::GLOBAL_POSITION_INT_DATA;
use super::mission::Mission;
use crate::camera::pitch_rad;
use crate::frame::Geodetic;
use crate::trajectory::limits::Turning;
use crate::trajectory::profile::Profile;

/// A position is old after this: an aircraft at cruise is elsewhere by then.
const FRESH: Duration = Duration::from_secs(2);
/// An image was taken for an exposure of the plan at most so far from it: this share of the way to the next one, and at least so many metres.
const NEAR_SHARE: f64 = 0.75;
const NEAR_M: f64 = 3.0;
/// An aircraft keeps to its path when it is no farther from it than this, m.
const ON_PATH_M: f64 = 5.0;
/// Items that are current by mistake, in a message that comes late, do not end a flight: so many in a row have to say so.
const SURE: u32 = 2;

/// One release of the shutter: the images of all cameras.
#[derive(Clone, Copy, Debug)]
struct Exposure {
    position_m: Point3<f64>,
    leg: usize,
    /// Images of the plan up to and with those of this one.
    images: usize,
}

/// Where an aircraft is, in the local frame of its plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    pub position_m: Point3<f64>,
    pub velocity_mps: Vector3<f64>,
    pub at: Duration,
}

/// A flight along one mission.
#[derive(Clone, Debug)]
pub struct Progress {
    pub mission: Arc<Mission>,
    profile: Option<Profile>,
    exposures: Vec<Exposure>,
    /// The waypoint that is flown to.
    ahead: Option<usize>,
    is_under_way: bool,
    behind_last: u32,
    is_flown: bool,
    pub fix: Option<Fix>,
    /// Exposures that were passed, and those up to the last one that the camera tells of.
    passed: usize,
    fed: usize,
    matched: usize,
    strays: usize,
    /// The camera tells of its images.
    pub is_fed: bool,
}

impl Progress {
    /// The flight along a mission that is joined at a waypoint, or begins on the ground.
    pub fn new(mission: Arc<Mission>, joined: Option<usize>, fix: Option<Fix>, is_fed: bool) -> Self {
        let exposures = exposures(&mission);
        // What lies before the place where it is joined is not flown any more.
        let before = joined.map_or(0, |joined| {
            let leg = joined.saturating_sub(1);
            exposures.partition_point(|exposure| exposure.leg < leg)
        });
        Self {
            exposures,
            ahead: joined,
            is_under_way: joined.is_some(),
            behind_last: 0,
            is_flown: false,
            fix,
            passed: before,
            fed: before,
            matched: before,
            strays: 0,
            is_fed,
            profile: mission.plan.profile(),
            mission,
        }
    }

    /// An item has become current.
    pub fn current(&mut self, item: usize) {
        let ahead = self.mission.waypoint_ahead(item);
        match ahead {
            Some(_) => {
                self.behind_last = 0;
                self.ahead = ahead;
                let first = self.mission.stops.first().map(|stop| stop.item);
                self.is_under_way |= first.is_some_and(|first| item > first);
            }
            None => {
                self.behind_last += 1;
                if self.is_under_way && self.behind_last >= SURE {
                    self.finish();
                }
            }
        }
    }

    /// An item was reached.
    pub fn reached(&mut self, item: usize) {
        let Some(index) = self.mission.stops.iter().position(|stop| stop.item == item) else { return };
        self.is_under_way = true;
        match self.mission.stops.get(index + 1) {
            Some(next) if self.ahead.is_none_or(|ahead| ahead < next.waypoint) => self.ahead = Some(next.waypoint),
            Some(_) => {}
            None => self.finish(),
        }
    }

    /// The aircraft is somewhere else.
    pub fn moved(&mut self, message: &GLOBAL_POSITION_INT_DATA, now: Duration) {
        let Some(position_m) = self.local(message.lat, message.lon, message.relative_alt) else { return };
        let mps = |cm: i16| f64::from(cm) / 100.0;
        let velocity_mps = Vector3::new(mps(message.vy), mps(message.vx), -mps(message.vz));
        self.fix = Some(Fix { position_m, velocity_mps, at: now });
        let Some(leg) = self.leg().filter(|_| self.is_under_way) else { return };
        while let Some(exposure) = self.exposures.get(self.passed) {
            let is_passed = exposure.leg + 1 < leg
                || (exposure.leg <= leg && self.is_level(exposure, exposure.leg, &position_m))
                || (exposure.leg + 1 == leg && self.is_level(exposure, leg, &position_m));
            if !is_passed {
                break;
            }
            self.passed += 1;
        }
    }

    /// An image was taken: degrees times 10^7, and millimetres above the take-off place.
    pub fn captured(&mut self, lat: i32, lon: i32, relative_mm: i32) {
        self.is_fed = true;
        let Some(position_m) = self.local(lat, lon, relative_mm) else { return };
        let most_leg = self.leg().map_or(0, |leg| leg + 1);
        let ahead = self.exposures.iter().enumerate().skip(self.fed).take_while(|(_, exposure)| exposure.leg <= most_leg);
        let off_m = |exposure: &Exposure| (exposure.position_m - position_m).norm();
        let nearest = ahead.min_by(|a, b| off_m(a.1).total_cmp(&off_m(b.1)));
        match nearest {
            Some((index, exposure)) if off_m(exposure) <= self.near_m(index) => {
                self.fed = index + 1;
                self.matched += 1;
            }
            _ => self.strays += 1,
        }
    }

    /// Images of the plan that were taken, from its first one on.
    pub fn images_taken(&self) -> usize {
        self.images_up_to(if self.is_fed { self.fed } else { self.passed })
    }

    fn images_up_to(&self, exposures: usize) -> usize {
        exposures.checked_sub(1).map_or(0, |last| self.exposures[last].images)
    }

    /// Where an aircraft that keeps to its plan will be, how it will move, and how many exposures it will have passed by then; `None` for one that is
    /// not on its path.
    fn in_future(&self, fix: &Fix, lead_s: f64) -> Option<(Point3<f64>, Vector3<f64>, usize)> {
        let profile = self.profile.as_ref()?;
        let leg = self.leg()?;
        let waypoints = &self.mission.plan.waypoints;
        let (from, to) = (waypoints.get(leg)?.position_m, waypoints.get(leg + 1)?.position_m);
        let along = (to - from).try_normalize(0.0)?;
        let flown_m = (fix.position_m - from).dot(&along).clamp(0.0, (to - from).norm());
        let here = profile.passing(leg, flown_m)?;
        if (here.position_m - fix.position_m).norm() > ON_PATH_M {
            return None;
        }
        let last = self.mission.stops.last()?.waypoint.checked_sub(1)?;
        let last_s = profile.time_at_s(last, (waypoints.get(last + 1)?.position_m - waypoints[last].position_m).norm());
        let then = profile.at((here.time_s + lead_s).min(last_s))?;
        let images = &self.mission.plan.images;
        let more =
            self.exposures.iter().skip(self.passed).take_while(|exposure| images[exposure.images - 1].time_s <= then.time_s);
        Some((then.position_m, then.velocity_mps, more.count()))
    }

    /// Exposures among them that the camera has told of no image near to, and images that belong to none.
    pub fn missed(&self) -> usize {
        if self.is_fed { self.fed - self.matched } else { 0 }
    }

    pub fn strays(&self) -> usize {
        self.strays
    }

    /// The waypoint of the plan that is flown to.
    pub fn ahead(&self) -> Option<usize> {
        self.ahead
    }

    /// It flies along the plan: not on the ground, and not on the way to its beginning.
    pub fn is_under_way(&self) -> bool {
        self.is_under_way && !self.is_flown
    }

    /// The last waypoint of the mission that belongs to the plan is reached.
    pub fn is_flown(&self) -> bool {
        self.is_flown
    }

    /// What the daemon is to know; `None` on the ground, and where the position is not known or old. A plan that follows from it is flown so much
    /// later, `lead`: what is reported is where the aircraft will be by then, if it flies on along its plan as that is timed.
    pub fn report(&self, now: Duration, lead: Duration) -> Option<FlightReport> {
        let fix = self.fix.filter(|fix| now.saturating_sub(fix.at) <= FRESH && self.is_under_way())?;
        let ahead = self.in_future(&fix, lead.as_secs_f64());
        let (position_m, velocity_mps, more) = ahead.unwrap_or((fix.position_m, fix.velocity_mps, 0));
        let passed = (self.passed + more).min(self.exposures.len());
        Some(FlightReport {
            epoch: self.mission.epoch,
            images_taken: self.images_up_to(if self.is_fed { (self.fed + more).min(passed.max(self.fed)) } else { passed })
                as u64,
            position_m: position_m.into(),
            velocity_mps: velocity_mps.into(),
            view_deg: self.view_deg(passed),
            time_left_s: None,
            landing_m: None,
        })
    }

    /// A place on the wire in the local frame; `None` for one that is not known yet.
    fn local(&self, lat: i32, lon: i32, relative_mm: i32) -> Option<Point3<f64>> {
        local(&self.mission, lat, lon, relative_mm)
    }

    /// The leg that is flown.
    fn leg(&self) -> Option<usize> {
        self.ahead?.checked_sub(1)
    }

    /// Whether a place is as far along a leg as an exposure, or farther.
    fn is_level(&self, exposure: &Exposure, leg: usize, position_m: &Point3<f64>) -> bool {
        let waypoints = &self.mission.plan.waypoints;
        let (Some(from), Some(to)) = (waypoints.get(leg), waypoints.get(leg + 1)) else { return true };
        let along = to.position_m - from.position_m;
        (position_m - exposure.position_m).dot(&along) >= 0.0
    }

    fn near_m(&self, index: usize) -> f64 {
        let at = &self.exposures[index];
        let neighbours = [index.checked_sub(1), Some(index + 1)];
        let gaps = neighbours.into_iter().filter_map(|other| self.exposures.get(other?));
        let gap_m = gaps.map(|other| (other.position_m - at.position_m).norm()).fold(0.0, f64::max);
        (NEAR_SHARE * gap_m).max(NEAR_M)
    }

    fn finish(&mut self) {
        self.is_flown = true;
        let last = self.mission.stops.last().map_or(0, |stop| stop.waypoint);
        self.ahead = None;
        self.passed = self.exposures.partition_point(|exposure| exposure.leg < last.max(1));
    }

    /// Where a camera on a gimbal looks: as in the image that was passed last.
    fn view_deg(&self, passed: usize) -> Option<[f64; 2]> {
        let plan = &self.mission.plan;
        plan.limits.filter(|limits| limits.turning == Turning::View)?;
        let last = passed.checked_sub(1).map(|last| self.exposures[last].images - 1);
        let direction = match last.and_then(|image| plan.images.get(image)) {
            Some(image) => image.direction,
            None => plan.waypoints.first().and_then(|waypoint| waypoint.direction),
        }?;
        Some([libm::atan2(direction.x, direction.y).to_degrees(), pitch_rad(&direction).to_degrees()])
    }
}

/// A place on the wire in the local frame of a mission's plan: degrees times 10^7, and millimetres above the take-off place. `None` for one that is not known yet.
pub fn local(mission: &Mission, lat: i32, lon: i32, relative_mm: i32) -> Option<Point3<f64>> {
    if [lat, lon] == [0, 0] {
        return None;
    }
    let origin = mission.frame.origin?;
    let place = Geodetic { lat_deg: f64::from(lat) * 1e-7, lon_deg: f64::from(lon) * 1e-7, alt_m: origin.alt_m };
    let at = mission.frame.local_from_geodetic(&place)?;
    Some(Point3::new(at.x, at.y, mission.home_z_m + f64::from(relative_mm) / 1000.0))
}

/// The exposures of a plan with their legs.
fn exposures(mission: &Mission) -> Vec<Exposure> {
    let plan = &mission.plan;
    let profile = plan.profile();
    let mut exposures: Vec<Exposure> = Vec::new();
    let mut last_s = f64::NAN;
    for (index, image) in plan.images.iter().enumerate() {
        match exposures.last_mut() {
            Some(exposure) if image.time_s == last_s => exposure.images = index + 1,
            _ => {
                let leg = profile.as_ref().and_then(|profile| profile.at(image.time_s)).map_or(0, |passage| passage.leg);
                let leg = exposures.last().map_or(leg, |before| leg.max(before.leg));
                exposures.push(Exposure { position_m: image.position_m, leg, images: index + 1 });
            }
        }
        last_s = image.time_s;
    }
    exposures
}

#[cfg(test)]
mod tests;
