//! What passes between the overfly daemon and its clients.
//!
//! Every message is a sample of 64-byte blocks with a fixed [`Header`] beside it. Control messages carry a short encoded body (see
//! [`message`]); scene files follow their body as bulk; fields and plans are tables of `overfly-table` and have no body. Nothing
//! here knows the planner: domain types are converted at the daemon's border.
//!
//! Whatever arrives was written by another process and may change while it is read. So [`frame::copy`] checks the lengths, copies
//! once and only then decodes, and [`message::Request::check`] judges the copy.

pub mod codec;
pub mod domain;
pub mod en_route;
pub mod frame;
pub mod header;
pub mod memory;
pub mod message;
pub mod segment;
pub mod service;

pub use domain::{Domain, DomainError, DomainLock, LockError};
pub use en_route::FlightReport;
pub use header::{Header, Kind, SCHEMA, WireBlock};
pub use message::{
    EditOrder, Loaded, PlanOrder, PlanSummary, ProgressNote, ReadOrder, Refusal, RefusalCode, Reply, Request, SceneChanges,
    SceneState, SceneStatus, ShapeOrder, Stage, Status, StructureInfo, StructureKind, Updated, ZoneInfo,
};
pub use service::Ipc;
