//! `overfly reproduce`: the paper's tables and figures, computed anew and kept in a folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};

use super::answer::{Answer, Form};
use super::arguments::ReproduceArgs;
use super::failure::Failure;
use super::import_lines::counted;
use super::interrupt::Interrupts;
use super::machine::this_machine;
use super::outputs::Folder;
use super::progress::Meter;
use super::{in_process, settings_file};
use crate::planner::StopToken;
use crate::reproduction::{self, Effort, Order, Part, Reproduction, Site, Table, Watch, json as tables_json, markdown};
use crate::scene::Scene;
use crate::settings::Settings;

/// How the files are called; charts have names of their own.
const MARKDOWN: &str = "reproduction.md";
const JSON: &str = "reproduction.json";

pub fn run(arguments: &ReproduceArgs, form: Form) -> Result<Answer, Failure> {
    let order = order(arguments)?;
    let _folder = Folder::prepare(&arguments.out)?;
    let RealScenes { found: scenes, missing } = real_scenes(&arguments.scenes, &order.settings)?;
    let started = Instant::now();
    let mut meter = Meter::new(form);
    let stop = StopToken::default();
    let stopper = stop.clone();
    let interrupts = Interrupts::announced(
        form,
        "stopping: only rows of unfinished tables are kept (*.partial.json); Ctrl-C again ends at once",
        move || stopper.abandon(),
    );
    let is_terminal = form.shows_progress();
    let mut on_step = |step: &str| {
        // A terminal shows the step at work; a log keeps them all.
        if is_terminal { meter.stage(step) } else { form.remark(&format!("{:7.1} s  {step}", started.elapsed().as_secs_f64())) }
    };
    let mut on_row = |table: &Table| keep(&arguments.out, table, form);
    let watch = Watch {
        stop: &stop,
        on_step: &mut on_step,
        on_row: &mut on_row,
        clock: Arc::new(move || started.elapsed().as_secs_f64()),
    };
    let found = reproduction::reproduce(&order, scenes, watch)?;
    drop(interrupts);
    drop(meter);

    let run = Run { command: command(arguments), order, missing, total_s: started.elapsed().as_secs_f64() };
    let files = write(&arguments.out, &found, &run)?;
    let tables = counted(found.tables.len() + found.times.len(), "table");
    let text = format!("{}\n{tables} in {:.0} s; wrote {}", whole_text(&found, &run), run.total_s, listed(&files));
    let json = json!({ "tables": found.tables.len() + found.times.len(), "total_s": run.total_s, "missing_scenes": run.missing, "files": files });
    Ok(Answer { text, json })
}

/// What the files say beside the tables.
struct Run {
    command: String,
    order: Order,
    missing: Vec<String>,
    total_s: f64,
}

fn order(arguments: &ReproduceArgs) -> Result<Order, Failure> {
    let parts = arguments.only.iter().map(|name| Part::parse(name.trim())).collect::<Result<Vec<_>, _>>()?;
    let parts = if parts.is_empty() { Part::of_the_paper() } else { parts };
    let effort = if arguments.quick { Effort::Quick } else { Effort::Full };
    let settings = settings_file::settings(arguments.config.as_ref(), None)?;
    let seeds = if arguments.quick { 1 } else { arguments.seeds };
    Ok(Order { parts, seeds, effort, settings })
}

/// The real scenes that a folder holds, and the files that it does not.
#[derive(Default)]
struct RealScenes {
    found: Vec<(Site, Scene)>,
    missing: Vec<String>,
}

fn real_scenes(folder: &Path, settings: &Settings) -> Result<RealScenes, Failure> {
    let mut scenes = RealScenes::default();
    for site in Site::REAL {
        let Some(file) = site.file() else { continue };
        let path = folder.join(file);
        if path.is_file() {
            scenes.found.push((site, in_process::read_scene(&path, settings)?.0));
        } else {
            scenes.missing.push(file.to_owned());
        }
    }
    Ok(scenes)
}

