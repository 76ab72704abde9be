//! A first flight of a search that will take long: people look at it while a better one is searched.

use super::in_process::Planned;
use crate::planner::{self, Method, Objective, PlanOptions};
use crate::session::Snapshot;
use crate::settings::Settings;
use crate::trajectory::plan::{Plan, StopReason};

/// How long is searched for it, s: with reading, the field of a district and the files it is on the disk within three seconds.
const SEARCH_S: f64 = 1.5;

/// A round takes about so long for each sample, s (Intel Xeon, two cores); it only decides whether there is a first flight.
const ROUND_S: f64 = 30e-6;
/// Nobody minds waiting so long for the flight that was asked for, s.
const WAITED_S: f64 = 20.0;

/// What a reader of a page has to know, if it shows a first flight.
pub fn note(planned: &Planned) -> Option<String> {
    let follows = match planned.plan.stop {
        StopReason::Cancelled => "The search was ended before there was a better one.",
        _ => "The search goes on; the flight that it ends with takes the place of this one.",
    };
    planned.is_first.then(|| format!("This is a first look, found in a second or two. {follows}"))
}

/// How to search for a first flight, where nobody has said how long the search is to take and that will be long.
pub fn options(options: &PlanOptions, snapshot: &Snapshot, settings: &Settings) -> Option<PlanOptions> {
    // What is flown for most coverage within a time has no end to hold it against.
    let is_to_goal = options.method == Method::Refined && options.objective == Objective::Time && options.within_s.is_none();
    let is_open = is_to_goal && options.iterations.is_none() && options.budget_s.is_none();
    let field = snapshot.field();
    let search_s = f64::from(planner::rounds_of(settings, field.facts)) * field.samples.len() as f64 * ROUND_S;
    (is_open && search_s > WAITED_S).then(|| PlanOptions { budget_s: Some(SEARCH_S), ..options.clone() })
}

/// The better one of a first flight and the one that the search ended with; only one that was ended early may be worse.
pub fn better(first: Planned, last: Planned) -> Planned {
    let is_kept = last.plan.stop == StopReason::Cancelled && is_better(&first.plan, &last.plan);
    if is_kept { ended(first) } else { last }
}

/// A first flight as the plan of a search that was ended early.
pub fn ended(first: Planned) -> Planned {
    Planned { plan: Plan { stop: StopReason::Cancelled, ..first.plan }, ..first }
}

/// Whether a flight captures enough where the other one does not, or does the same in less time; where neither captures enough, the one that captures more.
fn is_better(one: &Plan, other: &Plan) -> bool {
    let lack_percent = |plan: &Plan| {
        let Plan { goal_percent, matched_goal_percent, metrics, .. } = plan;
        (goal_percent - metrics.coverage_percent).max(0.0) + (matched_goal_percent - metrics.matched_percent).max(0.0)
    };
    let standing = |plan: &Plan| [lack_percent(plan), plan.metrics.profile_s];
    standing(one) < standing(other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission::fixture;

    fn plan(coverage_percent: f64, profile_s: f64) -> Plan {
        let mut plan = fixture::plan("panoramic", &[[0.0, 0.0, 30.0], [40.0, 0.0, 30.0]]);
        plan.goal_percent = 95.0;
        (plan.metrics.coverage_percent, plan.metrics.profile_s) = (coverage_percent, profile_s);
        plan
    }

    #[test]
    fn enough_comes_before_time_and_time_before_more_than_enough() {
        let is_better = |one: (f64, f64), other: (f64, f64)| super::is_better(&plan(one.0, one.1), &plan(other.0, other.1));
        assert!(is_better((95.0, 900.0), (94.0, 100.0)));
        assert!(is_better((95.1, 700.0), (99.0, 800.0)) && !is_better((99.0, 800.0), (95.1, 700.0)));
        assert!(is_better((90.0, 900.0), (80.0, 100.0)));
        assert!(!is_better((95.0, 700.0), (95.0, 700.0)));
    }
}
