//! The parts of a flight that are changed at the same time, each by a worker on a copy of its own.

use std::ops::Range;

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::flight::{Flight, Journal};
use super::focus::Focus;
use super::ground::Ground;
use super::moves::uniform;

/// Waypoints that a worker may change: all but some at the beginning and some at the end.
#[derive(Clone, Copy, Debug)]
pub struct Sector<'f> {
    pub head: usize,
    pub tail: usize,
    /// Where most changes are tried.
    pub focus: Option<&'f Focus>,
}

impl Sector<'_> {
    /// The waypoints of the sector in a flight of so many.
    pub fn of(&self, waypoints: usize) -> Range<usize> {
        self.head..waypoints - self.tail
    }
}

/// A sector has at least so many waypoints that may be changed.
const LEAST_SECTOR: usize = 8;

/// The flight in parts, the border between two of them elsewhere in every round.
pub fn of<'f>(ground: &Ground, flight: &Flight, focus: Option<&'f Focus>, random: &mut ChaCha8Rng) -> Vec<Sector<'f>> {
    let [first, last] = ground.fixed;
    let waypoints = &flight.waypoints;
    let count = waypoints.len();
    // As many that may be changed in each.
    let places: Vec<usize> = match focus {
        None => (0..count).collect(),
        Some(focus) => (first + 1..count - last).filter(|&k| focus.contains(&waypoints[k].pose.position)).collect(),
    };
    let sectors = (ground.settings.sectors as usize).min(places.len() / LEAST_SECTOR).max(1);
    let shift = if sectors == 1 { 0.0 } else { uniform(random) - 0.5 };
    // The waypoint at a border belongs to no sector.
    let border = |k: usize| places[((k as f64 + shift) * places.len() as f64 / sectors as f64) as usize];
    let head = |k: usize| if k == 0 { first } else { border(k) + 1 };
    let tail = |k: usize| if k + 1 == sectors { last } else { count - border(k + 1) };
    (0..sectors).map(|k| Sector { head: head(k), tail: tail(k), focus }).collect()
}

/// Makes all copies the flight whose sectors are those of the workers.
pub fn join(ground: &Ground, flights: &mut [&mut Flight], sectors: &[Sector]) {
    let journals: Vec<Journal> = flights.iter_mut().map(|flight| flight.take_journal()).collect();
    if sectors.len() == 1 {
        return;
    }
    let mut waypoints = Vec::new();
    for (k, (flight, sector)) in flights.iter().zip(sectors).enumerate() {
        // The waypoint before a sector leaves along the sector's first leg.
        let from = if k == 0 { 0 } else { sector.head - 1 };
        let to = if k + 1 == sectors.len() { flight.waypoints.len() } else { flight.waypoints.len() - sector.tail };
        waypoints.extend(flight.waypoints[from.min(to)..to].iter().cloned());
    }
    flights.par_iter_mut().enumerate().for_each(|(own, flight)| {
        let others = journals.iter().enumerate().filter(|&(worker, _)| worker != own);
        others.for_each(|(_, journal)| flight.follow(journal));
        flight.arrange(ground, waypoints.clone());
    });
}
