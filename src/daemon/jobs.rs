//! Work that takes longer than the main loop may pause: reading scene files, building fields, searching. Every job has a thread
//! of its own and posts what it found; it never touches the daemon's state. Only what is parallel inside of it runs in the compute
//! pool, and a search after an edit in threads that stand back behind it, so that jobs share the processor and none waits for another.

mod field;
mod flight;

use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use overfly_wire::{ProgressNote, Refusal, RefusalCode, Stage};

use super::budget::{Budget, OverBudget};
use super::convert;
use super::crew::{self, Crew};
use super::field_channel::{FieldChannel, FieldChannelError, FilledField};
use super::flown::{Evaluated, UnderWay};
use super::scene_file::{self, SceneFile};
use super::scenes::Cause;
use super::threads::SearchPools;
use super::wake::Mail;
use crate::planner::{Made, PlanError, PlanOptions, StopToken};
use crate::scene::Scene;
use crate::scene::anchor::Anchor;
use crate::session::{FieldError, Findings, Session, Snapshot};
use crate::settings::Settings;
use crate::stop::Part;
use crate::trajectory::known::SafeFlight;
use crate::trajectory::plan::{Plan, RunTimes};
use crate::trajectory::record::Record;

/// How often it is told how much of a field is built.
const FIELD_NOTE_GAP: Duration = Duration::from_millis(100);

/// Work that goes on waits no longer than this for its first safe plan to be published.
const MOST_PAUSE: Duration = Duration::from_millis(5);

