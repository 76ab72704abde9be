//! What all flights over one scene have in common while they are improved.

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;

use super::cells::CellCounts;
use super::counts::{Counts, Worth};
use super::matches::MatchCounts;
use super::sights::Sights;
use crate::camera::{Cameras, Pose, Targets};
use crate::coverage::{Bearing, Information, Mask, Matching};
use crate::search::Problem;
use crate::search::leg::image_poses;
use crate::settings::{RefineSettings, Settings};
use crate::stop::{StopToken, free_behind};
use crate::trajectory::profile::Limits;

/// Rows of the field that a worker takes at once, at least.
const LEAST_ROWS: usize = 64;

/// The problem with what the moves need of it.
pub struct Ground<'a> {
    pub problem: &'a Problem<'a>,
    pub settings: &'a RefineSettings,
    pub limits: Limits,
    /// Whether cameras are bolted on, so that they look where the leg leads.
    pub is_rigid: bool,
    /// So many waypoints at the beginning of the flight, and at its end, have to stay as they are.
    pub fixed: [usize; 2],
    /// Whether images are taken at the first waypoint and at the last one.
    pub takes_at_ends: [bool; 2],
    /// Samples that can be captured, and the ones that are to be matched.
    pub wanted: Vec<u32>,
    /// How many samples there are for each one that is looked at.
    pub stride: usize,
    /// The most that any flight is worth, of the samples that are looked at and of all.
    pub most: Worth,
    pub most_of_all: Worth,
    /// Wanted samples in each row of the field.
    rows: Vec<Row>,
    /// Cells that each sample must exceed; all cells for one that does not count.
    thresholds: Arc<[u32]>,
    /// By sample: whether its matched views count.
    is_matching: Arc<[bool]>,
    areas_mm2: Arc<[u64]>,
    matching: Matching,
    /// Viewpoints of the field that see each sample.
    pub seers: Vec<Vec<u32>>,
    pub nothing: Arc<Sights>,
    /// What images saw that were taken before the flight.
    captured: Arc<Sights>,
    /// Area-weighted cells that these cover.
    pub captured_information: Information,
    /// How the search is told to end: of an abandoned one nobody asks any more what is seen from where.
    pub stop: StopToken,
}

/// A city's rows are a hundred thousand pieces of memory.
impl Drop for Ground<'_> {
    fn drop(&mut self) {
        free_behind((std::mem::take(&mut self.rows), std::mem::take(&mut self.seers)));
    }
}

/// The wanted samples of a row of the field, with their positions.
#[derive(Clone, Debug, Default)]
struct Row {
    samples: Vec<u32>,
    targets: Targets,
}

/// Which samples are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counting {
    /// Those that can be captured.
    Captured,
    /// Those, and those that can have enough matched views.
    Matched,
    /// Those that can have enough matched views, whatever is captured.
    MatchedAlone,
    /// All: Eq. 6 is worth something even where nothing is captured.
    Everything,
}

/// How visibility is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// By the field: a promise.
    Field,
    /// By the field and rays from the image's true pose, with exact disks: never more than what the image really sees.
    Rays,
}

