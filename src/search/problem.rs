//! What a search works on: the field of one snapshot seen through one rig.

use std::sync::{Arc, OnceLock};

use geo::{Coord, Intersects, Polygon};
use nalgebra::{Point3, Unit, Vector3};
use overfly_table::{FieldTable, Row};

use super::captured::{self, Captured};
use super::cover::{Cover, Places};
use super::leg::{angle_rad, image_poses};
use super::objective::Objective;
use super::reach::{Reach, Seeing};
use super::spacing::ImageSpacing;
use crate::camera::{Pose, Rig, View};
use crate::coverage::union::{self, Gained, Observations};
use crate::coverage::{CELLS, DiskModel, Information, Mask, MatchedViews, Matching, SampleFrame};
use crate::field::Lookup;
use crate::field::Snapshot;
use crate::scene::free_space::FreeSpace;
use crate::settings::{CoverageSettings, SearchSettings, Settings};
use crate::stop::StopToken;

/// Why a search could not start or go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SearchError {
    #[error(
        "no point of the free space can be reached from the start within {tries} tries: the start is walled in by structures, \
         zones or limits"
    )]
    Unreachable { tries: u32 },
}

/// What a user wants of a scene, where it is not all of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Only samples in this area count, seen from above, m in the local frame.
    pub region: Option<Polygon>,
    /// Views whose ground sampling distance is larger show nothing, m.
    pub gsd_m: Option<f64>,
    /// For an overlap: images that follow each other on a leg are no farther apart, m.
    pub most_apart_m: Option<f64>,
    /// What was captured already, and need not be again.
    pub captured: Arc<Captured>,
}

impl Wanted {
    /// How far views show anything of a surface, m: as far as `range_m`, or nearer for the sampling distance that is wanted.
    pub fn sight_m(&self, rig: &Rig, range_m: f64) -> f64 {
        self.gsd_m.map_or(range_m, |gsd_m| range_m.min(gsd_m / rig.coarsest_pixel_rad()))
    }
}

/// The planning problem of one snapshot, rig and objective.
pub struct Problem<'a> {
    pub field: FieldTable<'a>,
    pub free: &'a FreeSpace,
    pub rig: Rig,
    pub objective: Objective,
    pub settings: SearchSettings,
    /// How far apart images are, and how long legs are at least.
    pub spacing: ImageSpacing,
    /// Samples whose capture counts: exposed and within reach of the viewpoints together.
    pub capturable: u32,
    /// Capturable samples that a sufficient path captures: more than G percent of them.
    pub sufficient: u32,
    /// Cells of each sample that the rig's views from all viewpoints together cover.
    pub ceilings: Vec<u16>,
    /// By sample: whether the rig's views from all viewpoints together give it enough matched views.
    pub matchable: Vec<bool>,
    /// By sample: how images that were taken before the flight saw it; empty where there are none. What they captured counts as captured and as
    /// capturable, whatever hides it now.
    captured: Vec<Vec<captured::View>>,
    /// Which views match, and how many a sample needs.
    pub matching: Matching,
    pub areas_mm2: Vec<u64>,
    /// Cells that a capturable sample must exceed; all cells for one that cannot be captured.
    pub thresholds: Vec<u32>,
    /// Samples with the axes of their hemispheres.
    pub frames: Arc<Vec<SampleFrame>>,
    /// Where they stand in the nodes of a tree; found out for the first one.
    places: OnceLock<Places>,
    /// The discretised view directions of a camera on a gimbal (section 5.4); empty for other rigs.
    pub view_directions: Vec<Unit<Vector3<f64>>>,
    /// Disks as the field's, or with a shorter range.
    pub disks: Arc<DiskModel>,
    /// What the rig can reach of each sample, in the region or not.
    pub reach: Reach,
    lookup: &'a Lookup,
    /// How far in front of a sample a line of sight ends, m.
    offset_m: f64,
    /// No image gains more than this.
    most_of_image: OnceLock<Information>,
    turning: ViewTurning,
}

/// How fast the view may turn along a leg: "otherwise, the drone's camera may rotate too fast and produce blurry images" (section 5.4).
#[derive(Clone, Copy, Debug)]
struct ViewTurning {
    rad_per_m: f64,
    most_rad: f64,
}

/// Dense masks while observations are gathered, kept between uses so that nothing is allocated on the hot path.
#[derive(Debug)]
pub struct Scratch {
    masks: Vec<Mask>,
    touched: Vec<u32>,
}

