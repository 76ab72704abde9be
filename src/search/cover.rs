//! What the views on the way to a node cover. A node sees little that its parent has not seen, and that lies together: so the samples are put in the order
//! of tiles, in pages, and a node shares the pages that its leg does not touch. A tree over a town then takes memory by what its legs see,
//! not by what the town has.

use std::cell::Cell;
use std::rc::Rc;

use multiversion::multiversion;

use crate::coverage::union::{Gained, Observations};
use crate::coverage::{Information, Mask, SampleFrame};

/// Edge of a tile, m: about half of the range of a view, so that a leg touches a dozen of them.
const TILE_M: f64 = 40.0;

/// Samples of a page.
const PAGE: usize = 32;

/// Where each sample stands in the order of tiles.
#[derive(Clone, Debug)]
pub struct Places {
    of: Vec<u32>,
}

/// The covered cells of samples that stand next to each other.
struct Page {
    masks: [Mask; PAGE],
    /// How many pages there are of this tree.
    count: Rc<Cell<usize>>,
}

/// The cells of each sample that are covered; shares its pages with those that it was cloned from.
#[derive(Clone)]
pub struct Cover {
    /// `None` where nothing is covered.
    pages: Vec<Option<Rc<Page>>>,
    count: Rc<Cell<usize>>,
}

impl Places {
    pub fn new(frames: &[SampleFrame]) -> Self {
        let tile = |v: f64| (v / TILE_M).floor() as i64;
        let key = |&i: &u32| {
            let position = &frames[i as usize].position;
            (tile(position.x), tile(position.y), i)
        };
        let mut order: Vec<u32> = (0..frames.len() as u32).collect();
        order.sort_unstable_by_key(key);
        let mut of = vec![0; order.len()];
        order.iter().zip(0..).for_each(|(&i, place)| of[i as usize] = place);
        Self { of }
    }
}

impl Cover {
    pub fn nothing(places: &Places) -> Self {
        Self { pages: vec![None; places.of.len().div_ceil(PAGE)], count: Rc::default() }
    }

    /// Of each sample such cells.
    pub fn of(cells: &[Mask], places: &Places) -> Self {
        let mut cover = Self::nothing(places);
        for (&mask, &place) in cells.iter().zip(&places.of).filter(|(mask, _)| **mask != 0) {
            *cover.cells_mut(place as usize) |= mask;
        }
        cover
    }

    /// The covered cells of sample `i`.
    pub fn cells(&self, places: &Places, i: usize) -> Mask {
        cells(&self.pages, places.of[i] as usize)
    }

    /// Area-weighted cells that `seen` adds (Eq. 2); `areas_mm2` by sample.
    pub fn gain(&self, places: &Places, seen: &Observations, areas_mm2: &[u64]) -> Information {
        gain_kernel(&self.pages, &places.of, seen, areas_mm2)
    }

    /// Adds `seen`. A sample counts as captured when more cells are covered than `thresholds` has for it.
    pub fn add(&mut self, places: &Places, seen: &Observations, areas_mm2: &[u64], thresholds: &[u32]) -> Gained {
        let mut gained = Gained::default();
        for (i, mask) in seen.iter() {
            let place = places.of[i] as usize;
            let covered = cells(&self.pages, place);
            // A page to which nothing is added stays shared.
            if mask & !covered != 0 {
                *self.cells_mut(place) |= mask;
                let (before, after) = (covered.count_ones(), (covered | mask).count_ones());
                gained.information += u64::from(after - before) * areas_mm2[i];
                gained.captured += u32::from(before <= thresholds[i] && after > thresholds[i]);
            }
        }
        gained
    }

    /// Memory of all pages of this tree, bytes.
    pub fn page_bytes(&self) -> usize {
        self.count.get() * size_of::<Page>()
    }

    /// Memory that each cover takes for itself, bytes.
    pub fn own_bytes(&self) -> usize {
        self.pages.len() * size_of::<Option<Rc<Page>>>()
    }

