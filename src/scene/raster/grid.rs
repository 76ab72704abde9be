//! Heights on a grid of cells, where the grid lies, and how gaps in it are closed.

use std::collections::VecDeque;

/// Gaps up to this size are closed from their neighbours, m^2: a chimney's shadow, a car's roof. Larger ones are water or outside.
pub(super) const MOST_FILLED_M2: f64 = 25.0;

/// Cells that a raster is read into at most; larger ones are gridded down while they are read.
pub(super) const MOST_CELLS: usize = 4_000_000;

/// Cells need not be finer than this, m.
pub(super) const LEAST_CELL_M: f64 = 0.5;

/// From a place in cells (columns from the first one's outer side, rows likewise) to the coordinates of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    pub origin: [f64; 2],
    /// What a column and a row add.
    pub column: [f64; 2],
    pub row: [f64; 2],
}

impl Affine {
    pub fn at(&self, column: f64, row: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.origin[axis] + column * self.column[axis] + row * self.row[axis])
    }

    fn determinant(&self) -> f64 {
        self.column[0] * self.row[1] - self.column[1] * self.row[0]
    }

    /// Side of a square as large as a cell, in the units of the file; not a positive number where the cells have no area.
    pub fn cell(&self) -> f64 {
        self.determinant().abs().sqrt()
    }

    /// The place in cells of a point of the file.
    pub fn inverse(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (x, y, determinant) = (x - self.origin[0], y - self.origin[1], self.determinant());
        [(x * self.row[1] - y * self.row[0]) / determinant, (y * self.column[0] - x * self.column[1]) / determinant]
    }

    /// The same for cells that are so many times as large each way.
    pub fn coarser(&self, factor: usize) -> Self {
        let grown = |side: [f64; 2]| side.map(|length| length * factor as f64);
        Self { column: grown(self.column), row: grown(self.row), ..*self }
    }

    pub fn is_sound(&self) -> bool {
        let numbers = [self.origin, self.column, self.row];
        numbers.iter().flatten().all(|number| number.is_finite()) && self.cell().is_finite() && self.cell() > 0.0
    }
}

/// Heights by cells, row by row; not a number where nothing is known.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub columns: usize,
    pub rows: usize,
    pub place: Affine,
    pub heights: Vec<f32>,
}

impl Grid {
    /// Height at a point of the file, between the middles of the cells around it, or that of its cell where not all of them are known.
    pub fn height_at(&self, point: [f64; 2]) -> f32 {
        let [column, row] = self.place.inverse(point);
        let inside = |value: f64, count: usize| (0.0..count as f64).contains(&value);
        if !inside(column, self.columns) || !inside(row, self.rows) {
            return f32::NAN;
        }
        let own = self.heights[row as usize * self.columns + column as usize];
        let split = |value: f64, count: usize| {
            let from = (value - 0.5).clamp(0.0, (count - 1) as f64);
            (from as usize, (from as usize + 1).min(count - 1), from.fract() as f32)
        };
        let ((west, east, along), (north, south, down)) = (split(column, self.columns), split(row, self.rows));
        let at = |column: usize, row: usize| self.heights[row * self.columns + column];
        let between = |from: f32, to: f32, share: f32| from + (to - from) * share;
        let height =
            between(between(at(west, north), at(east, north), along), between(at(west, south), at(east, south), along), down);
        if height.is_nan() { own } else { height }
    }

