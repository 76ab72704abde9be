//! Rows that every sufficient plan keeps and that a fractional proposal breaks.
//!
//! Both kinds rest on the same thought. Take cells C of a sample's hemisphere as given. Whoever captures the sample covers at least D = needed - |C|
//! cells outside C, so that the sum over the plan's images of min(D, new cells of the image) is at least D: a union never has more cells than its parts.

use rayon::prelude::*;

use super::flow::Network;
use super::graph::Graph;
use super::hull;
use super::program::Row;
use super::relaxation::Layout;
use crate::coverage::{CELLS, Mask};

/// What sees a sample, by sample: variables and masks.
#[derive(Clone, Debug)]
pub struct Witnesses {
    of_sample: Vec<Vec<Witness>>,
}

/// Images that see a sample.
#[derive(Clone, Copy, Debug)]
struct Witness {
    variable: usize,
    place: Place,
    mask: Mask,
}

#[derive(Clone, Copy, Debug)]
enum Place {
    Vertex(usize),
    Edge([usize; 2]),
}

/// A row that is broken, and by how much of a whole capture or visit.
pub type Broken = (f64, Row);

/// Rows that are broken by less are left alone.
const LEAST_VIOLATION: f64 = 0.02;

/// Capacities are whole multiples of this share of an edge.
const FLOW_UNITS: f64 = 1e6;

impl Witnesses {
    pub fn new(graph: &Graph, layout: &Layout) -> Self {
        let mut of_sample = vec![Vec::new(); graph.demand.samples];
        for (v, sights) in graph.vertex_sights.iter().enumerate() {
            for (variable, sight) in layout.sights(v).zip(sights) {
                sight.iter().for_each(|(i, mask)| of_sample[i].push(Witness { variable, place: Place::Vertex(v), mask }));
            }
        }
        for (e, (edge, sight)) in graph.edges.iter().zip(&graph.edge_sights).enumerate() {
            let witness = |mask| Witness { variable: layout.edge(e), place: Place::Edge(edge.ends), mask };
            sight.iter().for_each(|(i, mask)| of_sample[i].push(witness(mask)));
        }
        Self { of_sample }
    }
}

/// All broken rows that are found: of coverage, of the connection with what captures a sample, and of the connection with each visited waypoint.
pub fn separate(graph: &Graph, layout: &Layout, witnesses: &Witnesses, values: &[f64]) -> Vec<Broken> {
    let by_sample = (0..layout.samples).into_par_iter().map(|i| of_sample(graph, layout, &witnesses.of_sample[i], i, values));
    let mut broken: Vec<Broken> = by_sample.flatten_iter().collect();
    let by_vertex = (0..layout.vertices).into_par_iter().filter_map(|v| of_vertex(graph, layout, v, values));
    broken.par_extend(by_vertex);
    broken
}

fn of_sample(graph: &Graph, layout: &Layout, witnesses: &[Witness], i: usize, values: &[f64]) -> Vec<Broken> {
    let captured = values[layout.sample(i)];
    if captured < LEAST_VIOLATION {
        return Vec::new();
    }
    let needed = graph.demand.needed_cells;
    let masks: Vec<Mask> = witnesses.iter().map(|witness| witness.mask).collect();
    let uses: Vec<f64> = witnesses.iter().map(|witness| values[witness.variable]).collect();
    let weightings = [Some(by_cells(&masks, &uses, needed)), hull::weigh(&masks, &uses, needed).map(|weights| (weights, hull::WHOLE))];
    let mut rows = Vec::new();
    for (weights, whole) in weightings.into_iter().flatten() {
        let row = coverage_row(layout, witnesses, &weights, whole, i);
        let violation = row.violation(values) / whole as f64;
        if violation > LEAST_VIOLATION {
            rows.push((violation, row));
        }
        rows.extend(connection(graph, layout, witnesses, &weights, whole, i, values));
    }
    rows
}

/// New cells beside given ones, as far as they count, and how many are needed. The given cells are those that the proposal covers most, as many of
/// them as break the row most: they are what the true cost of the rest is hidden behind.
fn by_cells(masks: &[Mask], uses: &[f64], needed: u32) -> (Vec<i64>, i64) {
    let load = |cell: usize| -> f64 { masks.iter().zip(uses).filter(|(mask, _)| *mask >> cell & 1 == 1).map(|(_, &used)| used).sum() };
    let mut loads: Vec<(f64, usize)> = (0..CELLS).map(|cell| (load(cell), cell)).collect();
    loads.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let relative = |given: Mask| -> f64 {
        let (weights, missing) = new_cells(masks, given, needed);
        weights.iter().zip(uses).map(|(&weight, &used)| weight as f64 * used).sum::<f64>() / missing as f64
    };
    let mut given: Mask = 0;
    let mut least = (relative(given), given);
    for &(_, cell) in loads.iter().take(needed as usize - 1).take_while(|load| load.0 > 0.0) {
        given |= 1 << cell;
        let candidate = relative(given);
        if candidate < least.0 {
            least = (candidate, given);
        }
    }
    new_cells(masks, least.1, needed)
}

