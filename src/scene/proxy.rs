//! The proxy: what is known of the scene before the flight (paper, section 3).

use std::fmt;
use std::sync::Arc;

use geo::{Coord, LineString, MultiPolygon, Polygon};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::terrain::Terrain;
use crate::fingerprint::fnv1a;
use crate::frame::LocalFrame;

/// A triangle by its corners, counter-clockwise seen from outside, metres in the local frame.
pub type Triangle = [Point3<f64>; 3];

/// Identity of a structure: stable between loads of the same file and across edits. It is the hash of the structure's name.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct StructureId(pub u64);

impl StructureId {
    /// The id of the structure called `name` (the same on every machine and in every version).
    pub fn of_name(name: &str) -> Self {
        Self(fnv1a(name.as_bytes()))
    }
}

impl fmt::Display for StructureId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// The rough scene: structures on the ground, and the zones that must not be entered. The ground is the plane z = 0 of the local frame, or the
/// terrain among the structures, whose lowest place z = 0 is.
///
/// Structures are sorted by id and ids are unique, so that two scenes with the same structures are the same value whatever the
/// order in which they were made.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    pub name: String,
    pub frame: LocalFrame,
    pub structures: Vec<Arc<Structure>>,
    pub zones: Vec<NoFlyZone>,
}

/// One building, building part, bridge, tower or obstacle: the unit of editing and of sampling.
#[derive(Clone, Debug, PartialEq)]
pub struct Structure {
    pub id: StructureId,
    /// The id in the file where it has one, else a derived one (`feature-17`).
    pub name: String,
    pub shape: Shape,
}

impl Structure {
    /// Whether its surface is to be captured.
    pub fn is_captured(&self) -> bool {
        matches!(self.shape, Shape::Prism { .. } | Shape::Mesh { .. })
    }

    /// The ground, where this structure is that.
    pub fn terrain(&self) -> Option<&Arc<Terrain>> {
        match &self.shape {
            Shape::Terrain(terrain) => Some(terrain),
            _ => None,
        }
    }
}

/// The geometry of a structure, metres in the local frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A footprint with holes, swept from `base_m` to `top_m` (heights above the ground plane, `base_m < top_m`).
    /// Exterior rings run counter-clockwise, holes clockwise; rings do not cross.
    Prism { footprint: MultiPolygon<f64>, base_m: f64, top_m: f64 },
    /// A surface of triangles; it need not be closed.
    Mesh { triangles: Vec<Triangle> },
    /// Something in the way, as a sensor on board reports it: a solid like that of [`Shape::Prism`], which hides what is behind it and which flights
    /// keep clear of, but whose surface nobody wants to capture. It has no samples and does not widen the flight limits.
    Obstacle { footprint: MultiPolygon<f64>, base_m: f64, top_m: f64 },
    /// The ground where it is not flat; a scene has one at most. It hides what is behind it, flights keep clear of it and their least altitude above it,
    /// and it has no samples. Edits leave it alone.
    Terrain(Arc<Terrain>),
}

impl Shape {
    /// The obstacle that fills an upright box. `size_m` are its sides along its own axes, of which the first is turned by `yaw_rad` counter-clockwise
    /// from east; what would lie below the ground is left out.
    pub fn obstacle_box(centre: Point3<f64>, size_m: [f64; 3], yaw_rad: f64) -> Self {
        let (sin, cos) = libm::sincos(yaw_rad);
        let [along, across, up] = size_m.map(|side| side / 2.0);
        let corner = |(a, b): (f64, f64)| Coord { x: centre.x + a * cos - b * sin, y: centre.y + a * sin + b * cos };
        let ring = [(-along, -across), (along, -across), (along, across), (-along, across), (-along, -across)].map(corner);
        let footprint = MultiPolygon(vec![Polygon::new(LineString::from(ring.to_vec()), Vec::new())]);
        Self::Obstacle { footprint, base_m: (centre.z - up).max(0.0), top_m: centre.z + up }
    }
}

/// A polygon that the drone must not enter between two heights above the ground below: the terrain, or the plane z = 0. A zone without a ceiling has
/// `ceiling_m` = [`f64::MAX`]. The outline ends far outside of where any flight goes; that of a zone wholly outside is empty.
#[derive(Clone, Debug, PartialEq)]
pub struct NoFlyZone {
    pub name: String,
    pub outline: MultiPolygon<f64>,
    pub floor_m: f64,
    pub ceiling_m: f64,
    pub source: ZoneSource,
}

/// Where a zone of a scene comes from. A new version of the scene's file takes away only what came with the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZoneSource {
    File,
    Edit,
    Configuration,
}
