//! The visibility of a field after an edit, from the field before: only pairs of viewpoints and samples that the edit can have changed are looked at.
//!
//! A pair whose viewpoint and sample are as before can change only when its line of sight leads through a box in which something stood
//! or stands now: one that was free by what has come, one that was blocked by what has gone. What results equals a field that is built anew,
//! bit for bit (`tests/field_is_exact.rs`).

use std::ops::Range;

use nalgebra::Point3;
use overfly_table::FieldTable;
use rayon::prelude::*;

use super::build::{FieldInputs, Group, Targets};
use super::viewpoints::Cell;
use crate::coverage::Mask;
use crate::scene::Bounds;
use crate::scene::differences::Differences;
use crate::stop::StopToken;
use crate::surface::Samples;

/// What an update goes out from: the field before with what it was built of.
pub struct Earlier<'a> {
    pub field: FieldTable<'a>,
    /// The cells of its viewpoints.
    pub cells: &'a [Cell],
    pub samples: &'a Samples,
    /// What all viewpoints together cover of each sample.
    pub unions: &'a [Mask],
}

/// The samples of a field beside those of the one before.
pub struct Seen {
    pub same: Vec<Option<u32>>,
    pub is_touched: Vec<bool>,
}

/// Samples that are those of the earlier field, a run of them at other places.
struct Run {
    before: usize,
    now: Range<usize>,
}

/// Boxes are taken for so much larger, m, that rounding decides nothing.
const SLACK_M: f64 = 1e-3;

/// Rows that a worker takes at once, at least: each of them needs room for what it finds.
const LEAST_ROWS: usize = 256;

/// What one worker finds in its rows, by sample: cells that came, and cells of disks that are seen no more.
#[derive(Clone)]
struct Found {
    gained: Vec<Mask>,
    lost: Vec<Mask>,
    /// Whether a viewpoint sees the sample that did not before, or the other way round.
    is_touched: Vec<bool>,
}

impl Found {
    fn nothing(samples: usize) -> Self {
        Self { gained: vec![0; samples], lost: vec![0; samples], is_touched: vec![false; samples] }
    }

    fn join(mut self, other: Self) -> Self {
        let or = |all: &mut [Mask], more: Vec<Mask>| all.iter_mut().zip(more).for_each(|(mask, more)| *mask |= more);
        or(&mut self.gained, other.gained);
        or(&mut self.lost, other.lost);
        self.is_touched.iter_mut().zip(other.is_touched).for_each(|(is_touched, other)| *is_touched |= other);
        self
    }
}

struct Update<'a> {
    inputs: &'a FieldInputs<'a>,
    earlier: &'a Earlier<'a>,
    targets: Targets,
    groups: Vec<Group>,
    /// The groups in which some samples are not as before, all groups, and whether a group is one of the former.
    renewed: Vec<usize>,
    all: Vec<usize>,
    is_renewed: Vec<bool>,
    runs: Vec<Run>,
    /// By sample: whether it is as before.
    is_kept: Vec<bool>,
    gone: Vec<Bounds>,
    come: Vec<Bounds>,
}

