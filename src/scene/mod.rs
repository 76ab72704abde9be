//! The scene room: readers by format, the proxy, its repairs, its edits and the distances to it.
//!
//! [`read()`] turns the bytes of a file into a [`Scene`] and an [`ImportReport`]; [`generate_block`] makes a scene from a seed.

pub mod bounds;
pub mod proxy;
pub mod solid;
pub mod terrain;

pub mod anchor;
pub mod read;
pub mod report;

mod cityjson;
mod close;
mod crs;
mod faces;
mod features;
mod file_name;
mod footprint;
mod geojson;
mod geometry;
mod gltf_file;
mod heights;
mod hierarchy;
mod json;
mod locate;
mod meshes;
mod names;
mod neighbours;
mod no_fly;
mod obj;
mod orient;
mod osm_pbf;
mod ply;
mod raster;
mod stl;
mod zone;

pub mod generate;
pub mod write;

pub mod differences;
pub mod edit;
pub mod update;

pub mod degrade;

mod boxes;
pub mod clearance;
mod distance;
pub mod free_space;

pub use bounds::Bounds;
pub use file_name::{ENDINGS, ground_beside};
pub use generate::{BlockSettings, generate_block, ny1_size};
pub use proxy::{NoFlyZone, Scene, Shape, Structure, StructureId, Triangle, ZoneSource};
pub use raster::{Source, Watched};
pub use read::{GroundFile, ImportError, KNOWN_FORMATS, is_cloud, read, read_anchored, read_cloud, read_over_ground};
pub use report::{ImportReport, ItemKind, Meaning, Place, ReportItem};
pub use terrain::{TERRAIN_NAME, Terrain};
pub use write::to_geojson;
