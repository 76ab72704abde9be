//! `overfly plan`: a scene file in process, or a loaded scene by the daemon.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use overfly_client::ReadOrder;
use serde_json::{Value, json};

use super::answer::{self, Answer, Form};
use super::arguments::{OrderArgs, PlanArgs};
use super::failure::Failure;
use super::in_process::{OnFirst, Planned};
use super::interrupt::Interrupts;
use super::outputs::{self, FileNames, Flight, Folder, Scenery};
use super::progress::Meter;
use super::rig_file::GivenRig;
use super::shortfall::{self, Heights};
use super::{daemon, import_lines, in_process, rig_file, settings_file};
use crate::mission::run_json::Engine;
use crate::planner::{self, Objective, PlanOptions, StopToken};
use crate::scene::ENDINGS;
use crate::settings::Settings;
use crate::trajectory::plan::{Plan, StopReason};

pub fn run(arguments: &PlanArgs, form: Form) -> Result<Answer, Failure> {
    let given = rig_file::read(&arguments.order.rig)?;
    let options = in_process::options(&arguments.order, &given.rig)?;
    let options = arguments.en_route.complete(&arguments.order, options)?;
    let scene = &arguments.scene;
    if Path::new(scene).is_file() || looks_like_path(scene) {
        plan_file(arguments, &given, &options, form)
    } else {
        plan_loaded(arguments, &given, form)
    }
}

/// A mistyped path must not be looked up among the loaded scenes.
fn looks_like_path(scene: &str) -> bool {
    let lower = scene.to_lowercase();
    scene.contains('/') || ENDINGS.iter().any(|ending| lower.ends_with(ending))
}

fn plan_file(arguments: &PlanArgs, given: &GivenRig, options: &PlanOptions, form: Form) -> Result<Answer, Failure> {
    let settings = settings_file::reading(arguments.config.as_ref(), Some(&arguments.sizes), &arguments.read)?;
    let settings = Arc::new(settings.clone().with_sight(planner::flown_rig(options, &settings).sight_scale()));
    settings.check()?;
    let _folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let mut meter = Meter::with_budget(form, arguments.order.budget);
    let begun = Instant::now();
    let stop = StopToken::timed(move || begun.elapsed().as_secs_f64());
    let stopper = stop.clone();
    let interrupts = Interrupts::first(form, move || stopper.stop());
    let flown = arguments.en_route.read_flown()?;
    let files = in_process::SceneFiles { scene: Path::new(&arguments.scene), ground: arguments.read.dtm.as_deref() };
    let names = FileNames::of_plan();
    let write = |folder: &PathBuf, planned: &Planned| {
        outputs::write(folder, &names, &flight_of(arguments, given, &settings, planned), &Scenery::Planned(planned, &settings))
    };
    let mut on_first = arguments.out.as_ref().map(|folder| {
        |planned: &Planned, meter: &Meter| {
            write(folder, planned)?;
            meter.say(form, &first_look(planned, &folder.join(&names.page)));
            Ok(())
        }
    });
    let on_first = on_first.as_mut().map(|on_first| on_first as OnFirst);
    let planned = in_process::plan_file(&files, &settings, options, flown.as_ref(), &stop, &mut meter, on_first)?;
    drop(interrupts);
    let asked = meter.asked().filter(|_| !planned.is_first);
    drop(meter);
    for line in import_lines::lines(&planned.report, settings.flight.no_fly.len()) {
        form.remark(&format!("scene: {line}"));
    }
    let written = match &arguments.out {
        Some(folder) => write(folder, &planned)?,
        None => Vec::new(),
    };
    remark_departure(&planned.plan, form);
    remark_cruise(&arguments.order, &planned.plan, Some(settings.flight.cruise_speed_mps), form);
    let heights = Heights::of(&planned.snapshot.field(), Some(settings.flight.legal_ceiling_m));
    let flight = flight_of(arguments, given, &settings, &planned);
    remark_shortfall(&flight, &again(arguments), Some(&heights), has_goal(arguments), form);
    Ok(answer(&flight, &written, asked))
}

/// What there is to see while a better flight is searched.
fn first_look(planned: &Planned, page: &Path) -> String {
    let Plan { metrics, .. } = &planned.plan;
    format!(
        "a first look after {:.1} s: {:.1} % of capturable on {:.0} m in {:.0} s, see {}; the search goes on, Ctrl-C ends it with the best plan so far",
        planned.times.total_s,
        metrics.coverage_percent,
        metrics.length_m,
        metrics.profile_s,
        page.display()
    )
}

