//! A change of a flight before it is made.

use std::ops::Range;

use super::flight::Waypoint;
use crate::camera::Pose;

/// Which waypoints of a flight are replaced by which others.
#[derive(Clone, Debug, Default)]
pub struct Splice {
    pub range: Range<usize>,
    pub stops: Vec<Stop>,
}

/// A waypoint after a change.
#[derive(Clone, Copy, Debug)]
pub enum Stop {
    /// One that the flight has already within the range of the change, by its number.
    Kept(usize),
    New(Pose),
}

/// The flight as a change would make it.
pub struct Draft<'w> {
    waypoints: &'w [Waypoint],
    splice: &'w Splice,
    is_rigid: bool,
    pub count: usize,
}

impl<'w> Draft<'w> {
    pub fn new(waypoints: &'w [Waypoint], splice: &'w Splice, is_rigid: bool) -> Self {
        let count = waypoints.len() - splice.range.len() + splice.stops.len();
        Self { waypoints, splice, is_rigid, count }
    }

    /// Where waypoint `k` comes from.
    pub fn stop(&self, k: usize) -> Stop {
        let Range { start, end } = self.splice.range;
        match k.checked_sub(start) {
            None => Stop::Kept(k),
            Some(inside) if inside < self.splice.stops.len() => self.splice.stops[inside],
            Some(inside) => Stop::Kept(end + inside - self.splice.stops.len()),
        }
    }

    pub fn pose(&self, k: usize) -> Pose {
        match self.stop(k) {
            Stop::Kept(old) => self.waypoints[old].pose,
            Stop::New(pose) => pose,
        }
    }

    /// The waypoints whose leaving legs the change may replace: those of the change and the one before.
    pub fn touched(&self) -> Range<usize> {
        self.splice.range.start.saturating_sub(1)..self.splice.range.start + self.splice.stops.len()
    }

    /// The legs that the change makes, by the waypoints that they leave.
    pub fn legs(&self) -> Range<usize> {
        let Range { start, end } = self.touched();
        start..end.min(self.count - 1)
    }

    /// The old leg that sees the same as leg `k`; where cameras are bolted on, that depends on the sense in which it is flown.
    pub fn same_leg(&self, k: usize) -> Option<usize> {
        match (self.stop(k), self.stop(k + 1)) {
            (Stop::Kept(a), Stop::Kept(b)) if b == a + 1 => Some(a),
            (Stop::Kept(a), Stop::Kept(b)) if a == b + 1 && !self.is_rigid => Some(b),
            _ => None,
        }
    }

    /// The legs that are really new.
    pub fn new_legs(&self) -> impl Iterator<Item = usize> + '_ {
        self.legs().filter(|&k| self.same_leg(k).is_none())
    }

    /// The waypoints and the legs that the change does away with.
    pub fn dropped(&self) -> (Vec<usize>, Vec<usize>) {
        let Range { start, end } = self.splice.range;
        let first = start.saturating_sub(1);
        // Whether the waypoint and the leg that leaves it stay, from the first one on that the change touches.
        let mut stays = vec![[false; 2]; end - first];
        for stop in &self.splice.stops {
            if let Stop::Kept(old) = stop {
                stays[old - first][0] = true;
            }
        }
        self.legs().filter_map(|k| self.same_leg(k)).for_each(|old| stays[old - first][1] = true);
        let legs = first..end.min(self.waypoints.len() - 1);
        ((start..end).filter(|&old| !stays[old - first][0]).collect(), legs.filter(|&old| !stays[old - first][1]).collect())
    }
}
