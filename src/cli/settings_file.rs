//! Settings from a file over the built-in ones, and from the command line over both.

use std::path::PathBuf;

use super::arguments::SizeArgs;
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
