//! Work that takes longer than the main loop may pause: reading scene files, building fields, searching. Every job has a thread
//! of its own and posts what it found; it never touches the daemon's state. Only what is parallel inside of it runs in the compute
//! pool, and a search after an edit in threads that stand back behind it, so that jobs share the processor and none waits for another.

use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use overfly_table::Block;
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
use crate::planner::{self, Conduct, Made, PlanError, PlanOptions, Progress, StopToken, en_route};
use crate::scene::Scene;
use crate::scene::anchor::Anchor;
use crate::session::{FieldError, Findings, Session, Snapshot};
use crate::settings::Settings;
use crate::stop::Part;
use crate::trajectory::plan::{Plan, RunTimes, StopReason};
use crate::trajectory::record::Record;

/// Shortest time between two progress notes.
const NOTE_GAP: Duration = Duration::from_millis(25);

/// How often it is told how much of a field is built.
const FIELD_NOTE_GAP: Duration = Duration::from_millis(100);

/// A search waits no longer than this for its first safe plan to be published.
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
    /// A plan that comes before the one that the job is for: not the last news.
    Interim(PlannedFlight, Attended),
    /// What images capture that were reported as taken: not the last news.
    Evaluated(Box<Evaluated>),
    Planned(PlannedFlight),
    Failed(Failure),
}

