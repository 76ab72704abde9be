//! The speed profile: how long a drone of given limits takes along a path, and where it is when. One profile with the same limits ranks
//! every method.
//!
//! Eq. 5 makes a hairpin (2.25 s) cheaper than two turns of 45 degrees (2.72 s), so it cannot rank paths. Here every corner is rounded by an
//! arc that keeps within `corner_deviation_m` of the corner; the arc's radius limits the speed by the lateral acceleration and, where the
//! drone flies nose first, by its yaw rate. Straight parts are flown with bounded acceleration and jerk up to the cruise speed, or slower where
//! the camera has to turn. The flight ends at rest, and begins there or with the speed that the drone has (`Limits::entry_mps`).

use nalgebra::{Point3, Unit, Vector3};

pub use super::corner::Corner;
use super::curve::Curve;
pub use super::limits::{Limits, Turning};
use super::straight::{Motion, Straight};
use crate::camera::{Pose, Rig, direction_of};
use crate::search::leg::heading;
use crate::settings::{DynamicsSettings, FlightSettings};

/// A timed curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    curve: Curve,
    corners: Vec<Corner>,
    legs: Vec<TimedLeg>,
    duration_s: f64,
}

/// A drone on its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    pub time_s: f64,
    /// The leg, and the distance from its start along the leg. A place that an arc cuts off is passed on the arc.
    pub leg: usize,
    pub flown_m: f64,
    pub position_m: Point3<f64>,
    pub velocity_mps: Vector3<f64>,
    /// Where the nose points on the horizon where the drone flies nose first; east where it only climbs or sinks.
    pub heading: Unit<Vector3<f64>>,
}

/// A piece of the flight in which the drone does one thing: cruise, change its speed, fly an arc, or turn on the spot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    pub start_s: f64,
    pub end_s: f64,
    /// The most that the velocity changes on it, m/s^2.
    pub acceleration_mps2: f64,
}

/// A leg between the arcs at its ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct TimedLeg {
    /// When the drone passes the leg's start: the middle of the arc there, s.
    start_s: f64,
    /// Length of the polyline's leg and what the arcs at both ends cut off it, m.
    length_m: f64,
    cut_m: [f64; 2],
    /// Time in the second half of the first arc and in the first half of the last one, s.
    arc_s: [f64; 2],
    straight: Straight,
}

/// A part of a leg, and how far the drone has come on it.
enum Part {
    /// Share of the second half of the arc at the leg's start.
    FirstArc(f64),
    Straight(Motion),
    /// Share of the first half of the arc at its end.
    LastArc(f64),
}

impl Profile {
    /// The profile of a path whose corners are rounded as far as the settings allow.
    pub fn new(path: &[Pose], rig: &Rig, flight: &FlightSettings, dynamics: &DynamicsSettings) -> Self {
        Self::rounded(path, &Limits::new(rig, flight, dynamics), &vec![dynamics.corner_deviation_m; path.len()])
    }

    /// The profile of a path with an arc at each waypoint that keeps within a distance of its own, m; 0 is a stop.
    pub fn rounded(path: &[Pose], limits: &Limits, deviations_m: &[f64]) -> Self {
        let lengths_m: Vec<f64> = path.windows(2).map(|ends| (ends[1].position - ends[0].position).norm()).collect();
        let speeds_mps: Vec<f64> = path.windows(2).map(|ends| limits.leg_mps(&ends[0], &ends[1])).collect();
        let mut corners = vec![Corner::default(); path.len()];
        for (k, at) in path.windows(3).enumerate() {
            let limit_mps = speeds_mps[k].min(speeds_mps[k + 1]);
            corners[k + 1] = limits.corner_within(&at[0], &at[1], &at[2], limit_mps, deviations_m[k + 1]);
        }
        if let Some(first) = corners.first_mut() {
            *first = limits.entry();
        }
        bound_speeds(limits, &mut corners, &lengths_m);
        let mut legs = Vec::with_capacity(lengths_m.len());
        let mut duration_s = 0.0;
        for (k, &length_m) in lengths_m.iter().enumerate() {
            let leg = TimedLeg::new(duration_s, length_m, &[corners[k], corners[k + 1]], speeds_mps[k], limits);
            duration_s = leg.end_s();
            legs.push(leg);
        }
        let curve = Curve::new(path.iter().map(|pose| pose.position).collect(), &corners);
        Self { curve, corners, legs, duration_s }
    }

