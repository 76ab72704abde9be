//! The random tree: nodes in an arena, each with the sums and the coverage of its path from the root.

use std::collections::HashMap;

use super::objective::PathSums;
use super::problem::{Problem, Scratch};
use crate::camera::Pose;
use crate::coverage::Mask;
use crate::coverage::union::{Gained, Observations};

/// A candidate waypoint.
#[derive(Clone, Debug)]
pub struct Node {
    pub pose: Pose,
    pub parent: Option<usize>,
    pub children: Vec<usize>,
    pub sums: PathSums,
    /// E of the path from the root (Eq. 6).
    pub objective: f64,
    /// Capturable samples above the threshold on the path.
    pub captured: u32,
    /// Union of all views on the path, sample by sample.
    pub covered: Vec<Mask>,
}

/// The tree T with the legs that were looked at so far.
pub struct Tree<'p, 'a> {
    problem: &'p Problem<'a>,
    pub nodes: Vec<Node>,
    /// Whether the drone can fly between two nodes, the lower index first.
    flyable: HashMap<(usize, usize), bool>,
    /// What a leg adds, by its start and end node: a cache.
    legs: HashMap<(usize, usize), Observations>,
    /// Entries of all cached legs together.
    held: usize,
    scratch: Scratch,
}

/// The cache of legs keeps at most this many entries (of 20 bytes) beside those of the tree's own edges.
const MOST_HELD: usize = 2_000_000;

impl<'p, 'a> Tree<'p, 'a> {
    /// A tree of the root alone, which takes an image.
    pub fn new(problem: &'p Problem<'a>, root: Pose) -> Self {
        let mut scratch = problem.scratch();
        let mut covered = vec![0; problem.field.samples.len()];
        // The root's own image covers, but the sums of Eq. 6 begin with the first leg (k = 2).
        let Gained { captured, .. } = problem.cover(&mut covered, &problem.observe_pose(&root, &mut scratch));
        let sums = PathSums::default();
        let objective = problem.objective.value(&sums);
        let root = Node { pose: root, parent: None, children: Vec::new(), sums, objective, captured, covered };
        Self { problem, nodes: vec![root], flyable: HashMap::new(), legs: HashMap::new(), held: 0, scratch }
    }

    /// Adds a node without a parent; [`Tree::connect`] follows.
    pub fn add(&mut self, pose: Pose) -> usize {
        self.nodes.push(Node {
            pose,
            parent: None,
            children: Vec::new(),
            sums: PathSums::default(),
            objective: f64::NEG_INFINITY,
            captured: 0,
            covered: Vec::new(),
        });
        self.nodes.len() - 1
    }

    /// Whether the drone can fly between two nodes, in either direction.
    pub fn can_fly(&mut self, a: usize, b: usize) -> bool {
        let (from, to) = (self.nodes[a].pose.position, self.nodes[b].pose.position);
        *self.flyable.entry((a.min(b), a.max(b))).or_insert_with(|| self.problem.can_fly(&from, &to))
    }

    /// E of the path to `parent` continued to `child` if it exceeds `least`. The drone must be able to fly there.
    ///
    /// Looking at a leg is the search's main cost, and most legs lose by far. So first an upper bound is compared: no image gains
    /// more than the best row of the field holds. The bound is strict, so the answer never depends on it.
    pub fn objective_above(&mut self, parent: usize, child: usize, least: f64) -> Option<f64> {
        let objective = &self.problem.objective;
        let mut sums = self.sums_with_leg(parent, child);
        let mut bound = sums;
        bound.information += self.problem.most_of_leg(&self.nodes[parent].pose, &self.nodes[child].pose);
        if objective.value(&bound) <= least {
            return None;
        }
        self.observe_leg(parent, child);
        sums.information += self.problem.gain(&self.nodes[parent].covered, &self.legs[&(parent, child)]);
        Some(objective.value(&sums)).filter(|&value| value > least)
    }

    /// Makes `parent` the parent of `child` and brings the whole subtree of `child` up to date. The drone must be able to fly the leg.
    pub fn connect(&mut self, parent: usize, child: usize) {
        if let Some(old) = self.nodes[child].parent.replace(parent) {
            self.nodes[old].children.retain(|&c| c != child);
        }
        self.nodes[parent].children.push(child);
        let mut stack = vec![child];
        while let Some(node) = stack.pop() {
            self.update(node);
            stack.extend_from_slice(&self.nodes[node].children);
        }
    }

    /// Which nodes lie on the path from the root to `node`, itself included. Reconnecting others below `node` does not change it.
    pub fn ancestors(&self, node: usize) -> Vec<bool> {
        let mut is_ancestor = vec![false; self.nodes.len()];
        self.path_up(node).for_each(|ancestor| is_ancestor[ancestor] = true);
        is_ancestor
    }

    /// The nodes from `node` up to the root, both included.
    pub fn path_up(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(node), |&n| self.nodes[n].parent)
    }

    /// Recomputes a node's path state from its parent's.
    fn update(&mut self, node: usize) {
        let parent = self.nodes[node].parent.expect("the root is never updated");
        let mut covered = std::mem::take(&mut self.nodes[node].covered);
        covered.clone_from(&self.nodes[parent].covered);
        self.observe_leg(parent, node);
        let gained = self.problem.cover(&mut covered, &self.legs[&(parent, node)]);
        let mut sums = self.sums_with_leg(parent, node);
        sums.information += gained.information;
        let captured = self.nodes[parent].captured + gained.captured;
        let objective = self.problem.objective.value(&sums);
        let entry = &mut self.nodes[node];
        (entry.covered, entry.sums, entry.captured, entry.objective) = (covered, sums, captured, objective);
    }

    /// Length and turning of the path to `parent` continued to `child`, with the information of `parent`.
    fn sums_with_leg(&self, parent: usize, child: usize) -> PathSums {
        let from = &self.nodes[parent];
        let leg = self.nodes[child].pose.position - from.pose.position;
        let mut sums = from.sums;
        sums.length_m += leg.norm();
        if let Some(before) = from.parent {
            let arriving = from.pose.position - self.nodes[before].pose.position;
            sums.turning_s += self.problem.objective.turn_s(&arriving, &leg);
        }
        sums
    }

    fn observe_leg(&mut self, from: usize, to: usize) {
        if self.legs.contains_key(&(from, to)) {
            return;
        }
        if self.held > MOST_HELD {
            self.forget_legs_outside_of_the_tree();
        }
        let seen = self.problem.observe_leg(&self.nodes[from].pose, &self.nodes[to].pose, &mut self.scratch);
        self.held += seen.len();
        self.legs.insert((from, to), seen);
    }

    fn forget_legs_outside_of_the_tree(&mut self) {
        let nodes = &self.nodes;
        self.legs.retain(|&(from, to), _| nodes[to].parent == Some(from));
        // What the tree itself holds does not count, or a large tree would empty its cache at every step.
        self.held = 0;
    }
}
