//! From the lines of oblique photography to a route: safe ways between them, and round what lies on them.

use nalgebra::{Point3, Unit, Vector3};

use super::router::Router;
use crate::camera::{Cameras, Pose};
use crate::search::Problem;
use crate::search::leg::heading;
use crate::trajectory::route::{Exposure, Route};

/// Nodes for ways round no-fly zones stand so far apart, m.
const DETOUR_GRID_M: f64 = 12.0;

/// The route while lines are added to it.
pub struct Assembly<'p, 'a> {
    problem: &'p Problem<'a>,
    height_m: f64,
    pub route: Route,
    /// Made when the first leg is not safe.
    router: Option<Router<'p>>,
}

impl<'p, 'a> Assembly<'p, 'a> {
    pub fn new(problem: &'p Problem<'a>, height_m: f64) -> Self {
        Self { problem, height_m, route: Route::default(), router: None }
    }

    /// Adds the parts of a line that can be flown; what lies in a no-fly zone is flown round.
    pub fn fly_line(&mut self, line: &[Point3<f64>], look: Option<Unit<Vector3<f64>>>) {
        let free = self.problem.free;
        let safe: Vec<Point3<f64>> = line.iter().copied().filter(|p| free.is_safe(p)).collect();
        for run in safe.chunk_by(|a, b| free.is_leg_safe(a, b)) {
            let (first, last) = (run[0], run[run.len() - 1]);
            if !self.go_to(&first, look) {
                continue;
            }
            if run.len() > 1 && !free.is_leg_safe(&first, &last) {
                self.expose(run[0], look);
                for &position in &run[1..] {
                    self.corner(&position, look);
                    self.expose(position, look);
                }
                continue;
            }
            if run.len() > 1 {
                self.corner(&last, look);
            }
            run.iter().for_each(|&position| self.expose(position, look));
        }
    }

    /// Flies to a position by a safe way; `false` when there is none.
    fn go_to(&mut self, to: &Point3<f64>, look: Option<Unit<Vector3<f64>>>) -> bool {
        let Some(from) = self.route.waypoints.last().map(|pose| pose.position) else {
            self.corner(to, look);
            return true;
        };
        if from == *to {
            return true;
        }
        let Some(corners) = self.way(&from, to) else { return false };
        for corner in corners.iter().chain([to]) {
            self.corner(corner, look);
        }
        true
    }

    fn way(&mut self, from: &Point3<f64>, to: &Point3<f64>) -> Option<Vec<Point3<f64>>> {
        let free = self.problem.free;
        if free.is_leg_safe(from, to) {
            return Some(Vec::new());
        }
        let height_m = self.height_m;
        let router = self.router.get_or_insert_with(|| {
            let steps =
                |low: f64, high: f64| (0..=((high - low) / DETOUR_GRID_M) as usize).map(move |k| low + k as f64 * DETOUR_GRID_M);
            let limits = &free.limits;
            let plane = steps(limits.min.x, limits.max.x).flat_map(|x| steps(limits.min.y, limits.max.y).map(move |y| (x, y)));
            let nodes = plane.map(|(x, y)| Point3::new(x, y, height_m)).filter(|p| free.is_safe(p)).collect();
            Router::new(free, nodes, 2.3 * DETOUR_GRID_M)
        });
        router.detour(from, to)
    }

    fn corner(&mut self, position: &Point3<f64>, look: Option<Unit<Vector3<f64>>>) {
        let before = self.route.waypoints.last().map(|pose| pose.position);
        let direction = match self.problem.rig.cameras {
            Cameras::Rigid(_) => Some(before.map_or(Vector3::x_axis(), |before| heading(&before, position))),
            _ => look,
        };
        self.route.waypoints.push(Pose { position: *position, direction });
        // Bolted cameras look along the first leg at its start too.
        if let ([first, second], Cameras::Rigid(_)) = (&mut self.route.waypoints[..], &self.problem.rig.cameras) {
            first.direction = second.direction;
        }
    }

    /// An image on the last leg, or where the route begins.
    fn expose(&mut self, position: Point3<f64>, look: Option<Unit<Vector3<f64>>>) {
        let leg = self.route.waypoints.len().saturating_sub(2);
        let flown_m = (position - self.route.waypoints[leg].position).norm();
        let direction = match self.problem.rig.cameras {
            Cameras::Rigid(_) => self.route.waypoints[self.route.waypoints.len() - 1].direction,
            _ => look,
        };
        self.route.exposures.push(Exposure { leg, flown_m, pose: Pose { position, direction } });
    }
}
