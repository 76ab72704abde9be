//! The visibility of a field after an edit, from the field before: only tiles that the edit can have changed are looked at, and in them only pairs of
//! viewpoints and samples that it can have changed. The other tiles keep their segments.
//!
//! A pair whose viewpoint and sample are as before can change only when its line of sight meets what has come, if it was free, or what has gone, if it
//! was blocked. What results equals a field that is built anew, bit for bit (`tests/field_is_exact.rs`).

use std::sync::{Mutex, MutexGuard, PoisonError};

use nalgebra::Point3;
use overfly_table::rows::{PATCH, SeenRow, ones};
use overfly_table::{FieldTable, Segment, SegmentRows};
use rayon::prelude::*;

use super::build::{FieldInputs, SLACK_M};
use super::lost::{self, Rows};
use super::rows::{Group, Place, Targets, Visibility, write};
use super::survey::FieldError;
use super::tiles::{Reach, RowBits, Tile};
use super::viewpoints::{Cell, Site};
use crate::coverage::{Mask, SampleFrame};
use crate::scene::Bounds;
use crate::scene::clearance::{Clearance, Exchange};
use crate::scene::differences::Differences;
use crate::stop::StopToken;
use crate::surface::Samples;

/// What an update goes out from: the field before with what it was built of.
pub struct Earlier<'a> {
    pub field: FieldTable<'a>,
    pub tiles: &'a [Tile],
    pub samples: &'a Samples,
    pub clearance: &'a Clearance,
    /// What all viewpoints together cover of each sample.
    pub unions: &'a [Mask],
}

/// The samples of a field beside those of the one before.
pub struct Seen {
    /// For each sample its place there, where it was the same and as exposed.
    pub same: Vec<Option<u32>>,
    /// Whether a viewpoint sees the sample that did not before, or the other way round.
    pub is_touched: Vec<bool>,
    /// The surfaces that only one of the scenes has.
    pub exchange: Exchange,
}

/// By sample: cells that came, cells of disks that are seen no more, and whether a viewpoint sees it that did not before or the other way round.
struct Found {
    gained: Vec<Mask>,
    lost: Vec<Mask>,
    is_touched: Vec<bool>,
}

struct Update<'a> {
    inputs: &'a FieldInputs<'a>,
    earlier: &'a Earlier<'a>,
    targets: Targets,
    groups: Vec<Group>,
    /// By earlier sample: its place now; `NOWHERE` where its structure is no more.
    now: Vec<u32>,
    /// By sample: whether it is as before.
    is_kept: Vec<bool>,
    gone: Vec<Bounds>,
    come: Vec<Bounds>,
    exchange: Exchange,
    found: Mutex<Found>,
}

const NOWHERE: u32 = u32::MAX;

/// A patch of an earlier segment: its patch in the reach, and which of its samples are as before.
#[derive(Clone, Copy)]
struct Moved {
    patch: usize,
    kept: u32,
}

/// An earlier viewpoint with what was seen from it.
struct Before<'a> {
    cell: Cell,
    view: Point3<f64>,
    seen: &'a [SeenRow],
}

/// A group of a reach that has to be looked at.
#[derive(Clone, Copy)]
struct Suspect {
    number: usize,
    /// Some of its samples are not as before.
    is_renewed: bool,
}

/// A tile that is updated: what it may see, and what is found.
struct Work<'a> {
    reach: Reach<'a>,
    /// Cells of samples that a viewpoint sees that it did not see before, and the other way round: mostly of a few samples among all in reach.
    gained: Vec<(usize, Mask)>,
    lost: Vec<(usize, Mask)>,
    /// Boxes within reach in which something stood, and stands now.
    gone: Vec<Bounds>,
    come: Vec<Bounds>,
    /// The groups of the reach some of whose samples are not as before, and those to which a line of sight may lead over what changed.
    suspects: Vec<Suspect>,
    /// By patch of the earlier segment.
    moved: Vec<Moved>,
}

impl Work<'_> {
    /// Whether nothing within reach of a viewpoint has come or gone. So no sample that it sees or could see is exposed otherwise than before: what is put in
    /// front of it, or taken away, is no farther from it than its line of sight ends.
    fn is_far_from(&self, view: &Point3<f64>, reach_m: f64) -> bool {
        !self.gone.iter().chain(&self.come).any(|bounds| bounds.distance_squared(view) <= reach_m * reach_m)
    }

    /// Adds a row that is as before: what is kept keeps its order.
    fn copy_row(&self, before: &Before, rows: &mut SegmentRows) {
        for seen in before.seen {
            let Moved { patch, kept } = self.moved[seen.patch as usize];
            rows.see(patch as u32, seen.bits & kept);
        }
        rows.end_row();
    }
}

