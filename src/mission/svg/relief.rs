//! The ground where it is not flat: lines of one height in the view from above, and the ground from the lowest to the highest place at each easting in the one from
//! the south.

use std::collections::HashMap;

use svg::node::element::Group;

use super::colour;
use super::pen::{self, Anchor, Place};
use super::sheet::{self, Sheet};
use super::thin;
use crate::scene::Terrain;

/// Heights are looked up so far apart, pixels: no line is missed that could be told from its neighbours.
const STEP: f64 = 8.0;
/// There are no more lines than this, and they lie whole metres apart.
const LINES: f64 = 14.0;
/// Every so manyth line is bold. Numbers are this far apart, pixels.
const BOLD: i64 = 5;
const LABEL_GAP: f64 = 130.0;

/// Lines of one height, seen from above, and their numbers, which stand over the buildings.
pub fn from_above(sheet: &Sheet, terrain: &Terrain) -> [Group; 2] {
    let grid = Grid::over(sheet, terrain);
    let [lowest_m, highest_m] = grid.range_m();
    let apart_m = sheet::round_up(((highest_m - lowest_m) / LINES).max(1.0));
    let mut group = pen::group("relief").set("data-apart-m", apart_m);
    let mut labels = pen::group("relief-heights");
    let mut labelled: Vec<Place> = Vec::new();
    // Level ground at the lowest height has no line.
    for number in (lowest_m / apart_m).floor() as i64 + 1..=(highest_m / apart_m).floor() as i64 {
        let height_m = number as f64 * apart_m;
        let lines = grid.lines(height_m);
        let is_bold = number % BOLD == 0;
        let data: String = lines.iter().map(|line| pen::polyline(line.iter().copied())).collect();
        if data.is_empty() {
            continue;
        }
        let width = if is_bold { 1.5 } else { 0.8 };
        group = group.add(pen::stroke(data, colour::CONTOUR, width).set("data-height-m", height_m));
        // The middle of a line is seldom where it leaves the frame.
        let middles = lines.iter().filter(|line| line.len() > 8).map(|line| line[line.len() / 2]);
        for place in thin::apart(middles, labelled.iter().copied(), LABEL_GAP) {
            labelled.push(place);
            let text = || pen::text([place[0], place[1] + 3.5], 10.5, Anchor::Middle, &format!("{height_m:.0}"));
            // Not every viewer knows an order of stroke and filling.
            labels = labels
                .add(text().set("stroke", colour::GROUND).set("stroke-width", 3).set("stroke-linejoin", "round"))
                .add(text().set("fill", colour::CONTOUR_INK));
        }
    }
    [group, labels]
}

/// The ground from its lowest to its highest place at each easting, and what lies below.
pub fn from_south(sheet: &Sheet, terrain: &Terrain) -> Group {
    let grid = Grid::over(sheet, terrain);
    let column = |i: usize| (0..grid.rows).map(move |j| j * grid.columns + i);
    let of = |i: usize, pick: fn(f64, f64) -> f64| {
        let height_m = column(i).map(|at| grid.heights_m[at]).reduce(pick).unwrap_or(0.0);
        let x_m = sheet.min.x + i as f64 * grid.step_m;
        sheet.seen_from_south(x_m.min(sheet.max.x), height_m)
    };
    let highest: Vec<Place> = (0..grid.columns).map(|i| of(i, f64::max)).collect();
    let lowest: Vec<Place> = (0..grid.columns).map(|i| of(i, f64::min)).collect();
    let bottom = sheet.side_view.bottom();
    let ends = [[sheet.side_view.right(), bottom], [sheet.side_view.left, bottom]];
    let below = |line: &[Place]| pen::ring(line.iter().copied().chain(ends));
    let filled = |line: &[Place], fill: &str| pen::stroke(below(line), "none", 0.0).set("fill", fill);
    pen::group("ground")
        .add(filled(&highest, colour::HILLS))
        .add(filled(&lowest, colour::SOIL))
        .add(pen::stroke(pen::polyline(highest), colour::CONTOUR, 1.2))
        .add(pen::stroke(pen::polyline(lowest), colour::CONTOUR, 0.8))
}

/// Heights of the ground over the drawn box.
struct Grid<'s> {
    sheet: &'s Sheet,
    step_m: f64,
    columns: usize,
    rows: usize,
    heights_m: Vec<f64>,
}

impl<'s> Grid<'s> {
    fn over(sheet: &'s Sheet, terrain: &Terrain) -> Self {
        let step_m = STEP / sheet.pixels_per_m;
        let count = |side_m: f64| (side_m / step_m).ceil() as usize + 1;
        let (columns, rows) = (count(sheet.max.x - sheet.min.x), count(sheet.max.y - sheet.min.y));
        let height = |at: usize| {
            let [x, y] = [sheet.min.x + (at % columns) as f64 * step_m, sheet.min.y + (at / columns) as f64 * step_m];
            terrain.height_m(x.min(sheet.max.x), y.min(sheet.max.y))
        };
        Self { sheet, step_m, columns, rows, heights_m: (0..columns * rows).map(height).collect() }
    }

    fn range_m(&self) -> [f64; 2] {
        let of = |pick: fn(f64, f64) -> f64| self.heights_m.iter().copied().reduce(pick).unwrap_or(0.0);
        [of(f64::min), of(f64::max)]
    }

