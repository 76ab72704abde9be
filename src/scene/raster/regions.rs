//! Cells that stand above the ground, put together to the roofs of structures: neighbours whose heights belong together, the small ones joined to what
//! they lie beside.

use std::collections::{BTreeMap, BTreeSet};

use super::grid::neighbours;

/// Neighbours belong together up to this step, m, or up to a slope of 45 degrees where cells are larger.
const LEAST_STEP_M: f32 = 1.0;

/// A cell of a roof differs from the mean of it by no more than this, m: a gradual slope does not join a tower to a shed.
const SPREAD_M: f64 = 5.0;

/// Roofs below this are joined to the neighbour with which they have most of their edge, m^2 ...
pub(super) const LEAST_ROOF_M2: f64 = 20.0;

/// ... when its mean height is no farther away than this, m.
const MOST_APART_M: f64 = 8.0;

/// The cells that are asked for roofs.
pub(super) struct Surface<'a> {
    pub columns: usize,
    pub rows: usize,
    pub cell_m: f64,
    pub heights_m: &'a [f32],
    /// Whether a cell stands high enough above the ground.
    pub is_high: &'a [bool],
    /// Whether a cell is one of a building, where the file knows that.
    pub is_building: Option<&'a [bool]>,
}

/// Roofs by cells.
pub(super) struct Regions {
    /// For each cell the number of its roof, from 1; 0 for the ground.
    pub labels: Vec<u32>,
    pub regions: Vec<Region>,
    /// Small ones that were joined to others.
    pub joined: usize,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Region {
    pub cells: usize,
    sum_m: f64,
    /// All its cells are of a building, or nobody knows.
    pub is_building: bool,
}

impl Region {
    fn mean_m(&self) -> f64 {
        self.sum_m / self.cells as f64
    }
}

/// Roofs in the order of their first cells.
pub(super) fn find(surface: &Surface) -> Regions {
    let (labels, grown) = grow(surface);
    join(surface, labels, grown)
}

fn grow(surface: &Surface) -> (Vec<u32>, Vec<Region>) {
    let step_m = LEAST_STEP_M.max(surface.cell_m as f32);
    let is_building = |cell: usize| surface.is_building.is_none_or(|is_building| is_building[cell]);
    let mut labels = vec![0; surface.heights_m.len()];
    let mut regions = Vec::new();
    let mut queue = Vec::new();
    for first in 0..labels.len() {
        if labels[first] != 0 || !surface.is_high[first] {
            continue;
        }
        let label = regions.len() as u32 + 1;
        let mut region = Region { cells: 0, sum_m: 0.0, is_building: is_building(first) };
        labels[first] = label;
        queue.clear();
        queue.push(first);
        let mut next = 0;
        while next < queue.len() {
            let cell = queue[next];
            let z = surface.heights_m[cell];
            (region.cells, region.sum_m, next) = (region.cells + 1, region.sum_m + f64::from(z), next + 1);
            for near in neighbours(cell, surface.columns, surface.rows) {
                let other = surface.heights_m[near];
                let belongs = labels[near] == 0
                    && surface.is_high[near]
                    && (other - z).abs() <= step_m
                    && (f64::from(other) - region.mean_m()).abs() <= SPREAD_M
                    && is_building(near) == region.is_building;
                if belongs {
                    labels[near] = label;
                    queue.push(near);
                }
            }
        }
        regions.push(region);
    }
    (labels, regions)
}

/// Joins small regions to others, the smallest first, and numbers what is left anew.
fn join(surface: &Surface, mut labels: Vec<u32>, mut regions: Vec<Region>) -> Regions {
    let mut edges: Vec<BTreeMap<u32, u32>> = vec![BTreeMap::new(); regions.len()];
    for cell in (0..labels.len()).filter(|&cell| labels[cell] != 0) {
        for near in neighbours(cell, surface.columns, surface.rows) {
            if labels[near] != 0 && labels[near] != labels[cell] {
                *edges[labels[cell] as usize - 1].entry(labels[near] - 1).or_default() += 1;
            }
        }
    }
    let mut parents: Vec<u32> = (0..regions.len() as u32).collect();
    let least_cells = (LEAST_ROOF_M2 / (surface.cell_m * surface.cell_m)).ceil() as usize;
    let small = |(index, region): (usize, &Region)| (region.cells < least_cells).then_some((region.cells, index as u32));
    let mut queue: BTreeSet<(usize, u32)> = regions.iter().enumerate().filter_map(small).collect();
    let mut joined = 0;
    while let Some((_, own)) = queue.pop_first() {
        let region = regions[own as usize].clone();
        let suits = |(other, _): &(&u32, &u32)| {
            let other = &regions[**other as usize];
            other.is_building == region.is_building && (other.mean_m() - region.mean_m()).abs() <= MOST_APART_M
        };
        // Of several with as much common edge the first one.
        let best = edges[own as usize].iter().filter(suits).max_by_key(|&(&other, &length)| (length, std::cmp::Reverse(other)));
        let Some((&other, _)) = best else { continue };
        joined += 1;
        queue.remove(&(regions[other as usize].cells, other));
        parents[own as usize] = other;
        for (near, length) in std::mem::take(&mut edges[own as usize]) {
            edges[near as usize].remove(&own);
            if near != other {
                *edges[near as usize].entry(other).or_default() += length;
                *edges[other as usize].entry(near).or_default() += length;
            }
        }
        let into = &mut regions[other as usize];
        (into.cells, into.sum_m) = (into.cells + region.cells, into.sum_m + region.sum_m);
        if into.cells < least_cells {
            queue.insert((into.cells, other));
        }
    }
    let root = |mut index: u32| {
        while parents[index as usize] != index {
            index = parents[index as usize];
        }
        index
    };
    let roots: Vec<u32> = (0..regions.len() as u32).map(root).collect();
    let mut numbers = vec![0; regions.len()];
    let mut left = Vec::new();
    for label in labels.iter_mut().filter(|label| **label != 0) {
        let root = roots[*label as usize - 1] as usize;
        if numbers[root] == 0 {
            left.push(regions[root].clone());
            numbers[root] = left.len() as u32;
        }
        *label = numbers[root];
    }
    Regions { labels, regions: left, joined }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of 20 x 10 m, half of it 6 m and half 15 m high, with a chimney on the lower half and a lamp beside it.
    #[test]
    fn steps_part_roofs_and_chimneys_are_joined_to_theirs() {
        let columns = 30;
        let mut heights_m = vec![0.0; columns * 14];
        for row in 2..12 {
            for column in 2..22 {
                heights_m[row * columns + column] = if column < 12 { 6.0 } else { 15.0 };
            }
        }
        heights_m[5 * columns + 5] = 8.5;
        heights_m[5 * columns + 26] = 9.0;
        let is_high: Vec<bool> = heights_m.iter().map(|&z| z > 2.5).collect();
        let find_with = |is_building| {
            let surface = Surface { columns, rows: 14, cell_m: 1.0, heights_m: &heights_m, is_high: &is_high, is_building };
            find(&surface)
        };
        let found = find_with(None);
        let sizes: Vec<usize> = found.regions.iter().map(|region| region.cells).collect();
        assert_eq!((sizes, found.joined), (vec![100, 100, 1], 1));
        assert_eq!(found.labels[5 * columns + 5], found.labels[2 * columns + 2]);
        let is_building: Vec<bool> = (0..heights_m.len()).map(|cell| cell % columns < 12).collect();
        let kinds: Vec<bool> = find_with(Some(&is_building)).regions.iter().map(|region| region.is_building).collect();
        assert_eq!(kinds, [true, false, false]);
    }

    #[test]
    fn a_ramp_does_not_join_the_ground_floor_to_a_tower() {
        let heights_m: Vec<f32> = (0..60).map(|column| 3.0 + 0.9 * column as f32).collect();
        let (columns, is_high) = (60, vec![true; 60]);
        let surface = Surface { columns, rows: 1, cell_m: 1.0, heights_m: &heights_m, is_high: &is_high, is_building: None };
        assert!(grow(&surface).1.len() > 4);
    }
}
