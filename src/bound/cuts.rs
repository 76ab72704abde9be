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
use crate::settings::BoundSettings;

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

/// A fractional solution of the program of a graph.
#[derive(Clone, Copy, Debug)]
pub struct Fraction<'a> {
    pub graph: &'a Graph,
    pub layout: &'a Layout,
    pub values: &'a [f64],
    pub settings: &'a BoundSettings,
}

/// How hard rows are sought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// By given cells alone: a tenth of a second.
    Quick,
    /// By the sharpest weighting of each sample's images as well: seconds.
    Sharp,
}

/// A row that is broken, and by how much of a whole capture or visit.
pub type Broken = (f64, Row);

/// Capacities are whole multiples of this share of an edge.
const FLOW_UNITS: f64 = 1e6;
/// Units that each edge has for nothing, so that of equally good cuts the one with the fewest edges is found.
const CREEP: i64 = 20;

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
pub fn separate(fraction: Fraction, witnesses: &Witnesses, effort: Effort) -> Vec<Broken> {
    let layout = fraction.layout;
    let by_sample = (0..layout.samples).into_par_iter().map(|i| of_sample(fraction, &witnesses.of_sample[i], i, effort));
    let mut broken: Vec<Broken> = by_sample.flatten_iter().collect();
    let by_vertex = (0..layout.vertices).into_par_iter().flat_map_iter(|v| of_vertex(fraction, v));
    broken.par_extend(by_vertex);
    broken
}

fn of_sample(fraction: Fraction, witnesses: &[Witness], i: usize, effort: Effort) -> Vec<Broken> {
    let Fraction { graph, layout, values, settings } = fraction;
    let captured = values[layout.sample(i)];
    if captured < settings.least_violation {
        return Vec::new();
    }
    let needed = graph.demand.needed_cells;
    let masks: Vec<Mask> = witnesses.iter().map(|witness| witness.mask).collect();
    let uses: Vec<f64> = witnesses.iter().map(|witness| values[witness.variable]).collect();
    let sharp = match effort {
        Effort::Quick => None,
        Effort::Sharp => hull::weigh(&masks, &uses, needed, settings).map(|weights| (weights, hull::WHOLE)),
    };
    let weightings = [Some(by_cells(&masks, &uses, needed)), sharp];
    let mut rows = Vec::new();
    for (weights, whole) in weightings.into_iter().flatten() {
        let row = coverage_row(layout, witnesses, &weights, whole, i);
        let violation = row.violation(values) / whole as f64;
        if violation > settings.least_violation {
            rows.push((violation, row));
        }
        rows.extend(connection(fraction, witnesses, &weights, whole, i));
    }
    rows
}

