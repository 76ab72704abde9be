//! The scene that a plan.json was made on, for what is flown and exported of it.

use std::path::{Path, PathBuf};

use super::evaluate::{read_as_before, read_run, run_file, scene_files};
use super::failure::Failure;
use super::in_process::{self, OwnedFiles};
use crate::quality;
use crate::scene::Scene;
use crate::scene::free_space::FreeSpace;
use crate::session::FieldError;
use crate::settings::Settings;
use crate::trajectory::plan::Plan;

/// The scene file that is given, else the one that the run.json beside a plan names, read as it was for the plan; or why there is none.
pub fn find(
    given: Option<&PathBuf>,
    plan_file: &Path,
    plan: &Plan,
    settings: &Settings,
) -> Result<Result<Scene, String>, Failure> {
    let run_file = run_file(plan_file);
    let run = read_run(&run_file, plan);
    let settings = run.as_ref().map_or(settings.clone(), |run| read_as_before(settings.clone(), run));
    let files = match given {
        Some(file) => Ok(OwnedFiles::alone(file)),
        None => run.and_then(|run| scene_files(&run)).map_err(|cause| format!("{run_file:?}: {cause}")),
    };
    match files {
        Ok(files) => Ok(Ok(in_process::read_scene_files(&files.borrowed(), &settings)?.0)),
        Err(cause) => Ok(Err(cause)),
    }
}

/// A plan in the frame of a scene: they differ only where another file than the plan's own is given.
pub fn carried(plan: &Plan, scene: &Scene, settings: &Settings) -> Result<Plan, Failure> {
    let carried = quality::carried(plan, scene);
    let carried = carried.and_then(|plan| quality::check_reach(&plan, scene, settings.coverage.range_m).map(|()| plan));
    carried.map_err(|misplaced| Failure::File(misplaced.to_string().replace("--truth", "--scene")))
}

pub fn free_space(scene: &Scene, settings: &Settings) -> Result<FreeSpace, Failure> {
    Ok(FreeSpace::new(scene, &settings.flight).map_err(FieldError::from)?)
}
