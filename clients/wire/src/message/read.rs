//! How a scene file is to be read.

use serde::{Deserialize, Serialize};

use super::Refusal;
use super::check::{MAX_COORDINATE_M, check_name, invalid};

/// How a scene file is read where it does not say so itself, or says it wrongly. What is not given is as the daemon's configuration has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReadOrder {
    /// Reference system of the coordinates, EPSG code; 0 for what the file says.
    pub epsg: Option<u32>,
    /// Axis of a mesh that points up: `y`, `z` or `file`.
    pub up: Option<String>,
    /// Metres in a unit of a mesh.
    pub unit_m: Option<f64>,
    /// Added to a mesh's coordinates, m.
    pub offset_m: Option<[f64; 3]>,
    /// Highest level of detail of CityJSON; 0 for the highest that there is.
    pub lod: Option<f64>,
    /// What is done about buildings of unknown height: `neighbours`, `constant` or `drop`.
    pub missing_heights: Option<String>,
    /// Height of a building of which nothing is known, m.
    pub default_height_m: Option<f64>,
}

impl ReadOrder {
    pub(super) fn check(&self) -> Result<(), Refusal> {
        for (what, name) in [("axis", &self.up), ("policy", &self.missing_heights)] {
            name.as_deref().map_or(Ok(()), |name| check_name(what, name))?;
        }
        let numbers =
            [self.unit_m, self.lod, self.default_height_m].into_iter().flatten().chain(self.offset_m.into_iter().flatten());
        match numbers.into_iter().find(|number| number.is_nan() || number.abs() > 100.0 * MAX_COORDINATE_M) {
            Some(number) => invalid(format!(
                "{number} is no number that a file can be read by; give one of at most {:e}",
                100.0 * MAX_COORDINATE_M
            )),
            None => Ok(()),
        }
    }
}