/// Fills the rows of `visibility`, which are all zero. Returns what all viewpoints together cover of each sample, and how the field
/// differs from the one before; `None` when stopped.
pub fn update_visibility(
    inputs: &FieldInputs,
    cells: &[Cell],
    differences: &Differences,
    earlier: &Earlier,
    visibility: &mut [u64],
    words_per_row: usize,
    stop: &StopToken,
) -> Option<(Vec<Mask>, Seen)> {
    let update = Update::new(inputs, differences, earlier);
    let before = matches(cells, earlier.cells);
    let count = inputs.samples.samples.len();
    let rows = visibility.par_chunks_mut(words_per_row.max(1)).enumerate().with_min_len(LEAST_ROWS);
    let found = rows
        .try_fold(
            || Found::nothing(count),
            |mut found, (j, row)| {
                if stop.is_stopped() {
                    return None;
                }
                update.fill_row(j, before[j], row, &mut found);
                Some(found)
            },
        )
        .try_reduce(|| Found::nothing(count), |a, b| Some(a.join(b)))?;

    let mut remains = vec![false; earlier.cells.len()];
    before.iter().flatten().for_each(|&old| remains[old] = true);
    let dropped = (0..earlier.cells.len()).into_par_iter().with_min_len(LEAST_ROWS).filter(|&old| !remains[old]);
    let dropped = dropped.fold(
        || Found::nothing(count),
        |mut found, old| {
            update.drop_row(old, &mut found);
            found
        },
    );
    let Found { gained, lost, is_touched } = found.join(dropped.reduce(|| Found::nothing(count), Found::join));

    let mut unions = vec![0; count];
    for Run { before, now } in &update.runs {
        unions[now.clone()].copy_from_slice(&earlier.unions[*before..before + now.len()]);
    }
    let rows: &[u64] = visibility;
    unions.par_iter_mut().enumerate().for_each(|(i, union)| {
        let in_doubt = lost[i] & !gained[i];
        let mut missing = in_doubt;
        for (j, viewpoint) in inputs.viewpoints.iter().enumerate() {
            if missing == 0 {
                break;
            }
            if rows[j * words_per_row + i / 64] >> (i % 64) & 1 == 1 {
                missing &= !inputs.disks.mask(&update.targets.frames[i], &viewpoint.position);
            }
        }
        *union = (*union & !missing) | gained[i];
    });
    let mut same = vec![None; count];
    for Run { before, now } in &update.runs {
        now.clone().for_each(|i| same[i] = Some((before + (i - now.start)) as u32));
    }
    Some((unions, Seen { same, is_touched }))
}

/// For each of the cells its place among the earlier ones; both are in order.
fn matches(cells: &[Cell], earlier: &[Cell]) -> Vec<Option<usize>> {
    let mut old = 0;
    let place = |cell: &Cell| {
        while old < earlier.len() && earlier[old] < *cell {
            old += 1;
        }
        (earlier.get(old) == Some(cell)).then_some(old)
    };
    cells.iter().map(place).collect()
}

impl<'a> Update<'a> {
    fn new(inputs: &'a FieldInputs<'a>, differences: &Differences, earlier: &'a Earlier<'a>) -> Self {
        let samples = &inputs.samples.samples;
        let (mut runs, mut is_kept): (Vec<Run>, _) = (Vec::new(), vec![false; samples.len()]);
        for (structure, old) in differences.kept.iter().enumerate() {
            let Some(old) = *old else { continue };
            for (now, before) in inputs.samples.range(structure).zip(earlier.samples.range(old)) {
                // One that was buried and is not any more is as good as new, and the other way round.
                if samples[now].exposed != earlier.samples.samples[before].exposed {
                    continue;
                }
                is_kept[now] = true;
                match runs.last_mut() {
                    Some(run) if run.now.end == now && run.before + run.now.len() == before => run.now.end += 1,
                    _ => runs.push(Run { before, now: now..now + 1 }),
                }
            }
        }
        let grown = |boxes: &[Bounds]| boxes.iter().map(|bounds| bounds.grown(SLACK_M)).collect();
        let (gone, come) = (grown(&differences.gone), grown(&differences.come));
        let groups = Group::all(inputs);
        let is_renewed: Vec<bool> =
            groups.iter().map(|group| !is_kept[group.samples.clone()].iter().all(|is_kept| *is_kept)).collect();
        let renewed = (0..groups.len()).filter(|&group| is_renewed[group]).collect();
        let all = (0..groups.len()).collect();
        Self { inputs, earlier, targets: Targets::new(inputs), groups, renewed, all, is_renewed, runs, is_kept, gone, come }
    }

