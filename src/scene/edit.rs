//! Edits of the proxy, one structure at a time.

use geo::Polygon;

use super::proxy::{Scene, StructureId};

/// One change of the proxy.
#[derive(Clone, Debug, PartialEq)]
pub enum Edit {
    /// Heights above the structure's base are stretched so that its top rises by `by_m` (> 0).
    Raise {
        id: StructureId,
        by_m: f64,
    },
    /// As [`Edit::Raise`], downwards; the structure must stay at least 1 m tall.
    Lower {
        id: StructureId,
        by_m: f64,
    },
    Remove {
        id: StructureId,
    },
    /// A new prism called `name`.
    Add {
        name: String,
        footprint: Polygon<f64>,
        base_m: f64,
        top_m: f64,
    },
    /// Moves the structure horizontally, metres east and north.
    Move {
        id: StructureId,
        by_m: [f64; 2],
    },
}

/// The box that an edit has touched, metres in the local frame: what stood there before together with what stands there now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirtyRegion {
    pub min: nalgebra::Point3<f64>,
    pub max: nalgebra::Point3<f64>,
}

/// Why an edit was refused. The scene is unchanged.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum EditError {
    #[error("scene {scene:?} has no structure {id}; list them with `overfly status --scene {scene}`")]
    UnknownStructure { scene: String, id: StructureId },
}

impl Scene {
    /// The scene after `edit`, and the region in which it differs from this one.
    pub fn edited(&self, _edit: &Edit) -> Result<(Scene, DirtyRegion), EditError> {
        unimplemented!("scene room")
    }
}
