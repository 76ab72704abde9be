//! `--rig`: the name of a preset, or a rig file.

use std::io;
use std::path::Path;

use overfly_wire::message::MAX_RIG_FILE_BYTES;

use super::bounded_file;
use super::failure::Failure;
use crate::camera::{Rig, RigError};

/// What `--rig` names.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenRig {
    pub rig: Rig,
    /// The content of the rig file; `None` for a preset.
    pub text: Option<String>,
}

/// The rig that the command line names. A file is read once: it may be a pipe.
pub fn read(given: &str) -> Result<GivenRig, Failure> {
    if Rig::PRESETS.contains(&given) || !is_file_name(given) {
        return Ok(GivenRig { rig: Rig::preset(given)?, text: None });
    }
    let path = Path::new(given);
    let remedy = "give a rig file that you may read; `overfly rigs phantom4-rtk` prints one to begin with";
    let text = read_text(path).map_err(|cause| Failure::Read { path: path.to_owned(), cause, remedy })?;
    let rig = Rig::parse(&text).map_err(|cause| Failure::RigFile { path: path.to_owned(), cause })?;
    Ok(GivenRig { rig, text: Some(text) })
}

fn read_text(path: &Path) -> io::Result<String> {
    let bytes = bounded_file::read(path, MAX_RIG_FILE_BYTES as u64)?;
    String::from_utf8(bytes).map_err(|_| io::Error::other("it is not UTF-8 text"))
}

fn is_file_name(given: &str) -> bool {
    given.to_lowercase().ends_with(".toml") || given.contains('/')
}

impl From<RigError> for Failure {
    fn from(error: RigError) -> Self {
        Failure::Rig(error)
    }
}
