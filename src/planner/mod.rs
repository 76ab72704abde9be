//! The whole pipeline on one screen.

pub mod en_route;
mod options;
mod overlap;
mod resume;

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;

use self::en_route::Departure;
use crate::baseline;
use crate::camera::{Pose, Rig, Targets};
use crate::coverage::Information;
use crate::field::Snapshot;
use crate::refine::{self, Aim, Budget, Confirmed, Counting, Ground, Task, Worth};
use crate::search::leg::headed;
use crate::search::objective::PathSums;
use crate::search::{Outcome, Problem, Wanted, search};
use crate::settings::Settings;
use crate::trajectory::egress::Egress;
use crate::trajectory::evaluate::{self, Capture};
use crate::trajectory::images::Exposed;
use crate::trajectory::limits::Limits;
use crate::trajectory::plan::{Camera, Metrics, Plan, SceneStamp, StopReason, Waypoint};
use crate::trajectory::profile::Profile;
use crate::trajectory::record::Record;
use crate::trajectory::route::{Found, Route};
use crate::trajectory::safety;
use crate::trajectory::{images, select};

pub use en_route::EnRoute;
pub use options::{MOST_BUDGET_S, Method, Objective, PlanError, PlanOptions};

pub use crate::search::Progress;
pub use crate::stop::StopToken;

/// The rig that a method really flies: oblique photography puts lenses of its own on the rig's sensors. With [`Settings::with_sight`] of it a
/// field sees as far as its cameras.
pub fn flown_rig(options: &PlanOptions, settings: &Settings) -> Rig {
    match options.method {
        Method::Oblique => baseline::oblique::adapted_rig(&options.rig, &settings.baseline),
        _ => options.rig.clone(),
    }
}

/// Plans one flight on a snapshot. A stop of the token ends the search with the best plan so far; only when the token is abandoned
/// there is none.
pub fn plan(
    snapshot: &Snapshot,
    settings: &Settings,
    options: &PlanOptions,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Plan, PlanError> {
    replan(snapshot, settings, options, None, stop, on_progress, &mut |_| {}).map(|made| made.plan)
}

/// A plan, and what its images see: with it the plan after an edit is sooner there.
#[derive(Debug)]
pub struct Made {
    pub plan: Plan,
    pub record: Record,
}

/// The same after an edit: where it goes on with an earlier flight (`options.earlier`), what can still be flown of that is handed out as a plan
/// before anything is searched, and from time to time what is better than that. The record of that flight changes nothing but the time that
/// this takes.
pub fn replan(
    snapshot: &Snapshot,
    settings: &Settings,
    options: &PlanOptions,
    record: Option<Record>,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
    on_interim: &mut dyn FnMut(Made),
) -> Result<Made, PlanError> {
    options.check()?;
    let settings = &with_goal(settings, options.goal_percent);
    let rig = &flown_rig(options, settings);
    let captured = options.en_route.as_ref().map_or_else(Arc::default, |en_route| Arc::clone(&en_route.captured));
    let wanted = Wanted { region: options.region()?, gsd_m: options.gsd_m, most_apart_m: None, captured };
    let (settings, most_apart_m) = &overlap::with_overlap(settings, snapshot, rig, options, &wanted)?;
    let wanted = Wanted { most_apart_m: *most_apart_m, ..wanted };
    let sight_m = wanted.sight_m(rig, snapshot.disks.range_m());
    let reach = record.as_ref().and_then(|record| record.reach_before(snapshot, rig, sight_m));
    let problem = Problem::after(snapshot, settings, rig.clone(), &wanted, reach);
    if problem.capturable == 0 {
        let (range_m, ceiling_m) = (problem.disks.range_m(), settings.flight.legal_ceiling_m);
        return Err(PlanError::NothingCapturable { rig: rig.name.clone(), range_m, ceiling_m });
    }
    let matched_goal_percent = matched_goal_percent(settings, options);
    let mut order = Order { snapshot, settings, options, problem: &problem, matched_goal_percent, stop, departure: None };
    if let Some(en_route) = &options.en_route {
        order.departure = Some(order.depart(en_route)?);
    }
    let resumed = order.resumed();
    let mut interim = Interim { order: &order, best: None, on_interim };
    if let Some(path) = &resumed {
        match order.on_the_way(path, StopReason::Repaired, record) {
            Ok(made) => interim.offer(made),
            Err(PlanError::Abandoned) => return Err(PlanError::Abandoned),
            // It may still be improved to a plan.
            Err(_) => {}
        }
    }
    let found = match options.method {
        Method::Refined => refined(&order, resumed, &mut interim, on_progress)?,
        Method::Paper => {
            let iterations = options.iterations.unwrap_or(settings.search.iterations);
            Found::of(order.tree_search(iterations, on_progress)?, &problem)
        }
        Method::Oblique => baseline::oblique::fly(&problem, &settings.baseline, stop, on_progress)?,
        Method::Smith => baseline::smith::fly(&problem, &settings.baseline, options.seed, stop, on_progress)?,
        Method::Zhou => baseline::zhou::fly(&problem, &settings.baseline, options.seed, stop, on_progress)?,
    };
    order.finished(found, None)
}

/// Flights that are handed out while the search goes on.
struct Interim<'i> {
    order: &'i Order<'i>,
    /// What the best of them is worth.
    best: Option<Confirmed>,
    on_interim: &'i mut dyn FnMut(Made),
}

