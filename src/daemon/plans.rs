//! Plans as they are published: the one that was asked for, and those that come before it after an edit.

use overfly_wire::{Header, Kind, Refusal, RefusalCode, Reply};

use super::jobs::{JobId, PlannedFlight};
use super::ledger::Ticket;
use super::ports::{Ports, SendError};
use super::scenes::{LastPlan, Search};
use super::state::Daemon;
use crate::mission::plan_table;
use crate::trajectory::plan::{Plan, RunTimes};

impl Daemon {
    pub(super) fn on_planned(&mut self, ports: &Ports, scene: &str, flight: PlannedFlight, search: Search) {
        let epoch = self.next_epoch();
        let Search { ticket, order, .. } = search;
        if let Some(remark) = &flight.remark {
            tracing::warn!(scene, epoch, remark, "planned otherwise than ordered");
        }
        let remark = flight.remark.clone();
        let sent = self.publish_plan(ports, scene, epoch, Some(ticket), flight);
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.orders.prove(order);
            slot.remark = remark;
        }
        match sent {
            Ok(()) => self.answer(ports, ticket, &Reply::Planned { epoch }, false),
            Err(error) => self.refuse(ports, ticket, Refusal::new(RefusalCode::Memory, error.to_string())),
        }
    }

    /// Publishes what can be flown at once in a scene whose field is still being built. The edit is not made before that stands; but from now on
    /// nobody is to fly what a search finds in the scene as it was.
    pub(super) fn on_safe(&mut self, ports: &Ports, scene: &str, job: JobId, mut flight: PlannedFlight) {
        let building = self.scenes.get(scene).and_then(|slot| slot.edits.building.as_ref());
        if building.is_none_or(|batch| batch.assignment.job != job) {
            return;
        }
        self.supersede_search(ports, scene, "an edit");
        // What its images see has to be looked at, but not again whether it is safe.
        flight.record = self.scenes.get_mut(scene).and_then(|slot| slot.plans.take_record());
        flight.record.iter_mut().for_each(|record| record.flight.clone_from(&flight.safe));
        let epoch = self.next_epoch();
        if let Err(error) = self.publish_plan(ports, scene, epoch, None, flight) {
            tracing::warn!(scene, %error, "the first safe plan was not published");
        }
        self.changed = true;
    }

    /// Edits that are not made may have been followed by a plan already: the one that was flown before them is published again.
    pub(super) fn take_back_plan(&mut self, ports: &Ports, scene: &str) {
        let slot = self.scenes.get(scene);
        let Some((slot, current)) = slot.and_then(|slot| Some((slot, slot.current.as_ref()?))) else { return };
        let revision = current.session.revision();
        let is_ahead = slot.plans.last().is_some_and(|last| last.plan.scene.revision > revision);
        let Some(before) = slot.plans.up_to(revision).filter(|_| is_ahead) else { return };
        let planned = PlannedFlight { plan: before.plan.clone(), times: before.times, record: None, safe: None, remark: None };
        let epoch = self.next_epoch();
        if let Err(error) = self.publish_plan(ports, scene, epoch, None, planned) {
            tracing::warn!(scene, %error, "the plan before edits that were not made was not published again");
        }
    }

    /// Publishes what can be flown so far after an edit. It answers nobody: the plan that was asked for comes later.
    pub(super) fn on_interim(&mut self, ports: &Ports, scene: &str, flight: PlannedFlight) {
        let epoch = self.next_epoch();
        if let Err(error) = self.publish_plan(ports, scene, epoch, None, flight) {
            tracing::warn!(scene, %error, "a plan on the way was not published");
        }
        self.changed = true;
    }

    /// Publishes a plan, for whoever asked for it, and keeps it as the scene's last one.
    fn publish_plan(
        &mut self,
        ports: &Ports,
        scene: &str,
        epoch: u64,
        ticket: Option<Ticket>,
        PlannedFlight { plan, times, record, safe, .. }: PlannedFlight,
    ) -> Result<(), SendError> {
        log_plan(scene, epoch, &plan, &times);
        let before = self.scenes.get(scene).and_then(|slot| slot.plans.last());
        let header = Header {
            instance: self.instance,
            epoch,
            client: ticket.map_or(0, |ticket| ticket.client),
            correlation: ticket.map_or(0, |ticket| ticket.correlation),
            follows: before.map_or(0, |before| before.header.epoch),
            first_changed: before.map_or(0, |before| before.first_changed(&plan)),
            ..Header::new(Kind::Plan)
        };
        let last = LastPlan { header, plan, times, record, safe };
        let sent = last.publish(ports);
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.publish(last);
        }
        sent
    }

    /// Tells everybody that there is no flight in the scene since an edit. The plan before is kept: a later edit may make it safe again.
    pub(super) fn publish_infeasible(&mut self, ports: &Ports, scene: &str, reason: &str) {
        let epoch = self.next_epoch();
        let Some(slot) = self.scenes.get(scene) else { return };
        let revision = slot.current.as_ref().map_or(0, |current| current.session.revision());
        let follows = slot.plans.last().map_or(0, |before| before.header.epoch);
        let header = Header { instance: self.instance, epoch, follows, ..Header::new(Kind::Plan) };
        let table = plan_table::infeasible(scene, revision, reason);
        if let Err(error) = ports.publish_plan(header, table.len(), |blocks| blocks.copy_from_slice(&table)) {
            tracing::warn!(scene, %error, "it was not published that there is no flight");
        }
    }
}

fn log_plan(scene: &str, epoch: u64, plan: &Plan, times: &RunTimes) {
    tracing::info!(
        scene,
        epoch,
        revision = plan.scene.revision,
        seed = plan.seed,
        stop = ?plan.stop,
        coverage_percent = plan.metrics.coverage_percent,
        length_m = plan.metrics.length_m,
        waypoints = plan.waypoints.len(),
        search_s = times.search_s,
        total_s = times.total_s,
        "plan published"
    );
}
