//! The flight of an earlier plan over a scene that has changed since: what can still be flown stays, what cannot is flown around or left out.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::baseline::router::Router;
use crate::camera::{Cameras, Pose};
use crate::search::Problem;
use crate::search::leg::slerp;
use crate::trajectory::known::Scope;

/// A way around is looked for over the viewpoints no farther than this from the leg, m, or as far as the leg is long.
const AROUND_M: f64 = 60.0;

/// Viewpoints that a way around leads over are at most so many lattice spacings apart: their neighbours, those across a corner too.
pub const REACH_SPACINGS: f64 = 1.8;

/// With a smaller share of the waypoints it is better to begin anew.
const LEAST_SHARE: f64 = 0.5;

/// Poses that a worker takes at once, at least.
const LEAST_POSES: usize = 32;

/// The waypoints of an earlier flight as they can be flown now, `None` when too few of them are left, or the start where it `is_start_fixed`.
pub fn resumed(problem: &Problem, earlier: &[Pose], is_start_fixed: bool, scope: Scope) -> Option<Vec<Pose>> {
    let looks_around = matches!(problem.rig.cameras, Cameras::Panoramic { .. });
    if earlier.iter().any(|pose| pose.direction.is_none() != looks_around) {
        // The flight of another rig.
        return None;
    }
    let is_admissible = |pose: &&Pose| problem.can_look(pose) && scope.at(&pose.position).is_safe(&pose.position);
    let poses: Vec<&Pose> = earlier.par_iter().with_min_len(LEAST_POSES).filter(is_admissible).collect();
    // Nearly all legs are as they were, and whether they are is asked side by side.
    let legs = poses.par_windows(2).with_min_len(LEAST_POSES);
    let can_fly = |from: &Pose, to: &Pose| {
        let free = scope.along(&from.position, &to.position);
        problem.is_flyable(from, to) && free.is_leg_safe(&from.position, &to.position)
    };
    let is_flown: Vec<bool> = legs.map(|leg| can_fly(leg[0], leg[1])).collect();
    let mut path: Vec<Pose> = Vec::with_capacity(earlier.len());
    let (mut kept, mut last) = (0, None);
    for (index, pose) in poses.iter().enumerate() {
        let way = match last {
            None => Some(Vec::new()),
            Some(last) if last + 1 == index && is_flown[last] => Some(Vec::new()),
            Some(last) => way(problem, poses[last], pose),
        };
        // A waypoint that cannot be reached is left out; the next one may be.
        if let Some(way) = way {
            path.extend(way);
            path.push(**pose);
            (kept, last) = (kept + 1, Some(index));
        }
    }
    let starts_where_it_must =
        !is_start_fixed || path.first().map(|pose| pose.position) == earlier.first().map(|pose| pose.position);
    (path.len() >= 2 && f64::from(kept) >= LEAST_SHARE * earlier.len() as f64 && starts_where_it_must).then_some(path)
}

/// Whether the straight leg between two poses can be flown.
fn can_fly(problem: &Problem, from: &Pose, to: &Pose) -> bool {
    problem.is_flyable(from, to) && problem.free.is_leg_safe(&from.position, &to.position)
}

/// The waypoints between two others, none where the straight leg can be flown; `None` where there is no way.
pub(super) fn way(problem: &Problem, from: &Pose, to: &Pose) -> Option<Vec<Pose>> {
    let free = problem.free;
    if can_fly(problem, from, to) {
        return Some(Vec::new());
    }
    if free.is_leg_safe(&from.position, &to.position) {
        // Too short for its images, or the view would have to turn too fast.
        return None;
    }
    let leg = to.position - from.position;
    let around_m = leg.norm().max(AROUND_M);
    let field = &problem.field;
    let is_near = |p: &Point3<f64>| {
        let share = ((p - from.position).dot(&leg) / leg.norm_squared()).clamp(0.0, 1.0);
        (p - (from.position + leg * share)).norm() <= around_m
    };
    let nodes = field.viewpoints.par_iter().map(|row| Point3::from(row.position_m)).filter(is_near).collect();
    let corners =
        Router::new(free, nodes, field.facts.lattice_spacing_m * REACH_SPACINGS).detour(&from.position, &to.position)?;
    let corners = spread(problem, &from.position, &to.position, corners);
    let places = || std::iter::once(&from.position).chain(&corners).chain([&to.position]);
    let whole_m: f64 = places().zip(places().skip(1)).map(|(a, b)| (b - a).norm()).sum();
    let mut flown_m = 0.0;
    let turned = |(before, here): (&Point3<f64>, &Point3<f64>)| {
        flown_m += (here - before).norm();
        let direction = from.direction.zip(to.direction).map(|(first, last)| slerp(&first, &last, flown_m / whole_m));
        Pose { position: *here, direction }
    };
    let way: Vec<Pose> = places().zip(&corners).map(turned).collect();
    let all = || std::iter::once(from).chain(&way).chain([to]);
    let is_flown = all().zip(all().skip(1)).all(|(a, b)| can_fly(problem, a, b));
    is_flown.then_some(way)
}

/// The corners without those that follow too soon for a leg.
fn spread(problem: &Problem, from: &Point3<f64>, to: &Point3<f64>, corners: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
    let least_m = problem.spacing.least_leg_m;
    let mut last = *from;
    let mut kept = Vec::with_capacity(corners.len());
    for corner in corners {
        if (corner - last).norm() >= least_m && (to - corner).norm() >= least_m {
            kept.push(corner);
            last = corner;
        }
    }
    kept
}
