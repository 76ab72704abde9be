//! The speed profile of a path under change: only what a change touches is timed anew.

use std::ops::Range;

use crate::camera::Pose;
use crate::trajectory::profile::{Corner, Limits};

/// The times of all legs of a path, in whole nanoseconds, so that they add up to the same sum in any order.
#[derive(Clone, Debug)]
pub struct Timeline {
    limits: Limits,
    stations: Vec<Station>,
    total_ns: u64,
}

/// A waypoint with the leg that leaves it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Station {
    leg_m: f64,
    leg_limit_mps: f64,
    leg_ns: u64,
    /// The corner with the speed that it allows by itself.
    corner: Corner,
    /// The most speed that can be reached on the way here, and the speed that the rest of the way allows as well.
    reached_mps: f64,
    speed_mps: f64,
}

/// The times of a path after a change that was not made yet.
#[derive(Clone, Debug, Default)]
pub struct Retimed {
    /// The stations that are replaced, and what replaces them.
    old: Range<usize>,
    fresh: Vec<Station>,
    pub total_ns: u64,
    /// Whether the flight can begin with the speed that the drone has.
    pub keeps_entry: bool,
}

/// Which waypoints a change replaces by how many.
struct Change {
    changed: Range<usize>,
    count: usize,
    new_len: usize,
}

/// How far before a change the slowing down for it is looked for, waypoints; legs are as long as the distance of two images, so that it
/// is hardly ever more.
const RUN_UP: usize = 4;

impl Change {
    /// Waypoints of the new path whose legs or corners differ from those that they had: also the one before the change, which leaves
    /// along another leg, and the one behind it, which arrives along another one.
    fn touched(&self) -> Range<usize> {
        self.changed.start.saturating_sub(1)..(self.changed.start + self.count + 1).min(self.new_len)
    }

    /// Where a waypoint behind the change was before it; nowhere in a path that is all new.
    fn before(&self, k: usize) -> usize {
        (k + self.changed.len()).wrapping_sub(self.count)
    }
}

impl Timeline {
    pub fn new(limits: Limits, path: &[Pose]) -> Self {
        let mut timeline = Self { limits, stations: Vec::new(), total_ns: 0 };
        let mut all = Retimed::default();
        timeline.retime(&mut all, 0..0, path.len(), |k| path[k]);
        timeline.commit(&mut all);
        timeline
    }

    /// Time of the whole flight.
    pub fn total_ns(&self) -> u64 {
        self.total_ns
    }

    /// Times the path in which the waypoints `changed` are replaced by `count` others; `pose` gives the waypoints of the new path.
    pub fn retime(&self, out: &mut Retimed, changed: Range<usize>, count: usize, pose: impl Fn(usize) -> Pose) {
        let change = Change { changed, count, new_len: 0 };
        let change = Change { new_len: self.stations.len() - change.changed.len() + count, ..change };
        let mut run_up = RUN_UP;
        while !self.retime_from(out, &change, change.touched().start.saturating_sub(run_up), &pose) {
            run_up *= 4;
        }
        let removed: u64 = self.stations[out.old.clone()].iter().map(|station| station.leg_ns).sum();
        let added: u64 = out.fresh.iter().map(|station| station.leg_ns).sum();
        out.total_ns = self.total_ns + added - removed;
    }

    /// The same with the stations from `first` on; `false` when slowing down for the change begins before them.
    fn retime_from(&self, out: &mut Retimed, change: &Change, first: usize, pose: &impl Fn(usize) -> Pose) -> bool {
        let touched = change.touched();
        out.fresh.clear();
        out.fresh.extend_from_slice(&self.stations[first..touched.start]);
        self.lay_out(&mut out.fresh, change, pose);
        self.reach(&mut out.fresh, change, first);
        let end = first + out.fresh.len();
        let kept = self.slow_down(&mut out.fresh, end == change.new_len);
        out.keeps_entry = first > 0 || kept >= self.limits.entry_mps;
        // What lies before relies on this speed.
        if first > 0 && kept != self.stations[first].speed_mps {
            return false;
        }
        for k in 1..out.fresh.len() {
            let ends = [out.fresh[k - 1], out.fresh[k]].map(|at| at.corner.at_mps(at.speed_mps));
            let leg_s = self.limits.leg_s(out.fresh[k - 1].leg_m, &ends, out.fresh[k - 1].leg_limit_mps);
            out.fresh[k - 1].leg_ns = (leg_s * 1e9) as u64;
        }
        out.old = first..change.before(end);
        true
    }