impl Interim<'_> {
    /// Hands a flight out if it is short enough and better than all before.
    fn offer(&mut self, made: Made) {
        let Order { options, problem, matched_goal_percent, .. } = *self.order;
        let confirmed = made.confirmed(problem);
        if self.order.within_s().is_some_and(|within_s| confirmed.duration_s > within_s) {
            return;
        }
        let required = Worth { captured: problem.sufficient, matched: problem.enough_matched(matched_goal_percent) };
        let is_better = |best: &Confirmed| {
            let counted = |one: &Confirmed| one.worth.counted(required).sum();
            let rank = |one: &Confirmed, other: &Confirmed| counted(one).cmp(&counted(other));
            // Within a time the most counts, beyond the goals too; else the shortest of those that come as near to the goals.
            match options.within_s {
                Some(_) => confirmed.worth.sum() > best.worth.sum(),
                None => rank(&confirmed, best).then(best.duration_s.total_cmp(&confirmed.duration_s)).is_gt(),
            }
        };
        if self.best.as_ref().is_none_or(is_better) {
            self.best = Some(confirmed);
            (self.on_interim)(made);
        }
    }

    /// What a path is worth. While an earlier flight is gone on with, one that is better than what was handed out is.
    fn confirmed(&mut self, path: &[Pose]) -> Confirmed {
        let order = self.order;
        if self.best.is_none() {
            return order.confirmed(path);
        }
        match order.on_the_way(&headed(&order.problem.rig, path), StopReason::Improved, None) {
            Ok(made) => {
                let Confirmed { worth, duration_s } = made.confirmed(order.problem);
                self.offer(made);
                Confirmed { worth, duration_s: duration_s - order.before_s() }
            }
            Err(_) => order.confirmed(path),
        }
    }
}

impl Made {
    fn confirmed(&self, problem: &Problem) -> Confirmed {
        let Capture { captured, matched, .. } = self.record.capture(problem);
        Confirmed { worth: Worth { captured, matched }, duration_s: self.plan.metrics.profile_s }
    }
}

/// What a flight is planned by.
struct Order<'o> {
    snapshot: &'o Snapshot,
    settings: &'o Settings,
    options: &'o PlanOptions,
    problem: &'o Problem<'o>,
    matched_goal_percent: f64,
    stop: &'o StopToken,
    /// How a flight leaves an aircraft's pose, for one that is in the air already.
    departure: Option<Departure>,
}

