//! `overfly view`: one plan or two as a page, and the page in a browser.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::Point3;
use serde_json::{Value, json};

use super::answer::{Answer, Form};
use super::arguments::ViewArgs;
use super::evaluate::{interrupted, read_plan_or_run, read_run, run_file, scene_files};
use super::failure::Failure;
use super::in_process::{self, OwnedFiles};
use super::interrupt::Interrupts;
use super::pages::{self, Shown};
use super::progress::Meter;
use super::{browser, flown_scene, settings_file};
use crate::camera::Rig;
use crate::frame::LocalFrame;
use crate::mission::plan_read;
use crate::planner::{self, Method, PlanError, PlanOptions};
use crate::scene::anchor::Anchor;
use crate::scene::{ImportError, ImportReport, Scene};
use crate::session::{Session, Snapshot};
use crate::settings::Settings;
use crate::stop::{Part, StopToken};
use crate::trajectory::plan::{Plan, SceneStamp, sight_scale};

/// Shares of captured surface that differ by more than this are worth a word, percent.
const NOTICEABLE_PERCENT: f64 = 0.5;

const OTHER_SAMPLES: &str = "The two plans were made with other settings, or for cameras that see differently far, so that their surfaces have \
     other samples: it is not shown what only one of them captures.";

pub fn run(arguments: &ViewArgs, form: Form) -> Result<Answer, Failure> {
    let stop = StopToken::default();
    let stopper = stop.clone();
    let interrupts =
        Interrupts::announced(form, "stopping: nothing is written; Ctrl-C again ends at once", move || stopper.stop());
    let mut viewer = Viewer { arguments, stop, notes: Vec::new(), known: None, frame: None, meter: Meter::new(form) };
    let shown = viewer.all_shown()?;
    drop(interrupts);
    let Viewer { mut notes, .. } = viewer;
    let file = arguments.out.clone().unwrap_or_else(|| beside(&arguments.plan, arguments.other.as_deref()));
    let is_kept = arguments.out.is_none() && shown.iter().any(Shown::is_alone) && pages::shows_in_scene(&file, &shown);
    let mut text = if is_kept {
        notes = vec![format!(
            "the page that came with the plan is shown, {}; give `--scene` or `--out` for a new one",
            file.display()
        )];
        format!("{} is as it was", file.display())
    } else {
        fs::write(&file, pages::page_of(shown)).map_err(|cause| Failure::write(&file, cause))?;
        format!("wrote {}", file.display())
    };
    notes.iter().for_each(|note| form.remark(&format!("note: {note}")));
    let opened = if arguments.no_open { None } else { Some(open(&file)) };
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
    known: Option<Known>,
    /// What is shown is in one frame.
    frame: Option<LocalFrame>,
    meter: Meter,
}

/// The scene that was read first, with its field.
struct Known {
    files: OwnedFiles,
    session: Session,
    snapshot: Snapshot,
    anchor: Option<Anchor>,
}

/// Which samples a scene has.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Samples {
    Own,
    /// Those of the scene that was read before, but for what has changed.
    OfOther,
    /// Others than the scene that was read before, also where nothing has changed.
    Apart,
}

/// A plan with what stands beside it.
struct Given {
    label: String,
    plan: Plan,
    run: Value,
    files: Result<OwnedFiles, String>,
}

