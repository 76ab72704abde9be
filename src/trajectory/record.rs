//! What the images of a flight see, kept so that the flight after an edit is looked at anew only where the edit can have changed something.
//!
//! A line of sight between an image and a sample that are both as before can change only when it meets what has come or what has gone. So only images
//! that are new, samples that are new, and such lines are cast again; what results equals what all images would show if they were looked at anew (`tests/plan_resumes.rs`).

use std::collections::HashMap;
use std::sync::Arc;

use nalgebra::distance_squared;
use rayon::prelude::*;

use super::evaluate::{Capture, Caster, Sighting, Sightings, Tally};
use super::known::{Known, SafeFlight};
use super::places::Places;
use super::plan::Image;
use crate::camera::Rig;
use crate::coverage::Information;
use crate::field::{Changes, Snapshot};
use crate::scene::Bounds;
use crate::scene::clearance::Exchange;
use crate::search::Problem;
use crate::search::reach::Reach;
use crate::stop::{StopToken, free_behind};

/// Boxes and distances are taken for so much larger, m, that rounding decides nothing.
const SLACK_M: f64 = 1e-3;

/// Samples that a worker takes at once, at least.
const LEAST_SAMPLES: usize = 256;

/// What the images of a flight see of the samples of one revision.
#[derive(Clone, Debug)]
pub struct Record {
    revision: u64,
    rig: Rig,
    range_m: f64,
    reach: Reach,
    /// By slot; `None` where an image is no more. The sightings name slots.
    images: Vec<Option<Image>>,
    /// Shared, because the record of a flight is kept by who goes on with it and by who flies it.
    sightings: Arc<Sightings>,
    tally: Tally,
    /// Slots of the images at the start, which belong to no leg.
    at_start: Vec<u32>,
    /// The flight itself, once it is known to be safe: in the scene of this revision, or already in the one that follows.
    pub flight: Option<Arc<SafeFlight>>,
}

impl Record {
    /// Looks at all images. `None` when abandoned.
    pub fn new(snapshot: &Snapshot, problem: &Problem, images: &[Image], stop: &StopToken) -> Option<Self> {
        let sightings = super::evaluate::sightings(snapshot, &problem.disks, images, stop)?;
        let tally = Tally::of(&sightings, problem, &|_| true);
        let cameras = problem.rig.camera_count().min(images.len()) as u32;
        Some(Self {
            revision: snapshot.revision,
            rig: problem.rig.clone(),
            range_m: problem.disks.range_m(),
            reach: problem.reach.clone(),
            images: images.iter().copied().map(Some).collect(),
            sightings: Arc::new(sightings),
            tally,
            at_start: (0..cameras).collect(),
            flight: None,
        })
    }

    /// What is known to be safe of the flight in a snapshot: all of it where it was found safe in its very space, else what has not met anything since the
    /// revision before. It is given away.
    pub fn known(&mut self, snapshot: &Snapshot) -> Option<Known> {
        let flight = self.flight.take()?;
        if flight.is_safe_in(&snapshot.free) {
            return Known::new(flight, snapshot.free.without_structures());
        }
        let changes = snapshot.changes().filter(|changes| changes.since == flight.revision)?;
        Known::new(flight, snapshot.free.only_new(&changes.differences))
    }

    fn is_of_revision_before(&self, snapshot: &Snapshot) -> bool {
        snapshot.changes().is_some_and(|changes| changes.since == self.revision)
    }

    /// What the rig could reach, if this is the record of the revision that `snapshot` followed from, by the same rig.
    pub fn reach_before(&self, snapshot: &Snapshot, rig: &Rig, range_m: f64) -> Option<&Reach> {
        (self.is_of_revision_before(snapshot) && self.rig == *rig && self.range_m == range_m).then_some(&self.reach)
    }

    /// The record of another flight in the revision that follows from this one's; anew where that is not known. `None` when abandoned.
    pub fn after(self, snapshot: &Snapshot, problem: &Problem, images: &[Image], stop: &StopToken) -> Option<Self> {
        match snapshot.changes() {
            Some(changes) if self.reach_before(snapshot, &problem.rig, problem.disks.range_m()).is_some() => {
                self.followed(snapshot, problem, images, Some(changes), stop)
            }
            _ => Self::new(snapshot, problem, images, stop),
        }
    }

    /// The record of another flight of the same problem. `None` when abandoned.
    pub fn beside(self, snapshot: &Snapshot, problem: &Problem, images: &[Image], stop: &StopToken) -> Option<Self> {
        self.followed(snapshot, problem, images, None, stop)
    }