impl<'a> Ground<'a> {
    pub fn new(
        problem: &'a Problem<'a>,
        settings: &'a Settings,
        is_start_fixed: bool,
        counting: Counting,
        stop: &StopToken,
    ) -> Self {
        let is_matching = |i: usize| matches!(counting, Counting::Matched | Counting::MatchedAlone) && problem.matchable[i];
        let is_wanted = |i: usize| match counting {
            Counting::MatchedAlone => is_matching(i),
            Counting::Everything => true,
            Counting::Captured | Counting::Matched => is_matching(i) || problem.is_capturable(i),
        };
        let (before, _) = problem.captured_cells();
        let threshold = |i: usize| match counting {
            Counting::MatchedAlone => Mask::BITS,
            _ => raised_threshold(problem, &settings.refine, i, before[i]),
        };
        let samples = problem.frames.len();
        let mut ground = Self {
            problem,
            settings: &settings.refine,
            limits: Limits::new(&problem.rig, &settings.flight, &settings.dynamics),
            is_rigid: matches!(problem.rig.cameras, Cameras::Rigid(_)),
            fixed: [usize::from(is_start_fixed), 0],
            takes_at_ends: [true; 2],
            wanted: (0..samples as u32).filter(|&i| is_wanted(i as usize)).collect(),
            stride: 1,
            most: Worth::default(),
            most_of_all: Worth::default(),
            rows: Vec::new(),
            thresholds: (0..samples).map(threshold).collect(),
            is_matching: (0..samples).map(is_matching).collect(),
            areas_mm2: problem.areas_mm2.as_slice().into(),
            matching: Matching::within(&settings.quality, settings.refine.margin_parallax_deg),
            seers: Vec::new(),
            nothing: Arc::new(Sights::default()),
            captured: Arc::new(captured(problem)),
            captured_information: 0,
            stop: stop.clone(),
        };
        ground.survey();
        ground.most_of_all = ground.most;
        if !stop.is_abandoned() {
            ground.captured_information = ground.counts().cells.totals().information;
        }
        ground
    }

    /// The same ground on which only every so many samples count.
    pub fn thinned(&self, stride: usize) -> Self {
        let counts = |i: usize| i.is_multiple_of(stride);
        let mut ground = Self {
            wanted: self.wanted.iter().copied().filter(|&i| counts(i as usize)).collect(),
            stride,
            rows: Vec::new(),
            thresholds: self
                .thresholds
                .iter()
                .enumerate()
                .map(|(i, &cells)| if counts(i) { cells } else { Mask::BITS })
                .collect(),
            is_matching: self.is_matching.iter().enumerate().map(|(i, matches)| *matches && counts(i)).collect(),
            areas_mm2: Arc::clone(&self.areas_mm2),
            seers: Vec::new(),
            nothing: Arc::clone(&self.nothing),
            captured: Arc::clone(&self.captured),
            stop: self.stop.clone(),
            ..*self
        };
        ground.survey();
        ground
    }

    /// What follows from the samples that are wanted.
    fn survey(&mut self) {
        let problem = self.problem;
        let mut is_wanted = vec![false; problem.frames.len()];
        self.wanted.iter().for_each(|&i| is_wanted[i as usize] = true);
        let row = |j: usize| {
            let mut row = Row::default();
            if self.stop.is_abandoned() {
                return row;
            }
            for i in problem.seen_from(j).filter(|&i| is_wanted[i]) {
                row.samples.push(i as u32);
                row.targets.push(&problem.frames[i].position);
            }
            row
        };
        self.rows = (0..problem.field.viewpoints.len()).into_par_iter().with_min_len(LEAST_ROWS).map(row).collect();
        self.seers = vec![Vec::new(); problem.frames.len()];
        for (j, row) in (0..).zip(&self.rows).take_while(|_| !self.stop.is_abandoned()) {
            row.samples.iter().for_each(|&i| self.seers[i as usize].push(j));
        }
        if !self.stop.is_abandoned() {
            self.most = self.counts().most();
        }
    }

    /// Counters of what was captured before the flight.
    pub fn counts(&self) -> Counts {
        let mut counts = Counts {
            cells: CellCounts::new(Arc::clone(&self.thresholds), Arc::clone(&self.areas_mm2)),
            matches: MatchCounts::new(self.matching, Arc::clone(&self.is_matching)),
        };
        counts.add(&self.captured);
        counts
    }

    /// As many of the samples that are looked at as are the same share of them as `of_all` is of all.
    pub fn share_of(&self, of_all: Worth) -> Worth {
        let share = |part: u32, most: u32, whole: u32| {
            if whole == 0 { 0 } else { (u64::from(part) * u64::from(most)).div_ceil(u64::from(whole)) as u32 }
        };
        Worth {
            captured: share(of_all.captured, self.most.captured, self.most_of_all.captured),
            matched: share(of_all.matched, self.most.matched, self.most_of_all.matched),
        }
    }