impl<'a> Problem<'a> {
    /// The problem of the whole scene.
    pub fn new(snapshot: &'a Snapshot, settings: &Settings, rig: Rig) -> Self {
        Self::wanted(snapshot, settings, rig, &Wanted::default())
    }

    /// The problem in which only what is wanted counts. Samples outside of the region have a ceiling of no cells.
    pub fn wanted(snapshot: &'a Snapshot, settings: &Settings, rig: Rig, wanted: &Wanted) -> Self {
        Self::after(snapshot, settings, rig, wanted, None, &StopToken::default())
    }

    /// The same after an edit, with what the rig could reach in the field before if that is known. Of an abandoned search the problem is not to be used.
    pub fn after(
        snapshot: &'a Snapshot,
        settings: &Settings,
        rig: Rig,
        wanted: &Wanted,
        before: Option<&Reach>,
        stop: &StopToken,
    ) -> Self {
        let reach = |seeing: &Seeing| match before.zip(snapshot.changes()) {
            Some((before, changes)) => before.after(seeing, changes),
            None => Reach::new(seeing),
        };
        Self::reaching(snapshot, settings, rig, wanted, reach, stop)
    }

    /// For who only asks what can be flown: nothing counts as capturable, and so nothing is looked at for that.
    pub fn to_fly(snapshot: &'a Snapshot, settings: &Settings, rig: Rig, wanted: &Wanted) -> Self {
        let wanted = Wanted { captured: Arc::default(), ..wanted.clone() };
        let reach = |seeing: &Seeing| Reach::nothing(seeing.frames.len());
        Self::reaching(snapshot, settings, rig, &wanted, reach, &StopToken::default())
    }

    fn reaching(
        snapshot: &'a Snapshot,
        settings: &Settings,
        rig: Rig,
        wanted: &Wanted,
        reach: impl FnOnce(&Seeing) -> Reach,
        stop: &StopToken,
    ) -> Self {
        let field = snapshot.field();
        let threshold = field.facts.threshold_cells;
        let frames = Arc::clone(snapshot.frames());
        let range_m = wanted.sight_m(&rig, snapshot.disks.range_m());
        let disks = if range_m < snapshot.disks.range_m() {
            Arc::new(DiskModel::new(&CoverageSettings { range_m, ..settings.coverage.clone() }))
        } else {
            Arc::clone(&snapshot.disks)
        };
        let matching = Matching::new(&settings.quality);
        let is_shorter = disks.range_m() < snapshot.disks.range_m();
        let seeing = Seeing { field: &field, rig: &rig, frames: &frames, disks: &disks, is_shorter, matching: &matching, stop };
        let reach = reach(&seeing);
        let Reach { mut ceilings, is_matchable: mut matchable } = reach.clone();
        let captured = wanted.captured.views(snapshot, &frames, &disks);
        for (i, views) in captured.iter().enumerate() {
            ceilings[i] = ceilings[i].max(captured_mask(views).count_ones() as u16);
            matchable[i] |= is_matched(&matching, views);
        }
        if let Some(region) = &wanted.region {
            let is_outside = |frame: &SampleFrame| !region.intersects(&Coord { x: frame.position.x, y: frame.position.y });
            for (i, _) in frames.iter().enumerate().filter(|(_, frame)| is_outside(frame)) {
                (ceilings[i], matchable[i]) = (0, false);
            }
        }
        let is_capturable = |cells: &&u16| u32::from(**cells) > threshold;
        let capturable = ceilings.iter().filter(is_capturable).count() as u32;
        let enough = (f64::from(capturable) * settings.coverage.goal_percent / 100.0).floor() as u32 + 1;
        let speed_mps = settings.flight.cruise_speed_mps;
        let least_m = settings.search.image_spacing_m.max(speed_mps * rig.shutter_interval_s);
        let dynamics = &settings.dynamics;
        let most_rad_s = dynamics.yaw_rate_dps.min(dynamics.gimbal_rate_dps).to_radians().min(rig.blur_limit_rad_s);
        Self {
            free: &snapshot.free,
            spacing: match wanted.most_apart_m {
                Some(most_m) => ImageSpacing::overlapping(least_m, most_m),
                None => ImageSpacing::at_least(least_m),
            },
            view_directions: rig.view_directions(),
            turning: ViewTurning { rad_per_m: most_rad_s / speed_mps, most_rad: settings.search.view_turn_deg.to_radians() },
            rig,
            objective: Objective::new(settings, field.facts.reference_area_m2, field.facts.neighbour_radius_m),
            settings: settings.search.clone(),
            capturable,
            sufficient: enough.min(capturable),
            lookup: &snapshot.lookup,
            offset_m: snapshot.offset_m,
            most_of_image: OnceLock::new(),
            reach,
            disks,
            areas_mm2: field.samples.iter().map(|row| row.area_mm2).collect(),
            thresholds: ceilings.iter().map(|cells| if is_capturable(&cells) { threshold } else { CELLS as u32 }).collect(),
            places: OnceLock::new(),
            frames,
            ceilings,
            matchable,
            captured,
            matching,
            field,
        }
    }

