//! The graph that a bound is about: waypoints, straight legs between them, and what the images on them see.

use nalgebra::Point3;
use rayon::prelude::*;

use super::BoundError;
use crate::camera::Pose;
use crate::coverage::{Mask, Observations};
use crate::search::Problem;
use crate::search::leg::image_poses;
use crate::settings::BoundSettings;
use crate::stop::StopToken;

/// A graph of waypoints with the demand that a plan on it meets. Samples that cannot be captured are left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    /// Places of the waypoints, m.
    pub positions_m: Vec<Point3<f64>>,
    pub edges: Vec<Edge>,
    /// By waypoint: what one image there sees, for each of the ways in which it can be taken.
    pub vertex_sights: Vec<Vec<Observations>>,
    /// By edge: what the images between its ends see at most, together.
    pub edge_sights: Vec<Observations>,
    pub demand: Demand,
}

/// A straight leg that can be flown both ways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    pub ends: [usize; 2],
    /// Whole micrometres, rounded down, so that sums are exact and never exceed the true length.
    pub length_um: i64,
}

/// What makes a plan sufficient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Demand {
    pub samples: usize,
    /// Cells of the hemisphere that a captured sample has covered, at least.
    pub needed_cells: u32,
    /// Samples that a plan captures, at least.
    pub sufficient: u32,
}

/// In a metre.
pub const MICROMETRES: f64 = 1e6;

impl Edge {
    pub fn new(ends: [usize; 2], length_m: f64) -> Self {
        Self { ends, length_um: (length_m * MICROMETRES).floor() as i64 }
    }

    pub fn length_m(&self) -> f64 {
        self.length_um as f64 / MICROMETRES
    }

    /// The other end.
    pub fn across(&self, vertex: usize) -> usize {
        self.ends[0] + self.ends[1] - vertex
    }
}

impl Graph {
    /// `bound.waypoints` viewpoints of the field, spread as evenly as they can be, and all flyable legs of at most `radius_m` between them; of
    /// that only what can be reached from the viewpoint that sees most. An error when stopped, and when there would be too much to see.
    pub fn of_problem(problem: &Problem, settings: &BoundSettings, radius_m: f64, stop: &StopToken) -> Result<Self, BoundError> {
        let everywhere: Vec<Point3<f64>> = problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect();
        let first = (0..everywhere.len()).max_by_key(|&j| (seen_at(problem, &everywhere[j]), usize::MAX - j));
        let first = first.ok_or(BoundError::NothingCapturable)?;
        let positions_m = spread(&everywhere, first, settings.waypoints as usize);
        let legs = legs(problem, &positions_m, radius_m, stop).ok_or(BoundError::Stopped)?;
        let (positions_m, edges) = connected(positions_m, &legs);

        let sample_numbers = numbers(problem);
        let demand = Demand {
            samples: problem.capturable as usize,
            needed_cells: problem.field.facts.threshold_cells + 1,
            sufficient: problem.sufficient,
        };
        let too_large = BoundError::TooLarge {
            waypoints: positions_m.len(),
            legs: edges.len(),
            samples: demand.samples,
            most: settings.most_sightings,
        };
        let mut room = Room { left: settings.most_sightings as usize, too_large, stop };
        let vertex_sights = room.gather(&positions_m, |place| at_waypoint(problem, place, &sample_numbers))?;
        let on_edge = |edge: &Edge| vec![on_the_way(problem, edge.ends.map(|v| positions_m[v]), &sample_numbers)];
        let edge_sights = room.gather(&edges, on_edge)?.into_iter().flatten().collect();
        Ok(Self { edge_sights, vertex_sights, positions_m, edges, demand })
    }

    /// By waypoint, its edges.
    pub fn incident(&self) -> Vec<Vec<usize>> {
        let mut incident = vec![Vec::new(); self.positions_m.len()];
        for (e, edge) in self.edges.iter().enumerate() {
            edge.ends.into_iter().for_each(|v| incident[v].push(e));
        }
        incident
    }

    /// How many samples all images of the graph together capture.
    pub fn reachable(&self) -> u32 {
        let mut covered = vec![0; self.demand.samples];
        self.vertex_sights.iter().flatten().chain(&self.edge_sights).for_each(|sight| add(&mut covered, sight));
        self.demand.captured(&covered)
    }
}

/// How much may be seen.
struct Room<'s> {
    /// Pairs of a sight and a sample.
    left: usize,
    too_large: BoundError,
    stop: &'s StopToken,
}

/// Waypoints or legs whose sights are found at once.
const GATHERED_AT_ONCE: usize = 256;

impl Room<'_> {
    /// What `see` finds for each item, as long as there is room for it.
    fn gather<T: Sync>(
        &mut self,
        items: &[T],
        see: impl Fn(&T) -> Vec<Observations> + Sync,
    ) -> Result<Vec<Vec<Observations>>, BoundError> {
        let mut gathered: Vec<Vec<Observations>> = Vec::with_capacity(items.len());
        for some in items.chunks(GATHERED_AT_ONCE) {
            if self.stop.is_stopped() {
                return Err(BoundError::Stopped);
            }
            gathered.par_extend(some.par_iter().map(&see));
            let seen = gathered[gathered.len() - some.len()..].iter().flatten().map(Observations::len).sum();
            self.left = self.left.checked_sub(seen).ok_or(self.too_large.clone())?;
        }
        Ok(gathered)
    }
}

