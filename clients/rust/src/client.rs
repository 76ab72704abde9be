//! What a program can ask of the daemon.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use overfly_wire::service::{LOOK_AGAIN, ServiceError};
use overfly_wire::{
    Domain, EditOrder, FlightReport, Loaded, PlanOrder, ProgressNote, ReadOrder, RefusalCode, Reply, Request, Status,
    StructureInfo, Updated, ZoneInfo,
};

use crate::error::ClientError;
use crate::field::FieldMap;
use crate::link::Link;
use crate::plan::{PlanMessage, PlanWatch};
use crate::status::StatusFeed;

/// How long a daemon may take to acknowledge a request.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often somebody who waits for a replan asks what became of it.
const ASK_AGAIN: Duration = Duration::from_millis(500);
/// Plans that came before anybody asked for them.
const KEPT_PLANS: usize = 8;

/// Where a scene comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneSource {
    /// A file that the daemon can read.
    Path(PathBuf),
    /// A surface model (DSM) and the model of its ground (DTM), both GeoTIFF files that the daemon can read.
    PathOverGround { path: PathBuf, ground: PathBuf },
    /// The content of a file, which is sent. The name tells its format and names the scene, best as an absolute path: a file called
    /// `buildings.geojson` is named after its folder.
    Bytes { file_name: String, bytes: Vec<u8> },
}

/// An edit that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Edited {
    pub scene: String,
    /// The scene's revision from now on.
    pub revision: u64,
    /// The scene has been planned before, so a new plan will be published: see [`Client::await_replan`].
    pub replan_follows: bool,
    /// Number of the request; the replan carries it.
    pub correlation: u64,
}

/// A connection to the daemon of a domain.
pub struct Client {
    link: Link,
    kept: RefCell<VecDeque<PlanMessage>>,
}

impl Client {
    /// Connects to the daemon of `domain`, and waits for it to start for as long as `timeout` allows.
    pub fn connect(domain: &Domain, timeout: Duration) -> Result<Self, ClientError> {
        let end = Instant::now() + timeout;
        loop {
            match Self::try_connect(domain, end) {
                // A service can also fail because a daemon is starting or ending at this very moment.
                Err(ClientError::NoDaemon { .. } | ClientError::Service(ServiceError::Failed { .. })) if Instant::now() < end => {
                    std::thread::sleep(Duration::from_millis(2));
                }
                other => return other,
            }
        }
    }

    /// Loads a scene, builds its field and returns when both are ready. `name` replaces the name that the file gives; a scene that
    /// already has this name is replaced.
    pub fn load(
        &self,
        source: SceneSource,
        name: Option<&str>,
        on_progress: &mut dyn FnMut(&ProgressNote),
    ) -> Result<Loaded, ClientError> {
        self.load_as(source, name, &ReadOrder::default(), on_progress)
    }

    /// The same for a file that does not say itself how it is to be read.
    pub fn load_as(
        &self,
        source: SceneSource,
        name: Option<&str>,
        order: &ReadOrder,
        on_progress: &mut dyn FnMut(&ProgressNote),
    ) -> Result<Loaded, ClientError> {
        let (name, order) = (name.map(str::to_owned), Box::new(order.clone()));
        let (request, bulk) = match source {
            SceneSource::Bytes { file_name, bytes } => (Request::LoadBytes { file_name, name, order }, bytes),
            SceneSource::Path(path) => (Request::LoadPath { path: absolute(path)?, ground: None, name, order }, Vec::new()),
            SceneSource::PathOverGround { path, ground } => {
                let ground = Some(absolute(ground)?);
                (Request::LoadPath { path: absolute(path)?, ground, name, order }, Vec::new())
            }
        };
        match self.link.call(&request, &bulk, PATIENCE, on_progress)?.1 {
            Reply::Loaded(loaded) => Ok(loaded),
            other => Err(unexpected(&other)),
        }
    }

    /// Drops a scene and its field.
    pub fn unload(&self, scene: &str) -> Result<(), ClientError> {
        self.done(&Request::Unload { scene: scene.into() })
    }

