//! The outlines of regions of cells, simplified so that neighbours keep their common walls.

use std::collections::HashMap;

use geo::{Coord, LineString, Simplify};

/// Lines are simplified in pieces of so many corners, because the algorithm descends into itself.
const PIECE: usize = 1000;

/// A closed line without its last corner again, in cells: columns and rows from the outer corner of the first cell.
pub(super) type Ring = Vec<Coord<f64>>;

/// The rings of each region: outer ones have their region to the right when rows run down, holes likewise, and so the other way round.
#[derive(Debug, Default)]
pub(super) struct Outline {
    pub outer: Vec<Ring>,
    pub holes: Vec<Ring>,
}

/// Steps to the east, south, west and north, in this order: one more is a turn to the right.
const STEPS: [[i64; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// Cells by the number of their region, 0 for none.
pub(super) struct Labels<'a> {
    pub labels: &'a [u32],
    pub columns: usize,
    pub rows: usize,
}

/// The outlines of the regions 1 to `regions`, corners of the lines between two corners moved by at most `tolerance` cells. Corners at which three
/// regions meet stay, and a line between two regions is the same for both.
pub(super) fn outlines(cells: &Labels, regions: usize, tolerance: f64) -> Vec<Outline> {
    let mut sides: Vec<Vec<[i64; 3]>> = vec![Vec::new(); regions];
    for row in 0..cells.rows as i64 {
        for column in 0..cells.columns as i64 {
            let own = cells.at(column, row);
            if own == 0 || own as usize > regions {
                continue;
            }
            // The sides of a cell, clockwise: where each begins and what lies beyond.
            let beyond = [(0, -1, [0, 0]), (1, 0, [1, 0]), (0, 1, [1, 1]), (-1, 0, [0, 1])];
            for (direction, (over, down, [x, y])) in beyond.into_iter().enumerate() {
                if cells.at(column + over, row + down) != own {
                    sides[own as usize - 1].push([column + x, row + y, direction as i64]);
                }
            }
        }
    }
    sides.into_iter().map(|sides| outline(cells, &sides, tolerance)).collect()
}

impl Labels<'_> {
    fn at(&self, column: i64, row: i64) -> u32 {
        let inside = (0..self.columns as i64).contains(&column) && (0..self.rows as i64).contains(&row);
        if inside { self.labels[row as usize * self.columns + column as usize] } else { 0 }
    }

    /// Whether more than two lines come together at a corner.
    fn is_junction(&self, [x, y]: [i64; 2]) -> bool {
        let [a, b, c, d] = [(-1, -1), (0, -1), (0, 0), (-1, 0)].map(|(over, down)| self.at(x + over, y + down));
        [a != b, b != c, c != d, d != a].into_iter().filter(|is_line| *is_line).count() > 2
    }
}

fn outline(cells: &Labels, sides: &[[i64; 3]], tolerance: f64) -> Outline {
    let mut from: HashMap<[i64; 2], Vec<usize>> = HashMap::with_capacity(sides.len());
    for (index, [x, y, _]) in sides.iter().enumerate() {
        from.entry([*x, *y]).or_default().push(index);
    }
    let mut is_used = vec![false; sides.len()];
    let mut outline = Outline::default();
    for first in 0..sides.len() {
        if is_used[first] {
            continue;
        }
        let mut ring = Vec::new();
        let mut side = first;
        loop {
            is_used[side] = true;
            let [x, y, direction] = sides[side];
            ring.push([x, y]);
            let [over, down] = STEPS[direction as usize];
            // Where two cells touch at a corner only, the line stays with its cell.
            let turn = |next: usize| [1, 0, 3].into_iter().position(|turn| sides[next][2] == (direction + turn) % 4);
            let ahead = from.get(&[x + over, y + down]).into_iter().flatten().copied().filter(|&next| !is_used[next]);
            let Some(next) = ahead.min_by_key(|&next| turn(next).unwrap_or(3)) else { break };
            side = next;
        }
        let doubled: i64 =
            (0..ring.len()).map(|k| (ring[k], ring[(k + 1) % ring.len()])).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
        let is_outer = doubled > 0;
        let simple = simplified(cells, &ring, tolerance);
        let enough = simple.len() >= 3;
        match (is_outer, enough) {
            (true, true) => outline.outer.push(simple),
            // What is too thin to be simplified stays as it is.
            (true, false) => outline.outer.push(ring.into_iter().map(coord).collect()),
            (false, true) => outline.holes.push(simple),
            (false, false) => {}
        }
    }
    outline
}

fn coord([x, y]: [i64; 2]) -> Coord<f64> {
    Coord { x: x as f64, y: y as f64 }
}