    /// What the image at a waypoint sees. Bolted cameras look there as the nose does in the middle of its turn, which depends on the next
    /// waypoint: what they see is not counted, and is an extra.
    pub fn at_waypoint(&self, pose: &Pose, look: Look) -> Arc<Sights> {
        if self.is_rigid {
            return Arc::clone(&self.nothing);
        }
        let mut sights = Sights::default();
        self.see(pose, look, &mut sights);
        Arc::new(sights)
    }

    /// What the images of a leg see without those at its ends.
    pub fn on_leg(&self, from: &Pose, to: &Pose, look: Look) -> Arc<Sights> {
        let mut sights = Sights::default();
        let mut images = image_poses(&self.problem.rig, from, to, self.problem.spacing).peekable();
        while let Some(pose) = images.next() {
            if images.peek().is_some() {
                self.see(&pose, look, &mut sights);
            }
        }
        Arc::new(sights)
    }

    fn see(&self, pose: &Pose, look: Look, sights: &mut Sights) {
        sights.begin_image();
        let problem = self.problem;
        let Some(j) = problem.viewpoint_for(&pose.position) else { return };
        let row = &self.rows[j];
        let frusta = problem.rig.frusta(pose);
        let mut marks = vec![frusta.is_none(); row.samples.len()];
        frusta.iter().flatten().for_each(|view| view.mark_framed(&row.targets, &mut marks));
        for (&sample, _) in row.samples.iter().zip(&marks).filter(|(_, is_framed)| **is_framed) {
            let (i, frame) = (sample as usize, &problem.frames[sample as usize]);
            let mask = match look {
                Look::Field => problem.disks.mask(frame, &pose.position),
                Look::Rays if problem.is_in_sight(i, &pose.position) => problem.disks.exact_mask(frame, &pose.position),
                Look::Rays => 0,
            };
            if mask != 0 {
                sights.push(sample, mask, Bearing::new(&frame.position, &pose.position));
            }
        }
    }

    /// The direction from one place to another, brought into the gimbal's range.
    pub fn aimed(&self, from: &Point3<f64>, at: &Point3<f64>) -> Option<Unit<Vector3<f64>>> {
        self.within_reach(&(at - from))
    }

    /// The direction of a vector, brought into the gimbal's range.
    pub fn within_reach(&self, towards: &Vector3<f64>) -> Option<Unit<Vector3<f64>>> {
        let direction = Unit::try_new(*towards, 1e-6)?;
        let Cameras::Gimbal { sin_pitch: [low, high], .. } = &self.problem.rig.cameras else { return Some(direction) };
        let height = direction.z.clamp(*low, *high);
        if height == direction.z {
            return Some(direction);
        }
        let level = Unit::try_new(Vector3::new(direction.x, direction.y, 0.0), 1e-9)?;
        Unit::try_new(level.into_inner() * (1.0 - height * height).max(0.0).sqrt() + Vector3::z() * height, 1e-6)
    }
}

/// What images saw that were taken before the flight, as if one had taken all of it: nobody takes a single one of them away again.
fn captured(problem: &Problem) -> Sights {
    let mut sights = Sights::default();
    for i in 0..problem.frames.len() {
        // The cells of all of them count once.
        let mut cells = problem.captured_views(i).iter().fold(0, |cells, (mask, _)| cells | mask);
        for &(_, bearing) in problem.captured_views(i) {
            sights.push(i as u32, std::mem::take(&mut cells), bearing);
        }
    }
    sights
}

/// Cells that a sample must exceed while a flight is improved: more than the problem wants by a margin, as far as it can have them, so that an
/// image that is taken half a metre away, on the arc of a corner or in a gust, does not lose it. One that the cells `before` the flight capture is captured.
fn raised_threshold(problem: &Problem, settings: &RefineSettings, i: usize, before: Mask) -> u32 {
    let (threshold, ceiling) = (problem.thresholds[i], u32::from(problem.ceilings[i]));
    if before.count_ones() > threshold {
        return threshold;
    }
    match ceiling.checked_sub(threshold + 1) {
        Some(most) => threshold + settings.margin_cells.min(most),
        None => threshold,
    }
}