    /// Plans one flight and returns when the plan is published. A newer request for the same scene ends this one with a refusal of
    /// code [`RefusalCode::Superseded`].
    pub fn plan(
        &self,
        scene: &str,
        order: &PlanOrder,
        on_progress: &mut dyn FnMut(&ProgressNote),
    ) -> Result<PlanMessage, ClientError> {
        let request = Request::Plan { scene: scene.into(), order: Box::new(order.clone()) };
        let (correlation, reply) = self.link.call(&request, &[], PATIENCE, on_progress)?;
        let Reply::Planned { epoch } = reply else { return Err(unexpected(&reply)) };
        self.published(scene, correlation, epoch)
    }

    /// Tells where an aircraft is on its flight and what it has captured. What is planned from now on goes on from there, also after an edit. A refusal of
    /// code [`RefusalCode::Hold`] or [`RefusalCode::Land`] in place of a plan says what the aircraft has to do.
    pub fn report(&self, scene: &str, report: &FlightReport) -> Result<(), ClientError> {
        self.done(&Request::Progress { scene: scene.into(), report: report.clone() })
    }

    /// Ends the running search of a scene. Whoever asked for it receives the best plan so far.
    pub fn cancel(&self, scene: &str) -> Result<(), ClientError> {
        self.done(&Request::Cancel { scene: scene.into() })
    }

    /// Changes a structure or a no-fly zone of a scene. Returns when the field of the changed scene stands; a scene that has been planned before is then
    /// replanned: see [`Client::await_replan`].
    pub fn edit(&self, scene: &str, edit: &EditOrder) -> Result<Edited, ClientError> {
        self.edit_all(scene, std::slice::from_ref(edit))
    }

    /// Makes edits together: one after the other as one revision with one new field and one replan, or none of them. A refusal says which one cannot be
    /// made and why.
    pub fn edit_all(&self, scene: &str, edits: &[EditOrder]) -> Result<Edited, ClientError> {
        let request = Request::Edit { scene: scene.into(), edits: edits.to_vec() };
        // Else one that is too large would be refused for its length alone.
        request.check()?;
        match self.link.call(&request, &[], PATIENCE, &mut |_| {})? {
            (correlation, Reply::Edited { revision, replan_follows }) => {
                Ok(Edited { scene: scene.into(), revision, replan_follows, correlation })
            }
            (_, other) => Err(unexpected(&other)),
        }
    }

    /// Changes what differs between a scene and a new version of its file, as by edits that are made together; with `dry_run` that is only told. The file is
    /// put into the frame of the scene; one that does not fit there is refused. Obstacles and zones that edits have added stay. The first of the result
    /// is for [`Client::await_replan`].
    pub fn update(
        &self,
        scene: &str,
        source: SceneSource,
        dry_run: bool,
        on_progress: &mut dyn FnMut(&ProgressNote),
    ) -> Result<(Edited, Updated), ClientError> {
        let scene = scene.to_owned();
        let (request, bulk) = match source {
            SceneSource::Bytes { file_name, bytes } => (Request::UpdateBytes { scene: scene.clone(), file_name, dry_run }, bytes),
            SceneSource::Path(path) => {
                (Request::UpdatePath { scene: scene.clone(), path: absolute(path)?, ground: None, dry_run }, Vec::new())
            }
            SceneSource::PathOverGround { path, ground } => {
                let ground = Some(absolute(ground)?);
                (Request::UpdatePath { scene: scene.clone(), path: absolute(path)?, ground, dry_run }, Vec::new())
            }
        };
        match self.link.call(&request, &bulk, PATIENCE, on_progress)? {
            (correlation, Reply::Updated(updated)) => {
                let (revision, replan_follows) = (updated.revision, updated.replan_follows);
                Ok((Edited { scene, revision, replan_follows, correlation }, updated))
            }
            (_, other) => Err(unexpected(&other)),
        }
    }

