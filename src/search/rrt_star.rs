//! Algorithms 2 to 5 of the paper, line by line.

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::outcome::{Iteration, Outcome, Progress, StopReason};
use super::problem::{Problem, SearchError};
use super::tree::{Node, Offer, Tree};
use crate::camera::Pose;
use crate::stop::StopToken;

/// Random positions that are tried before the start counts as walled in.
const SAMPLE_TRIES: u32 = 20_000;

/// Algorithm 2, Trajectory Planning. One seed gives one path, bit for bit.
///
/// The tree knows coverage by the field, which is right to a point or two. So a path that reaches the goal is `confirm`ed, which counts
/// the capturable samples that it really captures; when some are missing, that many more are asked of the tree.
pub fn search(
    problem: &Problem,
    start: Pose,
    iterations: u32,
    seed: u64,
    stop: &StopToken,
    confirm: &dyn Fn(&[Pose]) -> u32,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Outcome, SearchError> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Alg. 2: "Initialize random tree T with w_start as its root node".
    let mut tree = Tree::new(problem, start);
    let mut best = Best::of(problem, &tree);
    let mut convergence = Vec::new();
    let mut reason = StopReason::IterationsUsed;
    // Alg. 2: "while percentage of surface points [...] is <= G and # iterations of this while loop is < K".
    for iteration in 1..=iterations {
        if best.is_sufficient(problem, confirm) {
            reason = StopReason::GoalReached;
            break;
        }
        if stop.is_stopped() {
            reason = StopReason::Cancelled;
            break;
        }
        if tree.bytes() >= problem.most_bytes() {
            reason = StopReason::MemoryUsed;
            break;
        }
        match expand(problem, &mut tree, &mut random, stop) {
            Ok(true) => {}
            Ok(false) => {
                reason = StopReason::Cancelled;
                break;
            }
            Err(error) if tree.nodes.len() == 1 => return Err(error),
            // There is a path already: the search ends with it.
            Err(SearchError::Unreachable { .. }) => {
                reason = StopReason::SpaceExhausted;
                break;
            }
        }
        if iteration % problem.settings.root_rewire_every.max(1) == 0 {
            // Alg. 2: "if every 50 iterations then Rewire_Tree(T, w_start)".
            rewire_tree(problem, &mut tree, 0, stop);
        }
        best.improve(&tree);
        convergence.push(best.record(problem));
        on_progress(&best.progress(problem, iteration, iterations));
    }
    if reason != StopReason::GoalReached && best.is_sufficient(problem, confirm) {
        reason = StopReason::GoalReached;
    }
    Ok(Outcome { path: best.path, convergence, stop: reason })
}

/// One pass through the body of Algorithm 2; `false` when stopped before there was a new node.
pub(super) fn expand(problem: &Problem, tree: &mut Tree, random: &mut ChaCha8Rng, stop: &StopToken) -> Result<bool, SearchError> {
    let mut chosen: Option<Connection> = None;
    for _ in 0..problem.settings.candidates {
        // "w_new <- Random_Sample(F, T)".
        let Some((position, reachable_from)) = random_sample(problem, tree, random, stop)? else {
            return Ok(false);
        };
        let least = chosen.as_ref().map_or(f64::NEG_INFINITY, |connection| connection.offer.objective);
        chosen = best_connection(problem, tree, position, reachable_from, least).or(chosen);
    }
    let Connection { position, parent, offer } = chosen.expect("any leg to a node without children is better than nothing");
    // "Connect w_new to T by setting w_p as w_new's parent".
    let new = tree.add(position);
    tree.connect(parent, new, offer.end);
    // "Rewire_Tree(T, w_new)".
    rewire_tree(problem, tree, new, stop);
    Ok(true)
}

/// Where a new waypoint would hang.
struct Connection {
    position: Point3<f64>,
    parent: usize,
    offer: Offer,
}

