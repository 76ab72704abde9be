//! What clients ask for.

use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use overfly_table::Block;
use overfly_wire::codec;
use overfly_wire::frame::{self, Limits};
use overfly_wire::{EditOrder, FlightReport, Header, Kind, PlanOrder, ReadOrder, Refusal, RefusalCode, Reply, Request, Status};

use super::convert;
use super::edits::{self, Change, PendingEdit};
use super::flown::Flown;
use super::jobs::{FileSource, JobId};
use super::ledger::{Outcome, Seen, Ticket};
use super::ports::Ports;
use super::scenes::{Cause, Current, Queued, Slot};
use super::state::{Daemon, Purpose, Reading, UpdateOf, stopping, tell};

/// Jobs that may run or wait for a thread at the same time.
const MAX_RUNNING: usize = 64;

impl Daemon {
    /// Takes up one request, or refuses it. `header` and `payload` lie in memory that the sender can still change.
    pub fn on_request(&mut self, ports: &Ports, header: &Header, payload: &[Block]) {
        let header = *header;
        let ticket = Ticket { client: header.client, correlation: header.correlation };
        if let Err(refusal) = self.take_up(ports, ticket, &header, payload) {
            self.refuse(ports, ticket, refusal);
        }
    }

    fn take_up(&mut self, ports: &Ports, ticket: Ticket, header: &Header, payload: &[Block]) -> Result<(), Refusal> {
        let malformed = |error: String| Refusal::new(RefusalCode::Malformed, error);
        let max_scene = self.settings.daemon.max_scene_mb.saturating_mul(1_000_000);
        let limits =
            Limits { body_bytes: codec::MAX_REQUEST_BYTES, bulk_bytes: usize::try_from(max_scene).unwrap_or(usize::MAX) };
        let frame = frame::copy(header, payload, Kind::Request, limits).map_err(|error| malformed(error.to_string()))?;
        let request: Request = codec::decode_request(&frame.body).map_err(|error| malformed(error.to_string()))?;
        if frame.header.instance != 0 && frame.header.instance != self.instance {
            let message = "the daemon was restarted and has lost its scenes; load them again";
            return Err(Refusal::new(RefusalCode::Restarted, message));
        }
        request.check()?;
        tracing::debug!(client = ticket.client, correlation = ticket.correlation, ?request, "request");
        match self.glance(ports, ticket, &request)? {
            Some(reply) => tell(ports, ticket, &reply),
            None => self.work_on(ports, ticket, request, frame.body.len(), frame.bulk)?,
        }
        Ok(())
    }

    /// Answers what only asks and may be asked any number of times; `None` for requests that change something.
    fn glance(&self, ports: &Ports, ticket: Ticket, request: &Request) -> Result<Option<Reply>, Refusal> {
        Ok(Some(match request {
            Request::Hello => Reply::Welcome { version: env!("CARGO_PKG_VERSION").into(), pid: std::process::id() },
            Request::Ping => Reply::Acknowledged,
            Request::Status => Reply::Status(self.status()),
            Request::Structures { scene } => Reply::Structures(self.current(scene)?.structures()),
            Request::Zones { scene } => Reply::Zones(self.current(scene)?.zones()),
            Request::Locate { scene } => {
                let current = self.current(scene)?;
                let revision = current.session.revision();
                Reply::Located { epoch: current.epoch, revision, bytes: current.field_bytes }
            }
            Request::Republish { scene } => {
                let last = self.slot(scene)?.plans.last();
                let message = || format!("the scene {scene:?} has no plan; ask for one with `overfly plan {scene}`");
                let last = last.ok_or_else(|| Refusal::new(RefusalCode::UnknownScene, message()))?;
                last.publish(ports).map_err(|error| Refusal::new(RefusalCode::Memory, error.to_string()))?;
                Reply::Planned { epoch: last.header.epoch }
            }
            Request::Outcome { correlation } => {
                match self.ledger.outcome(Ticket { client: ticket.client, correlation: *correlation }) {
                    Outcome::Pending => Reply::Acknowledged,
                    Outcome::Known(reply) => reply,
                    Outcome::Unknown => {
                        let message =
                            format!("request {correlation} of this client is not known any more; ask again for what is wanted");
                        return Err(Refusal::new(RefusalCode::Invalid, message));
                    }
                }
            }
            _ => return Ok(None),
        }))
    }