    /// The lines of a height, on the sheet. Each cell is halved as the terrain's are, and a line passes a half between two of its sides.
    fn lines(&self, height_m: f64) -> Vec<Vec<Place>> {
        let is_above = |at: usize| self.heights_m[at] > height_m;
        let mut ways: HashMap<[usize; 2], Vec<[usize; 2]>> = HashMap::new();
        let mut order: Vec<[usize; 2]> = Vec::new();
        let halves = (0..self.rows - 1).flat_map(|j| (0..self.columns - 1).map(move |i| (i, j))).flat_map(|(i, j)| {
            let at = j * self.columns + i;
            let [east, north, both] = [at + 1, at + self.columns, at + self.columns + 1];
            [[at, east, both], [at, both, north]]
        });
        for corners in halves {
            let sides = [[corners[0], corners[1]], [corners[1], corners[2]], [corners[2], corners[0]]];
            let crossed: Vec<[usize; 2]> =
                sides.into_iter().filter(|[a, b]| is_above(*a) != is_above(*b)).map(|[a, b]| [a.min(b), a.max(b)]).collect();
            if let [from, to] = crossed[..] {
                for (side, other) in [(from, to), (to, from)] {
                    ways.entry(side).or_insert_with(|| {
                        order.push(side);
                        Vec::new()
                    });
                    ways.entry(side).and_modify(|others| others.push(other));
                }
            }
        }
        // Lines that leave the frame first, so that each is drawn from end to end; then those that are closed.
        order.sort_by_key(|side| ways.get(side).map_or(0, Vec::len));
        let mut lines = Vec::new();
        for first in order {
            let mut line = vec![self.place(first, height_m)];
            let mut side = first;
            while let Some(next) = ways.get_mut(&side).and_then(Vec::pop) {
                if let Some(back) = ways.get_mut(&next) {
                    back.retain(|other| *other != side);
                }
                line.push(self.place(next, height_m));
                side = next;
            }
            if line.len() > 1 {
                lines.push(line);
            }
        }
        lines
    }

    /// Where a line of a height passes the side between two places.
    fn place(&self, [a, b]: [usize; 2], height_m: f64) -> Place {
        let (low, high) = (self.heights_m[a], self.heights_m[b]);
        let share = ((height_m - low) / (high - low)).clamp(0.0, 1.0);
        let at = |index: usize| [(index % self.columns) as f64, (index / self.columns) as f64];
        let ([x0, y0], [x1, y1]) = (at(a), at(b));
        let x = self.sheet.min.x + (x0 + (x1 - x0) * share) * self.step_m;
        let y = self.sheet.min.y + (y0 + (y1 - y0) * share) * self.step_m;
        self.sheet.seen_from_above(x.min(self.sheet.max.x), y.min(self.sheet.max.y))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::mission::fixture;
    use crate::scene::terrain::tests::hill;

    #[test]
    fn lines_of_one_height_are_where_the_ground_has_it() {
        let terrain = hill(60.0, 150.0, 600.0, 10.0);
        let plan = fixture::plan("panoramic", &[[-180.0, -180.0, 90.0], [180.0, 180.0, 90.0]]);
        let sheet = Sheet::from_above(Point3::new(-200.0, -200.0, 0.0), Point3::new(200.0, 200.0, 60.0), &plan);
        let grid = Grid::over(&sheet, &terrain);
        for height_m in [10.0, 30.0, 55.0] {
            let lines = grid.lines(height_m);
            assert_eq!(lines.len(), 1, "one line around the hill at {height_m} m");
            assert_eq!(lines[0].first(), lines[0].last(), "and it is closed");
            for place in &lines[0] {
                let x = sheet.min.x + (place[0] - sheet.top_view.left) / sheet.pixels_per_m;
                let y = sheet.max.y - (place[1] - sheet.top_view.top) / sheet.pixels_per_m;
                assert!((terrain.height_m(x, y) - height_m).abs() < 1.0, "{} m at {x}, {y}", terrain.height_m(x, y));
            }
        }
        let [lines, numbers] = from_above(&sheet, &terrain).map(|group| group.to_string());
        assert!(lines.contains("data-height-m=\"25\"") && numbers.matches("<text").count() >= 4, "{numbers}");
        let side = from_south(&sheet, &terrain).to_string();
        assert_eq!(side.matches("<path").count(), 4);
    }

    #[test]
    fn a_line_that_leaves_the_frame_is_one_line() {
        let slope = Terrain::new([-300.0; 2], 300.0, [3, 3], vec![0.0, 30.0, 60.0, 0.0, 30.0, 60.0, 0.0, 30.0, 60.0]).unwrap();
        let plan = fixture::plan("panoramic", &[[-180.0, -180.0, 90.0], [180.0, 180.0, 90.0]]);
        let sheet = Sheet::from_above(Point3::new(-200.0, -200.0, 0.0), Point3::new(200.0, 200.0, 60.0), &plan);
        let lines = Grid::over(&sheet, &slope).lines(25.0);
        assert_eq!(lines.len(), 1);
        let [first, last] = [lines[0][0], lines[0][lines[0].len() - 1]];
        assert!((first[1] - last[1]).abs() > 0.98 * sheet.top_view.height, "{first:?} to {last:?}");
    }
}
