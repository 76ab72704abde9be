//! The certified bound never exceeds the shortest sufficient plan, found by brute force on tiny graphs, and comes near to plans on a block.

mod support;

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use nalgebra::Point3;
use overfly::bound::graph::{Demand, Edge, Graph, add};
use overfly::bound::plan::shortest;
use overfly::bound::program::{Program, Row};
use overfly::bound::relaxation::{Layout, program};
use overfly::bound::routes::Routes;
use overfly::bound::{BoundError, Ended, bound, lower_bound};
use overfly::camera::Rig;
use overfly::coverage::{Mask, Observations};
use overfly::search::Problem;
use overfly::settings::{BoundSettings, Settings};
use overfly::stop::StopToken;
use proptest::prelude::*;
use support::{session, small_block, small_settings, snapshot};

/// Where a walk is, the sights that it has taken and the edges that it has flown.
type State = (usize, u32, u32);

/// The shortest sufficient walk by Dijkstra over everything that a walk can have seen.
fn shortest_by_brute_force(graph: &Graph) -> Option<i64> {
    let first: Vec<usize> = (0..graph.positions_m.len()).map(|v| graph.vertex_sights[..v].iter().map(Vec::len).sum()).collect();
    let looks = |v: usize| (0..graph.vertex_sights[v].len().max(1)).map(move |k| (v, k));
    let taken = |(v, k): (usize, usize)| if graph.vertex_sights[v].is_empty() { 0 } else { 1u32 << (first[v] + k) };
    let is_enough = |(_, sights, edges): State| {
        let mut covered = vec![0; graph.demand.samples];
        for (k, sight) in graph.vertex_sights.iter().flatten().enumerate().filter(|(k, _)| sights >> k & 1 == 1) {
            let _ = k;
            add(&mut covered, sight);
        }
        (0..graph.edges.len()).filter(|e| edges >> e & 1 == 1).for_each(|e| add(&mut covered, &graph.edge_sights[e]));
        graph.demand.captured(&covered) >= graph.demand.sufficient
    };
    let mut best: BTreeMap<State, i64> = BTreeMap::new();
    let starts = (0..graph.positions_m.len()).flat_map(looks).map(|look| Reverse((0, (look.0, taken(look), 0))));
    let mut open: BinaryHeap<Reverse<(i64, State)>> = starts.collect();
    while let Some(Reverse((length_um, state))) = open.pop() {
        if best.get(&state).is_some_and(|&known| known <= length_um) {
            continue;
        }
        best.insert(state, length_um);
        if is_enough(state) {
            return Some(length_um);
        }
        for (e, edge) in graph.edges.iter().enumerate().filter(|(_, edge)| edge.ends.contains(&state.0)) {
            for look in looks(edge.across(state.0)) {
                let next = (look.0, state.1 | taken(look), state.2 | 1 << e);
                open.push(Reverse((length_um + edge.length_um, next)));
            }
        }
    }
    None
}

const SAMPLES: usize = 4;
const CELLS_EACH: u32 = 6;

fn sight() -> impl Strategy<Value = Observations> {
    proptest::collection::vec(0u32..1 << CELLS_EACH, SAMPLES).prop_map(|masks| {
        let seen: Vec<(u32, Mask)> =
            masks.into_iter().enumerate().map(|(i, mask)| (i as u32, Mask::from(mask & mask >> 1))).collect();
        let (samples, masks) = seen.into_iter().filter(|&(_, mask)| mask != 0).unzip();
        Observations::new(samples, masks)
    })
}

/// Up to `vertices` waypoints with so many ways to look, joined by a path and some chords.
fn graphs(vertices: usize, looks: usize) -> impl Strategy<Value = Graph> {
    let chords = proptest::collection::btree_set((0..vertices, 0..vertices), 0..4);
    let places = proptest::collection::vec([0.0..100.0f64, 0.0..100.0, 10.0..40.0], vertices);
    let sights = proptest::collection::vec(proptest::collection::vec(sight(), looks), vertices);
    let on_the_way = proptest::collection::vec(sight(), vertices + 4);
    (places, chords, sights, on_the_way, 1u32..=CELLS_EACH, 1u32..=SAMPLES as u32).prop_map(
        move |(places, chords, vertex_sights, on_the_way, needed_cells, sufficient)| {
            let positions_m: Vec<Point3<f64>> = places.into_iter().map(Point3::from).collect();
            let path = (1..vertices).map(|v| [v - 1, v]);
            let chords = chords.into_iter().filter(|(a, b)| a + 1 < *b).map(|(a, b)| [a, b]);
            let leg = |ends: [usize; 2]| Edge::new(ends, (positions_m[ends[1]] - positions_m[ends[0]]).norm() + 0.001);
            let edges: Vec<Edge> = path.chain(chords).map(leg).collect();
            let edge_sights = on_the_way[..edges.len()].to_vec();
            let demand = Demand { samples: SAMPLES, needed_cells, sufficient };
            Graph { positions_m, edges, vertex_sights, edge_sights, demand }
        },
    )
}

/// The defaults with so many rounds of the search for a plan.
fn rounds(plan_rounds: u32) -> BoundSettings {
    BoundSettings { plan_rounds, ..Settings::default().bound }
}

