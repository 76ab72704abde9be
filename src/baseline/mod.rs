//! Baselines: the methods that the paper compares with (sections 2, 6.2 and 6.3).
//!
//! These are re-implementations of published ideas over the same samples, visibility, safety and speed profile as every other method. They
//! are not the authors' programs, whose heuristics and constants differ.
//!
//! - [`oblique`]: serpentine lines at one height, as commercial software flies them.
//! - [`smith`]: after Smith et al. 2018, "Aerial path planning for urban scene reconstruction: a continuous optimization method and
//!   benchmark": views chosen by the sum over pairs that see a point, then a tour.
//! - [`zhou`]: after Zhou et al. 2020, "Offsite aerial path planning for efficient urban scene reconstruction": far too many views, of which
//!   those are left out that the reconstructability of no point needs, then a tour.
//!
//! The tour methods take images at their views alone. Consecutive images must be as far apart as the shutter needs at cruise speed, so their
//! views keep that distance from each other. The drone does not stop at a view: a favour to these methods.

mod assembly;
pub mod costs;
mod flight;
pub mod oblique;
pub mod pairs;
mod proximity;
pub mod router;
pub mod shots;
pub mod smith;
mod tally;
pub mod tour;
pub mod zhou;

use crate::camera::{Cameras, Pose};
use crate::search::{Problem, Progress, StopReason};
use crate::stop::StopToken;
use crate::trajectory::route::{Found, Route};

/// Why a baseline has no flight.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BaselineError {
    #[error(
        "the method {method:?} chooses the view direction of each image, but the cameras of {rig:?} are bolted to the drone; take a rig with \
         a gimbal (phantom4-rtk, mavic3e), or the method \"op\" or \"paper\""
    )]
    BoltedCameras { method: &'static str, rig: String },
    #[error(
        "oblique photography flies at one height above all buildings: at least {needed_m:.1} m here ({tallest_m:.1} m and the safety \
         distance), but the flight limits end at {ceiling_m:.1} m; raise `flight.legal_ceiling_m` or `flight.above_tallest_m`"
    )]
    NoHeight { needed_m: f64, tallest_m: f64, ceiling_m: f64 },
    #[error(
        "`baseline.op_height_m` is {height_m} m, but must lie between {least_m:.1} m and {most_m:.1} m over this scene; 0 chooses"
    )]
    Height { height_m: f64, least_m: f64, most_m: f64 },
    #[error(
        "oblique photography would take {images:.0} images at this height and focal length, the most is {most}; lower \
         `baseline.op_focal_mm` or the overlaps, or raise `baseline.op_height_m`"
    )]
    TooManyImages { images: f64, most: usize },
    #[error(
        "no view of the method {method:?} can be flown: no safe position near the surface sees a capturable sample; lower \
         `flight.safety_distance_m` or raise `flight.legal_ceiling_m`"
    )]
    NoView { method: &'static str },
    #[error("the computation was abandoned")]
    Abandoned,
}

/// Whether a method that chooses views can do so with the rig of the problem.
fn check_rig(problem: &Problem, method: &'static str) -> Result<(), BaselineError> {
    match problem.rig.cameras {
        Cameras::Rigid(_) => Err(BaselineError::BoltedCameras { method, rig: problem.rig.name.clone() }),
        _ => Ok(()),
    }
}

/// Says how far a method has come; its steps are parts of the whole, because their number is not known beforehand.
struct Reporter<'a> {
    on_progress: &'a mut dyn FnMut(&Progress),
    last: Progress,
}

/// Parts of the whole in which progress is told.
const PARTS: u32 = 100;

impl<'a> Reporter<'a> {
    fn new(on_progress: &'a mut dyn FnMut(&Progress)) -> Self {
        let last = Progress { iteration: 0, iterations: PARTS, coverage_percent: 0.0, length_m: 0.0, objective: 0.0 };
        Self { on_progress, last }
    }

    /// `done` of [`PARTS`] parts are done.
    fn tell(&mut self, done: u32) {
        self.last.iteration = done;
        (self.on_progress)(&self.last);
    }

    /// The same with what the views chosen so far capture by the field.
    fn tell_views<'p>(&mut self, done: u32, problem: &Problem, poses: impl Iterator<Item = &'p Pose>) {
        let mut covered = vec![0; problem.field.samples.len()];
        let mut scratch = problem.scratch();
        let captured = poses.map(|pose| problem.cover(&mut covered, &problem.observe_pose(pose, &mut scratch)).captured).sum();
        self.last.coverage_percent = problem.coverage_percent(captured);
        self.tell(done);
    }

    fn tell_length(&mut self, done: u32, length_m: f64) {
        self.last.length_m = length_m;
        self.tell(done);
    }
}

/// What a method ends with.
fn found(route: Route, stop: &StopToken) -> Result<Found, BaselineError> {
    let reason = match (stop.is_abandoned(), stop.is_stopped()) {
        (true, _) => return Err(BaselineError::Abandoned),
        (_, true) => StopReason::Cancelled,
        _ => StopReason::Complete,
    };
    Ok(Found { route, convergence: Vec::new(), stop: reason })
}
