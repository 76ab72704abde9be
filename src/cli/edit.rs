//! `overfly edit`: changes of structures and zones, and the plan that follows from them.

use std::path::Path;
use std::time::Instant;

use overfly_client::{Client, ClientError, EditOrder, Edited, RefusalCode, ShapeOrder, StructureInfo};
use serde_json::json;

use super::answer::{Answer, Form};
use super::arguments::EditArgs;
use super::edit_orders;
use super::failure::Failure;
use super::outputs::{FileNames, Folder};
use super::progress::Meter;
use super::{daemon, plan};

/// Edits of a batch that are told one by one.
const MOST_TOLD: usize = 20;

pub fn run(arguments: &EditArgs, form: Form) -> Result<Answer, Failure> {
    let orders = edit_orders::of_change(&arguments.change)?;
    let client = daemon::connect(arguments.domain.as_deref())?;
    let _folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let before = client.structures(&arguments.scene)?;
    let started = Instant::now();
    let edited = client.edit_all(&arguments.scene, &orders)?;
    let changed = changed(&orders, &before, &edited);
    if arguments.no_wait || !edited.replan_follows {
        return Ok(edited_only(&edited, &changed));
    }
    let mut answer = receive(&client, arguments.out.as_deref(), &edited, started, form)?;
    answer.text = format!("{changed}\n{}", answer.text);
    answer.json["edit"] = changed.into();
    Ok(answer)
}

/// What the edits did, in words, and the revision.
fn changed(orders: &[EditOrder], before: &[StructureInfo], edited: &Edited) -> String {
    let mut told: Vec<String> = match orders {
        [order] => vec![in_words(order, before)],
        // What stood there before an edit is known of the first one alone.
        _ => orders.iter().take(MOST_TOLD).map(|order| in_words(order, &[])).collect(),
    };
    if orders.len() > MOST_TOLD {
        told.push(format!("{} more edits", orders.len() - MOST_TOLD));
    }
    format!("{}; {} is at revision {}", told.join("\n"), edited.scene, edited.revision)
}

fn in_words(order: &EditOrder, before: &[StructureInfo]) -> String {
    let find = |id: &str| {
        let is_id = |structure: &&StructureInfo| u64::from_str_radix(id, 16) == Ok(structure.id);
        before.iter().find(|structure| structure.name == id).or_else(|| before.iter().find(is_id))
    };
    let name = |id: &str| find(id).map_or_else(|| id.to_owned(), |structure| structure.name.clone());
    let height = |id: &str, by_m: f64| match find(id) {
        Some(structure) => format!("{}: top {:.1} m -> {:.1} m", structure.name, structure.top_m, structure.top_m + by_m),
        None => format!("{id}: {by_m:+.1} m"),
    };
    match order {
        EditOrder::Raise { structure, by_m } => height(structure, *by_m),
        EditOrder::Lower { structure, by_m } => height(structure, -by_m),
        EditOrder::Remove { structure } => format!("{}: removed", name(structure)),
        EditOrder::Add { name, shape } => format!("{name}: added, {}", shape_in_words(shape)),
        EditOrder::Replace { structure, shape } => format!("{}: replaced, {}", name(structure), shape_in_words(shape)),
        EditOrder::Move { structure, by_m: [east_m, north_m] } => {
            format!("{}: moved by {east_m} m east, {north_m} m north", name(structure))
        }
        EditOrder::AddZone { name, floor_m, ceiling_m, .. } => {
            let ceiling = ceiling_m.map_or("up".into(), |ceiling_m| format!("to {ceiling_m} m"));
            format!("{name}: barred from {floor_m} m {ceiling}")
        }
        EditOrder::RemoveZone { name } => format!("{name}: no longer barred"),
    }
}

fn shape_in_words(shape: &ShapeOrder) -> String {
    match shape {
        ShapeOrder::Prism { top_m, .. } => format!("top {top_m:.1} m"),
        ShapeOrder::Mesh { triangles, .. } => format!("a mesh of {} triangles", triangles.len()),
        ShapeOrder::Obstacle { centre_m, size_m, .. } => {
            format!("an obstacle from {:.1} to {:.1} m", centre_m[2] - size_m[2] / 2.0, centre_m[2] + size_m[2] / 2.0)
        }
    }
}

/// The plan that follows from an edit; what belongs to it goes into the folder `out`.
pub fn receive(client: &Client, out: Option<&Path>, edited: &Edited, started: Instant, form: Form) -> Result<Answer, Failure> {
    let mut meter = Meter::new(form);
    let message = match client.await_replan(edited, daemon::REPLAN, &mut |note| meter.note(note)) {
        Err(ClientError::Refused { code: RefusalCode::Superseded, .. }) => return Ok(superseded(edited)),
        other => other?,
    };
    let edit_to_plan_s = started.elapsed().as_secs_f64();
    let asked = meter.asked();
    drop(meter);
    let (plan, times) = daemon::plan_of(&message)?;
    let flight = daemon::flight(&plan, times, Some(edit_to_plan_s), None);
    let mut files = Vec::new();
    if let Some(folder) = out {
        let (written, remark) = daemon::write(client, folder, &FileNames::of_plan(), &flight)?;
        files = written;
        remark.into_iter().for_each(|remark| form.remark(remark));
    }
    let command = plan::command(&edited.scene, &plan.rig);
    plan::remark_shortfall(&flight, &command, daemon::heights(client, &plan).as_ref(), true, form);
    Ok(plan::answer(&flight, &files, asked))
}

/// The edit stands, whatever became of its plan.
fn superseded(edited: &Edited) -> Answer {
    let revision = edited.revision;
    Answer {
        text: format!("edit made (revision {revision}); a newer request replaced its replan"),
        json: json!({ "scene": edited.scene, "revision": revision, "replan_follows": false, "replan_superseded": true }),
    }
}

/// The answer without a plan.
pub fn edited_only(edited: &Edited, changed: &str) -> Answer {
    let follows = match edited.replan_follows {
        true => "a new plan follows: `overfly watch` shows it".to_owned(),
        false => format!("it has not been planned yet: `overfly plan {}` does it", edited.scene),
    };
    Answer {
        text: format!("{changed}; {follows}"),
        json: json!({ "edit": changed, "scene": edited.scene, "revision": edited.revision, "replan_follows": edited.replan_follows }),
    }
}
