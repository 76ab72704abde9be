//! All that the daemon knows, and the reactions that are neither requests nor results.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use overfly_wire::service;
use overfly_wire::{Domain, Refusal, RefusalCode, Reply, SceneStatus};

use super::DaemonError;
use super::budget::Budget;
use super::configuration::{self, ConfigurationError};
use super::crew::Crew;
use super::edits::Batch;
use super::flown::Flown;
use super::jobs::{Assignment, FieldSource, Flight, JobId, News, Workshop};
use super::ledger::{Ledger, Ticket};
use super::ports::Ports;
use super::scenes::{Cause, Queued, Search, Slot};
use super::threads::{self, SearchPools};
use super::wake::Mail;
use crate::planner::StopToken;
use crate::settings::{DaemonSettings, Settings};

/// How long running work may take to notice that the daemon ends.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// Jobs that run at the same time. Each computes mostly on one core, so that many long searches leave a short one its share.
const JOBS_AT_ONCE: usize = 16;

/// The daemon's state; the main thread owns it alone.
pub struct Daemon {
    pub(super) domain: Domain,
    pub(super) settings: Arc<Settings>,
    pub(super) workshop: Workshop,
    pub(super) ledger: Ledger,
    pub(super) scenes: BTreeMap<String, Slot>,
    /// Files that are being read; which scene they belong to is not known before.
    pub(super) reading: HashMap<JobId, Reading>,
    /// Which scene a running job works for.
    pub(super) owners: HashMap<JobId, String>,
    /// Jobs that have not posted their last news, also those whose result nobody wants any more.
    pub(super) running: usize,
    pub(super) instance: u64,
    pub(super) started: Instant,
    /// Clients that were there when it was last looked.
    seen: HashSet<u64>,
    config_path: Option<PathBuf>,
    epoch: u64,
    next_job: u64,
    ending: Option<Instant>,
    /// The scenes as the status last told them.
    told: Option<Vec<SceneStatus>>,
    /// Something may have changed since.
    pub(super) changed: bool,
}

/// A scene file on its way.
pub struct Reading {
    pub ticket: Ticket,
    pub purpose: Purpose,
    pub settings: Arc<Settings>,
    pub assignment: Assignment,
}

/// What a scene file is read for.
pub enum Purpose {
    /// A scene of this name, or of the name that the file gives.
    Load(Option<String>),
    Update(UpdateOf),
}

/// The scene that a new version of its file is compared with.
pub struct UpdateOf {
    pub scene: String,
    /// The load that it came with: after another one the file was read in the wrong frame.
    pub load: JobId,
    /// Only to be told what differs.
    pub dry_run: bool,
}

impl Daemon {
    pub fn new(
        settings: Settings,
        config_path: Option<PathBuf>,
        domain: &Domain,
        mail: Mail<News>,
        instance: u64,
    ) -> Result<Self, DaemonError> {
        threads::start_pool(&settings.daemon)?;
        let search_pools = SearchPools::new(&settings.daemon);
        let budget = Budget::new(settings.daemon.memory_budget_mb);
        Ok(Self {
            domain: domain.clone(),
            settings: Arc::new(settings),
            workshop: Workshop { crew: Crew::new(JOBS_AT_ONCE), search_pools, budget, mail },
            ledger: Ledger::default(),
            scenes: BTreeMap::new(),
            reading: HashMap::new(),
            owners: HashMap::new(),
            running: 0,
            instance,
            started: Instant::now(),
            seen: HashSet::new(),
            config_path,
            epoch: 0,
            next_job: 0,
            ending: None,
            told: None,
            changed: true,
        })
    }

    /// The daemon was asked to end, and nobody is working any more or has taken too long.
    pub fn has_ended(&self) -> bool {
        self.ending.is_some_and(|since| self.running == 0 || since.elapsed() > LAST_WORDS)
    }

    pub fn is_ending(&self) -> bool {
        self.ending.is_some()
    }

    /// How long the loop may wait for the next event.
    pub fn patience(&self) -> Duration {
        if self.is_ending() { Duration::from_millis(50) } else { Duration::from_secs(3600) }
    }