    pub fn scratch(&self) -> Scratch {
        Scratch { masks: vec![0; self.frames.len()], touched: Vec::new() }
    }

    /// Whether the drone may fly straight from `a` to `b`: safe all the way, and long enough for an image at both ends.
    pub fn can_fly(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        (b - a).norm() >= self.spacing.least_leg_m && self.free.is_leg_safe(a, b)
    }

    /// Whether the rig can capture sample `i` at all: its views from all viewpoints together cover more than the threshold.
    pub fn is_capturable(&self, i: usize) -> bool {
        u32::from(self.ceilings[i]) > self.field.facts.threshold_cells
    }

    /// How images that were taken before the flight saw sample `i`.
    pub fn captured_views(&self, i: usize) -> &[captured::View] {
        self.captured.get(i).map_or(&[], Vec::as_slice)
    }

    /// The cells of each sample that were covered before the flight, and how many samples are captured by that.
    pub fn captured_cells(&self) -> (Vec<Mask>, u32) {
        let masks: Vec<Mask> = (0..self.frames.len()).map(|i| self.captured_mask(i)).collect();
        let captured = masks.iter().zip(&self.thresholds).filter(|(mask, threshold)| mask.count_ones() > **threshold).count();
        (masks, captured as u32)
    }

    /// Area-weighted cells that were covered before the flight.
    pub fn captured_information(&self) -> Information {
        let (masks, _) = self.captured_cells();
        masks.iter().zip(&self.areas_mm2).map(|(mask, area_mm2)| u64::from(mask.count_ones()) * area_mm2).sum()
    }

    /// The cells of sample `i` that were covered before the flight.
    pub fn captured_mask(&self, i: usize) -> Mask {
        captured_mask(self.captured_views(i))
    }

    /// Whether the view may turn from one direction to the other along the leg: slowly enough for gimbal, yaw and shutter, and within the
    /// gimbal's range at every image.
    pub fn can_turn(&self, from: &Pose, to: &Pose) -> bool {
        let (Some(first), Some(last)) = (from.direction, to.direction) else { return true };
        let limit_rad = ((to.position - from.position).norm() * self.turning.rad_per_m).min(self.turning.most_rad);
        first == last
            || angle_rad(&first, &last) <= limit_rad
                && image_poses(&self.rig, from, to, self.spacing).all(|pose| pose.direction.is_none_or(|d| self.rig.reaches(&d)))
    }

    /// Whether a pose may be a waypoint.
    pub fn is_admissible(&self, pose: &Pose) -> bool {
        self.can_look(pose) && self.free.is_safe(&pose.position)
    }

    /// Whether the gimbal reaches a pose's direction.
    pub fn can_look(&self, pose: &Pose) -> bool {
        pose.direction.is_none_or(|direction| self.rig.reaches(&direction))
    }

    /// Whether a leg is long enough for its images and the view turns slowly enough on it; safety is not looked at.
    pub fn is_flyable(&self, from: &Pose, to: &Pose) -> bool {
        let spacing_m = self.spacing.least_leg_m;
        let is_long_enough = (to.position - from.position).norm_squared() >= spacing_m * spacing_m;
        // Bolted cameras turn in the corners, not on the legs.
        is_long_enough && (!self.rig.has_gimbal() || self.can_turn(from, to))
    }

