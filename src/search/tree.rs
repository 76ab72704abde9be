//! The random tree: nodes in an arena, each with the sums and the coverage of its path from the root.

use std::collections::HashMap;
use std::rc::Rc;

use nalgebra::Point3;

use super::cover::Cover;
use super::leg::heading;
use super::objective::PathSums;
use super::problem::{Problem, Scratch};
use super::view_choice::ViewChoice;
use crate::camera::{Cameras, Pose};

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
    /// Union of all views on the path.
    pub covered: Cover,
    /// What the views on the leg from the parent see.
    seen: Rc<Observations>,
}

/// A leg that a node may be connected by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offer {
    /// E of the path to the leg's end.
    pub objective: f64,
    /// The leg's end with the direction that it would have.
    pub end: Pose,
}

/// The tree T with the legs that were looked at so far.
pub struct Tree<'p, 'a> {
    problem: &'p Problem<'a>,
    pub nodes: Vec<Node>,
    /// Whether the drone can fly between two nodes, the lower index first.
    flyable: HashMap<(usize, usize), bool>,
    /// What a leg adds, by its start and end node: a cache, for rigs whose legs do not depend on their ends' directions.
    legs: HashMap<(usize, usize), Rc<Observations>>,
    /// Entries of all cached legs together, and of those that the nodes hold.
    held: usize,
    held_by_nodes: usize,
    scratch: Scratch,
    views: ViewChoice,
}

/// The cache of legs keeps at most this many entries.
const MOST_HELD: usize = 2_000_000;

/// A sample that a leg sees, with its cells, bytes.
const ENTRY_BYTES: usize = size_of::<u32>() + size_of::<Mask>();

impl<'p, 'a> Tree<'p, 'a> {
    /// A tree of the root alone, which takes an image.
    pub fn new(problem: &'p Problem<'a>, root: Pose) -> Self {
        let mut scratch = problem.scratch();
        let (cells, before) = problem.captured_cells();
        let mut covered = Cover::of(&cells, problem.places());
        // The root's own image covers, but the sums of Eq. 6 begin with the first leg (k = 2).
        let Gained { captured, .. } = problem.add_to(&mut covered, &problem.observe_pose(&root, &mut scratch));
        let captured = before + captured;
        let sums = PathSums::default();
        let objective = problem.objective.value(&sums);
        let root = Node { captured, objective, ..Node::at(root, covered) };
        let views = ViewChoice::new(problem.field.samples.len());
        let (flyable, legs) = (HashMap::new(), HashMap::new());
        Self { problem, nodes: vec![root], flyable, legs, held: 0, held_by_nodes: 0, scratch, views }
    }

    /// Memory of the tree, bytes, but for what is small.
    pub fn bytes(&self) -> usize {
        let covered = &self.nodes[0].covered;
        let node_bytes = size_of::<Node>() + covered.own_bytes();
        self.nodes.len() * node_bytes + covered.page_bytes() + (self.held + self.held_by_nodes) * ENTRY_BYTES
    }

    /// Adds a node without a parent; [`Tree::connect`] follows and gives it its direction.
    pub fn add(&mut self, position: Point3<f64>) -> usize {
        let covered = self.nodes[0].covered.clone();
        self.nodes.push(Node::at(Pose { position, direction: None }, covered));
        self.nodes.len() - 1
    }

    /// Takes back the node that was added last and was never connected.
    pub fn take_back(&mut self, last: usize) {
        debug_assert!(last + 1 == self.nodes.len() && self.nodes[last].parent.is_none());
        self.nodes.truncate(last);
        for other in 0..last {
            self.flyable.remove(&(other, last));
            if let Some(seen) = self.legs.remove(&(other, last)) {
                self.held -= seen.len();
            }
        }
    }

    /// Whether the drone can fly between two nodes, in either direction.
    pub fn can_fly(&mut self, a: usize, b: usize) -> bool {
        let (from, to) = (self.nodes[a].pose.position, self.nodes[b].pose.position);
        *self.flyable.entry((a.min(b), a.max(b))).or_insert_with(|| self.problem.can_fly(&from, &to))
    }

