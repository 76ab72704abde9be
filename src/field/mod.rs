//! The view information field (paper, section 4.3): which samples can be seen from where.
//!
//! The field stores visibility alone, one bit for a viewpoint and a sample within reach of it. Disks and, for directed cameras, the frustum are
//! computed exactly at the queried pose: masks interpolated between viewpoints would be wrong by 3 to 6 points of r, visibility of
//! the nearest viewpoint by 1.6.

mod build;
mod lookup;
mod lost;
mod outside;
mod rows;
mod strips;
mod survey;
mod tiles;
mod update;
mod viewpoints;

pub use build::{Outlines, counts};
pub use lookup::Lookup;
pub use outside::outside;
pub use rows::Place;
pub use strips::{Strip, Viewpoints};
pub use survey::{Changes, Cleared, FieldError, FieldStorage, Findings, HeapField, Snapshot, Survey};
pub use tiles::Tile;
pub use viewpoints::{Cell, Lattice, Site, Viewpoint, cells, choose_spacing_m, fill, sites, sites_after};
