//! The ground under a surface model: as a terrain of the scene, and as a guess where no model of the ground is given.

use super::grid::{Affine, fill_nearest};
use crate::scene::terrain::Terrain;

/// Side of the blocks whose low places are taken for ground, m.
const BLOCK_M: f64 = 10.0;

/// This share of a block's heights may lie below what is taken for its ground: pits and wrong echoes.
const LOW_SHARE: f64 = 0.05;

/// The ground is opened with windows of up to so many blocks to each side: the roof of a building less than twice that wide is not taken for ground.
const WINDOWS: [usize; 4] = [1, 2, 4, 8];

/// What stands out less than this over the opened ground, and this much more for each metre of a window, is a slope or a hilltop, m.
const LEAST_STEP_M: f64 = 1.0;
const SLOPE: f64 = 0.1;

/// Cells of the terrain are no smaller than this, m, and no more than so many.
const LEAST_TERRAIN_CELL_M: f64 = 5.0;
const MOST_TERRAIN_CELLS: f64 = 40_000.0;

/// The terrain lies no deeper than this below any height of the ground, m.
const MOST_BELOW_M: f64 = 0.5;

/// A guess of the ground under a surface, cell by cell: low places of blocks, without what stands out of its surroundings as buildings do
/// (a progressive morphological filter, after Zhang et al., IEEE Trans. Geosci. Remote Sens. 41(4), 2003). `surface` has a known height somewhere.
pub(super) fn guess(surface: &[f32], columns: usize, rows: usize, cell_m: f64) -> Vec<f32> {
    let block = (BLOCK_M / cell_m).round().max(1.0) as usize;
    let (across, down) = (columns.div_ceil(block), rows.div_ceil(block));
    let low = |index: usize| {
        let (left, top) = (index % across * block, index / across * block);
        let in_rows = (top..(top + block).min(rows)).map(|row| row * columns);
        let mut heights: Vec<f32> = in_rows
            .flat_map(|row| &surface[row + left..row + (left + block).min(columns)])
            .copied()
            .filter(|z| !z.is_nan())
            .collect();
        if heights.is_empty() {
            return f32::NAN;
        }
        let at = (LOW_SHARE * (heights.len() - 1) as f64) as usize;
        *heights.select_nth_unstable_by(at, f32::total_cmp).1
    };
    let mut blocks: Vec<f32> = (0..across * down).map(low).collect();
    fill_nearest(&mut blocks, across, down);
    // Opening takes the upper border of a slope for a step: the slope of the whole is taken out for as long.
    let plane = plane(&blocks, across);
    let level = |index: usize| plane(index % across, index / across);
    blocks.iter_mut().enumerate().for_each(|(index, z)| *z -= level(index));
    let block_m = block as f64 * cell_m;
    for window in WINDOWS {
        let eroded = windowed(&blocks, across, down, window, f32::min);
        let opened = windowed(&eroded, across, down, window, f32::max);
        let step_m = (LEAST_STEP_M + SLOPE * window as f64 * block_m) as f32;
        blocks.iter_mut().zip(&opened).for_each(|(z, &opened)| *z = if *z - opened > step_m { opened } else { *z });
    }
    blocks.iter_mut().enumerate().for_each(|(index, z)| *z += level(index));
    let between = |cell: usize| {
        let middle = |index: usize, count: usize| {
            let at = ((index as f64 + 0.5) / block as f64 - 0.5).clamp(0.0, (count - 1) as f64);
            (at as usize, (at as usize + 1).min(count - 1), at.fract() as f32)
        };
        let ((west, east, along), (north, south, down)) = (middle(cell % columns, across), middle(cell / columns, down));
        let at = |column: usize, row: usize| blocks[row * across + column];
        let upper = at(west, north) + (at(east, north) - at(west, north)) * along;
        let lower = at(west, south) + (at(east, south) - at(west, south)) * along;
        let ground = upper + (lower - upper) * down;
        // What lies lower than its block is ground as well.
        if surface[cell] < ground { surface[cell] } else { ground }
    };
    (0..surface.len()).map(between).collect()
}