/// The visibility of the viewpoints in `tiles`, of a scene that differs from the earlier one, and how its samples compare with that one's.
pub fn update_rows<E: From<FieldError> + Send>(
    inputs: &FieldInputs,
    tiles: &[Tile],
    differences: &Differences,
    earlier: &Earlier,
    place: &Place<E>,
    stop: &StopToken,
) -> Result<(Visibility, Seen), E> {
    let update = Update::new(inputs, differences, earlier);
    let earlier_of = |tile: &Tile| earlier.tiles.binary_search_by_key(&tile.key, |old| old.key).ok();
    let of_tile = |number: usize| {
        let tile = &tiles[number];
        if stop.is_stopped() {
            return Err(FieldError::Stopped.into());
        }
        match earlier_of(tile) {
            Some(old) if update.is_as_before(tile, old) => Ok((number, update.kept_tile(old), true)),
            old => Ok((number, update.tile(tile, old, place, stop)?, false)),
        }
    };
    // Those that have most to do come first, so that nobody is left alone with one of them in the end.
    let mut order: Vec<(f64, usize)> = tiles.iter().map(|tile| update.distance_squared(tile)).zip(0..).collect();
    order.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    let rows: Result<Vec<_>, E> = order.into_iter().par_bridge().map(|(_, number)| of_tile(number)).collect();
    let mut rows = rows?;
    rows.sort_unstable_by_key(|(number, ..)| *number);
    let is_vanished = |old: &usize| tiles.binary_search_by_key(&earlier.tiles[*old].key, |tile| tile.key).is_err();
    (0..earlier.tiles.len()).filter(is_vanished).for_each(|old| update.drop_tile(old));
    let is_kept: Vec<bool> = rows.iter().map(|(.., is_kept)| *is_kept).collect();
    let (segments, patches): (Vec<Segment>, Vec<Vec<u32>>) = rows.into_iter().map(|(_, row, _)| row).unzip();
    let unions = update.unions(&Rows { tiles, segments: &segments, patches: &patches, is_kept: &is_kept });
    let (seen, frames) = update.into_parts();
    Ok((Visibility { segments, patches, unions, frames }, seen))
}

impl<'a> Update<'a> {
    fn new(inputs: &'a FieldInputs<'a>, differences: &Differences, earlier: &'a Earlier<'a>) -> Self {
        let samples = &inputs.samples.samples;
        let compared = || {
            let (mut now_of, mut is_kept) = (vec![NOWHERE; earlier.samples.samples.len()], vec![false; samples.len()]);
            for (structure, old) in differences.kept.iter().enumerate() {
                let Some(old) = *old else { continue };
                for (now, before) in inputs.samples.range(structure).zip(earlier.samples.range(old)) {
                    now_of[before] = now as u32;
                    // One that was buried and is not any more is as good as new, and the other way round.
                    is_kept[now] = samples[now].exposed == earlier.samples.samples[before].exposed;
                }
            }
            (now_of, is_kept, Exchange::between(earlier.clearance, &inputs.free.clearance, differences))
        };
        let ((now, is_kept, exchange), (targets, groups)) = rayon::join(compared, || (Targets::new(inputs), Group::all(inputs)));
        let grown = |boxes: &[Bounds]| boxes.iter().map(|bounds| bounds.grown(SLACK_M)).collect();
        let nothing = || vec![0; samples.len()];
        Self {
            inputs,
            earlier,
            targets,
            groups,
            now,
            is_kept,
            gone: grown(&differences.gone),
            come: grown(&differences.come),
            exchange,
            found: Mutex::new(Found { gained: nothing(), lost: nothing(), is_touched: vec![false; samples.len()] }),
        }
    }

    /// Whether nothing that the viewpoints of a tile may see, and nothing that may stand between, has changed since it was earlier tile `old`.
    fn is_as_before(&self, tile: &Tile, old: usize) -> bool {
        let grown = tile.bounds.grown(self.inputs.reach_m());
        let mut changed = self.gone.iter().chain(&self.come);
        !changed.any(|bounds| bounds.meets(&grown)) && tile.has_cells_of(&self.earlier.tiles[old])
    }

    /// How far the middle of a tile is from what has changed, squared, m^2.
    fn distance_squared(&self, tile: &Tile) -> f64 {
        let middle = nalgebra::center(&tile.bounds.min, &tile.bounds.max);
        self.gone.iter().chain(&self.come).map(|bounds| bounds.distance_squared(&middle)).fold(f64::INFINITY, f64::min)
    }

