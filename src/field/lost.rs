//! Cells of samples that a view covered which is no more: whether some other one covers them.
//!
//! Most of them are found where the edit was, and whoever finds the last of a sample's cells spares all others the look at it. Which are found does not depend
//! on who comes first: as long as one is missing, everybody who sees the sample looks.

use std::sync::atomic::{AtomicU64, Ordering};

use overfly_table::rows::ones;
use overfly_table::{SampleSet, Segment};
use rayon::prelude::*;

use super::build::FieldInputs;
use super::rows::Targets;
use super::tiles::Tile;
use crate::coverage::Mask;

/// The rows of all tiles, with the first samples of their patches.
pub struct Rows<'r> {
    pub tiles: &'r [Tile],
    pub segments: &'r [Segment],
    pub patches: &'r [Vec<u32>],
    /// Whether a tile is as it was before.
    pub is_kept: &'r [bool],
}

/// Of cells by sample those that some viewpoint covers.
pub fn covered(cells: &[Mask], rows: &Rows, inputs: &FieldInputs, targets: &Targets) -> Vec<Mask> {
    let search = Search { missing: Missing::new(cells), rows, inputs, targets };
    for is_kept in [false, true] {
        let asked = search.missing.samples();
        let tiles: Vec<usize> = (0..rows.tiles.len()).filter(|&tile| rows.is_kept[tile] == is_kept).collect();
        tiles.into_par_iter().with_max_len(1).for_each(|tile| search.ask(tile, &asked));
    }
    search.missing.left().zip(cells).map(|(left, cells)| cells & !left).collect()
}

struct Search<'s> {
    missing: Missing,
    rows: &'s Rows<'s>,
    inputs: &'s FieldInputs<'s>,
    targets: &'s Targets,
}

impl Search<'_> {
    /// Looks at all samples that are asked for and that a tile's viewpoints see.
    fn ask(&self, tile: usize, asked: &SampleSet) {
        let Self { missing, rows, inputs, targets } = self;
        let patches = &rows.patches[tile];
        let mut asked: Vec<u32> = patches.iter().map(|&first| asked.bits_from(first as usize)).collect();
        if asked.iter().all(|bits| *bits == 0) {
            return;
        }
        for (row, site) in rows.tiles[tile].sites().enumerate() {
            let view = &site.viewpoint.position;
            for seen in rows.segments[tile].row(row) {
                let patch = seen.patch as usize;
                for b in ones(seen.bits & asked[patch]) {
                    let i = patches[patch] as usize + b;
                    if missing.is_any(i) {
                        missing.find(i, inputs.disks.mask(&targets.frames[i], view));
                    } else {
                        asked[patch] &= !(1 << b);
                    }
                }
            }
        }
    }
}

/// Cells of each sample that nobody has found yet, in halves because there are no larger atomics.
struct Missing(Vec<[AtomicU64; 2]>);

impl Missing {
    fn new(cells: &[Mask]) -> Self {
        Self(cells.iter().map(|&cells| halves(cells).map(AtomicU64::new)).collect())
    }

    fn is_any(&self, i: usize) -> bool {
        self.0[i].iter().any(|half| half.load(Ordering::Relaxed) != 0)
    }

    fn find(&self, i: usize, found: Mask) {
        self.0[i].iter().zip(halves(found)).for_each(|(half, found)| {
            half.fetch_and(!found, Ordering::Relaxed);
        });
    }

    /// The samples some of whose cells are missing.
    fn samples(&self) -> SampleSet {
        let mut samples = SampleSet::none_of(self.0.len());
        (0..self.0.len()).filter(|&i| self.is_any(i)).for_each(|i| samples.insert(i));
        samples
    }

    fn left(self) -> impl Iterator<Item = Mask> {
        let whole = |[low, high]: [u64; 2]| Mask::from(low) | Mask::from(high) << 64;
        self.0.into_iter().map(move |halves| whole(halves.map(AtomicU64::into_inner)))
    }
}

fn halves(mask: Mask) -> [u64; 2] {
    [mask as u64, (mask >> 64) as u64]
}