    /// The row of viewpoint `j`, which had row `before`.
    fn fill_row(&'a self, j: usize, before: Option<usize>, row: &mut [u64], found: &mut Found) {
        let view = self.inputs.viewpoints[j].position;
        let Some(old) = before else {
            let seen: Vec<usize> = self.targets.seen_from(self.inputs, &self.groups, &view).collect();
            seen.into_iter().for_each(|i| self.gain(i, &view, row, found));
            return;
        };
        let earlier = self.earlier.field.row(old);
        self.runs.iter().for_each(|run| copy_bits(row, run.now.start, earlier, run.before, run.now.len()));
        let range_m = self.inputs.disks.range_m() + self.inputs.offset_m + SLACK_M;
        let in_range = |bounds: &Bounds| bounds.distance_squared(&view) <= range_m * range_m;
        let near = |boxes: &'a [Bounds]| boxes.iter().filter(|bounds| in_range(bounds)).collect::<Vec<_>>();
        let (gone, come) = (near(&self.gone), near(&self.come));
        // Far from every change only samples that are not as before have to be looked at.
        let is_far = gone.is_empty() && come.is_empty();
        let numbers = if is_far { &self.renewed } else { &self.all };
        for &number in numbers {
            let (group, is_renewed) = (&self.groups[number], self.is_renewed[number]);
            if !in_range(&group.bounds) {
                continue;
            }
            // All lines of sight to the structure lie in here.
            let lines = Bounds { min: group.bounds.min.inf(&view), max: group.bounds.max.sup(&view) };
            if !is_renewed && !gone.iter().chain(&come).any(|bounds| bounds.meets(&lines)) {
                continue;
            }
            for i in group.samples.clone() {
                if !self.is_kept[i] {
                    if self.targets.is_seen(self.inputs, i, &view) {
                        self.gain(i, &view, row, found);
                    }
                    continue;
                }
                let was_seen = row[i / 64] >> (i % 64) & 1 == 1;
                let end = &self.targets.ends[i];
                let is_crossed = |boxes: &[&Bounds]| boxes.iter().any(|bounds| bounds.meets_segment(&view, end));
                if was_seen && is_crossed(&come) && self.inputs.clearance.occluded(&view, end) {
                    row[i / 64] &= !(1 << (i % 64));
                    self.lose(i, &view, found);
                } else if !was_seen && is_crossed(&gone) && self.targets.is_seen(self.inputs, i, &view) {
                    self.gain(i, &view, row, found);
                }
            }
        }
    }

    /// Viewpoint `old` of the earlier field is no more.
    fn drop_row(&self, old: usize, found: &mut Found) {
        let view = Point3::from(self.earlier.field.viewpoints[old].position_m);
        let row = self.earlier.field.row(old);
        for Run { before, now } in &self.runs {
            for i in now.clone() {
                let place = before + (i - now.start);
                if row[place / 64] >> (place % 64) & 1 == 1 {
                    self.lose(i, &view, found);
                }
            }
        }
    }

    fn gain(&self, i: usize, view: &Point3<f64>, row: &mut [u64], found: &mut Found) {
        row[i / 64] |= 1 << (i % 64);
        found.gained[i] |= self.mask(i, view);
        found.is_touched[i] = true;
    }

    fn lose(&self, i: usize, view: &Point3<f64>, found: &mut Found) {
        found.lost[i] |= self.mask(i, view);
        found.is_touched[i] = true;
    }

    fn mask(&self, i: usize, view: &Point3<f64>) -> Mask {
        self.inputs.disks.mask(&self.targets.frames[i], view)
    }
}

/// Copies `count` bits of `from`, beginning at bit `from_bit`, to bit `to_bit` of `to`, where they are zero.
fn copy_bits(to: &mut [u64], to_bit: usize, from: &[u64], from_bit: usize, count: usize) {
    let mut done = 0;
    while done < count {
        let (source, target) = (from_bit + done, to_bit + done);
        let some = (count - done).min(64 - source % 64).min(64 - target % 64);
        let bits = from[source / 64] >> (source % 64) & (u64::MAX >> (64 - some));
        to[target / 64] |= bits << (target % 64);
        done += some;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bits_are_copied_one_by_one(from in proptest::collection::vec(any::<u64>(), 4), from_bit in 0usize..128, to_bit in 0usize..128, count in 0usize..128) {
            let bit = |words: &[u64], k: usize| words[k / 64] >> (k % 64) & 1;
            let mut to = vec![0; 4];
            copy_bits(&mut to, to_bit, &from, from_bit, count);
            for k in 0..256 {
                let expected = if (to_bit..to_bit + count).contains(&k) { bit(&from, from_bit + k - to_bit) } else { 0 };
                prop_assert_eq!(bit(&to, k), expected);
            }
        }
    }
}