    /// Runs a request that changes something, once, however often it comes. Its body was `bytes` long.
    fn work_on(&mut self, ports: &Ports, ticket: Ticket, request: Request, bytes: usize, bulk: Vec<u8>) -> Result<(), Refusal> {
        match self.ledger.see(ticket) {
            Seen::New => {}
            Seen::Pending => {
                tell(ports, ticket, &Reply::Acknowledged);
                return Ok(());
            }
            Seen::Answered(reply) => {
                tell(ports, ticket, &reply);
                return Ok(());
            }
        }
        if request == Request::Stop {
            self.answer(ports, ticket, &Reply::Done, false);
            self.on_end(ports);
            return Ok(());
        }
        if self.is_ending() {
            return Err(stopping());
        }
        tell(ports, ticket, &Reply::Acknowledged);
        self.changed = true;
        match request {
            Request::LoadPath { path, ground, name, order } => self.load(ticket, at(path, ground), name, &order),
            Request::LoadBytes { file_name, name, order } => {
                self.load(ticket, FileSource::Bytes { file_name, bytes: bulk }, name, &order)
            }
            Request::Plan { scene, order } => self.plan(ports, ticket, &scene, *order),
            Request::Edit { scene, edits } => self.edit(ports, ticket, &scene, edits, bytes),
            Request::UpdatePath { scene, path, ground, dry_run } => self.update(ticket, scene, at(path, ground), dry_run),
            Request::UpdateBytes { scene, file_name, dry_run } => {
                self.update(ticket, scene, FileSource::Bytes { file_name, bytes: bulk }, dry_run)
            }
            Request::Progress { scene, report } => self.progress(ports, ticket, &scene, &report),
            Request::Cancel { scene } => self.cancel(ports, ticket, &scene),
            Request::Unload { scene } => self.unload(ports, ticket, &scene),
            Request::Reload => {
                self.reload()?;
                self.answer(ports, ticket, &Reply::Done, false);
                Ok(())
            }
            Request::Hello
            | Request::Ping
            | Request::Locate { .. }
            | Request::Republish { .. }
            | Request::Outcome { .. }
            | Request::Structures { .. }
            | Request::Zones { .. }
            | Request::Status
            | Request::Stop => Ok(()),
        }
    }

    fn load(&mut self, ticket: Ticket, source: FileSource, name: Option<String>, order: &ReadOrder) -> Result<(), Refusal> {
        self.check_room()?;
        // A newer version of the file is read in the same way: the scene keeps these settings.
        let settings = Arc::new(convert::read_as(order, &self.settings)?);
        let assignment = self.assign(Instant::now());
        self.workshop.read(assignment.clone(), source, settings.clone(), None);
        self.reading.insert(assignment.job, Reading { ticket, purpose: Purpose::Load(name), settings, assignment });
        Ok(())
    }

    /// Reads a new version of a scene's file in the frame of the scene.
    fn update(&mut self, ticket: Ticket, scene: String, source: FileSource, dry_run: bool) -> Result<(), Refusal> {
        self.check_room()?;
        let current = self.editable(&scene)?;
        let (settings, anchor, load) = (current.session.settings().clone(), current.anchor, current.request);
        let without = || format!("the scene {scene:?} has no frame that a file could be put into; load the file anew");
        let anchor = anchor.ok_or_else(|| Refusal::new(RefusalCode::Import, without()))?;
        let assignment = self.assign(Instant::now());
        self.workshop.read(assignment.clone(), source, settings.clone(), Some(anchor));
        let purpose = Purpose::Update(UpdateOf { scene, load, dry_run });
        self.reading.insert(assignment.job, Reading { ticket, purpose, settings, assignment });
        Ok(())
    }

