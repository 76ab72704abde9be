//! Plans as tables: what the daemon publishes, and the way back.

mod rows;

use overfly_table::plan::{CellsRow, INFEASIBLE, LimitsRow, PlanCounts, PlanFacts, SAFE};
use overfly_table::{Block, PlanTable, PlanTableMut};

use self::rows::*;
use crate::frame::Geodetic;
use crate::trajectory::plan::{Camera, Plan, RunTimes, SceneStamp};

/// Why a table is not a plan.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlanTableError {
    #[error("the plan's {what} holds a value that is not finite")]
    NotFinite { what: &'static str },
    #[error("the plan's {what} holds the code {code}, which this release does not know: use client and daemon of one release")]
    Code { what: &'static str, code: u64 },
    #[error("the plan's {what} is not a unit vector")]
    Direction { what: &'static str },
    #[error("the plan's text is not UTF-8 or lacks the line of its {missing}")]
    Text { missing: &'static str },
    #[error("an image names camera {camera}, but the rig has {cameras}")]
    Camera { camera: u32, cameras: usize },
    #[error("the plan's {what} lie beyond what a drone can fly by")]
    Limits { what: &'static str },
    #[error("the plan counts what it captures, and says that it does not")]
    Counted,
    #[error("there is no flight in the scene {scene:?}: {reason}")]
    Infeasible { scene: String, reason: String },
    #[error("the plan counts {counted} waypoints but holds {held}")]
    Count { counted: u64, held: usize },
}

/// Size of the table of a plan, blocks.
pub fn blocks(plan: &Plan) -> usize {
    counts(plan).blocks()
}

/// Writes a plan where it will be read: `into` is as long as [`blocks`] says.
pub fn write(plan: &Plan, times: &RunTimes, into: &mut [Block]) {
    let table = PlanTableMut::create(into, &counts(plan), &facts(plan, times));
    fill(table.waypoints, plan.waypoints.iter().map(waypoint_row));
    fill(table.images, plan.images.iter().map(image_row));
    fill(table.cameras, plan.cameras.iter().map(camera_row));
    fill(table.iterations, plan.convergence.iter().map(iteration_row));
    let cells = plan.cells.iter().zip(&plan.ceilings);
    fill(table.cells, cells.map(|(&covered, &ceiling)| CellsRow { covered, ceiling }));
    fill(table.text, text(plan).bytes());
}

/// The plan as a table in memory of its own.
pub fn to_blocks(plan: &Plan, times: &RunTimes) -> Vec<Block> {
    let mut table = vec![Block::ZERO; blocks(plan)];
    write(plan, times, &mut table);
    table
}

/// A table that says why there is no flight in a scene of this revision.
pub fn infeasible(scene: &str, revision: u64, reason: &str) -> Vec<Block> {
    let facts = PlanFacts { revision, stop: INFEASIBLE, ..PlanFacts::default() };
    let text = format!("{}\n{}\n", escape(scene), escape(reason));
    let counts = PlanCounts { text_bytes: text.len(), ..PlanCounts::default() };
    let mut blocks = vec![Block::ZERO; counts.blocks()];
    PlanTableMut::create(&mut blocks, &counts, &facts).text.copy_from_slice(text.as_bytes());
    blocks
}

fn counts(plan: &Plan) -> PlanCounts {
    PlanCounts {
        waypoints: plan.waypoints.len(),
        images: plan.images.len(),
        cameras: plan.cameras.len(),
        samples: plan.cells.len().min(plan.ceilings.len()),
        iterations: plan.convergence.len(),
        text_bytes: text(plan).len(),
    }
}

fn fill<T>(rows: &mut [T], values: impl Iterator<Item = T>) {
    rows.iter_mut().zip(values).for_each(|(row, value)| *row = value);
}

/// The plan in a table that somebody else may have written.
pub fn from_table(table: &PlanTable<'_>) -> Result<(Plan, RunTimes), PlanTableError> {
    let facts = table.facts;
    if facts.metrics.waypoints != table.waypoints.len() as u64 {
        return Err(PlanTableError::Count { counted: facts.metrics.waypoints, held: table.waypoints.len() });
    }
    if let Some(reason) = table.infeasible() {
        let scene = std::str::from_utf8(table.text).unwrap_or_default().lines().next().unwrap_or_default();
        return Err(PlanTableError::Infeasible { scene: unescape(scene), reason: unescape(reason) });
    }
    let mut lines =
        std::str::from_utf8(table.text).map_err(|_| PlanTableError::Text { missing: "scene" })?.split_terminator('\n');
    let mut line = |missing| lines.next().map(unescape).ok_or(PlanTableError::Text { missing });
    let (name, rig, method) = (line("scene")?, line("rig")?, line("method")?);
    let names: Vec<String> = lines.map(unescape).collect();
    if names.len() != table.cameras.len() {
        return Err(PlanTableError::Text { missing: "cameras" });
    }
    let cameras: Vec<Camera> =
        names.into_iter().zip(table.cameras).map(|(name, row)| camera(name, row)).collect::<Result<_, _>>()?;
    if facts.stop == SAFE && !table.cells.is_empty() {
        return Err(PlanTableError::Counted);
    }
    let plan = Plan {
        scene: SceneStamp { name, origin: origin(facts)?, revision: facts.revision },
        seed: facts.seed,
        rig,
        method,
        waypoints: table.waypoints.iter().map(waypoint).collect::<Result<_, _>>()?,
        images: table.images.iter().map(|row| image(row, cameras.len())).collect::<Result<_, _>>()?,
        cameras,
        metrics: metrics(&facts.metrics, facts.stop != SAFE)?,
        limits: limits(&facts.limits)?,
        cells: table.cells.iter().map(|row| row.covered).collect(),
        ceilings: table.cells.iter().map(|row| row.ceiling).collect(),
        goal_percent: finite("goal", facts.goal_percent)?,
        matched_goal_percent: finite("goal of matches", facts.matched_goal_percent)?,
        egress: egress(facts.egress, table.waypoints.len())?,
        clearance_m: finite("clearance", facts.clearance_m)?,
        convergence: table.iterations.iter().map(iteration).collect::<Result<_, _>>()?,
        stop: stop_reason(facts.stop)?,
    };
    Ok((plan, run_times(facts)?))
}

fn facts(plan: &Plan, times: &RunTimes) -> PlanFacts {
    let origin = plan.scene.origin;
    let of_origin = |value: fn(&Geodetic) -> f64| origin.as_ref().map_or(0.0, value);
    PlanFacts {
        metrics: metrics_row(&plan.metrics, plan.waypoints.len()),
        limits: plan.limits.as_ref().map_or_else(LimitsRow::default, limits_row),
        revision: plan.scene.revision,
        seed: plan.seed,
        iterations: plan.convergence.len() as u64,
        stop: stop_code(plan.stop),
        origin_lat_deg: of_origin(|origin| origin.lat_deg),
        origin_lon_deg: of_origin(|origin| origin.lon_deg),
        origin_alt_m: of_origin(|origin| origin.alt_m),
        georeferenced: origin.is_some().into(),
        goal_percent: plan.goal_percent,
        matched_goal_percent: plan.matched_goal_percent,
        field_s: times.field_s,
        search_s: times.search_s,
        check_s: times.check_s,
        total_s: times.total_s,
        egress: u64::from(plan.egress.brakes) | u64::from(plan.egress.escapes) << 1,
        clearance_m: plan.clearance_m,
        threads: times.threads.into(),
    }
}

#[cfg(test)]
mod tests;
