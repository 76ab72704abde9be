//! `overfly evaluate`: the predicted quality of a plan on the scene that it was made for, or on any other.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::answer::{self, Answer, Form};
use super::arguments::{EvaluateArgs, ImageChoice};
use super::failure::Failure;
use super::in_process::OwnedFiles;
use super::interrupt::Interrupts;
use super::outputs::Folder;
use super::progress::Meter;
use super::{bounded_file, in_process, settings_file};
use crate::mission::quality_json::{self, Report};
use crate::mission::{plan_read, svg};
use crate::quality::{self, COMPLETENESS_M, Flown, Quality, Summary, Truth, Which};
use crate::session::FieldError;
use crate::settings::Settings;
use crate::stop::{Part, StopToken};
use crate::trajectory::plan::{Plan, sight_scale};

/// A larger file is no plan: a million images take half of it.
const MOST_BYTES: u64 = 512_000_000;

pub fn run(arguments: &EvaluateArgs, form: Form) -> Result<Answer, Failure> {
    let mut settings = settings_file::settings(arguments.config.as_ref(), None)?;
    settings.quality.samples = arguments.samples.unwrap_or(settings.quality.samples);
    let given = plan_read::read(&arguments.plan.to_string_lossy(), &read_plan_or_run(&arguments.plan)?)?;
    let settings = settings.with_sight(sight_scale(&given.cameras));
    settings.check()?;
    let run_file = run_file(&arguments.plan);
    let run = read_run(&run_file, &given);
    let truth_files = match &arguments.truth {
        Some(truth) => OwnedFiles::alone(truth),
        None => run.as_ref().map_err(String::clone).and_then(scene_files).map_err(|cause| Failure::UnknownScene {
            plan: arguments.plan.clone(),
            run: run_file,
            cause,
        })?,
    };
    let settings = match &run {
        // The scene is to be the one that the plan was made on.
        Ok(run) if arguments.truth.is_none() => read_as_before(settings, run),
        _ => settings,
    };
    let stop = StopToken::default();
    let stopper = stop.clone();
    let interrupts =
        Interrupts::announced(form, "stopping: nothing is written; Ctrl-C again ends at once", move || stopper.stop());
    let _folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let meter = Meter::new(form);
    let mut assessed = assess(&given, &truth_files, arguments.images.which(), &settings, &stop, meter)?;
    drop(interrupts);
    if let Ok(run) = &run
        && arguments.config.is_none()
        && run["settings"].as_object().is_some_and(|differing| differing.keys().any(|section| section != "proxy"))
    {
        assessed.notes.push(
            "the plan was made with other settings than the built-in ones used here (`settings` in its run.json); give them with `--config`"
                .to_owned(),
        );
    }
    let report = Report {
        plan: &assessed.plan,
        truth: &assessed.truth.scene().name,
        images: arguments.images.name(),
        summary: &assessed.summary,
        flown: &assessed.flown,
        settings: &settings.quality,
        notes: &assessed.notes,
    };
    let files = arguments.out.as_deref().map_or(Ok(Vec::new()), |folder| write(folder, &report, &assessed))?;
    assessed.notes.iter().for_each(|note| form.remark(&format!("note: {note}")));
    Ok(answer(&report, &files))
}

struct Assessed {
    /// In the truth's frame.
    plan: Plan,
    truth: Truth,
    quality: Quality,
    summary: Summary,
    flown: Flown,
    notes: Vec<String>,
}

