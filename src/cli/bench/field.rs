//! Loading a scene, sampling it, and building its view information field.

use std::io::Seek;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::{Point3, Vector3};
use overfly_table::FieldTable;
use serde_json::json;

use super::{Report, Row};
use crate::cli::answer::Form;
use crate::cli::arguments::BenchArgs;
use crate::cli::failure::Failure;
use crate::cli::progress::Meter;
use crate::cli::{in_process, settings_file};
use crate::planner::StopToken;
use crate::scene;
use crate::scene::edit::Edit;
use crate::session::{FieldError, Session, Snapshot};
use crate::settings::Settings;
use crate::snapshot::{self, FieldStamp, SnapshotError};

pub fn run(arguments: &BenchArgs, form: Form) -> Result<Report, Failure> {
    let settings = Arc::new(settings_file::settings(arguments.config.as_ref(), Some(&arguments.sizes))?);
    let bytes = in_process::read_bytes(&arguments.file)?;
    let file_name = arguments.file.to_string_lossy();
    let stop = StopToken::default();
    let mut meter = Meter::new(form);
    let mut values: [Vec<f64>; 9] = Default::default();
    let mut last = None;
    for round in 1..=arguments.repeat {
        meter.stage(&format!("round {round} of {}", arguments.repeat));
        let started = Instant::now();
        let (scene, _) = scene::read(&file_name, &bytes, &settings.proxy)?;
        let read = started.elapsed();
        let session = Session::new(scene, Arc::clone(&settings), &stop)?;
        let survey = session.survey(&stop)?;
        let surveyed = started.elapsed();
        let build_started = Instant::now();
        let field = survey.into_snapshot(&stop)?;
        let built = build_started.elapsed();
        let [updated, rebuilt] = edit_times(&session, &field, round, &stop)?;
        let [stored, restored] = disk_times(&field)?;
        last = Some(field);
        let steps = [read, surveyed - read, built, surveyed + built, updated, rebuilt, stored, restored];
        steps.iter().zip(&mut values).for_each(|(step, values)| values.push(step.as_secs_f64() * 1e3));
    }
    drop(meter);
    let last = last.expect("there is a round at least");
    let field = last.field();
    let rays = pairs_in_reach(&field, &settings);
    values[8] = values[2].iter().map(|build_ms| rays as f64 / build_ms / 1e3).collect();
    let [load, survey, build, all, updated, rebuilt, stored, restored, rate] = values;
    Ok(Report {
        figures: Vec::new(),
        facts: [facts(&field, arguments.repeat), vec![("rays", json!(rays))]].concat(),
        rows: vec![
            Row { step: "load", unit: "ms", values: load, limit: "" },
            Row { step: "survey", unit: "ms", values: survey, limit: "" },
            Row { step: "build", unit: "ms", values: build, limit: "33 walls, 77 CWBVH, 110 parry (N 1600, M 2000)" },
            Row { step: "load to field", unit: "ms", values: all, limit: "goal 500 (delfshaven, N 1600, M 2000)" },
            Row {
                step: "update after an edit",
                unit: "ms",
                values: updated,
                limit: "goal 3 (delfshaven, nihonbashi), 8 (marunouchi), 15 (tokyo-2km)",
            },
            Row {
                step: "rebuild after it",
                unit: "ms",
                values: rebuilt,
                limit: "goal 150 (delfshaven, nihonbashi), 1500 (marunouchi), 5000 (tokyo-2km)",
            },
            Row { step: "field to disk", unit: "ms", values: stored, limit: "goal 500 with the way back (tokyo-2km)" },
            Row { step: "field from disk", unit: "ms", values: restored, limit: "" },
            Row { step: "rays", unit: "million/s", values: rate, limit: "8 parry, 12 CWBVH, 50 walls" },
        ],
    })
}

/// The same of a scene by itself, ms, `rounds` times.
pub fn update_and_rebuild_ms(file: &Path, bytes: &[u8], settings: &Settings, rounds: u32) -> Result<[Vec<f64>; 2], Failure> {
    let stop = StopToken::default();
    let (scene, _) = scene::read(&file.to_string_lossy(), bytes, &settings.proxy)?;
    let session = Session::new(scene, Arc::new(settings.clone()), &stop)?;
    let earlier = session.survey(&stop)?.into_snapshot(&stop)?;
    let mut times: [Vec<f64>; 2] = Default::default();
    for round in 1..=rounds {
        let measured = edit_times(&session, &earlier, round, &stop)?;
        measured.iter().zip(&mut times).for_each(|(time, times)| times.push(time.as_secs_f64() * 1e3));
    }
    Ok(times)
}