/// New cells beside given ones, as far as they count, and how many are needed. The given cells are those that the proposal covers most, as many of
/// them as break the row most: they are what the true cost of the rest is hidden behind.
fn by_cells(masks: &[Mask], uses: &[f64], needed: u32) -> (Vec<i64>, i64) {
    let load =
        |cell: usize| -> f64 { masks.iter().zip(uses).filter(|(mask, _)| *mask >> cell & 1 == 1).map(|(_, &used)| used).sum() };
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
fn connection(fraction: Fraction, witnesses: &[Witness], weights: &[i64], whole: i64, i: usize) -> Vec<Broken> {
    let target = Target { variable: fraction.layout.sample(i), whole };
    let shares: Vec<(Place, usize, i64)> =
        witnesses.iter().zip(weights).map(|(w, &weight)| (w.place, w.variable, weight)).collect();
    nested(fraction, &target, &shares)
}

/// What is to be connected: a variable, and the weight at which images are as good as a visit.
struct Target {
    variable: usize,
    whole: i64,
}

/// Smallest cuts between the ends of the walk and what is to be connected. When one is found its edges are opened, so that the next one is another; each is taken
/// from both sides. Many rows at a time save many solutions of the program.
fn nested(fraction: Fraction, target: &Target, images: &[(Place, usize, i64)]) -> Vec<Broken> {
    let Fraction { graph, layout, values, settings } = fraction;
    let (wanted, whole) = (values[target.variable], target.whole as f64);
    let mut opened = vec![false; layout.edges];
    let mut rows: Vec<Broken> = Vec::new();
    for _ in 0..settings.nested_cuts {
        let (mut network, source) = network(fraction, &opened, wanted);
        let sink = source + 1;
        for &(place, variable, weight) in images {
            let share = weight as f64 / whole * values[variable];
            match place {
                Place::Vertex(v) => network.join(v, sink, units(2.0 * share), 0),
                // Both ends outside pay twice the share, as they should; a leg across the cut counts as such, which the row makes good.
                Place::Edge(ends) => ends.into_iter().for_each(|v| network.join(v, sink, units(share), 0)),
            }
        }
        let (sent, mut far) = network.cut(source, sink, units(2.0 * wanted));
        if sent as f64 / FLOW_UNITS >= 2.0 * wanted - settings.least_violation {
            break;
        }
        let near: Vec<bool> = network.sink_side(sink).into_iter().map(|inside| !inside).collect();
        far.truncate(layout.vertices);
        for outside in [&far, &near[..layout.vertices].to_vec()] {
            let row = connection_row(graph, layout, target, images, outside);
            let violation = row.violation(values) / whole / 2.0;
            if violation > settings.least_violation && rows.last().is_none_or(|last| last.1 != row) {
                rows.push((violation, row));
            }
            let crosses = |e: &usize| outside[graph.edges[*e].ends[0]] != outside[graph.edges[*e].ends[1]];
            (0..layout.edges).filter(crosses).for_each(|e| opened[e] = true);
        }
    }
    rows
}

fn connection_row(graph: &Graph, layout: &Layout, target: &Target, images: &[(Place, usize, i64)], outside: &[bool]) -> Row {
    let is_outside = |place: Place| match place {
        Place::Vertex(v) => outside[v],
        Place::Edge([a, b]) => outside[a] && outside[b],
    };
    let outer = images.iter().filter(|image| image.2 > 0 && is_outside(image.0)).map(|image| (image.1, 2 * image.2));
    let inner = [(target.variable, -2 * target.whole)];
    Row { terms: boundary(graph, layout, outside, target.whole).chain(outer).chain(inner).collect(), at_least: 0 }
}

/// x(cut of S) + s(S) >= 2 w for the most used sight w of a waypoint in S.
fn of_vertex(fraction: Fraction, v: usize) -> Vec<Broken> {
    let Fraction { graph, layout, values, settings } = fraction;
    let Some(sight) = layout.sights(v).max_by(|&a, &b| values[a].total_cmp(&values[b]).then(b.cmp(&a))) else {
        return Vec::new();
    };
    if values[sight] < settings.least_visit {
        return Vec::new();
    }
    let (mut network, source) = network(fraction, &vec![false; layout.edges], 0.0);
    let sink = source + 1;
    network.join(v, sink, units(3.0), 0);
    let (_, outside) = network.cut(source, sink, units(2.0 * values[sight]));
    if outside[v] {
        return Vec::new();
    }
    let row = Row { terms: boundary(graph, layout, &outside, 1).chain([(sight, -2)]).collect(), at_least: 0 };
    let violation = row.violation(values) / 2.0;
    if violation > settings.least_violation { vec![(violation, row)] } else { Vec::new() }
}

/// Waypoints, a source that the ends of the walk hang on, and a sink that hangs on nothing yet.
fn network(fraction: Fraction, opened: &[bool], wanted: f64) -> (Network, usize) {
    let Fraction { graph, layout, values, .. } = fraction;
    let source = layout.vertices;
    let mut network = Network::new(layout.vertices + 2);
    for (e, edge) in graph.edges.iter().enumerate() {
        let room = CREEP + units(if opened[e] { 2.0 * wanted } else { values[layout.edge(e)] });
        network.join(edge.ends[0], edge.ends[1], room, room);
    }
    (0..layout.vertices).for_each(|v| network.join(source, v, units(values[layout.ends(v)]), 0));
    (network, source)
}

/// Flights across the border of S, the waypoints that are not `outside`, and ends of the walk in it, `times` each.
fn boundary<'a>(
    graph: &'a Graph,
    layout: &'a Layout,
    outside: &'a [bool],
    times: i64,
) -> impl Iterator<Item = (usize, i64)> + 'a {
    let crossing = move |&e: &usize| outside[graph.edges[e].ends[0]] != outside[graph.edges[e].ends[1]];
    let flights = (0..layout.edges).filter(crossing).map(move |e| (layout.edge(e), times));
    flights.chain((0..layout.vertices).filter(|&v| !outside[v]).map(move |v| (layout.ends(v), times)))
}

fn units(value: f64) -> i64 {
    (value * FLOW_UNITS).round() as i64
}
