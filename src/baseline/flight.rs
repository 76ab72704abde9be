//! From chosen views to a route: their order, and safe legs between them.

use std::collections::BTreeMap;

use nalgebra::Point3;
use rayon::prelude::*;

use super::Reporter;
use super::costs::{Costs, NO_WAY_MM};
use super::router::{Router, length_m};
use super::shots::within_reach;
use super::tour::{nearest_neighbour, shorten};
use crate::camera::Pose;
use crate::search::Problem;
use crate::search::leg::slerp;
use crate::settings::BaselineSettings;
use crate::stop::StopToken;
use crate::trajectory::route::Route;

/// How often the order is improved again after detours have become known.
const ROUNDS: u32 = 12;

/// The roadmap joins viewpoints of the lattice up to so many spacings apart.
const ROADMAP_SPACINGS: f64 = 2.0;

/// Detours by the pair of views between which they lead, from the lower index to the higher one; `None` where there is no way.
type Detours = BTreeMap<(u32, u32), Option<Vec<Point3<f64>>>>;

/// A route through the views with images at them alone. Views between which there is no way are flown in parts: the part with the most
/// views is the route, the others are left out.
pub(super) fn through(
    problem: &Problem,
    views: &[Pose],
    settings: &BaselineSettings,
    seed: u64,
    stop: &StopToken,
    report: &mut Reporter,
) -> Route {
    let positions: Vec<Point3<f64>> = views.iter().map(|pose| pose.position).collect();
    let mut costs = Costs::new(positions.clone());
    if !stop.is_stopped() {
        check_near_legs(problem, &positions, &mut costs);
    }
    let nodes = problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect();
    let mut router = Router::new(problem.free, nodes, ROADMAP_SPACINGS * problem.field.facts.lattice_spacing_m);
    let mut detours = Detours::new();
    let mut order = nearest_neighbour(&costs);
    let mut best: Option<(u64, Vec<u32>)> = None;
    let kicks = u64::from(settings.tour_kicks) * views.len() as u64;
    for round in 0..ROUNDS {
        // Later rounds begin with a short path and have little left to do.
        order = shorten(&costs, order, kicks / u64::from(1 + 3 * round.min(1)), seed ^ u64::from(round), stop);
        let learned = resolve(&order, &positions, &mut costs, &mut router, &mut detours);
        let found_mm = costs.length_mm(&order);
        if best.as_ref().is_none_or(|(least_mm, _)| found_mm < *least_mm) {
            best = Some((found_mm, order.clone()));
        }
        report.tell_length(80 + round, best.as_ref().map_or(0.0, |(least_mm, _)| *least_mm as f64 / 1000.0));
        if !learned || stop.is_stopped() {
            break;
        }
    }
    let order = best.map_or(order, |(_, order)| order);
    let joined = order.chunk_by(|&a, &b| costs.cost_mm(a, b) < NO_WAY_MM);
    // The first of the longest parts.
    let part = joined.rev().max_by_key(|part| part.len()).unwrap_or_default();
    assembled(problem, views, part, &detours)
}

/// Checks the straight legs between near views, in parallel.
fn check_near_legs(problem: &Problem, positions: &[Point3<f64>], costs: &mut Costs) {
    let legs = |a: u32| -> Vec<(u32, bool)> {
        let is_safe = |b: u32| problem.free.is_leg_safe(&positions[a.min(b) as usize], &positions[a.max(b) as usize]);
        costs.near(a).iter().map(|&b| (b, is_safe(b))).collect()
    };
    let checked: Vec<Vec<(u32, bool)>> = (0..positions.len() as u32).into_par_iter().map(legs).collect();
    for (a, legs) in checked.into_iter().enumerate() {
        for (b, _) in legs.into_iter().filter(|(_, is_safe)| *is_safe) {
            costs.set(a as u32, b, costs.straight_mm(a as u32, b));
        }
    }
}

/// Finds out what the legs of a path cost that are not known yet; says whether there were any.
fn resolve(order: &[u32], positions: &[Point3<f64>], costs: &mut Costs, router: &mut Router, detours: &mut Detours) -> bool {
    let mut learned = false;
    for leg in order.windows(2) {
        let (a, b) = (leg[0].min(leg[1]), leg[0].max(leg[1]));
        if costs.known_mm(a, b).is_some() {
            continue;
        }
        learned = true;
        let (from, to) = (&positions[a as usize], &positions[b as usize]);
        let corners = router.detour(from, to);
        let cost_mm = corners.as_ref().map_or(NO_WAY_MM, |corners| (length_m(from, corners, to) * 1000.0).round() as u64);
        costs.set(a, b, cost_mm);
        if corners.as_ref().is_none_or(|corners| !corners.is_empty()) {
            detours.insert((a, b), corners);
        }
    }
    learned
}

fn assembled(problem: &Problem, views: &[Pose], order: &[u32], detours: &Detours) -> Route {
    let mut path: Vec<Pose> = Vec::new();
    let mut is_view = Vec::new();
    for (place, &view) in order.iter().enumerate() {
        let to = views[view as usize];
        if place > 0 {
            let (from, last) = (views[order[place - 1] as usize], order[place - 1]);
            let corners = detours.get(&(last.min(view), last.max(view))).cloned().flatten().unwrap_or_default();
            let in_order: Vec<_> = if last < view { corners } else { corners.into_iter().rev().collect() };
            path.extend(between(problem, &from, &in_order, &to));
            is_view.resize(path.len(), false);
        }
        path.push(to);
        is_view.push(true);
    }
    Route::at_views(&path, &is_view)
}

/// The corners of a detour as poses: the camera turns evenly from one view to the next.
fn between(problem: &Problem, from: &Pose, corners: &[Point3<f64>], to: &Pose) -> Vec<Pose> {
    let whole_m = length_m(&from.position, corners, &to.position);
    let direction = |count: usize| {
        let flown_m = length_m(&from.position, &corners[..count], &corners[count]);
        let (first, last) = (from.direction?, to.direction?);
        let turned = if first == last { last } else { slerp(&first, &last, flown_m / whole_m) };
        Some(within_reach(&problem.rig, &turned))
    };
    corners.iter().enumerate().map(|(count, &position)| Pose { position, direction: direction(count) }).collect()
}