/// How long a field takes to a file and back.
fn disk_times(field: &Snapshot) -> Result<[Duration; 2], Failure> {
    let failed = |error: SnapshotError| Failure::Unexpected(error.to_string());
    let stamp = FieldStamp { scene: "bench".to_owned(), revision: field.revision, settings_hash: 0 };
    let mut file = tempfile::tempfile().map_err(|error| failed(error.into()))?;
    let started = Instant::now();
    snapshot::write(&mut file, &stamp, field.storage().as_ref()).map_err(failed)?;
    file.sync_all().map_err(|error| failed(error.into()))?;
    let stored = started.elapsed();
    file.rewind().map_err(|error| failed(error.into()))?;
    let started = Instant::now();
    let read = snapshot::read(&mut file, &stamp, u64::MAX).map_err(failed)?;
    let restored = started.elapsed();
    if !field.storage().is_same(&read) {
        return Err(Failure::Unexpected("a field came back from disk as another one".to_owned()));
    }
    Ok([stored, restored])
}

/// How long the field takes after one structure was raised: from the field before, and anew. Another structure in each round.
fn edit_times(session: &Session, earlier: &Snapshot, round: u32, stop: &StopToken) -> Result<[Duration; 2], Failure> {
    let structures = &session.scene().structures;
    let mut edited = session.clone();
    let ids = (0..structures.len()).map(|k| structures[(round as usize * STRIDE + k) % structures.len()].id);
    ids.into_iter().find(|&id| edited.apply(&Edit::Raise { id, by_m: RAISED_M }).is_ok());
    let timed = |survey: &dyn Fn() -> Result<Snapshot, FieldError>| -> Result<_, Failure> {
        let started = Instant::now();
        let snapshot = survey()?;
        Ok((started.elapsed(), snapshot))
    };
    let (updated, update) = timed(&|| edited.survey_after(earlier, stop)?.into_snapshot(stop))?;
    let (rebuilt, rebuild) = timed(&|| edited.survey(stop)?.into_snapshot(stop))?;
    debug_assert!(update.storage().is_same(rebuild.storage().as_ref()));
    Ok([updated, rebuilt])
}

/// Structures that are raised lie so many apart.
const STRIDE: usize = 37;
const RAISED_M: f64 = 3.0;

/// Facts of a field that figures depend on.
pub fn facts(field: &FieldTable, repeat: u32) -> Vec<(&'static str, serde_json::Value)> {
    vec![
        ("structures", json!(field.structures.len())),
        ("samples", json!(field.samples.len())),
        ("exposed", json!(field.samples.iter().filter(|sample| sample.exposed == 1).count())),
        ("viewpoints", json!(field.viewpoints.len())),
        ("field MB", json!(field.bytes() as f64 / 1e6)),
        ("rounds", json!(repeat)),
    ]
}

/// Pairs of a viewpoint and an exposed sample that need a ray: in range, and the sample faces the viewpoint.
fn pairs_in_reach(field: &FieldTable, settings: &Settings) -> u64 {
    let least_cosine = settings.coverage.max_incidence_deg.to_radians().cos();
    let needs_ray = |viewpoint: &Point3<f64>, position_m: &[f64; 3], normal: &[f64; 3]| {
        let towards = viewpoint - Point3::from(*position_m);
        let distance_m = towards.norm();
        distance_m <= field.facts.range_m && towards.dot(&Vector3::from(*normal)) >= least_cosine * distance_m
    };
    let exposed = || field.samples.iter().filter(|sample| sample.exposed == 1);
    let count = |viewpoint: Point3<f64>| {
        exposed().filter(|sample| needs_ray(&viewpoint, &sample.position_m, &sample.normal)).count() as u64
    };
    field.viewpoints.iter().map(|viewpoint| count(viewpoint.position_m.into())).sum()
}
