//! Blocking client of the overfly daemon.
//!
//! ```no_run
//! use std::time::Duration;
//! use overfly_client::{Client, Domain, PlanOrder, ReadOrder, SceneSource};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let client = Client::connect(&Domain::new("overfly")?, Duration::from_secs(2))?;
//! let loaded = client.load(SceneSource::Path("town.geojson".into()), None, &mut |_| {})?;
//! let order = PlanOrder { rig: "phantom4-rtk".into(), ..Default::default() };
//! let plan = client.plan(&loaded.scene, &order, &mut |note| println!("{:.1} %", note.coverage_percent))?;
//! println!("{} waypoints", plan.table().waypoints.len());
//! # Ok(())
//! # }
//! ```
//!
//! The order names a rig preset, or carries the content of a rig file (`PlanOrder::rig_file`); `overfly rigs NAME` prints one to begin with.
//!
//! A [`Client`] is for one thread at a time; connect once more for another. Fields are read where the daemon built them
//! ([`FieldMap`]), plans are copied ([`PlanMessage`]).

pub mod bench;
mod client;
mod error;
mod field;
mod link;
mod plan;
mod status;

pub use client::{Client, Edited, SceneSource};
pub use error::ClientError;
pub use field::FieldMap;
pub use overfly_wire::{
    Domain, DomainError, EditOrder, FlightReport, Loaded, PlanOrder, PlanSummary, ProgressNote, ReadOrder, RefusalCode,
    SceneChanges, SceneState, SceneStatus, ShapeOrder, Stage, Status, StructureInfo, StructureKind, Updated, ZoneInfo,
};
pub use plan::{PlanMessage, PlanWatch};
pub use status::StatusFeed;
