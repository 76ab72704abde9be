//! `overfly view`: one plan or two as a page, and the page in a browser.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Value, json};

use super::answer::{Answer, Form};
use super::arguments::ViewArgs;
use super::evaluate::{read_plan_or_run, read_run, run_file, scene_file};
use super::failure::Failure;
use super::in_process;
use super::interrupt::Interrupts;
use super::pages::Shown;
use super::progress::Meter;
use super::{browser, settings_file};
use crate::camera::Rig;
use crate::mission::plan_read;
use crate::planner::{self, Method, PlanError, PlanOptions};
use crate::quality;
use crate::session::{FieldError, Snapshot};
use crate::settings::Settings;
use crate::stop::StopToken;
use crate::trajectory::plan::{Plan, sight_scale};

/// Shares of captured surface that differ by more than this are worth a word, percent.
const NOTICEABLE_PERCENT: f64 = 0.5;

pub fn run(arguments: &ViewArgs, form: Form) -> Result<Answer, Failure> {
    let stop = StopToken::default();
    let stopper = stop.clone();
    let interrupts =
        Interrupts::announced(form, "stopping: nothing is written; Ctrl-C again ends at once", move || stopper.stop());
    let mut viewer = Viewer { arguments, stop, notes: Vec::new(), known: None, meter: Meter::new(form) };
    let shown = viewer.shown(&arguments.plan)?;
    let page = match &arguments.other {
        None => shown.page(),
        Some(other) => {
            let other = viewer.shown(other)?;
            shown.against(other)
        }
    };
    drop(interrupts);
    let Viewer { notes, .. } = viewer;
    let file = arguments.out.clone().unwrap_or_else(|| beside(&arguments.plan, arguments.other.as_deref()));
    fs::write(&file, page).map_err(|cause| Failure::write(&file, cause))?;
    notes.iter().for_each(|note| form.remark(&format!("note: {note}")));
    let opened = if arguments.no_open { None } else { Some(open(&file)) };
    let mut text = format!("wrote {}", file.display());
    match &opened {
        Some(Ok(())) => text.push_str("\nopened in the browser"),
        Some(Err(cause)) => {
            let path = std::path::absolute(&file).unwrap_or_else(|_| file.clone());
            text.push_str(&format!("\nno browser could be opened here ({cause}); open file://{} in one", path.display()));
        }
        None => {}
    }
    let json = json!({ "files": [file.display().to_string()], "opened": matches!(opened, Some(Ok(()))), "notes": notes });
    Ok(Answer { text, json })
}

/// Reads plans with their scenes.
struct Viewer<'a> {
    arguments: &'a ViewArgs,
    stop: StopToken,
    notes: Vec<String>,
    /// The field that was built last: two plans of one scene need one.
    known: Option<(PathBuf, Settings, Snapshot)>,
    meter: Meter,
}

