//! The whole pipeline on one screen.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::Point3;

use crate::session::Snapshot;
use crate::settings::Settings;
use crate::trajectory::plan::Plan;

/// Asks a running computation to stop; clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct StopToken(Arc<AtomicBool>);

impl StopToken {
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// What a user asks for beyond the settings.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanOptions {
    /// Name of a rig preset: `panoramic`.
    pub rig: String,
    /// Name of a planning method: `paper`.
    pub method: String,
    pub seed: u64,
    /// Iterations K; `None` takes the setting.
    pub iterations: Option<u32>,
    /// Where the flight starts, m in the local frame; `None` chooses a start.
    pub start_m: Option<Point3<f64>>,
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

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    #[error("there is no rig {0:?}; known rigs: panoramic")]
    UnknownRig(String),
    #[error("there is no planning method {0:?}; known methods: paper")]
    UnknownMethod(String),
    #[error("the start ({0}) cannot be flown: {1}; give another `--start X,Y,Z` or leave it out")]
    Start(String, String),
}

/// Plans one flight on a snapshot. A stop of the token ends the search with the best plan so far.
pub fn plan(
    _snapshot: &Snapshot,
    _settings: &Settings,
    _options: &PlanOptions,
    _stop: &StopToken,
    _on_progress: &mut dyn FnMut(&Progress),
) -> Result<Plan, PlanError> {
    unimplemented!("core")
}
