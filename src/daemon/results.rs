//! What workers have found.

use std::sync::Arc;

use overfly_table::{Block, PlanTable};
use overfly_wire::{Header, Kind, Loaded, Refusal, RefusalCode, Reply, message};

use super::field_channel::FieldChannel;
use super::jobs::{BuiltField, Failure, FieldSource, JobId, News, NewsKind, PlannedFlight};
use super::ledger::Ticket;
use super::ports::Ports;
use super::scene_file::SceneFile;
use super::scenes::{Current, FieldFigures, LastPlan, Load, Queued, Search, Slot, Task, Work};
use super::state::{Daemon, Reading, stopping, tell};

impl Daemon {
    /// Reacts to the news of one job. News of a job that something newer has replaced are dropped, and their memory with them.
    pub fn on_news(&mut self, ports: &Ports, news: News) {
        if !matches!(news.kind, NewsKind::Progress(_)) {
            self.running -= 1;
        }
        if self.reading.contains_key(&news.job) {
            self.on_reading(ports, news);
            return;
        }
        let Some(scene) = self.owners.get(&news.job).cloned() else { return };
        if let NewsKind::Progress(_) = news.kind {
            self.on_progress(ports, &scene, &news.kind);
            return;
        }
        self.owners.remove(&news.job);
        let Some(work) = self.scenes.get_mut(&scene).and_then(|slot| slot.work.take()) else { return };
        match (news.kind, work.task) {
            (NewsKind::Built(built), task) => self.on_built(ports, &scene, *built, task),
            (NewsKind::Planned(flight), Task::Search(search)) => self.on_planned(ports, &scene, flight, search),
            (NewsKind::Failed(failure), task) => self.on_failed(ports, &scene, failure, task),
            (NewsKind::Progress(_) | NewsKind::Read(_) | NewsKind::Planned(_), _) => {}
        }
    }

    fn on_reading(&mut self, ports: &Ports, news: News) {
        match news.kind {
            NewsKind::Progress(note) => {
                let ticket = self.reading.get(&news.job).map(|reading| reading.ticket);
                ticket.into_iter().for_each(|ticket| tell(ports, ticket, &Reply::Progress(note)));
            }
            NewsKind::Read(file) => {
                let Some(reading) = self.reading.remove(&news.job) else { return };
                let ticket = reading.ticket;
                if let Err(refusal) = self.place(ports, reading, *file) {
                    self.refuse(ports, ticket, refusal);
                }
            }
            NewsKind::Failed(failure) => self.on_unread(ports, news.job, failure),
            NewsKind::Built(_) | NewsKind::Planned(_) => {}
        }
    }

    fn on_unread(&mut self, ports: &Ports, job: JobId, failure: Failure) {
        let Some(reading) = self.reading.remove(&job) else { return };
        let refusal = match failure {
            Failure::Refused(refusal) => refusal,
            Failure::Stopped => stopping(),
        };
        self.refuse(ports, reading.ticket, refusal);
    }

    /// Gives a scene that was read its slot and starts to build its field. What stands in the slot stays until that is ready.
    fn place(&mut self, ports: &Ports, reading: Reading, file: SceneFile) -> Result<(), Refusal> {
        if self.is_ending() {
            return Err(stopping());
        }
        let SceneFile { mut scene, report_json, report_lines, read_s } = file;
        let name = reading.name.unwrap_or_else(|| plain_name(&scene.name));
        message::check_scene_name(&name)?;
        scene.name = name.clone();
        if self.scenes.contains_key(&name) {
            self.supersede(ports, &name, "a newer load");
        } else {
            let channel = FieldChannel::create(&ports.node, &name);
            let channel = channel.map_err(|error| Refusal::new(RefusalCode::Memory, error.to_string()))?;
            self.scenes.insert(name.clone(), Slot::new(channel));
        }
        tracing::info!(scene = name, structures = scene.structures.len(), read_s, "read");
        let taken_up = reading.assignment.taken_up;
        let load = Load { ticket: reading.ticket, report_json, report_lines, read_s, taken_up };
        let source = FieldSource::Scene(Box::new(scene), reading.settings);
        self.start_build(&name, source, Task::Load(Box::new(load)), taken_up);
        Ok(())
    }

    /// Passes progress to whoever waits, and notes that a search has got under way.
    fn on_progress(&mut self, ports: &Ports, scene: &str, kind: &NewsKind) {
        let NewsKind::Progress(note) = kind else { return };
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        let ticket = match &slot.work {
            Some(Work { task: Task::Load(load), .. }) => Some(load.ticket),
            Some(Work { task: Task::Search(search), .. }) => {
                slot.last_order = Some(search.order.clone());
                Some(search.ticket)
            }
            Some(Work { task: Task::Rebuild, .. }) => slot.queued.as_ref().map(|queued| queued.ticket),
            None => None,
        };
        ticket.into_iter().for_each(|ticket| tell(ports, ticket, &Reply::Progress(*note)));
    }

    /// Publishes a field and starts the search that waits for it.
    fn on_built(&mut self, ports: &Ports, scene: &str, built: BuiltField, task: Task) {
        let field_s = built.field_s;
        let current = match self.publish_field(scene, built) {
            Ok(current) => current,
            Err(failure) => return self.on_failed(ports, scene, failure, task),
        };
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        let (revision, figures, field_bytes) = (current.session.revision(), current.figures, current.field_bytes);
        tracing::info!(scene, revision, epoch = current.epoch, field_s, field_bytes, ?figures, "field published");
        if let Task::Load(load) = task {
            slot.session = Some(current.session.clone());
            slot.last_order = None;
            slot.last_plan = None;
            slot.current = Some(current);
            let ticket = load.ticket;
            let loaded = Loaded { revision, ..loaded(scene, *load, figures, field_bytes, field_s) };
            self.answer(ports, ticket, &Reply::Loaded(loaded), false);
        } else {
            slot.current = Some(current);
        }
        ports.ring();
        let queued = self.scenes.get_mut(scene).and_then(|slot| slot.queued.take());
        match queued {
            Some(Queued { ticket, .. }) if self.is_ending() => self.refuse(ports, ticket, stopping()),
            Some(queued) => self.start_search(scene, queued, field_s),
            None => {}
        }
    }

