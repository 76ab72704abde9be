//! The files of a plan, and its figures for the terminal.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use overfly_table::FieldTable;
use serde_json::{Value, json};

use super::failure::Failure;
use super::in_process::Planned;
use super::machine::this_machine;
use super::pages;
use crate::mission::run_json::{self, Engine, Run};
use crate::mission::{plan_json, svg};
use crate::scene::Terrain;
use crate::settings::Settings;
use crate::trajectory::plan::{Plan, RunTimes, StopReason};

/// A plan with all that its files need.
pub struct Flight<'a> {
    pub plan: &'a Plan,
    pub times: RunTimes,
    pub engine: Engine,
    /// From the user's edit to the plan, s.
    pub edit_to_plan_s: Option<f64>,
    pub import: Option<Value>,
    /// What was ordered and the settings that are not the built-in ones, so that the run can be repeated; a daemon's settings are its own.
    pub order: Option<Value>,
    pub settings: Option<Value>,
    /// Absolute path of the scene file, where there is one.
    pub scene_file: Option<String>,
    /// And of the model of its ground, where one was named.
    pub ground_file: Option<String>,
    /// The ground of the plan's scene, where it is known and not flat.
    pub terrain: Option<Arc<Terrain>>,
}

/// A folder for results that is known to be writable; when nothing was written into it, what was created of it goes again.
pub struct Folder {
    made: Vec<PathBuf>,
}

impl Folder {
    /// Creates the folder and tries it out, before anybody waits for results that cannot be written.
    pub fn prepare(path: &Path) -> Result<Self, Failure> {
        let made = path.ancestors().filter(|part| !part.as_os_str().is_empty() && !part.exists()).map(Path::to_owned).collect();
        let folder = Self { made };
        fs::create_dir_all(path).map_err(|cause| Failure::write(path, cause))?;
        let trial = path.join(format!(".overfly-{}", std::process::id()));
        fs::write(&trial, b"").and_then(|()| fs::remove_file(&trial)).map_err(|cause| Failure::write(path, cause))?;
        Ok(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // The innermost stands first; a folder with something in it stays.
        self.made.iter().for_each(|path| drop(fs::remove_dir(path)));
    }
}

/// How the files of one plan are called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileNames {
    pub plan: String,
    pub drawing: String,
    pub page: String,
    pub run: String,
}

impl FileNames {
    /// `plan.json`, `plan.svg`, `run.json`, `plan.html`: what scripts look for.
    pub fn of_plan() -> Self {
        Self { run: "run.json".to_owned(), ..Self::with_stem("plan") }
    }

    /// The names for one of several plans in a folder: `replan.json`, `replan.svg`, `replan-run.json`, `replan.html`.
    pub fn with_stem(stem: &str) -> Self {
        Self {
            plan: format!("{stem}.json"),
            drawing: format!("{stem}.svg"),
            page: format!("{stem}.html"),
            run: format!("{stem}-run.json"),
        }
    }
}

/// What a plan is drawn in.
pub enum Scenery<'a> {
    /// The scene that it was planned in, in this process.
    Planned(&'a Planned, &'a Settings),
    /// The field of its revision.
    Field(&'a FieldTable<'a>),
    /// Nothing: the field of its revision is gone, and there are no drawings.
    Gone,
}