    fn cells_mut(&mut self, place: usize) -> &mut Mask {
        let page = self.pages[place / PAGE].get_or_insert_with(|| Rc::new(Page::new([0; PAGE], &self.count)));
        &mut Rc::make_mut(page).masks[place % PAGE]
    }
}

impl Page {
    fn new(masks: [Mask; PAGE], count: &Rc<Cell<usize>>) -> Self {
        count.set(count.get() + 1);
        Self { masks, count: Rc::clone(count) }
    }
}

impl Clone for Page {
    fn clone(&self) -> Self {
        Self::new(self.masks, &self.count)
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.count.set(self.count.get() - 1);
    }
}

impl std::fmt::Debug for Cover {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Cover of {} of {} pages", self.pages.iter().flatten().count(), self.pages.len())
    }
}

fn cells(pages: &[Option<Rc<Page>>], place: usize) -> Mask {
    pages[place / PAGE].as_ref().map_or(0, |page| page.masks[place % PAGE])
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+popcnt", "x86_64+popcnt", "aarch64+neon"))]
fn gain_kernel(pages: &[Option<Rc<Page>>], places: &[u32], seen: &Observations, areas_mm2: &[u64]) -> Information {
    let mut information = 0;
    for (i, mask) in seen.iter() {
        let covered = cells(pages, places[i] as usize);
        information += u64::from((mask & !covered).count_ones()) * areas_mm2[i];
    }
    information
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::coverage::union;

    fn frames(places: &[[f64; 2]]) -> Vec<SampleFrame> {
        places.iter().map(|&[x, y]| SampleFrame::new(Point3::new(x, y, 0.0), Vector3::z())).collect()
    }

    proptest! {
        #[test]
        fn a_cover_is_what_a_row_of_masks_would_be_and_leaves_its_origin_alone(
            rows in proptest::collection::vec(([-300.0..300.0f64, -300.0..300.0], any::<u128>(), 1u64..1000, 0u32..130), 1..300),
            steps in proptest::collection::vec((0usize..4, proptest::collection::vec((any::<u16>(), any::<u128>()), 1..40)), 1..12),
        ) {
            let places = Places::new(&frames(&rows.iter().map(|row| row.0).collect::<Vec<_>>()));
            let (areas, thresholds): (Vec<u64>, Vec<u32>) = rows.iter().map(|row| (row.2, row.3)).unzip();
            let first: Vec<Mask> = rows.iter().map(|row| row.1).collect();
            let mut all = vec![(first.clone(), Cover::of(&first, &places))];
            for (from, sights) in steps {
                let mut seen: Vec<(u32, Mask)> = sights.into_iter().map(|(i, mask)| (u32::from(i) % rows.len() as u32, mask)).collect();
                seen.sort_by_key(|one| one.0);
                seen.dedup_by_key(|one| one.0);
                let (samples, masks) = seen.into_iter().unzip();
                let seen = Observations::new(samples, masks);
                let (mut dense, mut cover) = all[from % all.len()].clone();
                prop_assert_eq!(cover.gain(&places, &seen, &areas), union::gain(&dense, &seen, &areas));
                prop_assert_eq!(cover.add(&places, &seen, &areas, &thresholds), union::cover(&mut dense, &seen, &areas, &thresholds));
                all.push((dense, cover));
            }
            for (dense, cover) in &all {
                prop_assert!(dense.iter().enumerate().all(|(i, mask)| cover.cells(&places, i) == *mask));
            }
            // Every page that is held is counted once.
            let held: std::collections::HashSet<*const Page> =
                all.iter().flat_map(|(_, cover)| cover.pages.iter().flatten()).map(Rc::as_ptr).collect();
            prop_assert_eq!(all[0].1.page_bytes(), held.len() * size_of::<Page>());
        }
    }
}