    fn publish_field(&mut self, scene: &str, built: BuiltField) -> Result<Current, Failure> {
        let BuiltField { session, survey, filled, .. } = built;
        let epoch = self.next_epoch();
        let header = Header { instance: self.instance, epoch, ..Header::new(Kind::Field) };
        let gone = || Failure::Refused(Refusal::new(RefusalCode::UnknownScene, format!("the scene {scene:?} was unloaded")));
        let slot = self.scenes.get(scene).ok_or_else(gone)?;
        let held = Arc::new(slot.channel.publish(filled, header)?);
        let field_bytes = std::mem::size_of_val(crate::session::FieldStorage::blocks(&*held)) as u64;
        let snapshot = survey.snapshot(held)?;
        let figures = FieldFigures::of(&snapshot.field());
        Ok(Current { session, snapshot, epoch, field_bytes, figures })
    }

    fn on_planned(&mut self, ports: &Ports, scene: &str, flight: PlannedFlight, search: Search) {
        let epoch = self.next_epoch();
        let Search { ticket, order } = search;
        let header = Header {
            instance: self.instance,
            epoch,
            client: ticket.client,
            correlation: ticket.correlation,
            ..Header::new(Kind::Plan)
        };
        log_plan(scene, epoch, &flight.table);
        let sent = ports.publish_plan(header, &flight.table);
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.last_order = Some(order);
            slot.last_plan = Some(LastPlan { header, table: flight.table });
        }
        match sent {
            Ok(()) => self.answer(ports, ticket, &Reply::Planned { epoch }, false),
            Err(error) => self.refuse(ports, ticket, Refusal::new(RefusalCode::Memory, error.to_string())),
        }
    }

    fn on_failed(&mut self, ports: &Ports, scene: &str, failure: Failure, task: Task) {
        let refusal = match failure {
            Failure::Refused(refusal) => refusal,
            Failure::Stopped if self.is_ending() => stopping(),
            Failure::Stopped => Refusal::new(RefusalCode::Superseded, format!("the work on the scene {scene:?} was cancelled")),
        };
        match task {
            Task::Search(search) => self.refuse(ports, search.ticket, refusal),
            Task::Load(load) => self.undo_load(ports, scene, load.ticket, &refusal),
            Task::Rebuild => self.undo_edits(ports, scene, &refusal),
        }
    }

    /// A load that failed has changed nothing: the scene that had the name before is still there.
    fn undo_load(&mut self, ports: &Ports, scene: &str, ticket: Ticket, refusal: &Refusal) {
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        let waiting = slot.queued.take().map(|queued| queued.ticket);
        if slot.current.is_none() {
            self.scenes.remove(scene);
        }
        for ticket in std::iter::once(ticket).chain(waiting) {
            self.refuse(ports, ticket, refusal.clone());
        }
    }

    /// An edit whose scene offers no field is taken back, with all edits since the last field.
    fn undo_edits(&mut self, ports: &Ports, scene: &str, refusal: &Refusal) {
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        let Some(current) = &slot.current else { return };
        slot.session = Some(current.session.clone());
        let revision = current.session.revision();
        tracing::warn!(scene, revision, %refusal, "edits were undone, because no field can be built after them");
        if let Some(queued) = slot.queued.take() {
            let message =
                format!("the scene is back at revision {revision}, because no field can be built after the edit: {refusal}");
            self.refuse(ports, queued.ticket, Refusal::new(refusal.code, message));
        }
    }
}

/// The answer to a load.
fn loaded(scene: &str, load: Load, figures: FieldFigures, field_bytes: u64, field_s: f64) -> Loaded {
    Loaded {
        scene: scene.into(),
        revision: 0,
        structures: figures.structures,
        samples: figures.samples,
        exposed: figures.exposed,
        viewpoints: figures.viewpoints,
        capturable_percent: figures.capturable_percent,
        field_bytes,
        read_s: load.read_s,
        field_s,
        load_s: load.taken_up.elapsed().as_secs_f64(),
        report_json: load.report_json,
        report_lines: load.report_lines,
    }
}

fn log_plan(scene: &str, epoch: u64, table: &[Block]) {
    let Ok(table) = PlanTable::open(table) else { return };
    let facts = table.facts;
    tracing::info!(
        scene,
        epoch,
        revision = facts.revision,
        seed = facts.seed,
        coverage_percent = facts.metrics.coverage_percent,
        length_m = facts.metrics.length_m,
        waypoints = facts.metrics.waypoints,
        search_s = facts.search_s,
        total_s = facts.total_s,
        "plan published"
    );
}

/// The name that a file gives, with everything replaced that a scene's name cannot hold.
fn plain_name(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_alphanumeric() || "._-+ ".contains(c) { c } else { '-' }).collect();
    let mut end = plain.len().min(message::MAX_NAME_BYTES);
    while !plain.is_char_boundary(end) {
        end -= 1;
    }
    let plain = plain[..end].trim();
    if plain.is_empty() { "scene".into() } else { plain.into() }
}