/// The plane through values on a grid with the least squares of distances: its value by column and row.
fn plane(values: &[f32], columns: usize) -> impl Fn(usize, usize) -> f32 + use<> {
    let rows = values.len() / columns;
    let (mid_column, mid_row) = ((columns - 1) as f64 / 2.0, (rows - 1) as f64 / 2.0);
    let offsets = |index: usize| ((index % columns) as f64 - mid_column, (index / columns) as f64 - mid_row);
    let mut sums = [0.0; 5];
    for (index, z) in values.iter().enumerate() {
        let ((x, y), z) = (offsets(index), f64::from(*z));
        [z, x * z, y * z, x * x, y * y].iter().zip(&mut sums).for_each(|(term, sum)| *sum += term);
    }
    let [of_z, of_xz, of_yz, of_xx, of_yy] = sums;
    let slope = |sum: f64, squares: f64| if squares > 0.0 { sum / squares } else { 0.0 };
    let (mean, along, down) = (of_z / values.len() as f64, slope(of_xz, of_xx), slope(of_yz, of_yy));
    move |column, row| (mean + along * (column as f64 - mid_column) + down * (row as f64 - mid_row)) as f32
}

/// Each value with those up to `reach` to its sides, first along the rows, then along the columns.
fn windowed(values: &[f32], columns: usize, rows: usize, reach: usize, pick: fn(f32, f32) -> f32) -> Vec<f32> {
    let along = |values: &[f32], step: usize, count: usize, place: &dyn Fn(usize) -> usize| -> Vec<f32> {
        let of = |index: usize| {
            let at = place(index);
            let window = at.saturating_sub(reach)..(at + reach + 1).min(count);
            window.map(|other| values[index - at * step + other * step]).reduce(pick).unwrap_or(f32::NAN)
        };
        (0..values.len()).map(of).collect()
    };
    let rowwise = along(values, 1, columns, &|index| index % columns);
    along(&rowwise, columns, rows, &|index| index / columns)
}

/// The terrain of a scene, how far it stands above the ground that it is made of at most, m.
#[derive(Debug)]
pub(super) struct Modelled {
    pub terrain: Terrain,
    pub most_above_m: f64,
}

