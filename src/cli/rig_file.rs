//! `--rig`: the name of a preset, or a rig file.

use std::path::Path;

use super::failure::Failure;
use crate::camera::{Rig, RigError};

/// The rig that the command line names.
pub fn rig(given: &str) -> Result<Rig, Failure> {
    match text(given)? {
        None => Ok(Rig::preset(given)?),
        Some(text) => Rig::parse(&text).map_err(|cause| Failure::RigFile { path: given.into(), cause }),
    }
}

/// The content of the rig file, when it is one that is named and not a preset.
pub fn text(given: &str) -> Result<Option<String>, Failure> {
    if Rig::PRESETS.contains(&given) || !is_file_name(given) {
        return Ok(None);
    }
    let remedy = "give a rig file that you may read; `config/rigs/` holds examples";
    let path = Path::new(given);
    std::fs::read_to_string(path).map(Some).map_err(|cause| Failure::Read { path: path.to_owned(), cause, remedy })
}

fn is_file_name(given: &str) -> bool {
    given.to_lowercase().ends_with(".toml") || given.contains('/')
}

impl From<RigError> for Failure {
    fn from(error: RigError) -> Self {
        Failure::Rig(error)
    }
}
