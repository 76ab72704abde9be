//! Which part of a flight each battery flies.

use nalgebra::Point3;

use super::detour::Ways;
use super::legs::Legs;
use super::{CourseError, CourseOptions, transit};
use crate::scene::free_space::{FreeSpace, Obstruction};
use crate::trajectory::limits::Limits;

/// Vertical speeds that the ways out and home are timed with: those that ArduPilot has by default, slower than PX4's and DJI's.
const CLIMB_MPS: f64 = 2.5;
const SINK_MPS: f64 = 1.5;
/// A flight in more sorties is a mistake.
pub const MOST_SORTIES: usize = 100;

/// How each waypoint is reached from the take-off place, and left for it.
pub struct Reach {
    out_s: Vec<f64>,
    home_s: Vec<f64>,
    /// Corners at the height of transit, from the one behind the take-off place to the place above the waypoint; or what is in the way.
    ways: Vec<Result<Vec<Point3<f64>>, Barred>>,
    /// Time that coming to rest, or starting from it, takes longer than passing, at most, s.
    stop_s: f64,
}

/// What is in the way between the take-off place and a waypoint.
struct Barred {
    obstruction: Obstruction,
    /// In the climb above the waypoint, which no other take-off place changes.
    is_above: bool,
}

impl Reach {
    pub fn new(
        legs: &Legs,
        limits: &Limits,
        home_m: &Point3<f64>,
        ways: &Ways,
        free: Option<&FreeSpace>,
        transit_z_m: f64,
    ) -> Self {
        let dynamics = &limits.dynamics;
        let stop_s = (limits.cruise_mps / dynamics.acceleration_mps2 + dynamics.acceleration_mps2 / dynamics.jerk_mps3) / 2.0;
        let points = legs.points();
        let way = |p: &Point3<f64>| {
            let above = Point3::new(p.x, p.y, transit_z_m);
            if let Some(obstruction) = free.and_then(|free| transit::obstruction(free, p, &above)) {
                return Err(Barred { obstruction, is_above: true });
            }
            let corners = ways.to(&above).map_err(|obstruction| Barred { obstruction, is_above: false })?;
            Ok(corners.into_iter().chain([above]).collect::<Vec<_>>())
        };
        let ways: Vec<Result<Vec<Point3<f64>>, Barred>> = points.iter().map(way).collect();
        let way_s = |(p, way): (&Point3<f64>, &Result<Vec<Point3<f64>>, Barred>), home_mps: f64, own_mps: f64| {
            // It comes to rest at each corner.
            let corners = way.as_deref().unwrap_or(&[]);
            let starts = std::iter::once(home_m).chain(corners);
            let level_m: f64 = starts.zip(corners).map(|(from, to)| (to.xy() - from.xy()).norm()).sum();
            let stops_s = (1 + corners.len()) as f64 * stop_s;
            (transit_z_m - home_m.z) / home_mps + level_m / limits.cruise_mps + stops_s + (transit_z_m - p.z) / own_mps
        };
        Self {
            out_s: points.iter().zip(&ways).map(|pair| way_s(pair, CLIMB_MPS, SINK_MPS)).collect(),
            home_s: points.iter().zip(&ways).map(|pair| way_s(pair, SINK_MPS, CLIMB_MPS)).collect(),
            ways,
            stop_s,
        }
    }

    /// Corners of the way from the take-off place to above a waypoint; none where it is barred.
    pub fn way(&self, k: usize) -> &[Point3<f64>] {
        self.ways[k].as_deref().unwrap_or(&[])
    }

    /// An autopilot's own return knows nothing of detours.
    pub fn note(&self, notes: &mut Vec<String>) {
        let leads_around = |way: &&Result<Vec<Point3<f64>>, Barred>| match way {
            Ok(corners) => corners.len() > 1,
            Err(barred) => matches!(barred.obstruction, Obstruction::Zone(_)),
        };
        let around = self.ways.iter().filter(leads_around).count();
        if around > 0 {
            notes.push(format!(
                "from {around} of {} waypoints the straight way home leads through a no-fly zone or along its border: the mission goes around, \
                 but an autopilot that returns by itself (battery, lost link) flies straight; take off elsewhere (`--home`) where that must not be",
                self.ways.len()
            ));
        }
    }

    /// A sortie from take-off to landing, s.
    pub fn duration_s(&self, legs: &Legs, from: usize, to: usize) -> f64 {
        self.out_s[from] + legs.arrivals_s[to] - legs.arrivals_s[from] + 2.0 * self.stop_s + self.home_s[to]
    }

    fn check(&self, legs: &Legs, k: usize) -> Result<(), CourseError> {
        let Err(Barred { obstruction, is_above }) = &self.ways[k] else { return Ok(()) };
        let waypoint = legs.kept[k];
        let (what, remedy) = if *is_above {
            (format!("the climb above waypoint {waypoint}"), "plan the flight so that it begins and ends under the open sky")
        } else {
            (format!("the way between the take-off place and waypoint {waypoint}"), "take off elsewhere, with `--home LAT,LON`")
        };
        Err(CourseError::Obstructed { what, obstruction: obstruction.clone(), remedy })
    }
}

/// How long a sortie may last.
pub struct Times {
    most_s: Option<f64>,
    /// What the flight draws from a battery each second.
    pub percent_a_second: Option<f64>,
}

impl Times {
    /// Without a battery and without a time all is one sortie.
    pub fn new(legs: &Legs, battery_percent: Option<f64>, options: &CourseOptions, notes: &mut Vec<String>) -> Self {
        let duration_s = legs.arrivals_s.last().copied().unwrap_or(0.0);
        let percent_a_second = battery_percent.filter(|_| duration_s > 0.0).map(|percent| percent / duration_s);
        let by_battery_s = percent_a_second.map(|percent| (100.0 - options.reserve_percent).max(0.0) / percent);
        let most_s = options.sortie_s.or(by_battery_s);
        if most_s.is_none() {
            let remedy = "give the time of one with `--sortie-time`";
            notes.push(format!("the plan's rig has no battery, so that the flight is not divided into sorties; {remedy}"));
        }
        Self { most_s, percent_a_second }
    }
}

/// The first and the last waypoint of each sortie. Each goes as far as it can and ends where the way home is free; a flight that goes on in
/// the air needs no way out to where it begins.
pub fn split(legs: &Legs, reach: &Reach, times: &Times, in_flight: bool) -> Result<Vec<(usize, usize)>, CourseError> {
    let last = legs.path.len() - 1;
    if !in_flight {
        reach.check(legs, 0)?;
    }
    reach.check(legs, last)?;
    let Some(most_s) = times.most_s else { return Ok(vec![(0, last)]) };
    let mut parts = Vec::new();
    let mut from = 0;
    while from < last {
        if parts.len() == MOST_SORTIES {
            return Err(CourseError::TooManySorties { most: MOST_SORTIES });
        }
        let mut farthest = None;
        let mut shortest_s = f64::INFINITY;
        for to in from + 1..=last {
            if legs.arrivals_s[to] - legs.arrivals_s[from] > most_s && shortest_s.is_finite() {
                break;
            }
            if reach.ways[to].is_err() {
                continue;
            }
            let duration_s = reach.duration_s(legs, from, to);
            shortest_s = shortest_s.min(duration_s);
            if duration_s <= most_s {
                farthest = Some(to);
            }
        }
        let needs = CourseError::SortieTooShort { from: legs.kept[from], needs_s: shortest_s, has_s: most_s };
        let to = farthest.ok_or(needs)?;
        parts.push((from, to));
        from = to;
    }
    Ok(parts)
}
