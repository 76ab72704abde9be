//! The shortest safe way between two positions that see no straight one: A* over a roadmap, then straightened.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::Point3;

use super::proximity::{self, Neighbours};
use crate::scene::free_space::FreeSpace;

/// A graph of safe positions; its legs are found and checked when they are first looked at, because a short way passes few of them.
#[derive(Debug)]
pub struct Router<'a> {
    free: &'a FreeSpace,
    nodes: Vec<Point3<f64>>,
    neighbours: Neighbours,
    legs: Vec<Option<Vec<Leg>>>,
}

/// From a node to a near one.
#[derive(Clone, Copy, Debug)]
struct Leg {
    to: u32,
    /// Whether it is safe, where that is known.
    is_safe: Option<bool>,
}

/// How many of the nearest nodes are tried to join a position with the graph, and how many joins are made.
const TRIED: usize = 200;
const JOINED: usize = 8;

impl<'a> Router<'a> {
    /// Legs join nodes up to `reach_m` apart. The nodes are safe positions.
    pub fn new(free: &'a FreeSpace, nodes: Vec<Point3<f64>>, reach_m: f64) -> Self {
        Self { free, neighbours: Neighbours::new(&nodes, reach_m), legs: vec![None; nodes.len()], nodes }
    }

    /// The corners between `a` and `b`, none when the straight leg is safe; `None` when there is no way. Both are safe positions.
    pub fn detour(&mut self, a: &Point3<f64>, b: &Point3<f64>) -> Option<Vec<Point3<f64>>> {
        if self.free.is_leg_safe(a, b) {
            return Some(Vec::new());
        }
        let way = self.way(a, b)?;
        let corners: Vec<Point3<f64>> = way.into_iter().map(|node| self.nodes[node]).collect();
        Some(self.straightened(a, b, &corners))
    }

    /// Nodes of the shortest way over the graph.
    fn way(&mut self, a: &Point3<f64>, b: &Point3<f64>) -> Option<Vec<usize>> {
        let (starts, ends) = (self.joins(a), self.joins(b));
        if starts.is_empty() || ends.is_empty() {
            return None;
        }
        let mut flown_m = vec![f64::INFINITY; self.nodes.len()];
        let mut came_from = vec![usize::MAX; self.nodes.len()];
        let mut is_done = vec![false; self.nodes.len()];
        // Lengths are not negative, so their bits are in the order of their values.
        let mut queue = BinaryHeap::new();
        for node in starts {
            flown_m[node] = (self.nodes[node] - a).norm();
            queue.push(Reverse(((flown_m[node] + (self.nodes[node] - b).norm()).to_bits(), node)));
        }
        let mut best = (f64::INFINITY, usize::MAX);
        while let Some(Reverse((bound, node))) = queue.pop() {
            if f64::from_bits(bound) >= best.0 {
                break;
            }
            if std::mem::replace(&mut is_done[node], true) {
                continue;
            }
            if ends.contains(&node) {
                let whole_m = flown_m[node] + (self.nodes[node] - b).norm();
                if whole_m < best.0 {
                    best = (whole_m, node);
                }
            }
            for place in 0..self.legs_from(node).len() {
                let next = self.legs_from(node)[place].to as usize;
                let longer_m = flown_m[node] + (self.nodes[next] - self.nodes[node]).norm();
                if longer_m < flown_m[next] && self.is_leg_safe(node, place) {
                    (flown_m[next], came_from[next]) = (longer_m, node);
                    queue.push(Reverse(((longer_m + (self.nodes[next] - b).norm()).to_bits(), next)));
                }
            }
        }
        (best.1 != usize::MAX).then(|| {
            let before = |node: &usize| Some(came_from[*node]).filter(|&node| node != usize::MAX);
            let mut way: Vec<usize> = std::iter::successors(Some(best.1), before).collect();
            way.reverse();
            way
        })
    }

