//! The scene room: readers by format, the proxy, its repairs, its edits and the distances to it.

pub mod clearance;
pub mod edit;
pub mod proxy;

pub use proxy::{NoFlyZone, Scene, Shape, Structure, StructureId, Triangle};