/// The parent of a new waypoint at `position`, if E of the path over it exceeds `least`.
fn best_connection(
    problem: &Problem,
    tree: &mut Tree,
    position: Point3<f64>,
    reachable_from: usize,
    least: f64,
) -> Option<Connection> {
    let new = tree.add(position);
    // "N <- Find_Neighbors(T, w_new)".
    let mut candidates = find_neighbours(problem, tree, new);
    // "if N is empty then w_p <- Find the node in T that is nearest to w_new and reachable to w_new".
    if candidates.is_empty() {
        candidates.push(reachable_from);
    }
    let mut best = None;
    for n in candidates {
        // "w_p <- Find the node in N that maximizes Eq. (6) for trajectory {w_start, ..., w_p, w_new}".
        let least = best.as_ref().map_or(least, |connection: &Connection| connection.offer.objective);
        if let Some(offer) = tree.offer(n, new, least) {
            best = Some(Connection { position, parent: n, offer });
        }
    }
    tree.take_back(new);
    best
}

/// Algorithm 3, Random_Sample. Returns the location and the nearest node that it can be reached from; nothing when stopped.
fn random_sample(
    problem: &Problem,
    tree: &Tree,
    random: &mut ChaCha8Rng,
    stop: &StopToken,
) -> Result<Option<(Point3<f64>, usize)>, SearchError> {
    for _ in 0..SAMPLE_TRIES {
        if stop.is_stopped() {
            return Ok(None);
        }
        // "w_new <- randomize a location in F": a viewpoint of the field, anywhere in its lattice cell.
        let position = randomise(problem, random);
        if !problem.free.is_safe(&position) {
            continue;
        }
        // "if w_new is reachable from any node in T through the free space without hitting or getting close to the proxy".
        let mut nodes: Vec<(f64, usize)> = (0..tree.nodes.len()).map(|n| (distance(&tree.nodes[n], &position), n)).collect();
        nodes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        if let Some(&(_, nearest)) = nodes.iter().find(|&&(_, n)| problem.can_fly(&tree.nodes[n].pose.position, &position)) {
            return Ok(Some((position, nearest)));
        }
    }
    Err(SearchError::Unreachable { tries: SAMPLE_TRIES })
}

/// Algorithm 4, Find_Neighbors: nodes within the neighbour radius of `w` that the drone can fly to and from.
fn find_neighbours(problem: &Problem, tree: &mut Tree, w: usize) -> Vec<usize> {
    let (position, radius) = (tree.nodes[w].pose.position, problem.field.facts.neighbour_radius_m);
    // "N <- find nodes in T within a radius of 10% scene size from w".
    let mut near: Vec<(f64, usize)> =
        (0..tree.nodes.len()).filter(|&n| n != w).map(|n| (distance(&tree.nodes[n], &position), n)).collect();
    near.retain(|&(distance_m, _)| distance_m <= radius);
    near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // "if w is not reachable from n [...] then N <- N - n". Section 5.2 calls this a k-NN search: the nearest ones are enough.
    near.into_iter().map(|(_, n)| n).filter(|&n| tree.can_fly(n, w)).take(problem.settings.neighbours_most as usize).collect()
}

/// Algorithm 5, Rewire_Tree. The time budget counts reconnections, with a cap on the nodes that are looked at.
pub(super) fn rewire_tree(problem: &Problem, tree: &mut Tree, start: usize, stop: &StopToken) {
    // "queue Q <- w".
    let mut queue = VecDeque::from([start]);
    let (mut reconnections, mut pops) = (0, 0);
    // "while Q is not empty & within time budget do w <- Pop_Front(Q)".
    while let Some(w) = queue.pop_front() {
        pops += 1;
        if pops > problem.settings.rewire_pops || stop.is_stopped() {
            return;
        }
        // "N <- Find_Neighbors(T, w) - Find_Ancestors(w)": an ancestor below its own descendant would close a loop.
        let neighbours = find_neighbours(problem, tree, w);
        let is_ancestor = tree.ancestors(w);
        for n in neighbours {
            if is_ancestor[n] || tree.nodes[n].parent == Some(w) {
                continue;
            }
            // "Try to connect w_i to w"; "if E({w_start, ..., w_i}) increases after the reconnection then".
            let Some(offer) = tree.offer(w, n, tree.nodes[n].objective) else { continue };
            if reconnections == problem.settings.rewirings {
                return;
            }
            // "Set w as w_i's parent; Push w_i to Q".
            tree.connect(w, n, offer.end);
            queue.push_back(n);
            reconnections += 1;
        }
    }
}

