//! The configuration file of a running daemon.

use std::path::{Path, PathBuf};

use crate::settings::{Settings, SettingsError};

/// Why a configuration file was not taken.
#[derive(Debug, thiserror::Error)]
pub enum ConfigurationError {
    #[error("the configuration {path:?} cannot be read: {cause}")]
    Read {
        path: PathBuf,
        #[source]
        cause: std::io::Error,
    },
    #[error("the configuration {path:?} is wrong: {cause}")]
    Wrong {
        path: PathBuf,
        #[source]
        cause: Box<SettingsError>,
    },
}

/// Reads settings from `path`; keys that the file leaves out have their defaults.
pub fn read(path: &Path) -> Result<Settings, ConfigurationError> {
    let text = std::fs::read_to_string(path).map_err(|cause| ConfigurationError::Read { path: path.into(), cause })?;
    Settings::parse(&text).map_err(|cause| ConfigurationError::Wrong { path: path.into(), cause: Box::new(cause) })
}