    /// Time of the whole flight, s.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The curve that is flown.
    pub fn curve(&self) -> &Curve {
        &self.curve
    }

    /// When the drone is `flown_m` from the start of a leg, s since the start of the flight. A place that an arc cuts off is passed on
    /// the arc; at a stop it is the time of arrival.
    pub fn time_at_s(&self, leg: usize, flown_m: f64) -> f64 {
        self.legs.get(leg).map_or(0.0, |leg| leg.passing(flown_m).0)
    }

    /// The drone when it is `flown_m` from the start of a leg; `None` for a path without waypoints or a leg that it does not have.
    pub fn passing(&self, leg: usize, flown_m: f64) -> Option<Passage> {
        match self.legs.get(leg) {
            Some(timed) => {
                let (time_s, part) = timed.passing(flown_m);
                Some(self.passage(leg, time_s, part))
            }
            None => self.resting().filter(|_| leg == 0),
        }
    }

    /// The drone at a time since the start of the flight; before and after the flight it rests at the path's ends. `None` for a path
    /// without waypoints.
    pub fn at(&self, time_s: f64) -> Option<Passage> {
        let time_s = time_s.clamp(0.0, self.duration_s);
        let leg = self.legs.partition_point(|leg| leg.start_s <= time_s).saturating_sub(1);
        match self.legs.get(leg) {
            Some(timed) => Some(self.passage(leg, time_s, timed.part_at(time_s))),
            None => self.resting(),
        }
    }

    /// The pieces of the flight in each of which the drone does one thing, in their order.
    pub fn pieces(&self) -> impl Iterator<Item = Piece> + '_ {
        self.legs.iter().enumerate().flat_map(|(index, leg)| {
            let on_arc = |end: usize| (leg.arc_s[end], self.corners[index + end].lateral_mps2());
            let [rise_s, level_s, fall_s] = leg.straight.parts_s();
            let [rise_mps2, fall_mps2] = leg.straight.most_mps2();
            let mut end_s = leg.start_s;
            let parts = [on_arc(0), (rise_s, rise_mps2), (level_s, 0.0), (fall_s, fall_mps2), on_arc(1)];
            parts.map(|(part_s, acceleration_mps2)| {
                let start_s = end_s;
                end_s += part_s;
                Piece { start_s, end_s, acceleration_mps2 }
            })
        })
    }

    fn resting(&self) -> Option<Passage> {
        let position_m = *self.curve.waypoints.first()?;
        let velocity_mps = Vector3::zeros();
        Some(Passage { time_s: 0.0, leg: 0, flown_m: 0.0, position_m, velocity_mps, heading: Vector3::x_axis() })
    }

    fn passage(&self, leg: usize, time_s: f64, part: Part) -> Passage {
        let timed = &self.legs[leg];
        match part {
            Part::FirstArc(share) => {
                let on_arc = self.on_arc(leg, 0.5 + share / 2.0);
                Passage { time_s, leg, flown_m: timed.cut_m[0] * share, ..on_arc }
            }
            Part::LastArc(share) => {
                let flown_m = timed.length_m - timed.cut_m[1] * (1.0 - share);
                Passage { time_s, leg, flown_m, ..self.on_arc(leg + 1, share / 2.0) }
            }
            Part::Straight(motion) => {
                let (from, to) = (self.curve.waypoints[leg], self.curve.waypoints[leg + 1]);
                let flown_m = timed.cut_m[0] + motion.flown_m;
                let ahead = (to - from) / timed.length_m.max(f64::MIN_POSITIVE);
                // At the very ends the waypoints themselves, without rounding.
                let position_m = if flown_m >= timed.length_m { to } else { from + ahead * flown_m };
                Passage { time_s, leg, flown_m, position_m, velocity_mps: ahead * motion.speed_mps, heading: heading(&from, &to) }
            }
        }
    }

    /// The drone on the arc at a waypoint after a share of it; where it stops the share is that of its turn.
    fn on_arc(&self, waypoint: usize, share: f64) -> Passage {
        let (arc, corner) = (&self.curve.arcs[waypoint], &self.corners[waypoint]);
        let (position_m, ahead) = arc.at(corner.deviation_rad * share);
        let legs = self.headings_at(waypoint);
        let (time_s, leg, flown_m) = (0.0, waypoint, 0.0);
        if corner.is_stop() {
            let (position_m, velocity_mps) = (arc.corner, Vector3::zeros());
            return Passage { time_s, leg, flown_m, position_m, velocity_mps, heading: turned(&legs, share) };
        }
        let level = Vector3::new(ahead.x, ahead.y, 0.0);
        let heading = Unit::try_new(level, 1e-6).unwrap_or(legs[usize::from(share > 0.5)]);
        Passage { time_s, leg, flown_m, position_m, velocity_mps: ahead * corner.speed_mps, heading }
    }

    /// Headings of the legs before and after a waypoint.
    fn headings_at(&self, waypoint: usize) -> [Unit<Vector3<f64>>; 2] {
        let points = &self.curve.waypoints;
        let last = points.len() - 1;
        let (before, after) = (waypoint.max(1), waypoint.min(last.saturating_sub(1)));
        [heading(&points[before - 1], &points[before.min(last)]), heading(&points[after], &points[(after + 1).min(last)])]
    }
}

