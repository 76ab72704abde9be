//! What the daemon knows of each scene. Only the main thread touches it.

use std::sync::Arc;
use std::time::Instant;

use overfly_table::{Block, FieldTable, PlanTable};
use overfly_wire::{Header, PlanOrder, PlanSummary, SceneState, SceneStatus, StructureInfo};

use super::field_channel::FieldChannel;
use super::jobs::Assignment;
use super::ledger::Ticket;
use crate::session::{Session, Snapshot};

/// One scene: what is published of it, what is being made, and what comes after that.
pub struct Slot {
    pub channel: Arc<FieldChannel>,
    /// The scene with all its edits, also those whose field is still being built. `None` while it is loaded for the first time.
    pub session: Option<Session>,
    pub current: Option<Current>,
    pub work: Option<Work>,
    /// The search that starts when the field is ready.
    pub queued: Option<Queued>,
    /// The order of the last search that got under way: an edit is followed by a plan of the same order.
    pub last_order: Option<PlanOrder>,
    pub last_plan: Option<LastPlan>,
}

/// The field that clients see, and the scene it was built of.
pub struct Current {
    pub session: Session,
    pub snapshot: Snapshot,
    pub epoch: u64,
    pub field_bytes: u64,
    pub figures: FieldFigures,
}

/// Figures of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldFigures {
    pub structures: u64,
    pub samples: u64,
    pub exposed: u64,
    pub viewpoints: u64,
    pub capturable_percent: f64,
}

/// A running job of a scene.
pub struct Work {
    pub assignment: Assignment,
    pub task: Task,
}

/// What a job is for.
pub enum Task {
    /// The field of a scene that was just read.
    Load(Box<Load>),
    /// The field after an edit.
    Rebuild,
    Search(Search),
}

/// A load that waits for its field.
pub struct Load {
    pub ticket: Ticket,
    pub report_json: String,
    pub report_lines: Vec<String>,
    pub read_s: f64,
    pub taken_up: Instant,
}

/// A search and who asked for it.
pub struct Search {
    pub ticket: Ticket,
    pub order: PlanOrder,
}

/// A search that waits for a field.
pub struct Queued {
    pub ticket: Ticket,
    pub order: PlanOrder,
    pub taken_up: Instant,
}

/// The plan that was published last.
pub struct LastPlan {
    pub header: Header,
    pub table: Vec<Block>,
}

impl Slot {
    pub fn new(channel: Arc<FieldChannel>) -> Self {
        Self { channel, session: None, current: None, work: None, queued: None, last_order: None, last_plan: None }
    }

    pub fn state(&self) -> SceneState {
        match &self.work {
            None => SceneState::Idle,
            Some(Work { task: Task::Search(_), .. }) => SceneState::Planning,
            Some(_) => SceneState::Building,
        }
    }

    pub fn status(&self, name: &str) -> SceneStatus {
        let figures = self.current.as_ref().map(|current| current.figures);
        SceneStatus {
            name: name.into(),
            revision: self.session.as_ref().map_or(0, Session::revision),
            structures: figures.map_or(0, |figures| figures.structures),
            samples: figures.map_or(0, |figures| figures.samples),
            viewpoints: figures.map_or(0, |figures| figures.viewpoints),
            capturable_percent: figures.map_or(0.0, |figures| figures.capturable_percent),
            field_bytes: self.current.as_ref().map_or(0, |current| current.field_bytes),
            state: self.state(),
            plan: self.last_plan.as_ref().and_then(LastPlan::summary),
        }
    }
}

impl Current {
    pub fn structures(&self) -> Vec<StructureInfo> {
        let table = self.snapshot.field();
        let info = |row: &overfly_table::field::StructureRow| StructureInfo {
            id: row.id,
            name: table.name(row).into_owned(),
            base_m: row.base_m,
            top_m: row.top_m,
            samples: row.samples.into(),
        };
        table.structures.iter().map(info).collect()
    }
}

impl FieldFigures {
    pub fn of(table: &FieldTable<'_>) -> Self {
        let threshold = table.facts.threshold_cells;
        let exposed = table.samples.iter().filter(|sample| sample.exposed != 0).count();
        let capturable = table
            .samples
            .iter()
            .zip(table.ceilings)
            .filter(|(sample, ceiling)| sample.exposed != 0 && u32::from(**ceiling) > threshold)
            .count();
        Self {
            structures: table.structures.len() as u64,
            samples: table.samples.len() as u64,
            exposed: exposed as u64,
            viewpoints: table.viewpoints.len() as u64,
            capturable_percent: 100.0 * capturable as f64 / exposed.max(1) as f64,
        }
    }
}

impl LastPlan {
    fn summary(&self) -> Option<PlanSummary> {
        let facts = *PlanTable::open(&self.table).ok()?.facts;
        Some(PlanSummary {
            revision: facts.revision,
            seed: facts.seed,
            waypoints: facts.metrics.waypoints,
            length_m: facts.metrics.length_m,
            flight_s: facts.metrics.flight_s,
            coverage_percent: facts.metrics.coverage_percent,
            total_s: facts.total_s,
        })
    }
}
