//! The view from the south, under the top view and to the same scale: heights of the structures and of the flight.

use overfly_table::FieldTable;
use overfly_table::field::StructureRow;
use svg::node::element::Group;

use super::colour::{self, HEIGHT};
use super::flight::Instant;
use super::pen::{self, Anchor};
use super::sheet::{self, Sheet};
use super::top_view;
use crate::trajectory::plan::Plan;

/// Draws the whole side view.
pub fn draw(sheet: &Sheet, field: &FieldTable, plan: &Plan, path: &[Instant]) -> Group {
    pen::group("side-view")
        .add(axes(sheet))
        .add(buildings(sheet, field))
        .add(top_view::flight(path, plan, 0.75, |point| sheet.seen_from_south(point.x, point.z)))
}

fn axes(sheet: &Sheet) -> Group {
    let frame = &sheet.side_view;
    let mut group = Group::new()
        .add(pen::rectangle([frame.left, frame.top], [frame.width, frame.height], colour::GROUND).set("stroke", colour::HAIRLINE))
        .add(pen::text([frame.left, frame.top - 10.0], 14.0, Anchor::Start, "Side view, looking north").set("font-weight", 600))
        .add(pen::quiet_text([frame.right(), frame.top - 10.0], 12.0, Anchor::End, "height above ground, m"));
    for z_m in sheet::round_ticks(sheet.min.z, sheet.max.z, 34.0 / sheet.pixels_per_m) {
        let [_, y] = sheet.seen_from_south(0.0, z_m);
        group = group.add(pen::line([frame.left, y], [frame.right(), y], colour::GRID, 1.0)).add(pen::quiet_text(
            [frame.left - 8.0, y + 4.0],
            12.0,
            Anchor::End,
            &format!("{z_m:.0}"),
        ));
    }
    let [_, ground] = sheet.seen_from_south(0.0, 0.0);
    group.add(pen::line([frame.left, ground], [frame.right(), ground], colour::OUTLINE, 1.4))
}

/// Far structures first; near ones stand before them.
fn buildings(sheet: &Sheet, field: &FieldTable) -> Group {
    let tallest_m = field.facts.max_m[2].max(1.0);
    let mut boxes: Vec<(&StructureRow, Extent)> =
        field.structures.iter().filter_map(|structure| Some((structure, extent(field, structure)?))).collect();
    boxes.sort_by(|(_, a), (_, b)| b.south_m.total_cmp(&a.south_m));
    boxes.into_iter().fold(Group::new(), |group, (structure, extent)| {
        let [left, top] = sheet.seen_from_south(extent.west_m, structure.top_m);
        let [right, bottom] = sheet.seen_from_south(extent.east_m, structure.base_m);
        let shape = pen::rectangle([left, top], [right - left, bottom - top], &HEIGHT.at(structure.top_m / tallest_m))
            .set("stroke", colour::OUTLINE)
            .set("stroke-width", 0.7);
        group.add(pen::titled(shape, &format!("{}: {:.1} m", field.name(structure), structure.top_m)))
    })
}

struct Extent {
    west_m: f64,
    east_m: f64,
    south_m: f64,
}

fn extent(field: &FieldTable, structure: &StructureRow) -> Option<Extent> {
    let mut points = field.outline(structure).flatten();
    let [x, y] = *points.next()?;
    let first = Extent { west_m: x, east_m: x, south_m: y };
    Some(points.fold(first, |extent, [x, y]| Extent {
        west_m: extent.west_m.min(*x),
        east_m: extent.east_m.max(*x),
        south_m: extent.south_m.min(*y),
    }))
}
