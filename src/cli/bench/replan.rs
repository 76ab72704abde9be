//! From an edit to the first safe plan in this process's hands, with a daemon of its own. Plans are received on a thread of their own, as an aircraft's
//! are: the first one comes before the edit is answered.
//!
//! Edits come in threes: a pillar on the flight, so that it is not safe any more; the same pillar away, so that what its neighbourhood shows
//! changes; and the structure that is farthest from the flight, a little higher or lower.

use std::sync::mpsc::Receiver;
use std::time::Instant;

use nalgebra::{Point3, center};
use overfly_client::{Client, EditOrder, PlanMessage, PlanOrder, SceneSource};
use overfly_table::field::StructureRow;
use overfly_table::plan::{SAFE, WaypointRow};
use overfly_table::{FieldTable, PlanTable};
use serde_json::{Value, json};

use super::ipc::SettingsFile;
use super::{Report, Row, field, quantile};
use crate::cli::answer::Form;
use crate::cli::arguments::BenchArgs;
use crate::cli::failure::Failure;
use crate::cli::private_daemon::PrivateDaemon;
use crate::cli::progress::Meter;
use crate::cli::received::{self, Received};
use crate::cli::{daemon, in_process, rig_file, settings_file};

/// Rounds of the refinement, before the first edit and after each: what is measured comes before them.
const ROUNDS: u32 = 12;

/// Half the width of a pillar, and how far it rises above the flight, m.
const HALF_WIDTH_M: f64 = 1.0;
const ABOVE_M: f64 = 1.0;

/// By how much the distant structure is raised and lowered, m.
const STEP_M: f64 = 1.0;

const PLACES: [&str; 3] =
    ["first safe plan, edit on the path", "first safe plan, edit beside it", "first safe plan, edit elsewhere"];

/// What was measured of the edits at one place.
#[derive(Default)]
struct Measured {
    first_plan_ms: Vec<f64>,
    field_ms: Vec<f64>,
    /// Until the first plan that tells what it captures.
    counted_ms: Vec<f64>,
    /// Coverage of the first safe plan, which the next one tells that has the same path, over that of the plan before, percent.
    kept_percent: Vec<f64>,
}

pub fn run(arguments: &BenchArgs, form: Form) -> Result<Report, Failure> {
    let bytes = in_process::read_bytes(&arguments.file)?;
    let rig = rig_file::read(&arguments.rig)?;
    let settings = settings_file::settings(arguments.config.as_ref(), Some(&arguments.sizes))?.with_sight(rig.rig.sight_scale());
    settings.check()?;
    let mut meter = Meter::new(form);
    let config = SettingsFile::write(&settings)?;
    let mut own = PrivateDaemon::start("replan", Some(&config.path), None)?;
    let client = own.connect()?;
    drop(config);
    let loaded = client.load(SceneSource::Path(arguments.file.clone()), None, &mut |note| meter.note(note))?;
    let rounds = arguments.iterations.unwrap_or(ROUNDS);
    let order = PlanOrder { rig: rig.rig.name.clone(), rig_file: rig.text, iterations: Some(rounds), ..Default::default() };
    let mut latest = client.plan(&loaded.scene, &order, &mut |note| meter.note(note))?;
    let mut measured: [Measured; 3] = Default::default();
    let make_edits = |plans: &Receiver<Received>| -> Result<(), Failure> {
        for number in 0..arguments.edits {
            meter.stage(&format!("edit {} of {}", number + 1, arguments.edits));
            let place = number as usize % PLACES.len();
            latest = edit(&client, plans, &loaded.scene, number, &latest, &mut measured[place])?;
        }
        Ok(())
    };
    received::while_receiving(own.domain(), &loaded.scene, make_edits)?;
    let resident_mb = client.status()?.resident_mb;
    let (images, captured_percent) = (latest.table().images.len(), latest.table().facts.metrics.coverage_percent);
    own.stop(client)?;
    meter.stage("the field anew");
    let [update_ms, rebuild_ms] = field::update_and_rebuild_ms(&arguments.file, &bytes, &settings, arguments.repeat)?;
    drop(meter);
    let ratio = mean(&update_ms) / mean(&rebuild_ms);
    let kept = measured.iter().flat_map(|one| &one.kept_percent).copied();
    let facts = vec![
        ("rig", json!(rig.rig.name)),
        ("structures", json!(loaded.structures)),
        ("samples", json!(loaded.samples)),
        ("viewpoints", json!(loaded.viewpoints)),
        ("edits", json!(arguments.edits)),
        ("images of the last plan", json!(images)),
        ("captured percent", json!(captured_percent)),
        ("least coverage kept percent", json!(kept.fold(f64::INFINITY, f64::min))),
        ("field update over rebuild", json!(ratio)),
        ("daemon resident MB", json!(resident_mb)),
    ];
    let all_ms: Vec<f64> = measured.iter().flat_map(|one| one.first_plan_ms.clone()).collect();
    let mut first_safe_plan_ms = quantiles(&all_ms);
    for (place, one) in ["on_path", "beside", "elsewhere"].into_iter().zip(&measured) {
        first_safe_plan_ms[place] = quantiles(&one.first_plan_ms);
    }
    let counted_ms: Vec<f64> = measured.iter().flat_map(|one| one.counted_ms.clone()).collect();
    let figures = vec![
        ("first_safe_plan_ms", first_safe_plan_ms),
        ("first_counted_plan_ms", quantiles(&counted_ms)),
        ("field_update_ms", quantiles(&update_ms)),
        ("field_rebuild_ms", quantiles(&rebuild_ms)),
        ("field_update_over_rebuild", json!(ratio)),
    ];
    let field_ms = measured.iter().flat_map(|one| one.field_ms.clone()).collect();
    let mut rows: Vec<Row> = PLACES
        .into_iter()
        .zip(measured)
        .map(|(step, one)| Row {
            step,
            unit: "ms",
            values: one.first_plan_ms,
            limit: "goal 5, p99 20 (delfshaven, nihonbashi); 10, 40 (marunouchi); 25, 80 (tokyo-2km)",
        })
        .collect();
    rows.extend([
        Row { step: "first plan with what it captures", unit: "ms", values: counted_ms, limit: "none" },
        Row {
            step: "field update, in the daemon",
            unit: "ms",
            values: field_ms,
            limit: "goal 3 (delfshaven, nihonbashi), 8 (marunouchi), 15 (tokyo-2km)",
        },
        Row { step: "field update, in process", unit: "ms", values: update_ms, limit: "the same" },
        Row {
            step: "field rebuild, in process",
            unit: "ms",
            values: rebuild_ms,
            limit: "goal 150 (delfshaven, nihonbashi), 1500 (marunouchi), 5000 (tokyo-2km)",
        },
    ]);
    Ok(Report { facts, rows, figures })
}