/// Writes the files of a plan into `folder`, which is created; returns their paths.
pub fn write(folder: &Path, names: &FileNames, flight: &Flight, scenery: &Scenery) -> Result<Vec<PathBuf>, Failure> {
    fs::create_dir_all(folder).map_err(|cause| Failure::write(folder, cause))?;
    let run = Run {
        engine: flight.engine,
        machine: this_machine(),
        times: flight.times,
        edit_to_plan_s: flight.edit_to_plan_s,
        import: flight.import.clone(),
        order: flight.order.clone(),
        settings: flight.settings.clone(),
        scene_file: flight.scene_file.clone(),
        ground_file: flight.ground_file.clone(),
    };
    let mut written = Vec::new();
    let mut put = |name: &str, bytes: Vec<u8>| {
        let path = folder.join(name);
        fs::write(&path, bytes).map_err(|cause| Failure::write(&path, cause))?;
        written.push(path);
        Ok::<(), Failure>(())
    };
    put(&names.plan, plan_json::to_bytes(flight.plan))?;
    let terrain = flight.terrain.as_deref();
    match scenery {
        Scenery::Planned(planned, _) => put(&names.drawing, svg::to_bytes(&planned.snapshot.field(), terrain, flight.plan)?)?,
        Scenery::Field(field) => put(&names.drawing, svg::to_bytes(field, terrain, flight.plan)?)?,
        Scenery::Gone => {}
    }
    put(&names.run, run_json::to_bytes(flight.plan, &run))?;
    // The page comes last: whoever waits for the plan has it by then.
    match scenery {
        Scenery::Planned(planned, settings) => put(&names.page, pages::of_planned(planned, settings)?)?,
        Scenery::Field(field) => {
            let is_under_way = flight.order.as_ref().is_some_and(|order| !order["en_route"].is_null());
            put(&names.page, pages::of_field(field, flight.plan, is_under_way)?)?;
        }
        Scenery::Gone => {}
    }
    Ok(written)
}

/// Rows of a table: label, then one cell.
pub fn figures(plan: &Plan, times: &RunTimes) -> Vec<Vec<String>> {
    let metrics = &plan.metrics;
    let row = |label: &str, value: String| vec![label.to_owned(), value];
    let mut rows = vec![
        row("captured of capturable, %", format!("{:.1}", metrics.coverage_percent)),
        row("captured of exposed, %", format!("{:.1}", metrics.coverage_exposed_percent)),
        row("capturable (ceiling), %", format!("{:.1}", metrics.capturable_percent)),
        row("in matched views, %", format!("{:.1}", metrics.matched_percent)),
        row("length, m", format!("{:.0}", metrics.length_m)),
        row("waypoints", plan.waypoints.len().to_string()),
        row("images", plan.images.len().to_string()),
        row("selected images", plan.selected_images().to_string()),
        row("movement, s", format!("{:.1}", metrics.movement_s)),
        row("turning, s", format!("{:.1}", metrics.turning_s)),
        row("flight, s", format!("{:.1}", metrics.flight_s)),
        row("speed profile, s", format!("{:.1}", metrics.profile_s)),
        row("least clearance, m", format!("{:.2}", plan.clearance_m)),
        row("iterations", plan.convergence.len().to_string()),
        row("field, s", format!("{:.3}", times.field_s)),
        row("search, s", format!("{:.3}", times.search_s)),
        row("check, s", format!("{:.3}", times.check_s)),
        row("total, s", format!("{:.3}", times.total_s)),
    ];
    let behind_times = rows.iter().position(|row| row[0] == "speed profile, s").map_or(0, |index| index + 1);
    let others = [
        plan.limits.map(|limits| row("cruise, m/s", format!("{:.2}", limits.cruise_mps))),
        metrics.battery_percent.map(|battery_percent| row("battery, %", format!("{battery_percent:.0}"))),
    ];
    rows.splice(behind_times..behind_times, others.into_iter().flatten());
    rows
}

/// The figures of `plan.json` and what goes with them, for scripts.
pub fn figures_json(flight: &Flight, files: &[PathBuf]) -> Value {
    let Flight { plan, times, .. } = flight;
    let mut figures = plan_json::metrics(plan);
    let others = json!({
        "scene": plan.scene.name,
        "revision": plan.scene.revision,
        "engine": flight.engine,
        "seed": plan.seed,
        "rig": plan.rig,
        "method": plan.method,
        "stop": run_json::stop_name(plan.stop),
        "goal_percent": plan.goal_percent,
        "matched_goal_percent": plan.matched_goal_percent,
        "goal_reached": plan.stop == StopReason::GoalReached,
        "cruise_mps": plan.limits.map(|limits| limits.cruise_mps),
        "clearance_m": plan.clearance_m,
        "iterations": plan.convergence.len(),
        "field_s": times.field_s,
        "search_s": times.search_s,
        "check_s": times.check_s,
        "total_s": times.total_s,
        "edit_to_plan_s": flight.edit_to_plan_s,
        "files": files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
    });
    if let (Value::Object(figures), Value::Object(others)) = (&mut figures, others) {
        figures.extend(others);
    }
    figures
}
