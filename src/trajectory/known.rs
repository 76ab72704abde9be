//! What is known to be safe of a flight, so that after an edit only what is new of it is looked at in the whole scene: the rest was safe before, and
//! is safe still unless it comes too near to what was not there, enters a zone or leaves the limits. What results equals a look at everything.

use std::collections::HashMap;
use std::sync::{self, Weak};

use nalgebra::Point3;

use super::curve::{Arc, Curve};
use super::egress::Egress;
use super::images::Exposed;
use super::limits::Limits;
use super::profile::Profile;
use super::route::Route;
use crate::camera::Rig;
use crate::scene::free_space::FreeSpace;

/// A flight that was found safe, as it is flown, and all that is known of it but what it captures.
#[derive(Clone, Debug)]
pub struct SafeFlight {
    pub rig: Rig,
    pub route: Route,
    pub limits: Limits,
    /// How far each arc may pass from its corner, m.
    pub deviations_m: Vec<f64>,
    pub profile: Profile,
    pub exposed: Exposed,
    /// Its first legs may have rules of their own, and nothing is known of them.
    pub egress: Egress,
    /// Smallest distance of the curve to a structure or the ground, m.
    pub clearance_m: f64,
    /// The most that the flight smears an image, px.
    pub blur_px: f64,
    /// The space that it is safe in, and the revision of the scene that this belongs to.
    pub space: Weak<FreeSpace>,
    pub revision: u64,
    pub safety_distance_m: f64,
}

/// A flight that was safe in an earlier space, and what has come since.
#[derive(Debug)]
pub struct Known {
    flight: sync::Arc<SafeFlight>,
    /// Places of the waypoints, to the last bit.
    places: HashMap<[u64; 3], usize>,
    /// The limits and zones as they are, and only the structures that were not there.
    newcomers: FreeSpace,
}

/// Where the parts of a flight have to be looked at to know that they are safe: what is known among the newcomers, all else everywhere.
#[derive(Clone, Copy, Debug)]
pub struct Scope<'s> {
    free: &'s FreeSpace,
    known: Option<&'s Known>,
}

impl SafeFlight {
    fn curve(&self) -> &Curve {
        self.profile.curve()
    }

    /// Whether it is this very space that it is safe in.
    pub fn is_safe_in(&self, free: &sync::Arc<FreeSpace>) -> bool {
        self.space.ptr_eq(&sync::Arc::downgrade(free))
    }
}

impl Known {
    /// `newcomers` has the limits and zones as they are, and of the structures those that did not stand in the space that the flight is safe in. `None`
    /// where another distance was kept there.
    pub fn new(flight: sync::Arc<SafeFlight>, newcomers: FreeSpace) -> Option<Self> {
        let is_as_strict = flight.safety_distance_m == newcomers.safety_distance_m;
        let places = flight.curve().waypoints.iter().enumerate().map(|(index, p)| (key(p), index)).collect();
        is_as_strict.then_some(Self { newcomers, places, flight })
    }

    /// The flight itself, if it is this one in this very space: so it need not be looked at again.
    pub fn flight(
        &self,
        rig: &Rig,
        route: &Route,
        limits: &Limits,
        egress: Egress,
        free: &sync::Arc<FreeSpace>,
    ) -> Option<&sync::Arc<SafeFlight>> {
        let flight = &self.flight;
        let is_same = flight.is_safe_in(free) && flight.egress == egress && flight.limits == *limits && flight.rig == *rig;
        (is_same && flight.route == *route).then_some(flight)
    }

    fn place(&self, p: &Point3<f64>) -> Option<usize> {
        self.places.get(&key(p)).copied().filter(|&place| place >= self.flight.egress.legs())
    }

    /// The leg between two waypoints that follow each other.
    fn leg(&self, from: &Point3<f64>, to: &Point3<f64>) -> Option<usize> {
        let (from, to) = (self.place(from)?, self.place(to)?);
        (from + 1 == to).then_some(from)
    }
}

impl<'s> Scope<'s> {
    /// Nothing is known.
    pub fn everywhere(free: &'s FreeSpace) -> Self {
        Self { free, known: None }
    }

    pub fn after(free: &'s FreeSpace, known: Option<&'s Known>) -> Self {
        Self { free, known }
    }

    /// All that is free.
    pub fn free(&self) -> &'s FreeSpace {
        self.free
    }

    /// For a waypoint.
    pub fn at(&self, p: &Point3<f64>) -> &'s FreeSpace {
        self.where_known(|known| known.place(p).is_some())
    }

    /// For the leg between two waypoints.
    pub fn along(&self, from: &Point3<f64>, to: &Point3<f64>) -> &'s FreeSpace {
        self.where_known(|known| known.leg(from, to).is_some())
    }

    /// For the straight part of a leg of a curve.
    pub fn along_straight(&self, curve: &Curve, leg: usize) -> &'s FreeSpace {
        self.where_known(|known| {
            let before = known.leg(&curve.waypoints[leg], &curve.waypoints[leg + 1]);
            before.is_some_and(|before| known.flight.curve().straight(before) == curve.straight(leg))
        })
    }

    /// For an arc.
    pub fn on_arc(&self, arc: &Arc) -> &'s FreeSpace {
        self.where_known(|known| known.place(&arc.corner).is_some_and(|place| known.flight.curve().arcs[place] == *arc))
    }

    /// For an arc that passes so far from the corner between two waypoints, m.
    pub fn round_corner(&self, [before, corner, after]: [&Point3<f64>; 3], deviation_m: f64) -> &'s FreeSpace {
        self.where_known(|known| {
            let legs = known.leg(before, corner).zip(known.leg(corner, after));
            legs.is_some_and(|(_, behind)| known.flight.deviations_m[behind] == deviation_m)
        })
    }

    fn where_known(&self, is_known: impl Fn(&Known) -> bool) -> &'s FreeSpace {
        self.known.filter(|known| is_known(known)).map_or(self.free, |known| &known.newcomers)
    }
}

fn key(p: &Point3<f64>) -> [u64; 3] {
    p.coords.map(f64::to_bits).into()
}