/// A plan of a scene file with all that its files tell.
fn flight_of<'p>(arguments: &PlanArgs, given: &GivenRig, settings: &Settings, planned: &'p Planned) -> Flight<'p> {
    Flight {
        plan: &planned.plan,
        times: planned.times,
        engine: Engine::InProcess,
        edit_to_plan_s: None,
        import: serde_json::to_value(&planned.report).ok(),
        order: Some(order_json(arguments, given)),
        settings: settings_file::differing(settings),
        scene_file: std::path::absolute(&arguments.scene).ok().map(|path| path.to_string_lossy().into_owned()),
        ground_file: arguments
            .read
            .dtm
            .as_ref()
            .and_then(|path| std::path::absolute(path).ok())
            .map(|path| path.to_string_lossy().into_owned()),
        terrain: planned.snapshot.free.terrain().map(|terrain| Arc::new(terrain.clone())),
    }
}

fn plan_loaded(arguments: &PlanArgs, given: &GivenRig, form: Form) -> Result<Answer, Failure> {
    refuse_file_options(arguments)?;
    let domain = arguments.reach.domain.clone();
    let client = daemon::connect(domain.as_deref()).map_err(|failure| neither(&arguments.scene, failure))?;
    let _folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let mut meter = Meter::with_budget(form, arguments.order.budget);
    let scene = arguments.scene.clone();
    let interrupts = Interrupts::first(form, move || daemon::cancel(domain.as_deref(), &scene));
    let mut order = daemon::order(&arguments.order, given);
    order.en_route = arguments.en_route.report(&arguments.order);
    if order.en_route.is_some() {
        order.start_view_deg = None;
    }
    let message = client.plan(&arguments.scene, &order, &mut |note| meter.note(note))?;
    drop(interrupts);
    let asked = arguments.order.iterations.or(meter.asked());
    drop(meter);
    let (plan, times) = daemon::plan_of(&message)?;
    let flight = Flight { order: Some(order_json(arguments, given)), ..daemon::flight(&plan, times, None, None) };
    let mut files = Vec::new();
    if let Some(folder) = &arguments.out {
        let (written, remark) = daemon::write(&client, folder, &FileNames::of_plan(), &flight)?;
        files = written;
        remark.into_iter().for_each(|remark| form.remark(remark));
    }
    remark_departure(&plan, form);
    remark_cruise(&arguments.order, &plan, None, form);
    remark_shortfall(&flight, &again(arguments), daemon::heights(&client, &plan).as_ref(), has_goal(arguments), form);
    Ok(answer(&flight, &files, asked))
}

/// The command for another plan in the same way, as it is typed, without iterations and folder.
fn again(arguments: &PlanArgs) -> String {
    let PlanArgs { order, sizes, .. } = arguments;
    let typed = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let options = [
        ("method", (order.method != "refined").then(|| order.method.clone())),
        ("seed", (order.seed != 1).then(|| order.seed.to_string())),
        ("start", order.start.map(|start| typed(&start.0))),
        ("coverage", order.coverage.map(|percent| percent.to_string())),
        ("gsd", order.gsd.map(|gsd_m| gsd_m.to_string())),
        ("overlap", order.overlap.map(|percent| percent.to_string())),
        ("region", order.region.as_ref().map(|region| format!("\"{region}\""))),
        ("look", order.look.map(|look| typed(&look.0))),
        ("config", arguments.config.as_ref().map(|path| path.display().to_string())),
        ("dtm", arguments.read.dtm.as_ref().map(|path| path.display().to_string())),
        ("samples", sizes.samples.map(|samples| samples.to_string())),
        ("viewpoints", sizes.viewpoints.map(|viewpoints| viewpoints.to_string())),
    ];
    let given = options.into_iter().filter_map(|(option, value)| Some(format!(" --{option} {}", value?)));
    command(&arguments.scene, &order.rig) + &given.collect::<String>()
}

/// The command for another plan of the same scene with the same rig, as it is typed.
pub fn command(scene: &str, rig: &str) -> String {
    let rig = if rig == "panoramic" { String::new() } else { format!(" --rig {rig}") };
    format!("overfly plan {scene}{rig}")
}