    /// Legs and corners that the change touches.
    fn lay_out(&self, fresh: &mut Vec<Station>, change: &Change, pose: &impl Fn(usize) -> Pose) {
        let touched = change.touched();
        for k in touched.clone() {
            let mut station = Station::default();
            if k + 1 == touched.end {
                // The last one leaves as before.
                let before = self.stations.get(change.before(k)).copied().unwrap_or_default();
                (station.leg_m, station.leg_limit_mps, station.leg_ns) = (before.leg_m, before.leg_limit_mps, before.leg_ns);
            } else {
                let (from, to) = (pose(k), pose(k + 1));
                (station.leg_m, station.leg_limit_mps) = ((to.position - from.position).norm(), self.limits.leg_mps(&from, &to));
            }
            if let Some(arriving) = fresh.last()
                && k + 1 < change.new_len
            {
                let limit_mps = arriving.leg_limit_mps.min(station.leg_limit_mps);
                station.corner = self.limits.corner(&pose(k - 1), &pose(k), &pose(k + 1), limit_mps);
            }
            if k == 0 {
                station.corner = self.limits.entry();
            }
            fresh.push(station);
        }
    }

    /// Speeds up forwards, on into the rest of the path until that is reached as fast as before.
    fn reach(&self, fresh: &mut Vec<Station>, change: &Change, first: usize) {
        let touched = change.touched();
        for k in touched.start..change.new_len {
            let at = k - first;
            if at == fresh.len() {
                fresh.push(self.stations[change.before(k)]);
            }
            let corner_mps = fresh[at].corner.speed_mps;
            let reached_mps = match at.checked_sub(1).map(|before| &fresh[before]) {
                None => corner_mps,
                Some(from) => {
                    let ends = [&from.corner, &fresh[at].corner];
                    corner_mps.min(self.limits.reachable_mps(from.reached_mps, from.leg_m, ends))
                }
            };
            let is_as_before = k >= touched.end && reached_mps == fresh[at].reached_mps;
            fresh[at].reached_mps = reached_mps;
            if is_as_before {
                break;
            }
        }
    }

    /// Slows down backwards, from the end of the path or from a station with the speed that it had; returns the speed at the first one.
    fn slow_down(&self, fresh: &mut [Station], is_whole: bool) -> f64 {
        if let Some(last) = fresh.last_mut().filter(|_| is_whole) {
            last.speed_mps = last.reached_mps;
        }
        for at in (1..fresh.len()).rev() {
            let ends = [&fresh[at - 1].corner, &fresh[at].corner];
            let slow_mps = self.limits.reachable_mps(fresh[at].speed_mps, fresh[at - 1].leg_m, ends);
            fresh[at - 1].speed_mps = fresh[at - 1].reached_mps.min(slow_mps);
        }
        fresh.first().map_or(0.0, |station| station.speed_mps)
    }

    /// Makes the change.
    pub fn commit(&mut self, change: &mut Retimed) {
        self.stations.splice(change.old.clone(), change.fresh.drain(..));
        self.total_ns = change.total_ns;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{Rig, direction_of};
    use crate::settings::Settings;
    use crate::trajectory::profile::Profile;

    fn pose() -> impl Strategy<Value = Pose> {
        ([-60.0..60.0f64, -60.0..60.0, 10.0..40.0], 0.0..360.0f64, -80.0..20.0f64).prop_map(|(p, azimuth_deg, pitch_deg)| Pose {
            position: Point3::from(p),
            direction: Some(direction_of(azimuth_deg, pitch_deg)),
        })
    }

    proptest! {
        #[test]
        fn a_change_is_timed_as_the_whole_path_would_be(
            path in proptest::collection::vec(pose(), 2..30), stops in proptest::collection::vec(pose(), 0..5),
            from in any::<prop::sample::Index>(), count in 0usize..5, rig in 0usize..Rig::PRESETS.len(),
        ) {
            let Settings { flight, dynamics, .. } = Settings::default();
            let rig = Rig::preset(Rig::PRESETS[rig]).unwrap();
            let limits = || Limits::new(&rig, &flight, &dynamics);
            let from = from.index(path.len() + 1);
            let changed = from..(from + count).min(path.len());
            let mut new = path.clone();
            new.splice(changed.clone(), stops.iter().copied());
            prop_assume!(new.len() >= 2);

            let mut timeline = Timeline::new(limits(), &path);
            let mut change = Retimed::default();
            timeline.retime(&mut change, changed, stops.len(), |k| new[k]);
            timeline.commit(&mut change);
            let whole = Timeline::new(limits(), &new);
            prop_assert_eq!(&timeline.stations, &whole.stations);
            prop_assert_eq!(timeline.total_ns(), whole.total_ns());
            let profile_s = Profile::new(&new, &rig, &flight, &dynamics).duration_s();
            // Each leg is rounded down to whole nanoseconds.
            prop_assert!((whole.total_ns() as f64 * 1e-9 - profile_s).abs() <= 1e-9 * new.len() as f64 + 1e-9 * profile_s);
        }
    }
}