    /// The best leg from `parent` to `child` if E of the path over it exceeds `least`. The drone must be able to fly there.
    ///
    /// Looking at a leg is the search's main cost, and most legs lose by far. So first an upper bound is compared: no image gains
    /// more than the best row of the field holds. The bound is strict, so the answer never depends on it.
    pub fn offer(&mut self, parent: usize, child: usize, least: f64) -> Option<Offer> {
        let problem = self.problem;
        let sums = self.sums_with_leg(parent, child);
        let from = &self.nodes[parent];
        let to = self.nodes[child].pose.position;
        let objective = |gained| {
            let information = sums.information + gained;
            problem.objective.value(&PathSums { information, ..sums })
        };
        if objective(problem.most_of_leg(&from.pose.position, &to)) <= least {
            return None;
        }
        if problem.rig.has_gimbal() {
            // "We have to determine the view vector [...] whenever we create a new edge in the tree" (section 5.4).
            let nodes = &self.nodes;
            let children = || nodes[child].children.iter().map(|&grandchild| &nodes[grandchild].pose);
            let fits = |end: &Pose| problem.can_turn(&from.pose, end) && children().all(|next| problem.can_turn(end, next));
            let is_worth = |gained| objective(gained) > least;
            let (end, gained) = self.views.choose(problem, &from.pose, &from.covered, &to, &fits, &is_worth)?;
            return Some(Offer { objective: objective(gained), end });
        }
        let end = self.end_without_gimbal(parent, child);
        let seen = self.leg(parent, child, &end);
        let objective = objective(problem.gain_over(&self.nodes[parent].covered, &seen));
        (objective > least).then_some(Offer { objective, end })
    }

    /// Makes `parent` the parent of `child`, which takes the pose `end`, and brings the whole subtree of `child` up to date. The drone
    /// must be able to fly the leg.
    pub fn connect(&mut self, parent: usize, child: usize, end: Pose) {
        if let Some(old) = self.nodes[child].parent.replace(parent) {
            self.nodes[old].children.retain(|&c| c != child);
        }
        self.nodes[parent].children.push(child);
        let has_turned = self.nodes[child].pose != end;
        self.nodes[child].pose = end;
        self.see(parent, child, &end);
        if has_turned && self.problem.rig.has_gimbal() {
            for grandchild in self.nodes[child].children.clone() {
                let end = self.nodes[grandchild].pose;
                self.see(child, grandchild, &end);
            }
        }
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
        let mut covered = self.nodes[parent].covered.clone();
        let gained = self.problem.add_to(&mut covered, &self.nodes[node].seen);
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

    /// The pose at the end of a leg where the leg alone decides on the direction.
    fn end_without_gimbal(&self, parent: usize, child: usize) -> Pose {
        let position = self.nodes[child].pose.position;
        let direction = match self.problem.rig.cameras {
            Cameras::Rigid(_) => Some(heading(&self.nodes[parent].pose.position, &position)),
            _ => None,
        };
        Pose { position, direction }
    }

    /// Looks at the leg to a node.
    fn see(&mut self, parent: usize, node: usize, end: &Pose) {
        let seen = self.leg(parent, node, end);
        self.held_by_nodes += seen.len();
        self.held_by_nodes -= std::mem::replace(&mut self.nodes[node].seen, seen).len();
    }

    fn leg(&mut self, from: usize, to: usize, end: &Pose) -> Rc<Observations> {
        if self.problem.rig.has_gimbal() {
            return Rc::new(self.problem.observe_leg(&self.nodes[from].pose, end, &mut self.scratch));
        }
        if let Some(seen) = self.legs.get(&(from, to)) {
            return Rc::clone(seen);
        }
        if self.held > MOST_HELD {
            // The legs of the tree itself are held by its nodes.
            self.legs.clear();
            self.held = 0;
        }
        let seen = Rc::new(self.problem.observe_leg(&self.nodes[from].pose, end, &mut self.scratch));
        self.held += seen.len();
        self.legs.insert((from, to), Rc::clone(&seen));
        seen
    }
}

impl Node {
    fn at(pose: Pose, covered: Cover) -> Self {
        Self {
            pose,
            parent: None,
            children: Vec::new(),
            sums: PathSums::default(),
            objective: f64::NEG_INFINITY,
            captured: 0,
            covered,
            seen: Rc::default(),
        }
    }
}
