//! What a search returns: always the best path so far, never an error because it was stopped.

use crate::camera::Pose;
use crate::trajectory::plan::{Iteration, StopReason};

/// The result of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Waypoints w_1 to w_n.
    pub path: Vec<Pose>,
    /// The best path after each iteration.
    pub convergence: Vec<Iteration>,
    pub stop: StopReason,
}
