//! How soon the flight after an edit is as good as one that is planned from nothing, in this process; and how soon a search that is not wanted any more ends.

use std::sync::Arc;
use std::time::{Duration, Instant};

use geo::{LineString, Polygon};
use serde_json::json;

use super::{Report, Row, field, given, quantile};
use crate::cli::answer::Form;
use crate::cli::arguments::BenchArgs;
use crate::cli::failure::Failure;
use crate::cli::in_process;
use crate::cli::progress::Meter;
use crate::planner::{self, Conduct, Made, Method, PlanError, PlanOptions, Progress, StopToken};
use crate::scene::edit::Edit;
use crate::session::{Session, Snapshot};
use crate::settings::{MOST_ITERATIONS, Settings};
use crate::trajectory::plan::Plan;

/// A flight is as good as another that takes this share of its time or more.
const AS_GOOD: f64 = 1.03;

/// Half the width of a pillar, and how far it rises above the flight, m.
const HALF_WIDTH_M: f64 = 1.0;
const ABOVE_M: f64 = 1.0;

/// Rounds of the refinement before the first edit, and after each the share of them.
const ROUNDS: u32 = 480;
const SHARE_AFTER: u32 = 4;

/// Cold plans that one is compared with, each with a seed of its own: one alone may be shorter than the next by a tenth.
const COLD_PLANS: u64 = 3;

/// Searches are cancelled after times that follow one another in such steps, up to the longest, ms: while they begin, mend and anneal.
const CANCELLED_STEP_MS: u64 = 211;
const CANCELLED_MOST_MS: u64 = 1500;

pub fn run(arguments: &BenchArgs, form: Form) -> Result<Report, Failure> {
    let (rig, settings) = given(arguments)?;
    let stop = StopToken::default();
    let mut meter = Meter::new(form);
    meter.stage("the first flight");
    let (scene, _) = in_process::read_scene(&arguments.file, &settings)?;
    let mut session = Session::new(scene, Arc::clone(&settings), &stop)?;
    let mut snapshot = session.survey(&stop)?.into_snapshot(&stop)?;
    let rounds = arguments.iterations.unwrap_or(ROUNDS);
    let options = PlanOptions { iterations: Some(rounds), ..PlanOptions::new(rig, Method::Refined, 1) };
    let mut made = planner::replan(&snapshot, &settings, &options, None, Conduct::unheard(&stop))?;
    let rounds_after = rounds.div_ceil(SHARE_AFTER);
    let mut rows: [Vec<f64>; 5] = Default::default();
    let [as_good_s, whole_s, cold_s, first_ratio, ratio] = &mut rows;
    let (mut never, mut searched) = (0, rounds);
    for number in 0..arguments.repeat {
        meter.stage(&format!("edit {} of {}", number + 1, arguments.repeat));
        session.apply(&pillar(number, &made.plan)).map_err(|error| Failure::Unexpected(error.to_string()))?;
        let started = Instant::now();
        let next = session.survey_after(&snapshot, &stop)?.into_snapshot(&stop)?;
        let again = PlanOptions { earlier: Some(made.plan.poses()), iterations: Some(rounds_after), ..options.clone() };
        let (mut offered, mut done) = (Vec::new(), 0);
        let on_interim = &mut |made: Made| offered.push(Offer::new(&started, &made.plan));
        let on_progress = &mut |_: &Progress| done += 1;
        let conduct = Conduct { on_progress, on_interim, ..Conduct::unheard(&stop) };
        let warm = planner::replan(&next, &settings, &again, Some(made.record), conduct)?;
        whole_s.push(started.elapsed().as_secs_f64());
        offered.push(Offer::new(&started, &warm.plan));
        searched = searched.saturating_add(done).min(MOST_ITERATIONS);
        let cold = cold(&next, &settings, &PlanOptions { iterations: Some(searched), ..options.clone() }, cold_s)?;
        // An edit after which no flight is as good counts as endless.
        let as_good = offered.iter().find(|offer| offer.standing.is_as_good_as(&cold));
        never += u32::from(as_good.is_none());
        as_good_s.push(as_good.map_or(f64::INFINITY, |offer| offer.at_s));
        first_ratio.extend(offered.first().map(|offer| offer.standing.profile_s / cold.profile_s));
        ratio.push(warm.plan.metrics.profile_s / cold.profile_s);
        (snapshot, made) = (next, warm);
    }
    // Searches from nothing and those that go on with a flight, in turns.
    let resumed = PlanOptions { earlier: Some(made.plan.poses()), ..options.clone() };
    let cancelled_ms = cancelled_ms(arguments, &snapshot, &settings, [&options, &resumed])?;
    drop(meter);
    let mut facts = field::facts(&snapshot.field(), arguments.repeat);
    facts.extend([
        ("rig", json!(options.rig.name)),
        ("rounds", json!(rounds)),
        ("images of the last plan", json!(made.plan.images.len())),
        ("captured percent", json!(made.plan.metrics.coverage_percent)),
        ("after each edit", json!(rounds_after)),
        ("never as good", json!(never)),
    ]);
    let [as_good_s, whole_s, cold_s, first_ratio, ratio] = rows;
    let goal = "goal 0.3 (delfshaven, nihonbashi), 1 (marunouchi), 5 (tokyo-2km)";
    Ok(Report {
        figures: Vec::new(),
        facts,
        rows: vec![
            Row { step: "edit to within 3 % of a cold plan's time, at its coverage", unit: "s", values: as_good_s, limit: goal },
            Row { step: "edit to last plan", unit: "s", values: whole_s, limit: "" },
            Row { step: "cold plan of as many rounds as the flight has had", unit: "s", values: cold_s, limit: "" },
            Row { step: "time of the first flight over that of cold ones", unit: "", values: first_ratio, limit: "" },
            Row { step: "time of the last flight over that of cold ones", unit: "", values: ratio, limit: "" },
            Row { step: "cancelled search ends", unit: "ms", values: cancelled_ms, limit: "goal 10" },
        ],
    })
}

