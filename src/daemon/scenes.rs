//! What the daemon knows of each scene. Only the main thread touches it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use overfly_table::{Block, FieldTable};
use overfly_wire::{Header, PlanOrder, PlanSummary, SceneState, SceneStatus, StructureInfo, ZoneInfo};

use super::convert;
use super::edits::{Batch, Edits};
use super::field_channel::FieldChannel;
use super::flown::Flown;
use super::jobs::{Assignment, FlightBefore, JobId};
use super::ledger::Ticket;
use super::ports::{Ports, SendError};
use crate::camera::Pose;
use crate::mission::plan_table;
use crate::planner::PlanOptions;
use crate::scene::anchor::Anchor;
use crate::session::{Session, Snapshot};
use crate::trajectory::known::SafeFlight;
use crate::trajectory::plan::{Plan, RunTimes};
use crate::trajectory::record::Record;

/// One scene: what is published of it, what is being made, and what comes after that. What is being made changes nothing of what
/// is published before it stands.
pub struct Slot {
    pub channel: Arc<FieldChannel>,
    /// `None` while the scene is loaded for the first time.
    pub current: Option<Current>,
    /// Scenes that were read under this name and whose fields are being built; the newest request wins.
    pub loads: Vec<Load>,
    pub edits: Edits,
    pub search: Option<Search>,
    /// The search that starts when nothing is being built any more.
    pub queued: Option<Queued>,
    pub orders: Orders,
    pub plans: Plans,
    /// The flight that is under way; `None` when nobody has reported one.
    pub flown: Option<Flown>,
    /// What became of the last search, when that is not simply a plan as it was ordered.
    pub remark: Option<String>,
}

/// What a search follows from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    Request,
    /// An edit, after which the scene is planned as it was ordered before.
    Edit,
}

/// What an edit is followed by.
#[derive(Default)]
pub struct Orders {
    /// The order of the last search that was accepted: an edit is followed by a plan of the same order.
    pub last: Option<PlanOrder>,
    /// The order of the last search that gave a plan.
    proven: Option<PlanOrder>,
}

/// The field that clients see, and the scene it was built of.
pub struct Current {
    pub session: Session,
    /// The load that the scene came with.
    pub request: JobId,
    /// Where its frame lies in its file.
    pub anchor: Option<Anchor>,
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

/// What a job is for.
pub enum Task {
    Load(Load),
    Rebuild(Batch),
    Search(Box<Search>),
}

/// The field of a scene that was just read.
pub struct Load {
    pub assignment: Assignment,
    /// Number of the request: of two loads of one name the later request wins, whichever file was read first.
    pub request: JobId,
    pub ticket: Ticket,
    pub anchor: Option<Anchor>,
    pub report_json: String,
    pub report_lines: Vec<String>,
    pub read_s: f64,
    pub taken_up: Instant,
}

/// A running search and who asked for it.
pub struct Search {
    pub assignment: Assignment,
    pub ticket: Ticket,
    pub order: PlanOrder,
    pub cause: Cause,
}

/// A search that waits for a field.
pub struct Queued {
    pub ticket: Ticket,
    pub order: PlanOrder,
    pub cause: Cause,
    pub taken_up: Instant,
    /// Time that building the field took, s.
    pub field_s: f64,
}

/// The plans that were published, the last one behind all others: an aircraft may fly an earlier one.
#[derive(Default)]
pub struct Plans(VecDeque<LastPlan>);

/// So many plans are kept: more than are published while an aircraft takes over one of them.
const KEPT_PLANS: usize = 32;

/// A plan that was published.
pub struct LastPlan {
    pub header: Header,
    pub plan: Plan,
    pub times: RunTimes,
    /// What its images see; the search that goes on with it takes it along.
    pub record: Option<Record>,
    /// The flight as it was found safe.
    pub safe: Option<Arc<SafeFlight>>,
}

impl Plans {
    pub fn last(&self) -> Option<&LastPlan> {
        self.0.back()
    }

