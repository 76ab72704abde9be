//! The beginning of a flight by an aircraft that is in the air already, and where it must not be: what has just been found there was not known before.
//!
//! Such a flight cannot be safe from its first metre on. Two legs may stand before all others, both flown to rest, and only they are not held to the
//! rules of the rest, but to rules of their own:
//!
//! - Braking goes straight on for no longer than it takes, and passes no surface. It may come too near to something: whatever else the aircraft
//!   did, it would be as near at first.
//! - The way out is straight and ends at a safe place. On it the aircraft never comes nearer to anything that is nearer than the safety distance:
//!   neither to a surface nor to the ground, and inside of a structure, which then cannot be as solid there as the scene has it, never farther in. It
//!   passes no other surface, and once it has left a no-fly zone, or come within the limits of the flight, it stays so.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::limits::Limits;
use super::safety::UnsafeCurve;
use crate::scene::free_space::FreeSpace;

/// Which of the two legs a flight begins with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Egress {
    pub brakes: bool,
    pub escapes: bool,
}

/// The way out is looked at in steps of this length, m; a quick look first takes longer ones.
const STEP_M: f64 = 0.05;
const LONG_STEP_M: f64 = 1.0;
/// Distances are compared to within rounding, m.
const TOLERANCE_M: f64 = 1e-9;
/// Farther than any place inside of a structure is from its surface, m.
const DEEPEST_M: f64 = 1e5;

impl Egress {
    /// How many legs they are.
    pub fn legs(&self) -> usize {
        usize::from(self.brakes) + usize::from(self.escapes)
    }

    /// Holds the legs at the beginning of a path to their rules.
    pub fn check(&self, waypoints: &[Point3<f64>], limits: &Limits, free: &FreeSpace) -> Result<(), UnsafeCurve> {
        let mut legs = waypoints.windows(2).enumerate();
        let mut next = |is_kept: &dyn Fn(&Point3<f64>, &Point3<f64>) -> bool| match legs.next() {
            Some((_, ends)) if is_kept(&ends[0], &ends[1]) => Ok(()),
            leg => Err(UnsafeCurve::Egress { leg: leg.map_or(0, |(leg, _)| leg) }),
        };
        if self.brakes {
            next(&|from, to| {
                (to - from).norm() <= limits.braking_m(limits.entry_mps) + TOLERANCE_M && can_brake(free, from, to)
            })?;
        }
        if self.escapes {
            next(&|from, to| leads_out(free, from, to))?;
        }
        Ok(())
    }
}

/// Whether braking from one place to another passes neither a surface nor the ground.
pub fn can_brake(free: &FreeSpace, from: &Point3<f64>, to: &Point3<f64>) -> bool {
    to.z > 0.0 && !free.clearance.occluded(from, to)
}

/// Whether the straight way from a place where the aircraft must not be leads out to a safe one.
pub fn leads_out(free: &FreeSpace, from: &Point3<f64>, to: &Point3<f64>) -> bool {
    free.is_safe(to) && is_ever_farther(free, from, to, LONG_STEP_M) && is_ever_farther(free, from, to, STEP_M)
}

fn is_ever_farther(free: &FreeSpace, from: &Point3<f64>, to: &Point3<f64>, step_m: f64) -> bool {
    let way: Vector3<f64> = to - from;
    let steps = (way.norm() / step_m).ceil().max(1.0) as u32;
    let keeps_rules = |a: &Point3<f64>, b: &Point3<f64>| free.limits.contains(b) && free.zone_between(a, b).is_none();
    let (mut before, mut margin_m, mut is_out) = (*from, margin_m(free, from), keeps_rules(from, from));
    // Where the way leaves the structure that it begins in.
    let mut open = (margin_m >= 0.0).then_some(*from);
    for k in 1..=steps {
        let here = from + way * (f64::from(k) / f64::from(steps));
        let now_m = self::margin_m(free, &here);
        let keeps = keeps_rules(&before, &here);
        if now_m < margin_m - TOLERANCE_M || is_out && !keeps {
            return false;
        }
        open = open.or((now_m >= 0.0).then_some(here));
        (before, margin_m, is_out) = (here, now_m, keeps_rules(&here, &here));
    }
    // What is thinner than a step has been missed so far.
    is_out && open.is_some_and(|open| !free.clearance.occluded(&open, to))
}

/// How far a place is from surfaces and the ground, m, up to the safety distance; below nothing inside of a structure.
pub fn margin_m(free: &FreeSpace, p: &Point3<f64>) -> f64 {
    if free.structure_around(p).is_some() {
        return -free.clearance.point_distance_m(p, DEEPEST_M);
    }
    free.clearance.point_distance_m(p, free.safety_distance_m).min(p.z)
}
