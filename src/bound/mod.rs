//! A certified lower bound on the length of any sufficient plan on a graph of waypoints, and a plan on the same graph to hold it against.
//!
//! The bound is the value of a linear relaxation, strengthened by rows on demand until they lift it no more. It is certified: whatever the solver says, its
//! multipliers are turned into a bound by weak duality in whole numbers ([`program::Program::certify`]).

mod cuts;
mod flow;
pub mod graph;
mod hull;
pub mod plan;
pub mod program;
pub mod relaxation;
pub mod routes;

use self::cuts::{Broken, Effort, Fraction, Witnesses};
use self::graph::{Graph, MICROMETRES};
use self::plan::Walk;
use self::program::{Program, Proposal, Row};
use self::relaxation::Layout;
use self::routes::Routes;
use crate::camera::Cameras;
use crate::search::Problem;
use crate::settings::BoundSettings;
use crate::stop::StopToken;

/// A bound and what it is about.
#[derive(Clone, Debug)]
pub struct Bound {
    pub graph: Graph,
    /// Legs are no longer, m.
    pub radius_m: f64,
    pub outcome: Outcome,
    /// A sufficient plan on the graph; `None` for a camera on a gimbal, for which none is sought.
    pub plan: Option<Walk>,
}

/// Why there is no bound.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BoundError {
    #[error(
        "no sample of the scene can be captured, so that there is nothing to bound; take a rig with a wider view or raise `flight.legal_ceiling_m`"
    )]
    NothingCapturable,
    #[error(
        "no plan on a graph of {waypoints} waypoints is sufficient: all its images together capture {reachable} samples, and {sufficient} are needed; ask \
         for more waypoints (`--waypoints`), and for as many viewpoints of the field (`--viewpoints`)"
    )]
    TooFewWaypoints { waypoints: usize, reachable: u32, sufficient: u32 },
    #[error(
        "a graph of {waypoints} waypoints and {legs} legs is too large for a bound: its images see the {samples} samples that can be captured more than \
         {most} times; take fewer samples (`--samples`), fewer waypoints (`--waypoints`) or a part of the scene, or raise `bound.most_sightings` and \
         expect hours"
    )]
    TooLarge { waypoints: usize, legs: usize, samples: usize, most: u32 },
    #[error("stopped before there was a bound")]
    Stopped,
}

/// How far the bound has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// No sufficient plan is shorter.
    pub bound_um: i64,
    pub rounds: u32,
    pub rows: usize,
    pub ended: Ended,
}

/// Why the bound was not lifted any further.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ended {
    /// The last rounds lifted it by next to nothing.
    #[default]
    Still,
    MostRounds,
    Stopped,
}

/// The plan in hand and the bound so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    pub round: u32,
    pub bound_um: i64,
    pub plan_um: Option<i64>,
}

/// Where what is seen depends on how often an edge is flown, it is flown at most so often; a plan that does so more often is longer than the
/// bound is let become.
const MOST_FLIGHTS: i64 = 1000;