fn assess(
    given: &Plan,
    truth_files: &OwnedFiles,
    which: Which,
    settings: &Settings,
    stop: &StopToken,
    mut meter: Meter,
) -> Result<Assessed, Failure> {
    meter.keep_moving();
    meter.begin(Part::Reading);
    let (scene, _) = in_process::read_scene_files(&truth_files.borrowed(), settings)?;
    let plan = quality::carried(given, &scene)?;
    quality::check_reach(&plan, &scene, settings.coverage.range_m)?;
    meter.begin(Part::Survey);
    let truth = Truth::new(scene, settings, stop).map_err(interrupted)?;
    let shots = quality::shots(&plan, which);
    meter.stage(&format!("casting the rays of {} images to {} samples", shots.len(), truth.samples().len()));
    let quality = quality::assess(&truth, &shots, settings, stop).ok_or(Failure::Interrupted)?;
    meter.stage("following the path");
    let (curve, behind): (Vec<_>, Vec<usize>) = plan.flown_points().into_iter().unzip();
    let flown = quality::flown(&truth, &curve, settings.flight.safety_distance_m);
    let flown = Flown { leg: behind.get(flown.leg).copied().unwrap_or(0), ..flown };
    let notes = notes(given, &truth, &flown, settings);
    Ok(Assessed { summary: quality.summary(), plan, truth, quality, flown, notes })
}

pub(super) fn interrupted(error: FieldError) -> Failure {
    if error == FieldError::Stopped { Failure::Interrupted } else { Failure::Field(error) }
}

/// What a reader of the figures has to know.
fn notes(given: &Plan, truth: &Truth, flown: &Flown, settings: &Settings) -> Vec<String> {
    let mut notes = Vec::new();
    let place = flown.nearest_m.map_or(String::new(), |p| format!(" near ({:.1}, {:.1}, {:.1})", p.x, p.y, p.z));
    let safety_m = settings.flight.safety_distance_m;
    if flown.collides {
        notes.push(format!("the path collides with this scene{place}, on the leg from waypoint {}", flown.leg));
    } else if flown.too_near {
        notes.push(format!(
            "the path comes within {:.2} m of this scene{place}, nearer than the safety distance of {safety_m} m",
            flown.clearance_m
        ));
    }
    match (given.scene.origin, truth.scene().frame.origin) {
        (None, None) => notes.push("plan and scene have no georeference: they are taken to share one frame".to_owned()),
        (Some(from), Some(to)) if (from.alt_m - to.alt_m).abs() > 0.01 => notes.push(format!(
            "the grounds of plan and scene lie {:.2} m apart in height by their origins ({:.2} m and {:.2} m); so does the path",
            (from.alt_m - to.alt_m).abs(),
            from.alt_m,
            to.alt_m
        )),
        _ => {}
    }
    notes
}

pub(super) fn read_plan_or_run(path: &Path) -> Result<Vec<u8>, Failure> {
    let remedy = "give the plan.json that `overfly plan --out DIR` has written";
    bounded_file::read(path, MOST_BYTES).map_err(|cause| Failure::Read { path: path.to_owned(), cause, remedy })
}

/// The `run.json` that stands beside a plan.
pub(super) fn run_file(plan_file: &Path) -> PathBuf {
    plan_file.with_file_name(match plan_file.file_stem().map(|stem| stem.to_string_lossy().into_owned()) {
        Some(stem) if stem != "plan" => format!("{stem}-run.json"),
        _ => "run.json".to_owned(),
    })
}

/// Its content, or why there is none that belongs to the plan.
pub(super) fn read_run(run_file: &Path, plan: &Plan) -> Result<Value, String> {
    let text = read_plan_or_run(run_file).map_err(|failure| match failure {
        Failure::Read { cause, .. } => cause.to_string(),
        other => other.to_string(),
    })?;
    let run: Value = serde_json::from_slice(&text).map_err(|error| error.to_string())?;
    let is_of_plan = run["scene"] == plan.scene.name && run["revision"] == plan.scene.revision;
    if is_of_plan { Ok(run) } else { Err("it belongs to another plan".to_owned()) }
}

/// The settings with what the plan's run says of how its scene file was read, where that can be understood.
pub(super) fn read_as_before(mut settings: Settings, run: &Value) -> Settings {
    let Ok(mut proxy) = serde_json::to_value(&settings.proxy) else { return settings };
    let differing = run["settings"]["proxy"].as_object().into_iter().flatten();
    differing.for_each(|(key, value)| proxy[key] = value.clone());
    let read = serde_json::from_value(proxy).map(|proxy| Settings { proxy, ..settings.clone() });
    if let Some(read) = read.ok().filter(|read| read.check().is_ok()) {
        settings = read;
    }
    settings
}