/// What a command answers that ends with one plan; `asked` are the iterations that the search was to make, where they are known.
pub fn answer(flight: &Flight, files: &[std::path::PathBuf], asked: Option<u32>) -> Answer {
    let mut rows = outputs::figures(flight.plan, &flight.times);
    if let Some(edit_to_plan_s) = flight.edit_to_plan_s {
        rows.push(vec!["edit to plan, s".to_owned(), format!("{edit_to_plan_s:.3}")]);
    }
    let mut text = answer::table(&rows);
    if flight.plan.stop == StopReason::Cancelled {
        let of = asked.map_or(String::new(), |asked| format!(" of {asked}"));
        let after = match flight.plan.convergence.len() {
            0 if !matches!(flight.plan.method.as_str(), "paper" | "refined") => "early".to_owned(),
            done => format!("after {done}{of} iterations"),
        };
        text.push_str(&format!("\nstopped {after}: this is the best plan so far"));
    }
    for file in files {
        text.push_str(&format!("\nwrote {}", file.display()));
    }
    Answer { text, json: outputs::figures_json(flight, files) }
}

/// Whether a coverage was asked for, and not the most within a time or of the objective.
fn has_goal(arguments: &PlanArgs) -> bool {
    arguments.order.max_time.is_none() && arguments.order.objective == Objective::Time.name()
}

/// Says what a plan lacks, if anything; one that was asked for no coverage lacks none.
pub fn remark_shortfall(flight: &Flight, command: &str, heights: Option<&Heights>, has_goal: bool, form: Form) {
    if let Some(note) = shortfall::note(flight.plan, command, heights, has_goal) {
        form.remark(&note);
    }
}

/// Says how fast a flight with an overlap cruises; `set_mps` is the speed of the settings, where they are known.
fn remark_cruise(order: &OrderArgs, plan: &Plan, set_mps: Option<f64>, form: Form) {
    let Some((percent, limits)) = order.overlap.zip(plan.limits) else { return };
    let cruise_mps = limits.cruise_mps;
    let instead = match set_mps {
        Some(set_mps) if set_mps > cruise_mps => {
            format!(" instead of {set_mps} m/s (`flight.cruise_speed_mps`), because the shutter needs the time")
        }
        _ => String::new(),
    };
    form.remark(&format!("note: with an overlap of {percent} % the flight cruises at {cruise_mps:.2} m/s{instead}"));
}

fn order_json(arguments: &PlanArgs, given: &GivenRig) -> Value {
    let order = &arguments.order;
    let mut json = json!({
        "rig": order.rig,
        "rig_file": given.text,
        "method": order.method,
        "seed": order.seed,
        "iterations": order.iterations,
        "budget_s": order.budget,
        "goal_percent": order.coverage,
        "matched_percent": order.matched,
        "objective": order.objective,
        "within_s": order.max_time,
        "gsd_m": order.gsd,
        "overlap_percent": order.overlap,
        "region_m": order.region.as_ref().map(|region| &region.0),
        "start_m": order.start.map(|start| start.0),
        "start_view_deg": order.look.map(|look| look.0),
    });
    if arguments.en_route.pose.is_some() {
        json["en_route"] = arguments.en_route.json();
    }
    json
}

/// Says how a flight begins that begins otherwise than others.
fn remark_departure(plan: &Plan, form: Form) {
    if let Some(remark) = planner::en_route::remark(plan) {
        form.remark(&format!("note: {remark}"));
    }
}

fn refuse_file_options(arguments: &PlanArgs) -> Result<(), Failure> {
    let given = [
        ("--config", arguments.config.is_some()),
        ("--dtm", arguments.read.dtm.is_some()),
        ("--samples", arguments.sizes.samples.is_some()),
        ("--viewpoints", arguments.sizes.viewpoints.is_some()),
        ("--flown", arguments.en_route.flown.is_some()),
        ("what says how a file is read", arguments.read.order() != ReadOrder::default()),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some(("--flown", _)) => Err(Failure::Usage(
            "--flown is for a scene file; for a loaded scene the daemon knows the plan that it published last".into(),
        )),
        Some(("--dtm", _)) => Err(Failure::Usage(format!(
            "there is no file {:?}, and --dtm needs one; a loaded scene has its ground from `overfly load FILE --dtm FILE`",
            arguments.scene
        ))),
        Some((option, _)) => Err(Failure::Usage(format!(
            "there is no file {:?}, and {option} needs one: the settings of a loaded scene are the daemon's (`overfly serve --config FILE`, `overfly load FILE --help`)",
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
