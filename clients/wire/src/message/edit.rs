//! Changes of a scene.

use serde::{Deserialize, Serialize};

use super::check::{check_coordinate, check_name, invalid};
use super::{MAX_OUTLINE_CORNERS, Refusal};

/// A change of one structure, which is given by its name or its id in hexadecimal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum EditOrder {
    Raise {
        structure: String,
        by_m: f64,
    },
    Lower {
        structure: String,
        by_m: f64,
    },
    Remove {
        structure: String,
    },
    /// A new prism. The outline is one ring in the local frame, m; its first corner is not repeated.
    Add {
        name: String,
        outline_m: Vec<[f64; 2]>,
        base_m: f64,
        top_m: f64,
    },
    /// Metres east and north.
    Move {
        structure: String,
        by_m: [f64; 2],
    },
}
impl EditOrder {
    pub(super) fn check(&self) -> Result<(), Refusal> {
        match self {
            EditOrder::Raise { structure, by_m } | EditOrder::Lower { structure, by_m } => {
                check_name("structure", structure)?;
                check_coordinate("change of height", *by_m)?;
                if *by_m <= 0.0 {
                    return invalid(format!("the change of height is {by_m} m; give a length above 0 and choose raise or lower"));
                }
                Ok(())
            }
            EditOrder::Remove { structure } => check_name("structure", structure),
            EditOrder::Move { structure, by_m } => {
                check_name("structure", structure)?;
                by_m.iter().try_for_each(|value| check_coordinate("shift", *value))
            }
            EditOrder::Add { name, outline_m, base_m, top_m } => {
                check_name("structure", name)?;
                if !(3..=MAX_OUTLINE_CORNERS).contains(&outline_m.len()) {
                    let corners = outline_m.len();
                    return invalid(format!("the outline of {name:?} has {corners} corners; give 3 to {MAX_OUTLINE_CORNERS}"));
                }
                outline_m.iter().flatten().try_for_each(|value| check_coordinate("outline", *value))?;
                check_coordinate("base", *base_m)?;
                check_coordinate("top", *top_m)?;
                if base_m >= top_m {
                    return invalid(format!("the base of {name:?} at {base_m} m is not below its top at {top_m} m"));
                }
                Ok(())
            }
        }
    }
}