/// The scene file that it names, and the model of its ground where one was named.
pub(super) fn scene_files(run: &Value) -> Result<OwnedFiles, String> {
    let unnamed = || "it names no scene file, as for a scene that a daemon holds".to_owned();
    let there = |named: &str, what: &str| {
        let file = PathBuf::from(named);
        if file.is_file() { Ok(file) } else { Err(format!("its {what} {named:?} is gone")) }
    };
    let scene = there(run["scene_file"].as_str().ok_or_else(unnamed)?, "scene file")?;
    let ground = run["ground_file"].as_str().map(|named| there(named, "ground file")).transpose()?;
    Ok(OwnedFiles { scene, ground })
}

fn write(folder: &Path, report: &Report, assessed: &Assessed) -> Result<Vec<PathBuf>, Failure> {
    let drawing = svg::quality::to_bytes(&svg::quality::Drawn {
        plan: &assessed.plan,
        truth: &assessed.truth,
        quality: &assessed.quality,
        summary: &assessed.summary,
        flown: &assessed.flown,
        images: report.images,
    });
    let files = [("quality.json", quality_json::to_bytes(report)), ("quality.svg", drawing)];
    let put = |(name, bytes): (&str, Vec<u8>)| {
        let path = folder.join(name);
        fs::write(&path, bytes).map_err(|cause| Failure::write(&path, cause))?;
        Ok(path)
    };
    files.into_iter().map(put).collect()
}

fn answer(report: &Report, files: &[PathBuf]) -> Answer {
    let mut text = answer::table(&figures(report));
    for file in files {
        text.push_str(&format!("\nwrote {}", file.display()));
    }
    let mut object = quality_json::to_json(report);
    object["files"] = json!(files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>());
    Answer { text, json: object }
}

fn figures(report: &Report) -> Vec<Vec<String>> {
    let Report { summary, flown, .. } = report;
    let row = |label: &str, value: String| vec![label.to_owned(), value];
    let metres = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.4}"));
    let percent = |value: f64| format!("{value:.1}");
    let mut rows = vec![
        row("images", format!("{} ({})", summary.images, report.images)),
        row("samples of the truth", summary.samples.to_string()),
        row("exposed surface, m2", format!("{:.0}", summary.area_m2)),
        row("seen, %", percent(summary.seen_percent)),
        row("reconstructed, %", percent(summary.reconstructed_percent)),
        row("predicted Error 90 %, m", metres(summary.error_90_m)),
        row("predicted Error 95 %, m", metres(summary.error_95_m)),
    ];
    for (within_m, share) in COMPLETENESS_M.iter().zip(summary.completeness_percent) {
        rows.push(row(&format!("predicted Completeness {within_m:.3} m, %"), percent(share)));
    }
    let optional = |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
    rows.extend([
        row("median deviation along the normal, m", metres(summary.median_deviation_m)),
        row("median deviation over three axes, m", metres(summary.median_deviation_rms_m)),
        row("median views", format!("{:.0}", summary.median_views)),
        row("median largest parallax, degrees", optional(summary.median_parallax_deg, 1)),
        row("median best ground sampling distance, m", metres(summary.median_gsd_m)),
        row("mean r (K = 256), %", percent(summary.mean_r_percent)),
        row(&format!("r > {:.0} %, % of the surface", summary.threshold_percent), percent(summary.above_threshold_percent)),
        row("mean Smith reconstructability", format!("{:.1}", summary.mean_smith)),
        row(&format!("Smith > {:.0}, % of the surface", summary.smith_target), percent(summary.smith_above_target_percent)),
        row("least clearance to the truth, m", format!("{:.2}", flown.clearance_m)),
    ]);
    rows
}

impl ImageChoice {
    pub(super) fn which(self) -> Which {
        match self {
            Self::All => Which::All,
            Self::Selected => Which::Selected,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Selected => "selected",
        }
    }
}