    /// What the views along the leg add to those at `from`: the viewpoints between the ends, and the one at `to` (section 4.2).
    pub fn observe_leg(&self, from: &Pose, to: &Pose, scratch: &mut Scratch) -> Observations {
        for pose in image_poses(&self.rig, from, to, self.spacing) {
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
    pub fn most_of_leg(&self, from: &Point3<f64>, to: &Point3<f64>) -> Information {
        let most_of_image = *self.most_of_image.get_or_init(|| most_of_image(&self.field, &self.disks));
        most_of_image.saturating_mul(self.spacing.image_count((to - from).norm()) as u64)
    }

    /// Adds the coverage disks of one view: visibility from the field, frustum and disk exactly at the pose.
    fn observe(&self, pose: &Pose, scratch: &mut Scratch) {
        let Some(nearest) = self.lookup.nearest_in_sight(&pose.position, &self.free.clearance) else {
            return;
        };
        let frusta = self.rig.frusta(pose);
        for i in self.field.row(nearest).samples() {
            let frame = &self.frames[i];
            if is_framed(frusta.as_deref(), &frame.position) {
                scratch.add(i as u32, self.disks.mask(frame, &pose.position));
            }
        }
    }

    /// The samples in the field's row of viewpoint `j`, in ascending order.
    pub fn seen_from(&self, j: usize) -> impl Iterator<Item = usize> + '_ {
        self.field.row(j).samples()
    }

    /// The viewpoint whose row of the field answers for a position: the nearest one in sight.
    pub fn viewpoint_for(&self, position: &Point3<f64>) -> Option<usize> {
        self.lookup.nearest_in_sight(position, &self.free.clearance)
    }

    /// Whether a sample can really be seen from a position: within range, from in front, and by a ray.
    pub fn is_in_sight(&self, i: usize, position: &Point3<f64>) -> bool {
        let frame = &self.frames[i];
        let end = frame.position + frame.normal * self.offset_m;
        self.disks.faces(frame, position) && !self.free.clearance.occluded(position, &end)
    }

    /// Every sample that the field shows at a position, whatever the direction of the cameras, with the cells of its disk.
    pub fn sighted(&self, position: &Point3<f64>) -> impl Iterator<Item = (usize, Mask)> + '_ {
        let row =
            self.lookup.nearest_in_sight(position, &self.free.clearance).map_or(Row::NOTHING, |nearest| self.field.row(nearest));
        let position = *position;
        row.samples().map(move |i| (i, self.disks.mask(&self.frames[i], &position))).filter(|&(_, mask)| mask != 0)
    }

    /// Area-weighted cells that `seen` adds to `covered` (Eq. 2 over all samples).
    pub fn gain(&self, covered: &[Mask], seen: &Observations) -> Information {
        union::gain(covered, seen, &self.areas_mm2)
    }

    /// Adds `seen` to `covered`; counts the capturable samples that crossed the threshold.
    pub fn cover(&self, covered: &mut [Mask], seen: &Observations) -> Gained {
        union::cover(covered, seen, &self.areas_mm2, &self.thresholds)
    }

    /// Where the samples stand in the nodes of a tree.
    pub fn places(&self) -> &Places {
        self.places.get_or_init(|| Places::new(&self.frames))
    }

    /// What [`Problem::gain`] says of a node's cover.
    pub fn gain_over(&self, covered: &Cover, seen: &Observations) -> Information {
        covered.gain(self.places(), seen, &self.areas_mm2)
    }

    /// What [`Problem::cover`] does to a node's cover.
    pub fn add_to(&self, covered: &mut Cover, seen: &Observations) -> Gained {
        covered.add(self.places(), seen, &self.areas_mm2, &self.thresholds)
    }

    /// Most memory of a tree, bytes.
    pub fn most_bytes(&self) -> usize {
        self.settings.memory_mb as usize * 1_000_000
    }

    /// Samples that have to be matched for such a share of those that can be: more than `goal_percent` of them, or none for 0.
    pub fn enough_matched(&self, goal_percent: f64) -> u32 {
        let matchable = self.matchable.iter().filter(|matchable| **matchable).count() as u32;
        let enough = (f64::from(matchable) * goal_percent / 100.0).floor() as u32 + 1;
        if goal_percent > 0.0 { enough.min(matchable) } else { 0 }
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

fn captured_mask(views: &[captured::View]) -> Mask {
    views.iter().fold(0, |mask, (cells, _)| mask | cells)
}

fn is_matched(matching: &Matching, views: &[captured::View]) -> bool {
    let mut matched = MatchedViews::default();
    views.iter().for_each(|&(_, bearing)| matched.add(matching, bearing));
    matched.matched() >= matching.least_views
}

fn is_framed(frusta: Option<&[View]>, target: &Point3<f64>) -> bool {
    frusta.is_none_or(|views| views.iter().any(|view| view.frames(target)))
}

/// The most that any row of the field could gain: every sample in it under the largest disk.
fn most_of_image(field: &FieldTable, disks: &DiskModel) -> Information {
    let area = |row: Row| row.samples().fold(0u64, |sum, i| sum.saturating_add(field.samples[i].area_mm2));
    let most = (0..field.viewpoints.len()).map(|j| area(field.row(j))).max().unwrap_or(0);
    most.saturating_mul(u64::from(disks.most_cells()))
}
