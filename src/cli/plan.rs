//! `overfly plan`: a scene file in process, or a loaded scene by the daemon.

use std::path::Path;

use super::answer::{self, Answer, Form};
use super::arguments::PlanArgs;
use super::failure::Failure;
use super::outputs::{self, FileNames, Flight};
use super::progress::Meter;
use super::{daemon, in_process, settings_file};
use crate::mission::run_json::Engine;

pub fn run(arguments: &PlanArgs, form: Form) -> Result<Answer, Failure> {
    let scene = &arguments.scene;
    if Path::new(scene).is_file() || looks_like_path(scene) { plan_file(arguments, form) } else { plan_loaded(arguments, form) }
}

/// A mistyped path must not be looked up among the loaded scenes.
fn looks_like_path(scene: &str) -> bool {
    let lower = scene.to_lowercase();
    scene.contains('/') || [".geojson", ".json", ".obj"].iter().any(|ending| lower.ends_with(ending))
}

fn plan_file(arguments: &PlanArgs, form: Form) -> Result<Answer, Failure> {
    let settings = settings_file::settings(arguments.config.as_ref(), Some(&arguments.sizes))?;
    let mut meter = Meter::new(form);
    let planned = in_process::plan_file(Path::new(&arguments.scene), settings, &arguments.order, &mut meter)?;
    drop(meter);
    for line in planned.report.summary().lines() {
        form.remark(&format!("scene: {line}"));
    }
    let import = serde_json::to_value(&planned.report).ok();
    let flight = Flight { plan: &planned.plan, times: planned.times, engine: Engine::InProcess, edit_to_plan_s: None, import };
    let files = match &arguments.out {
        Some(folder) => outputs::write(folder, &FileNames::of_plan(), &flight, Some(&planned.snapshot.field()))?,
        None => Vec::new(),
    };
    Ok(answer(&flight, &files, form))
}

fn plan_loaded(arguments: &PlanArgs, form: Form) -> Result<Answer, Failure> {
    refuse_file_options(arguments)?;
    let client = daemon::connect(arguments.reach.domain.as_deref()).map_err(|failure| neither(&arguments.scene, failure))?;
    let mut meter = Meter::new(form);
    let message = client.plan(&arguments.scene, &daemon::order(&arguments.order), &mut |note| meter.note(note))?;
    drop(meter);
    let (plan, times) = daemon::plan_of(&message)?;
    let flight = daemon::flight(&plan, times, None, None);
    let mut files = Vec::new();
    if let Some(folder) = &arguments.out {
        let (written, remark) = daemon::write(&client, folder, &FileNames::of_plan(), &flight)?;
        files = written;
        remark.into_iter().for_each(|remark| form.remark(remark));
    }
    Ok(answer(&flight, &files, form))
}

/// What a command answers that ends with one plan.
pub fn answer(flight: &Flight, files: &[std::path::PathBuf], form: Form) -> Answer {
    if let Some(note) = outputs::shortfall(flight.plan) {
        form.remark(&note);
    }
    let mut rows = outputs::figures(flight.plan, &flight.times);
    if let Some(edit_to_plan_s) = flight.edit_to_plan_s {
        rows.push(vec!["edit to plan, s".to_owned(), format!("{edit_to_plan_s:.3}")]);
    }
    let mut text = answer::table(&rows);
    for file in files {
        text.push_str(&format!("\nwrote {}", file.display()));
    }
    Answer { text, json: outputs::figures_json(flight, files) }
}

fn refuse_file_options(arguments: &PlanArgs) -> Result<(), Failure> {
    let given = [
        ("--config", arguments.config.is_some()),
        ("--samples", arguments.sizes.samples.is_some()),
        ("--viewpoints", arguments.sizes.viewpoints.is_some()),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some((option, _)) => Err(Failure::Usage(format!(
            "there is no file {:?}, and {option} needs one: the settings of a loaded scene are the daemon's (`overfly serve --config FILE`)",
            arguments.scene
        ))),
    }
}

/// Without a daemon the likely mistake is the file's path.
fn neither(scene: &str, failure: Failure) -> Failure {
    if !daemon::is_absent(&failure) {
        return failure;
    }
    Failure::NoSuchScene { scene: scene.to_owned(), cause: failure.to_string() }
}
