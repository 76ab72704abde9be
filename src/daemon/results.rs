//! What workers have found.

use std::sync::Arc;

use overfly_wire::{Header, Kind, Loaded, Refusal, RefusalCode, Reply, Updated, message};

use super::edits::{self, Change, NewVersion, PendingEdit};
use super::field_channel::FieldChannel;
use super::jobs::{Assignment, BuiltField, Failure, FieldSource, JobId, News, NewsKind};
use super::ledger::Ticket;
use super::ports::Ports;
use super::scene_file::SceneFile;
use super::scenes::{Cause, Current, FieldFigures, Load, Orders, Plans, Queued, Slot, Task};
use super::state::{Daemon, Purpose, Reading, UpdateOf, stopping, tell};
use crate::scene::anchor::Anchor;
use crate::settings::Settings;

impl Daemon {
    /// Reacts to the news of one job. News of a job that something newer has replaced are dropped, and their memory with them.
    pub fn on_news(&mut self, ports: &Ports, news: News) {
        if news.kind.is_last() {
            self.running -= 1;
            self.changed = true;
        }
        if self.reading.contains_key(&news.job) {
            self.on_reading(ports, news);
            return;
        }
        let Some(scene) = self.owners.get(&news.job).cloned() else { return };
        match news.kind {
            NewsKind::Progress(_) => return self.on_progress(ports, &scene, &news),
            NewsKind::Safe(plan, _attended) => return self.on_safe(ports, &scene, news.job, plan),
            NewsKind::Interim(flight, _attended) => return self.on_interim(ports, &scene, flight),
            NewsKind::Evaluated(evaluated) => {
                if let Some(flown) = self.scenes.get_mut(&scene).and_then(|slot| slot.flown.as_mut()) {
                    flown.note(*evaluated);
                }
                return;
            }
            _ => {}
        }
        self.owners.remove(&news.job);
        let Some(task) = self.scenes.get_mut(&scene).and_then(|slot| slot.take_task(news.job)) else { return };
        match (news.kind, task) {
            (NewsKind::Built(built), task) => self.on_built(ports, &scene, *built, task),
            (NewsKind::Planned(flight), Task::Search(search)) => self.on_planned(ports, &scene, flight, *search),
            (NewsKind::Failed(failure), task) => self.on_failed(ports, &scene, failure, task),
            (_, _) => {}
        }
        self.advance(ports, &scene);
    }