/// The ground on a coarser grid along the local axes: means of its heights, raised where that would leave the ground more than half a metre above it. `local`
/// tells where a place in cells lies in the local frame, m; `heights_m` are all known.
pub(super) fn model(heights_m: &[f32], columns: usize, rows: usize, local: &Affine) -> Option<Modelled> {
    let outer = [(0, 0), (columns, 0), (0, rows), (columns, rows)].map(|(column, row)| local.at(column as f64, row as f64));
    let edge = |axis: usize, pick: fn(f64, f64) -> f64| outer.iter().map(|corner| corner[axis]).reduce(pick).unwrap_or(0.0);
    let ([west, south], [east, north]) = ([0, 1].map(|axis| edge(axis, f64::min)), [0, 1].map(|axis| edge(axis, f64::max)));
    let cell_m = ((east - west) * (north - south) / MOST_TERRAIN_CELLS).sqrt().max(LEAST_TERRAIN_CELL_M);
    let corners = [east - west, north - south].map(|extent_m| (extent_m / cell_m).ceil().max(1.0) as usize + 1);
    let origin = [west, south];
    let place = |cell: usize| local.at((cell % columns) as f64 + 0.5, (cell / columns) as f64 + 0.5);
    let in_cells = |[x, y]: [f64; 2]| [(x - west) / cell_m, (y - south) / cell_m];
    let mut sums = vec![(0.0, 0u32); corners[0] * corners[1]];
    for (cell, z) in heights_m.iter().enumerate() {
        let [u, v] = in_cells(place(cell)).map(f64::round);
        let (i, j) = ((u as usize).min(corners[0] - 1), (v as usize).min(corners[1] - 1));
        let (sum, count) = &mut sums[j * corners[0] + i];
        (*sum, *count) = (*sum + f64::from(*z), *count + 1);
    }
    let mean = |(sum, count): &(f64, u32)| if *count == 0 { f32::NAN } else { (sum / f64::from(*count)) as f32 };
    let mut means: Vec<f32> = sums.iter().map(mean).collect();
    fill_nearest(&mut means, corners[0], corners[1]);
    let mut raised: Vec<f64> = means.iter().map(|&z| f64::from(z)).collect();
    let coarse = Terrain::new(origin, cell_m, corners, raised.clone())?;
    for (cell, z) in heights_m.iter().enumerate() {
        let at = place(cell);
        let short_m = f64::from(*z) - coarse.height_m(at[0], at[1]) - MOST_BELOW_M;
        if short_m > 0.0 {
            // Raising all corners of the cell by what is missing raises each place in it by that.
            let [u, v] = in_cells(at);
            let (i, j) = ((u as usize).min(corners[0] - 2), (v as usize).min(corners[1] - 2));
            for corner in [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)].map(|(i, j)| j * corners[0] + i) {
                raised[corner] = raised[corner].max(f64::from(means[corner]) + short_m);
            }
        }
    }
    let terrain = Terrain::new(origin, cell_m, corners, raised.iter().map(|z| (z * 1000.0).ceil() / 1000.0).collect())?;
    let above = |(cell, z): (usize, &f32)| {
        let at = place(cell);
        terrain.height_m(at[0], at[1]) - f64::from(*z)
    };
    let most_above_m = heights_m.iter().enumerate().map(above).fold(0.0, f64::max);
    Some(Modelled { terrain, most_above_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 120;

    fn slope(cell: usize) -> f32 {
        20.0 + (cell % SIDE) as f32 * 0.15 + (cell / SIDE) as f32 * 0.05
    }

    #[test]
    fn the_guessed_ground_of_a_slope_goes_under_its_buildings() {
        let is_roof = |cell: usize| (40..65).contains(&(cell % SIDE)) && (50..90).contains(&(cell / SIDE));
        let mut surface: Vec<f32> = (0..SIDE * SIDE).map(|cell| slope(cell) + if is_roof(cell) { 12.0 } else { 0.0 }).collect();
        surface[7] = f32::NAN;
        let ground = guess(&surface, SIDE, SIDE, 1.0);
        let worst = |wanted: &dyn Fn(usize) -> bool| {
            (0..SIDE * SIDE).filter(|&cell| wanted(cell)).map(|cell| (ground[cell] - slope(cell)).abs()).fold(0.0, f32::max)
        };
        assert!(worst(&is_roof) < 4.0, "{}", worst(&is_roof));
        assert!(worst(&|cell| !is_roof(cell)) < 4.0, "{}", worst(&|cell| !is_roof(cell)));
        assert!(ground.iter().all(|z| z.is_finite()));
    }

    #[test]
    fn the_terrain_lies_nowhere_far_below_the_ground() {
        // A wall of earth, narrower than a cell of the terrain, on a slope.
        let heights_m: Vec<f32> = (0..SIDE * SIDE).map(|cell| slope(cell) + if cell % SIDE == 50 { 3.0 } else { 0.0 }).collect();
        let local = Affine { origin: [-60.0, 60.0], column: [1.0, 0.02], row: [0.02, -1.0] };
        let modelled = model(&heights_m, SIDE, SIDE, &local).unwrap();
        assert_eq!(modelled.terrain.cell_m(), LEAST_TERRAIN_CELL_M);
        let mut most_above_m: f64 = 0.0;
        for (cell, z) in heights_m.iter().enumerate() {
            let [x, y] = local.at((cell % SIDE) as f64 + 0.5, (cell / SIDE) as f64 + 0.5);
            let above_m = modelled.terrain.height_m(x, y) - f64::from(*z);
            assert!(above_m >= -MOST_BELOW_M - 1e-3, "{above_m} m at {x}, {y}");
            most_above_m = most_above_m.max(above_m);
        }
        assert!((most_above_m - modelled.most_above_m).abs() < 1e-9 && most_above_m < 4.0, "{most_above_m}");
    }
}