impl Demand {
    /// Samples that are captured when these cells are covered.
    pub fn captured(&self, covered: &[Mask]) -> u32 {
        covered.iter().filter(|mask| mask.count_ones() >= self.needed_cells).count() as u32
    }
}

/// Adds a sight to the covered cells.
pub fn add(covered: &mut [Mask], sight: &Observations) {
    sight.iter().for_each(|(i, mask)| covered[i] |= mask);
}

/// Cells that a panorama at `place` covers.
fn seen_at(problem: &Problem, place: &Point3<f64>) -> u64 {
    problem.sighted(place).map(|(_, mask)| u64::from(mask.count_ones())).sum()
}

/// The farthest point from all chosen ones, again and again; of two equals the first.
fn spread(places: &[Point3<f64>], first: usize, most: usize) -> Vec<Point3<f64>> {
    let mut chosen = vec![places[first]];
    let mut apart: Vec<f64> = places.iter().map(|place| (place - places[first]).norm_squared()).collect();
    while chosen.len() < most {
        let Some(next) = (0..places.len()).max_by(|&a, &b| apart[a].total_cmp(&apart[b]).then(b.cmp(&a))) else { break };
        if apart[next] <= 0.0 {
            break;
        }
        chosen.push(places[next]);
        apart.iter_mut().zip(places).for_each(|(apart, place)| *apart = apart.min((place - places[next]).norm_squared()));
    }
    chosen
}

fn legs(problem: &Problem, places: &[Point3<f64>], radius_m: f64, stop: &StopToken) -> Option<Vec<Edge>> {
    let from = |a: usize| {
        if stop.is_stopped() {
            return None;
        }
        let near = |b: &usize| (places[*b] - places[a]).norm() <= radius_m && problem.can_fly(&places[a], &places[*b]);
        let edge = |b: usize| Edge::new([a, b], (places[b] - places[a]).norm());
        Some((a + 1..places.len()).filter(near).map(edge).collect::<Vec<_>>())
    };
    let legs: Option<Vec<Vec<Edge>>> = (0..places.len()).into_par_iter().map(from).collect();
    Some(legs?.concat())
}

/// The part of the graph that is connected with the first place: no plan leaves its part.
fn connected(places: Vec<Point3<f64>>, legs: &[Edge]) -> (Vec<Point3<f64>>, Vec<Edge>) {
    let mut reached = vec![false; places.len()];
    reached[0] = true;
    let mut grown = true;
    while grown {
        grown = false;
        for [a, b] in legs.iter().map(|leg| leg.ends) {
            grown |= reached[a] != reached[b];
            let either = reached[a] || reached[b];
            (reached[a], reached[b]) = (either, either);
        }
    }
    let number = |v: usize| reached[..v].iter().filter(|&&reached| reached).count();
    let edges = legs.iter().filter(|leg| reached[leg.ends[0]]).map(|leg| Edge { ends: leg.ends.map(number), ..*leg }).collect();
    (places.into_iter().zip(&reached).filter(|&(_, &reached)| reached).map(|(place, _)| place).collect(), edges)
}

/// New numbers of the capturable samples.
fn numbers(problem: &Problem) -> Vec<Option<u32>> {
    let mut next = 0;
    let number = |i: usize| {
        problem.is_capturable(i).then(|| {
            next += 1;
            next - 1
        })
    };
    (0..problem.field.samples.len()).map(number).collect()
}

/// What an image at a waypoint sees, for each direction of the rig. A rig whose cameras are bolted on may arrive in any heading, so that it is
/// credited with everything around.
fn at_waypoint(problem: &Problem, place: &Point3<f64>, numbers: &[Option<u32>]) -> Vec<Observations> {
    if !problem.rig.has_gimbal() {
        return vec![everything(problem, std::iter::once(*place), numbers)];
    }
    let mut scratch = problem.scratch();
    let see = |&direction| {
        let pose = Pose { position: *place, direction: Some(direction) };
        renumbered(problem.observe_pose(&pose, &mut scratch).iter(), numbers)
    };
    problem.view_directions.iter().map(see).collect()
}

/// What the images between the ends of a leg see at most, flown in either direction, in any direction of the cameras.
fn on_the_way(problem: &Problem, [a, b]: [Point3<f64>; 2], numbers: &[Option<u32>]) -> Observations {
    let pose = |position| Pose { position, direction: None };
    let panoramic = |from: Point3<f64>, to: Point3<f64>| -> Vec<Point3<f64>> {
        let direction = problem.view_directions.first().copied();
        let images =
            image_poses(&problem.rig, &Pose { direction, ..pose(from) }, &Pose { direction, ..pose(to) }, problem.spacing);
        let mut places: Vec<_> = images.map(|image| image.position).collect();
        places.pop();
        places
    };
    everything(problem, panoramic(a, b).into_iter().chain(panoramic(b, a)), numbers)
}

fn everything(problem: &Problem, places: impl Iterator<Item = Point3<f64>>, numbers: &[Option<u32>]) -> Observations {
    let mut union = vec![0 as Mask; numbers.len()];
    for place in places {
        problem.sighted(&place).for_each(|(i, mask)| union[i] |= mask);
    }
    renumbered(union.into_iter().enumerate().filter(|&(_, mask)| mask != 0), numbers)
}

fn renumbered(seen: impl Iterator<Item = (usize, Mask)>, numbers: &[Option<u32>]) -> Observations {
    let (samples, masks) = seen.filter_map(|(i, mask)| Some((numbers[i]?, mask))).unzip();
    Observations::new(samples, masks)
}