/// Bounds the length of the plans on a graph that [`Graph::of_problem`] makes with the neighbour radius of the search, and looks for a short one, by chance
/// as `seed` says.
pub fn bound(
    problem: &Problem,
    settings: &BoundSettings,
    seed: u64,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Bound, BoundError> {
    if problem.capturable == 0 {
        return Err(BoundError::NothingCapturable);
    }
    let radius_m = problem.field.facts.neighbour_radius_m;
    let graph = Graph::of_problem(problem, settings, radius_m, stop)?;
    let (reachable, sufficient) = (graph.reachable(), graph.demand.sufficient);
    if reachable < sufficient {
        return Err(BoundError::TooFewWaypoints { waypoints: graph.positions_m.len(), reachable, sufficient });
    }
    // The directions of a camera on a gimbal are bounded, but no plan with them is sought.
    let is_planned = matches!(problem.rig.cameras, Cameras::Panoramic { .. });
    let plan = is_planned.then(|| plan::shortest(&graph, &Routes::new(&graph), settings, seed, stop)).flatten();
    let plan_um = plan.as_ref().map(|plan| plan.length_um);
    let outcome = lower_bound(&graph, settings, stop, &mut |progress| on_progress(&Progress { plan_um, ..*progress }));
    if outcome.bound_um == 0 && outcome.ended == Ended::Stopped {
        return Err(BoundError::Stopped);
    }
    Ok(Bound { graph, radius_m, outcome, plan })
}

impl Bound {
    pub fn length_m(&self) -> f64 {
        self.outcome.bound_um as f64 / MICROMETRES
    }

    pub fn plan_m(&self) -> Option<f64> {
        self.plan.as_ref().map(|plan| plan.length_um as f64 / MICROMETRES)
    }

    /// The plan is at most so many times as long as the shortest one.
    pub fn ratio(&self) -> Option<f64> {
        self.plan_m().filter(|_| self.outcome.bound_um > 0).map(|plan_m| plan_m / self.length_m())
    }
}

/// The best certified bound that rows on demand lead to. Each round's bound holds, so that a stop only makes it weaker.
pub fn lower_bound(graph: &Graph, settings: &BoundSettings, stop: &StopToken, on_progress: &mut dyn FnMut(&Progress)) -> Outcome {
    let layout = Layout::new(graph);
    let witnesses = Witnesses::new(graph, &layout);
    let most_flights = most_flights(graph);
    let mut program = relaxation::program(graph, &layout, most_flights);
    let fixed_rows = program.rows.len();
    let mut active = first_columns(graph, &layout, settings.first_neighbours as usize);
    let mut best = Outcome { ended: Ended::MostRounds, ..Outcome::default() };
    let (mut effort, mut still) = (Effort::Quick, 0);
    for round in 1..=settings.most_rounds {
        if stop.is_stopped() {
            return Outcome { ended: Ended::Stopped, ..best };
        }
        let proposal = program.solve(&active, settings);
        let certificate = program.certify(&proposal.multipliers);
        let bound_um = certificate.bound.min(longest_certified_um(graph, most_flights));
        let has_moved = bound_um as f64 > best.bound_um as f64 * (1.0 + settings.still_share);
        best = Outcome { bound_um: bound_um.max(best.bound_um), rounds: round, rows: program.rows.len(), ..best };
        on_progress(&Progress { round, bound_um: best.bound_um, plan_um: None });

        let joined = join_columns(&mut active, &certificate.reduced);
        drop_idle(&mut program, fixed_rows, &proposal, settings.idle_m);
        still = if has_moved { 0 } else { still + 1 };
        let fraction = Fraction { graph, layout: &layout, values: &proposal.values, settings };
        let mut broken = cuts::separate(fraction, &witnesses, effort);
        if still >= settings.still_rounds || broken.is_empty() && joined == 0 {
            if effort == Effort::Sharp {
                return Outcome { ended: Ended::Still, ..best };
            }
            (effort, still) = (Effort::Sharp, 0);
            broken = cuts::separate(fraction, &witnesses, effort);
        }
        add_rows(&mut program.rows, broken, settings.most_new_rows as usize);
    }
    best
}

/// Two flights of an edge see as much as three, unless images from one waypoint see different things.
fn most_flights(graph: &Graph) -> i64 {
    if graph.vertex_sights.iter().all(|sights| sights.len() <= 1) { 2 } else { MOST_FLIGHTS }
}

/// Plans that fly an edge more often than the program allows are at least so long.
fn longest_certified_um(graph: &Graph, most_flights: i64) -> i64 {
    let shortest_um = graph.edges.iter().map(|edge| edge.length_um).min().unwrap_or(0);
    if most_flights == 2 { i64::MAX } else { shortest_um * (most_flights + 1) }
}

/// All variables but edges, and the edges from each waypoint to so many near neighbours.
fn first_columns(graph: &Graph, layout: &Layout, neighbours: usize) -> Vec<bool> {
    let mut active = vec![true; layout.variables()];
    active[..layout.edges].fill(false);
    for mut incident in graph.incident() {
        incident.sort_by_key(|&e| graph.edges[e].length_um);
        incident.into_iter().take(neighbours).for_each(|e| active[e] = true);
    }
    active
}

/// Lets in the variables that the multipliers would rather use.
fn join_columns(active: &mut [bool], reduced: &[i128]) -> usize {
    let cheap = |&j: &usize| !active[j] && reduced[j] < 0;
    let joining: Vec<usize> = (0..active.len()).filter(cheap).collect();
    joining.iter().for_each(|&j| active[j] = true);
    joining.len()
}

/// Rows that found themselves without a multiplier go, so that the program stays small.
fn drop_idle(program: &mut Program, fixed_rows: usize, proposal: &Proposal, idle_m: f64) {
    let mut number = 0;
    program.rows.retain(|row| {
        let r = number;
        number += 1;
        let scale = row.terms.iter().map(|term| term.1.abs()).max().unwrap_or(1) as f64;
        r < fixed_rows || proposal.multipliers[r] * scale > idle_m * MICROMETRES
    });
}

fn add_rows(rows: &mut Vec<Row>, mut broken: Vec<Broken>, most: usize) {
    broken.sort_by(|a, b| b.0.total_cmp(&a.0));
    rows.extend(broken.into_iter().take(most).map(|(_, row)| row));
}