    /// Without changes in the field that the record belongs to. `None` when abandoned.
    fn followed(
        self,
        snapshot: &Snapshot,
        problem: &Problem,
        images: &[Image],
        changes: Option<&Changes>,
        stop: &StopToken,
    ) -> Option<Self> {
        if stop.is_abandoned() {
            return None;
        }
        let Self { rig, range_m, images: mut slots, sightings, tally: counted, .. } = self;
        let Sightings(mut before) = Arc::unwrap_or_clone(sightings);
        let cast = Recast::new(snapshot, problem, images, &mut slots, changes);
        let samples = problem.frames.len();
        let mut tally = Tally::nothing(samples);
        let same = |i: usize| changes.map_or(Some(i), |changes| changes.same[i].map(|old| old as usize));
        let lists = (0..samples).map(|i| match same(i) {
            None => (None, Vec::new()),
            Some(old) => {
                (tally.cells[i], tally.is_matched[i]) = (counted.cells[old], counted.is_matched[old]);
                // What could not be matched was not counted, and what was taken before the flight was another thing then.
                let is_alone = !counted.is_captured[old] && problem.captured_views(i).is_empty();
                let is_counted = is_alone && counted.is_matchable[old] == problem.matchable[i];
                (Some(is_counted), std::mem::take(&mut before[old]))
            }
        });
        let mut lists: Vec<(Option<bool>, Vec<Sighting>)> = lists.collect();
        let counts = lists.par_iter_mut().enumerate().with_min_len(LEAST_SAMPLES).map(|(i, (is_counted, list))| {
            if stop.is_abandoned() {
                return None;
            }
            let is_as_before = match is_counted {
                None => cast.anew(i, list),
                Some(_) => cast.again(i, list),
            };
            Some((!is_as_before || *is_counted != Some(true)).then(|| Tally::of_sample(problem, i, list.iter())))
        });
        let Some(counts) = counts.collect::<Option<Vec<_>>>() else {
            free_behind(lists);
            return None;
        };
        for (i, count) in counts.into_iter().enumerate() {
            if let Some((cells, is_matched)) = count {
                (tally.cells[i], tally.is_matched[i]) = (cells, is_matched);
            }
        }
        tally.is_matchable.clone_from(&problem.matchable);
        tally.is_captured = Tally::captured(problem);
        let cameras = rig.camera_count().min(images.len());
        Some(Self {
            revision: snapshot.revision,
            range_m,
            reach: problem.reach.clone(),
            at_start: cast.slots[..cameras].to_vec(),
            images: slots,
            sightings: Arc::new(Sightings(lists.into_iter().map(|(_, list)| list).collect())),
            tally,
            rig,
            flight: None,
        })
    }

    /// What all images capture together.
    pub fn capture(&self, problem: &Problem) -> Capture {
        Capture::of(problem, &self.tally)
    }

    /// What the images at the start capture (Eq. 2).
    pub fn information_at_start(&self, problem: &Problem) -> Information {
        let start = self.at_start.first().and_then(|&slot| self.images[slot as usize]);
        let Some(start) = start.map(|image| image.position_m) else { return 0 };
        let reach_m = self.range_m + SLACK_M;
        let cells = |i: usize| {
            if distance_squared(&problem.frames[i].position, &start) > reach_m * reach_m {
                return 0;
            }
            let seen = self.sightings.0[i].iter().filter(|one| self.at_start.contains(&one.image));
            u64::from(seen.fold(0, |mask, one| mask | one.mask).count_ones())
        };
        (0..problem.frames.len()).into_par_iter().with_min_len(LEAST_SAMPLES).map(|i| cells(i) * problem.areas_mm2[i]).sum()
    }

    /// Which images see what: of a flight that was looked at anew, by the places of its images.
    pub fn sightings(&self) -> &Sightings {
        &self.sightings
    }

    /// The same, when nothing else of the record is needed any more.
    pub fn into_sightings(self) -> Sightings {
        Arc::unwrap_or_clone(self.sightings)
    }
}

/// Which lines of sight have to be cast again.
struct Recast<'a> {
    caster: Caster<'a>,
    /// All images, those that are new, and the places of those that are no more.
    all: Places,
    new: Places,
    gone: Places,
    is_gone: Vec<bool>,
    /// The slot of each image, and the image in each slot.
    slots: Vec<u32>,
    in_slot: Vec<u32>,
    /// Boxes in which something changed, with the old images near them.
    beside: Vec<(Bounds, Vec<usize>)>,
    exchange: Option<&'a Exchange>,
    reach_m: f64,
}