    /// Closes gaps of at most so many cells with the mean of their neighbours, from the outside in. Says how many cells were closed and how many are left
    /// unknown.
    pub fn fill_small(&mut self, most_cells: usize) -> (usize, usize) {
        let mut is_seen = vec![false; self.heights.len()];
        let (mut filled, mut left) = (0, 0);
        for first in 0..self.heights.len() {
            if is_seen[first] || !self.heights[first].is_nan() {
                continue;
            }
            is_seen[first] = true;
            let mut gap = vec![first];
            let mut next = 0;
            while next < gap.len() {
                for near in neighbours(gap[next], self.columns, self.rows) {
                    if self.heights[near].is_nan() && !std::mem::replace(&mut is_seen[near], true) {
                        gap.push(near);
                    }
                }
                next += 1;
            }
            if gap.len() > most_cells || gap.len() == self.heights.len() {
                left += gap.len();
                continue;
            }
            filled += gap.len();
            while !gap.is_empty() {
                let mean = |cell: usize| {
                    let known = neighbours(cell, self.columns, self.rows).map(|near| self.heights[near]).filter(|z| !z.is_nan());
                    let (sum, count) = known.fold((0.0, 0.0), |(sum, count), z| (sum + z, count + 1.0));
                    sum / count
                };
                let means: Vec<f32> = gap.iter().map(|&cell| mean(cell)).collect();
                gap.iter().zip(&means).for_each(|(&cell, &mean)| self.heights[cell] = mean);
                gap.retain(|&cell| self.heights[cell].is_nan());
            }
        }
        (filled, left)
    }
}

/// The cells beside a cell.
pub(super) fn neighbours(cell: usize, columns: usize, rows: usize) -> impl Iterator<Item = usize> {
    let (column, row) = (cell % columns, cell / columns);
    let beside = [
        (row > 0).then(|| cell - columns),
        (column > 0).then(|| cell - 1),
        (column + 1 < columns).then_some(cell + 1),
        (row + 1 < rows).then_some(cell + columns),
    ];
    beside.into_iter().flatten()
}

/// Gives every unknown value that of the nearest known one, by cells beside each other; says how many there were. Without any known one nothing changes.
pub(super) fn fill_nearest(values: &mut [f32], columns: usize, rows: usize) -> usize {
    let mut queue: VecDeque<usize> = (0..values.len()).filter(|&cell| !values[cell].is_nan()).collect();
    let unknown = values.len() - queue.len();
    while let Some(cell) = queue.pop_front() {
        for near in neighbours(cell, columns, rows) {
            if values[near].is_nan() {
                values[near] = values[cell];
                queue.push_back(near);
            }
        }
    }
    unknown
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNKNOWN: f32 = f32::NAN;

    #[test]
    fn places_are_found_back_on_a_turned_grid() {
        let place = Affine { origin: [500.0, 900.0], column: [0.4, 0.3], row: [0.3, -0.4] };
        assert!((place.cell() - 0.5).abs() < 1e-12 && place.is_sound());
        let [column, row] = place.inverse(place.at(12.25, 7.5));
        assert!((column - 12.25).abs() < 1e-9 && (row - 7.5).abs() < 1e-9);
        assert!(!Affine { row: [0.4, 0.3], ..place }.is_sound());
    }

    #[test]
    fn small_gaps_are_closed_and_large_ones_stay() {
        let mut heights = vec![4.0; 60];
        heights[11] = UNKNOWN;
        for cell in [6, 7, 8, 16, 17, 18] {
            heights[cell] = UNKNOWN;
        }
        let place = Affine { origin: [0.0; 2], column: [1.0, 0.0], row: [0.0, -1.0] };
        let mut grid = Grid { columns: 10, rows: 6, place, heights };
        assert_eq!(grid.fill_small(2), (1, 6));
        assert!(grid.heights[11] == 4.0 && grid.heights[7].is_nan());
        assert_eq!(grid.height_at([1.5, -1.5]), 4.0);
        assert!(grid.height_at([-0.1, -1.5]).is_nan() && grid.height_at([f64::NAN, 0.0]).is_nan());
        assert_eq!(fill_nearest(&mut grid.heights, 10, 6), 6);
        assert!(grid.heights.iter().all(|&z| z == 4.0));
        let mut nothing = vec![UNKNOWN; 4];
        assert_eq!(fill_nearest(&mut nothing, 2, 2), 4);
    }
}