    pub fn of_epoch(&self, epoch: u64) -> Option<&LastPlan> {
        self.0.iter().find(|plan| plan.header.epoch == epoch)
    }

    /// The record of the last plan, for the search that goes on with it.
    pub fn take_record(&mut self) -> Option<Record> {
        self.0.back_mut().and_then(|plan| plan.record.take())
    }

    /// The newest plan of this revision or an earlier one.
    pub fn up_to(&self, revision: u64) -> Option<&LastPlan> {
        self.0.iter().rev().find(|plan| plan.plan.scene.revision <= revision)
    }

    /// Adds a plan; the oldest ones go, but for the one that is `flown`. Nobody goes on with the record of any other but the last.
    pub fn publish(&mut self, plan: LastPlan, flown: Option<u64>) {
        if let Some(before) = self.0.back_mut() {
            (before.record, before.safe) = (None, None);
        }
        self.0.push_back(plan);
        if self.0.len() > KEPT_PLANS {
            let oldest = self.0.iter().position(|plan| Some(plan.header.epoch) != flown);
            oldest.and_then(|index| self.0.remove(index));
        }
    }
}

impl Orders {
    pub fn accept(&mut self, order: &PlanOrder) {
        self.last = Some(order.clone());
    }

    pub fn prove(&mut self, order: PlanOrder) {
        self.proven = Some(order);
    }

    /// `order` gave no plan, so that it shall not follow an edit unless it gave one before.
    pub fn take_back(&mut self, order: &PlanOrder) {
        if self.last.as_ref() == Some(order) {
            self.last = self.proven.clone();
        }
    }
}

impl Slot {
    pub fn publish(&mut self, plan: LastPlan) {
        self.plans.publish(plan, self.flown.as_ref().map(Flown::epoch));
    }

    pub fn new(channel: Arc<FieldChannel>) -> Self {
        Self {
            channel,
            current: None,
            loads: Vec::new(),
            edits: Edits::default(),
            search: None,
            queued: None,
            orders: Orders::default(),
            plans: Plans::default(),
            flown: None,
            remark: None,
        }
    }

    /// What an edit is followed by, where the scene has been planned: the last plan, as far as it can be flown there.
    pub fn flight_before(&self) -> Option<FlightBefore> {
        let (order, last) = (self.orders.last.as_ref()?, self.plans.last()?);
        Some(FlightBefore { options: self.options(order, Cause::Edit), safe: last.safe.clone() })
    }

    /// What an order asks of the planner: to go on with the last plan after an edit, and from where an aircraft is in the air.
    pub fn options(&self, order: &PlanOrder, cause: Cause) -> PlanOptions {
        let mut options = convert::plan_options(order).expect("orders are checked before they are accepted");
        if cause == Cause::Edit {
            options.earlier = self.plans.last().map(LastPlan::waypoints);
        }
        if let Some(flown) = &self.flown {
            flown.go_on(&mut options, &self.plans);
        }
        options
    }

    /// A field is being built.
    pub fn is_building(&self) -> bool {
        !self.loads.is_empty() || self.edits.are_under_way()
    }

    pub fn state(&self) -> SceneState {
        match (self.is_building(), &self.search) {
            (true, _) => SceneState::Building,
            (false, Some(_)) => SceneState::Planning,
            (false, None) => SceneState::Idle,
        }
    }

    /// Takes what `job` was for out of the slot.
    pub fn take_task(&mut self, job: JobId) -> Option<Task> {
        if let Some(index) = self.loads.iter().position(|load| load.assignment.job == job) {
            return Some(Task::Load(self.loads.remove(index)));
        }
        if let Some(batch) = self.edits.building.take_if(|batch| batch.assignment.job == job) {
            return Some(Task::Rebuild(batch));
        }
        self.search.take_if(|search| search.assignment.job == job).map(|search| Task::Search(Box::new(search)))
    }

