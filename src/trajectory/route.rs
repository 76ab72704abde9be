//! A flight before it is timed: its corners, and where on the way images are taken.

use crate::camera::{Pose, Rig};
use crate::search::Problem;
use crate::search::leg::image_poses;
use crate::search::outcome::{Iteration, Outcome, StopReason};
use crate::search::spacing::ImageSpacing;

/// What a planning method decides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Route {
    pub waypoints: Vec<Pose>,
    /// In the order of the flight.
    pub exposures: Vec<Exposure>,
    /// For an overlap: images that follow each other are to be no farther apart, m. Exposures are.
    pub most_apart_m: Option<f64>,
}

/// What a planning method found: always its best, never an error because it was stopped.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    pub route: Route,
    /// The best path after each iteration; empty for methods that do not iterate over whole paths.
    pub convergence: Vec<Iteration>,
    /// Of a method that does not search for a goal [`StopReason::Complete`], or [`StopReason::Cancelled`] when it was told to stop.
    pub stop: StopReason,
}

/// One release of the shutter of all cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// The leg from waypoint `leg` to the next one.
    pub leg: usize,
    /// Distance from the leg's start, m.
    pub flown_m: f64,
    pub pose: Pose,
}

impl Found {
    /// A search's path with images all along it.
    pub fn of(outcome: Outcome, problem: &Problem) -> Self {
        let Outcome { path, convergence, stop } = outcome;
        Self { route: Route::continuous(&path, &problem.rig, problem.spacing), convergence, stop }
    }
}

impl Route {
    /// Images all along the path, as many as `spacing` says: at its start and on every leg up to the leg's end.
    pub fn continuous(path: &[Pose], rig: &Rig, spacing: ImageSpacing) -> Self {
        let start = path.first().map(|&pose| Exposure { leg: 0, flown_m: 0.0, pose });
        let on_legs =
            path.windows(2).map(|ends| spacing.image_count((ends[1].position - ends[0].position).norm())).sum::<usize>();
        let mut exposures = Vec::with_capacity(1 + on_legs);
        let on_leg = |(leg, ends): (usize, &[Pose])| {
            let from = ends[0];
            image_poses(rig, &from, &ends[1], spacing).map(move |pose| {
                let flown_m = (pose.position - from.position).norm();
                Exposure { leg, flown_m, pose }
            })
        };
        exposures.extend(start);
        path.windows(2).enumerate().for_each(|leg| exposures.extend(on_leg(leg)));
        Self { waypoints: path.to_vec(), exposures, most_apart_m: spacing.most_m }
    }

    /// Images only at chosen waypoints; `is_view` says which.
    pub fn at_views(path: &[Pose], is_view: &[bool]) -> Self {
        let exposure = |index: usize| {
            let arriving = index.checked_sub(1);
            let flown_m = arriving.map_or(0.0, |before| (path[index].position - path[before].position).norm());
            Exposure { leg: arriving.unwrap_or(0), flown_m, pose: path[index] }
        };
        let exposures = (0..path.len()).filter(|&index| is_view[index]).map(exposure).collect();
        Self { waypoints: path.to_vec(), exposures, most_apart_m: None }
    }
}
