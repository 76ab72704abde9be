//! A short sufficient plan on the graph, to hold the bound against: greedy insertion, then parts taken out and put in anew.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

use super::graph::{Graph, add};
use super::routes::{NO_ROUTE, Routes};
use crate::coverage::Mask;
use crate::settings::BoundSettings;
use crate::stop::StopToken;

/// A walk on the graph that captures enough.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Walk {
    pub vertices: Vec<usize>,
    pub length_um: i64,
    pub captured: u32,
}

/// Stops of a tour: waypoints that the walk must pass; between them it takes the shortest routes, and what their images see counts as well.
type Stops = Vec<usize>;

/// The best walk that several searches find, each of as many rounds as the settings ask for; of two equals the first.
/// `None` when all images together do not capture enough.
pub fn shortest(graph: &Graph, routes: &Routes, settings: &BoundSettings, seed: u64, stop: &StopToken) -> Option<Walk> {
    let searched = (0..settings.plan_searches).into_par_iter().map(|number| {
        // The first one gives a plan in any case.
        if number > 0 && stop.is_stopped() {
            return None;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::from(number));
        let (covered, used, mark) = (Vec::new(), Vec::new(), 0);
        let mut tours = Tours { graph, routes, settings, rng, covered, used, mark };
        let first = tours.completed(Vec::new())?;
        let (stops, _) = tours.rebuilt(first, settings.plan_rounds, stop);
        Some(tours.walk(&stops))
    });
    searched.collect::<Vec<_>>().into_iter().flatten().min_by_key(|walk| walk.length_um)
}

/// Tours on a graph while a short one is sought.
struct Tours<'a> {
    graph: &'a Graph,
    routes: &'a Routes,
    settings: &'a BoundSettings,
    rng: ChaCha8Rng,
    /// Cells that the tour in hand covers, and its waypoints and edges by the mark of the time when they were counted.
    covered: Vec<Mask>,
    used: Vec<u32>,
    mark: u32,
}

impl Tours<'_> {
    /// The best tour of so many rounds in which parts of it are taken out and put in anew.
    fn rebuilt(&mut self, first: (Stops, i64), rounds: u32, stop: &StopToken) -> (Stops, i64) {
        let (mut current, mut best) = (first.clone(), first);
        for round in 0..rounds {
            if stop.is_stopped() {
                break;
            }
            let Some(candidate) = self.changed(&current.0) else { continue };
            let left = 1.0 - f64::from(round) / f64::from(rounds);
            let tolerated = current.1 as f64 * (1.0 + self.settings.plan_tolerance * left * left * self.share());
            if candidate.1 as f64 <= tolerated {
                current = candidate;
            }
            if current.1 < best.1 {
                best = current.clone();
            }
        }
        best
    }

    /// A uniform number from 0 to 1.
    fn share(&mut self) -> f64 {
        f64::from(self.rng.next_u32()) / f64::from(u32::MAX)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.share() * count as f64) as usize % count.max(1)
    }

    /// Takes some stops out, neighbours on the tour or in space, puts others in until it is enough, and takes out what is not needed.
    fn changed(&mut self, stops: &Stops) -> Option<(Stops, i64)> {
        let mut kept = stops.clone();
        let taken = 1 + self.below((self.settings.plan_taken as usize).min(kept.len()));
        let centre = self.below(kept.len());
        if self.share() < 0.5 {
            let first = centre.min(kept.len() - taken);
            kept.drain(first..first + taken);
        } else {
            let place = kept[centre];
            let mut by_distance: Vec<(i64, usize)> =
                kept.iter().map(|&stop| (self.routes.length_um(place, stop), stop)).collect();
            by_distance.sort_unstable();
            let out: Vec<usize> = by_distance.into_iter().take(taken).map(|(_, stop)| stop).collect();
            kept.retain(|stop| !out.contains(stop));
        }
        self.completed(kept)
    }

    /// Adds stops until the tour captures enough, shortens it, and drops what is not needed.
    fn completed(&mut self, mut stops: Stops) -> Option<(Stops, i64)> {
        let noise = if stops.is_empty() { 0.0 } else { self.share() };
        while !self.is_sufficient(&stops) {
            let (stop, place) = self.best_insertion(&stops, noise)?;
            stops.insert(place, stop);
        }
        straighten(self.routes, &mut stops);
        self.drop_idle(&mut stops);
        straighten(self.routes, &mut stops);
        // Another order takes other routes, which may see less.
        while !self.is_sufficient(&stops) {
            let (stop, place) = self.best_insertion(&stops, 0.0)?;
            stops.insert(place, stop);
        }
        let length_um = length_um(self.routes, &stops);
        Some((stops, length_um))
    }

    /// The stop that gains most for its detour, some chance included.
    fn best_insertion(&mut self, stops: &Stops, noise: f64) -> Option<(usize, usize)> {
        let mut best: Option<(f64, usize, usize)> = None;
        for v in 0..self.graph.positions_m.len() {
            let gain = self.gain(v);
            if gain == 0 {
                continue;
            }
            let Some((detour_um, place)) = cheapest_place(self.routes, stops, v) else { continue };
            let chance = 1.0 + noise * self.share();
            let worth = chance * gain as f64 / (detour_um as f64 + 1e6);
            if best.is_none_or(|(most, ..)| worth > most) {
                best = Some((worth, v, place));
            }
        }
        best.map(|(_, v, place)| (v, place))
    }

    /// Cells that count: those that bring a sample nearer to being captured.
    fn gain(&self, v: usize) -> u32 {
        let needed = self.graph.demand.needed_cells;
        let of_one = |(i, mask): (usize, Mask)| {
            let before = self.covered[i].count_ones();
            if before >= needed { 0 } else { (self.covered[i] | mask).count_ones().min(needed) - before }
        };
        self.graph.vertex_sights[v].iter().flat_map(|sight| sight.iter()).map(of_one).sum()
    }

    /// Counts what a tour covers.
    fn is_sufficient(&mut self, stops: &[usize]) -> bool {
        let (graph, routes) = (self.graph, self.routes);
        self.covered.clear();
        self.covered.resize(graph.demand.samples, 0);
        self.used.resize(graph.positions_m.len() + graph.edges.len(), 0);
        self.mark += 1;
        if let Some(&first) = stops.first() {
            self.count_vertex(first);
        }
        for pair in stops.windows(2) {
            for (edge, vertex) in routes.backwards(graph, pair[0], pair[1]) {
                self.count_vertex(vertex);
                let slot = graph.positions_m.len() + edge;
                if std::mem::replace(&mut self.used[slot], self.mark) != self.mark {
                    add(&mut self.covered, &graph.edge_sights[edge]);
                }
            }
        }
        graph.demand.captured(&self.covered) >= graph.demand.sufficient
    }

    fn count_vertex(&mut self, v: usize) {
        if std::mem::replace(&mut self.used[v], self.mark) != self.mark {
            self.graph.vertex_sights[v].iter().for_each(|sight| add(&mut self.covered, sight));
        }
    }

    /// Leaves out stops that the others do not need, those that save most first.
    fn drop_idle(&mut self, stops: &mut Stops) {
        loop {
            let mut savings: Vec<(i64, usize)> = (0..stops.len()).map(|k| (-saving(self.routes, stops, k), k)).collect();
            savings.sort_unstable();
            let idle = savings.into_iter().find(|&(_, k)| {
                let mut fewer = stops.clone();
                fewer.remove(k);
                self.is_sufficient(&fewer)
            });
            let Some((_, k)) = idle else { break };
            stops.remove(k);
        }
    }

    fn walk(&mut self, stops: &[usize]) -> Walk {
        self.is_sufficient(stops);
        let captured = self.graph.demand.captured(&self.covered);
        let mut vertices: Vec<usize> = stops.first().copied().into_iter().collect();
        for pair in stops.windows(2) {
            let mut way: Vec<usize> = self.routes.backwards(self.graph, pair[0], pair[1]).map(|(_, vertex)| vertex).collect();
            way.reverse();
            vertices.extend(way);
        }
        Walk { vertices, length_um: length_um(self.routes, stops), captured }
    }
}

