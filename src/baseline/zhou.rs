//! After Zhou et al. 2020: far too many views close to the surface, of which those are left out that no sample needs, then a tour.
//!
//! Every capturable sample gets a view on its normal. Views are left out in the order of their redundancy as long as the reconstructability of
//! every sample stays at the target, or at what all views together give. Those that remain are moved and turned a little so that the samples
//! that they see gain, and may make others redundant again.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;

use super::pairs::{PairModel, Quality, UNIT};
use super::shots::{Shot, Sight, aimed, framed, sights_at, within_reach};
use super::tally::Tally;
use super::{BaselineError, Reporter, check_rig, flight, found, proximity};
use crate::camera::{Pose, direction_of, pitch_rad};
use crate::search::{Problem, Progress};
use crate::settings::BaselineSettings;
use crate::stop::StopToken;
use crate::trajectory::route::Found;

const NAME: &str = "zhou";

/// Shares of the wanted distance to the surface that are tried when the wanted one is not safe.
const DISTANCES: [f64; 3] = [1.0, 0.75, 0.5];

/// Viewpoints of the field that may stand in for a position that is not safe.
const STAND_INS: usize = 128;

/// Largest move of a view in the first round, m, and its turns, degrees; both are halved every second round.
const MOVE_M: f64 = 6.0;
const TURN_DEG: f64 = 16.0;

/// Redundancy in whole units of the requirement.
const REDUNDANCY_UNIT: u64 = 1000;

/// The views that are left and what they reach.
struct Reduction<'p, 'a> {
    problem: &'p Problem<'a>,
    shots: Vec<Shot>,
    is_kept: Vec<bool>,
    tally: Tally<'p>,
    /// What has to remain of each sample's reconstructability.
    required: Vec<Quality>,
}

