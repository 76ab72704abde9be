//! overfly plans one continuous flight of a camera drone that captures a city block for 3D reconstruction, and replans when the
//! scene's proxy is edited.
//!
//! The modules stand in the order of the data: a scene file becomes a [`scene::Scene`], the scene becomes surface samples and
//! viewpoints, these become the view information field, the field feeds the search, the search ends in a flight plan. Everything
//! up to [`session`] is a pure core: no I/O, no clock, no environment, no interprocess communication. `ARCHITECTURE.md` draws the map.

#![allow(rustdoc::private_intra_doc_links, reason = "room descriptions name their private parts for readers of the source")]

pub mod fingerprint;
pub mod settings;
pub mod stop;

pub mod baseline;
pub mod bound;
pub mod camera;
pub mod coverage;
pub mod field;
pub mod frame;
pub mod planner;
pub mod quality;
pub mod refine;
pub mod reproduction;
pub mod scene;
pub mod search;
pub mod session;
pub mod surface;
pub mod trajectory;

pub mod autopilot;
pub mod cli;
pub mod daemon;
pub mod mission;
pub mod snapshot;