fn length_um(routes: &Routes, stops: &[usize]) -> i64 {
    stops.windows(2).map(|pair| routes.length_um(pair[0], pair[1])).sum()
}

fn cheapest_place(routes: &Routes, stops: &[usize], v: usize) -> Option<(i64, usize)> {
    let (Some(&first), Some(&last)) = (stops.first(), stops.last()) else { return Some((0, 0)) };
    let ends = [(routes.length_um(v, first), 0), (routes.length_um(last, v), stops.len())];
    let between = stops.windows(2).enumerate().map(|(k, pair)| {
        (routes.length_um(pair[0], v) + routes.length_um(v, pair[1]) - routes.length_um(pair[0], pair[1]), k + 1)
    });
    between.chain(ends).min().filter(|&(detour_um, _)| detour_um < NO_ROUTE)
}

/// What leaving out stop `k` saves.
fn saving(routes: &Routes, stops: &[usize], k: usize) -> i64 {
    let before = k.checked_sub(1).map(|k| stops[k]);
    let after = stops.get(k + 1).copied();
    let leg = |a: Option<usize>, b: Option<usize>| a.zip(b).map_or(0, |(a, b)| routes.length_um(a, b));
    leg(before, Some(stops[k])) + leg(Some(stops[k]), after) - leg(before, after)
}

/// 2-opt for a path with free ends, until nothing is gained.
fn straighten(routes: &Routes, stops: &mut Stops) {
    let leg = |a: Option<&usize>, b: Option<&usize>| a.zip(b).map_or(0, |(&a, &b)| routes.length_um(a, b));
    let mut improved = true;
    while improved {
        improved = false;
        for i in 0..stops.len() {
            for j in i + 1..stops.len() {
                let before = i.checked_sub(1).and_then(|k| stops.get(k));
                let after = stops.get(j + 1);
                let old = leg(before, stops.get(i)) + leg(stops.get(j), after);
                let new = leg(before, stops.get(j)) + leg(stops.get(i), after);
                if new < old {
                    stops[i..=j].reverse();
                    improved = true;
                }
            }
        }
    }
}
