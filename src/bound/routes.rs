//! Shortest routes between all pairs of waypoints.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::graph::Graph;

/// Shortest routes on a graph.
#[derive(Clone, Debug)]
pub struct Routes {
    vertices: usize,
    /// By start and end: length, micrometres; [`NO_ROUTE`] where there is none.
    lengths_um: Vec<i64>,
    /// By start and end, the last edge of the route.
    last_edges: Vec<u32>,
}

/// Longer than any route, and still safe to add up.
pub const NO_ROUTE: i64 = i64::MAX / 1_000_000;

impl Routes {
    pub fn new(graph: &Graph) -> Self {
        let incident = graph.incident();
        let vertices = graph.positions_m.len();
        let rows: Vec<_> = (0..vertices).into_par_iter().map(|from| routes_from(graph, &incident, from)).collect();
        let (lengths_um, last_edges): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
        Self { vertices, lengths_um: lengths_um.concat(), last_edges: last_edges.concat() }
    }

    pub fn length_um(&self, from: usize, to: usize) -> i64 {
        self.lengths_um[from * self.vertices + to]
    }

    /// The edges of a route and the waypoints that they lead to, from its end to its start; `from` itself is not among them.
    pub fn backwards<'a>(&'a self, graph: &'a Graph, from: usize, to: usize) -> impl Iterator<Item = (usize, usize)> + 'a {
        let mut at = to;
        std::iter::from_fn(move || {
            if at == from || self.length_um(from, at) >= NO_ROUTE {
                return None;
            }
            let (edge, reached) = (self.last_edges[from * self.vertices + at] as usize, at);
            at = graph.edges[edge].across(at);
            Some((edge, reached))
        })
    }
}

/// Dijkstra; of two equal routes the one by the lower numbers.
fn routes_from(graph: &Graph, incident: &[Vec<usize>], from: usize) -> (Vec<i64>, Vec<u32>) {
    let mut lengths_um = vec![NO_ROUTE; incident.len()];
    let mut last_edges = vec![u32::MAX; incident.len()];
    lengths_um[from] = 0;
    let mut open = BinaryHeap::from([Reverse((0, from))]);
    while let Some(Reverse((length_um, v))) = open.pop() {
        if length_um > lengths_um[v] {
            continue;
        }
        for &e in &incident[v] {
            let (next, through_um) = (graph.edges[e].across(v), length_um + graph.edges[e].length_um);
            if through_um < lengths_um[next] {
                (lengths_um[next], last_edges[next]) = (through_um, e as u32);
                open.push(Reverse((through_um, next)));
            }
        }
    }
    (lengths_um, last_edges)
}
