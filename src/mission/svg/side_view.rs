//! The view from the south, under the top view and to the same scale: heights of the structures and of the flight.

use overfly_table::FieldTable;
use overfly_table::field::StructureRow;
use svg::node::element::Group;

use super::colour::{self, HEIGHT, TIME};
use super::flight::{Instant, split_by_time};
use super::pen::{self, Anchor};
use super::relief;
use super::sheet::{self, Sheet};
use super::top_view;
use crate::scene::{TERRAIN_NAME, Terrain};
use crate::trajectory::plan::Plan;

/// How far the farthest structure fades into the paper.
const MOST_PALE: f64 = 0.75;

/// Draws the whole side view.
pub fn draw(sheet: &Sheet, field: &FieldTable, terrain: Option<&Terrain>, plan: &Plan, path: &[Instant]) -> Group {
    let ground = terrain.map(|terrain| relief::from_south(sheet, terrain));
    let group = ground.into_iter().fold(pen::group("side-view").add(axes(sheet, field)), Group::add);
    group.add(buildings(sheet, field)).add(flight(sheet, plan, path))
}

fn axes(sheet: &Sheet, field: &FieldTable) -> Group {
    let frame = &sheet.side_view;
    // The terrain is the only structure without an outline.
    let has_terrain = field.structures.iter().any(|structure| structure.rings == 0 && field.name(structure) == TERRAIN_NAME);
    let heights = if has_terrain { "height above the lowest ground, m" } else { "height above ground, m" };
    let mut group = Group::new()
        .add(pen::rectangle([frame.left, frame.top], [frame.width, frame.height], colour::GROUND).set("stroke", colour::HAIRLINE))
        .add(pen::text([frame.left, frame.top - 10.0], 14.0, Anchor::Start, "Side view, looking north").set("font-weight", 600))
        .add(pen::quiet_text([frame.right(), frame.top - 10.0], 12.0, Anchor::End, heights));
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

/// The path by time alone: from the side its legs lie over each other, and marks on them would hide the heights. Only a narrow white
/// casing where the path stands before a structure sets it off.
fn flight(sheet: &Sheet, plan: &Plan, path: &[Instant]) -> Group {
    let project = |point: &nalgebra::Point3<f64>| sheet.seen_from_south(point.x, point.z);
    let width = 1.5 * sheet.mark_scale().max(0.55);
    let pieces = split_by_time(path, top_view::TIME_STEPS);
    let mut group = Group::new().set("class", "flight");
    for (index, piece) in pieces.iter().enumerate() {
        let colour = TIME.at((index as f64 + 0.5) / pieces.len() as f64);
        let data = pen::polyline(piece.iter().map(project));
        if index == 0 {
            let whole = pen::polyline(path.iter().map(|instant| project(&instant.position_m)));
            group = group.add(pen::stroke(whole, colour::PAPER, width + 1.2).set("stroke-opacity", 0.5));
        }
        group = group.add(pen::stroke(data, &colour, width).set("stroke-opacity", 0.85));
    }
    group.add(top_view::ends(plan, &project))
}

/// Far structures first and paler; near ones stand before them.
fn buildings(sheet: &Sheet, field: &FieldTable) -> Group {
    let tallest_m = field.facts.max_m[2].max(1.0);
    let mut boxes: Vec<(&StructureRow, Extent)> =
        field.structures.iter().filter_map(|structure| Some((structure, extent(field, structure)?))).collect();
    boxes.sort_by(|(_, a), (_, b)| b.south_m.total_cmp(&a.south_m));
    let depth_m = (field.facts.max_m[1] - field.facts.min_m[1]).max(1.0);
    boxes.into_iter().fold(Group::new(), |group, (structure, extent)| {
        let paleness = MOST_PALE * ((extent.south_m - field.facts.min_m[1]) / depth_m).clamp(0.0, 1.0);
        let [left, top] = sheet.seen_from_south(extent.west_m, structure.top_m);
        let [right, bottom] = sheet.seen_from_south(extent.east_m, structure.base_m);
        let shape =
            pen::rectangle([left, top], [right - left, bottom - top], &HEIGHT.paler(structure.top_m / tallest_m, paleness))
                .set("stroke", colour::mix_with_white(colour::OUTLINE, paleness))
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