/// The command that makes these files again; where scenes and results lie is the reader's own affair.
fn command(arguments: &ReproduceArgs) -> String {
    let mut words = vec!["overfly reproduce".to_owned()];
    if !arguments.only.is_empty() {
        words.push(format!("--only {}", arguments.only.join(",")));
    }
    words.push(if arguments.quick { "--quick".to_owned() } else { format!("--seeds {}", arguments.seeds) });
    words.extend(["--scenes SCENES", "--out DIR"].map(str::to_owned));
    if arguments.config.is_some() {
        words.push("--config FILE".to_owned());
    }
    words.join(" ")
}

/// Keeps a table that is not yet whole beside the results: some take hours, and an interrupted run shall not lose them.
fn keep(folder: &Path, table: &Table, form: Form) {
    let path = partial(folder, table);
    if let Err(cause) = fs::write(&path, format!("{:#}\n", tables_json::table(table))) {
        form.remark(&format!("{}: not kept so far: {cause}", path.display()));
    }
}

fn partial(folder: &Path, table: &Table) -> PathBuf {
    folder.join(format!("{}.partial.json", table.key))
}

fn write(folder: &Path, found: &Reproduction, run: &Run) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    let mut put = |name: &str, content: String| {
        let path = folder.join(name);
        fs::write(&path, content).map_err(|cause| Failure::write(&path, cause))?;
        files.push(path);
        Ok::<(), Failure>(())
    };
    put(MARKDOWN, whole_text(found, run))?;
    let json = serde_json::to_string_pretty(&whole_json(found, run)).map_err(|cause| Failure::Unexpected(cause.to_string()))?;
    put(JSON, json + "\n")?;
    found.drawings.iter().try_for_each(|drawing| put(&drawing.file, drawing.svg.clone()))?;
    // The whole tables are there now.
    for table in &found.tables {
        let _ = fs::remove_file(partial(folder, table));
    }
    Ok(files)
}

fn whole_text(found: &Reproduction, run: &Run) -> String {
    let mut text = format!("# The paper's tables and figures, reproduced\n\nMade by `{}`.", run.command);
    if run.order.effort == Effort::Quick {
        text.push_str(" A quick run: small sizes and one seed, so that its figures say nothing.");
    }
    if !run.missing.is_empty() {
        text.push_str(&format!(" Scenes that were missing: {}.", run.missing.join(", ")));
    }
    text.push_str("\n\n");
    found.tables.iter().for_each(|table| text.push_str(&markdown::table(table, 2)));
    let machine = this_machine();
    text.push_str("## Machine and times\n\n");
    let total_s = run.total_s;
    text.push_str(&format!(
        "{}, {}, {}; {total_s:.0} s in all.\n\n",
        machine.processor,
        counted(machine.cores, "core"),
        machine.platform
    ));
    found.times.iter().for_each(|table| text.push_str(&markdown::table(table, 3)));
    text.trim_end().to_owned() + "\n"
}

/// Everything but `machine` and `times` is the same on every run.
fn whole_json(found: &Reproduction, run: &Run) -> Value {
    let tables: Vec<Value> = found.tables.iter().map(tables_json::table).collect();
    let times: Vec<Value> = found.times.iter().map(tables_json::table).collect();
    json!({
        "format": "overfly-reproduction/1",
        "command": run.command,
        "parts": run.order.parts.iter().map(|part| part.name()).collect::<Vec<_>>(),
        "seeds": run.order.seeds,
        "quick": run.order.effort == Effort::Quick,
        "missing_scenes": run.missing,
        "settings": settings_file::differing(&run.order.settings),
        "tables": tables,
        "machine": this_machine(),
        "times": { "tables": times, "total_s": run.total_s },
    })
}

fn listed(files: &[PathBuf]) -> String {
    files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
}
