//! `overfly demo`: the whole thing on a generated block, through a daemon and the client library.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use overfly_client::{Client, Domain, EditOrder, Loaded, PlanOrder, SceneSource};
use serde_json::{Value, json};

use super::answer::{self, Answer, Form};
use super::arguments::DemoArgs;
use super::demo_flight::{self, Flown};
use super::failure::Failure;
use super::outputs::{self, FileNames, Flight, Folder};
use super::pages::{self, Shown};
use super::private_daemon::PrivateDaemon;
use super::progress::Meter;
use super::received::{self, Made};
use super::{daemon, load, plan};
use crate::scene::{self, BlockSettings, Scene};
use crate::trajectory::plan::{Plan, RunTimes};

/// Rounds of the refinement: as few as a show has patience for, and enough that its plan reaches the goal (24 are not: 94.8 %).
const ROUNDS: u32 = 40;

/// How much taller one building becomes.
const RAISE_M: f64 = 15.0;

pub fn run(arguments: &DemoArgs, form: Form) -> Result<Answer, Failure> {
    let folder = &arguments.out;
    let _folder = Folder::prepare(folder)?;
    let scene = scene::generate_block(&BlockSettings { seed: arguments.seed, ..Default::default() });
    let geojson = scene::to_geojson(&scene);
    let scene_file = folder.join("scene.geojson");
    fs::write(&scene_file, &geojson).map_err(|cause| Failure::write(&scene_file, cause))?;
    form.remark(&format!("a block of {} structures, seed {}", scene.structures.len(), arguments.seed));

    let log_file = folder.join("daemon.log");
    let log = File::create(&log_file).map_err(|cause| Failure::write(&log_file, cause))?;
    let mut daemon = PrivateDaemon::start("demo", None, Some(log))?;
    let client = daemon.connect()?;
    let show = fly(&client, daemon.domain(), folder, &scene, geojson, arguments.seed, form)?;
    daemon.stop(client)?;

    let files = [vec![scene_file, log_file], show.files.clone()].concat();
    let mut text = answer::table(&side_by_side(&show));
    text.push_str(&format!("\n\n{} was made {RAISE_M} m taller.", show.raised));
    let first_plans: Vec<String> = show.flown.first_plans_ms.iter().map(|ms| format!("{ms:.0}")).collect();
    text.push_str(&format!(
        "\nIn the air three more changes came: a safe plan was there after {} ms, and {:.1} % are captured in the end (flight.svg).",
        first_plans.join(", "),
        show.flown.coverage_percent
    ));
    for file in &files {
        text.push_str(&format!("\nwrote {}", file.display()));
    }
    Ok(Answer { text, json: to_json(&show, &files) })
}

/// What the daemon has done.
struct Show {
    loaded: Loaded,
    raised: String,
    plan: (Plan, RunTimes),
    replan: (Plan, RunTimes),
    /// Until what can still be flown was there, and until that was improved.
    edit_to_first_plan_s: f64,
    edit_to_plan_s: f64,
    flown: Flown,
    files: Vec<PathBuf>,
}