impl Viewer<'_> {
    /// One plan or two, in the order in which they were named.
    fn all_shown(&mut self) -> Result<Vec<Shown>, Failure> {
        let files = std::iter::once(&self.arguments.plan).chain(&self.arguments.other);
        let mut given = files.map(|file| self.given(file)).collect::<Result<Vec<_>, _>>()?;
        // A plan without a scene can be put into the frame of the other one.
        let is_turned = given[0].files.is_err();
        if is_turned {
            given.reverse();
        }
        let mut shown = given.into_iter().map(|given| self.shown(given)).collect::<Result<Vec<_>, _>>()?;
        if is_turned {
            shown.reverse();
        }
        Ok(shown)
    }

    fn given(&self, file: &Path) -> Result<Given, Failure> {
        let plan = plan_read::read(&file.to_string_lossy(), &read_plan_or_run(file)?)?;
        let run_file = run_file(file);
        let run = read_run(&run_file, &plan);
        let files = match &self.arguments.scene {
            Some(scene) => Ok(OwnedFiles::alone(scene)),
            None => run.as_ref().map_err(String::clone).and_then(scene_files),
        };
        let run = run.unwrap_or_default();
        let plan = Plan {
            goal_percent: run["goal_percent"].as_f64().unwrap_or(0.0),
            clearance_m: run["clearance_m"].as_f64().unwrap_or(0.0),
            ..plan
        };
        let files = files.map_err(|cause| format!("{}: {cause}", run_file.display()));
        Ok(Given { label: file.display().to_string(), plan, run, files })
    }

    fn shown(&mut self, given: Given) -> Result<Shown, Failure> {
        match &given.files {
            Ok(files) => self.in_scene(&given, files),
            Err(cause) => {
                let Given { label, plan, .. } = &given;
                self.notes.push(format!("{label} is shown without its scene ({cause}); give its scene file with `--scene`"));
                let frame = self.frame.get_or_insert(LocalFrame { origin: plan.scene.origin }).clone();
                let nothing = Scene { name: plan.scene.name.clone(), frame, structures: Vec::new(), zones: Vec::new() };
                let plan = flown_scene::carried(plan, &nothing, &Settings::default())?;
                Ok(Shown::alone(label, &plan))
            }
        }
    }

    fn in_scene(&mut self, given: &Given, files: &OwnedFiles) -> Result<Shown, Failure> {
        let Given { label, plan, run, .. } = given;
        let settings = match &self.arguments.config {
            Some(_) => settings_file::settings(self.arguments.config.as_ref(), None)?.with_sight(sight_scale(&plan.cameras)),
            None => settings_file::as_in_run(run, sight_scale(&plan.cameras)),
        };
        settings.check()?;
        let (snapshot, samples) = self.snapshot(files, &settings)?;
        let earlier_notes = self.notes.len();
        let options = self.options(given, &snapshot.scene.frame);
        let revision = plan.scene.revision;
        let plan = flown_scene::carried(plan, &snapshot.scene, &settings)?;
        // The scene of a file is a first revision, whatever edits a plan was made after.
        let plan = Plan { scene: SceneStamp { revision: snapshot.revision, ..plan.scene }, ..plan };
        self.meter.stage("casting the rays of the images");
        let (plan, sightings) = planner::look(&snapshot, &settings, &options, plan, &self.stop)
            .map_err(|error| if error == PlanError::Abandoned { Failure::Interrupted } else { Failure::Plan(error) })?;
        self.compare_coverage(label, &plan, snapshot.field().facts.threshold_cells, samples);
        let shown = Shown::in_scene(label, &snapshot, &settings, &plan, &sightings)?.of_revision(&plan.scene.name, revision);
        self.frame = Some(snapshot.scene.frame.clone());
        let apart = (samples == Samples::Apart).then_some(OTHER_SAMPLES);
        Ok(shown.noted(&self.notes[earlier_notes..]).apart(apart))
    }

    /// The field of a scene in the frame of the one that was read before.
    fn snapshot(&mut self, files: &OwnedFiles, settings: &Settings) -> Result<(Snapshot, Samples), Failure> {
        let is_same = |known: &&Known| known.files == *files && **known.session.settings() == *settings;
        if let Some(known) = self.known.as_ref().filter(is_same) {
            return Ok((known.snapshot.clone(), Samples::Own));
        }
        self.meter.keep_moving();
        self.meter.begin(Part::Reading);
        let (scene, report) = self.read(files, settings)?;
        let samples = match &self.known {
            None => Samples::Own,
            Some(known) if **known.session.settings() == *settings => Samples::OfOther,
            Some(_) => Samples::Apart,
        };
        let session = match &self.known {
            Some(known) if samples == Samples::OfOther => known.session.with_scene(scene, 1),
            _ => Session::new(scene, Arc::new(settings.clone()), &self.stop).map_err(interrupted)?,
        };
        let snapshot = in_process::field_of(&session, &self.stop, &mut self.meter).map_err(|failure| match failure {
            Failure::Field(error) => interrupted(error),
            other => other,
        })?;
        self.known.get_or_insert(Known { files: files.clone(), session, snapshot: snapshot.clone(), anchor: report.anchor });
        Ok((snapshot, samples))
    }

    /// A scene, in the frame of the one that was read before.
    fn read(&self, files: &OwnedFiles, settings: &Settings) -> Result<(Scene, ImportReport), Failure> {
        let Some(known) = &self.known else { return in_process::read_scene_files(&files.borrowed(), settings) };
        let refusal = |what: &str| {
            let file = files.scene.display();
            Failure::File(format!(
                "{file} cannot be put into the frame of the other plan's scene: {what}; give one scene for both plans with `--scene`"
            ))
        };
        if known.snapshot.scene.frame.origin.is_some() {
            let anchor = known.anchor.as_ref().ok_or_else(|| refusal("its file does not say where that lies"))?;
            return in_process::read_in_frame(&files.borrowed(), settings, Some(anchor), &self.stop).map_err(|failure| {
                match failure {
                    Failure::Import(ImportError::Anchor { what, .. }) => refusal(&what),
                    other => other,
                }
            });
        }
        // Without a georeference a plan's coordinates are those of its own scene's frame.
        let read = in_process::read_scene_files(&files.borrowed(), settings)?;
        let is_one_frame = read.0.frame == known.snapshot.scene.frame && read.1.anchor == known.anchor;
        if is_one_frame { Ok(read) } else { Err(refusal("they have no common georeference, and their origins differ")) }
    }

    /// What was ordered, as far as it decides on what counts as captured, in the frame of its scene.
    fn options(&mut self, given: &Given, to: &LocalFrame) -> PlanOptions {
        let Given { label, plan, run, .. } = given;
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
        let from = LocalFrame { origin: plan.scene.origin };
        let carried = |[x, y]: [f64; 2]| {
            let place = from.geodetic_from_local(&Point3::new(x, y, 0.0)).filter(|_| from != *to);
            place.and_then(|place| to.local_from_geodetic(&place)).map_or([x, y], |there| [there.x, there.y])
        };
        let region_m: Option<Vec<[f64; 2]>> = serde_json::from_value(order["region_m"].clone()).unwrap_or_default();
        let region_m = region_m.map(|corners| corners.into_iter().map(carried).collect());
        PlanOptions { gsd_m: order["gsd_m"].as_f64(), region_m, ..PlanOptions::new(rig, Method::Refined, plan.seed) }
    }

    fn compare_coverage(&mut self, label: &str, plan: &Plan, threshold_cells: u32, samples: Samples) {
        let capturable = (0..plan.cells.len()).filter(|&i| plan.is_capturable(i, threshold_cells));
        let (captured, all) = capturable
            .fold((0, 0), |(captured, all), i| (captured + u32::from(u32::from(plan.cells[i]) > threshold_cells), all + 1));
        let percent = 100.0 * f64::from(captured) / f64::from(all.max(1));
        let said = plan.metrics.coverage_percent;
        if all > 0 && (percent - said).abs() > NOTICEABLE_PERCENT {
            let why = match samples {
                Samples::OfOther => "it was made for samples of its own, and is shown on those of the plan beside it",
                _ => "it was made on another scene, with other settings, or after images that were taken before it",
            };
            self.notes.push(format!(
                "on this scene the images of {label} capture {percent:.1} % of what can be captured, where the plan says {said:.1} %: {why}"
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