fn quantiles(values: &[f64]) -> Value {
    let [p50, p99, max] = [0.5, 0.99, 1.0].map(|share| quantile(values, share));
    json!({ "p50": p50, "p99": p99, "max": max })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Makes one edit and waits for the first plan after it, then for the improved one, which is returned.
fn edit(
    client: &Client,
    plans: &Receiver<Received>,
    scene: &str,
    number: u32,
    latest: &PlanMessage,
    measured: &mut Measured,
) -> Result<PlanMessage, Failure> {
    let order = match number % 3 {
        0 => pillar(number, &latest.table()),
        1 => EditOrder::Remove { structure: pillar_name(number - 1) },
        _ => far_off(number, &client.field(scene)?.table(), &latest.table())?,
    };
    let started = Instant::now();
    let edited = client.edit(scene, &order)?;
    let first = received::first(plans, edited.revision)?;
    measured.first_plan_ms.push((first.at - started).as_secs_f64() * 1e3);
    let is_counted = first.plan.table().facts.stop != SAFE;
    let counted = if is_counted { None } else { Some(received::next(plans)?) };
    let counted = counted.as_ref().unwrap_or(&first);
    let (before, safe, now) = (latest.table(), first.plan.table(), counted.plan.table());
    if now.waypoints != safe.waypoints {
        return Err(Failure::Unexpected("the plan that tells what the first safe plan captures has another path".to_owned()));
    }
    measured.counted_ms.push((counted.at - started).as_secs_f64() * 1e3);
    let percent = |plan: &PlanTable| plan.facts.metrics.coverage_percent;
    measured.kept_percent.push(100.0 * percent(&now) / percent(&before).max(1e-9));
    measured.field_ms.push(now.facts.field_s * 1e3);
    Ok(client.await_replan(&edited, daemon::REPLAN, &mut |_| {})?)
}

fn pillar_name(number: u32) -> String {
    format!("bench-pillar-{number}")
}

/// A pillar that reaches through the middle of a leg; of another leg each time.
fn pillar(number: u32, plan: &PlanTable) -> EditOrder {
    let legs = plan.waypoints.len().saturating_sub(1).max(1);
    let leg = number as usize * 7 % legs;
    let place = |k: usize| plan.waypoints.get(k).map_or_else(Point3::origin, |row| Point3::from(row.position_m));
    let middle = center(&place(leg), &place(leg + 1));
    let corner = |dx: f64, dy: f64| [middle.x + dx * HALF_WIDTH_M, middle.y + dy * HALF_WIDTH_M];
    let outline_m = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    EditOrder::add_prism(pillar_name(number), outline_m, 0.0, middle.z + ABOVE_M)
}

/// The structure that is farthest from the flight: higher, and the next time lower again.
fn far_off(number: u32, field: &FieldTable, plan: &PlanTable) -> Result<EditOrder, Failure> {
    let away_m = |structure: &StructureRow| {
        let corner = field.outline(structure).flatten().next().copied().unwrap_or_default();
        let to = |row: &WaypointRow| (row.position_m[0] - corner[0]).hypot(row.position_m[1] - corner[1]);
        plan.waypoints.iter().map(to).fold(f64::INFINITY, f64::min)
    };
    let is_high = |structure: &&StructureRow| structure.top_m - structure.base_m > 2.0 * STEP_M;
    let farthest = field.structures.iter().filter(is_high).max_by(|a, b| away_m(a).total_cmp(&away_m(b)));
    let farthest = farthest.ok_or_else(|| Failure::Unexpected("no structure is high enough to be lowered".to_owned()))?;
    let structure = field.name(farthest).into_owned();
    Ok(if (number / 3).is_multiple_of(2) {
        EditOrder::Raise { structure, by_m: STEP_M }
    } else {
        EditOrder::Lower { structure, by_m: STEP_M }
    })
}