impl Order<'_> {
    /// The plan of a flight that is not the last one.
    fn on_the_way(&self, path: &[Pose], stop: StopReason, before: Option<Record>) -> Result<Made, PlanError> {
        let outcome = Outcome { path: path.to_vec(), convergence: Vec::new(), stop };
        self.finished(Found::of(outcome, self.problem), before)
    }

    /// The plan of a flight that was found: its curve, its images and what they capture, checked for safety. With the record of the flight
    /// before an edit only what may have changed is looked at.
    fn finished(&self, Found { route, convergence, stop: reason }: Found, before: Option<Record>) -> Result<Made, PlanError> {
        let Self { snapshot, settings, options, problem, matched_goal_percent, stop, ref departure } = *self;
        let rig = &problem.rig;
        let route = self.whole_route(route);
        let (limits, deviations_m, profile) = self.timed(&route.waypoints);
        let Exposed { mut images, delayed, dropped } = images::expose(&route, rig, &profile);
        let record = match before {
            Some(before) => before.after(snapshot, problem, &images, stop),
            None => Record::new(snapshot, problem, &images, stop),
        };
        let record = record.ok_or(PlanError::Abandoned)?;
        let capture = record.capture(problem);
        // Which images are dispensable takes longer to find out than a flight on the way may wait.
        if !matches!(reason, StopReason::Repaired | StopReason::Improved) {
            let enough = problem.enough_matched(matched_goal_percent);
            let selected = select::select(problem, record.sightings(), images.len(), enough);
            images.iter_mut().zip(selected).for_each(|(image, selected)| image.selected = selected);
        }
        let egress = departure.as_ref().map_or_else(Egress::default, |departure| departure.egress);
        egress.check(&profile.curve().waypoints, &limits, &snapshot.free)?;
        let clearance_m = safety::check_behind(profile.curve(), egress.legs(), &snapshot.free)?;
        // What belongs to no leg: the views at the start, or what was captured before a flight that begins in the air.
        let at_start = match departure {
            None => record.information_at_start(problem),
            Some(_) => problem.captured_information(),
        };
        safety::check_views(rig, &images)?;
        let blur_px = images::blur_px(&images, rig, &profile, &snapshot.free.clearance);
        let figures = metrics(problem, settings, &route, &profile, &capture, at_start);
        let waypoint =
            |(pose, &deviation_m): (&Pose, &f64)| Waypoint { position_m: pose.position, direction: pose.direction, deviation_m };

        let plan = Plan {
            scene: SceneStamp {
                name: snapshot.scene.name.clone(),
                origin: snapshot.scene.frame.origin,
                revision: snapshot.revision,
            },
            seed: options.seed,
            rig: rig.name.clone(),
            method: options.method.name().to_owned(),
            cameras: Camera::all_of(rig),
            metrics: Metrics { delayed_exposures: delayed, dropped_exposures: dropped, blur_px, ..figures },
            limits: Some(limits),
            waypoints: route.waypoints.iter().zip(&deviations_m).map(waypoint).collect(),
            images,
            cells: capture.cells,
            ceilings: problem.ceilings.clone(),
            goal_percent: settings.coverage.goal_percent,
            matched_goal_percent,
            egress,
            clearance_m,
            convergence,
            stop: reason,
        };
        Ok(Made { plan, record })
    }

    /// What can still be flown of an earlier flight, for the methods whose images are all along the path.
    fn resumed(&self) -> Option<Vec<Pose>> {
        let Self { options, problem, .. } = *self;
        let earlier = options.earlier.as_ref().filter(|_| matches!(options.method, Method::Refined | Method::Paper))?;
        let path = match &self.departure {
            None => resume::resumed(problem, earlier, options.start_m.is_some())?,
            Some(departure) => {
                let from_start: Vec<Pose> = std::iter::once(departure.start()).chain(earlier.iter().copied()).collect();
                departure.landed(problem, &resume::resumed(problem, &from_start, true)?)?
            }
        };
        Some(headed(&problem.rig, &path))
    }

    /// The paper's own method: a random tree, and the best path in it.
    fn tree_search(&self, iterations: u32, on_progress: &mut dyn FnMut(&Progress)) -> Result<Outcome, PlanError> {
        let Self { options, problem, stop, .. } = *self;
        let start = match &self.departure {
            None => start_pose(problem, options, stop)?,
            Some(departure) => departure.start(),
        };
        let confirm = |path: &[Pose]| self.confirmed(path).worth.captured;
        Ok(search(problem, start, iterations, options.seed, stop, &confirm, on_progress)?)
    }

    /// What a finished path is really worth, by exact rays from its images; of a flight that begins in the air the part that is searched.
    fn confirmed(&self, path: &[Pose]) -> Confirmed {
        let Self { snapshot, problem, stop, .. } = *self;
        let route = self.whole_route(Route::continuous(path, &problem.rig, problem.spacing));
        let (_, _, profile) = self.timed(&route.waypoints);
        let Exposed { images, .. } = images::expose(&route, &problem.rig, &profile);
        let worth = evaluate::sightings(snapshot, &problem.disks, &images, stop).map_or(Worth::default(), |sightings| {
            let Capture { captured, matched, .. } = sightings.capture(problem, |_| true);
            Worth { captured, matched }
        });
        Confirmed { worth, duration_s: profile.duration_s() - self.before_s() }
    }

    /// Time until the part of the flight begins that is searched, s.
    fn before_s(&self) -> f64 {
        self.departure.as_ref().map_or(0.0, Departure::stops_s)
    }

    /// The profile of the curve that is flown, with all that comes before the part of it that is searched.
    fn profile(&self, path: &[Pose]) -> Profile {
        match &self.departure {
            None => self.timed(path).2,
            Some(departure) => self.timed(&departure.whole(path)).2,
        }
    }

    /// A whole path as it is flown: its limits, how far the arcs may pass from the corners, m, and its profile.
    fn timed(&self, path: &[Pose]) -> (Limits, Vec<f64>, Profile) {
        let mut limits = Limits::new(&self.problem.rig, &self.settings.flight, &self.settings.dynamics);
        let mut deviations_m = safety::deviations_m(path, &limits, &self.snapshot.free);
        if let Some(departure) = &self.departure {
            limits.entry_mps = departure.entry_mps();
            deviations_m = departure.stopped(deviations_m);
        }
        let profile = Profile::rounded(path, &limits, &deviations_m);
        (limits, deviations_m, profile)
    }

    fn whole_route(&self, route: Route) -> Route {
        match &self.departure {
            None => route,
            Some(departure) => departure.whole_route(route),
        }
    }

    /// The most time that the flight may take, s.
    fn within_s(&self) -> Option<f64> {
        let left_s = self.options.en_route.as_ref().and_then(|en_route| en_route.time_left_s);
        [self.options.within_s, left_s].into_iter().flatten().reduce(f64::min)
    }
}