/// Plans a flight. A stop ends the optimisation; the views that are left then are flown.
pub fn fly(
    problem: &Problem,
    settings: &BaselineSettings,
    seed: u64,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Found, BaselineError> {
    check_rig(problem, NAME)?;
    let mut report = Reporter::new(on_progress);
    report.tell(0);
    let model = PairModel::new(problem.disks.range_m());
    let target = (settings.zhou_target * UNIT as f64).round() as Quality;
    let mut reduction = Reduction::new(problem, &model, target);
    report.tell(20);
    reduction.reduce(stop);
    reduction.space_out();
    report.tell_views(40, problem, reduction.poses().iter());
    for round in 0..settings.zhou_rounds {
        if stop.is_stopped() {
            break;
        }
        let scale = 0.5f64.powi(round as i32 / 2);
        let is_better = reduction.adjust(MOVE_M * scale, TURN_DEG * scale, stop);
        reduction.reduce(stop);
        report.tell_views(40 + 40 * (round + 1) / settings.zhou_rounds, problem, reduction.poses().iter());
        if !is_better {
            break;
        }
    }
    let views = reduction.poses();
    if views.is_empty() {
        return Err(BaselineError::NoView { method: NAME });
    }
    let route = flight::through(problem, &views, settings, seed, stop, &mut report);
    found(route, stop)
}

/// The view of a sample: on its normal, as many times the safety distance away as the range is times that; nearer, or from the nearest
/// viewpoint of the field that sees it, where that is not safe.
fn first_shot(problem: &Problem, viewpoints: &[Point3<f64>], sample: usize) -> Option<Shot> {
    let frame = &problem.frames[sample];
    let distance_m = (problem.free.safety_distance_m * problem.disks.range_m()).sqrt();
    let sees = |shot: &Shot| shot.sights.iter().any(|sight| sight.sample as usize == sample);
    let shot =
        |position: Point3<f64>| Shot::new(problem, Pose { position, direction: aimed(&problem.rig, &position, &frame.position) });
    let on_normal = DISTANCES.map(|share| frame.position + frame.normal * (distance_m * share));
    let safe = on_normal.into_iter().filter(|position| problem.free.is_safe(position)).map(shot).find(sees);
    safe.or_else(|| {
        let nearest = proximity::nearest(viewpoints, &on_normal[0], STAND_INS).into_iter().map(|j| j as usize);
        let is_seen = |j: &usize| problem.field.row(*j).sees(sample);
        nearest.filter(is_seen).map(|j| shot(viewpoints[j])).find(sees)
    })
}

impl<'p, 'a> Reduction<'p, 'a> {
    /// All first views, and the requirement: the target, or what all of them together reach.
    fn new(problem: &'p Problem<'a>, model: &'p PairModel, target: Quality) -> Self {
        let samples: Vec<usize> = (0..problem.frames.len()).filter(|&i| problem.is_capturable(i)).collect();
        let viewpoints: Vec<Point3<f64>> = problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect();
        let shots: Vec<Shot> = samples.par_iter().filter_map(|&sample| first_shot(problem, &viewpoints, sample)).collect();
        let mut tally = Tally::new(model, &problem.areas_mm2, vec![target; problem.frames.len()]);
        shots.iter().enumerate().for_each(|(view, shot)| tally.add(view as u32, &shot.sights));
        let required = tally.sums.iter().map(|&sum| sum.min(target)).collect();
        Self { problem, is_kept: vec![true; shots.len()], shots, tally, required }
    }

    fn poses(&self) -> Vec<Pose> {
        self.kept().map(|view| self.shots[view as usize].pose).collect()
    }

    fn kept(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.shots.len() as u32).filter(|&view| self.is_kept[view as usize])
    }

    fn leave_out(&mut self, view: u32) {
        self.tally.remove(view, &self.shots[view as usize].sights);
        self.is_kept[view as usize] = false;
    }

    /// Leaves out views as long as every sample keeps what is required, the most redundant one first; of views too near to another those come
    /// before all others. Both only fall as views are left out, so an old redundancy is an upper bound.
    fn reduce(&mut self, stop: &StopToken) {
        let near = proximity::within(&self.positions(), self.problem.spacing.least_leg_m);
        let is_crowded = |reduction: &Self, view: u32| near[view as usize].iter().any(|&other| reduction.is_kept[other as usize]);
        let views: Vec<u32> = self.kept().collect();
        let rank = |reduction: &Self, view: u32| Some((is_crowded(reduction, view), reduction.redundancy(view)?));
        let ranks: Vec<_> = views.par_iter().filter_map(|&view| Some((rank(self, view)?, Reverse(view)))).collect();
        let mut queue = BinaryHeap::from(ranks);
        while let Some((_, Reverse(view))) = queue.pop().filter(|_| !stop.is_stopped()) {
            let Some(rank) = rank(self, view) else { continue };
            if queue.peek().is_some_and(|next| *next > (rank, Reverse(view))) {
                queue.push((rank, Reverse(view)));
                continue;
            }
            self.leave_out(view);
        }
    }

    /// How much of the requirement is left without the view at the sample that is hit worst; `None` when it is needed.
    fn redundancy(&self, view: u32) -> Option<u64> {
        let mut least = u64::MAX;
        for sight in &self.shots[view as usize].sights {
            let (sum, required) = (self.tally.sums[sight.sample as usize], self.required[sight.sample as usize]);
            let links = self.tally.links(view, sight);
            if links > 0 && sum - links < required {
                return None;
            }
            least = least.min((sum - links) * REDUNDANCY_UNIT / required.max(1));
        }
        Some(least)
    }

    /// Leaves out views until none is nearer to another than images may be, always the one of the least loss.
    fn space_out(&mut self) {
        let near = proximity::within(&self.positions(), self.problem.spacing.least_leg_m);
        loop {
            let views: Vec<u32> =
                self.kept().filter(|&view| near[view as usize].iter().any(|&v| self.is_kept[v as usize])).collect();
            let loss = |&view: &u32| (self.tally.loss(view, &self.shots[view as usize].sights), view);
            let Some((_, view)) = views.par_iter().map(loss).min() else { return };
            self.leave_out(view);
        }
    }

    fn positions(&self) -> Vec<Point3<f64>> {
        self.shots.iter().map(|shot| shot.pose.position).collect()
    }

    /// Moves and turns each view to the best of the poses around it; says whether the value rose.
    fn adjust(&mut self, move_m: f64, turn_deg: f64, stop: &StopToken) -> bool {
        let before = self.tally.value();
        for view in self.kept().collect::<Vec<_>>() {
            if stop.is_stopped() {
                break;
            }
            let old = self.shots[view as usize].clone();
            self.tally.remove(view, &old.sights);
            let mut best = (self.tally.gain(&old.sights), None);
            for position in self.positions_around(view, &old.pose, move_m) {
                let sights = sights_at(self.problem, &position);
                for direction in self.directions_around(&old.pose, &position, &sights, turn_deg) {
                    let pose = Pose { position, direction };
                    let shot = Shot { pose, sights: framed(self.problem, &pose, &sights) };
                    let gain = self.tally.gain(&shot.sights);
                    if gain > best.0 {
                        best = (gain, Some(shot));
                    }
                }
            }
            let shot = best.1.unwrap_or(old);
            self.tally.add(view, &shot.sights);
            self.shots[view as usize] = shot;
        }
        self.tally.value() > before
    }

    /// The view's own position and those a step away that are safe, can be flown to straight, and are not too near to another view.
    fn positions_around(&self, view: u32, pose: &Pose, step_m: f64) -> Vec<Point3<f64>> {
        let steps = [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
        let free = self.problem.free;
        let is_near = |a: &Point3<f64>, other: u32| {
            (self.shots[other as usize].pose.position - a).norm() < self.problem.spacing.least_leg_m
        };
        let is_crowded = |p: &Point3<f64>| self.kept().any(|other| other != view && is_near(p, other));
        let moved = steps.into_iter().map(|step| pose.position + step * step_m);
        let fits = moved.filter(|p| free.is_safe(p) && free.is_leg_safe(&pose.position, p) && !is_crowded(p));
        std::iter::once(pose.position).chain(fits).collect()
    }

    /// The view's own direction, turned a little, and towards the sample in sight that is covered worst.
    fn directions_around(
        &self,
        pose: &Pose,
        position: &Point3<f64>,
        sights: &[Sight],
        turn_deg: f64,
    ) -> Vec<Option<Unit<Vector3<f64>>>> {
        let Some(direction) = pose.direction else { return vec![None] };
        let azimuth_deg = libm::atan2(direction.x, direction.y).to_degrees();
        let pitch_deg = pitch_rad(&direction).to_degrees();
        let turned = |azimuth_deg: f64, pitch_deg: f64| {
            within_reach(&self.problem.rig, &direction_of(azimuth_deg, pitch_deg.clamp(-90.0, 90.0)))
        };
        let turns = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
        let around = turns.map(|(yaw, pitch)| turned(azimuth_deg + yaw * turn_deg, pitch_deg + pitch * turn_deg));
        let worst = sights.iter().min_by_key(|sight| (self.tally.sums[sight.sample as usize], sight.sample));
        let towards =
            worst.and_then(|sight| aimed(&self.problem.rig, position, &self.problem.frames[sight.sample as usize].position));
        std::iter::once(direction).chain(around).chain(towards).map(Some).collect()
    }
}