    /// Connects clients that have come since to everything that was published.
    pub fn on_attach(&self, ports: &Ports) {
        ports.update();
        self.scenes.values().for_each(|slot| slot.channel.update());
        ports.ring();
    }

    /// Cleans up after clients that were killed: samples they held would be lost for ever, and what they asked for is not wanted any more.
    pub fn on_tick(&mut self, ports: &Ports) {
        let cleaned = ports.node.try_cleanup_dead_nodes();
        if cleaned.cleanups > 0 {
            tracing::info!(clients = cleaned.cleanups, "cleaned up after clients that died");
        }
        ports.update();
        self.scenes.values().for_each(|slot| slot.channel.update());
        self.stop_unwanted();
    }

    /// Stops searches whose clients are gone; their best plans so far are still published. A plan after an edit is wanted by whoever
    /// watches the scene. A client that was never seen here may live beyond a network tunnel.
    fn stop_unwanted(&mut self) {
        let asked = self.scenes.values().filter_map(|slot| slot.search.as_ref()).any(|search| search.cause == Cause::Request);
        if !asked {
            if self.scenes.values().all(|slot| slot.queued.is_none()) {
                self.seen.clear();
            }
            return;
        }
        let Some(present) = self.present_clients() else { return };
        for (scene, slot) in &self.scenes {
            let Some(search) = slot.search.as_ref().filter(|search| search.cause == Cause::Request) else { continue };
            let client = search.ticket.client;
            if self.seen.contains(&client) && !present.contains(&client) && !search.assignment.stop.is_stopped() {
                tracing::info!(scene, client, "the client that asked for this search is gone: stopping it");
                search.assignment.stop.stop();
            }
        }
        self.seen.extend(present);
    }

    /// Looks who is there before a search begins, so that it can be told later whether its client has gone.
    pub(super) fn note_presence(&mut self, client: u64) {
        if !self.seen.contains(&client) {
            self.seen.extend(self.present_clients().unwrap_or_default());
        }
    }

    fn present_clients(&self) -> Option<HashSet<u64>> {
        Some(self.domain.living_nodes()?.into_iter().map(service::short_id).collect())
    }

    /// Publishes the status when a scene came, went, or has another revision, state or plan.
    pub fn tell_status(&mut self, ports: &Ports) {
        if !std::mem::take(&mut self.changed) {
            return;
        }
        let status = self.status();
        if self.told.as_ref() == Some(&status.scenes) {
            return;
        }
        if let Err(error) = ports.publish_status(&status) {
            tracing::warn!(%error, "subscribers did not get the status");
        }
        self.told = Some(status.scenes);
    }

    /// Begins to end: no new work, and what runs is stopped. A stopped search still gives its best plan so far.
    pub fn on_end(&mut self, ports: &Ports) {
        if self.ending.is_some() {
            return;
        }
        tracing::info!(running = self.running, "ending");
        self.ending = Some(Instant::now());
        let mut waiting = Vec::new();
        for slot in self.scenes.values_mut() {
            waiting.extend(slot.queued.take().map(|queued| queued.ticket));
            waiting.extend(slot.edits.give_up_waiting());
            slot.stop();
        }
        for ticket in waiting {
            self.refuse(ports, ticket, stopping());
        }
        self.reading.values().for_each(|reading| reading.assignment.stop.stop());
    }

    pub fn on_reload_signal(&mut self) {
        // Nobody waits for an answer: the log is the place to tell.
        if let Err(refusal) = self.reload() {
            tracing::error!(%refusal, "the configuration was not reloaded; the old one stays");
        }
    }

