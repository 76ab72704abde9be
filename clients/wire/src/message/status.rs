//! How the daemon and its scenes are.

use serde::{Deserialize, Serialize};

/// The daemon and all its scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    pub version: String,
    pub domain: String,
    pub pid: u32,
    pub instance: u64,
    pub uptime_s: f64,
    pub threads: u32,
    /// Shared memory that the fields of all scenes take.
    pub field_bytes: u64,
    pub budget_bytes: u64,
    /// Resident memory of the daemon, shared memory included.
    pub resident_mb: f64,
    pub scenes: Vec<SceneStatus>,
}

/// One scene of a daemon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneStatus {
    pub name: String,
    pub revision: u64,
    pub structures: u64,
    pub samples: u64,
    pub viewpoints: u64,
    pub capturable_percent: f64,
    pub field_bytes: u64,
    pub state: SceneState,
    /// The last plan that was published for it.
    pub plan: Option<PlanSummary>,
    /// What is to be known of the last plan or of the attempt to make a newer one.
    pub remark: Option<String>,
}

/// What goes on with a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SceneState {
    Idle,
    /// Its field is being built.
    Building,
    Planning,
}

/// The figures of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanSummary {
    pub revision: u64,
    /// The scene has another revision by now, so that the plan may lead through something: do not fly it.
    pub is_stale: bool,
    pub seed: u64,
    pub waypoints: u64,
    pub length_m: f64,
    pub flight_s: f64,
    /// NaN while it is not counted, right after an edit.
    pub coverage_percent: f64,
    /// From taking up the request to the plan, s.
    pub total_s: f64,
}