    /// Waits for the plan that follows an edit. When a later edit has taken its place the refusal has the code
    /// [`RefusalCode::Superseded`].
    pub fn await_replan(
        &self,
        edited: &Edited,
        timeout: Duration,
        on_progress: &mut dyn FnMut(&ProgressNote),
    ) -> Result<PlanMessage, ClientError> {
        let started = Instant::now();
        let request = Request::Outcome { correlation: edited.correlation };
        while started.elapsed() < timeout {
            if let Some(plan) = self.take_plan(edited.correlation)? {
                return Ok(plan);
            }
            // The daemon answers `Acknowledged` while it works, and the outcome as soon as it stands.
            let mut exchange = self.link.begin(&request, &[], PATIENCE)?;
            let asked = Instant::now();
            while asked.elapsed() < ASK_AGAIN && started.elapsed() < timeout {
                match self.link.step(&mut exchange, LOOK_AGAIN)? {
                    Some(Reply::Planned { epoch }) => return self.published(&edited.scene, edited.correlation, epoch),
                    Some(Reply::Progress(note)) => on_progress(&note),
                    // The answer to the edit itself may be repeated.
                    Some(Reply::Acknowledged | Reply::Edited { .. } | Reply::Updated(_)) | None => {}
                    Some(other) => return Err(unexpected(&other)),
                }
                if let Some(plan) = self.take_plan(edited.correlation)? {
                    return Ok(plan);
                }
            }
        }
        let what = format!("the replan of {:?}", edited.scene);
        Err(ClientError::Timeout { what, seconds: timeout.as_secs_f64() })
    }

    /// Receives each plan of a scene from now on, whoever asked for it.
    pub fn watch(&self, scene: &str) -> Result<PlanWatch, ClientError> {
        self.locate(scene)?;
        let watch = PlanWatch::open(&self.link.domain, scene)?;
        // The ping's answer says that the daemon has seen the new subscriber.
        self.link.attach();
        self.ping()?;
        Ok(watch)
    }

    /// Has the last plan of a scene published once more, for a watch that was opened after it. Returns its epoch; a scene that has none is refused with
    /// the code [`RefusalCode::UnknownScene`].
    pub fn publish_again(&self, scene: &str) -> Result<u64, ClientError> {
        match self.link.call(&Request::Republish { scene: scene.into() }, &[], PATIENCE, &mut |_| {})?.1 {
            Reply::Planned { epoch } => Ok(epoch),
            other => Err(unexpected(&other)),
        }
    }

    /// Receives the status now and whenever it changes.
    pub fn status_feed(&self) -> Result<StatusFeed, ClientError> {
        let feed = StatusFeed::open(&self.link.domain)?;
        self.link.attach();
        Ok(feed)
    }

    /// Maps the current field of a scene read-only, where it lies.
    pub fn field(&self, scene: &str) -> Result<FieldMap, ClientError> {
        let epoch = self.locate(scene)?;
        FieldMap::open(&self.link, scene, epoch, Instant::now() + PATIENCE)
    }

    pub fn status(&self) -> Result<Status, ClientError> {
        match self.link.call(&Request::Status, &[], PATIENCE, &mut |_| {})?.1 {
            Reply::Status(status) => Ok(status),
            other => Err(unexpected(&other)),
        }
    }

    /// The structures of a scene, sorted by id.
    pub fn structures(&self, scene: &str) -> Result<Vec<StructureInfo>, ClientError> {
        match self.link.call(&Request::Structures { scene: scene.into() }, &[], PATIENCE, &mut |_| {})?.1 {
            Reply::Structures(structures) => Ok(structures),
            other => Err(unexpected(&other)),
        }
    }

    /// The no-fly zones of a scene; those of the configuration are not among them.
    pub fn zones(&self, scene: &str) -> Result<Vec<ZoneInfo>, ClientError> {
        match self.link.call(&Request::Zones { scene: scene.into() }, &[], PATIENCE, &mut |_| {})?.1 {
            Reply::Zones(zones) => Ok(zones),
            other => Err(unexpected(&other)),
        }
    }

    /// Reads the daemon's configuration file again; scenes that are loaded keep what they were loaded with.
    pub fn reload(&self) -> Result<(), ClientError> {
        self.done(&Request::Reload)
    }

