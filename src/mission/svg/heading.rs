//! Title and key figures, across the top of the sheet.

use svg::node::element::Group;

use super::colour;
use super::pen::{self, Anchor};
use super::sheet::{MARGIN, WIDTH};
use crate::trajectory::plan::{Plan, StopReason};

/// Draws title, subtitle and the row of key figures.
pub fn draw(plan: &Plan) -> Group {
    let subtitle = format!(
        "revision {} · rig {} · method {} · seed {} · {}",
        plan.scene.revision,
        plan.rig,
        plan.method,
        plan.seed,
        ending(plan)
    );
    banner(&plan.scene.name, &subtitle, &key_figures(plan))
}

/// Any title, subtitle and row of key figures.
pub fn banner(title: &str, subtitle: &str, figures: &[Figure]) -> Group {
    let mut group = pen::group("heading")
        .add(pen::text([MARGIN, 74.0], 30.0, Anchor::Start, &shortened(title)).set("font-weight", 700))
        .add(pen::quiet_text([MARGIN, 100.0], 15.0, Anchor::Start, subtitle))
        .add(pen::line([MARGIN, 122.0], [WIDTH - MARGIN, 122.0], colour::HAIRLINE, 1.0));
    let step = (WIDTH - 2.0 * MARGIN) / figures.len() as f64;
    for (index, figure) in figures.iter().enumerate() {
        let left = MARGIN + index as f64 * step;
        group = group
            .add(pen::quiet_text([left, 146.0], 12.0, Anchor::Start, figure.label))
            .add(pen::text([left, 175.0], 25.0, Anchor::Start, &figure.value).set("font-weight", 600))
            .add(pen::quiet_text([left, 195.0], 12.0, Anchor::Start, &figure.remark));
    }
    group
}

/// Minutes and seconds, rounded to the second.
pub fn minutes(time_s: f64) -> String {
    let seconds = time_s.max(0.0).round() as u64;
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

/// A key figure with what it is and a remark.
pub struct Figure {
    pub label: &'static str,
    pub value: String,
    pub remark: String,
}

fn key_figures(plan: &Plan) -> Vec<Figure> {
    let metrics = &plan.metrics;
    let figure = |label, value, remark| Figure { label, value, remark };
    let mut figures = vec![
        figure("Captured of capturable", percent(metrics.coverage_percent), format!("goal {}", percent(plan.goal_percent))),
        figure(
            "... of exposed",
            percent(metrics.coverage_exposed_percent),
            format!("ceiling {}", percent(metrics.capturable_percent)),
        ),
    ];
    if plan.matched_goal_percent > 0.0 {
        let goal = format!("goal {}", percent(plan.matched_goal_percent));
        figures.push(figure("In matched views", percent(metrics.matched_percent), goal));
    }
    figures.extend([
        figure("Length", format!("{:.0} m", metrics.length_m), image_spacing(plan)),
        figure("Flight time, min:s", minutes(metrics.profile_s), format!("Eq. 4 and 5: {}", minutes(metrics.flight_s))),
    ]);
    if let Some(battery_percent) = metrics.battery_percent {
        figures.push(figure("Battery", format!("{battery_percent:.0} %"), "of a full charge".to_owned()));
    }
    figures.extend([
        figure("Waypoints", plan.waypoints.len().to_string(), String::new()),
        figure("Images", plan.images.len().to_string(), format!("{} selected", plan.selected_images())),
        figure("Least clearance", format!("{:.1} m", plan.clearance_m), "over the whole curve".to_owned()),
    ]);
    figures
}

/// All cameras of a rig are released together.
fn image_spacing(plan: &Plan) -> String {
    let exposures = plan.images.len() / plan.cameras.len().max(1);
    if exposures < 2 { String::new() } else { format!("shutter every {:.1} m", plan.metrics.length_m / exposures as f64) }
}

fn percent(value: f64) -> String {
    format!("{value:.1} %")
}

fn ending(plan: &Plan) -> String {
    let noun = if plan.method == "refined" { "rounds" } else { "iterations" };
    let iterations = format!("{} {noun}", plan.convergence.len());
    match plan.stop {
        StopReason::GoalReached => format!("goal reached after {iterations}"),
        StopReason::IterationsUsed => format!("all {iterations} used"),
        StopReason::MemoryUsed => format!("memory used up after {iterations}"),
        StopReason::SpaceExhausted => format!("nothing more to reach after {iterations}"),
        StopReason::Safe => "safe after an edit, what it captures is not counted yet".to_owned(),
        StopReason::Repaired => "repaired after an edit, not improved yet".to_owned(),
        StopReason::Improved => "improved after an edit, the search goes on".to_owned(),
        StopReason::Complete => "the method is complete".to_owned(),
        StopReason::Cancelled => format!("stopped after {iterations}"),
    }
}

/// A name that fits on the sheet.
fn shortened(name: &str) -> String {
    const LONGEST: usize = 60;
    if name.chars().count() <= LONGEST {
        return name.to_owned();
    }
    let head: String = name.chars().take(LONGEST - 1).collect();
    format!("{head}…")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_rounded_before_it_is_split() {
        assert_eq!(minutes(59.6), "1:00");
        assert_eq!(minutes(0.0), "0:00");
        assert_eq!(minutes(3725.0), "62:05");
    }

    #[test]
    fn a_long_name_is_cut_between_characters() {
        assert_eq!(shortened(&"é".repeat(80)).chars().count(), 60);
    }
}
