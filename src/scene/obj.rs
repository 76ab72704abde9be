//! Later.
use super::proxy::Scene;
use super::read::ImportError;
use super::report::ImportReport;
use crate::settings::ProxySettings;

pub(crate) fn read(file: &str, _bytes: &[u8], _settings: &ProxySettings) -> Result<(Scene, ImportReport), ImportError> {
    Err(ImportError::UnknownFormat { file: file.into(), found: "a format that is not read yet".into() })
}