fn randomise(problem: &Problem, random: &mut ChaCha8Rng) -> Point3<f64> {
    let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let viewpoints = problem.field.viewpoints;
    let index = ((uniform() * viewpoints.len() as f64) as usize).min(viewpoints.len() - 1);
    let offset = Vector3::new(uniform() - 0.5, uniform() - 0.5, uniform() - 0.5);
    Point3::from(viewpoints[index].position_m) + offset * problem.field.facts.lattice_spacing_m
}

fn distance(node: &Node, position: &Point3<f64>) -> f64 {
    (node.pose.position - position).norm()
}

/// The best path that any iteration has seen: sufficient paths before others, these by E; the others by coverage, then by E.
///
/// It is kept as positions, because later rewiring may take it out of the tree again.
struct Best {
    path: Vec<Pose>,
    /// Capturable samples above the threshold, by the field.
    captured: u32,
    /// How many of them make a path sufficient, by the field.
    required: u32,
    objective: f64,
    length_m: f64,
    turning_s: f64,
}

impl Best {
    fn of(problem: &Problem, tree: &Tree) -> Self {
        let mut best = Self {
            path: Vec::new(),
            captured: 0,
            required: problem.sufficient,
            objective: f64::NEG_INFINITY,
            length_m: 0.0,
            turning_s: 0.0,
        };
        best.take(tree, 0);
        best.improve(tree);
        best
    }

    /// Whether the path captures more than G percent of the capturable samples. What the field promised and the path does not keep
    /// is added to what the field must promise next.
    fn is_sufficient(&mut self, problem: &Problem, confirm: &dyn Fn(&[Pose]) -> u32) -> bool {
        if self.captured < self.required {
            return false;
        }
        let missing = problem.sufficient.saturating_sub(confirm(&self.path));
        self.required = self.captured + missing;
        missing == 0
    }

    /// Alg. 2: "S <- Find trajectories in T with sufficient coverage; T_best <- the trajectory in S that maximizes Eq. (6)".
    fn improve(&mut self, tree: &Tree) {
        let required = self.required;
        let rank = |captured: u32, objective: f64| (captured.min(required), objective);
        let candidate = (0..tree.nodes.len())
            .map(|n| (rank(tree.nodes[n].captured, tree.nodes[n].objective), n))
            .max_by(|(a, i), (b, j)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(j.cmp(i)));
        if let Some((rank_found, node)) = candidate
            && rank_found > rank(self.captured, self.objective)
        {
            self.take(tree, node);
        }
    }

    fn take(&mut self, tree: &Tree, node: usize) {
        self.path = tree.path_up(node).map(|n| tree.nodes[n].pose).collect();
        self.path.reverse();
        let node = &tree.nodes[node];
        (self.captured, self.objective) = (node.captured, node.objective);
        (self.length_m, self.turning_s) = (node.sums.length_m, node.sums.turning_s);
    }

    fn record(&self, problem: &Problem) -> Iteration {
        Iteration {
            objective: self.objective,
            coverage_percent: problem.coverage_percent(self.captured),
            length_m: self.length_m,
            turning_s: self.turning_s,
        }
    }

    fn progress(&self, problem: &Problem, iteration: u32, iterations: u32) -> Progress {
        Progress {
            iteration,
            iterations,
            coverage_percent: problem.coverage_percent(self.captured),
            length_m: self.length_m,
            objective: self.objective,
        }
    }
}
