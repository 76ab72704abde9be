//! Viewpoints in strips: those of all columns of the lattice that stand side by side in one direction.
//!
//! A strip never changes and is shared by the fields before and after an edit, so that an edit costs what lies near it and not what lies in the city. What
//! tiles take of a strip is found once, when the strip is made.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::tiles::{Tile, TileGrid};
use super::viewpoints::Site;
use crate::scene::Bounds;

/// Sites whose cells have the same first index, in the order of their cells; never none.
#[derive(Debug, PartialEq)]
pub struct Strip {
    sites: Vec<Site>,
    /// Those of one tile follow each other.
    stretches: Vec<Stretch>,
    /// Nothing stands above any of them.
    is_open: bool,
}

/// The sites of a strip that lie in one tile.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// The tile's place among those of the lattice.
    pub key: [i64; 2],
    pub sites: Range<usize>,
    /// Box around its viewpoints, m.
    pub bounds: Bounds,
}

impl Strip {
    /// `None` without any sites.
    pub fn new(sites: Vec<Site>, grid: TileGrid) -> Option<Arc<Self>> {
        let (mut stretches, mut start) = (Vec::new(), 0);
        for stretch in sites.chunk_by(|a, b| grid.key(&a.cell) == grid.key(&b.cell)) {
            let bounds = Bounds::of_points(stretch.iter().map(|site| site.viewpoint.position))?;
            stretches.push(Stretch { key: grid.key(&stretch[0].cell), sites: start..start + stretch.len(), bounds });
            start += stretch.len();
        }
        let is_open = sites.iter().all(|site| site.is_open);
        (!sites.is_empty()).then(|| Arc::new(Self { sites, stretches, is_open }))
    }

    /// All of some sites, which are in the order of their cells.
    pub fn all_of(sites: Vec<Site>, grid: TileGrid) -> Vec<Arc<Self>> {
        let strips: Vec<&[Site]> = sites.chunk_by(|a, b| a.cell[0] == b.cell[0]).collect();
        strips.into_par_iter().filter_map(|sites| Self::new(sites.to_vec(), grid)).collect()
    }

    /// The place among strips, which are in their order, of that whose cells have such a first index.
    pub fn find(strips: &[Arc<Self>], x: i64) -> Option<usize> {
        strips.binary_search_by_key(&x, |strip| strip.x()).ok()
    }

    /// The first index of its cells.
    pub fn x(&self) -> i64 {
        self.sites[0].cell[0]
    }

    pub fn sites(&self) -> &[Site] {
        &self.sites
    }

    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Where the sites of a column are, or would be.
    pub fn column(&self, y: i64) -> Range<usize> {
        let first = self.sites.partition_point(|site| site.cell[1] < y);
        first..first + self.sites[first..].partition_point(|site| site.cell[1] == y)
    }
}

/// The viewpoints of a field: they are numbered in the order of their cells.
#[derive(Clone, Debug)]
pub struct Viewpoints {
    strips: Vec<Arc<Strip>>,
    count: usize,
}

impl Viewpoints {
    /// `strips` in their order.
    pub fn new(strips: Vec<Arc<Strip>>) -> Self {
        let count = strips.iter().map(|strip| strip.sites.len()).sum();
        Self { strips, count }
    }

    pub fn len(&self) -> usize {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    pub fn sites(&self) -> impl Iterator<Item = &Site> {
        self.strips.iter().flat_map(|strip| strip.sites.iter())
    }

    /// All tiles that have viewpoints, by their keys.
    pub fn tiles(&self) -> Vec<Tile> {
        let (mut tiles, mut first) = (BTreeMap::<[i64; 2], Tile>::new(), 0);
        for strip in &self.strips {
            for (index, stretch) in strip.stretches.iter().enumerate() {
                let tile = tiles.entry(stretch.key).or_insert_with(|| Tile::new(stretch));
                tile.add(Part { strip: Arc::clone(strip), index, first: first + stretch.sites.start as u32 });
            }
            first += strip.sites.len() as u32;
        }
        tiles.into_values().collect()
    }
}

/// A stretch as a part of a tile.
#[derive(Clone, Debug)]
pub struct Part {
    strip: Arc<Strip>,
    index: usize,
    /// Number of its first viewpoint in the field.
    first: u32,
}

impl Part {
    pub fn stretch(&self) -> &Stretch {
        &self.strip.stretches[self.index]
    }

    pub fn sites(&self) -> &[Site] {
        &self.strip.sites[self.stretch().sites.clone()]
    }

    /// Its viewpoints with their numbers in the field.
    pub fn numbered(&self) -> impl Iterator<Item = (u32, &Site)> {
        (self.first..).zip(self.sites())
    }

    /// Whether it has the same cells as another one.
    pub fn has_cells_of(&self, other: &Self) -> bool {
        let is_same = Arc::ptr_eq(&self.strip, &other.strip) && self.index == other.index;
        is_same || self.sites().iter().map(|site| site.cell).eq(other.sites().iter().map(|site| site.cell))
    }
}
