//! `run.json`: what varies between two runs of one plan (times, machine, threads), and how the search went. It lies beside `plan.json`
//! so that `plan.json` can be compared byte for byte.

use serde::Serialize;
use serde_json::Value;

use crate::trajectory::plan::{Iteration, Plan, RunTimes, StopReason};

/// Version of the format, the first key of the file.
pub const FORMAT: &str = "overfly-run/1";

/// Where a run took place. The caller finds this out; the writer reads no environment.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Machine {
    /// `linux-x86_64` and the like.
    pub platform: String,
    /// Model name of the processor, empty when unknown.
    pub processor: String,
    /// Cores that this process may use.
    pub cores: usize,
}

/// Who made the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    InProcess,
    Daemon,
}

/// Everything about a run that is not in the plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    pub engine: Engine,
    pub machine: Machine,
    pub times: RunTimes,
    /// From the user's edit to the safe plan in the client's hands, s; `None` when no edit led to this plan.
    pub edit_to_plan_s: Option<f64>,
    /// What the reader of the scene file had to repair or guess, where the caller has it.
    pub import: Option<Value>,
    /// What was ordered (seed, iterations as given, start), and the settings that differ from the built-in ones: both together with the
    /// scene file repeat the run. `None` where the caller does not know them.
    pub order: Option<Value>,
    pub settings: Option<Value>,
    /// Absolute path of the scene file; `None` for a scene that a daemon holds, which may have been edited since it was read.
    pub scene_file: Option<String>,
    pub ground_file: Option<String>,
}

/// The file's content, with a final newline.
pub fn to_bytes(plan: &Plan, run: &Run) -> Vec<u8> {
    let entry = RunEntry {
        format: FORMAT,
        version: env!("CARGO_PKG_VERSION"),
        scene: &plan.scene.name,
        revision: plan.scene.revision,
        scene_file: run.scene_file.as_deref(),
        ground_file: run.ground_file.as_deref(),
        engine: run.engine,
        machine: &run.machine,
        threads: run.times.threads,
        times: TimesEntry {
            field_s: run.times.field_s,
            search_s: run.times.search_s,
            check_s: run.times.check_s,
            total_s: run.times.total_s,
            edit_to_plan_s: run.edit_to_plan_s,
        },
        stop: stop_name(plan.stop),
        goal_percent: plan.goal_percent,
        matched_goal_percent: plan.matched_goal_percent,
        coverage_percent: plan.metrics.coverage_percent,
        clearance_m: plan.clearance_m,
        order: run.order.as_ref(),
        settings: run.settings.as_ref(),
        import: run.import.as_ref(),
    };
    let head = serde_json::to_string_pretty(&entry).expect("entries have string keys and no failing serialiser");
    let head = head.strip_suffix("\n}").expect("a pretty object ends with a brace on a line of its own");
    format!("{head},\n  \"convergence\": {{\n{}\n  }}\n}}\n", convergence(plan)).into_bytes()
}

/// The word for a stop reason, as it stands in `run.json` and in the command line's JSON.
pub fn stop_name(stop: StopReason) -> &'static str {
    match stop {
        StopReason::GoalReached => "goal_reached",
        StopReason::IterationsUsed => "iterations_used",
        StopReason::MemoryUsed => "memory_used",
        StopReason::SpaceExhausted => "space_exhausted",
        StopReason::Cancelled => "cancelled",
        StopReason::Complete => "complete",
        StopReason::Safe => "safe",
        StopReason::Repaired => "repaired",
        StopReason::Improved => "improved",
    }
}

#[derive(Serialize)]
struct RunEntry<'a> {
    format: &'static str,
    version: &'static str,
    scene: &'a str,
    revision: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    scene_file: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ground_file: Option<&'a str>,
    engine: Engine,
    machine: &'a Machine,
    threads: u32,
    times: TimesEntry,
    stop: &'static str,
    goal_percent: f64,
    matched_goal_percent: f64,
    coverage_percent: f64,
    clearance_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    order: Option<&'a Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    settings: Option<&'a Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    import: Option<&'a Value>,
}

#[derive(Serialize)]
struct TimesEntry {
    field_s: f64,
    search_s: f64,
    check_s: f64,
    total_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    edit_to_plan_s: Option<f64>,
}

/// The best path after iteration 1, 2, ... of the search, one list per figure and line; coverage is by the field, percent of the
/// capturable samples.
fn convergence(plan: &Plan) -> String {
    let list = |key: &str, figure: fn(&Iteration) -> f64| {
        let values: Vec<f64> = plan.convergence.iter().map(figure).collect();
        format!("    \"{key}\": {}", Value::from(values))
    };
    [
        list("objective", |iteration| iteration.objective),
        list("coverage_percent", |iteration| iteration.coverage_percent),
        list("length_m", |iteration| iteration.length_m),
        list("turning_s", |iteration| iteration.turning_s),
    ]
    .join(",\n")
}
