//! What a search works on: the field of one snapshot seen through one rig.

use nalgebra::Point3;
use overfly_table::FieldTable;

use super::objective::Objective;
use crate::camera::{Pose, Rig};
use crate::coverage::union::{self, Gained, Observations};
use crate::coverage::{CELLS, DiskModel, Information, Mask, SampleFrame};
use crate::field::Lookup;
use crate::field::Snapshot;
use crate::scene::free_space::FreeSpace;
use crate::settings::{SearchSettings, Settings};

/// Why a search could not start or go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SearchError {
    #[error(
        "no point of the free space can be reached from the start within {tries} tries: the start is walled in by structures, \
         zones or limits"
    )]
    Unreachable { tries: u32 },
}

/// The planning problem of one snapshot, rig and objective.
pub struct Problem<'a> {
    pub field: FieldTable<'a>,
    pub free: &'a FreeSpace,
    pub rig: Rig,
    pub objective: Objective,
    pub settings: SearchSettings,
    /// Least distance of two images, m.
    pub image_spacing_m: f64,
    /// Samples whose capture counts: exposed and within reach of the viewpoints together.
    pub capturable: u32,
    /// Capturable samples that a sufficient path captures: more than G percent of them.
    pub sufficient: u32,
    disks: &'a DiskModel,
    lookup: &'a Lookup,
    /// No image gains more than this.
    most_of_image: Information,
    frames: Vec<SampleFrame>,
    areas_mm2: Vec<u64>,
    /// Cells that a capturable sample must exceed; all cells for one that cannot be captured.
    thresholds: Vec<u32>,
}

/// Dense masks while observations are gathered, kept between uses so that nothing is allocated on the hot path.
#[derive(Debug)]
pub struct Scratch {
    masks: Vec<Mask>,
    touched: Vec<u32>,
}

impl<'a> Problem<'a> {
    pub fn new(snapshot: &'a Snapshot, settings: &Settings, rig: Rig) -> Self {
        let field = snapshot.field();
        let threshold = field.facts.threshold_cells;
        let samples = 0..field.samples.len();
        let capturable = samples.clone().filter(|&i| field.is_capturable(i)).count() as u32;
        let enough = (f64::from(capturable) * settings.coverage.goal_percent / 100.0).floor() as u32 + 1;
        let spacing = settings.search.image_spacing_m.max(settings.flight.cruise_speed_mps * settings.search.shutter_interval_s);
        Self {
            free: &snapshot.free,
            rig,
            objective: Objective::new(settings, field.facts.reference_area_m2, field.facts.neighbour_radius_m),
            settings: settings.search.clone(),
            image_spacing_m: spacing,
            capturable,
            sufficient: enough.min(capturable),
            disks: &snapshot.disks,
            lookup: &snapshot.lookup,
            most_of_image: most_of_image(&field, &snapshot.disks),
            frames: frames(&field),
            areas_mm2: field.samples.iter().map(|row| row.area_mm2).collect(),
            thresholds: samples.map(|i| if field.is_capturable(i) { threshold } else { CELLS as u32 }).collect(),
            field,
        }
    }

    pub fn scratch(&self) -> Scratch {
        Scratch { masks: vec![0; self.frames.len()], touched: Vec::new() }
    }

    /// Whether the drone may fly straight from `a` to `b`: safe all the way, and long enough for an image at both ends.
    pub fn can_fly(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        (b - a).norm() >= self.image_spacing_m && self.free.is_leg_safe(a, b)
    }

    /// What the views along the leg add to those at `from`: the viewpoints between the ends, and the one at `to` (section 4.2).
    pub fn observe_leg(&self, from: &Pose, to: &Pose, scratch: &mut Scratch) -> Observations {
        for pose in image_poses(from, to, self.image_spacing_m) {
            self.observe(&pose, scratch);
        }
        scratch.take()
    }

    /// What a single view observes.
    pub fn observe_pose(&self, pose: &Pose, scratch: &mut Scratch) -> Observations {
        self.observe(pose, scratch);
        scratch.take()
    }

    /// An upper bound of what the images of a leg can gain, whatever they see.
    pub fn most_of_leg(&self, from: &Pose, to: &Pose) -> Information {
        self.most_of_image.saturating_mul(image_count((to.position - from.position).norm(), self.image_spacing_m) as u64)
    }

