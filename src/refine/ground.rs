//! What all flights over one scene have in common while they are improved.

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};

use super::counts::CellCounts;
use super::sights::Sights;
use crate::camera::{Cameras, Pose};
use crate::search::Problem;
use crate::search::leg::image_poses;
use crate::settings::{RefineSettings, Settings};
use crate::trajectory::profile::Limits;

/// The problem with what the moves need of it.
pub struct Ground<'a> {
    pub problem: &'a Problem<'a>,
    pub settings: &'a RefineSettings,
    pub limits: Limits,
    /// Whether cameras are bolted on, so that an image belongs to the leg that arrives at it.
    pub is_rigid: bool,
    /// Whether the flight has to begin where it does.
    pub is_start_fixed: bool,
    /// Samples that can be captured.
    pub capturable: Vec<u32>,
    /// Viewpoints of the field that see each sample.
    pub seers: Vec<Vec<u32>>,
    pub nothing: Arc<Sights>,
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
    pub fn new(problem: &'a Problem<'a>, settings: &'a Settings, is_start_fixed: bool) -> Self {
        let mut seers = vec![Vec::new(); problem.frames.len()];
        for j in 0..problem.field.viewpoints.len() {
            problem.capturable_seen_from(j).for_each(|i| seers[i].push(j as u32));
        }
        Self {
            problem,
            settings: &settings.refine,
            limits: Limits::new(&problem.rig, &settings.flight, &settings.dynamics),
            is_rigid: matches!(problem.rig.cameras, Cameras::Rigid(_)),
            is_start_fixed,
            capturable: (0..problem.frames.len() as u32).filter(|&i| problem.is_capturable(i as usize)).collect(),
            seers,
            nothing: Arc::new(Sights::default()),
        }
    }

    /// Empty counters with the thresholds of the problem.
    pub fn counts(&self) -> CellCounts {
        CellCounts::new(self.problem.thresholds.clone())
    }

    /// What the image at a waypoint sees; where the cameras are bolted on, it belongs to the leg that arrives.
    pub fn at_waypoint(&self, pose: &Pose, look: Look) -> Arc<Sights> {
        if self.is_rigid {
            return Arc::clone(&self.nothing);
        }
        let mut sights = Sights::default();
        self.see(pose, look, &mut sights);
        Arc::new(sights)
    }

    /// What the images of a leg see without those at its ends; where the cameras are bolted on, with that at its end.
    pub fn on_leg(&self, from: &Pose, to: &Pose, look: Look) -> Arc<Sights> {
        let mut sights = Sights::default();
        let mut images = image_poses(&self.problem.rig, from, to, self.problem.image_spacing_m).peekable();
        while let Some(pose) = images.next() {
            if self.is_rigid || images.peek().is_some() {
                self.see(&pose, look, &mut sights);
            }
        }
        Arc::new(sights)
    }

    fn see(&self, pose: &Pose, look: Look, sights: &mut Sights) {
        sights.begin_image();
        match look {
            Look::Field => self.problem.promised(pose, &mut |sample, mask| sights.push(sample, mask)),
            Look::Rays => self.problem.confirmed(pose, &mut |sample, mask| sights.push(sample, mask)),
        }
    }

    /// Whether a pose may be a waypoint.
    pub fn is_admissible(&self, pose: &Pose) -> bool {
        pose.direction.is_none_or(|direction| self.problem.rig.reaches(&direction)) && self.problem.free.is_safe(&pose.position)
    }

    /// Whether a leg is long enough for its images and the view turns slowly enough on it; safety is not looked at.
    pub fn is_flyable(&self, from: &Pose, to: &Pose) -> bool {
        let spacing_m = self.problem.image_spacing_m;
        (to.position - from.position).norm_squared() >= spacing_m * spacing_m && self.problem.can_turn(from, to)
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
