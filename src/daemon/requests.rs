//! What clients ask for.

use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;
use std::path::PathBuf;
use std::time::Instant;

use overfly_table::Block;
use overfly_wire::codec;
use overfly_wire::frame::{self, Limits};
use overfly_wire::{EditOrder, Header, Kind, PlanOrder, Refusal, RefusalCode, Reply, Request, Status};

use super::convert;
use super::jobs::{FieldSource, FileSource};
use super::ledger::{Outcome, Seen, Ticket};
use super::ports::Ports;
use super::scenes::{Current, Queued, Slot, Task};
use super::state::{Daemon, Reading, stopping, tell};

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
            None => self.work_on(ports, ticket, request, frame.bulk)?,
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
            Request::Locate { scene } => {
                let current = self.current(scene)?;
                let revision = current.session.revision();
                Reply::Located { epoch: current.epoch, revision, bytes: current.field_bytes }
            }
            Request::Republish { scene } => {
                let last = self.slot(scene)?.last_plan.as_ref();
                let message = || format!("the scene {scene:?} has no plan; ask for one with `overfly plan {scene}`");
                let last = last.ok_or_else(|| Refusal::new(RefusalCode::UnknownScene, message()))?;
                let sent = ports.publish_plan(last.header, &last.table);
                sent.map_err(|error| Refusal::new(RefusalCode::Memory, error.to_string()))?;
                Reply::Done
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

    /// Runs a request that changes something, once, however often it comes.
    fn work_on(&mut self, ports: &Ports, ticket: Ticket, request: Request, bulk: Vec<u8>) -> Result<(), Refusal> {
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
        match request {
            Request::LoadPath { path, name } => {
                self.load(ticket, FileSource::Path(PathBuf::from(OsString::from_vec(path))), name)
            }
            Request::LoadBytes { file_name, name } => self.load(ticket, FileSource::Bytes { file_name, bytes: bulk }, name),
            Request::Plan { scene, order } => self.plan(ports, ticket, &scene, order),
            Request::Edit { scene, edit } => self.edit(ports, ticket, &scene, &edit),
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
            | Request::Status
            | Request::Stop => Ok(()),
        }
    }

    fn load(&mut self, ticket: Ticket, source: FileSource, name: Option<String>) -> Result<(), Refusal> {
        self.check_room()?;
        let assignment = self.assign(Instant::now());
        let settings = self.settings.clone();
        self.workshop.read(assignment.clone(), source, settings.clone());
        self.reading.insert(assignment.job, Reading { ticket, name, settings, assignment });
        Ok(())
    }

    fn plan(&mut self, ports: &Ports, ticket: Ticket, scene: &str, order: PlanOrder) -> Result<(), Refusal> {
        self.check_room()?;
        convert::check_plan(&order)?;
        let queued = Queued { ticket, order, taken_up: Instant::now() };
        let slot = self.slot(scene)?;
        let builds = slot.work.as_ref().is_some_and(|work| !matches!(work.task, Task::Search(_)));
        if !builds && slot.current.is_none() {
            return Err(no_field(scene));
        }
        if builds {
            // The search starts as soon as the field is ready.
            let replaced = self.scenes.get_mut(scene).and_then(|slot| slot.queued.replace(queued));
            if let Some(replaced) = replaced {
                let message = format!("a newer plan request on the scene {scene:?} took the place of this one");
                self.refuse(ports, replaced.ticket, Refusal::new(RefusalCode::Superseded, message));
            }
            return Ok(());
        }
        self.supersede(ports, scene, "a newer plan request");
        self.start_search(scene, queued, 0.0);
        Ok(())
    }

    fn edit(&mut self, ports: &Ports, ticket: Ticket, scene: &str, order: &EditOrder) -> Result<(), Refusal> {
        self.check_room()?;
        let slot = self.slot(scene)?;
        let loads = slot.work.as_ref().is_some_and(|work| matches!(work.task, Task::Load(_)));
        let Some(session) = slot.session.as_ref().filter(|_| !loads) else { return Err(still_loading(scene)) };
        let mut edited = session.clone();
        let change = convert::edit(edited.scene(), order)?;
        edited.apply(&change).map_err(|error| convert::edit_refusal(&error))?;
        // From here on the edit is made; everything that was going on belongs to an older scene.
        let (revision, again, taken_up) = (edited.revision(), slot.last_order.clone(), Instant::now());
        self.supersede(ports, scene, "an edit");
        let replan_follows = again.is_some();
        if let Some(slot) = self.scenes.get_mut(scene) {
            slot.session = Some(edited.clone());
            slot.queued = again.map(|order| Queued { ticket, order, taken_up });
        }
        tracing::info!(scene, revision, ?change, replan_follows, "edited");
        self.answer(ports, ticket, &Reply::Edited { revision, replan_follows }, replan_follows);
        self.start_build(scene, FieldSource::Session(Box::new(edited)), Task::Rebuild, taken_up);
        Ok(())
    }

    fn cancel(&mut self, ports: &Ports, ticket: Ticket, scene: &str) -> Result<(), Refusal> {
        self.slot(scene)?;
        let queued = self.scenes.get_mut(scene).and_then(|slot| slot.queued.take());
        if let Some(queued) = queued {
            let message = format!("the search on the scene {scene:?} was cancelled before it began");
            self.refuse(ports, queued.ticket, Refusal::new(RefusalCode::Superseded, message));
        }
        if let Some(work) = &self.slot(scene)?.work
            && let Task::Search(_) = work.task
        {
            work.assignment.stop.stop();
        }
        self.answer(ports, ticket, &Reply::Done, false);
        Ok(())
    }

    fn unload(&mut self, ports: &Ports, ticket: Ticket, scene: &str) -> Result<(), Refusal> {
        self.slot(scene)?;
        self.supersede(ports, scene, "unloading");
        self.scenes.remove(scene);
        tracing::info!(scene, "unloaded");
        self.answer(ports, ticket, &Reply::Done, false);
        Ok(())
    }

    fn slot(&self, scene: &str) -> Result<&Slot, Refusal> {
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

    fn status(&self) -> Status {
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

fn still_loading(scene: &str) -> Refusal {
    Refusal::new(
        RefusalCode::Busy,
        format!("the scene {scene:?} is still being loaded; try again when `overfly status` lists it as idle"),
    )
}

fn no_field(scene: &str) -> Refusal {
    Refusal::new(RefusalCode::Field, format!("the scene {scene:?} has no field; load it again"))
}
