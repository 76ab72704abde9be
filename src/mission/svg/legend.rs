//! What the colours and symbols mean, north and scale.

use overfly_table::FieldTable;
use svg::node::element::{Definitions, Group, LinearGradient, Stop};

use super::charts;
use super::colour::{self, HEIGHT, Ramp, SHARE, TIME};
use super::heading::minutes;
use super::pen::{self, Anchor, Place};
use super::sheet::{self, DRAWING_TOP, LEGEND_WIDTH, Sheet};
use super::top_view;
use crate::trajectory::plan::Plan;

const BAR_HEIGHT: f64 = 14.0;

/// The gradients that the legend refers to.
pub fn gradients() -> Definitions {
    let gradient = |id: &str, ramp: &Ramp| {
        let stops = ramp.stops().map(|(offset, colour)| {
            Stop::new().set("offset", format!("{}%", pen::rounded(offset * 100.0))).set("stop-color", colour)
        });
        stops.fold(LinearGradient::new().set("id", id), LinearGradient::add)
    };
    Definitions::new().add(gradient("ramp-time", &TIME)).add(gradient("ramp-height", &HEIGHT)).add(gradient("ramp-share", &SHARE))
}

/// Draws the column to the right of the views.
pub fn draw(sheet: &Sheet, field: &FieldTable, plan: &Plan) -> Group {
    let left = sheet.legend_left;
    let tallest_m = field.facts.max_m[2].max(1.0);
    let flight_s = plan.metrics.flight_s;
    let quarters = [0.0, 0.25, 0.5, 0.75, 1.0];
    let times = quarters.map(|share| minutes(share * flight_s));
    let heights = quarters.map(|share| format!("{:.0}", share * tallest_m));
    let shares = quarters.map(|share| format!("{:.0}", share * 100.0));
    pen::group("legend")
        .add(ramp([left, DRAWING_TOP], "Time along the flight, min:s", "ramp-time", &times))
        .add(ramp([left, DRAWING_TOP + 82.0], "Height of a building, m", "ramp-height", &heights))
        .add(ramp([left, DRAWING_TOP + 164.0], "Captured share of a wall or roof, %", "ramp-share", &shares))
        .add(symbols(sheet, [left, DRAWING_TOP + 254.0]))
        .add(north([left + LEGEND_WIDTH - 26.0, DRAWING_TOP + 270.0]))
        .add(charts::convergence([left, DRAWING_TOP + 510.0], plan))
        .add(charts::covered_shares([left, DRAWING_TOP + 740.0], field, plan))
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

/// A horizontal ramp with labels at its quarters.
fn ramp(place: Place, title: &str, gradient: &str, labels: &[String; 5]) -> Group {
    let [left, top] = place;
    let bar = pen::rectangle([left, top + 20.0], [LEGEND_WIDTH, BAR_HEIGHT], &format!("url(#{gradient})"));
    let mut group =
        Group::new().add(heading([left, top + 10.0], title)).add(bar.set("stroke", colour::OUTLINE).set("stroke-width", 0.7));
    for (index, label) in labels.iter().enumerate() {
        let anchor = [Anchor::Start, Anchor::Middle, Anchor::Middle, Anchor::Middle, Anchor::End][index];
        let x = left + LEGEND_WIDTH * index as f64 / 4.0;
        group = group.add(pen::quiet_text([x, top + 20.0 + BAR_HEIGHT + 17.0], 12.0, anchor, label));
    }
    group
}

fn symbols(sheet: &Sheet, place: Place) -> Group {
    let [left, top] = place;
    let middle = left + 14.0;
    let row = |index: usize| top + index as f64 * 29.0;
    let width = top_view::wall_width(sheet);
    let wall = |y: f64, colour: &str, width: f64| pen::line([left + 2.0, y], [left + 26.0, y], colour, width);
    let labels = [
        "start and end of the flight",
        "waypoint",
        "image",
        "wall with samples, half captured",
        "wall that is not exposed",
        "roof, half captured",
        "sample that no admissible",
    ];
    let mut group = Group::new()
        .add(top_view::end_marker([left + 6.0, row(0)], "S"))
        .add(top_view::end_marker([left + 24.0, row(0)], "E"))
        .add(top_view::waypoint_marker([middle, row(1)], 1.0))
        .add(pen::dots([[middle, row(2)]], 2.6, colour::INK))
        .add(wall(row(3), colour::WALL_CASING, width + 1.4))
        .add(wall(row(3), &SHARE.at(0.5), width))
        .add(wall(row(4), colour::OUTLINE, 0.7))
        .add(top_view::roof_marker([middle, row(5)], 0.5))
        .add(pen::dots([[middle - 5.0, row(6)], [middle, row(6)], [middle + 5.0, row(6)]], 2.6, colour::BEYOND_REACH))
        .add(pen::text([left + 42.0, row(6) + 21.5], 13.0, Anchor::Start, "view captures"));
    for (index, label) in labels.into_iter().enumerate() {
        group = group.add(pen::text([left + 42.0, row(index) + 4.5], 13.0, Anchor::Start, label));
    }
    group
}

fn north(place: Place) -> Group {
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