    /// A tile that keeps its segment: only where its patches lie among all samples is new.
    fn kept_tile(&self, old: usize) -> (Segment, Vec<u32>) {
        let patches = self.earlier_patches(old).iter().map(|&first| self.now[first as usize]).collect();
        (self.earlier.field.segments[old].clone(), patches)
    }

    fn tile<E: From<FieldError>>(
        &self,
        tile: &Tile,
        old: Option<usize>,
        place: &Place<E>,
        stop: &StopToken,
    ) -> Result<(Segment, Vec<u32>), E> {
        let mut work = self.work(&tile.bounds, old);
        let mut before = self.rows_before(old).peekable();
        let (mut bits, mut rows) = (work.reach.row(), SegmentRows::default());
        for site in tile.sites() {
            if stop.is_stopped() {
                return Err(FieldError::Stopped.into());
            }
            let cell = site.cell;
            while let Some(dropped) = before.next_if(|old| old.cell < cell) {
                self.drop_row(&dropped, &mut work);
            }
            let view = &site.viewpoint.position;
            match before.next_if(|old| old.cell == cell) {
                Some(old) if work.is_far_from(view, self.inputs.reach_m()) => work.copy_row(&old, &mut rows),
                old => {
                    self.fill_row(view, old, &mut bits, &mut work);
                    bits.end(&mut rows);
                }
            }
        }
        before.for_each(|dropped| self.drop_row(&dropped, &mut work));
        self.merge(&work);
        let patches = work.reach.number(&mut rows);
        let same = old.map(|old| &self.earlier.field.segments[old]).filter(|segment| rows.is_in(segment));
        let segment = same.map_or_else(|| write(&rows, place), |same| Ok(same.clone()))?;
        Ok((segment, patches))
    }

    /// An earlier tile that has no viewpoint any more.
    fn drop_tile(&self, old: usize) {
        let mut work = self.work(&self.earlier.tiles[old].bounds, Some(old));
        self.rows_before(Some(old)).for_each(|dropped| self.drop_row(&dropped, &mut work));
        self.merge(&work);
    }

