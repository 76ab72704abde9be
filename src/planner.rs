//! The whole pipeline on one screen.

use nalgebra::Point3;
use overfly_table::field::ViewpointRow;

use crate::camera::{Pose, Rig};
use crate::field::Snapshot;
use crate::scene::free_space::Obstruction;
use crate::search::objective::PathSums;
use crate::search::{Problem, SearchError, search};
use crate::settings::{MOST_ITERATIONS, Settings};
use crate::trajectory::evaluate::{self, Capture};
use crate::trajectory::images::{self, FlightSums};
use crate::trajectory::plan::{Metrics, Plan, SceneStamp, Waypoint};
use crate::trajectory::safety::{self, UnsafeCurve};

pub use crate::search::Progress;
pub use crate::stop::StopToken;

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

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    #[error("there is no rig {0:?}; known rigs: {known}", known = Rig::PRESETS.join(", "))]
    UnknownRig(String),
    #[error("there is no planning method {0:?}; known methods: {known}", known = METHODS.join(", "))]
    UnknownMethod(String),
    #[error(
        "the flight cannot start at ({position}): {cause}; give another start in metres of the scene's frame, or none to have one chosen"
    )]
    Start { position: String, cause: Obstruction },
    #[error("{iterations} iterations were asked for; the most is {most}", most = MOST_ITERATIONS)]
    Iterations { iterations: u32 },
    #[error(
        "no sample of the scene can be captured: no admissible view comes within {range_m} m and sees enough of it; raise \
         `flight.legal_ceiling_m` ({ceiling_m} m) or `coverage.range_m`"
    )]
    NothingCapturable { range_m: f64, ceiling_m: f64 },
    #[error("the computation was abandoned")]
    Abandoned,
    #[error(transparent)]
    Search(#[from] SearchError),
    #[error("the search's path failed the final safety check and is withheld: {0}; this is a defect of the planner")]
    Unsafe(#[from] UnsafeCurve),
}

/// Names of the planning methods.
pub const METHODS: [&str; 1] = ["paper"];

/// Plans one flight on a snapshot. A stop of the token ends the search with the best plan so far; only when the token is abandoned
/// there is none.
pub fn plan(
    snapshot: &Snapshot,
    settings: &Settings,
    options: &PlanOptions,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Plan, PlanError> {
    let rig = Rig::preset(&options.rig).ok_or_else(|| PlanError::UnknownRig(options.rig.clone()))?;
    if !METHODS.contains(&options.method.as_str()) {
        return Err(PlanError::UnknownMethod(options.method.clone()));
    }
    let problem = Problem::new(snapshot, settings, rig);
    if problem.capturable == 0 {
        let (range_m, ceiling_m) = (settings.coverage.range_m, settings.flight.legal_ceiling_m);
        return Err(PlanError::NothingCapturable { range_m, ceiling_m });
    }
    let start = start_pose(&problem, options.start_m, stop)?;
    let iterations = options.iterations.unwrap_or(settings.search.iterations);
    if iterations > MOST_ITERATIONS {
        return Err(PlanError::Iterations { iterations });
    }

    let speed_mps = settings.flight.cruise_speed_mps;
    let confirm = |path: &[Pose]| {
        let (images, _) = images::place(path, &problem, speed_mps);
        evaluate::capture(snapshot, &problem.rig, &images, stop).map_or(0, |capture| capture.captured)
    };
    let outcome = search(&problem, start, iterations, options.seed, stop, &confirm, on_progress)?;
    let (images, sums) = images::place(&outcome.path, &problem, speed_mps);
    let capture = evaluate::capture(snapshot, &problem.rig, &images, stop).ok_or(PlanError::Abandoned)?;
    let curve: Vec<_> = outcome.path.iter().map(|pose| pose.position).collect();
    // Eq. 6 sums from k = 2: what the view at the start sees belongs to no leg.
    let at_start =
        evaluate::capture(snapshot, &problem.rig, &images[..problem.rig.cameras().len()], stop).ok_or(PlanError::Abandoned)?;
    let clearance_m = safety::check(&curve, &snapshot.free)?;

    let waypoints = outcome.path.iter().map(|pose| Waypoint { position_m: pose.position, direction: pose.direction }).collect();
    Ok(Plan {
        scene: SceneStamp { name: snapshot.scene.name.clone(), origin: snapshot.scene.frame.origin, revision: snapshot.revision },
        seed: options.seed,
        rig: options.rig.clone(),
        method: options.method.clone(),
        cameras: problem.rig.cameras(),
        metrics: metrics(&problem, settings, &sums, &capture, &at_start),
        waypoints,
        images,
        cells: capture.cells,
        goal_percent: settings.coverage.goal_percent,
        clearance_m,
        convergence: outcome.convergence,
        stop: outcome.stop,
    })
}

/// The given start if it is safe; else the viewpoint that alone captures the most information, so that the tree begins where there
/// is something to see.
fn start_pose(problem: &Problem, given_m: Option<Point3<f64>>, stop: &StopToken) -> Result<Pose, PlanError> {
    if let Some(position) = given_m {
        return match problem.free.obstruction_at(&position) {
            None => Ok(Pose { position, direction: None }),
            Some(cause) => {
                let position = format!("{}, {}, {}", position.x, position.y, position.z);
                Err(PlanError::Start { position, cause })
            }
        };
    }
    let pose = |row: &ViewpointRow| Pose { position: row.position_m.into(), direction: None };
    let mut scratch = problem.scratch();
    let nothing = vec![0; problem.field.samples.len()];
    let mut best = (pose(&problem.field.viewpoints[0]), 0);
    for pose in problem.field.viewpoints.iter().map(pose) {
        if stop.is_abandoned() {
            return Err(PlanError::Abandoned);
        }
        let gain = problem.gain(&nothing, &problem.observe_pose(&pose, &mut scratch));
        if gain > best.1 {
            best = (pose, gain);
        }
    }
    Ok(best.0)
}

fn metrics(problem: &Problem, settings: &Settings, sums: &FlightSums, capture: &Capture, at_start: &Capture) -> Metrics {
    let movement_s = sums.length_m / settings.flight.cruise_speed_mps;
    let path =
        PathSums { information: capture.information - at_start.information, length_m: sums.length_m, turning_s: sums.turning_s };
    Metrics {
        length_m: sums.length_m,
        movement_s,
        turning_s: sums.turning_s,
        flight_s: movement_s + sums.turning_s,
        coverage_percent: capture.coverage_percent,
        coverage_exposed_percent: capture.coverage_exposed_percent,
        capturable_percent: capture.capturable_percent,
        information: problem.objective.gain(capture.information),
        objective: problem.objective.value(&path),
    }
}
