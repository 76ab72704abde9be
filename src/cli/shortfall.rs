//! What is said of a plan that stays below its goal: how far, why, and what may come nearer.

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

/// The remark with the next step; `command` is what takes `--iterations`, as it is typed.
pub fn note(plan: &Plan, command: &str, heights: Option<&Heights>) -> Option<String> {
    if plan.stop == StopReason::GoalReached {
        return None;
    }
    let metrics = &plan.metrics;
    let advice = if plan.stop == StopReason::Complete {
        format!("the method {:?} does not search for a goal, `--method paper` does", plan.method)
    } else if is_rising(plan) {
        let wanted = 4 * plan.convergence.len().max(100);
        format!("coverage was still rising, so more iterations come nearer (`{command} --iterations {wanted}`)")
    } else {
        "coverage hardly rose at the end, so a smaller weight of turning comes nearer (`objective.alpha_t` in the file of `--config`)"
            .to_owned()
    };
    let mut note = format!(
        "note: the plan captures {:.1} % of the capturable samples, the goal is {:.1} %; {advice}",
        metrics.coverage_percent, plan.goal_percent
    );
    let too_high =
        heights.filter(|heights| metrics.capturable_percent < LOW_CEILING && heights.tallest_m > heights.highest_view_m);
    if let Some(heights) = too_high {
        let ceiling = match heights.legal_ceiling_m {
            Some(ceiling_m) => format!("the legal ceiling is {ceiling_m:.0} m (`flight.legal_ceiling_m`)"),
            None => format!("the highest view is at {:.0} m (`flight.legal_ceiling_m` limits it)", heights.highest_view_m),
        };
        note.push_str(&format!(
            "\nnote: {:.1} % of the exposed surface lies beyond reach; structures rise to {:.0} m, {ceiling}",
            100.0 - metrics.capturable_percent,
            heights.tallest_m
        ));
    }
    Some(note)
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