    fn on_reading(&mut self, ports: &Ports, news: News) {
        match news.kind {
            NewsKind::Progress(note) => {
                let ticket = self.reading.get(&news.job).map(|reading| reading.ticket);
                ticket.into_iter().for_each(|ticket| tell(ports, ticket, &Reply::Progress(note)));
            }
            NewsKind::Read(file) => {
                let Some(reading) = self.reading.remove(&news.job) else { return };
                let Reading { ticket, purpose, settings, assignment } = reading;
                let done = match purpose {
                    _ if self.is_ending() => Err(stopping()),
                    Purpose::Load(name) => self.place(ports, ticket, name, settings, &assignment, *file),
                    Purpose::Update(update) => self.compare(ports, ticket, &update, &assignment, *file),
                };
                if let Err(refusal) = done {
                    self.refuse(ports, ticket, refusal);
                }
            }
            NewsKind::Failed(failure) => self.on_unread(ports, news.job, failure),
            NewsKind::Built(_) | NewsKind::Safe(..) | NewsKind::Interim(..) | NewsKind::Evaluated(_) | NewsKind::Planned(_) => {}
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
    fn place(
        &mut self,
        ports: &Ports,
        ticket: Ticket,
        name: Option<String>,
        settings: Arc<Settings>,
        reading: &Assignment,
        file: SceneFile,
    ) -> Result<(), Refusal> {
        let SceneFile { mut scene, anchor, report_json, report_lines, read_s, .. } = file;
        let name = name.unwrap_or_else(|| message::plain_scene_name(&scene.name));
        message::check_scene_name(&name)?;
        scene.name = name.clone();
        let request = reading.job;
        match self.scenes.get(&name) {
            Some(slot) if slot.current.as_ref().is_some_and(|current| current.request > request) => {
                self.refuse_superseded(ports, &name, [ticket], "a newer load");
                return Ok(());
            }
            Some(_) => {}
            None => {
                let channel = FieldChannel::create(&ports.node, &self.domain, self.instance, &name);
                let channel = channel.map_err(|error| Refusal::new(RefusalCode::Memory, error.to_string()))?;
                self.scenes.insert(name.clone(), Slot::new(channel));
            }
        }
        tracing::info!(scene = name, structures = scene.structures.len(), read_s, "read");
        let taken_up = reading.taken_up;
        let source = FieldSource::Scene(Box::new(scene), settings);
        let assignment = self.start_build(&name, source, taken_up);
        if let Some(slot) = self.scenes.get_mut(&name) {
            slot.loads.push(Load { assignment, request, ticket, anchor, report_json, report_lines, read_s, taken_up });
        }
        Ok(())
    }

    /// Compares a scene with a new version of its file, and changes what differs unless that is only to be told.
    fn compare(
        &mut self,
        ports: &Ports,
        ticket: Ticket,
        update: &UpdateOf,
        reading: &Assignment,
        file: SceneFile,
    ) -> Result<(), Refusal> {
        let UpdateOf { scene, load, dry_run } = update;
        let current = self.editable(scene)?;
        if current.request != *load {
            self.refuse_superseded(ports, scene, [ticket], "a newer load");
            return Ok(());
        }
        let edits = &self.slot(scene)?.edits;
        let latest = edits.latest().unwrap_or(&current.session);
        let SceneFile { scene: version, report_lines, bytes, .. } = file;
        let change = Change::Update(NewVersion { scene: version, report_lines: report_lines.clone() });
        let changes = edits::apply(latest, &change)?.1.unwrap_or_default();
        if *dry_run || (changes.is_empty() && !edits.are_under_way()) {
            let updated = Updated { revision: latest.revision(), replan_follows: false, changes, report_lines };
            self.answer(ports, ticket, &Reply::Updated(updated), false);
            return Ok(());
        }
        self.accept(ports, ticket, scene, change, bytes, reading.taken_up)
    }

    /// Passes progress to whoever waits.
    fn on_progress(&self, ports: &Ports, scene: &str, news: &News) {
        let NewsKind::Progress(note) = news.kind else { return };
        let tickets = self.scenes.get(scene).map(|slot| slot.waiting_for(news.job));
        tickets.into_iter().flatten().for_each(|ticket| tell(ports, ticket, &Reply::Progress(note)));
    }

    /// Publishes a field: from now on the load or the edits that it was built for are made.
    fn on_built(&mut self, ports: &Ports, scene: &str, built: BuiltField, task: Task) {
        let field_s = built.field_s;
        let (request, anchor) = match (&task, self.scenes.get(scene).and_then(|slot| slot.current.as_ref())) {
            (Task::Load(load), _) => (load.request, load.anchor),
            (_, Some(current)) => (current.request, current.anchor),
            (_, None) => return,
        };
        let current = match self.publish_field(scene, built, request, anchor) {
            Ok(current) => current,
            Err(failure) => return self.on_failed(ports, scene, failure, task),
        };
        let (revision, figures, field_bytes) = (current.session.revision(), current.figures, current.field_bytes);
        tracing::info!(scene, revision, epoch = current.epoch, field_s, field_bytes, ?figures, "field published");
        match task {
            Task::Load(load) => {
                self.supersede_all(ports, scene, load.request, "a newer load");
                self.install(scene, current, field_s);
                let ticket = load.ticket;
                if self.scenes.get(scene).and_then(|slot| slot.queued.as_ref()).is_some_and(|q| q.taken_up < load.taken_up) {
                    self.supersede_queued(ports, scene, "a newer load");
                }
                if let Some(slot) = self.scenes.get_mut(scene) {
                    slot.orders = Orders::default();
                    slot.queued.iter().for_each(|queued| slot.orders.accept(&queued.order));
                    (slot.plans, slot.flown) = (Plans::default(), None);
                    slot.remark = None;
                }
                let loaded = Loaded { revision, ..loaded(scene, load, figures, field_bytes, field_s) };
                self.answer(ports, ticket, &Reply::Loaded(loaded), false);
            }
            Task::Rebuild(batch) => {
                self.supersede_search(ports, scene, "an edit");
                self.install(scene, current, field_s);
                self.answer_edits(ports, scene, batch.edits, field_s);
            }
            Task::Search(_) => {}
        }
        ports.ring();
    }

    fn install(&mut self, scene: &str, current: Current, field_s: f64) {
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        slot.current = Some(current);
        slot.queued.iter_mut().for_each(|queued| queued.field_s = field_s);
    }

    /// Answers edits that are made now. When the scene has been planned, a plan of the same order follows the last of them.
    fn answer_edits(&mut self, ports: &Ports, scene: &str, edits: Vec<PendingEdit>, field_s: f64) {
        let order = self.scenes.get(scene).and_then(|slot| slot.orders.last.clone());
        let replan_follows = order.is_some();
        for edit in &edits {
            tracing::info!(scene, revision = edit.revision, change = edit.change.in_words(), replan_follows, "edited");
            self.answer(ports, edit.ticket, &edit.reply(replan_follows), replan_follows);
        }
        let (Some(order), Some((last, earlier))) = (order, edits.split_last()) else { return };
        self.supersede_replans(ports, scene, earlier.iter().map(|edit| edit.ticket), "a newer edit");
        let queued = self.scenes.get(scene).and_then(|slot| slot.queued.as_ref());
        if queued.is_some_and(|queued| queued.taken_up > last.taken_up) {
            self.supersede_replans(ports, scene, [last.ticket], "a newer plan request");
            return;
        }
        self.supersede_queued(ports, scene, "an edit");
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.queued = Some(Queued { ticket: last.ticket, order, cause: Cause::Edit, taken_up: last.taken_up, field_s });
        }
    }

    /// Ends everything that runs for the scene as it was, and loads that were asked for before `request`.
    pub(super) fn supersede_all(&mut self, ports: &Ports, scene: &str, request: JobId, by: &str) {
        self.supersede_loads(ports, scene, request, by);
        self.supersede_edits(ports, scene, by);
        self.supersede_search(ports, scene, by);
    }

    fn publish_field(
        &mut self,
        scene: &str,
        built: BuiltField,
        request: JobId,
        anchor: Option<Anchor>,
    ) -> Result<Current, Failure> {
        let BuiltField { session, findings, filled, .. } = built;
        let epoch = self.next_epoch();
        let header = Header { instance: self.instance, epoch, ..Header::new(Kind::Field) };
        let gone = || Failure::Refused(Refusal::new(RefusalCode::UnknownScene, format!("the scene {scene:?} was unloaded")));
        let slot = self.scenes.get(scene).ok_or_else(gone)?;
        let held = Arc::new(slot.channel.publish(filled, findings.segments(), header)?);
        let snapshot = findings.snapshot(held)?;
        let (field_bytes, figures) = (snapshot.field().bytes(), FieldFigures::of(&snapshot.field()));
        Ok(Current { session, request, anchor, snapshot, epoch, field_bytes, figures })
    }

    fn on_failed(&mut self, ports: &Ports, scene: &str, failure: Failure, task: Task) {
        let refusal = match failure {
            Failure::Refused(refusal) => refusal,
            Failure::Stopped if self.is_ending() => stopping(),
            Failure::Stopped => Refusal::new(RefusalCode::Superseded, format!("the work on the scene {scene:?} was cancelled")),
        };
        match task {
            Task::Search(search) => {
                let is_for_now = matches!(refusal.code, RefusalCode::Hold | RefusalCode::Land);
                let slot = self.scenes.get_mut(scene);
                if let Some(slot) = slot.filter(|_| is_for_now || refusal.code == RefusalCode::Plan) {
                    // The aircraft may be elsewhere when it is planned next.
                    if !is_for_now {
                        slot.orders.take_back(&search.order);
                    }
                    slot.remark = (search.cause == Cause::Edit).then(|| format!("no plan since the edit: {refusal}"));
                }
                if search.cause == Cause::Edit && (is_for_now || refusal.code == RefusalCode::Plan) {
                    self.publish_infeasible(ports, scene, &refusal.message);
                }
                self.refuse(ports, search.ticket, refusal);
            }
            Task::Load(load) => self.undo_load(ports, scene, load.ticket, &refusal),
            Task::Rebuild(batch) => self.undo_edits(ports, scene, batch.edits, &refusal),
        }
    }

    /// A load that failed has changed nothing: the scene that had the name before is still there.
    fn undo_load(&mut self, ports: &Ports, scene: &str, ticket: Ticket, refusal: &Refusal) {
        self.refuse(ports, ticket, refusal.clone());
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        if slot.current.is_none() && slot.loads.is_empty() {
            let waiting = slot.queued.take();
            self.scenes.remove(scene);
            waiting.into_iter().for_each(|queued| self.refuse(ports, queued.ticket, refusal.clone()));
        }
    }

    /// Edits whose scene offers no field are not made.
    fn undo_edits(&mut self, ports: &Ports, scene: &str, failed: Vec<PendingEdit>, refusal: &Refusal) {
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        let Some(current) = &slot.current else { return };
        for (ticket, refusal) in slot.edits.take_back(failed, &current.session, refusal) {
            self.refuse(ports, ticket, refusal);
        }
        self.take_back_plan(ports, scene);
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
