//! `overfly edit`: one change of one structure, and the plan that follows from it.

use std::time::Instant;

use overfly_client::{Client, ClientError, EditOrder, Edited, RefusalCode, StructureInfo};
use serde_json::json;

use super::answer::{Answer, Form};
use super::arguments::{Change, EditArgs};
use super::failure::Failure;
use super::outputs::{FileNames, Folder};
use super::progress::Meter;
use super::{daemon, plan};

pub fn run(arguments: &EditArgs, form: Form) -> Result<Answer, Failure> {
    let order = order(&arguments.change)?;
    let client = daemon::connect(arguments.domain.as_deref())?;
    let _folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let before = client.structures(&arguments.scene)?;
    let started = Instant::now();
    let edited = client.edit(&arguments.scene, &order)?;
    let changed = changed(&arguments.change, &before, &edited);
    if arguments.no_wait || !edited.replan_follows {
        return Ok(edited_only(&edited, &changed));
    }
    let mut answer = receive(&client, arguments, &edited, started, form)?;
    answer.text = format!("{changed}\n{}", answer.text);
    answer.json["edit"] = changed.into();
    Ok(answer)
}

/// What the edit did, in words: the structure, its height before and after, the revision.
fn changed(change: &Change, before: &[StructureInfo], edited: &Edited) -> String {
    let find = |id: &str| {
        let is_id = |structure: &&StructureInfo| u64::from_str_radix(id, 16) == Ok(structure.id);
        before.iter().find(|structure| structure.name == id).or_else(|| before.iter().find(is_id))
    };
    let name = |id: &str| find(id).map_or_else(|| id.to_owned(), |structure| structure.name.clone());
    let height = |id: &str, by_m: f64| match find(id) {
        Some(structure) => format!("{}: top {:.1} m -> {:.1} m", structure.name, structure.top_m, structure.top_m + by_m),
        None => format!("{id}: {by_m:+.1} m"),
    };
    let what = match change {
        Change::Raise { id, by } => height(id, *by),
        Change::Lower { id, by } => height(id, -by),
        Change::Remove { id } => format!("{}: removed", name(id)),
        Change::Add { name, height, base, .. } => format!("{name}: added, top {:.1} m", base + height),
        Change::Move { id, by } => format!("{}: moved by {} m east, {} m north", name(id), by.0[0], by.0[1]),
    };
    format!("{what}; {} is at revision {}", edited.scene, edited.revision)
}

fn receive(client: &Client, arguments: &EditArgs, edited: &Edited, started: Instant, form: Form) -> Result<Answer, Failure> {
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
    if let Some(folder) = &arguments.out {
        let (written, remark) = daemon::write(client, folder, &FileNames::of_plan(), &flight)?;
        files = written;
        remark.into_iter().for_each(|remark| form.remark(remark));
    }
    let command = plan::command(&arguments.scene, &plan.rig);
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

fn edited_only(edited: &Edited, changed: &str) -> Answer {
    let follows = match edited.replan_follows {
        true => "a new plan follows: `overfly watch` shows it".to_owned(),
        false => format!("it has not been planned yet: `overfly plan {}` does it", edited.scene),
    };
    Answer {
        text: format!("{changed}; {follows}"),
        json: json!({ "edit": changed, "scene": edited.scene, "revision": edited.revision, "replan_follows": edited.replan_follows }),
    }
}

fn order(change: &Change) -> Result<EditOrder, Failure> {
    Ok(match change.clone() {
        Change::Raise { id, by } => EditOrder::Raise { structure: id, by_m: positive("--by", by)? },
        Change::Lower { id, by } => EditOrder::Lower { structure: id, by_m: positive("--by", by)? },
        Change::Remove { id } => EditOrder::Remove { structure: id },
        Change::Add { name, outline, height, base } => {
            EditOrder::Add { name, outline_m: outline.0, base_m: base, top_m: base + positive("--height", height)? }
        }
        Change::Move { id, by } => EditOrder::Move { structure: id, by_m: by.0 },
    })
}

fn positive(option: &str, metres: f64) -> Result<f64, Failure> {
    if metres.is_finite() && metres > 0.0 {
        return Ok(metres);
    }
    Err(Failure::Usage(format!("{option} is {metres}; give a length above 0 m, and choose `raise` or `lower` for the direction")))
}
