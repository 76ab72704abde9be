//! The view from above: outlines by height, walls and roofs by captured share, the path by time.

use nalgebra::Point3;
use overfly_table::FieldTable;
use overfly_table::field::{PointRow, StructureRow};
use svg::node::element::{Element, Group, Path};

use super::colour::{self, HEIGHT, SHARE, TIME};
use super::flight::{Instant, split_by_time};
use super::pen::{self, Anchor, Place};
use super::relief;
use super::sheet::{self, Sheet};
use super::thin;
use super::views;
use super::walls::{self, StructureTally};
use crate::scene::Terrain;
use crate::trajectory::plan::Plan;

/// Pieces of equal duration into which the coloured path is split.
pub const TIME_STEPS: usize = 96;
/// Steps of the share ramp: walls of one step are drawn as one path.
const SHARE_STEPS: usize = 20;
/// Images are left out until dots are this far apart, and samples beyond reach likewise, pixels.
const IMAGE_GAP: f64 = 6.0;
const BEYOND_REACH_GAP: f64 = 4.0;
/// Narrow side of the median roof from which on roofs carry squares, pixels.
const LEAST_ROOF: f64 = 18.0;

/// Draws the whole top view.
pub fn draw(
    sheet: &Sheet,
    field: &FieldTable,
    terrain: Option<&Terrain>,
    tallies: &[StructureTally],
    plan: &Plan,
    path: &[Instant],
) -> Group {
    let (ground, heights) = terrain.map(|terrain| relief::from_above(sheet, terrain).into()).unzip();
    let with = |group: Group, part: Option<Group>| part.into_iter().fold(group, Group::add);
    let group = with(pen::group("top-view").add(axes(sheet)), ground)
        .add(buildings(sheet, field, tallies))
        .add(wall_shares(sheet, field, tallies))
        .add(roof_shares(sheet, field, tallies));
    with(group, heights).add(beyond_reach(sheet, field, plan)).add(flight(sheet, plan, path))
}

/// The path by time with waypoints, images and both ends.
fn flight(sheet: &Sheet, plan: &Plan, path: &[Instant]) -> Group {
    let project = |point: &Point3<f64>| sheet.seen_from_above(point.x, point.y);
    let scale = sheet.mark_scale();
    let whole = pen::polyline(path.iter().map(|instant| project(&instant.position_m)));
    let mut coloured = Group::new();
    let pieces = split_by_time(path, TIME_STEPS);
    for (index, piece) in pieces.iter().enumerate() {
        let colour = TIME.at((index as f64 + 0.5) / pieces.len() as f64);
        coloured = coloured.add(pen::stroke(pen::polyline(piece.iter().map(project)), &colour, 2.4 * scale));
    }
    let corners: Vec<Place> = plan.waypoints.iter().map(|waypoint| project(&waypoint.position_m)).collect();
    let images = plan.images.iter().map(|image| project(&image.position_m));
    let images = thin::apart(images, corners.iter().copied(), IMAGE_GAP);
    let corners = corners.into_iter().map(|corner| waypoint_marker(corner, scale));
    Group::new()
        .set("class", "flight")
        .add(pen::stroke(whole, colour::PAPER, 4.4 * scale).set("stroke-opacity", 0.85))
        .add(coloured)
        .add(views::draw(sheet, plan))
        .add(image_dots(&images, scale))
        .add(corners.fold(Group::new().set("class", "waypoints"), Group::add))
        .add(ends(plan, &project))
}

/// Images as they stand on the path and in the legend: white with a dark edge, to be seen on every colour of the path.
pub fn image_dots(places: &[Place], scale: f64) -> Group {
    Group::new().set("class", "images").add(pen::dots(places.iter().copied(), 2.2 * scale + 1.0, colour::INK)).add(pen::dots(
        places.iter().copied(),
        2.2 * scale,
        colour::PAPER,
    ))
}

/// A marker with a letter, as it stands at the start and at the end of the flight and in the legend.
pub fn end_marker(place: Place, letter: &str) -> Group {
    Group::new().add(pen::circle(place, 9.0, colour::INK).set("stroke", colour::PAPER).set("stroke-width", 2)).add(
        pen::text([place[0], place[1] + 4.0], 11.5, Anchor::Middle, letter).set("fill", colour::PAPER).set("font-weight", 700),
    )
}

/// A waypoint as it stands on the path and in the legend.
pub fn waypoint_marker(place: Place, weight: f64) -> Element {
    pen::circle(place, 3.0 * weight, colour::PAPER)
        .set("stroke", colour::INK)
        .set("stroke-width", pen::rounded(1.2 * weight))
        .into()
}

/// How thick walls are drawn, pixels.
pub fn wall_width(sheet: &Sheet) -> f64 {
    (1.3 * sheet.pixels_per_m).clamp(1.0, 4.2)
}