impl Viewer<'_> {
    fn shown(&mut self, file: &Path) -> Result<Shown, Failure> {
        let plan = plan_read::read(&file.to_string_lossy(), &read_plan_or_run(file)?)?;
        let label = file.display().to_string();
        let run_file = run_file(file);
        let run = read_run(&run_file, &plan);
        let scene_file = match &self.arguments.scene {
            Some(scene) => Ok(scene.clone()),
            None => run.as_ref().map_err(String::clone).and_then(scene_file),
        };
        let run = run.unwrap_or_default();
        let plan = Plan {
            goal_percent: run["goal_percent"].as_f64().unwrap_or(0.0),
            clearance_m: run["clearance_m"].as_f64().unwrap_or(0.0),
            ..plan
        };
        match scene_file {
            Ok(scene_file) => self.in_scene(&label, plan, &run, &scene_file),
            Err(cause) => {
                self.notes.push(format!(
                    "{label} is shown without its scene ({}: {cause}); give its scene file with `--scene`",
                    run_file.display()
                ));
                Ok(Shown::alone(&label, &plan))
            }
        }
    }

    fn in_scene(&mut self, label: &str, plan: Plan, run: &Value, scene_file: &Path) -> Result<Shown, Failure> {
        let settings = match &self.arguments.config {
            Some(_) => settings_file::settings(self.arguments.config.as_ref(), None)?.with_sight(sight_scale(&plan.cameras)),
            None => settings_file::as_in_run(run, sight_scale(&plan.cameras)),
        };
        settings.check()?;
        let snapshot = self.snapshot(scene_file, &settings)?;
        let plan = quality::carried(&plan, &snapshot.scene);
        let plan = plan.and_then(|plan| quality::check_reach(&plan, &snapshot.scene, settings.coverage.range_m).map(|()| plan));
        let plan = plan.map_err(|misplaced| Failure::File(misplaced.to_string().replace("--truth", "--scene")))?;
        self.meter.stage("casting the rays of the images");
        let (plan, sightings) = planner::look(&snapshot, &settings, &self.options(label, &plan, run), plan, &self.stop)
            .map_err(|error| if error == PlanError::Abandoned { Failure::Interrupted } else { Failure::Plan(error) })?;
        self.compare_coverage(label, &plan, snapshot.field().facts.threshold_cells);
        Ok(Shown::in_scene(label, &snapshot, &settings, &plan, &sightings)?)
    }

    fn snapshot(&mut self, scene_file: &Path, settings: &Settings) -> Result<Snapshot, Failure> {
        if let Some((_, _, snapshot)) = self.known.as_ref().filter(|known| known.0 == scene_file && known.1 == *settings) {
            return Ok(snapshot.clone());
        }
        self.meter.keep_moving();
        self.meter.stage("reading the scene");
        let (scene, _) = in_process::read_scene(scene_file, settings)?;
        let snapshot = in_process::build_field(scene, &Arc::new(settings.clone()), &self.stop, &mut self.meter);
        let snapshot = snapshot.map_err(|failure| match failure {
            Failure::Field(FieldError::Stopped) => Failure::Interrupted,
            other => other,
        })?;
        self.known = Some((scene_file.to_owned(), settings.clone(), snapshot.clone()));
        Ok(snapshot)
    }

    /// What was ordered, as far as it decides on what counts as captured.
    fn options(&mut self, label: &str, plan: &Plan, run: &Value) -> PlanOptions {
        let order = &run["order"];
        let rig = match order["rig_file"].as_str() {
            Some(text) => Rig::parse(text).ok(),
            None => Rig::preset(&plan.rig).ok(),
        };
        let rig = rig.unwrap_or_else(|| {
            self.notes.push(format!(
                "the file of the rig {:?} does not stand in the run.json beside {label}: what lies out of its reach is that of a panoramic rig",
                plan.rig
            ));
            Rig::preset("panoramic").expect("a preset")
        });
        let region_m = serde_json::from_value(order["region_m"].clone()).unwrap_or_default();
        PlanOptions { gsd_m: order["gsd_m"].as_f64(), region_m, ..PlanOptions::new(rig, Method::Refined, plan.seed) }
    }

    fn compare_coverage(&mut self, label: &str, plan: &Plan, threshold_cells: u32) {
        let capturable = (0..plan.cells.len()).filter(|&i| plan.is_capturable(i, threshold_cells));
        let (captured, all) = capturable
            .fold((0, 0), |(captured, all), i| (captured + u32::from(u32::from(plan.cells[i]) > threshold_cells), all + 1));
        let percent = 100.0 * f64::from(captured) / f64::from(all.max(1));
        let said = plan.metrics.coverage_percent;
        if all > 0 && (percent - said).abs() > NOTICEABLE_PERCENT {
            self.notes.push(format!(
                "on this scene the images of {label} capture {percent:.1} % of what can be captured, where the plan says {said:.1} %: it was made on another scene, with \
                 other settings, or after images that were taken before it"
            ));
        }
    }
}

/// `plan.html` beside `plan.json`; of two plans `a-vs-b.html`, with the folder's name where both are called the same.
fn beside(plan: &Path, other: Option<&Path>) -> PathBuf {
    let stem = |path: &Path| path.file_stem().map_or_else(|| "plan".to_owned(), |stem| stem.to_string_lossy().into_owned());
    let Some(other) = other else { return plan.with_file_name(format!("{}.html", stem(plan))) };
    let folder = |path: &Path| {
        let folder = std::path::absolute(path).ok().and_then(|path| path.parent()?.file_name().map(ToOwned::to_owned));
        folder.map_or_else(|| stem(path), |folder| folder.to_string_lossy().into_owned())
    };
    let (a, b) = if stem(plan) == stem(other) { (stem(plan), folder(other)) } else { (stem(plan), stem(other)) };
    plan.with_file_name(format!("{a}-vs-{b}.html"))
}

/// Opens a file with the program that the desktop has for pages.
fn open(file: &Path) -> Result<(), String> {
    let path = std::path::absolute(file).map_err(|cause| cause.to_string())?;
    browser::open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_stands_beside_its_plan() {
        let named = |plan: &str, other: Option<&str>| beside(Path::new(plan), other.map(Path::new)).display().to_string();
        assert_eq!(named("flights/plan.json", None), "flights/plan.html");
        assert_eq!(named("flights/replan.json", Some("flights/plan.json")), "flights/replan-vs-plan.html");
        assert_eq!(named("a/plan.json", Some("/flights/b/plan.json")), "a/plan-vs-b.html");
    }
}
