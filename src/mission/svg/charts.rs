//! Two small charts under the legend: how the search converged, and how well the samples are covered.

use overfly_table::FieldTable;
use svg::node::element::Group;

use super::colour::{self, SHARE};
use super::legend::heading;
use super::pen::{self, Anchor, Place};
use super::sheet::{self, LEGEND_WIDTH};
use crate::trajectory::plan::{Iteration, Plan};

/// Room for the labels of the vertical axes.
const AXIS: f64 = 30.0;
const HEIGHT: f64 = 150.0;
/// Bars over the range of covered shares.
const BARS: usize = 25;

/// Whether there is a curve to draw.
pub fn has_convergence(plan: &Plan) -> bool {
    plan.convergence.len() > 1
}

/// Coverage of the best path after each iteration, with the goal.
pub fn convergence(place: Place, plan: &Plan) -> Group {
    let [left, top] = place;
    let (chart_top, chart_height) = (top + 24.0, HEIGHT);
    let group = pen::group("convergence");
    if !has_convergence(plan) {
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
    let steps = sheet::round_ticks(0.0, (last + 1) as f64, ((last + 1) as f64 / 5.0).max(1.0));
    for iteration in steps.into_iter().filter(|iteration| *iteration >= 1.0) {
        let x = across(iteration as usize - 1);
        let anchor = if x > left + LEGEND_WIDTH - 10.0 { Anchor::End } else { Anchor::Middle };
        group = group.add(pen::line([x, below - 18.0], [x, below - 14.0], colour::OUTLINE, 0.7)).add(pen::quiet_text(
            [x, below],
            12.0,
            anchor,
            &format!("{iteration:.0}"),
        ));
    }
    group.add(goal.set("stroke-dasharray", "2 4")).add(pen::stroke(pen::polyline(curve), &SHARE.at(0.8), 2.2))
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
    let (top_count, step) = count_axis(&bars);
    let base = top + 24.0 + HEIGHT;
    let width = LEGEND_WIDTH - AXIS;
    let across = |percent: f64| left + AXIS + width * percent / 100.0;
    let threshold = 100.0 * f64::from(field.facts.threshold_cells) / f64::from(field.facts.hemisphere_cells.max(1));
    let mut group = pen::group("covered-shares").add(heading([left, top + 10.0], "Exposed samples by covered share, %"));
    for count in (0..=top_count / step).map(|tick| tick * step) {
        let y = base - HEIGHT * count as f64 / top_count as f64;
        group = group.add(pen::line([left + AXIS, y], [left + LEGEND_WIDTH, y], colour::GRID, 1.0)).add(pen::quiet_text(
            [left + AXIS - 8.0, y + 4.0],
            12.0,
            Anchor::End,
            &count.to_string(),
        ));
    }
    for (index, count) in bars.iter().enumerate() {
        let (from, to) = (across(100.0 * index as f64 / BARS as f64), across(100.0 * (index + 1) as f64 / BARS as f64));
        let height = HEIGHT * (*count as f64 / top_count as f64).min(1.0);
        let is_captured = (index as f64 + 0.5) * 100.0 / BARS as f64 > threshold;
        let fill = if is_captured { SHARE.at(0.8) } else { SHARE.at(0.3) };
        group = group.add(pen::rectangle([from, base - height], [to - from - 1.5, height], &fill));
        if *count > top_count {
            group = group.add(cut([from, base - HEIGHT + 12.0], to - from - 1.5)).add(pen::quiet_text(
                [to + 2.0, base - HEIGHT + 10.0],
                12.0,
                Anchor::Start,
                &count.to_string(),
            ));
        }
    }
    for percent in [0.0, 25.0, 50.0, 75.0, 100.0] {
        let anchor = if percent < 100.0 { Anchor::Middle } else { Anchor::End };
        group = group.add(pen::quiet_text([across(percent), base + 18.0], 12.0, anchor, &format!("{percent:.0}")));
    }
    let mark = pen::line([across(threshold), base - HEIGHT], [across(threshold), base], colour::INK, 1.0);
    group
        .add(pen::line([left + AXIS, base], [left + LEGEND_WIDTH, base], colour::OUTLINE, 1.0))
        .add(mark.set("stroke-dasharray", "2 4"))
}

/// The highest count of the vertical axis and its step, both round. A first bar that dwarfs the others is cut off: samples that no image
/// sees at all are many on a plan that stays below its goal.
fn count_axis(bars: &[usize; BARS]) -> (usize, usize) {
    let others = bars[1..].iter().copied().max().unwrap_or(0);
    let tallest = if bars[0] > 2 * others && others > 0 { others } else { bars[0].max(others) }.max(1);
    let step = (sheet::round_up(tallest as f64 / 4.0).round() as usize).max(1);
    (tallest.div_ceil(step) * step, step)
}

/// The mark of a bar that is taller than the axis: a slanted gap.
fn cut(place: Place, width: f64) -> svg::node::element::Path {
    let [left, y] = place;
    pen::stroke(pen::polyline([[left - 3.0, y + 3.0], [left + width + 3.0, y - 3.0]]), colour::PAPER, 3.5)
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

#[cfg(test)]
mod tests {
    use super::*;

    fn bars(first: usize, others: usize) -> [usize; BARS] {
        let mut bars = [others; BARS];
        bars[0] = first;
        bars
    }

    #[test]
    fn the_axis_of_counts_is_round_and_holds_all_bars_but_a_first_one_that_dwarfs_them() {
        assert_eq!(count_axis(&bars(30, 37)), (40, 10));
        assert_eq!(count_axis(&bars(700, 37)), (40, 10));
        assert_eq!(count_axis(&bars(700, 0)), (800, 200));
        assert_eq!(count_axis(&bars(0, 0)), (1, 1));
    }
}