fn new_cells(masks: &[Mask], given: Mask, needed: u32) -> (Vec<i64>, i64) {
    let missing = needed - given.count_ones();
    (masks.iter().map(|mask| i64::from((mask & !given).count_ones().min(missing))).collect(), i64::from(missing))
}

/// What is used weighs at least a whole if the sample is captured.
fn coverage_row(layout: &Layout, witnesses: &[Witness], weights: &[i64], whole: i64, i: usize) -> Row {
    let images = witnesses.iter().zip(weights).map(|(witness, &weight)| (witness.variable, weight)).filter(|term| term.1 > 0);
    Row { terms: images.chain([(layout.sample(i), -whole)]).collect(), at_least: 0 }
}

/// For any set S of waypoints, a plan that captures the sample goes into S and out again or ends there (twice the capture in all), or what it sees
/// without touching S is enough: whole (x(cut of S) + s(S)) + 2 sum of weights of the images outside S >= 2 whole c_i. The smallest left side
/// is a minimum cut.
fn connection(
    graph: &Graph,
    layout: &Layout,
    witnesses: &[Witness],
    weights: &[i64],
    whole: i64,
    i: usize,
    values: &[f64],
) -> Option<Broken> {
    let wanted = values[layout.sample(i)];
    let (mut network, source) = network(graph, layout, values);
    let sink = source + 1;
    for (witness, &weight) in witnesses.iter().zip(weights) {
        let share = weight as f64 / whole as f64 * values[witness.variable];
        match witness.place {
            Place::Vertex(v) => network.join(v, sink, units(2.0 * share), 0),
            // Both ends outside pay twice the share, as they should; a leg across the cut counts as such, which the row makes good.
            Place::Edge(ends) => ends.into_iter().for_each(|v| network.join(v, sink, units(share), 0)),
        }
    }
    let (sent, outside) = network.cut(source, sink, units(2.0 * wanted));
    if sent as f64 / FLOW_UNITS >= 2.0 * wanted - LEAST_VIOLATION {
        return None;
    }
    let is_outside = |place: Place| match place {
        Place::Vertex(v) => outside[v],
        Place::Edge([a, b]) => outside[a] && outside[b],
    };
    let images = witnesses.iter().zip(weights).filter(|(witness, weight)| **weight > 0 && is_outside(witness.place));
    let images = images.map(|(witness, weight)| (witness.variable, 2 * weight));
    let terms = boundary(graph, layout, &outside, whole).chain(images).chain([(layout.sample(i), -2 * whole)]).collect();
    let row = Row { terms, at_least: 0 };
    let violation = row.violation(values) / whole as f64 / 2.0;
    (violation > LEAST_VIOLATION).then_some((violation, row))
}

/// x(cut of S) + s(S) >= 2 w for the sights w of a waypoint in S; the sum of what lies there may ask for more only if it is one image.
fn of_vertex(graph: &Graph, layout: &Layout, v: usize, values: &[f64]) -> Option<Broken> {
    let sight = layout.sights(v).max_by(|&a, &b| values[a].total_cmp(&values[b]).then(b.cmp(&a)))?;
    if values[sight] < 5.0 * LEAST_VIOLATION {
        return None;
    }
    let (mut network, source) = network(graph, layout, values);
    let sink = source + 1;
    network.join(v, sink, i64::MAX / 4, 0);
    let (_, outside) = network.cut(source, sink, units(2.0 * values[sight]));
    if outside[v] || outside[sink] {
        return None;
    }
    let row = Row { terms: boundary(graph, layout, &outside, 1).chain([(sight, -2)]).collect(), at_least: 0 };
    let violation = row.violation(values) / 2.0;
    (violation > LEAST_VIOLATION).then_some((violation, row))
}

/// Waypoints, a source that the ends of the walk hang on, and a sink that hangs on nothing yet.
fn network(graph: &Graph, layout: &Layout, values: &[f64]) -> (Network, usize) {
    let source = layout.vertices;
    let mut network = Network::new(layout.vertices + 2);
    for (e, edge) in graph.edges.iter().enumerate() {
        let room = units(values[layout.edge(e)]);
        if room > 0 {
            network.join(edge.ends[0], edge.ends[1], room, room);
        }
    }
    (0..layout.vertices).for_each(|v| network.join(source, v, units(values[layout.ends(v)]), 0));
    (network, source)
}

/// Flights across the border of S, the waypoints that are not `outside`, and ends of the walk in it, `times` each.
fn boundary<'a>(graph: &'a Graph, layout: &'a Layout, outside: &'a [bool], times: i64) -> impl Iterator<Item = (usize, i64)> + 'a {
    let crossing = move |&e: &usize| outside[graph.edges[e].ends[0]] != outside[graph.edges[e].ends[1]];
    let flights = (0..layout.edges).filter(crossing).map(move |e| (layout.edge(e), times));
    flights.chain((0..layout.vertices).filter(|&v| !outside[v]).map(move |v| (layout.ends(v), times)))
}

fn units(value: f64) -> i64 {
    (value * FLOW_UNITS).round() as i64
}