    fn plan(&mut self, ports: &Ports, ticket: Ticket, scene: &str, order: PlanOrder) -> Result<(), Refusal> {
        self.check_room()?;
        convert::check_plan(&order)?;
        if self.slot(scene)?.current.is_none() && self.slot(scene)?.loads.is_empty() {
            return Err(no_field(scene));
        }
        let flown = match &order.en_route {
            Some(report) => Some(self.flown_after(scene, report)?),
            None => None,
        };
        self.note_presence(ticket.client);
        self.supersede_search(ports, scene, "a newer plan request");
        self.supersede_queued(ports, scene, "a newer plan request");
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.orders.accept(&order);
            slot.flown = flown;
            slot.queued = Some(Queued { ticket, order, cause: Cause::Request, taken_up: Instant::now(), field_s: 0.0 });
        }
        self.advance(ports, scene);
        Ok(())
    }

    /// Takes note of how far a flight has come: what is planned next goes on from there.
    fn progress(&mut self, ports: &Ports, ticket: Ticket, scene: &str, report: &FlightReport) -> Result<(), Refusal> {
        let flown = self.flown_after(scene, report)?;
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.flown = Some(flown);
        }
        self.answer(ports, ticket, &Reply::Done, false);
        Ok(())
    }

    fn flown_after(&self, scene: &str, report: &FlightReport) -> Result<Flown, Refusal> {
        let (slot, current) = (self.slot(scene)?, self.current(scene)?);
        Flown::after(slot.flown.as_ref(), report, &slot.plans, &current.snapshot)
    }

    fn edit(&mut self, ports: &Ports, ticket: Ticket, scene: &str, edits: Vec<EditOrder>, bytes: usize) -> Result<(), Refusal> {
        self.check_room()?;
        self.accept(ports, ticket, scene, Change::Edits(edits), bytes, Instant::now())
    }

    /// Accepts a change that makes sense, of so many bytes. It is answered when its field stands; until then nothing else is changed.
    pub(super) fn accept(
        &mut self,
        ports: &Ports,
        ticket: Ticket,
        scene: &str,
        change: Change,
        bytes: usize,
        taken_up: Instant,
    ) -> Result<(), Refusal> {
        let current = self.editable(scene)?;
        let edits = &self.slot(scene)?.edits;
        if !edits.has_room(bytes) {
            let message = format!("too many edits wait for the field of the scene {scene:?}; send fewer at a time");
            return Err(Refusal::new(RefusalCode::Busy, message));
        }
        let (session, changes) = edits::apply(edits.latest().unwrap_or(&current.session), &change)?;
        let revision = session.revision();
        tracing::debug!(scene, revision, "edit accepted");
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.edits.push(PendingEdit { ticket, change, revision, changes, taken_up, bytes }, session);
        }
        self.advance(ports, scene);
        Ok(())
    }

    /// The scene, when it can be edited.
    pub(super) fn editable(&self, scene: &str) -> Result<&Current, Refusal> {
        let slot = self.slot(scene)?;
        slot.current.as_ref().filter(|_| slot.loads.is_empty()).ok_or_else(|| still_loading(scene))
    }

    fn cancel(&mut self, ports: &Ports, ticket: Ticket, scene: &str) -> Result<(), Refusal> {
        self.slot(scene)?;
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.search.iter().for_each(|search| search.assignment.stop.stop());
            let queued = slot.queued.take();
            queued.iter().for_each(|queued| slot.orders.take_back(&queued.order));
            if let Some(queued) = queued {
                let message = format!("the search on the scene {scene:?} was cancelled before it began");
                self.refuse(ports, queued.ticket, Refusal::new(RefusalCode::Superseded, message));
            }
        }
        self.answer(ports, ticket, &Reply::Done, false);
        Ok(())
    }

    fn unload(&mut self, ports: &Ports, ticket: Ticket, scene: &str) -> Result<(), Refusal> {
        self.slot(scene)?;
        self.supersede_all(ports, scene, JobId(u64::MAX), "unloading");
        self.supersede_queued(ports, scene, "unloading");
        self.scenes.remove(scene);
        tracing::info!(scene, "unloaded");
        self.answer(ports, ticket, &Reply::Done, false);
        Ok(())
    }

    pub(super) fn slot(&self, scene: &str) -> Result<&Slot, Refusal> {
        self.scenes.get(scene).ok_or_else(|| {
            let known: Vec<&str> = self.scenes.keys().take(20).map(String::as_str).collect();
            let known = if known.is_empty() { "none is loaded".into() } else { format!("loaded are: {}", known.join(", ")) };
            let message = format!("there is no scene {scene:?}; {known}; load one with `overfly load FILE`");
            Refusal::new(RefusalCode::UnknownScene, message)
        })
    }

    fn current(&self, scene: &str) -> Result<&Current, Refusal> {
        self.slot(scene)?.current.as_ref().ok_or_else(|| still_loading(scene))
    }

    fn check_room(&self) -> Result<(), Refusal> {
        if self.running < MAX_RUNNING {
            return Ok(());
        }
        Err(Refusal::new(
            RefusalCode::Busy,
            format!("{MAX_RUNNING} jobs are running or waiting already; try again when some have ended"),
        ))
    }

    pub(super) fn status(&self) -> Status {
        Status {
            version: env!("CARGO_PKG_VERSION").into(),
            domain: self.domain.name().into(),
            pid: std::process::id(),
            instance: self.instance,
            uptime_s: self.started.elapsed().as_secs_f64(),
            threads: u32::try_from(rayon::current_num_threads()).unwrap_or(u32::MAX),
            field_bytes: self.workshop.budget.used(),
            budget_bytes: self.workshop.budget.limit(),
            resident_mb: resident_mb(),
            scenes: self.scenes.iter().map(|(name, slot)| slot.status(name)).collect(),
        }
    }
}

/// Resident memory of this process as the kernel counts it, MB; 0 when it does not tell.
fn resident_mb() -> f64 {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: f64 = statm.split_whitespace().nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0.0);
    pages * rustix::param::page_size() as f64 / 1e6
}

/// The file of a path as it came in a message.
fn at(path: Vec<u8>, ground: Option<Vec<u8>>) -> FileSource {
    let path_of = |path| PathBuf::from(OsString::from_vec(path));
    FileSource::Path { path: path_of(path), ground: ground.map(path_of) }
}

fn still_loading(scene: &str) -> Refusal {
    Refusal::new(
        RefusalCode::Busy,
        format!("the scene {scene:?} is still being loaded; try again when `overfly status` lists it as idle"),
    )
}

fn no_field(scene: &str) -> Refusal {
    Refusal::new(RefusalCode::Field, format!("the scene {scene:?} has no field; load it again"))
}
