//! What the colours and symbols mean, north and scale.

use overfly_table::FieldTable;
use svg::node::element::{Definitions, Group, LinearGradient, Stop};

use super::charts;
use super::colour::{self, HEIGHT, Ramp, SHARE, TIME};
use super::heading::minutes;
use super::pen::{self, Anchor, Place};
use super::sheet::{self, DRAWING_TOP, LEGEND_WIDTH, Sheet};
use super::{top_view, views};
use crate::trajectory::plan::Plan;

const BAR_HEIGHT: f64 = 14.0;

/// The gradients that the legend refers to.
pub fn gradients() -> Definitions {
    Definitions::new().add(gradient("ramp-time", &TIME)).add(gradient("ramp-height", &HEIGHT)).add(gradient("ramp-share", &SHARE))
}

/// A ramp that fills what refers to `id`.
pub fn gradient(id: &str, ramp: &Ramp) -> LinearGradient {
    let stops = ramp.stops().map(|(offset, colour)| {
        Stop::new().set("offset", format!("{}%", pen::rounded(offset * 100.0))).set("stop-color", colour)
    });
    stops.fold(LinearGradient::new().set("id", id), LinearGradient::add)
}

/// Draws the column to the right of the views.
pub fn draw(sheet: &Sheet, field: &FieldTable, plan: &Plan) -> Group {
    let left = sheet.legend_left;
    let tallest_m = field.facts.max_m[2].max(1.0);
    let flight_s = plan.metrics.profile_s;
    let times = time_ticks(flight_s).into_iter().map(|time_s| (time_s / flight_s.max(1e-9), minutes(time_s)));
    let heights = sheet::round_ticks(0.0, tallest_m, tallest_m / 6.0);
    let heights = heights.into_iter().map(|height_m| (height_m / tallest_m, format!("{height_m:.0}")));
    let shares = [0.0, 25.0, 50.0, 75.0, 100.0].into_iter().map(|percent| (percent / 100.0, format!("{percent:.0}")));
    let has_squares = top_view::has_roof_squares(sheet, field);
    let height_title = if has_squares { "Height of a building, m" } else { "Height of a building in the side view, m" };
    // A method that does not iterate has no curve and leaves no gap.
    let below_symbols = DRAWING_TOP + 510.0;
    let shares_top = if charts::has_convergence(plan) { below_symbols + 230.0 } else { below_symbols };
    pen::group("legend")
        .add(ramp([left, DRAWING_TOP], "Time along the flight, min:s", "ramp-time", times))
        .add(ramp([left, DRAWING_TOP + 82.0], height_title, "ramp-height", heights))
        .add(ramp([left, DRAWING_TOP + 164.0], "Captured share of a wall or roof, %", "ramp-share", shares))
        .add(symbols(sheet, plan, has_squares, [left, DRAWING_TOP + 254.0]))
        .add(north([left + LEGEND_WIDTH - 14.0, DRAWING_TOP + 270.0]))
        .add(charts::convergence([left, below_symbols], plan))
        .add(charts::covered_shares([left, shares_top], field, plan))
}

/// The scale bar, under the west end of the top view.
pub fn scale_bar(sheet: &Sheet) -> Group {
    let metres = sheet::round_up(0.15 * (sheet.max.x - sheet.min.x));
    let width = metres * sheet.pixels_per_m;
    let (left, top) = (sheet.top_view.left, sheet.top_view.bottom() + 38.0);
    let mut group = pen::group("scale-bar").set("data-metres", metres);
    for (quarter, fill) in [colour::INK, colour::PAPER, colour::INK, colour::PAPER].into_iter().enumerate() {
        let corner = [left + width * quarter as f64 / 4.0, top];
        group = group.add(pen::rectangle(corner, [width / 4.0, 6.0], fill).set("stroke", colour::INK).set("stroke-width", 1));
    }
    group.add(pen::text([left + width + 10.0, top + 7.5], 13.0, Anchor::Start, &format!("{metres} m")))
}

/// The heading of a part of the legend.
pub fn heading(place: Place, content: &str) -> svg::node::element::Text {
    pen::text(place, 13.0, Anchor::Start, content).set("font-weight", 600)
}

/// Round times up to `flight_s`, at most six, so that their labels stand clear of each other, s.
fn time_ticks(flight_s: f64) -> Vec<f64> {
    const STEPS_S: [f64; 13] = [1.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0];
    let step_s =
        STEPS_S.into_iter().find(|step_s| flight_s <= 5.0 * step_s).unwrap_or_else(|| 3600.0 * (flight_s / 18_000.0).ceil());
    (0..=(flight_s / step_s) as u32).map(|tick| f64::from(tick) * step_s).collect()
}

