//! What a search returns: always the best path so far, never an error because it was stopped.

use crate::camera::Pose;

/// The result of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Waypoints w_1 to w_n.
    pub path: Vec<Pose>,
    /// The best path after each iteration.
    pub convergence: Vec<Iteration>,
    pub stop: StopReason,
}

/// The best path after one iteration, by the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iteration {
    pub objective: f64,
    pub coverage_percent: f64,
    pub length_m: f64,
    pub turning_s: f64,
}

/// Why a search ended. None of them is an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    GoalReached,
    IterationsUsed,
    /// The tree holds as much as `search.memory_mb` allows.
    MemoryUsed,
    /// No further point of the free space could be reached.
    SpaceExhausted,
    Cancelled,
    /// The method has done all that it does; it does not search for a goal.
    Complete,
    /// What can still be flown of an earlier flight after an edit, handed out before there is a field of the scene as it is: it is safe, what it captures
    /// is not counted yet.
    Safe,
    /// There was no search yet: what could still be flown of an earlier flight after an edit.
    Repaired,
    /// The search goes on: this flight is better than the one that it handed out before.
    Improved,
}

/// How far a search has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    pub iteration: u32,
    pub iterations: u32,
    /// Best path so far, by the field.
    pub coverage_percent: f64,
    pub length_m: f64,
    pub objective: f64,
}