/// The ring with the lines between its junctions simplified; without junctions between its first corner, from the north and then from the west, and
/// the one farthest from that.
fn simplified(cells: &Labels, ring: &[[i64; 2]], tolerance: f64) -> Ring {
    let count = ring.len();
    let mut stops: Vec<usize> = (0..count).filter(|&k| cells.is_junction(ring[k])).collect();
    if stops.len() < 2 {
        let first = stops.first().copied().or_else(|| (0..count).min_by_key(|&k| [ring[k][1], ring[k][0]])).unwrap_or(0);
        let far = |k: &usize| {
            let [x, y] = [ring[*k][0] - ring[first][0], ring[*k][1] - ring[first][1]];
            (x * x + y * y, ring[*k])
        };
        let farthest = (0..count).max_by_key(far).unwrap_or(0);
        stops = vec![first.min(farthest), first.max(farthest)];
        stops.dedup();
    }
    let mut simple = Vec::new();
    for (index, &start) in stops.iter().enumerate() {
        let end = stops[(index + 1) % stops.len()];
        let steps = if end > start { end - start } else { end + count - start };
        let mut line: Vec<[i64; 2]> = (0..=steps).map(|k| ring[(start + k) % count]).collect();
        // Both regions beside the line simplify it from the same end.
        let is_reversed = line.last() < line.first();
        if is_reversed {
            line.reverse();
        }
        let mut corners = simplified_line(&line, tolerance);
        if is_reversed {
            corners.reverse();
        }
        corners.pop();
        simple.extend(corners);
    }
    simple
}

fn simplified_line(line: &[[i64; 2]], tolerance: f64) -> Vec<Coord<f64>> {
    let mut corners: Vec<Coord<f64>> = Vec::new();
    let mut from = 0;
    while from + 1 < line.len() {
        let to = (from + PIECE).min(line.len() - 1);
        let piece = LineString(line[from..=to].iter().copied().map(coord).collect());
        corners.pop();
        corners.extend(piece.simplify(tolerance).0);
        from = to;
    }
    corners
}

#[cfg(test)]
mod tests {
    use geo::{Area, Polygon};
    use proptest::prelude::*;

    use super::*;

    fn labels(picture: &[&str]) -> (Vec<u32>, usize, usize) {
        let cells = picture.iter().flat_map(|row| row.bytes().map(|byte| u32::from(byte - b'0'))).collect();
        (cells, picture[0].len(), picture.len())
    }

    fn area(ring: &Ring) -> f64 {
        Polygon::new(LineString(ring.clone()), Vec::new()).unsigned_area()
    }

    #[test]
    fn rings_and_holes_are_found_and_neighbours_share_their_wall() {
        let (cells, columns, rows) = labels(&[
            "000000000000",
            "011111122220",
            "011111122220",
            "011001122220",
            "011001112220",
            "011111112220",
            "011111112220",
            "000000000000",
        ]);
        let found = outlines(&Labels { labels: &cells, columns, rows }, 2, 0.4);
        assert_eq!(found.iter().map(|outline| (outline.outer.len(), outline.holes.len())).collect::<Vec<_>>(), [(1, 1), (1, 0)]);
        assert_eq!(area(&found[0].outer[0]) - area(&found[0].holes[0]), 35.0);
        assert_eq!(area(&found[1].outer[0]), 21.0);
        // With a coarser tolerance the step in the wall goes, on both sides alike.
        let coarse = outlines(&Labels { labels: &cells, columns, rows }, 2, 1.1);
        let sum = area(&coarse[0].outer[0]) + area(&coarse[1].outer[0]);
        assert!((sum - 60.0).abs() < 1e-9, "{sum}");
        let shared = coarse[0].outer[0].iter().filter(|corner| coarse[1].outer[0].contains(corner)).count();
        assert_eq!(shared, 2);
    }

    #[test]
    fn cells_that_touch_at_a_corner_have_rings_of_their_own() {
        let (cells, columns, rows) = labels(&["10", "01"]);
        let found = outlines(&Labels { labels: &cells, columns, rows }, 1, 0.1);
        assert_eq!(found[0].outer.iter().map(area).collect::<Vec<_>>(), [1.0, 1.0]);
    }

    proptest! {
        #[test]
        fn simplified_neighbours_neither_overlap_nor_leave_gaps(blocks in proptest::collection::vec(1u32..4, 9)) {
            // Blocks of five cells with jagged sides, and a frame around them.
            let label = |column: usize, row: usize| match (column.checked_sub(3), row.checked_sub(3)) {
                (Some(column), Some(row)) if column < 15 && row < 15 => blocks[row / 5 * 3 + ((column + row % 2) / 5).min(2)],
                _ => 4,
            };
            let cells: Vec<u32> = (0..21 * 21).map(|cell| label(cell % 21, cell / 21)).collect();
            let found = outlines(&Labels { labels: &cells, columns: 21, rows: 21 }, 4, 0.9);
            let enclosed = |rings: &[Ring]| rings.iter().map(area).sum::<f64>();
            let sum: f64 = found.iter().map(|outline| enclosed(&outline.outer) - enclosed(&outline.holes)).sum();
            prop_assert!((sum - 441.0).abs() < 1e-6, "{} of 441 cells", sum);
            let corners: usize = found.iter().flat_map(|outline| &outline.outer).map(Vec::len).sum();
            prop_assert!(corners < 110, "the jags are gone: {} corners", corners);
        }

        #[test]
        fn unsimplified_outlines_enclose_their_cells(cells in proptest::collection::vec(0u32..4, 63)) {
            let found = outlines(&Labels { labels: &cells, columns: 9, rows: 7 }, 3, 0.0);
            for (index, outline) in found.iter().enumerate() {
                let own = cells.iter().filter(|label| **label == index as u32 + 1).count() as f64;
                let enclosed: f64 = outline.outer.iter().map(area).sum::<f64>() - outline.holes.iter().map(area).sum::<f64>();
                prop_assert!((enclosed - own).abs() < 1e-9, "{} cells, {} enclosed", own, enclosed);
            }
        }
    }
}
