//! Tiles: viewpoints of neighbouring columns of the lattice. The rows of a tile's viewpoints lie in one segment, and what they may see is found out once
//! for all of them, so that time and memory of a field grow with the area and not with its square.

use std::collections::BTreeMap;
use std::ops::BitOrAssign;

use overfly_table::SegmentRows;
use overfly_table::rows::PATCH;
use rayon::prelude::*;

use super::rows::Group;
use super::viewpoints::{Cell, Viewpoint};
use crate::coverage::Mask;
use crate::scene::Bounds;

/// Edge of a tile, m, as far as columns of the lattice allow: about what the range of a view is, so that an edit touches a dozen of them.
const EDGE_M: f64 = 80.0;

/// Tiles whose boxes a worker finds at once, at least.
const LEAST_TILES: usize = 64;

/// The viewpoints whose rows lie in one segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Its place among the tiles of the lattice.
    pub key: [i64; 2],
    /// Places of its viewpoints among all of the field, ascending.
    pub viewpoints: Vec<u32>,
    /// Box around its viewpoints, m.
    pub bounds: Bounds,
}

/// All tiles that have viewpoints, by their keys. `cells` are those of the viewpoints of a lattice with such a spacing, in order.
pub fn tiles(cells: &[Cell], viewpoints: &[Viewpoint], spacing_m: f64) -> Vec<Tile> {
    let columns = (EDGE_M / spacing_m).round().max(1.0) as i64;
    let mut members: BTreeMap<[i64; 2], Vec<u32>> = BTreeMap::new();
    let mut start = 0;
    for mut row in cells.chunk_by(|a, b| a[0] == b[0]) {
        // Of each row of columns those that lie in one tile follow each other: a city has many more columns than such stretches.
        while let Some(first) = row.first() {
            let key = [first[0], first[1]].map(|place| place.div_euclid(columns));
            let (stretch, rest) = row.split_at(row.partition_point(|cell| cell[1] < (key[1] + 1) * columns));
            members.entry(key).or_default().extend(start..start + stretch.len() as u32);
            (start, row) = (start + stretch.len() as u32, rest);
        }
    }
    let tile = |(key, members): ([i64; 2], Vec<u32>)| {
        let bounds = Bounds::of_points(members.iter().map(|&j| viewpoints[j as usize].position))?;
        Some(Tile { key, viewpoints: members, bounds })
    };
    members.into_iter().collect::<Vec<_>>().into_par_iter().with_min_len(LEAST_TILES).filter_map(tile).collect()
}

/// The patches of all samples that a tile's viewpoints may see.
pub struct Reach<'a> {
    /// The structures' samples with the place of each one's first patch.
    pub groups: Vec<(&'a Group, usize)>,
    /// First sample of each patch, ascending.
    firsts: Vec<u32>,
}

/// What one viewpoint sees: bits of each patch of a reach.
pub struct RowBits(Vec<u32>);

impl<'a> Reach<'a> {
    /// Everything within `reach_m` of the box.
    pub fn of(bounds: &Bounds, reach_m: f64, groups: &'a [Group]) -> Self {
        let grown = bounds.grown(reach_m);
        let (mut reached, mut firsts) = (Vec::new(), Vec::new());
        for group in groups.iter().filter(|group| group.bounds.meets(&grown)) {
            reached.push((group, firsts.len()));
            firsts.extend(group.samples.clone().step_by(PATCH).map(|first| first as u32));
        }
        Self { groups: reached, firsts }
    }

    pub fn row(&self) -> RowBits {
        RowBits(vec![0; self.firsts.len()])
    }

    /// Room for a mask of each sample, by patch.
    pub fn masks(&self) -> Vec<Mask> {
        vec![0; self.firsts.len() * PATCH]
    }

    /// The patch with such a first sample.
    pub fn patch(&self, first: u32) -> Option<usize> {
        self.firsts.binary_search(&first).ok()
    }

    /// The first sample of a patch.
    pub fn first(&self, patch: usize) -> usize {
        self.firsts[patch] as usize
    }

    /// Adds masks by patch to those of all samples.
    pub fn merge<T: Copy + BitOrAssign>(&self, masks: &[T], all: &mut [T]) {
        for (masks, &first) in masks.chunks(PATCH).zip(&self.firsts) {
            // The last patches end beyond the last sample.
            all[first as usize..].iter_mut().zip(masks).for_each(|(all, mask)| *all |= *mask);
        }
    }

    /// Numbers the patches that are seen at all, in the rows and in what is returned: the first sample of each.
    pub fn number(&self, rows: &mut SegmentRows) -> Vec<u32> {
        let mut is_seen = vec![false; self.firsts.len()];
        rows.seen().iter().for_each(|seen| is_seen[seen.patch as usize] = true);
        let seen = || (0..self.firsts.len()).filter(|&patch| is_seen[patch]);
        let mut numbers = vec![0; self.firsts.len()];
        seen().zip(0..).for_each(|(patch, number)| numbers[patch] = number);
        rows.renumber(|patch| numbers[patch as usize]);
        seen().map(|patch| self.firsts[patch]).collect()
    }
}

impl RowBits {
    /// Marks the sample `offset` places after the first one of the structure whose patches begin at `patch`.
    pub fn mark(&mut self, patch: usize, offset: usize) {
        self.0[patch + offset / PATCH] |= 1 << (offset % PATCH);
    }

    pub fn unmark(&mut self, patch: usize, offset: usize) {
        self.0[patch + offset / PATCH] &= !(1 << (offset % PATCH));
    }

    pub fn is_marked(&self, patch: usize, offset: usize) -> bool {
        self.0[patch + offset / PATCH] >> (offset % PATCH) & 1 == 1
    }

    /// Marks several samples of one patch.
    pub fn mark_bits(&mut self, patch: usize, bits: u32) {
        self.0[patch] |= bits;
    }

    /// Adds the row to `rows` and clears it.
    pub fn end(&mut self, rows: &mut SegmentRows) {
        for (bits, patch) in self.0.iter_mut().zip(0..) {
            rows.see(patch, std::mem::take(bits));
        }
        rows.end_row();
    }
}
