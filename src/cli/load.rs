//! `overfly load`: a scene file for the daemon.

use std::path::Path;

use overfly_client::{Client, ClientError, Loaded, RefusalCode, SceneSource};
use serde_json::{Value, json};

use super::answer::{self, Answer, Form};
use super::arguments::LoadArgs;
use super::failure::Failure;
use super::progress::Meter;
use super::{daemon, in_process};

pub fn run(arguments: &LoadArgs, form: Form) -> Result<Answer, Failure> {
    // Opening it here first tells a wrong path from a daemon that may not read it.
    let piped = in_process::read_piped(&arguments.file)?;
    let client = daemon::connect(arguments.reach.domain.as_deref())?;
    let source = source(&arguments.file, arguments.read.dtm.as_deref());
    let loaded = match load(&client, source, arguments, form) {
        // What is sent is one file.
        Err(error @ ClientError::Refused { code: RefusalCode::Unreadable, .. }) if arguments.read.dtm.is_some() => {
            return Err(error.into());
        }
        Err(ClientError::Refused { code: RefusalCode::Unreadable, message }) => {
            form.remark(&format!("{message}\nso its content is sent"));
            load(&client, content(&arguments.file, piped)?, arguments, form)?
        }
        other => other?,
    };
    Ok(answer(&loaded))
}

fn load(client: &Client, source: SceneSource, arguments: &LoadArgs, form: Form) -> Result<Loaded, ClientError> {
    let mut meter = Meter::new(form);
    client.load_as(source, arguments.name.as_deref(), &arguments.read.order(), &mut |note| meter.note(note))
}

/// A file, and of a surface model the model of its ground, for a daemon that can read them.
pub fn source(file: &Path, ground: Option<&Path>) -> SceneSource {
    let path = file.to_owned();
    match ground {
        Some(ground) => SceneSource::PathOverGround { path, ground: ground.to_owned() },
        None => SceneSource::Path(path),
    }
}

/// The file as it is sent: under the same name that the daemon would have given it.
pub fn content(file: &Path, piped: Option<Vec<u8>>) -> Result<SceneSource, Failure> {
    let bytes = piped.map_or_else(|| in_process::read_bytes(file), Ok)?;
    let path = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    Ok(SceneSource::Bytes { file_name: path.to_string_lossy().into_owned(), bytes })
}

fn answer(loaded: &Loaded) -> Answer {
    let row = |label: &str, value: String| vec![label.to_owned(), value];
    let rows = [
        row("scene", loaded.scene.clone()),
        row("revision", loaded.revision.to_string()),
        row("structures", loaded.structures.to_string()),
        row("samples", loaded.samples.to_string()),
        row("exposed samples", loaded.exposed.to_string()),
        row("viewpoints", loaded.viewpoints.to_string()),
        row("capturable, %", format!("{:.1}", loaded.capturable_percent)),
        row("field, MB", format!("{:.1}", loaded.field_bytes as f64 / 1e6)),
        row("reading, s", format!("{:.3}", loaded.read_s)),
        row("field, s", format!("{:.3}", loaded.field_s)),
        row("all, s", format!("{:.3}", loaded.load_s)),
    ];
    let mut text = answer::table(&rows);
    for line in &loaded.report_lines {
        text.push_str(&format!("\nscene: {line}"));
    }
    Answer { text, json: to_json(loaded) }
}

/// What loading gives, as scripts read it.
pub fn to_json(loaded: &Loaded) -> Value {
    json!({
        "scene": loaded.scene,
        "revision": loaded.revision,
        "structures": loaded.structures,
        "samples": loaded.samples,
        "exposed": loaded.exposed,
        "viewpoints": loaded.viewpoints,
        "capturable_percent": loaded.capturable_percent,
        "field_bytes": loaded.field_bytes,
        "read_s": loaded.read_s,
        "field_s": loaded.field_s,
        "load_s": loaded.load_s,
        "import": import_report(loaded),
    })
}

/// The import report that the daemon sent along.
pub fn import_report(loaded: &Loaded) -> Option<Value> {
    serde_json::from_str(&loaded.report_json).ok()
}
