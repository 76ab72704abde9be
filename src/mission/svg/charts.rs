//! Two small charts under the legend: how the search converged, and how well the samples are covered.

use overfly_table::FieldTable;
use svg::node::element::Group;

use super::colour::{self, SHARE};
use super::legend::heading;
use super::pen::{self, Anchor, Place};
use super::sheet::LEGEND_WIDTH;
use crate::trajectory::plan::{Iteration, Plan};

/// Room for the labels of the vertical axes.
const AXIS: f64 = 30.0;
const HEIGHT: f64 = 150.0;
/// Bars over the range of covered shares.
const BARS: usize = 25;

/// Coverage of the best path after each iteration, with the goal.
pub fn convergence(place: Place, plan: &Plan) -> Group {
    let [left, top] = place;
    let (chart_top, chart_height) = (top + 24.0, HEIGHT);
    let group = pen::group("convergence");
    if plan.convergence.len() < 2 {
        return group;
    }
    let at = |percent: f64| chart_top + chart_height * (1.0 - percent.clamp(0.0, 100.0) / 100.0);
    let mut group = group.add(heading([left, top + 10.0], "Coverage by iteration, %"));
    for percent in [0.0, 25.0, 50.0, 75.0, 100.0] {
        group = group
            .add(pen::line([left + AXIS, at(percent)], [left + LEGEND_WIDTH, at(percent)], colour::GRID, 1.0))
            .add(pen::quiet_text([left + 22.0, at(percent) + 4.0], 12.0, Anchor::End, &format!("{percent:.0}")));
    }
    let last = plan.convergence.len() - 1;
    let width = LEGEND_WIDTH - AXIS;
    let across = |index: usize| left + AXIS + width * index as f64 / last as f64;
    let curve = shown(&plan.convergence).map(|(index, iteration)| [across(index), at(iteration.coverage_percent)]);
    let goal = pen::line([left + AXIS, at(plan.goal_percent)], [left + LEGEND_WIDTH, at(plan.goal_percent)], colour::INK, 1.0);
    let below = chart_top + chart_height + 18.0;
    group
        .add(goal.set("stroke-dasharray", "2 4"))
        .add(pen::stroke(pen::polyline(curve), &SHARE.at(0.8), 2.2))
        .add(pen::quiet_text([left + AXIS, below], 12.0, Anchor::Start, "1"))
        .add(pen::quiet_text([left + AXIS + width / 2.0, below], 12.0, Anchor::Middle, "iteration"))
        .add(pen::quiet_text([left + LEGEND_WIDTH, below], 12.0, Anchor::End, &(last + 1).to_string()))
}

/// Where the curve bends: an iteration that changes nothing between two equal ones needs no point.
fn shown(convergence: &[Iteration]) -> impl Iterator<Item = (usize, &Iteration)> {
    let level = |index: usize| convergence.get(index).map(|iteration| iteration.coverage_percent);
    convergence.iter().enumerate().filter(move |(index, _)| {
        let before = index.checked_sub(1).and_then(level);
        before != level(*index) || level(index + 1) != level(*index)
    })
}

/// How many exposed samples are covered how much: a bar per step of the covered share of the hemisphere (percent, cosine-weighted), with
/// the threshold above which a sample counts as captured.
pub fn covered_shares(place: Place, field: &FieldTable, plan: &Plan) -> Group {
    let [left, top] = place;
    let bars = histogram(field, &plan.cells);
    let tallest = bars.iter().copied().max().unwrap_or(0).max(1);
    let base = top + 24.0 + HEIGHT;
    let width = LEGEND_WIDTH - AXIS;
    let across = |percent: f64| left + AXIS + width * percent / 100.0;
    let threshold = 100.0 * f64::from(field.facts.threshold_cells) / f64::from(field.facts.hemisphere_cells.max(1));
    let mut group = pen::group("covered-shares").add(heading([left, top + 10.0], "Exposed samples by covered share, %"));
    for (index, count) in bars.iter().enumerate() {
        let (from, to) = (across(100.0 * index as f64 / BARS as f64), across(100.0 * (index + 1) as f64 / BARS as f64));
        let height = HEIGHT * *count as f64 / tallest as f64;
        let is_captured = (index as f64 + 0.5) * 100.0 / BARS as f64 > threshold;
        let fill = if is_captured { SHARE.at(0.8) } else { SHARE.at(0.3) };
        group = group.add(pen::rectangle([from, base - height], [to - from - 1.5, height], &fill));
    }
    for percent in [0.0, 25.0, 50.0, 75.0, 100.0] {
        let anchor = if percent < 100.0 { Anchor::Middle } else { Anchor::End };
        group = group.add(pen::quiet_text([across(percent), base + 18.0], 12.0, anchor, &format!("{percent:.0}")));
    }
    let mark = pen::line([across(threshold), base - HEIGHT], [across(threshold), base], colour::INK, 1.0);
    group
        .add(pen::line([left + AXIS, base], [left + LEGEND_WIDTH, base], colour::OUTLINE, 1.0))
        .add(mark.set("stroke-dasharray", "2 4"))
        .add(pen::quiet_text([left + AXIS - 8.0, base - HEIGHT + 10.0], 12.0, Anchor::End, &tallest.to_string()))
}

fn histogram(field: &FieldTable, cells: &[u16]) -> [usize; BARS] {
    let mut bars = [0; BARS];
    let all = f64::from(field.facts.hemisphere_cells.max(1));
    for (_, covered) in field.samples.iter().zip(cells).filter(|(sample, _)| sample.exposed == 1) {
        let index = (f64::from(*covered) / all * BARS as f64) as usize;
        bars[index.min(BARS - 1)] += 1;
    }
    bars
}