/// News that somebody waits for to be dealt with: they are when this is dropped.
#[derive(Debug)]
pub struct Attended(#[allow(dead_code, reason = "it is there to be dropped")] Sender<Infallible>);

fn attend() -> (Attended, Receiver<Infallible>) {
    let (attended, done) = mpsc::channel();
    (Attended(attended), done)
}

/// Number of a job; each is used once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct JobId(pub u64);

/// What a job tells the main loop.
#[derive(Debug)]
pub struct News {
    pub job: JobId,
    pub kind: NewsKind,
}

/// The last news of a job is everything but progress, a plan on the way and what images capture.
#[derive(Debug)]
pub enum NewsKind {
    Progress(ProgressNote),
    Read(Box<SceneFile>),
    Built(Box<BuiltField>),
    /// What can be flown at once in a scene whose field is being built: not the last news.
    Safe(PlannedFlight, Attended),
    /// A plan that comes before the one that the job is for: not the last news.
    Interim(PlannedFlight, Attended),
    /// What images capture that were reported as taken: not the last news.
    Evaluated(Box<Evaluated>),
    Planned(PlannedFlight),
    Failed(Failure),
}

impl NewsKind {
    pub fn is_last(&self) -> bool {
        !matches!(self, Self::Progress(_) | Self::Safe(..) | Self::Interim(..) | Self::Evaluated(_))
    }
}

/// Why a job has no result.
#[derive(Debug)]
pub enum Failure {
    /// It was asked to stop, and whoever asked knows why.
    Stopped,
    Refused(Refusal),
}

/// A field that is ready to be published, with everything that belongs to it.
#[derive(Debug)]
pub struct BuiltField {
    pub session: Session,
    pub findings: Findings,
    pub filled: FilledField,
    pub field_s: f64,
}

/// A plan that will be published.
#[derive(Debug)]
pub struct PlannedFlight {
    pub plan: Plan,
    pub times: RunTimes,
    /// What its images see, for the plan after the next edit; `None` where nobody has looked yet.
    pub record: Option<Record>,
    /// The flight as it was found safe.
    pub safe: Option<Arc<SafeFlight>>,
    /// How it differs from what was ordered.
    pub remark: Option<String>,
}

impl PlannedFlight {
    fn of(Made { plan, record }: Made, times: RunTimes, remark: Option<String>) -> Self {
        let safe = record.flight.clone();
        Self { plan, times, record: Some(record), safe, remark }
    }
}

/// What every job needs.
#[derive(Clone, Debug)]
pub struct Workshop {
    pub crew: Arc<Crew>,
    /// Threads for searches after an edit, once their first safe plan is out; everything else that is parallel runs in the pool of the process.
    pub search_pools: Arc<SearchPools>,
    pub budget: Arc<Budget>,
    pub mail: Mail<News>,
}

/// A job's place: its number, its stop flag and when its request was taken up.
#[derive(Clone, Debug)]
pub struct Assignment {
    pub job: JobId,
    pub stop: StopToken,
    pub taken_up: Instant,
}

/// Where a scene file comes from.
#[derive(Debug)]
pub enum FileSource {
    /// A surface model with the model of its ground where one is named.
    Path {
        path: PathBuf,
        ground: Option<PathBuf>,
    },
    Bytes {
        file_name: String,
        bytes: Vec<u8>,
    },
}

/// What a field is built of.
pub enum FieldSource {
    /// A scene that was just read: its field settings are pinned now.
    Scene(Box<Scene>, Arc<Settings>),
    /// A session whose scene was edited, with the field before, and the flight that is to be safe in it.
    Edited { session: Box<Session>, earlier: Snapshot, flight: Option<Box<FlightBefore>> },
}

/// A flight over a scene that is edited.
pub struct FlightBefore {
    /// With its waypoints, and where the aircraft is on it.
    pub options: PlanOptions,
    pub safe: Option<Arc<SafeFlight>>,
}

/// A search.
pub struct Flight {
    pub snapshot: Snapshot,
    pub settings: Arc<Settings>,
    pub options: PlanOptions,
    /// What the images of the flight see that the options go on with.
    pub record: Option<Record>,
    /// The flight that it goes on with.
    pub under_way: Option<UnderWay>,
    pub cause: Cause,
    /// Time that building the field took when that belongs to this request, s.
    pub field_s: f64,
}

impl Workshop {
    /// Reads a scene file; with an anchor in the frame of a scene that was read before.
    pub fn read(&self, assignment: Assignment, source: FileSource, settings: Arc<Settings>, anchor: Option<Anchor>) {
        self.spawn(assignment, move |workshop, assignment| {
            let max_bytes = settings.daemon.max_scene_mb.saturating_mul(1_000_000);
            let read = workshop.tell_while(assignment, Part::Reading, || match source {
                FileSource::Path { path, ground } => {
                    scene_file::read_path(&path, ground.as_deref(), max_bytes, &settings.proxy, anchor.as_ref(), &assignment.stop)
                }
                FileSource::Bytes { file_name, bytes } => {
                    scene_file::read_bytes(&file_name, &bytes, &settings.proxy, anchor.as_ref())
                }
            });
            Ok(NewsKind::Read(Box::new(read.map_err(Failure::Refused)?)))
        });
    }

    /// Builds a field in the shared memory where it will be read.
    pub fn build(&self, assignment: Assignment, source: FieldSource, channel: Arc<FieldChannel>) {
        self.spawn(assignment, move |workshop, assignment| {
            let is_edited = matches!(source, FieldSource::Edited { .. });
            let build = || workshop.build_field(assignment, source, &channel).map(|built| NewsKind::Built(Box::new(built)));
            // After an edit all is over in milliseconds, and what is done side by side begins sooner for who is one of the threads that do it.
            if is_edited { rayon::scope(|_| build()) } else { build() }
        });
    }

    /// Plans one flight.
    pub fn plan(&self, assignment: Assignment, flight: Flight) {
        self.spawn(assignment, move |workshop, assignment| workshop.plan_flight(assignment, flight).map(NewsKind::Planned));
    }

    /// Runs `work` on a thread of its own, as soon as there is one. A panic in it is a defect that costs the request, not the daemon.
    fn spawn<W>(&self, assignment: Assignment, work: W)
    where
        W: FnOnce(&Workshop, &Assignment) -> Result<NewsKind, Failure> + Send + 'static,
    {
        let workshop = self.clone();
        let (job, stop, mail) = (assignment.job, assignment.stop.clone(), self.mail.clone());
        let body = move || {
            let work = || if assignment.stop.is_abandoned() { Err(Failure::Stopped) } else { work(&workshop, &assignment) };
            let done = catch_unwind(AssertUnwindSafe(work));
            let done = done.unwrap_or_else(|panic| Err(Failure::Refused(defect(&*panic))));
            mail.post(News { job, kind: done.unwrap_or_else(NewsKind::Failed) });
        };
        if let Err(error) = self.crew.take_on(crew::Job { stop, run: Box::new(body) }) {
            let refusal = Refusal::new(RefusalCode::Busy, format!("no thread can be started ({error}); try again later"));
            self.mail.post(News { job, kind: NewsKind::Failed(Failure::Refused(refusal)) });
        }
    }

    /// Tells that `work` on a part begins, and again and again how far it has come.
    fn tell_while<T>(&self, assignment: &Assignment, part: Part, work: impl FnOnce() -> T) -> T {
        assignment.stop.begin(part, 0);
        self.note(assignment);
        let (at_work, is_over) = mpsc::channel::<Infallible>();
        std::thread::scope(|scope| {
            let tell = move || {
                while is_over.recv_timeout(FIELD_NOTE_GAP) == Err(RecvTimeoutError::Timeout) {
                    self.note(assignment);
                }
            };
            // Without a thread for it nobody is told.
            let _ = std::thread::Builder::new().name("progress".into()).spawn_scoped(scope, tell);
            let made = work();
            drop(at_work);
            made
        })
    }

    /// Tells how far the counted part of the work has come.
    fn note(&self, assignment: &Assignment) {
        let counted = assignment.stop.progress();
        let stage = match counted.part {
            Part::Reading => Stage::Read,
            Part::Survey => Stage::Survey,
            Part::Rays => Stage::Field,
        };
        let [done, of] = counted.told().map(|steps| u32::try_from(steps).unwrap_or(u32::MAX));
        let elapsed_s = assignment.taken_up.elapsed().as_secs_f64();
        let note = ProgressNote { stage, done, of, coverage_percent: 0.0, length_m: 0.0, objective: 0.0, elapsed_s };
        self.post(assignment, NewsKind::Progress(note));
    }

    fn post(&self, assignment: &Assignment, kind: NewsKind) {
        self.mail.post(News { job: assignment.job, kind });
    }
}

fn threads() -> u32 {
    u32::try_from(rayon::current_num_threads()).unwrap_or(u32::MAX)
}

fn defect(panic: &(dyn std::any::Any + Send)) -> Refusal {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    let text = text.unwrap_or("no message");
    tracing::error!(panic = text, "a worker panicked; this is a defect");
    Refusal::new(
        RefusalCode::Internal,
        format!("the daemon met a defect of its own ({text}); please report it with the scene and the request"),
    )
}

impl From<FieldError> for Failure {
    fn from(error: FieldError) -> Self {
        match error {
            FieldError::Stopped => Failure::Stopped,
            other => Failure::Refused(Refusal::new(RefusalCode::Field, other.to_string())),
        }
    }
}

impl From<FieldChannelError> for Failure {
    fn from(error: FieldChannelError) -> Self {
        Failure::Refused(Refusal::new(RefusalCode::Memory, error.to_string()))
    }
}

impl From<OverBudget> for Failure {
    fn from(error: OverBudget) -> Self {
        Failure::Refused(Refusal::new(RefusalCode::Memory, error.to_string()))
    }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Abandoned => Failure::Stopped,
            other => Failure::Refused(Refusal::new(convert::plan_code(&other), other.to_string())),
        }
    }
}