    fn work(&self, bounds: &Bounds, old: Option<usize>) -> Work<'_> {
        let bounds = old.map_or(*bounds, |old| self.earlier.tiles[old].bounds.union(bounds));
        let reach = Reach::of(&bounds, self.inputs.reach_m(), &self.groups);
        let moved = old.map(|old| self.earlier_patches(old).iter().map(|&first| self.moved(first, &reach)).collect());
        let grown = bounds.grown(self.inputs.reach_m());
        let near = |boxes: &[Bounds]| boxes.iter().copied().filter(|changed| changed.meets(&grown)).collect();
        let (gone, come): (Vec<Bounds>, Vec<Bounds>) = (near(&self.gone), near(&self.come));
        let suspect = |(number, (group, _)): (usize, &(&Group, usize))| {
            let is_renewed = !self.is_kept[group.samples.clone()].iter().all(|is_kept| *is_kept);
            let may_change = |changed: &Bounds| changed.may_lie_between(&bounds, &group.bounds);
            (is_renewed || gone.iter().chain(&come).any(may_change)).then_some(Suspect { number, is_renewed })
        };
        let suspects: Vec<Suspect> = reach.groups.iter().enumerate().filter_map(suspect).collect();
        let moved = moved.unwrap_or_default();
        Work { gained: Vec::new(), lost: Vec::new(), gone, come, suspects, moved, reach }
    }

    /// The patch that began at the earlier sample `first`.
    fn moved(&self, first: u32, reach: &Reach) -> Moved {
        let now = self.now[first as usize];
        let Some(patch) = reach.patch(now) else { return Moved { patch: 0, kept: 0 } };
        // Beyond the structure's last sample nothing was seen.
        let kept = self.is_kept[now as usize..].iter().take(PATCH).zip(0..);
        Moved { patch, kept: kept.fold(0, |bits, (&is_kept, b)| bits | u32::from(is_kept) << b) }
    }

    fn earlier_patches(&self, old: usize) -> &'a [u32] {
        self.earlier.field.patches_of(&self.earlier.field.tiles[old])
    }

    /// The viewpoints of an earlier tile.
    fn rows_before(&self, old: Option<usize>) -> impl Iterator<Item = Before<'a>> + use<'a> {
        let Earlier { field, tiles, .. } = self.earlier;
        old.into_iter().flat_map(move |old| {
            let before = move |(row, site): (usize, &Site)| Before {
                cell: site.cell,
                view: site.viewpoint.position,
                seen: field.segments[old].row(row),
            };
            tiles[old].sites().enumerate().map(before)
        })
    }

    /// The row of a viewpoint, which may have been there before.
    fn fill_row(&self, view: &Point3<f64>, before: Option<Before>, bits: &mut RowBits, work: &mut Work) {
        let Work { reach, gained, lost, gone, come, suspects, moved } = work;
        let mask = |i: usize| self.inputs.disks.mask(&self.targets.frames[i], view);
        let Some(before) = before else {
            self.targets.seen_from(self.inputs, reach, view, |i, patch, offset| {
                bits.mark(patch, offset);
                gained.push((i, mask(i)));
            });
            return;
        };
        for seen in before.seen {
            let Moved { patch, kept } = moved[seen.patch as usize];
            bits.mark_bits(patch, seen.bits & kept);
        }
        let reach_m = self.inputs.reach_m();
        let in_range = |bounds: &Bounds| bounds.distance_squared(view) <= reach_m * reach_m;
        let near = |boxes: &[Bounds]| boxes.iter().copied().filter(in_range).collect::<Vec<_>>();
        let (gone, come) = (near(gone), near(come));
        for &Suspect { number, is_renewed } in &*suspects {
            let (group, patch) = reach.groups[number];
            if !in_range(&group.bounds) {
                continue;
            }
            // All lines of sight to the structure lie in here.
            let lines = Bounds { min: group.bounds.min.inf(view), max: group.bounds.max.sup(view) };
            let are_crossed =
                |boxes: &[Bounds]| boxes.iter().any(|bounds| bounds.meets(&lines) && group.bounds.may_be_behind(bounds, view));
            let (is_any_gone, has_any_come) = (are_crossed(&gone), are_crossed(&come));
            if !(is_renewed || is_any_gone || has_any_come) {
                continue;
            }
            for (i, offset) in group.samples.clone().zip(0..) {
                let end = &self.targets.ends[i];
                let was_seen = self.is_kept[i] && bits.is_marked(patch, offset);
                if was_seen && has_any_come && self.exchange.may_change(false, view, end) {
                    bits.unmark(patch, offset);
                    lost.push((i, mask(i)));
                } else if !was_seen && self.may_be_seen(i, is_any_gone, view) && self.targets.is_seen(self.inputs, i, view) {
                    bits.mark(patch, offset);
                    gained.push((i, mask(i)));
                }
            }
        }
    }

    /// Whether a sample that was not seen from a place may be seen now, when lines to its structure lead over something that is gone, or not.
    fn may_be_seen(&self, i: usize, is_any_gone: bool, view: &Point3<f64>) -> bool {
        let may_change =
            || self.targets.faces(self.inputs, i, view) && self.exchange.may_change(true, view, &self.targets.ends[i]);
        !self.is_kept[i] || is_any_gone && may_change()
    }

    /// A viewpoint that is no more.
    fn drop_row(&self, dropped: &Before, work: &mut Work) {
        for seen in dropped.seen {
            let Moved { patch, kept } = work.moved[seen.patch as usize];
            for b in ones(seen.bits & kept) {
                let i = work.reach.first(patch) + b;
                work.lost.push((i, self.inputs.disks.mask(&self.targets.frames[i], &dropped.view)));
            }
        }
    }

    /// What all viewpoints together cover of each sample. Of cells that a lost view covered it is asked who else covers them.
    fn unions(&self, rows: &Rows) -> Vec<Mask> {
        let Found { gained, lost, .. } = &*self.lock();
        let in_doubt: Vec<Mask> = lost.iter().zip(gained).map(|(lost, gained)| lost & !gained).collect();
        let covered = lost::covered(&in_doubt, rows, self.inputs, &self.targets);
        let mut unions = gained.clone();
        for (&now, before) in self.now.iter().zip(self.earlier.unions).filter(|(now, _)| **now != NOWHERE) {
            let i = now as usize;
            if self.is_kept[i] {
                unions[i] |= before & !(in_doubt[i] & !covered[i]);
            }
        }
        unions
    }

    /// The samples beside those of the field before, and as targets.
    fn into_parts(self) -> (Seen, Vec<SampleFrame>) {
        let mut same = vec![None; self.is_kept.len()];
        for (old, &now) in self.now.iter().enumerate().filter(|(_, now)| **now != NOWHERE) {
            same[now as usize] = self.is_kept[now as usize].then_some(old as u32);
        }
        let Found { is_touched, .. } = self.found.into_inner().unwrap_or_else(PoisonError::into_inner);
        (Seen { same, is_touched, exchange: self.exchange }, self.targets.frames)
    }

    fn merge(&self, work: &Work) {
        let mut found = self.lock();
        let Found { gained, lost, is_touched } = &mut *found;
        for (all, changed) in [(gained, &work.gained), (lost, &work.lost)] {
            for &(i, mask) in changed {
                all[i] |= mask;
                is_touched[i] = true;
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Found> {
        self.found.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