    /// Who waits for `job`.
    pub fn waiting_for(&self, job: JobId) -> Vec<Ticket> {
        let load = self.loads.iter().find(|load| load.assignment.job == job).map(|load| load.ticket);
        let batch = self.edits.building.iter().filter(|batch| batch.assignment.job == job);
        let edits =
            batch.flat_map(|batch| batch.edits.iter().map(|edit| edit.ticket).chain(self.queued.iter().map(|q| q.ticket)));
        let search = self.search.iter().filter(|search| search.assignment.job == job).map(|search| search.ticket);
        load.into_iter().chain(edits).chain(search).collect()
    }

    /// Asks everything that runs for this scene to come to its end.
    pub fn stop(&self) {
        let loads = self.loads.iter().map(|load| &load.assignment);
        let batch = self.edits.building.iter().map(|batch| &batch.assignment);
        let search = self.search.iter().map(|search| &search.assignment);
        loads.chain(batch).chain(search).for_each(|assignment| assignment.stop.stop());
    }

    pub fn status(&self, name: &str) -> SceneStatus {
        let figures = self.current.as_ref().map(|current| current.figures);
        let revision = self.current.as_ref().map_or(0, |current| current.session.revision());
        SceneStatus {
            name: name.into(),
            revision,
            structures: figures.map_or(0, |figures| figures.structures),
            samples: figures.map_or(0, |figures| figures.samples),
            viewpoints: figures.map_or(0, |figures| figures.viewpoints),
            capturable_percent: figures.map_or(0.0, |figures| figures.capturable_percent),
            field_bytes: self.current.as_ref().map_or(0, |current| current.field_bytes),
            state: self.state(),
            plan: self.plans.last().map(|plan| plan.summary(revision)),
            remark: self.remark.clone(),
        }
    }
}

impl Current {
    pub fn structures(&self) -> Vec<StructureInfo> {
        let table = self.snapshot.field();
        let structures = self.session.scene().structures.iter().zip(table.structures);
        structures.map(|(structure, row)| convert::structure_info(structure, row.samples.into())).collect()
    }

    pub fn zones(&self) -> Vec<ZoneInfo> {
        self.session.scene().zones.iter().map(convert::zone_info).collect()
    }
}

impl FieldFigures {
    pub fn of(table: &FieldTable<'_>) -> Self {
        let exposed = table.samples.iter().filter(|sample| sample.exposed != 0).count();
        let capturable = (0..table.samples.len()).filter(|&i| table.is_capturable(i)).count();
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
    pub fn publish(&self, ports: &Ports) -> Result<(), SendError> {
        let write = |blocks: &mut [Block]| plan_table::write(&self.plan, &self.times, blocks);
        ports.publish_plan(self.header, plan_table::blocks(&self.plan), write)
    }

    /// The waypoints that the next flight goes on with.
    pub fn waypoints(&self) -> Vec<Pose> {
        self.plan.poses()
    }

    /// The first waypoint of another plan that is not as in this one.
    pub fn first_changed(&self, other: &Plan) -> u64 {
        let same = self.plan.waypoints.iter().zip(&other.waypoints).take_while(|(own, other)| own == other);
        same.count() as u64
    }

    /// Its figures in a scene that has this revision now.
    fn summary(&self, scene_revision: u64) -> PlanSummary {
        let Self { plan, times, .. } = self;
        PlanSummary {
            revision: plan.scene.revision,
            // A plan that comes before the field of its scene is newer.
            is_stale: plan.scene.revision < scene_revision,
            seed: plan.seed,
            waypoints: plan.waypoints.len() as u64,
            length_m: plan.metrics.length_m,
            flight_s: plan.metrics.flight_s,
            coverage_percent: plan.metrics.coverage_percent,
            total_s: times.total_s,
        }
    }
}
