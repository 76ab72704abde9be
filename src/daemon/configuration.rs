//! The configuration file of a running daemon.

use std::path::{Path, PathBuf};

use toml::{Table, Value};

use crate::settings::{DEFAULT_TOML, Settings};

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
    Parse {
        path: PathBuf,
        #[source]
        cause: Box<toml::de::Error>,
    },
}

/// Reads settings from `path`; keys that the file leaves out have their defaults.
pub fn read(path: &Path) -> Result<Settings, ConfigurationError> {
    let text = std::fs::read_to_string(path).map_err(|cause| ConfigurationError::Read { path: path.into(), cause })?;
    parse(&text).map_err(|cause| ConfigurationError::Parse { path: path.into(), cause: Box::new(cause) })
}

fn parse(text: &str) -> Result<Settings, toml::de::Error> {
    let mut settings: Table = toml::from_str(DEFAULT_TOML)?;
    merge(&mut settings, toml::from_str(text)?);
    Value::Table(settings).try_into()
}

fn merge(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => merge(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_that_are_left_out_keep_their_defaults() {
        let settings = parse("[daemon]\nmemory_budget_mb = 7\n").unwrap();
        let mut expected = Settings::default();
        expected.daemon.memory_budget_mb = 7;
        assert_eq!(settings, expected);
        assert_eq!(parse("").unwrap(), Settings::default());
    }

    #[test]
    fn a_key_that_does_not_exist_is_named() {
        let message = parse("[daemon]\nbudget = 7\n").unwrap_err().to_string();
        assert!(message.contains("budget"), "{message}");
    }
}