    /// Reads the configuration again. Scenes keep the settings that they were loaded with.
    pub fn reload(&mut self) -> Result<(), Refusal> {
        let refused = |cause: String| Refusal::new(RefusalCode::Configuration, format!("{cause}; the old configuration stays"));
        let Some(path) = &self.config_path else {
            return Err(refused("the daemon was started without a configuration file; start it with `--config FILE`".into()));
        };
        let settings = configuration::read(path).map_err(|error: ConfigurationError| refused(error.to_string()))?;
        let settings = settings.with_sight(self.settings.coverage.sight_scale);
        let threads = |settings: &Settings| {
            let DaemonSettings { threads, pin_threads, search_nice, .. } = settings.daemon;
            (threads, pin_threads, search_nice)
        };
        if threads(&settings) != threads(&self.settings) {
            let (threads, pin_threads, search_nice) = threads(&settings);
            tracing::warn!(
                threads,
                pin_threads,
                search_nice,
                "the threads, their cores and their niceness cannot change while the daemon runs: restart it for that"
            );
        }
        if settings.daemon.domain != self.settings.daemon.domain {
            tracing::warn!(
                domain = settings.daemon.domain,
                "the domain cannot change while the daemon runs: restart it for that"
            );
        }
        self.workshop.budget.set_limit_mb(settings.daemon.memory_budget_mb);
        self.settings = Arc::new(settings);
        tracing::info!(path = %path.display(), "configuration reloaded; scenes that are loaded keep theirs");
        Ok(())
    }

    /// Number for the next table.
    pub(super) fn next_epoch(&mut self) -> u64 {
        self.epoch += 1;
        self.epoch
    }

    pub(super) fn assign(&mut self, taken_up: Instant) -> Assignment {
        self.next_job += 1;
        self.running += 1;
        let stop = StopToken::timed(move || taken_up.elapsed().as_secs_f64());
        Assignment { job: JobId(self.next_job), stop, taken_up }
    }

    /// Starts to build a field for `scene`.
    pub(super) fn start_build(&mut self, scene: &str, source: FieldSource, taken_up: Instant) -> Assignment {
        let assignment = self.assign(taken_up);
        self.owners.insert(assignment.job, scene.into());
        if let Some(slot) = self.scenes.get(scene) {
            self.workshop.build(assignment.clone(), source, slot.channel.clone());
        }
        assignment
    }

    /// Starts what waits on `scene` and can start: the field of the edits that wait, or the search when no field is being built.
    pub(super) fn advance(&mut self, ports: &Ports, scene: &str) {
        let is_ending = self.is_ending();
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        if slot.edits.building.is_none() && !is_ending {
            let current = slot.current.as_ref();
            let next = current.and_then(|current| Some((slot.edits.next_batch(&current.session)?, current.snapshot.clone())));
            if let Some(((edits, session), earlier)) = next {
                let flight = slot.flight_before().map(Box::new);
                let taken_up = edits.first().map_or_else(Instant::now, |first| first.taken_up);
                let source = FieldSource::Edited { session: Box::new(session.clone()), earlier, flight };
                let assignment = self.start_build(scene, source, taken_up);
                if let Some(slot) = self.scenes.get_mut(scene) {
                    slot.edits.building = Some(Batch { assignment, edits, session });
                }
                return;
            }
        }
        if slot.is_building() || slot.current.is_none() {
            return;
        }
        match slot.queued.take() {
            Some(queued) if is_ending => self.refuse(ports, queued.ticket, stopping()),
            Some(queued) => self.start_search(scene, queued),
            None => {}
        }
    }

    fn start_search(&mut self, scene: &str, queued: Queued) {
        let assignment = self.assign(queued.taken_up);
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        let Some(current) = &slot.current else { return };
        let options = slot.options(&queued.order, queued.cause);
        let record = (queued.cause == Cause::Edit).then(|| slot.plans.take_record()).flatten();
        let flight = Flight {
            snapshot: current.snapshot.clone(),
            settings: current.session.settings().clone(),
            options,
            record,
            under_way: slot.flown.as_ref().map(Flown::under_way),
            cause: queued.cause,
            field_s: queued.field_s,
        };
        self.owners.insert(assignment.job, scene.into());
        self.workshop.plan(assignment.clone(), flight);
        slot.search = Some(Search { assignment, ticket: queued.ticket, order: queued.order, cause: queued.cause });
    }