impl<'a> Recast<'a> {
    /// Gives the images their slots.
    fn new(
        snapshot: &'a Snapshot,
        problem: &'a Problem,
        images: &'a [Image],
        slots: &mut Vec<Option<Image>>,
        changes: Option<&'a Changes>,
    ) -> Self {
        let occupied = slots.iter().enumerate().filter_map(|(slot, image)| Some((place(image.as_ref()?), slot as u32)));
        let mut known: HashMap<_, u32> = occupied.collect();
        let is_same = |image: &Image, slot: u32| slots[slot as usize].is_some_and(|known| key(&known) == key(image));
        let found = |image: &Image| known.remove(&place(image)).filter(|&slot| is_same(image, slot));
        let found: Vec<Option<u32>> = images.iter().map(found).collect();
        let mut is_gone = vec![true; slots.len()];
        found.iter().flatten().for_each(|&slot| is_gone[slot as usize] = false);
        let gone_at = slots.iter_mut().zip(&is_gone).filter(|(_, is_gone)| **is_gone);
        let gone_at: Vec<_> = gone_at.filter_map(|(image, _)| Some(image.take()?.position_m)).collect();
        let mut slot_of = |(image, found): (&Image, &Option<u32>)| {
            found.unwrap_or_else(|| {
                slots.push(Some(*image));
                slots.len() as u32 - 1
            })
        };
        let slot: Vec<u32> = images.iter().zip(&found).map(&mut slot_of).collect();
        is_gone.resize(slots.len(), false);
        let mut in_slot = vec![u32::MAX; slots.len()];
        slot.iter().enumerate().for_each(|(image, &slot)| in_slot[slot as usize] = image as u32);

        let reach_m = problem.disks.range_m() + snapshot.offset_m + SLACK_M;
        let beside = |bounds: &Bounds| {
            let bounds = bounds.grown(SLACK_M);
            let is_near = |k: &usize| found[*k].is_some() && bounds.distance_squared(&images[*k].position_m) <= reach_m * reach_m;
            (bounds, (0..images.len()).filter(is_near).collect())
        };
        let places = |is_in: &dyn Fn(usize) -> bool| {
            Places::new((0..).zip(images).filter(|&(k, _)| is_in(k as usize)).map(|(k, image)| (k, image.position_m)), reach_m)
        };
        Self {
            caster: Caster::new(snapshot, &problem.disks, images),
            all: places(&|_| true),
            new: places(&|k| found[k].is_none()),
            gone: Places::new((0..).zip(gone_at), reach_m),
            is_gone,
            in_slot,
            beside: changes.iter().flat_map(|changes| changes.differences.boxes()).map(beside).collect(),
            exchange: changes.map(|changes| &changes.exchange),
            slots: slot,
            reach_m,
        }
    }

    /// What a new sample is seen by. Nothing is as before.
    fn anew(&self, i: usize, list: &mut Vec<Sighting>) -> bool {
        if let Some(sample) = self.caster.sample(i) {
            let near = self.all.within(&sample.position);
            list.extend(self.caster.seen_by(&sample, &near).map(|one| self.slotted(one)));
        }
        false
    }

    /// Brings what an old sample is seen by up to date; whether it is as before.
    fn again(&self, i: usize, list: &mut Vec<Sighting>) -> bool {
        let Some(sample) = self.caster.sample(i) else { return true };
        let (place, end) = (sample.position, self.caster.end(&sample));
        let position = |k: usize| &self.caster.images[k].position_m;
        let mut again = self.new.within(&place);
        for ((bounds, beside), exchange) in self.beside.iter().flat_map(|beside| Some((beside, self.exchange?))) {
            if bounds.distance_squared(&place) > self.reach_m * self.reach_m {
                continue;
            }
            let is_crossed = |k: &usize| bounds.meets_segment(position(*k), &end);
            // A line that was free is blocked by nothing else than what has come, one that was blocked is free only where something is gone.
            let seeing = list.iter().map(|one| one.image as usize).filter(|&slot| !self.is_gone[slot]);
            let hidden = seeing.map(|slot| self.in_slot[slot] as usize).filter(is_crossed);
            again.extend(hidden.filter(|&k| exchange.may_change(false, position(k), &end)));
            if exchange.is_any_gone() {
                let may_see = |k: &usize| self.caster.may_see(&sample, *k);
                let is_blind = |k: &usize| list.iter().all(|one| one.image != self.slots[*k]);
                let shown = beside.iter().copied().filter(may_see).filter(is_crossed).filter(is_blind);
                again.extend(shown.filter(|&k| exchange.may_change(true, position(k), &end)));
            }
        }
        if again.is_empty() && !self.gone.is_any_within(&place) {
            return true;
        }
        again.sort_unstable();
        again.dedup();
        let is_kept = |one: &Sighting| {
            let slot = one.image as usize;
            !self.is_gone[slot] && again.binary_search(&(self.in_slot[slot] as usize)).is_err()
        };
        list.retain(is_kept);
        list.extend(self.caster.seen_by(&sample, &again).map(|one| self.slotted(one)));
        false
    }

    fn slotted(&self, sighting: Sighting) -> Sighting {
        Sighting { image: self.slots[sighting.image as usize], ..sighting }
    }
}

/// Where an image is taken, and by which camera. Two that agree in that and look elsewhere are rare: one of them counts as new.
fn place(image: &Image) -> [u64; 4] {
    let [x, y, z] = image.position_m.coords.map(f64::to_bits).into();
    [x, y, z, u64::from(image.camera)]
}

/// What an image's view depends on, to the last bit, for one rig.
fn key(image: &Image) -> [u64; 10] {
    let Image { position_m: p, direction, up, camera, .. } = image;
    let direction = direction.map_or([f64::NAN; 3], |direction| (*direction).into());
    let [dx, dy, dz] = direction;
    let bits = [p.x, p.y, p.z, dx, dy, dz, up.x, up.y, up.z].map(f64::to_bits);
    std::array::from_fn(|k| bits.get(k).copied().unwrap_or(u64::from(*camera)))
}
