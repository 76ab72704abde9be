//! The whole pipeline on one screen.

pub mod en_route;
mod interim;
mod look;
mod options;
mod order;
mod overlap;
mod resume;
mod safe;
mod start;

use std::sync::Arc;

use rayon::ThreadPool;

use self::en_route::Departure;
use self::interim::Interim;
use self::order::{Before, Order};
use crate::baseline;
use crate::camera::{Pose, Rig};
use crate::field::Snapshot;
use crate::refine::{self, Aim, Budget, Counting, Ground, Task, Worth};
use crate::search::leg::headed;
use crate::search::{Problem, Wanted};
use crate::settings::Settings;
use crate::stop::free_behind;
use crate::trajectory::plan::{Plan, StopReason};
use crate::trajectory::record::Record;
use crate::trajectory::route::Found;

pub use en_route::EnRoute;
pub use look::look;
pub use options::{MOST_BUDGET_S, Method, Objective, PlanError, PlanOptions};
pub use safe::safe;

pub use crate::refine::rounds_of;
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
    on_progress: &mut (dyn FnMut(&Progress) + Send),
) -> Result<Plan, PlanError> {
    replan(snapshot, settings, options, None, Conduct { on_progress, ..Conduct::unheard(stop) }).map(|made| made.plan)
}

/// How a search goes along with everything else: how it is told to end, who hears of it, and on which threads it runs.
pub struct Conduct<'a> {
    pub stop: &'a StopToken,
    pub on_progress: &'a mut (dyn FnMut(&Progress) + Send),
    pub on_interim: &'a mut (dyn FnMut(Made) + Send),
    /// A search whose first safe plan is out runs on these, and they may stand back behind others; without any on the threads of the caller, as does one
    /// that has nothing to show yet.
    pub search_threads: Option<&'a ThreadPool>,
}

impl<'a> Conduct<'a> {
    /// Of a search that nobody hears of, on the threads of the caller.
    pub fn unheard(stop: &'a StopToken) -> Self {
        // Closures without a size take no memory.
        Self {
            stop,
            on_progress: Box::leak(Box::new(|_: &Progress| {})),
            on_interim: Box::leak(Box::new(|_| {})),
            search_threads: None,
        }
    }
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
    mut record: Option<Record>,
    conduct: Conduct,
) -> Result<Made, PlanError> {
    let Conduct { stop, on_progress, on_interim, search_threads } = conduct;
    let Ordered { settings, rig, wanted } = &ordered(snapshot, settings, options)?;
    let sight_m = wanted.sight_m(rig, snapshot.disks.range_m());
    let reach = record.as_ref().and_then(|record| record.reach_before(snapshot, rig, sight_m));
    let problem = Problem::after(snapshot, settings, rig.clone(), wanted, reach, stop);
    if stop.is_abandoned() {
        return Err(PlanError::Abandoned);
    }
    if problem.capturable == 0 {
        let (range_m, ceiling_m) = (problem.disks.range_m(), settings.flight.legal_ceiling_m);
        return Err(PlanError::NothingCapturable { rig: rig.name.clone(), range_m, ceiling_m });
    }
    let matched_goal_percent = matched_goal_percent(settings, options);
    let known = record.as_mut().and_then(|record| record.known(snapshot));
    let mut order = Order { snapshot, settings, options, problem: &problem, matched_goal_percent, stop, departure: None, known };
    if let Some(en_route) = &options.en_route {
        order.departure = Some(order.depart(en_route)?);
    }
    order.check_wanted()?;
    let resumed = order.resumed();
    order.check_wanted()?;
    let mut interim = Interim::new(&order, on_interim);
    if let Some(path) = &resumed {
        match order.on_the_way(path, StopReason::Repaired, record.map_or(Before::Nothing, Before::Edit)) {
            Ok(made) => interim.offer(path, made),
            Err(PlanError::Abandoned) => return Err(PlanError::Abandoned),
            // It may still be improved to a plan.
            Err(_) => {}
        }
    }
    let is_under_way = interim.has_handed_out();
    let search = || searched(&order, resumed, interim, on_progress);
    match search_threads.filter(|_| is_under_way) {
        Some(threads) => threads.install(search),
        None => search(),
    }
}

/// What options mean in a scene.
struct Ordered {
    settings: Settings,
    rig: Rig,
    wanted: Wanted,
}

fn ordered(snapshot: &Snapshot, settings: &Settings, options: &PlanOptions) -> Result<Ordered, PlanError> {
    options.check()?;
    let settings = with_goal(settings, options.goal_percent);
    let rig = flown_rig(options, &settings);
    let captured = options.en_route.as_ref().map_or_else(Arc::default, |en_route| Arc::clone(&en_route.captured));
    let wanted = Wanted { region: options.region()?, gsd_m: options.gsd_m, most_apart_m: None, captured };
    let (settings, most_apart_m) = overlap::with_overlap(&settings, snapshot, &rig, options, &wanted)?;
    Ok(Ordered { settings, rig, wanted: Wanted { most_apart_m, ..wanted } })
}

/// The plan that a method finds, or the best one that was handed out on the way.
fn searched(
    order: &Order,
    resumed: Option<Vec<Pose>>,
    mut interim: Interim,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Made, PlanError> {
    let Order { settings, options, problem, stop, .. } = *order;
    let found = match options.method {
        Method::Refined => {
            let found = refined(order, resumed, &mut interim, on_progress)?;
            return interim.last(order.finished(found, Before::Nothing)?);
        }
        Method::Paper => {
            let iterations = options.iterations.unwrap_or(settings.search.iterations);
            Found::of(order.tree_search(iterations, on_progress)?, problem)
        }
        Method::Oblique => baseline::oblique::fly(problem, &settings.baseline, stop, on_progress)?,
        Method::Smith => baseline::smith::fly(problem, &settings.baseline, options.seed, stop, on_progress)?,
        Method::Zhou => baseline::zhou::fly(problem, &settings.baseline, options.seed, stop, on_progress)?,
    };
    order.finished(found, Before::Nothing)
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
    let Order { settings, options, problem, stop, .. } = *order;
    let rounds = options.iterations.unwrap_or_else(|| rounds_of(settings, problem.field.facts));
    let budget = match (options.budget_s, stop.elapsed_s()) {
        (None, _) => Budget::Rounds(rounds),
        (Some(seconds), Some(begun_s)) => Budget::Until(begun_s + seconds),
        (Some(_), None) => return Err(PlanError::NoClock),
    };
    let required = order.required();
    let counting = match required {
        Worth { matched: 0, .. } => Counting::Captured,
        Worth { captured: 0, .. } => Counting::MatchedAlone,
        _ => Counting::Matched,
    };
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
    order.check_wanted()?;
    let mut ground = Ground::new(problem, settings, options.start_m.is_some(), counting, stop);
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
                if required.matched > 0 && tree.stop == StopReason::GoalReached {
                    tree.stop = StopReason::IterationsUsed;
                }
                return Ok(Found::of(tree, problem));
            }
            tree.path
        }
    };
    let differences = order.snapshot.changes().map(|changes| &changes.differences);
    let changed = differences.iter().flat_map(|differences| differences.boxes().chain(&differences.barred)).copied().collect();
    let task = Task { aim, budget, seed: options.seed, is_resumed, changed };
    let mut looked = None;
    let confirm =
        &mut |path: &[Pose]| if is_resumed { interim.confirmed(path) } else { order.confirmed_beside(path, &mut looked) };
    let mut outcome = refine::refine(&ground, &path, &task, confirm, on_progress);
    free_behind(looked);
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
