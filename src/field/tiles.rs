//! Tiles: viewpoints of neighbouring columns of the lattice. The rows of a tile's viewpoints lie in one segment, and what they may see is found out once
//! for all of them, so that time and memory of a field grow with the area and not with its square.

use overfly_table::SegmentRows;
use overfly_table::rows::PATCH;

use super::rows::Group;
use super::strips::{Part, Stretch};
use super::viewpoints::{Cell, Site};
use crate::coverage::Mask;
use crate::scene::Bounds;

/// Edge of a tile, m, as far as columns of the lattice allow: about what the range of a view is, so that an edit touches a dozen of them.
const EDGE_M: f64 = 80.0;

/// How the columns of a lattice lie in tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileGrid {
    /// Columns along the edge of a tile.
    columns: i64,
}

impl TileGrid {
    /// Of a lattice with such a spacing.
    pub fn new(spacing_m: f64) -> Self {
        Self { columns: (EDGE_M / spacing_m).round().max(1.0) as i64 }
    }

    /// The place of a cell's tile among the tiles of the lattice.
    pub fn key(self, cell: &Cell) -> [i64; 2] {
        [cell[0], cell[1]].map(|place| place.div_euclid(self.columns))
    }
}

/// The viewpoints whose rows lie in one segment.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Its place among the tiles of the lattice.
    pub key: [i64; 2],
    /// Its viewpoints in the order of their cells.
    parts: Vec<Part>,
    /// Box around its viewpoints, m.
    pub bounds: Bounds,
}

impl Tile {
    /// The tile of a stretch, as yet without viewpoints.
    pub fn new(stretch: &Stretch) -> Self {
        Self { key: stretch.key, parts: Vec::new(), bounds: stretch.bounds }
    }

    /// Adds what comes next in the order of cells.
    pub fn add(&mut self, part: Part) {
        self.bounds = self.bounds.union(&part.stretch().bounds);
        self.parts.push(part);
    }

    /// How many viewpoints it has.
    pub fn viewpoints(&self) -> usize {
        self.parts.iter().map(|part| part.sites().len()).sum()
    }

    /// Its viewpoints with their cells.
    pub fn sites(&self) -> impl Iterator<Item = &Site> {
        self.parts.iter().flat_map(Part::sites)
    }

    /// The same with their numbers in the field.
    pub fn numbered(&self) -> impl Iterator<Item = (u32, &Site)> {
        self.parts.iter().flat_map(Part::numbered)
    }

    /// Whether its viewpoints lie in the same cells as those of another one.
    pub fn has_cells_of(&self, other: &Self) -> bool {
        self.parts.len() == other.parts.len() && self.parts.iter().zip(&other.parts).all(|(part, other)| part.has_cells_of(other))
    }
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
    pub fn merge(&self, masks: &[Mask], all: &mut [Mask]) {
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
