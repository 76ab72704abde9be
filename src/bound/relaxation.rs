//! The linear relaxation of the shortest sufficient plan on a graph.
//!
//! A plan is a walk. Its variables: how often each edge is flown, either way (x_e); how many of the walk's two ends lie at each waypoint
//! (s_v); whether each sight, a waypoint together with a way to look from there, is taken (w_k); whether each sample is captured (c_i). In a shortest walk
//! no edge is flown more than twice if what is seen does not depend on how often: two of three flights can be left out.

use super::graph::Graph;
use super::program::{Program, Row};

/// Where the variables of a graph stand in its program.
#[derive(Clone, Debug)]
pub struct Layout {
    pub edges: usize,
    pub vertices: usize,
    /// By vertex, the first of its sights; one more entry than vertices.
    first_sight: Vec<usize>,
    pub samples: usize,
}

impl Layout {
    pub fn new(graph: &Graph) -> Self {
        let mut first_sight = vec![0];
        graph.vertex_sights.iter().for_each(|sights| first_sight.push(first_sight[first_sight.len() - 1] + sights.len()));
        let (edges, vertices) = (graph.edges.len(), graph.positions_m.len());
        Self { edges, vertices, first_sight, samples: graph.demand.samples }
    }

    pub fn edge(&self, e: usize) -> usize {
        e
    }

    /// Ends of the walk at a waypoint.
    pub fn ends(&self, v: usize) -> usize {
        self.edges + v
    }

    /// The variables of a waypoint's sights.
    pub fn sights(&self, v: usize) -> std::ops::Range<usize> {
        let first = self.edges + self.vertices;
        first + self.first_sight[v]..first + self.first_sight[v + 1]
    }

    pub fn sample(&self, i: usize) -> usize {
        self.edges + self.vertices + self.first_sight[self.vertices] + i
    }

    pub fn variables(&self) -> usize {
        self.sample(self.samples)
    }
}

/// The program without what is found on demand: `most_flights` bounds how often each edge is flown.
pub fn program(graph: &Graph, layout: &Layout, most_flights: i64) -> Program {
    let mut costs = vec![0; layout.variables()];
    let mut upper = vec![1; layout.variables()];
    for (e, edge) in graph.edges.iter().enumerate() {
        costs[layout.edge(e)] = edge.length_um;
        upper[layout.edge(e)] = most_flights;
    }
    (0..layout.vertices).for_each(|v| upper[layout.ends(v)] = 2);

    let two_ends = Row { terms: (0..layout.vertices).map(|v| (layout.ends(v), -1)).collect(), at_least: -2 };
    let captured = (0..layout.samples).map(|i| (layout.sample(i), 1)).collect();
    let enough = Row { terms: captured, at_least: i64::from(graph.demand.sufficient) };
    let mut rows = vec![two_ends, enough];
    for (v, incident) in graph.incident().iter().enumerate() {
        // Each visit but one at an end is flown to and flown away from, and takes one image.
        let flights = incident.iter().map(|&e| (layout.edge(e), 1)).chain([(layout.ends(v), 1)]);
        rows.push(Row { terms: flights.chain(layout.sights(v).map(|k| (k, -2))).collect(), at_least: 0 });
    }
    Program { costs, upper, rows }
}
