//! The scene that a plan.json was made on, for what is flown and exported of it.

use std::path::{Path, PathBuf};

use super::evaluate::{read_as_before, read_run, run_file, scene_files};
use super::failure::Failure;
use super::in_process::{self, OwnedFiles};
use super::settings_file;
use crate::quality;
use crate::scene::Scene;
use crate::scene::free_space::FreeSpace;
use crate::session::FieldError;
use crate::settings::Settings;
use crate::trajectory::plan::{Plan, sight_scale};

/// The settings of a plan: those of the file that is given, else what the run.json beside the plan says that it was made with. A note where
/// it does not say so.
pub fn settings(config: Option<&PathBuf>, plan_file: &Path, plan: &Plan) -> Result<(Settings, Option<String>), Failure> {
    let sight_scale = sight_scale(&plan.cameras);
    if config.is_some() {
        let settings = settings_file::settings(config, None)?.with_sight(sight_scale);
        settings.check()?;
        return Ok((settings, None));
    }
    let run = read_run(&run_file(plan_file), plan).unwrap_or_default();
    let note = "what settings the plan was made with is not known, as for a plan of a daemon: safety distance, no-fly zones and all else are \
                the built-in ones; give others with `--config`";
    Ok((settings_file::as_in_run(&run, sight_scale), (!run["settings"].is_object()).then(|| note.to_owned())))
}

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
