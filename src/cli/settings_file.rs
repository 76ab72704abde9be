//! Settings from a file over the built-in ones, and from the command line over both.

use std::path::PathBuf;

use serde_json::{Map, Value};

use super::arguments::{ReadArgs, SizeArgs};
use super::failure::Failure;
use crate::daemon;
use crate::settings::Settings;

/// The settings that a command works with.
pub fn settings(file: Option<&PathBuf>, sizes: Option<&SizeArgs>) -> Result<Settings, Failure> {
    let mut settings = file.map_or(Ok(Settings::default()), |path| daemon::read_configuration(path))?;
    if let Some(samples) = sizes.and_then(|sizes| sizes.samples) {
        settings.surface.samples = samples;
    }
    if let Some(viewpoints) = sizes.and_then(|sizes| sizes.viewpoints) {
        settings.field.viewpoints = viewpoints;
    }
    settings.check()?;
    Ok(settings)
}

/// The same, for a file that is read as the command line says.
pub fn reading(file: Option<&PathBuf>, sizes: Option<&SizeArgs>, read: &ReadArgs) -> Result<Settings, Failure> {
    let settings = settings(file, sizes)?;
    daemon::read_as(&read.order(), &settings).map_err(|refusal| Failure::Usage(refusal.message))
}

/// The settings that are not the built-in ones for cameras of the same sight, by section and key.
pub fn differing(settings: &Settings) -> Option<Value> {
    let Value::Object(all) = serde_json::to_value(settings).ok()? else { return None };
    let built_in = serde_json::to_value(Settings::default().with_sight(settings.coverage.sight_scale)).ok()?;
    let mut differing = Map::new();
    for (section, keys) in all {
        let Value::Object(keys) = keys else { continue };
        let changed: Map<String, Value> = keys.into_iter().filter(|(key, value)| built_in[&section][key] != *value).collect();
        if !changed.is_empty() {
            differing.insert(section, Value::Object(changed));
        }
    }
    Some(Value::Object(differing))
}

/// The settings that a run.json says a plan was made with, for cameras of a sight; the built-in ones where it says nothing that can be understood.
pub fn as_in_run(run: &Value, sight_scale: f64) -> Settings {
    let built_in = Settings::default().with_sight(sight_scale);
    let Ok(mut all) = serde_json::to_value(&built_in) else { return built_in };
    for (section, keys) in run["settings"].as_object().into_iter().flatten() {
        for (key, value) in keys.as_object().into_iter().flatten() {
            all[section][key] = value.clone();
        }
    }
    let read = serde_json::from_value::<Settings>(all).ok();
    read.filter(|settings| settings.check().is_ok()).unwrap_or(built_in)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_changed_differs() {
        let mut settings = Settings::default();
        assert_eq!(differing(&settings), Some(serde_json::json!({})));
        settings.surface.samples = 7;
        assert_eq!(differing(&settings), Some(serde_json::json!({ "surface": { "samples": 7 } })));
    }

    #[test]
    fn a_run_tells_the_settings_of_its_plan() {
        let mut settings = Settings::default().with_sight(2.0);
        settings.surface.samples = 777;
        settings.coverage.goal_percent = 91.0;
        settings.check().unwrap();
        let run = serde_json::json!({ "settings": differing(&settings) });
        assert_eq!(as_in_run(&run, 2.0), settings);
        let built_in = Settings::default().with_sight(2.0);
        for damaged in [serde_json::json!(null), serde_json::json!({ "settings": { "surface": { "samples": "many" } } })] {
            assert_eq!(as_in_run(&damaged, 2.0), built_in);
        }
        let unknown = serde_json::json!({ "settings": { "none": 3, "new": { "key": 1 } } });
        assert_eq!(as_in_run(&unknown, 2.0), built_in);
    }
}