fn with_goal(settings: &Settings, goal_percent: Option<f64>) -> Settings {
    let mut settings = settings.clone();
    settings.coverage.goal_percent = goal_percent.unwrap_or(settings.coverage.goal_percent);
    settings
}

/// The goal for matched samples, percent; 0 for methods and plans that have none.
fn matched_goal_percent(settings: &Settings, options: &PlanOptions) -> f64 {
    match (options.method, options.objective, options.within_s) {
        (Method::Refined, Objective::Time, None) => options.matched_percent.unwrap_or(settings.coverage.goal_percent),
        _ => 0.0,
    }
}

/// Beyond the paper: a small tree, or an earlier flight, that is then improved until it covers enough, and until enough samples are matched if that
/// is wanted.
fn refined(
    order: &Order,
    resumed: Option<Vec<Pose>>,
    interim: &mut Interim,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Found, PlanError> {
    let Order { settings, options, problem, matched_goal_percent, stop, .. } = *order;
    let matched = problem.enough_matched(matched_goal_percent);
    let rounds = options.iterations.unwrap_or_else(|| refine::rounds_of(settings, problem));
    let budget = match (options.budget_s, stop.elapsed_s()) {
        (None, _) => Budget::Rounds(rounds),
        (Some(seconds), Some(begun_s)) => Budget::Until(begun_s + seconds),
        (Some(_), None) => return Err(PlanError::NoClock),
    };
    // More than no share would be a sample: who asks for none gets none.
    let captured = if settings.coverage.goal_percent > 0.0 { problem.sufficient } else { 0 };
    let counting = match (captured, matched) {
        (_, 0) => Counting::Captured,
        (0, _) => Counting::MatchedAlone,
        _ => Counting::Matched,
    };
    let required = Worth { captured, matched };
    let left_s = order.departure.as_ref().and_then(Departure::search_left_s);
    let within_ns = |within_s: f64| (within_s * 1e9) as u64;
    let (aim, counting) = match (options.objective, options.within_s, left_s) {
        (Objective::Eq6, ..) => (Aim::MostObjective, Counting::Everything),
        (Objective::Time, Some(within_s), left_s) => {
            let within_s = left_s.map_or(within_s, |left_s| within_s.min(left_s));
            (Aim::MostCoverage { within_ns: within_ns(within_s) }, Counting::Captured)
        }
        (Objective::Time, None, Some(left_s)) => (Aim::LeastTimeWithin { required, within_ns: within_ns(left_s) }, counting),
        (Objective::Time, None, None) => (Aim::LeastTime { required }, counting),
    };
    let mut ground = Ground::new(problem, settings, options.start_m.is_some(), counting);
    let home = order.departure.as_ref().map(|departure| order.way_home(departure)).transpose()?;
    if let Some(departure) = &order.departure {
        (ground.fixed, ground.takes_at_ends) = (departure.fixed(), departure.takes_at_ends());
        ground.limits.entry_mps = departure.search_entry_mps();
    }
    let is_resumed = resumed.is_some();
    let path = match resumed {
        Some(path) => path,
        None => {
            let mut tree = order.tree_search(settings.refine.tree_iterations, &mut |_| {})?;
            if let Some((departure, home)) = order.departure.as_ref().zip(home.as_ref()) {
                tree.path = departure.landed(problem, &tree.path).unwrap_or_else(|| home.clone());
            }
            if tree.path.len() < 2 {
                // One view may capture enough; it never matches anything.
                if matched > 0 && tree.stop == StopReason::GoalReached {
                    tree.stop = StopReason::IterationsUsed;
                }
                return Ok(Found::of(tree, problem));
            }
            tree.path
        }
    };
    let task = Task { aim, budget, seed: options.seed, is_resumed };
    let mut outcome = refine::refine(&ground, &path, &task, stop, &mut |path| interim.confirmed(path), on_progress);
    if let Some(within_s) = order.within_s() {
        let least_s = order.profile(&outcome.path).duration_s();
        match home {
            _ if least_s <= within_s => {}
            // Whatever else there is not the time for: there is for this.
            Some(home) if order.profile(&home).duration_s() <= within_s => outcome.path = headed(&problem.rig, &home),
            _ => return Err(PlanError::TooShort { within_s, least_s }),
        }
    }
    Ok(Found::of(outcome, problem))
}

/// The given start if it is safe, else the viewpoint; the given view, else the direction: whatever alone captures the most information,
/// so that the tree begins where there is something to see.
fn start_pose(problem: &Problem, options: &PlanOptions, stop: &StopToken) -> Result<Pose, PlanError> {
    if let Some(position) = options.start_m
        && let Some(cause) = problem.free.obstruction_at(&position)
    {
        let position = format!("{}, {}, {}", position.x, position.y, position.z);
        return Err(PlanError::Start { position, cause });
    }
    let positions = match options.start_m {
        Some(position) => vec![position],
        None => problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect(),
    };
    let directions = options.start_view.map_or_else(|| problem.rig.pose_directions(), |view| vec![Some(view)]);
    let alone = |(index, position): (usize, &Point3<f64>)| {
        let gains = (!stop.is_abandoned()).then(|| gains_alone(problem, *position, &directions))?;
        // Of equal gains the first one.
        let (direction, gain) = gains.into_iter().enumerate().rev().max_by_key(|&(_, gain)| gain)?;
        Some((gain, std::cmp::Reverse(index), direction))
    };
    let best = positions.par_iter().enumerate().map(alone).collect::<Option<Vec<_>>>().ok_or(PlanError::Abandoned)?;
    let (_, index, direction) = best.into_iter().max().expect("there is a position");
    Ok(Pose { position: positions[index.0], direction: directions[direction] })
}

/// The direction in which a camera on a gimbal gains most by itself at a position; of equal ones the first.
fn best_direction(problem: &Problem, position: &Point3<f64>) -> Unit<Vector3<f64>> {
    let directions = problem.rig.pose_directions();
    let gains = gains_alone(problem, *position, &directions);
    let best = gains.into_iter().enumerate().rev().max_by_key(|&(_, gain)| gain);
    best.and_then(|(index, _)| directions[index]).unwrap_or(-Vector3::z_axis())
}

/// What a view in each direction gains by itself at a position.
fn gains_alone(problem: &Problem, position: Point3<f64>, directions: &[Option<Unit<Vector3<f64>>>]) -> Vec<Information> {
    let (mut targets, mut worths) = (Targets::default(), Vec::new());
    for (i, mask) in problem.sighted(&position) {
        targets.push(&problem.frames[i].position);
        worths.push(u64::from(mask.count_ones()) * problem.areas_mm2[i]);
    }
    let gain = |&direction: &Option<Unit<Vector3<f64>>>| {
        let frusta = problem.rig.frusta(&Pose { position, direction });
        let mut marks = vec![frusta.is_none(); worths.len()];
        frusta.iter().flatten().for_each(|view| view.mark_framed(&targets, &mut marks));
        worths.iter().zip(marks).filter(|(_, is_framed)| *is_framed).map(|(worth, _)| worth).sum()
    };
    directions.iter().map(gain).collect()
}

fn metrics(
    problem: &Problem,
    settings: &Settings,
    route: &Route,
    profile: &Profile,
    capture: &Capture,
    at_start: Information,
) -> Metrics {
    // Eq. 6 sums from k = 2: what the views at the start see belongs to no leg.
    let path = PathSums { information: capture.information - at_start, ..problem.objective.travel(&route.waypoints) };
    let movement_s = path.length_m / settings.flight.cruise_speed_mps;
    Metrics {
        length_m: path.length_m,
        movement_s,
        turning_s: path.turning_s,
        flight_s: movement_s + path.turning_s,
        profile_s: profile.duration_s(),
        battery_percent: problem.rig.battery.map(|battery| battery.percent(movement_s, path.turning_s)),
        coverage_percent: capture.coverage_percent,
        coverage_exposed_percent: capture.coverage_exposed_percent,
        capturable_percent: capture.capturable_percent,
        matched_percent: capture.matched_percent,
        information: problem.objective.gain(capture.information),
        objective: problem.objective.value(&path),
        ..Metrics::default()
    }
}
