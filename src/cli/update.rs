//! `overfly update`: a loaded scene becomes what a new version of its file says.

use std::time::Instant;

use overfly_client::{Client, ClientError, Edited, RefusalCode, SceneChanges, SceneSource, Updated};
use serde_json::{Value, json};

use super::answer::{Answer, Form};
use super::arguments::UpdateArgs;
use super::failure::Failure;
use super::outputs::Folder;
use super::progress::Meter;
use super::{daemon, edit, in_process, load};

/// Names of a kind that are printed.
const MOST_NAMES: usize = 20;

pub fn run(arguments: &UpdateArgs, form: Form) -> Result<Answer, Failure> {
    // Opening it here first tells a wrong path from a daemon that may not read it.
    let piped = in_process::read_piped(&arguments.file)?;
    let client = daemon::connect(arguments.reach.domain.as_deref())?;
    let _folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let started = Instant::now();
    let source = load::source(&arguments.file, arguments.dtm.as_deref());
    let (edited, updated) = match update(&client, source, arguments, form) {
        // What is sent is one file.
        Err(error @ ClientError::Refused { code: RefusalCode::Unreadable, .. }) if arguments.dtm.is_some() => {
            return Err(error.into());
        }
        Err(ClientError::Refused { code: RefusalCode::Unreadable, message }) => {
            form.remark(&format!("{message}\nso its content is sent"));
            update(&client, load::content(&arguments.file, piped)?, arguments, form)?
        }
        other => other?,
    };
    let changed = in_words(&updated, arguments);
    let mut answer = if arguments.dry_run || updated.changes.is_empty() {
        let json = json!({ "scene": edited.scene, "revision": edited.revision, "replan_follows": false });
        Answer { text: changed, json }
    } else if arguments.no_wait || !edited.replan_follows {
        edit::edited_only(&edited, &changed)
    } else {
        let mut answer = edit::receive(&client, arguments.out.as_deref(), &edited, started, form)?;
        answer.text = format!("{changed}\n{}", answer.text);
        answer
    };
    for line in &updated.report_lines {
        answer.text.push_str(&format!("\nscene: {line}"));
    }
    answer.json["changes"] = to_json(&updated.changes);
    answer.json["dry_run"] = arguments.dry_run.into();
    Ok(answer)
}

fn update(client: &Client, source: SceneSource, arguments: &UpdateArgs, form: Form) -> Result<(Edited, Updated), ClientError> {
    let mut meter = Meter::new(form);
    client.update(&arguments.scene, source, arguments.dry_run, &mut |note| meter.note(note))
}

fn in_words(updated: &Updated, arguments: &UpdateArgs) -> String {
    let (scene, revision) = (&arguments.scene, updated.revision);
    if updated.changes.is_empty() {
        return format!("{scene} is as the file says, at revision {revision}: nothing was changed");
    }
    let mut text = String::new();
    for (kind, names) in updated.changes.kinds().into_iter().filter(|(_, names)| !names.is_empty()) {
        let shown = names.iter().take(MOST_NAMES).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = if names.len() > MOST_NAMES { ", ..." } else { "" };
        text.push_str(&format!("{} {kind}: {shown}{more}\n", names.len()));
    }
    text + &match arguments.dry_run {
        true => format!("nothing was changed; {scene} is at revision {revision}"),
        false => format!("{scene} is at revision {revision}"),
    }
}

/// All names of each kind.
fn to_json(changes: &SceneChanges) -> Value {
    changes.kinds().into_iter().map(|(kind, names)| (kind.replace(' ', "_"), json!(names))).collect()
}