    /// Near nodes to which a straight leg is safe.
    fn joins(&self, p: &Point3<f64>) -> Vec<usize> {
        let nearest = proximity::nearest(&self.nodes, p, TRIED).into_iter().map(|node| node as usize);
        nearest.filter(|&node| self.free.is_leg_safe(p, &self.nodes[node])).take(JOINED).collect()
    }

    fn is_leg_safe(&mut self, node: usize, place: usize) -> bool {
        let Leg { to, is_safe } = self.legs_from(node)[place];
        if let Some(known) = is_safe {
            return known;
        }
        let next = to as usize;
        // Both ways count the same, so that an answer does not depend on which one was asked for first.
        let (low, high) = (node.min(next), node.max(next));
        let is_safe = self.free.is_leg_safe(&self.nodes[low], &self.nodes[high]);
        self.legs_from(node)[place].is_safe = Some(is_safe);
        is_safe
    }

    fn legs_from(&mut self, node: usize) -> &mut [Leg] {
        let (nodes, neighbours) = (&self.nodes, &self.neighbours);
        let find = || neighbours.of(nodes, node).into_iter().map(|to| Leg { to, is_safe: None }).collect();
        self.legs[node].get_or_insert_with(find)
    }

    /// Leaves out corners: from each on to the farthest one that a safe leg reaches.
    fn straightened(&self, a: &Point3<f64>, b: &Point3<f64>, corners: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let all: Vec<Point3<f64>> = std::iter::once(*a).chain(corners.iter().copied()).chain([*b]).collect();
        let mut kept = Vec::new();
        let mut at = 0;
        while at + 1 < all.len() {
            let onward = (at + 2..all.len()).rev().find(|&next| self.free.is_leg_safe(&all[at], &all[next]));
            at = onward.unwrap_or(at + 1);
            if at + 1 < all.len() {
                kept.push(all[at]);
            }
        }
        kept
    }
}

/// Length of the way from `a` over the corners to `b`, m.
pub fn length_m(a: &Point3<f64>, corners: &[Point3<f64>], b: &Point3<f64>) -> f64 {
    let (mut at, mut flown_m) = (a, 0.0);
    for next in corners.iter().chain([b]) {
        flown_m += (next - at).norm();
        at = next;
    }
    flown_m
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::field::{Lattice, fill};
    use crate::scene::{BlockSettings, generate_block};
    use crate::settings::Settings;
    use crate::stop::StopToken;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4))]
        #[test]
        fn every_leg_of_a_detour_is_safe_and_none_is_shorter_than_the_straight_one(seed in 0u64..50) {
            let block = BlockSettings { seed, extent_m: [110.0, 110.0], buildings: 9, ..Default::default() };
            let scene = generate_block(&block);
            let free = FreeSpace::new(&scene, &Settings::default().flight).expect("there are no zones");
            let lattice = Lattice { origin: free.limits.min, spacing_m: 9.0, shell_m: 25.0, seed };
            let nodes: Vec<Point3<f64>> = fill(&free, &lattice, &StopToken::default()).expect("nobody stops it").sites().map(|site| site.viewpoint.position).collect();
            let mut router = Router::new(&free, nodes.clone(), 18.0);
            let mut detours = 0;
            for k in 0..40 {
                let (a, b) = (nodes[k * 37 % nodes.len()], nodes[(k * 101 + 11) % nodes.len()]);
                let corners = router.detour(&a, &b).expect("an open block is connected");
                let all: Vec<Point3<f64>> = std::iter::once(a).chain(corners.iter().copied()).chain([b]).collect();
                for leg in all.windows(2) {
                    prop_assert!(free.obstruction_at(&leg[1]).is_none());
                    prop_assert!(free.obstruction_between(&leg[0], &leg[1]).is_none());
                }
                prop_assert!(length_m(&a, &corners, &b) >= (b - a).norm() - 1e-9);
                prop_assert_eq!(corners.is_empty(), free.is_leg_safe(&a, &b));
                detours += usize::from(!corners.is_empty());
            }
            prop_assert!(detours > 0, "a block without a single blocked pair proves nothing");
        }
    }
}