/// How thick the dark outline on each side of a wall is, pixels: without it a wall that is not captured would look like a gap.
pub fn wall_edge(sheet: &Sheet) -> f64 {
    (0.4 * sheet.pixels_per_m).clamp(0.5, 1.0)
}

/// Whether the roofs of this sheet carry squares by share; on a large scene they would be larger than the roofs, which are filled by
/// share instead.
pub fn has_roof_squares(sheet: &Sheet, field: &FieldTable) -> bool {
    let mut sizes: Vec<f64> = field.structures.iter().map(|structure| narrow_side_m(field, structure)).collect();
    sizes.sort_by(f64::total_cmp);
    let median_m = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
    median_m * sheet.pixels_per_m >= LEAST_ROOF
}

/// The shorter side of the box around a structure's outline, m.
fn narrow_side_m(field: &FieldTable, structure: &StructureRow) -> f64 {
    let (mut min, mut max) = ([f64::MAX; 2], [f64::MIN; 2]);
    for [x, y] in field.outline(structure).flatten() {
        (min[0], min[1]) = (min[0].min(*x), min[1].min(*y));
        (max[0], max[1]) = (max[0].max(*x), max[1].max(*y));
    }
    (max[0] - min[0]).min(max[1] - min[1]).max(0.0)
}

/// Start and end of the flight.
pub fn ends(plan: &Plan, project: &impl Fn(&Point3<f64>) -> Place) -> Group {
    let (Some(first), Some(last)) = (plan.waypoints.first(), plan.waypoints.last()) else { return Group::new() };
    Group::new().add(end_marker(project(&last.position_m), "E")).add(end_marker(project(&first.position_m), "S"))
}

/// The frame of the view, with its grid in metres.
pub fn axes(sheet: &Sheet) -> Group {
    let frame = &sheet.top_view;
    let mut group = Group::new().add(
        pen::rectangle([frame.left, frame.top], [frame.width, frame.height], colour::GROUND).set("stroke", colour::HAIRLINE),
    );
    group = group
        .add(pen::text([frame.left, frame.top - 10.0], 14.0, Anchor::Start, "Top view").set("font-weight", 600))
        .add(pen::quiet_text([frame.right(), frame.top - 10.0], 12.0, Anchor::End, "east and north, m"));
    let gap_m = 90.0 / sheet.pixels_per_m;
    for x_m in sheet::round_ticks(sheet.min.x, sheet.max.x, gap_m) {
        let [x, _] = sheet.seen_from_above(x_m, 0.0);
        group = group.add(pen::line([x, frame.top], [x, frame.bottom()], colour::GRID, 1.0)).add(pen::quiet_text(
            [x, frame.bottom() + 18.0],
            12.0,
            Anchor::Middle,
            &format!("{x_m:.0}"),
        ));
    }
    for y_m in sheet::round_ticks(sheet.min.y, sheet.max.y, gap_m) {
        let [_, y] = sheet.seen_from_above(0.0, y_m);
        group = group.add(pen::line([frame.left, y], [frame.right(), y], colour::GRID, 1.0)).add(pen::quiet_text(
            [frame.left - 8.0, y + 4.0],
            12.0,
            Anchor::End,
            &format!("{y_m:.0}"),
        ));
    }
    group
}

/// Low structures first, so that a tower stands on its podium.
fn buildings(sheet: &Sheet, field: &FieldTable, tallies: &[StructureTally]) -> Group {
    let tallest_m = field.facts.max_m[2].max(1.0);
    let mut order: Vec<usize> = (0..field.structures.len()).collect();
    order.sort_by(|a, b| field.structures[*a].top_m.total_cmp(&field.structures[*b].top_m).then(a.cmp(b)));
    let has_squares = has_roof_squares(sheet, field);
    order.into_iter().fold(pen::group("buildings"), |group, index| {
        let structure = &field.structures[index];
        let fill = match (has_squares, tallies[index].roof.share()) {
            (true, _) => HEIGHT.at(structure.top_m / tallest_m),
            (false, Some(share)) => SHARE.at(share),
            (false, None) => colour::NOT_EXPOSED.to_owned(),
        };
        let shape = Path::new()
            .set("d", outline(sheet, field, structure))
            .set("fill", fill)
            .set("fill-rule", "evenodd")
            .set("stroke", colour::OUTLINE)
            .set("stroke-width", pen::rounded(0.7 * sheet.mark_scale()))
            .set("data-id", format!("{:016x}", structure.id));
        group.add(pen::titled(shape, &caption(field, structure, &tallies[index])))
    })
}

fn caption(field: &FieldTable, structure: &StructureRow, tally: &StructureTally) -> String {
    let percent = |share: Option<f64>| share.map_or("not exposed".to_owned(), |share| format!("{:.0} %", share * 100.0));
    format!(
        "{}: {:.1} m to {:.1} m; walls {}, roof {}",
        field.name(structure),
        structure.base_m,
        structure.top_m,
        percent(tally.all_walls().share()),
        percent(tally.roof.share())
    )
}

