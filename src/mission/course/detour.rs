//! Ways around no-fly zones at the height of transit: the shortest over corners of the zones, a margin outside of them (a visibility graph).

use std::cell::OnceCell;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

use geo::{BoundingRect, Coord, Distance, Euclidean, Intersects, Line, LineString, Polygon, Rect};
use nalgebra::{Point3, Vector2};

use super::transit;
use crate::scene::NoFlyZone;
use crate::scene::free_space::{FreeSpace, Obstruction};

/// Corners of a way lie so far outside of a zone, and its lines half as far, m: more than a position is wrong by.
const MARGIN_M: f64 = 20.0;
/// A zone with more corners is gone around as a whole: by the polygon around it with so many directions.
const MOST_CORNERS: usize = 64;
const DIRECTIONS: u32 = 16;
/// Corners of all zones together; those farthest from the take-off place are left out.
const MOST_NODES: usize = 500;

/// The ways between the place above the take-off place and others at its height.
pub struct Ways<'a> {
    free: Option<&'a FreeSpace>,
    start: Point3<f64>,
    /// The zones that reach this height somewhere.
    barred: Vec<Barred>,
    /// Corners that can be flown over, of which the first one is the start; looked for when a straight way leads too near to a zone for the first time.
    nodes: OnceCell<Vec<Node>>,
}

/// A corner with the shortest way to it.
struct Node {
    at: Point3<f64>,
    length_m: f64,
    before: Option<usize>,
}

/// A zone, or what is gone around in its place.
struct Barred {
    outline: Polygon<f64>,
    rect: Rect<f64>,
}

impl<'a> Ways<'a> {
    pub fn new(free: Option<&'a FreeSpace>, start: Point3<f64>) -> Self {
        let at_height = |free: &FreeSpace, zone: &NoFlyZone| {
            zone.bounds(free.terrain()).is_some_and(|bounds| (bounds.min.z..=bounds.max.z).contains(&start.z))
        };
        let barred = free
            .map_or(Vec::new(), |free| free.zones().iter().filter(|zone| at_height(free, zone)).flat_map(Barred::of).collect());
        Self { free, start, barred, nodes: OnceCell::new() }
    }

    /// Corners of the shortest way to a place at the same height, without its ends; none for a straight way. A straight one that comes nearer to a zone than the
    /// margin, and does not enter it, is the last resort.
    pub fn to(&self, goal: &Point3<f64>) -> Result<Vec<Point3<f64>>, Obstruction> {
        let Some(free) = self.free else { return Ok(Vec::new()) };
        let obstruction = transit::obstruction(free, &self.start, goal);
        let keeps_clear = obstruction.is_none() && self.keeps_margin(&self.start, goal);
        if keeps_clear || obstruction.as_ref().is_some_and(|cause| !matches!(cause, Obstruction::Zone(_))) {
            return obstruction.map_or(Ok(Vec::new()), Err);
        }
        match (self.around(free, goal), obstruction) {
            (Some(corners), _) => Ok(corners),
            (None, None) => Ok(Vec::new()),
            (None, Some(obstruction)) => Err(obstruction),
        }
    }

    /// The shortest way over at least one corner.
    fn around(&self, free: &FreeSpace, goal: &Point3<f64>) -> Option<Vec<Point3<f64>>> {
        let nodes = self.nodes.get_or_init(|| self.reach(free));
        let length_m = |node: &Node| node.length_m + (goal - node.at).norm();
        let mut nearest: Vec<usize> = (1..nodes.len()).filter(|&node| nodes[node].length_m.is_finite()).collect();
        nearest.sort_by(|&a, &b| length_m(&nodes[a]).total_cmp(&length_m(&nodes[b])));
        let mut node = nearest.into_iter().find(|&node| self.is_free(free, &nodes[node].at, goal))?;
        let mut corners = Vec::new();
        while let Some(before) = nodes[node].before {
            corners.push(nodes[node].at);
            node = before;
        }
        corners.reverse();
        Some(corners)
    }

    /// The shortest ways from the start to the corners of all zones (Dijkstra).
    fn reach(&self, free: &FreeSpace) -> Vec<Node> {
        let start = self.start;
        let mut corners: Vec<Point3<f64>> =
            self.barred.iter().flat_map(Barred::corners).map(|at| Point3::new(at.x, at.y, start.z)).collect();
        corners.sort_by(|a, b| (a - start).norm().total_cmp(&(b - start).norm()));
        let is_clear = |at: &Point3<f64>| self.barred.iter().all(|barred| barred.is_clear(at));
        let nearest = corners.into_iter().filter(is_clear).take(MOST_NODES);
        let unreached = nearest.map(|at| Node { at, length_m: f64::INFINITY, before: None });
        let mut nodes: Vec<Node> = std::iter::once(Node { at: start, length_m: 0.0, before: None }).chain(unreached).collect();
        let mut open = BinaryHeap::from([Open { length_m: 0.0, node: 0 }]);
        let mut is_done = vec![false; nodes.len()];
        while let Some(Open { node, .. }) = open.pop() {
            if std::mem::replace(&mut is_done[node], true) {
                continue;
            }
            let (at, length_m) = (nodes[node].at, nodes[node].length_m);
            for next in 0..nodes.len() {
                let by_here_m = length_m + (nodes[next].at - at).norm();
                if !is_done[next] && by_here_m < nodes[next].length_m && self.is_free(free, &at, &nodes[next].at) {
                    (nodes[next].length_m, nodes[next].before) = (by_here_m, Some(node));
                    open.push(Open { length_m: by_here_m, node: next });
                }
            }
        }
        nodes
    }

