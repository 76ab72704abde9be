//! The configuration file of a running daemon.

use std::fs::File;
use std::io::{self, Read};
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

/// A larger file is no configuration: the built-in one has about ten thousand bytes.
const MOST_BYTES: u64 = 1_000_000;

/// Reads settings from `path`; keys that the file leaves out have their defaults.
pub fn read(path: &Path) -> Result<Settings, ConfigurationError> {
    let text = read_text(path).map_err(|cause| ConfigurationError::Read { path: path.into(), cause })?;
    Settings::parse(&text).map_err(|cause| ConfigurationError::Wrong { path: path.into(), cause: Box::new(cause) })
}

/// No more is read than a configuration may have: a device or a pipe may never end.
fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    File::open(path)?.take(MOST_BYTES + 1).read_to_string(&mut text)?;
    if text.len() as u64 > MOST_BYTES {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("it has more than {MOST_BYTES} bytes")));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_end_is_refused() {
        let refused = read(Path::new("/dev/zero")).unwrap_err();
        assert!(matches!(&refused, ConfigurationError::Read { .. }), "{refused}");
        assert!(refused.to_string().contains("it has more than 1000000 bytes"), "{refused}");
    }
}