    /// Ends the search that runs on `scene`, and tells whoever waits for it that `by` took its place.
    pub(super) fn supersede_search(&mut self, ports: &Ports, scene: &str, by: &str) {
        let Some(search) = self.scenes.get_mut(scene).and_then(|slot| slot.search.take()) else { return };
        search.assignment.stop.abandon();
        self.owners.remove(&search.assignment.job);
        match search.cause {
            Cause::Request => self.refuse_superseded(ports, scene, [search.ticket], by),
            Cause::Edit => self.supersede_replans(ports, scene, [search.ticket], by),
        }
    }

    /// Ends the search that waits on `scene`.
    pub(super) fn supersede_queued(&mut self, ports: &Ports, scene: &str, by: &str) {
        let Some(queued) = self.scenes.get_mut(scene).and_then(|slot| slot.queued.take()) else { return };
        match queued.cause {
            Cause::Request => self.refuse_superseded(ports, scene, [queued.ticket], by),
            Cause::Edit => self.supersede_replans(ports, scene, [queued.ticket], by),
        }
    }

    /// Gives up the edits of `scene` that are not made yet.
    pub(super) fn supersede_edits(&mut self, ports: &Ports, scene: &str, by: &str) {
        let edits = self.scenes.get_mut(scene).map(|slot| slot.edits.give_up());
        self.refuse_superseded(ports, scene, edits.into_iter().flatten(), by);
    }

    /// Gives up the loads into `scene` that were asked for before `request`.
    pub(super) fn supersede_loads(&mut self, ports: &Ports, scene: &str, request: JobId, by: &str) {
        let Some(slot) = self.scenes.get_mut(scene) else { return };
        let (older, newer): (Vec<_>, Vec<_>) =
            std::mem::take(&mut slot.loads).into_iter().partition(|load| load.request < request);
        slot.loads = newer;
        older.iter().for_each(|load| load.assignment.stop.abandon());
        self.refuse_superseded(ports, scene, older.into_iter().map(|load| load.ticket), by);
    }

    pub(super) fn refuse_superseded(&mut self, ports: &Ports, scene: &str, tickets: impl IntoIterator<Item = Ticket>, by: &str) {
        for ticket in tickets {
            let message = format!("{by} on the scene {scene:?} took the place of this request; ask again if it is still wanted");
            self.refuse(ports, ticket, Refusal::new(RefusalCode::Superseded, message));
        }
    }

    /// Tells whoever waits for the plan after an edit that it will not come. The edit itself was answered before, and stays made.
    pub(super) fn supersede_replans(&mut self, ports: &Ports, scene: &str, tickets: impl IntoIterator<Item = Ticket>, by: &str) {
        for ticket in tickets {
            let message = format!("the edit is made; {by} on the scene {scene:?} took the place of its replan");
            tracing::info!(client = ticket.client, correlation = ticket.correlation, message, "replan superseded");
            let refusal = Refusal::new(RefusalCode::Superseded, message);
            self.answer(ports, ticket, &Reply::Refused(refusal), false);
        }
    }

    /// Answers a request; with `follows` another result comes later under the same ticket.
    pub(super) fn answer(&mut self, ports: &Ports, ticket: Ticket, reply: &Reply, follows: bool) {
        self.ledger.answer(ticket, reply, follows);
        tell(ports, ticket, reply);
    }

    pub(super) fn refuse(&mut self, ports: &Ports, ticket: Ticket, refusal: Refusal) {
        tracing::info!(client = ticket.client, correlation = ticket.correlation, code = ?refusal.code, %refusal, "refused");
        self.answer(ports, ticket, &Reply::Refused(refusal), false);
    }
}

/// Sends a reply that need not be remembered. A reply that is lost is asked for again.
pub(super) fn tell(ports: &Ports, ticket: Ticket, reply: &Reply) {
    if let Err(error) = ports.reply(ticket, reply) {
        tracing::warn!(%error, client = ticket.client, "a client did not get its reply");
    }
}

pub(super) fn stopping() -> Refusal {
    Refusal::new(RefusalCode::Stopping, "the daemon is ending; start it again with `overfly serve`")
}