fn outline(sheet: &Sheet, field: &FieldTable, structure: &StructureRow) -> String {
    field.outline(structure).map(|ring| pen::ring(ring.iter().map(|[x, y]| sheet.seen_from_above(*x, *y)))).collect()
}

/// Every wall with exposed samples: a dark casing, and on it the colour of its captured share.
fn wall_shares(sheet: &Sheet, field: &FieldTable, tallies: &[StructureTally]) -> Group {
    let mut by_step = vec![String::new(); SHARE_STEPS + 1];
    let mut casing = String::new();
    for (structure, tally) in field.structures.iter().zip(tallies) {
        for (ring, walls) in field.outline(structure).zip(&tally.walls) {
            for (index, share) in walls.iter().enumerate().filter_map(|(index, wall)| Some((index, wall.share()?))) {
                let data = wall(sheet, ring, index);
                casing.push_str(&data);
                by_step[(share * SHARE_STEPS as f64).round() as usize].push_str(&data);
            }
        }
    }
    let width = wall_width(sheet);
    let mut group = pen::group("walls")
        .add(pen::stroke(casing, colour::WALL_CASING, width + 2.0 * wall_edge(sheet)).set("stroke-linecap", "butt"));
    for (step, data) in by_step.into_iter().enumerate().filter(|(_, data)| !data.is_empty()) {
        let share = step as f64 / SHARE_STEPS as f64;
        let shape = pen::stroke(data, &SHARE.at(share), width).set("stroke-linecap", "butt");
        group = group.add(shape.set("data-share-percent", pen::rounded(share * 100.0)));
    }
    group
}

fn wall(sheet: &Sheet, ring: &[PointRow], index: usize) -> String {
    let (from, to) = walls::edge(ring, index);
    pen::polyline([sheet.seen_from_above(from.x, from.y), sheet.seen_from_above(to.x, to.y)])
}

/// A square by share in the middle of each exposed roof, where roofs have room for it.
fn roof_shares(sheet: &Sheet, field: &FieldTable, tallies: &[StructureTally]) -> Group {
    if !has_roof_squares(sheet, field) {
        return pen::group("roofs");
    }
    field.structures.iter().enumerate().fold(pen::group("roofs"), |group, (index, structure)| {
        let (Some(share), Some(place)) = (tallies[index].roof.share(), roof_middle(sheet, field, index, structure)) else {
            return group;
        };
        group.add(roof_marker(place, share))
    })
}

/// A roof's captured share, as it stands on the roof and in the legend.
pub fn roof_marker(place: Place, share: f64) -> Element {
    pen::rectangle([place[0] - 3.0, place[1] - 3.0], [6.0, 6.0], &SHARE.at(share))
        .set("stroke", colour::WALL_CASING)
        .set("stroke-width", 0.8)
        .into()
}

/// The exposed roof sample nearest to the mean of all of them: it lies on the roof even where the mean falls into a courtyard.
fn roof_middle(sheet: &Sheet, field: &FieldTable, index: usize, structure: &StructureRow) -> Option<Place> {
    let range = structure.first_sample as usize..(structure.first_sample + structure.samples) as usize;
    let roof: Vec<Place> = field.samples[range]
        .iter()
        .filter(|sample| sample.structure as usize == index && sample.exposed == 1 && walls::is_roof(sample))
        .map(|sample| sheet.seen_from_above(sample.position_m[0], sample.position_m[1]))
        .collect();
    let count = roof.len() as f64;
    let mean = roof.iter().fold([0.0, 0.0], |sum, place| [sum[0] + place[0] / count, sum[1] + place[1] / count]);
    let distance = |place: &Place| (place[0] - mean[0]).powi(2) + (place[1] - mean[1]).powi(2);
    roof.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Exposed samples that no admissible view of the rig captures, thinned out where they would merge; those of walls stand a little outside of it.
fn beyond_reach(sheet: &Sheet, field: &FieldTable, plan: &Plan) -> Path {
    let offset = wall_width(sheet) / 2.0 + 2.6 * sheet.mark_scale();
    let places = field
        .samples
        .iter()
        .enumerate()
        .filter(|&(i, sample)| sample.exposed == 1 && !plan.is_capturable(i, field.facts.threshold_cells))
        .map(|(_, sample)| {
            let [x, y] = sheet.seen_from_above(sample.position_m[0], sample.position_m[1]);
            [x + sample.normal[0] * offset, y - sample.normal[1] * offset]
        });
    let places = thin::apart(places, [], BEYOND_REACH_GAP);
    pen::dots(places, (2.4 * sheet.mark_scale()).max(1.4), colour::BEYOND_REACH).set("id", "beyond-reach")
}
