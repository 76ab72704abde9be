//! What is known to be safe of a flight, so that after an edit only what is new of it is looked at in the whole scene: the rest was safe before, and
//! is safe still unless it comes too near to what was not there, enters a zone or leaves the limits. What results equals a look at everything.

use std::collections::HashMap;

use nalgebra::Point3;

use super::curve::{Arc, Curve};
use crate::field::Snapshot;
use crate::scene::free_space::FreeSpace;

/// A flight that was found safe.
#[derive(Clone, Debug)]
pub struct SafeFlight {
    pub curve: Curve,
    /// How far each arc may pass from its corner, m.
    pub deviations_m: Vec<f64>,
    /// Its first legs have rules of their own, and nothing is known of them.
    pub egress_legs: usize,
    pub safety_distance_m: f64,
}

/// A flight that was safe in the revision before, and what has come since.
#[derive(Debug)]
pub struct Known {
    flight: SafeFlight,
    /// Places of the waypoints, to the last bit.
    places: HashMap<[u64; 3], usize>,
    /// The limits and zones as they are, and only the structures that were not there.
    newcomers: FreeSpace,
}

impl Known {
    /// `None` where the snapshot does not say how it differs from the revision before, which the flight was safe in.
    pub fn new(flight: SafeFlight, snapshot: &Snapshot) -> Option<Self> {
        let changes = snapshot.changes()?;
        let is_as_strict = flight.safety_distance_m == snapshot.free.safety_distance_m;
        let places = flight.curve.waypoints.iter().enumerate().map(|(index, p)| (key(p), index)).collect();
        is_as_strict.then(|| Self { newcomers: snapshot.free.only_new(&changes.differences), places, flight })
    }

    /// Where a position has to be looked at: among the newcomers if it was a waypoint, else in the whole of `free`.
    pub fn at<'f>(&'f self, free: &'f FreeSpace, p: &Point3<f64>) -> &'f FreeSpace {
        self.chosen(free, self.place(p).is_some())
    }

    /// Where the leg between two waypoints has to be looked at.
    pub fn along<'f>(&'f self, free: &'f FreeSpace, from: &Point3<f64>, to: &Point3<f64>) -> &'f FreeSpace {
        self.chosen(free, self.leg(from, to).is_some())
    }

    /// Where the straight part of leg `leg` of a curve has to be looked at.
    pub fn along_straight<'f>(&'f self, free: &'f FreeSpace, curve: &Curve, leg: usize) -> &'f FreeSpace {
        let before = self.leg(&curve.waypoints[leg], &curve.waypoints[leg + 1]);
        self.chosen(free, before.is_some_and(|before| self.flight.curve.straight(before) == curve.straight(leg)))
    }

    /// Where an arc has to be looked at.
    pub fn on_arc<'f>(&'f self, free: &'f FreeSpace, arc: &Arc) -> &'f FreeSpace {
        self.chosen(free, self.place(&arc.corner).is_some_and(|place| self.flight.curve.arcs[place] == *arc))
    }

    /// How far the arc at a corner passed from it, m, where both its legs are as they were.
    pub fn deviation_m(&self, before: &Point3<f64>, corner: &Point3<f64>, after: &Point3<f64>) -> Option<f64> {
        let ahead = self.leg(before, corner)?;
        let behind = self.leg(corner, after)?;
        (ahead + 1 == behind).then(|| self.flight.deviations_m[behind])
    }

    pub fn newcomers(&self) -> &FreeSpace {
        &self.newcomers
    }

    fn place(&self, p: &Point3<f64>) -> Option<usize> {
        self.places.get(&key(p)).copied().filter(|&place| place >= self.flight.egress_legs)
    }

    fn leg(&self, from: &Point3<f64>, to: &Point3<f64>) -> Option<usize> {
        let (from, to) = (self.place(from)?, self.place(to)?);
        (from + 1 == to).then_some(from)
    }

    fn chosen<'f>(&'f self, free: &'f FreeSpace, is_known: bool) -> &'f FreeSpace {
        if is_known { &self.newcomers } else { free }
    }
}

fn key(p: &Point3<f64>) -> [u64; 3] {
    p.coords.map(f64::to_bits).into()
}