/// A plan that was handed out after an edit.
struct Offer {
    /// Since the edit, s.
    at_s: f64,
    standing: Standing,
}

impl Offer {
    fn new(started: &Instant, plan: &Plan) -> Self {
        Self { at_s: started.elapsed().as_secs_f64(), standing: Standing::of(plan) }
    }
}

/// What flights are compared by.
struct Standing {
    profile_s: f64,
    /// Of what was asked for no more than that counts, percent.
    coverage_percent: f64,
    matched_percent: f64,
}

impl Standing {
    fn of(plan: &Plan) -> Self {
        let Plan { metrics, goal_percent, matched_goal_percent, .. } = plan;
        Self {
            profile_s: metrics.profile_s,
            coverage_percent: metrics.coverage_percent.min(*goal_percent),
            matched_percent: metrics.matched_percent.min(*matched_goal_percent),
        }
    }

    /// Whether a flight takes no longer, but for 3 %, and captures no less.
    fn is_as_good_as(&self, other: &Self) -> bool {
        self.profile_s <= AS_GOOD * other.profile_s
            && self.coverage_percent >= other.coverage_percent
            && self.matched_percent >= other.matched_percent
    }
}

/// The median of what plans from nothing are worth, figure by figure; adds how long each has taken to `cold_s`.
fn cold(snapshot: &Snapshot, settings: &Settings, options: &PlanOptions, cold_s: &mut Vec<f64>) -> Result<Standing, PlanError> {
    let mut plans = Vec::new();
    for seed in 1..=COLD_PLANS {
        let begun = Instant::now();
        let options = PlanOptions { seed, ..options.clone() };
        plans.push(Standing::of(&planner::plan(snapshot, settings, &options, &StopToken::default(), &mut |_| {})?));
        cold_s.push(begun.elapsed().as_secs_f64());
    }
    let median = |figure: fn(&Standing) -> f64| quantile(&plans.iter().map(figure).collect::<Vec<f64>>(), 0.5);
    Ok(Standing {
        profile_s: median(|plan| plan.profile_s),
        coverage_percent: median(|plan| plan.coverage_percent),
        matched_percent: median(|plan| plan.matched_percent),
    })
}

/// A pillar that reaches through the middle of a leg; of another leg each time.
fn pillar(number: u32, plan: &Plan) -> Edit {
    let leg = (number as usize * 7 + 3) % (plan.waypoints.len() - 1).max(1);
    let place = |k: usize| plan.waypoints[k.min(plan.waypoints.len() - 1)].position_m;
    let middle = nalgebra::center(&place(leg), &place(leg + 1));
    let corner = |dx: f64, dy: f64| (middle.x + dx * HALF_WIDTH_M, middle.y + dy * HALF_WIDTH_M);
    let ring = LineString::from(vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    Edit::add_prism(format!("bench-pillar-{number}"), Polygon::new(ring, Vec::new()), 0.0, middle.z + ABOVE_M)
}

/// How long a search goes on after it was abandoned, ms.
fn cancelled_ms(
    arguments: &BenchArgs,
    snapshot: &Snapshot,
    settings: &Settings,
    searches: [&PlanOptions; 2],
) -> Result<Vec<f64>, Failure> {
    let endless = searches.map(|options| PlanOptions { iterations: Some(MOST_ITERATIONS), ..options.clone() });
    let mut ended_ms = Vec::new();
    for (number, endless) in (1..).zip(endless.iter().cycle()).take(2 * arguments.repeat as usize) {
        let stop = StopToken::default();
        let ended = std::thread::scope(|scope| {
            let search = scope.spawn(|| {
                let plan = planner::plan(snapshot, settings, endless, &stop, &mut |_| {});
                (plan.is_err(), Instant::now())
            });
            std::thread::sleep(Duration::from_millis(number * CANCELLED_STEP_MS % CANCELLED_MOST_MS));
            let asked = Instant::now();
            stop.abandon();
            search.join().map(|(is_given_up, ended)| ended.checked_duration_since(asked).filter(|_| is_given_up))
        });
        match ended {
            Ok(Some(after)) => ended_ms.push(after.as_secs_f64() * 1e3),
            Ok(None) => return Err(Failure::Unexpected("a search ended before it was cancelled".to_owned())),
            Err(_) => return Err(Failure::Unexpected("a search that was to be cancelled panicked".to_owned())),
        }
    }
    Ok(ended_ms)
}