fn fly(
    client: &Client,
    domain: &Domain,
    folder: &Path,
    scene: &Scene,
    geojson: String,
    seed: u64,
    form: Form,
) -> Result<Show, Failure> {
    let mut meter = Meter::new(form);
    let source = SceneSource::Bytes { file_name: format!("{}.geojson", scene.name), bytes: geojson.into_bytes() };
    let loaded = client.load(source, None, &mut |note| meter.note(note))?;
    let order = PlanOrder { seed, iterations: Some(ROUNDS), ..Default::default() };
    let message = client.plan(&loaded.scene, &order, &mut |note| meter.note(note))?;
    let (plan, times) = daemon::plan_of(&message)?;
    let flight = daemon::flight(&plan, times, None, load::import_report(&loaded));
    let mut files = daemon::write(client, folder, &FileNames::of_plan(), &flight)?.0;
    let before = shown(client, "plan", &plan)?;

    let command = format!("overfly plan {}", folder.join("scene.geojson").display());
    plan::remark_shortfall(&flight, &command, daemon::heights(client, &plan).as_ref(), true, form);

    let raised = building_to_raise(client, &loaded.scene)?;
    let raise = EditOrder::Raise { structure: raised.clone(), by_m: RAISE_M };
    let Made { edited, sent, first } = received::edit(client, domain, &loaded.scene, &raise)?;
    let message = client.await_replan(&edited, daemon::REPLAN, &mut |note| meter.note(note))?;
    let edit_to_plan_s = sent.elapsed().as_secs_f64();
    let (replan, replan_times) = daemon::plan_of(&message)?;
    let flight = daemon::flight(&replan, replan_times, Some(edit_to_plan_s), None);
    files.extend(daemon::write(client, folder, &FileNames::with_stem("replan"), &flight)?.0);
    let both = folder.join("replan-vs-plan.html");
    fs::write(&both, pages::page_of(vec![shown(client, "replan", &replan)?, before]))
        .map_err(|cause| Failure::write(&both, cause))?;
    files.push(both);
    let flown = demo_flight::fly(client, domain, folder, &loaded.scene, message, &mut meter)?;
    files.push(flown.file.clone());
    drop(meter);
    let (plan, replan) = ((plan, times), (replan, replan_times));
    let edit_to_first_plan_s = first.as_secs_f64();
    Ok(Show { loaded, raised, plan, replan, edit_to_first_plan_s, edit_to_plan_s, flown, files })
}

/// A plan on the field that the daemon has now, which is the plan's.
fn shown(client: &Client, label: &str, plan: &Plan) -> Result<Shown, Failure> {
    let map = client.field(&plan.scene.name)?;
    Ok(Shown::on_field(label, &map.table(), plan, false)?)
}

/// The structure of median height: raising it changes what its neighbours' walls can be seen from.
fn building_to_raise(client: &Client, scene: &str) -> Result<String, Failure> {
    let mut structures = client.structures(scene)?;
    structures.sort_by(|a, b| a.top_m.total_cmp(&b.top_m).then(a.id.cmp(&b.id)));
    let median = structures.get(structures.len() / 2);
    median.map(|structure| structure.name.clone()).ok_or_else(|| Failure::Unexpected("the block is empty".to_owned()))
}

fn side_by_side(show: &Show) -> Vec<Vec<String>> {
    let (plan, replan) = (&show.plan, &show.replan);
    let mut rows = vec![vec![String::new(), "plan".to_owned(), "replan".to_owned()]];
    rows.push(vec!["edit to first safe plan, s".to_owned(), "-".to_owned(), format!("{:.3}", show.edit_to_first_plan_s)]);
    rows.push(vec!["edit to improved plan, s".to_owned(), "-".to_owned(), format!("{:.3}", show.edit_to_plan_s)]);
    // The first plan's field was built when the scene was loaded.
    let plan_times = RunTimes { field_s: show.loaded.field_s, ..plan.1 };
    let (of_plan, of_replan) = (outputs::figures(&plan.0, &plan_times), outputs::figures(&replan.0, &replan.1));
    rows.extend(of_plan.into_iter().zip(of_replan).map(|(mut row, other)| {
        row.extend(other.into_iter().skip(1));
        row
    }));
    rows
}

fn to_json(show: &Show, files: &[PathBuf]) -> Value {
    let one = |(plan, times): &(Plan, RunTimes), edit_to_plan_s| {
        let flight: Flight = daemon::flight(plan, *times, edit_to_plan_s, None);
        outputs::figures_json(&flight, &[])
    };
    json!({
        "load": load::to_json(&show.loaded),
        "plan": one(&show.plan, None),
        "raised": show.raised,
        "raised_by_m": RAISE_M,
        "edit_to_first_plan_s": show.edit_to_first_plan_s,
        "in_the_air": { "first_plan_ms": show.flown.first_plans_ms, "coverage_percent": show.flown.coverage_percent },
        "replan": one(&show.replan, Some(show.edit_to_plan_s)),
        "files": files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
    })
}
