//! What flying between views costs: known by and by, as legs are checked and detours found.

use nalgebra::Point3;

use super::proximity;

/// What flying between places costs, mm: known for near pairs, estimated for others.
#[derive(Clone, Debug)]
pub struct Costs {
    places: Vec<Point3<f64>>,
    /// Known costs, by place, in ascending order of the other place.
    known: Vec<Vec<(u32, u64)>>,
    /// Near places by distance.
    near: Vec<Vec<u32>>,
}

/// No way at all, mm: more than any path is long, and few enough to be added up.
pub const NO_WAY_MM: u64 = 1 << 40;

/// Neighbours that moves look at.
const NEIGHBOURS: usize = 12;

impl Costs {
    pub fn new(places: Vec<Point3<f64>>) -> Self {
        let near = |p: &Point3<f64>| proximity::nearest(&places, p, NEIGHBOURS + 1);
        let near = places.iter().enumerate().map(|(a, p)| near(p).into_iter().filter(|&b| b as usize != a).collect()).collect();
        Self { known: vec![Vec::new(); places.len()], near, places }
    }

    /// Number of places.
    pub fn count(&self) -> u32 {
        self.places.len() as u32
    }

    /// Near places of each place, nearest first.
    pub fn near(&self, a: u32) -> &[u32] {
        &self.near[a as usize]
    }

    /// States what a pair costs.
    pub fn set(&mut self, a: u32, b: u32, cost_mm: u64) {
        for (a, b) in [(a, b), (b, a)] {
            let row = &mut self.known[a as usize];
            match row.binary_search_by_key(&b, |entry| entry.0) {
                Ok(place) => row[place].1 = cost_mm,
                Err(place) => row.insert(place, (b, cost_mm)),
            }
        }
    }

    /// What is known of a pair.
    pub fn known_mm(&self, a: u32, b: u32) -> Option<u64> {
        let row = &self.known[a as usize];
        row.binary_search_by_key(&b, |entry| entry.0).ok().map(|place| row[place].1)
    }

    /// Straight distance, mm.
    pub fn straight_mm(&self, a: u32, b: u32) -> u64 {
        ((self.places[a as usize] - self.places[b as usize]).norm() * 1000.0).round() as u64
    }

    /// Cost of a pair; a pair of which nothing is known is taken to need some way round.
    pub fn cost_mm(&self, a: u32, b: u32) -> u64 {
        self.known_mm(a, b).unwrap_or_else(|| self.detour_mm(a, b))
    }

    /// What a detour may cost: an estimate from below in most streets.
    pub fn detour_mm(&self, a: u32, b: u32) -> u64 {
        self.straight_mm(a, b) * 6 / 5 + 10_000
    }

    /// Cost of a path.
    pub fn length_mm(&self, order: &[u32]) -> u64 {
        order.windows(2).map(|leg| self.cost_mm(leg[0], leg[1])).sum()
    }
}
