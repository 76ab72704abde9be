//! Messages and tables between this process and a daemon of its own.

use std::path::{Path, PathBuf};
use std::time::Duration;

use overfly_client::{SceneSource, bench};
use serde_json::json;

use super::{Report, Row};
use crate::cli::answer::Form;
use crate::cli::arguments::BenchArgs;
use crate::cli::failure::Failure;
use crate::cli::private_daemon::PrivateDaemon;
use crate::cli::progress::Meter;
use crate::cli::{in_process, settings_file};
use crate::settings::Settings;

/// What is measured per round: requests back to back, requests with a gap, late joiners.
const PINGS: usize = 500;
const SPACED_PINGS: usize = 50;
const JOINERS: usize = 20;

pub fn run(arguments: &BenchArgs, form: Form) -> Result<Report, Failure> {
    in_process::read_bytes(&arguments.file)?;
    let settings = settings_file::settings(arguments.config.as_ref(), Some(&arguments.sizes))?;
    let config = SettingsFile::write(&settings)?;
    let mut daemon = PrivateDaemon::start("bench", Some(&config.path), None)?;
    let client = daemon.connect()?;
    drop(config);
    let mut meter = Meter::new(form);
    let source = SceneSource::Path(arguments.file.clone());
    let loaded = client.load(source, None, &mut |note| meter.note(note))?;
    let (mut busy_ns, mut spaced_ns, mut joined_ns) = (Vec::new(), Vec::new(), Vec::new());
    for round in 1..=arguments.repeat {
        meter.stage(&format!("round {round} of {}", arguments.repeat));
        busy_ns.extend(bench::ping(&client, PINGS, Duration::ZERO)?);
        spaced_ns.extend(bench::ping(&client, SPACED_PINGS, Duration::from_millis(1))?);
        joined_ns.extend(bench::join(daemon.domain(), &loaded.scene, JOINERS)?);
    }
    let resident_mb = client.status()?.resident_mb;
    drop(meter);
    daemon.stop(client)?;
    Ok(Report {
        figures: Vec::new(),
        facts: vec![
            ("structures", json!(loaded.structures)),
            ("samples", json!(loaded.samples)),
            ("viewpoints", json!(loaded.viewpoints)),
            ("field MB", json!(loaded.field_bytes as f64 / 1e6)),
            ("daemon resident MB", json!(resident_mb)),
            ("rounds", json!(arguments.repeat)),
        ],
        rows: vec![
            row("acknowledged, back to back", "us", 1e3, &busy_ns, "14, p99 19; goal 50, p99 200"),
            row("acknowledged, 1 ms apart", "us", 1e3, &spaced_ns, "19, p99 40; goal 50, p99 200"),
            row("late joiner has the field", "ms", 1e6, &joined_ns, "0.7, p99 3; goal 2 (100 MB)"),
        ],
    })
}

fn row(step: &'static str, unit: &'static str, unit_ns: f64, nanoseconds: &[u64], limit: &'static str) -> Row {
    let values = nanoseconds.iter().map(|time| *time as f64 / unit_ns).collect();
    Row { step, unit, values, limit }
}

/// Settings on disk for as long as a daemon needs to read them.
pub struct SettingsFile {
    pub path: PathBuf,
}

impl SettingsFile {
    pub fn write(settings: &Settings) -> Result<Self, Failure> {
        let path = std::env::temp_dir().join(format!("overfly-bench-{}.toml", std::process::id()));
        let text =
            toml::to_string(settings).map_err(|error| Failure::Unexpected(format!("the settings cannot be written: {error}")))?;
        std::fs::write(&path, text).map_err(|cause| Failure::write(Path::new(&path), cause))?;
        Ok(Self { path })
    }
}

impl Drop for SettingsFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