    fn is_free(&self, free: &FreeSpace, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        self.keeps_margin(a, b) && transit::obstruction(free, a, b).is_none()
    }

    /// Whether a line keeps half the margin from all zones; an end that is nearer to one already does not come nearer.
    fn keeps_margin(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        let coord = |p: &Point3<f64>| Coord { x: p.x, y: p.y };
        let line = Line::new(coord(a), coord(b));
        let keeps = |barred: &Barred| {
            let reach = Rect::new(
                Coord { x: a.x.min(b.x) - MARGIN_M, y: a.y.min(b.y) - MARGIN_M },
                Coord { x: a.x.max(b.x) + MARGIN_M, y: a.y.max(b.y) + MARGIN_M },
            );
            if !reach.intersects(&barred.rect) {
                return true;
            }
            let least_m = (MARGIN_M / 2.0).min(barred.distance_m(a)).min(barred.distance_m(b)) * (1.0 - 1e-9);
            !barred.outline.intersects(&line) && Euclidean.distance(&line, &barred.outline) >= least_m
        };
        self.barred.iter().all(keeps)
    }
}

impl Barred {
    /// The parts of a zone, filled: a hole of a zone leads nowhere.
    fn of(zone: &NoFlyZone) -> Vec<Self> {
        let part = |polygon: &Polygon<f64>| {
            let ring = polygon.exterior();
            let ring = if ring.0.len() > MOST_CORNERS + 1 { around(ring) } else { ring.clone() };
            let outline = Polygon::new(ring, Vec::new());
            let rect = outline.bounding_rect()?;
            Some(Self { outline, rect })
        };
        zone.outline.iter().filter_map(part).collect()
    }

    /// Whether a place is no nearer than lines of ways may be.
    fn is_clear(&self, p: &Point3<f64>) -> bool {
        let (least, most, by_m) = (self.rect.min(), self.rect.max(), MARGIN_M / 2.0);
        let is_far = p.x < least.x - by_m || p.x > most.x + by_m || p.y < least.y - by_m || p.y > most.y + by_m;
        is_far || self.distance_m(p) >= by_m
    }

    fn distance_m(&self, p: &Point3<f64>) -> f64 {
        Euclidean.distance(&geo::Point::new(p.x, p.y), &self.outline)
    }

    /// Places the margin away from each corner that sticks out: one between its two sides, at a sharp one two beyond it.
    fn corners(&self) -> Vec<Coord<f64>> {
        let ring = &self.outline.exterior().0;
        let corners = &ring[..ring.len().saturating_sub(1)];
        let count = corners.len();
        let turn: f64 = (0..count).map(|k| cross(corners[k], corners[(k + 1) % count])).sum();
        let outside = |k: usize| -> Vec<Coord<f64>> {
            let (before, at, after) = (corners[(k + count - 1) % count], corners[k], corners[(k + 1) % count]);
            let along = |from: Coord<f64>, to: Coord<f64>| Vector2::new(to.x - from.x, to.y - from.y).try_normalize(1e-9);
            let Some((before, after)) = along(before, at).zip(along(at, after)) else { return Vec::new() };
            let beside = |by: Vector2<f64>| Coord { x: at.x + by.x * MARGIN_M, y: at.y + by.y * MARGIN_M };
            if before.perp(&after) * turn <= 0.0 {
                return Vec::new();
            }
            let sine_squared = (1.0 + before.dot(&after)) / 2.0;
            if sine_squared > 0.499 {
                return vec![beside((before - after).normalize() / sine_squared.sqrt())];
            }
            let right = |along: Vector2<f64>| Vector2::new(along.y, -along.x) * turn.signum();
            vec![beside(right(before) + before), beside(right(after) - after)]
        };
        (0..count).flat_map(outside).collect()
    }
}

fn cross(a: Coord<f64>, b: Coord<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}

/// The polygon around a ring with sides in a few directions: where each two neighbouring ones meet.
fn around(ring: &LineString<f64>) -> LineString<f64> {
    let direction = |k: u32| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(DIRECTIONS));
        Vector2::new(cos, sin)
    };
    let reach_m = |k: u32| {
        let outward = direction(k);
        ring.coords().map(|at| at.x * outward.x + at.y * outward.y).fold(f64::NEG_INFINITY, f64::max)
    };
    let corner = |k: u32| {
        let (a, b) = (direction(k), direction(k + 1));
        let (of_a, of_b) = (reach_m(k), reach_m((k + 1) % DIRECTIONS));
        let by = a.perp(&b);
        Coord { x: (of_a * b.y - of_b * a.y) / by, y: (of_b * a.x - of_a * b.x) / by }
    };
    let mut corners: Vec<Coord<f64>> = (0..DIRECTIONS).map(corner).collect();
    corners.extend(corners.first().copied());
    LineString::new(corners)
}

/// A node whose neighbours are still to be looked at, the nearest one first.
#[derive(PartialEq)]
struct Open {
    length_m: f64,
    node: usize,
}

impl Eq for Open {}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.length_m.total_cmp(&self.length_m).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