    /// Ends the daemon and returns when it has left the domain.
    pub fn stop(&self) -> Result<(), ClientError> {
        self.done(&Request::Stop)?;
        let asked = Instant::now();
        while self.link.domain.is_locked() {
            if asked.elapsed() > PATIENCE {
                return Err(ClientError::Timeout { what: "the end of the daemon".into(), seconds: PATIENCE.as_secs_f64() });
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    /// Time from a request to its acknowledgement.
    pub fn ping(&self) -> Result<Duration, ClientError> {
        let sent = Instant::now();
        self.link.call(&Request::Ping, &[], PATIENCE, &mut |_| {})?;
        Ok(sent.elapsed())
    }

    /// This client as plans name it: see [`PlanMessage::asked_by`].
    pub fn id(&self) -> u64 {
        self.link.id
    }

    fn try_connect(domain: &Domain, end: Instant) -> Result<Self, ClientError> {
        let no_daemon = || ClientError::NoDaemon { domain: domain.name().into() };
        if !domain.seems_served() {
            return Err(no_daemon());
        }
        let link = match Link::open(domain) {
            Ok(link) => link,
            Err(ClientError::Service(ServiceError::Missing(_))) => return Err(no_daemon()),
            Err(other) => return Err(other),
        };
        link.attach();
        let patience = end.saturating_duration_since(Instant::now()).max(Duration::from_millis(300));
        match link.call(&Request::Hello, &[], patience, &mut |_| {}) {
            Ok((_, Reply::Welcome { .. })) => Ok(Self { link, kept: RefCell::default() }),
            Ok((_, other)) => Err(unexpected(&other)),
            Err(ClientError::NoAnswer { .. } | ClientError::Lost { .. }) => Err(no_daemon()),
            Err(other) => Err(other),
        }
    }

    fn done(&self, request: &Request) -> Result<(), ClientError> {
        match self.link.call(request, &[], PATIENCE, &mut |_| {})?.1 {
            Reply::Done => Ok(()),
            other => Err(unexpected(&other)),
        }
    }

    /// Epoch of the scene's current field.
    fn locate(&self, scene: &str) -> Result<u64, ClientError> {
        match self.link.call(&Request::Locate { scene: scene.into() }, &[], PATIENCE, &mut |_| {})?.1 {
            Reply::Located { epoch, .. } => Ok(epoch),
            other => Err(unexpected(&other)),
        }
    }

    /// The plan of this correlation, which the daemon says it has published; asks for it once more when it was lost on the way.
    fn published(&self, scene: &str, correlation: u64, epoch: u64) -> Result<PlanMessage, ClientError> {
        let started = Instant::now();
        while started.elapsed() < PATIENCE {
            for _ in 0..3 {
                if let Some(plan) = self.take_plan(correlation)? {
                    return Ok(plan);
                }
                self.link.wait_for_news(LOOK_AGAIN)?;
            }
            self.link.attach();
            match self.link.call(&Request::Republish { scene: scene.into() }, &[], PATIENCE, &mut |_| {}) {
                Err(ClientError::Refused { code: RefusalCode::UnknownScene, message }) => {
                    return Err(ClientError::Refused { code: RefusalCode::Superseded, message });
                }
                Ok((_, Reply::Planned { epoch: last })) if last == epoch => {}
                // It may have arrived together with the newer one.
                Ok((_, Reply::Planned { .. })) => return self.take_plan(correlation)?.ok_or_else(|| replaced(scene)),
                Ok((_, other)) => return Err(unexpected(&other)),
                Err(error) => return Err(error),
            }
        }
        Err(ClientError::Timeout { what: format!("the plan of {scene:?}"), seconds: PATIENCE.as_secs_f64() })
    }

    /// Takes the plan of this correlation out of those that have come; others of this client are kept for later.
    fn take_plan(&self, correlation: u64) -> Result<Option<PlanMessage>, ClientError> {
        let mut kept = self.kept.borrow_mut();
        while let Some(sample) = self.link.plans.receive().map_err(|error| ClientError::Receive(format!("{error:?}")))? {
            if sample.user_header().client != self.link.id {
                continue;
            }
            kept.push_back(PlanMessage::copy(&sample)?);
            if kept.len() > KEPT_PLANS {
                kept.pop_front();
            }
        }
        let found = kept.iter().position(|plan| plan.asked_by() == (self.link.id, correlation));
        Ok(found.and_then(|index| kept.remove(index)))
    }
}

/// The bytes of an absolute path.
fn absolute(path: PathBuf) -> Result<Vec<u8>, ClientError> {
    let absolute = std::path::absolute(&path).map_err(|cause| ClientError::Path { path, cause })?;
    Ok(absolute.as_os_str().as_bytes().to_vec())
}

fn replaced(scene: &str) -> ClientError {
    let message = format!("a newer plan of the scene {scene:?} was published before this one was received; ask for that one");
    ClientError::Refused { code: RefusalCode::Superseded, message }
}

fn unexpected(reply: &Reply) -> ClientError {
    ClientError::Unexpected(format!("{reply:?}").chars().take(80).collect())
}
