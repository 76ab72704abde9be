//! Changes of a scene. The names of variants and fields are also those of files with edits.

use serde::{Deserialize, Serialize};

use super::check::{check_coordinate, check_name, invalid};
use super::{MAX_OUTLINE_CORNERS, Refusal};

/// Most edits that are made together.
pub const MAX_EDITS: usize = 1000;

/// Most triangles of a mesh, and most vertices.
pub const MAX_MESH_TRIANGLES: usize = 20_000;
pub const MAX_MESH_VERTICES: usize = 60_000;

/// Shortest and longest side of an obstacle, m.
pub const OBSTACLE_SIDE_M: [f64; 2] = [0.01, 10_000.0];

/// A change of one structure, which is given by its name or its id in hexadecimal, or of one no-fly zone, which is given by its name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
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
    /// A new structure.
    Add {
        name: String,
        shape: ShapeOrder,
    },
    /// Another shape under the same name.
    Replace {
        structure: String,
        shape: ShapeOrder,
    },
    /// Metres east and north.
    Move {
        structure: String,
        by_m: [f64; 2],
    },
    /// A new no-fly zone. The outline is one ring in the local frame, m, that does not cross itself; heights are above the ground.
    AddZone {
        name: String,
        outline_m: Vec<[f64; 2]>,
        #[serde(default)]
        floor_m: f64,
        /// `None` for a zone without a ceiling.
        #[serde(default)]
        ceiling_m: Option<f64>,
    },
    RemoveZone {
        name: String,
    },
}

/// What a structure is, metres in the local frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ShapeOrder {
    /// Straight walls over an outline of one ring; its first corner is not repeated.
    Prism {
        outline_m: Vec<[f64; 2]>,
        #[serde(default)]
        base_m: f64,
        top_m: f64,
    },
    /// A surface of triangles, each of three vertices by their numbers from 0, counter-clockwise seen from outside; it need not be closed.
    Mesh { vertices_m: Vec<[f64; 3]>, triangles: Vec<[u32; 3]> },
    /// An upright box that flights keep clear of and that hides what is behind it, but that nobody wants to capture: what a sensor on board reports.
    /// The first side is turned by `yaw_deg` counter-clockwise from east.
    Obstacle {
        centre_m: [f64; 3],
        size_m: [f64; 3],
        #[serde(default)]
        yaw_deg: f64,
    },
}

impl EditOrder {
    /// A new prism.
    pub fn add_prism(name: impl Into<String>, outline_m: Vec<[f64; 2]>, base_m: f64, top_m: f64) -> Self {
        Self::Add { name: name.into(), shape: ShapeOrder::Prism { outline_m, base_m, top_m } }
    }

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
            EditOrder::Add { name, shape } | EditOrder::Replace { structure: name, shape } => {
                check_name("structure", name)?;
                shape.check(name)
            }
            EditOrder::AddZone { name, outline_m, floor_m, ceiling_m } => {
                check_name("zone", name)?;
                check_outline(name, outline_m)?;
                check_coordinate("floor", *floor_m)?;
                ceiling_m.map_or(Ok(()), |ceiling_m| {
                    check_coordinate("ceiling", ceiling_m)?;
                    check_order(name, "floor", *floor_m, "ceiling", ceiling_m)
                })
            }
            EditOrder::RemoveZone { name } => check_name("zone", name),
        }
    }
}

impl ShapeOrder {
    fn check(&self, name: &str) -> Result<(), Refusal> {
        match self {
            ShapeOrder::Prism { outline_m, base_m, top_m } => {
                check_outline(name, outline_m)?;
                check_coordinate("base", *base_m)?;
                check_coordinate("top", *top_m)?;
                check_order(name, "base", *base_m, "top", *top_m)
            }
            ShapeOrder::Mesh { vertices_m, triangles } => check_mesh(name, vertices_m, triangles),
            ShapeOrder::Obstacle { centre_m, size_m, yaw_deg } => {
                centre_m.iter().try_for_each(|value| check_coordinate("centre", *value))?;
                let [least_m, most_m] = OBSTACLE_SIDE_M;
                if let Some(side_m) = size_m.iter().find(|side| !(least_m..=most_m).contains(*side)) {
                    return invalid(format!("a side of {name:?} is {side_m} m; give {least_m} to {most_m} m"));
                }
                if !(-360.0..=360.0).contains(yaw_deg) {
                    return invalid(format!("the yaw of {name:?} is {yaw_deg}; give -360 to 360 degrees"));
                }
                Ok(())
            }
        }
    }
}

/// Judges a list of edits that are to be made together.
pub(super) fn check_edits(edits: &[EditOrder]) -> Result<(), Refusal> {
    if !(1..=MAX_EDITS).contains(&edits.len()) {
        return invalid(format!("{} edits were to be made together; give 1 to {MAX_EDITS}", edits.len()));
    }
    for (index, edit) in edits.iter().enumerate() {
        edit.check().map_err(|refusal| refusal.of_edit(index, edits.len()))?;
    }
    Ok(())
}

fn check_outline(name: &str, outline_m: &[[f64; 2]]) -> Result<(), Refusal> {
    if !(3..=MAX_OUTLINE_CORNERS).contains(&outline_m.len()) {
        let corners = outline_m.len();
        return invalid(format!("the outline of {name:?} has {corners} corners; give 3 to {MAX_OUTLINE_CORNERS}"));
    }
    outline_m.iter().flatten().try_for_each(|value| check_coordinate("outline", *value))
}

fn check_order(name: &str, low: &str, low_m: f64, high: &str, high_m: f64) -> Result<(), Refusal> {
    if low_m >= high_m {
        return invalid(format!("the {low} of {name:?} at {low_m} m is not below its {high} at {high_m} m"));
    }
    Ok(())
}

fn check_mesh(name: &str, vertices_m: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(), Refusal> {
    if !(1..=MAX_MESH_TRIANGLES).contains(&triangles.len()) || vertices_m.len() > MAX_MESH_VERTICES {
        let (count, vertices) = (triangles.len(), vertices_m.len());
        return invalid(format!(
            "the mesh of {name:?} has {count} triangles and {vertices} vertices; give 1 to {MAX_MESH_TRIANGLES} triangles and at most \
             {MAX_MESH_VERTICES} vertices: simplify it, or split it into several structures"
        ));
    }
    vertices_m.iter().flatten().try_for_each(|value| check_coordinate("mesh", *value))?;
    match triangles.iter().flatten().find(|index| **index as usize >= vertices_m.len()) {
        Some(index) => {
            invalid(format!("the mesh of {name:?} refers to vertex {index} of {}; vertices are counted from 0", vertices_m.len()))
        }
        None => Ok(()),
    }
}