/// A horizontal ramp with labels at shares of its width.
pub fn ramp(place: Place, title: &str, gradient: &str, labels: impl Iterator<Item = (f64, String)>) -> Group {
    let [left, top] = place;
    let bar = pen::rectangle([left, top + 20.0], [LEGEND_WIDTH, BAR_HEIGHT], &format!("url(#{gradient})"));
    let mut group =
        Group::new().add(heading([left, top + 10.0], title)).add(bar.set("stroke", colour::OUTLINE).set("stroke-width", 0.7));
    let bottom = top + 20.0 + BAR_HEIGHT;
    for (share, label) in labels {
        let anchor = match share {
            share if share < 0.03 => Anchor::Start,
            share if share > 0.97 => Anchor::End,
            _ => Anchor::Middle,
        };
        let x = left + LEGEND_WIDTH * share;
        group = group.add(pen::line([x, bottom], [x, bottom + 4.0], colour::OUTLINE, 0.7)).add(pen::quiet_text(
            [x, bottom + 17.0],
            12.0,
            anchor,
            &label,
        ));
    }
    group
}

fn symbols(sheet: &Sheet, plan: &Plan, has_squares: bool, place: Place) -> Group {
    let [left, top] = place;
    let middle = left + 14.0;
    let has_views = views::are_shown(plan);
    let row = |index: usize| top + index as f64 * 29.0;
    // Below the images stands one row more where there are views.
    let lower = |index: usize| row(index + usize::from(has_views));
    let flown = ["start and end of the flight", "waypoint", "image (thinned where dense)"];
    let view = has_views.then_some("view; short where it looks down");
    let built = [
        "wall, 0, 50 and 100 % captured",
        "wall that is not exposed",
        if has_squares { "roof, half captured" } else { "roof, 0, 50 and 100 % captured" },
        "sample that no admissible",
    ];
    let labels = flown.into_iter().chain(view).chain(built);
    let roofs = match has_squares {
        true => Group::new().add(top_view::roof_marker([middle, lower(5)], 0.5)),
        false => filled_roofs([left + 2.0, lower(5)]),
    };
    let mut group = Group::new()
        .add(top_view::end_marker([left + 6.0, row(0)], "S"))
        .add(top_view::end_marker([left + 24.0, row(0)], "E"))
        .add(top_view::waypoint_marker([middle, row(1)], sheet.mark_scale()))
        .add(top_view::image_dots(&[[middle, row(2)]], sheet.mark_scale()))
        .add(walls_by_share(sheet, [left + 2.0, lower(3)]))
        .add(pen::line([left + 2.0, lower(4)], [left + 30.0, lower(4)], colour::OUTLINE, 0.7))
        .add(roofs)
        .add(pen::dots([[middle - 5.0, lower(6)], [middle, lower(6)], [middle + 5.0, lower(6)]], 2.6, colour::BEYOND_REACH))
        .add(pen::text([left + 42.0, lower(6) + 21.5], 13.0, Anchor::Start, "view of the rig captures"));
    if has_views {
        group = group.add(views::wedge([left + 4.0, row(3)], [1.0, 0.0], 0.45, 1.0));
    }
    for (index, label) in labels.enumerate() {
        group = group.add(pen::text([left + 42.0, row(index) + 4.5], 13.0, Anchor::Start, label));
    }
    group
}

/// Three short walls, as they stand in the top view.
fn walls_by_share(sheet: &Sheet, place: Place) -> Group {
    let [left, y] = place;
    let width = top_view::wall_width(sheet).max(2.0);
    [0.0, 0.5, 1.0].into_iter().enumerate().fold(Group::new(), |group, (index, share)| {
        let (from, to) = ([left + 11.0 * index as f64, y], [left + 11.0 * index as f64 + 8.0, y]);
        group.add(pen::line(from, to, colour::WALL_CASING, width + 2.0 * top_view::wall_edge(sheet))).add(pen::line(
            from,
            to,
            &SHARE.at(share),
            width,
        ))
    })
}

fn filled_roofs(place: Place) -> Group {
    let [left, y] = place;
    [0.0, 0.5, 1.0].into_iter().enumerate().fold(Group::new(), |group, (index, share)| {
        let roof = pen::rectangle([left + 11.0 * index as f64, y - 4.0], [8.0, 8.0], &SHARE.at(share));
        group.add(roof.set("stroke", colour::OUTLINE).set("stroke-width", 0.7))
    })
}

/// The arrow to the north.
pub fn north(place: Place) -> Group {
    let [x, y] = place;
    let half = |side: f64| pen::ring([[x, y - 22.0], [x + side * 9.0, y + 16.0], [x, y + 9.0]]);
    let shape = |data: String, fill: &str| {
        svg::node::element::Path::new()
            .set("d", data)
            .set("fill", fill)
            .set("stroke", colour::INK)
            .set("stroke-width", 1)
            .set("stroke-linejoin", "round")
    };
    pen::group("north")
        .add(shape(half(-1.0), colour::INK))
        .add(shape(half(1.0), colour::PAPER))
        .add(pen::text([x, y + 34.0], 14.0, Anchor::Middle, "N").set("font-weight", 700))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_marked_in_round_steps_that_leave_room_for_their_labels() {
        assert_eq!(time_ticks(0.0), [0.0]);
        assert_eq!(time_ticks(131.0), [0.0, 30.0, 60.0, 90.0, 120.0]);
        assert_eq!(time_ticks(2423.0), [0.0, 600.0, 1200.0, 1800.0, 2400.0]);
        assert_eq!(time_ticks(4155.0), [0.0, 900.0, 1800.0, 2700.0, 3600.0]);
        assert!(time_ticks(1e6).len() <= 6);
    }
}