    /// Adds the coverage disks of one view: visibility from the field, frustum and disk exactly at the pose.
    fn observe(&self, pose: &Pose, scratch: &mut Scratch) {
        let Some(nearest) = self.lookup.nearest_in_sight(&pose.position, &self.free.clearance) else {
            return;
        };
        for i in seen_in(self.field.row(nearest)) {
            let frame = &self.frames[i];
            if self.rig.frames(pose, &frame.position) {
                scratch.add(i as u32, self.disks.mask(frame, &pose.position));
            }
        }
    }

    /// Area-weighted cells that `seen` adds to `covered` (Eq. 2 over all samples).
    pub fn gain(&self, covered: &[Mask], seen: &Observations) -> Information {
        union::gain(covered, seen, &self.areas_mm2)
    }

    /// Adds `seen` to `covered`; counts the capturable samples that crossed the threshold.
    pub fn cover(&self, covered: &mut [Mask], seen: &Observations) -> Gained {
        union::cover(covered, seen, &self.areas_mm2, &self.thresholds)
    }

    /// How many nodes a tree may have: each holds a mask for every sample.
    pub fn most_nodes(&self) -> usize {
        let node_bytes = self.field.samples.len() * size_of::<Mask>();
        (self.settings.memory_mb as usize * 1_000_000 / node_bytes.max(1)).max(2)
    }

    /// Share of the capturable samples, percent.
    pub fn coverage_percent(&self, captured: u32) -> f64 {
        if self.capturable == 0 { 100.0 } else { 100.0 * f64::from(captured) / f64::from(self.capturable) }
    }
}

impl Scratch {
    fn add(&mut self, i: u32, mask: Mask) {
        if mask == 0 {
            return;
        }
        let held = &mut self.masks[i as usize];
        if *held == 0 {
            self.touched.push(i);
        }
        *held |= mask;
    }

    /// Empties the scratch into observations.
    fn take(&mut self) -> Observations {
        self.touched.sort_unstable();
        let masks = self.touched.iter().map(|&i| std::mem::take(&mut self.masks[i as usize])).collect();
        let samples = self.touched.clone();
        self.touched.clear();
        Observations::new(samples, masks)
    }
}

/// The images of a leg without the one at its start: evenly spaced, at least `spacing_m` apart, the last one at the end. The
/// viewpoints along an edge ARE the images of the flight.
pub fn image_poses(from: &Pose, to: &Pose, spacing_m: f64) -> impl Iterator<Item = Pose> + use<> {
    let leg = to.position - from.position;
    let count = image_count(leg.norm(), spacing_m);
    let (start, end) = (*from, *to);
    (1..=count).map(move |k| {
        if k == count {
            return end;
        }
        let share = k as f64 / count as f64;
        // The view direction turns along the great circle (section 5.4); between opposite directions there is no such circle.
        let direction = match (start.direction, end.direction) {
            (Some(from), Some(to)) => Some(from.try_slerp(&to, share, 1e-9).unwrap_or(to)),
            _ => end.direction,
        };
        Pose { position: start.position + leg * share, direction }
    })
}

/// The samples whose bits are set in a row of the field, in ascending order.
fn seen_in(row: &[u64]) -> impl Iterator<Item = usize> + '_ {
    row.iter().enumerate().flat_map(|(word_index, &word)| {
        let rest = std::iter::successors(Some(word), |rest| Some(rest & rest.wrapping_sub(1)));
        rest.take_while(|&rest| rest != 0).map(move |rest| word_index * 64 + rest.trailing_zeros() as usize)
    })
}

fn image_count(length_m: f64, spacing_m: f64) -> usize {
    ((length_m / spacing_m).floor() as usize).max(1)
}

/// The most that any row of the field could gain: every sample in it under the largest disk.
fn most_of_image(field: &FieldTable, disks: &DiskModel) -> Information {
    let area = |row: &[u64]| seen_in(row).fold(0u64, |sum, i| sum.saturating_add(field.samples[i].area_mm2));
    let most = (0..field.viewpoints.len()).map(|j| area(field.row(j))).max().unwrap_or(0);
    most.saturating_mul(u64::from(disks.most_cells()))
}

fn frames(field: &FieldTable) -> Vec<SampleFrame> {
    field.samples.iter().map(|row| SampleFrame::new(row.position_m.into(), row.normal.into())).collect()
}