impl NewsKind {
    pub fn is_last(&self) -> bool {
        !matches!(self, Self::Progress(_) | Self::Interim(..) | Self::Evaluated(_))
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
    /// What its images see, for the plan after the next edit.
    pub record: Record,
    /// How it differs from what was ordered.
    pub remark: Option<String>,
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
    /// A session whose scene was edited, with the field before.
    Edited { session: Box<Session>, earlier: Snapshot },
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
            workshop.build_field(assignment, source, &channel).map(|built| NewsKind::Built(Box::new(built)))
        });
    }

    /// Plans one flight.
    pub fn plan(&self, assignment: Assignment, flight: Flight) {
        self.spawn(assignment, move |workshop, assignment| workshop.plan_flight(assignment, flight).map(NewsKind::Planned));
    }

    fn build_field(&self, assignment: &Assignment, source: FieldSource, channel: &FieldChannel) -> Result<BuiltField, Failure> {
        let started = Instant::now();
        let stop = &assignment.stop;
        // After most edits the field stands before anybody could read how far it has come, and whoever tells of it takes processor from it.
        let is_anew = matches!(source, FieldSource::Scene(..));
        let (session, survey) = match source {
            FieldSource::Scene(scene, settings) => self.tell_while(assignment, Part::Survey, || {
                let session = Session::new(*scene, settings, stop)?;
                let survey = session.survey(stop)?;
                Ok::<_, Failure>((session, survey))
            })?,
            FieldSource::Edited { session, earlier } => {
                let survey = session.survey_after(&earlier, stop)?;
                (*session, survey)
            }
        };
        let is_told = is_anew || started.elapsed() >= FIELD_NOTE_GAP;
        let reserve = |count: usize| self.budget.reserve((count * Block::BYTES) as u64);
        let place = |count: usize, write: &dyn Fn(&mut [Block])| Ok(channel.segment(count, reserve(count)?, write)?);
        let build = || survey.build::<Failure>(&place, stop);
        let findings = if is_told { self.tell_while(assignment, Part::Rays, build) } else { build() }?;
        let count = findings.blocks();
        let filled = channel.fill(count, reserve(count)?, |blocks| findings.write(blocks))?;
        if stop.is_stopped() {
            return Err(Failure::Stopped);
        }
        Ok(BuiltField { session, findings, filled, field_s: started.elapsed().as_secs_f64() })
    }

    fn plan_flight(&self, assignment: &Assignment, mut flight: Flight) -> Result<PlannedFlight, Failure> {
        let started = Instant::now();
        let mut record = flight.record.take();
        let flight = &flight;
        let (mut noted, mut searched) = (None::<Instant>, started);
        let mut on_progress = |progress: &Progress| {
            searched = Instant::now();
            let last = progress.iteration >= progress.iterations;
            if last || noted.is_none_or(|time| searched - time >= NOTE_GAP) {
                noted = Some(searched);
                self.post(assignment, NewsKind::Progress(note(assignment, progress)));
            }
        };
        let mut on_interim = |Made { plan, record }: Made| {
            let times = times(assignment, flight, started, Instant::now());
            let is_first = plan.stop == StopReason::Repaired;
            let (attended, done) = attend();
            self.post(assignment, NewsKind::Interim(PlannedFlight { plan, times, record, remark: None }, attended));
            // The search that follows takes all cores: it waits until the first safe plan is out.
            if is_first {
                let _ = done.recv_timeout(MOST_PAUSE);
            }
        };
        let mut options = flight.options.clone();
        if let Some((under_way, en_route)) = flight.under_way.as_ref().zip(options.en_route.as_mut()) {
            let evaluated = under_way.evaluate(en_route, &assignment.stop).ok_or(Failure::Stopped)?;
            self.post(assignment, NewsKind::Evaluated(Box::new(evaluated)));
        }
        // Nobody stands back before there is a flight.
        let pool = options.earlier.as_ref().and_then(|_| self.search_pools.take());
        let mut search = |options: &PlanOptions| {
            let conduct = Conduct {
                stop: &assignment.stop,
                on_progress: &mut on_progress,
                on_interim: &mut on_interim,
                search_threads: pool.as_deref(),
            };
            planner::replan(&flight.snapshot, &flight.settings, options, record.take(), conduct)
        };
        let (Made { plan, record }, remark) = match (search(&options), flight.cause) {
            // The start is that of an earlier order, and nobody asked for it in the scene as it is now.
            (Err(error @ PlanError::Start { .. }), Cause::Edit) => {
                let remark = format!("since an edit {}; another start was chosen", without_remedy(&error));
                (search(&PlanOptions { start_m: None, ..options.clone() })?, Some(remark))
            }
            (made, _) => (made?, short_sight(flight)),
        };
        let remarks: Vec<String> = en_route::remark(&plan).into_iter().chain(remark).collect();
        let remark = (!remarks.is_empty()).then(|| remarks.join("; "));
        let times = times(assignment, flight, started, searched);
        Ok(PlannedFlight { plan, times, record, remark })
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

/// What a plan took whose search ended at `searched`.
fn times(assignment: &Assignment, flight: &Flight, started: Instant, searched: Instant) -> RunTimes {
    RunTimes {
        field_s: flight.field_s,
        search_s: (searched - started).as_secs_f64(),
        check_s: searched.elapsed().as_secs_f64(),
        total_s: assignment.taken_up.elapsed().as_secs_f64(),
        threads: u32::try_from(rayon::current_num_threads()).unwrap_or(u32::MAX),
    }
}

fn note(assignment: &Assignment, progress: &Progress) -> ProgressNote {
    ProgressNote {
        stage: Stage::Search,
        done: progress.iteration,
        of: progress.iterations,
        coverage_percent: progress.coverage_percent,
        length_m: progress.length_m,
        objective: progress.objective,
        elapsed_s: assignment.taken_up.elapsed().as_secs_f64(),
    }
}

/// What there is to say when the field was built for cameras of another sight than the rig's.
fn short_sight(flight: &Flight) -> Option<String> {
    let rig = &flight.options.rig;
    let (has, needs) = (flight.settings.coverage.sight_scale, rig.sight_scale());
    (has != needs).then(|| {
        format!(
            "the field was built for cameras that see {has} times as far as the reference, those of {:?} see {needs} times as far; \
             `overfly serve --rig` builds fields for it",
            rig.name
        )
    })
}

/// What an error says, without what to do about it: that is done already.
fn without_remedy(error: &PlanError) -> String {
    let text = error.to_string();
    text.split(';').next().unwrap_or_default().to_owned()
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
