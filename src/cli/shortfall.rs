//! What is said of a plan that stays below its goal, or asks for more than a battery: how far, why, and what may come nearer.

use overfly_table::FieldTable;

use crate::trajectory::plan::{Plan, StopReason};

/// A rise of coverage in the last quarter of the search that promises more, points.
const STILL_RISING: f64 = 1.0;
/// A ceiling below this is worth a word, percent of the exposed samples.
const LOW_CEILING: f64 = 90.0;

/// How far up structures and views reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heights {
    pub tallest_m: f64,
    pub highest_view_m: f64,
    /// Where it is known: a daemon's settings are its own.
    pub legal_ceiling_m: Option<f64>,
}

impl Heights {
    pub fn of(field: &FieldTable, legal_ceiling_m: Option<f64>) -> Self {
        let highest_view_m = field.viewpoints.iter().map(|viewpoint| viewpoint.position_m[2]).fold(0.0, f64::max);
        Self { tallest_m: field.facts.max_m[2], highest_view_m, legal_ceiling_m }
    }
}

/// The remarks with the next steps; `command` is what takes `--iterations`, as it is typed.
/// `has_goal` is false for a plan that was to fly for a given time, or for the paper's objective.
pub fn note(plan: &Plan, command: &str, heights: Option<&Heights>, has_goal: bool) -> Option<String> {
    let notes: Vec<String> =
        [has_goal.then(|| below_goal(plan, command)).flatten(), low_ceiling(plan, heights), empty_battery(plan)]
            .into_iter()
            .flatten()
            .collect();
    (!notes.is_empty()).then(|| notes.join("\n"))
}

/// How far a plan stays below its goal, and what comes nearer.
fn below_goal(plan: &Plan, command: &str) -> Option<String> {
    if plan.stop == StopReason::GoalReached {
        return None;
    }
    let advice = if plan.stop == StopReason::Complete {
        format!("the method {:?} does not search for a goal, `--method refined` does", plan.method)
    } else if is_rising(plan) {
        let wanted = 4 * plan.convergence.len().max(100);
        format!("coverage was still rising, so more iterations come nearer (`{command} --iterations {wanted}`)")
    } else if plan.method == "refined" {
        let wanted = 4 * plan.convergence.len().max(100);
        format!("more rounds come nearer (`{command} --iterations {wanted}`), or the last samples cannot be reached safely")
    } else {
        "coverage hardly rose at the end, so smaller weights of turning and of efficiency come nearer (`objective.alpha_t`, `objective.eta` in the file of `--config`)"
            .to_owned()
    };
    let metrics = &plan.metrics;
    let mut note = format!(
        "note: the plan captures {:.1} % of the capturable samples, the goal is {:.1} %; ",
        metrics.coverage_percent, plan.goal_percent
    );
    if plan.matched_goal_percent > 0.0 && metrics.matched_percent <= plan.matched_goal_percent {
        note.push_str(&format!(
            "it sees {:.1} % in views that match, the goal is {:.1} % (`--matched`); ",
            metrics.matched_percent, plan.matched_goal_percent
        ));
    }
    Some(note + &advice)
}

/// What no plan can capture, whatever its length, and what would bring it within reach.
fn low_ceiling(plan: &Plan, heights: Option<&Heights>) -> Option<String> {
    let reachable = plan.metrics.capturable_percent;
    if reachable >= LOW_CEILING {
        return None;
    }
    let mut note = format!(
        "note: all admissible views of the rig {:?} together capture {reachable:.1} % of the exposed surface, so no plan captures more; a \
         lower `coverage.threshold_percent` asks for less",
        plan.rig
    );
    // Nothing sees more than a panorama does.
    if plan.cameras.iter().any(|camera| camera.intrinsics.is_some()) {
        note.push_str(", another rig may see more (`--rig`; `overfly rigs` lists some)");
    }
    if let Some(heights) = heights.filter(|heights| heights.tallest_m > heights.highest_view_m) {
        let ceiling = match heights.legal_ceiling_m {
            Some(ceiling_m) => format!("the legal ceiling is {ceiling_m:.0} m (`flight.legal_ceiling_m`)"),
            None => format!("the highest view is at {:.0} m (`flight.legal_ceiling_m` limits it)", heights.highest_view_m),
        };
        note.push_str(&format!("; structures rise to {:.0} m, {ceiling}", heights.tallest_m));
    }
    Some(note)
}

/// A flight that no full battery lasts for.
fn empty_battery(plan: &Plan) -> Option<String> {
    let percent = plan.metrics.battery_percent.filter(|percent| *percent > 100.0)?;
    Some(format!(
        "note: the flight draws {percent:.0} % of a full battery of the rig {:?}, so it needs {:.0} of them, with landings in \
         between",
        plan.rig,
        (percent / 100.0).ceil()
    ))
}

/// Whether the last quarter of the iterations still brought something; a search of a few iterations has only begun.
fn is_rising(plan: &Plan) -> bool {
    let count = plan.convergence.len();
    if count < 8 {
        return true;
    }
    let coverage = |index: usize| plan.convergence[index].coverage_percent;
    coverage(count - 1) - coverage(count - 1 - count / 4) > STILL_RISING
}