impl TimedLeg {
    fn new(start_s: f64, length_m: f64, ends: &[Corner; 2], limit_mps: f64, limits: &Limits) -> Self {
        let arc_s = ends.map(|corner| corner.duration_s(&limits.dynamics) / 2.0);
        let straight = limits.straight(length_m, ends, limit_mps);
        Self { start_s, length_m, cut_m: ends.map(|corner| corner.cut_m), arc_s, straight }
    }

    fn end_s(&self) -> f64 {
        self.start_s + self.arc_s[0] + self.straight.duration_s() + self.arc_s[1]
    }

    /// When a place of the leg is passed, s, and the part on which that is.
    fn passing(&self, flown_m: f64) -> (f64, Part) {
        let [first_m, last_m] = self.cut_m;
        let flown_m = flown_m.clamp(0.0, self.length_m);
        let into_last_m = flown_m - (self.length_m - last_m);
        if flown_m < first_m {
            let share = flown_m / first_m;
            (self.start_s + self.arc_s[0] * share, Part::FirstArc(share))
        } else if into_last_m > 0.0 {
            let share = (into_last_m / last_m).min(1.0);
            (self.start_s + self.arc_s[0] + self.straight.duration_s() + self.arc_s[1] * share, Part::LastArc(share))
        } else {
            let flown_m = flown_m - first_m;
            let straight_s = self.straight.time_at_s(flown_m);
            let motion = Motion { flown_m, ..self.straight.motion_at(straight_s) };
            (self.start_s + self.arc_s[0] + straight_s, Part::Straight(motion))
        }
    }

    /// The part on which the drone is at a time.
    fn part_at(&self, time_s: f64) -> Part {
        let straight_s = self.straight.duration_s();
        let into_s = time_s - self.start_s;
        let into_last_s = into_s - self.arc_s[0] - straight_s;
        if into_s < self.arc_s[0] {
            Part::FirstArc(into_s / self.arc_s[0])
        } else if into_last_s > 0.0 && self.arc_s[1] > 0.0 {
            Part::LastArc((into_last_s / self.arc_s[1]).min(1.0))
        } else {
            Part::Straight(self.straight.motion_at(into_s - self.arc_s[0]))
        }
    }
}

/// Lowers the corners' speeds until each can be reached from its neighbours.
fn bound_speeds(limits: &Limits, corners: &mut [Corner], lengths_m: &[f64]) {
    for (k, &length_m) in lengths_m.iter().enumerate() {
        let reachable_mps = limits.reachable_mps(corners[k].speed_mps, length_m, [&corners[k], &corners[k + 1]]);
        corners[k + 1].speed_mps = corners[k + 1].speed_mps.min(reachable_mps);
    }
    for (k, &length_m) in lengths_m.iter().enumerate().rev() {
        let reachable_mps = limits.reachable_mps(corners[k + 1].speed_mps, length_m, [&corners[k], &corners[k + 1]]);
        corners[k].speed_mps = corners[k].speed_mps.min(reachable_mps);
    }
}

/// A heading part of the way from one to another, by the shorter way.
fn turned(legs: &[Unit<Vector3<f64>>; 2], share: f64) -> Unit<Vector3<f64>> {
    if share <= 0.0 {
        return legs[0];
    }
    let [before_deg, after_deg] = legs.map(|heading| libm::atan2(heading.x, heading.y).to_degrees());
    let turn_deg = (after_deg - before_deg + 540.0).rem_euclid(360.0) - 180.0;
    direction_of(before_deg + turn_deg * share, 0.0)
}

#[cfg(test)]
mod tests;
