//! A certified lower bound on the length of any sufficient plan on a graph of waypoints, and a plan on the same graph to hold it against.

pub mod cuts;
mod flow;
pub mod graph;
mod hull;
pub mod plan;
pub mod program;
pub mod relaxation;
pub mod routes;

use self::cuts::{Broken, Witnesses};
use self::graph::Graph;
use self::program::{Program, Proposal, Row};
use self::relaxation::Layout;
use crate::stop::StopToken;

/// What a run of the bound has come to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    pub round: u32,
    pub bound_um: i64,
    pub rows: usize,
    pub columns: usize,
}

/// Rounds whose bound is within this share of the best are said to stand still ...
const STILL: f64 = 0.001;
/// ... and so many of them in a row end the work.
const STILL_ROUNDS: u32 = 3;
const MOST_ROUNDS: u32 = 100;

/// Edges from each waypoint to the nearest others that the program begins with; the rest joins when it is worth it.
const FIRST_NEIGHBOURS: usize = 6;

/// The best certified bound that rows on demand lead to. Each round's bound holds, so that a stop only makes it weaker.
pub fn lower_bound(graph: &Graph, most_flights: &[i64], stop: &StopToken, on_progress: &mut dyn FnMut(&Progress)) -> Progress {
    let layout = Layout::new(graph);
    let witnesses = Witnesses::new(graph, &layout);
    let mut program = relaxation::program(graph, &layout, most_flights);
    let fixed_rows = program.rows.len();
    let mut active = first_columns(graph, &layout);
    let mut best = Progress::default();
    let mut still = 0;
    for round in 1..=MOST_ROUNDS {
        let t0 = std::time::Instant::now();
        let proposal = program.solve(&active);
        let t1 = t0.elapsed();
        let certificate = program.certify(&proposal.multipliers);
        let moved = certificate.bound as f64 > best.bound_um as f64 * (1.0 + STILL);
        best = Progress { round, bound_um: certificate.bound.max(best.bound_um), rows: program.rows.len(), columns: active.iter().filter(|a| **a).count() };
        on_progress(&best);
        let joined = join_columns(&mut active, &certificate.reduced);
        still = if moved || joined > 0 { 0 } else { still + 1 };
        if stop.is_stopped() || still >= STILL_ROUNDS {
            break;
        }
        drop_idle(&mut program, fixed_rows, &proposal);
        let t0 = std::time::Instant::now();
        let broken = cuts::separate(graph, &layout, &witnesses, &proposal.values);
        if std::env::var("TRACE").is_ok() { let primal: f64 = proposal.values.iter().zip(&program.costs).map(|(x, &c)| x * c as f64 / 1e6).sum(); eprintln!("round {round} now {:.1} primal {primal:.1} best {:.1} rows {} cols {} joined {joined} broken {} worst {:.3} solve {t1:?} cut {:?}", certificate.bound as f64 / 1e6, best.bound_um as f64/1e6, best.rows, best.columns, broken.len(), broken.iter().map(|b| b.0).fold(0.0, f64::max), t0.elapsed()); }
        if std::env::var("TRACE").is_ok() { trace_values(graph, &layout, &witnesses, &proposal.values); }
        if broken.is_empty() && joined == 0 {
            break;
        }
        add_rows(&mut program.rows, broken);
    }
    best
}

/// All variables but edges, and the edges to near neighbours.
fn first_columns(graph: &Graph, layout: &Layout) -> Vec<bool> {
    let mut active = vec![true; layout.variables()];
    active[..layout.edges].fill(false);
    for mut incident in graph.incident() {
        incident.sort_by_key(|&e| graph.edges[e].length_um);
        incident.into_iter().take(FIRST_NEIGHBOURS).for_each(|e| active[e] = true);
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
fn drop_idle(program: &mut Program, fixed_rows: usize, proposal: &Proposal) {
    let mut number = 0;
    program.rows.retain(|row| {
        let r = number;
        number += 1;
        let scale = row.terms.iter().map(|term| term.1.abs()).max().unwrap_or(1) as f64;
        r < fixed_rows || proposal.multipliers[r] * scale > 1e-3 * 1e6
    });
}

fn add_rows(rows: &mut Vec<Row>, mut broken: Vec<Broken>) {
    broken.sort_by(|a, b| b.0.total_cmp(&a.0));
    rows.extend(broken.into_iter().take(std::env::var("TAKE").map_or(800, |t| t.parse().unwrap())).map(|(_, row)| row));
}
pub fn trace_values(graph: &Graph, layout: &Layout, witnesses: &Witnesses, values: &[f64]) {
    let w: f64 = (0..layout.vertices).flat_map(|v| layout.sights(v)).map(|k| values[k]).sum();
    let x: f64 = (0..layout.edges).map(|e| values[e]).sum();
    let mut h = [0; 11];
    for e in 0..layout.edges { h[(values[e] * 5.0).min(10.0) as usize] += (values[e] > 0.005) as i32; }
    let c: Vec<i32> = { let mut c = [0; 11]; for i in 0..layout.samples { c[(values[layout.sample(i)] * 10.0) as usize] += 1; } c.to_vec() };
    let s: Vec<f64> = (0..layout.vertices).map(|v| values[layout.ends(v)]).filter(|s| *s > 0.05).collect();
    eprintln!("w {w:.2} x {x:.2} hist(x/0.2) {h:?} c {c:?} ends {s:.2?}");
    let _ = (graph, witnesses);
}