fn certified_um(graph: &Graph) -> i64 {
    lower_bound(graph, &rounds(0), &StopToken::default(), &mut |_| {}).bound_um
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn no_walk_is_shorter_than_the_bound(graph in graphs(6, 1)) {
        let Some(optimum_um) = shortest_by_brute_force(&graph) else { return Ok(()) };
        prop_assert!(certified_um(&graph) <= optimum_um);
        let walk = shortest(&graph, &Routes::new(&graph), &rounds(30), 1, &StopToken::default());
        if let Some(walk) = walk {
            prop_assert!(walk.length_um >= optimum_um && walk.captured >= graph.demand.sufficient);
        }
    }

    #[test]
    fn no_walk_of_a_camera_on_a_gimbal_is_shorter_than_the_bound(graph in graphs(4, 2)) {
        let Some(optimum_um) = shortest_by_brute_force(&graph) else { return Ok(()) };
        prop_assert!(certified_um(&graph) <= optimum_um);
    }

    #[test]
    fn any_multipliers_certify_a_true_bound(graph in graphs(6, 1), multipliers in proptest::collection::vec(-1e8..1e8f64, 8)) {
        let Some(optimum_um) = shortest_by_brute_force(&graph) else { return Ok(()) };
        let relaxed = program(&graph, &Layout::new(&graph), 2);
        prop_assert_eq!(relaxed.rows.len(), multipliers.len());
        prop_assert!(relaxed.certify(&multipliers).bound <= optimum_um);
        let odd = [f64::NAN, f64::INFINITY, -1.0, 1e300, 0.0, 1e-300, f64::NEG_INFINITY, 5.0];
        prop_assert!(relaxed.certify(&odd).bound <= optimum_um);
    }
}

#[test]
fn the_best_multipliers_certify_the_optimum_and_others_less() {
    // min 3 x + 2 y with x + y >= 4, x <= 3, y <= 3: y = 3, x = 1, so 9; by hand the multiplier is 3: 12 + (2 - 3) 3.
    let row = Row { terms: vec![(0, 1), (1, 1)], at_least: 4 };
    let program = Program { costs: vec![3_000_000, 2_000_000], upper: vec![3, 3], rows: vec![row] };
    assert_eq!(program.certify(&[3e6]).bound, 9_000_000);
    for (multiplier, bound) in [(2e6, 8_000_000), (2.5e6, 8_500_000), (4e6, 7_000_000), (-1.0, 0), (f64::NAN, 0)] {
        assert_eq!(program.certify(&[multiplier]).bound, bound, "{multiplier}");
    }
    let proposal = program.solve(&[true, true], &rounds(0));
    assert!(
        program.certify(&proposal.multipliers).bound > 8_999_000 && program.certify(&proposal.multipliers).bound <= 9_000_000
    );
    assert!((proposal.values[0] - 1.0).abs() < 1e-3 && (proposal.values[1] - 3.0).abs() < 1e-3, "{proposal:?}");
}

/// Waypoints 10 m apart on a line, of which the two at the ends see one sample each.
fn line(vertices: usize) -> Graph {
    let sees = |v: usize| match v {
        0 => Observations::new(vec![0], vec![0b1111]),
        v if v + 1 == vertices => Observations::new(vec![1], vec![0b1111]),
        _ => Observations::default(),
    };
    Graph {
        positions_m: (0..vertices).map(|v| Point3::new(10.0 * v as f64, 0.0, 20.0)).collect(),
        edges: (1..vertices).map(|v| Edge::new([v - 1, v], 10.0)).collect(),
        vertex_sights: (0..vertices).map(|v| vec![sees(v)]).collect(),
        edge_sights: vec![Observations::default(); vertices - 1],
        demand: Demand { samples: 2, needed_cells: 3, sufficient: 2 },
    }
}

#[test]
fn on_a_line_the_bound_is_the_whole_line() {
    let graph = line(8);
    let (bound_um, optimum_um) = (certified_um(&graph), 70_000_000);
    assert!(bound_um <= optimum_um && bound_um as f64 > 0.999 * optimum_um as f64, "{bound_um}");
    let walk = shortest(&graph, &Routes::new(&graph), &rounds(20), 1, &StopToken::default()).expect("the line can be flown");
    assert_eq!((walk.length_um, walk.captured, walk.vertices.len()), (optimum_um, 2, 8));
}

fn on_block(rig: &str, waypoints: u32, stop: &StopToken) -> Result<overfly::bound::Bound, BoundError> {
    let mut settings = small_settings();
    settings.surface.samples = 60;
    settings.bound = BoundSettings { waypoints, ..rounds(50) };
    let snapshot = snapshot(&session(small_block(8), &settings));
    let problem = Problem::new(&snapshot, &settings, Rig::preset(rig).expect("a preset"));
    // Each round's bound holds, so that a few of them will do.
    bound(&problem, &settings.bound, 1, stop, &mut |progress| {
        if progress.round == 6 {
            stop.stop();
        }
    })
}

#[test]
fn on_a_block_the_plan_is_longer_than_the_bound_and_both_are_the_same_again() {
    let first = on_block("panoramic", 140, &StopToken::default()).expect("the block can be flown");
    let plan = first.plan.as_ref().expect("a panorama is planned");
    assert!(first.length_m() > 10.0 && first.ratio().is_some_and(|ratio| ratio > 1.0), "{:?}", first.outcome);
    assert!(plan.captured >= first.graph.demand.sufficient && first.outcome.ended == Ended::Stopped);
    let again = on_block("panoramic", 140, &StopToken::default()).expect("the block can be flown");
    assert_eq!((again.outcome, &again.plan), (first.outcome, &first.plan));
}

#[test]
fn too_few_waypoints_and_a_stop_are_told() {
    let too_few = on_block("panoramic", 3, &StopToken::default()).unwrap_err();
    assert!(matches!(too_few, BoundError::TooFewWaypoints { .. }) && too_few.to_string().contains("ask for more waypoints"));
    let stopped = StopToken::default();
    stopped.stop();
    assert_eq!(on_block("panoramic", 140, &stopped).unwrap_err(), BoundError::Stopped);
}
