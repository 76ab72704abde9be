//! The whole pipeline on one screen.

use geo::{Area, Coord, LineString, Polygon, Validation};
use nalgebra::{Point3, Unit, Vector3};

use crate::baseline::{self, BaselineError};
use crate::camera::{Cameras, Pose, Rig, pitch_rad};
use crate::field::Snapshot;
use crate::refine::{self, Aim, Budget, Confirmed, Counting, Ground, Task, Worth};
use crate::scene::free_space::Obstruction;
use crate::search::objective::PathSums;
use crate::search::{Outcome, Problem, SearchError, Wanted, search};
use crate::settings::{MOST_ITERATIONS, Settings};
use crate::trajectory::evaluate::{self, Capture};
use crate::trajectory::images::Exposed;
use crate::trajectory::limits::Limits;
use crate::trajectory::plan::{Camera, Metrics, Plan, SceneStamp, Waypoint};
use crate::trajectory::profile::Profile;
use crate::trajectory::route::{Found, Route};
use crate::trajectory::safety::{self, UnsafeCurve};
use crate::trajectory::{images, select};

pub use crate::search::Progress;
pub use crate::stop::StopToken;

/// Longest refinement, s.
pub const MOST_BUDGET_S: f64 = 86_400.0;

/// What a user asks for beyond the settings.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanOptions {
    pub rig: Rig,
    pub method: Method,
    pub seed: u64,
    /// Iterations K of the tree search, or rounds of the refinement; `None` takes the setting.
    pub iterations: Option<u32>,
    /// For the refinement: about how long the search may take, s, in place of iterations. It needs a stop token with a clock.
    pub budget_s: Option<f64>,
    /// Coverage goal G, percent of the capturable samples; `None` takes the setting.
    pub goal_percent: Option<f64>,
    /// What the refinement is for.
    pub objective: Objective,
    /// For the refinement: share of the samples that can have enough matched views (`quality.least_views`) that are to have them, percent; `None`
    /// takes the coverage goal, 0 asks for none.
    pub matched_percent: Option<f64>,
    /// For the refinement: the most coverage within this time of the speed profile, s, in place of a goal.
    pub within_s: Option<f64>,
    /// Views with a larger ground sampling distance show nothing, m; `None` for the range of the coverage model.
    pub gsd_m: Option<f64>,
    /// Corners of the area whose samples count, m in the local frame; `None` for the whole scene.
    pub region_m: Option<Vec<[f64; 2]>>,
    /// Where the flight starts, m in the local frame; `None` chooses a start. The baselines begin where their tours do.
    pub start_m: Option<Point3<f64>>,
    /// Where a camera on a gimbal looks at the start; `None` chooses the direction.
    pub start_view: Option<Unit<Vector3<f64>>>,
}

impl PlanOptions {
    /// A plan with everything else left to the planner.
    pub fn new(rig: Rig, method: Method, seed: u64) -> Self {
        Self {
            rig,
            method,
            seed,
            iterations: None,
            budget_s: None,
            goal_percent: None,
            objective: Objective::Time,
            matched_percent: None,
            within_s: None,
            gsd_m: None,
            region_m: None,
            start_m: None,
            start_view: None,
        }
    }

    /// What can be refused before there is a scene.
    pub fn check(&self) -> Result<(), PlanError> {
        if let Some(iterations) = self.iterations.filter(|&iterations| iterations > MOST_ITERATIONS) {
            return Err(PlanError::Iterations { iterations });
        }
        for seconds in [self.budget_s, self.within_s].into_iter().flatten() {
            if self.method != Method::Refined {
                return Err(PlanError::NoSeconds { method: self.method.name() });
            }
            if !(seconds > 0.0 && seconds <= MOST_BUDGET_S) {
                return Err(PlanError::Seconds { seconds });
            }
        }
        if self.budget_s.is_some() && self.iterations.is_some()
            || self.within_s.is_some() && self.goal_percent.or(self.matched_percent).is_some()
        {
            return Err(PlanError::Twofold);
        }
        for goal_percent in [self.goal_percent, self.matched_percent].into_iter().flatten() {
            if !(0.0..=100.0).contains(&goal_percent) {
                return Err(PlanError::Goal { goal_percent });
            }
        }
        let has_goal = self.goal_percent.or(self.matched_percent).or(self.within_s).is_some();
        if self.objective == Objective::Eq6 && (self.method != Method::Refined || has_goal) {
            return Err(PlanError::Eq6);
        }
        if self.matched_percent.is_some() && self.method != Method::Refined {
            return Err(PlanError::NoMatches { method: self.method.name() });
        }
        if let Some(gsd_m) = self.gsd_m.filter(|gsd_m| !(*gsd_m > 0.0 && gsd_m.is_finite())) {
            return Err(PlanError::SamplingDistance { gsd_m });
        }
        self.region().map(|_| ())?;
        let Some(view) = self.start_view else { return Ok(()) };
        let rig = self.rig.name.clone();
        let Cameras::Gimbal { sin_pitch, .. } = &self.rig.cameras else { return Err(PlanError::NoGimbal { rig }) };
        if self.rig.reaches(&view) {
            return Ok(());
        }
        let [least_deg, most_deg] = sin_pitch.map(|sin| libm::asin(sin).to_degrees());
        Err(PlanError::StartView { rig, pitch_deg: pitch_rad(&view).to_degrees(), least_deg, most_deg })
    }
}

impl PlanOptions {
    /// The area whose samples count.
    fn region(&self) -> Result<Option<Polygon>, PlanError> {
        let Some(corners) = &self.region_m else { return Ok(None) };
        let ring: LineString = corners.iter().map(|&[x, y]| Coord { x, y }).collect();
        let region = Polygon::new(ring, Vec::new());
        let is_area = corners.iter().flatten().all(|v| v.is_finite()) && region.is_valid() && region.unsigned_area() > 0.0;
        if is_area { Ok(Some(region)) } else { Err(PlanError::Region) }
    }
}

/// What a flight is refined for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Objective {
    /// The least time of the speed profile at the goals, or the most coverage within a time.
    #[default]
    Time,
    /// The most of the paper's objective (Eq. 6), which has no goals: it weighs information against length and turning.
    Eq6,
}

impl Objective {
    pub const ALL: [Self; 2] = [Self::Time, Self::Eq6];

    pub fn name(self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::Eq6 => "eq6",
        }
    }

    /// The objective called `name`.
    pub fn parse(name: &str) -> Result<Self, PlanError> {
        Self::ALL
            .into_iter()
            .find(|objective| objective.name() == name)
            .ok_or_else(|| PlanError::UnknownObjective(name.to_owned()))
    }
}

/// A way to plan a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The paper's tree, then local search on its flight.
    Refined,
    /// Algorithms 2 to 5 of the paper.
    Paper,
    /// Serpentine lines above all buildings (oblique photography).
    Oblique,
    /// Views and a tour, after Smith et al. 2018.
    Smith,
    /// Views and a tour, after Zhou et al. 2020.
    Zhou,
}

impl Method {
    /// All methods, in the order in which they are listed.
    pub const ALL: [Self; 5] = [Self::Refined, Self::Paper, Self::Oblique, Self::Smith, Self::Zhou];

    pub fn name(self) -> &'static str {
        match self {
            Self::Refined => "refined",
            Self::Paper => "paper",
            Self::Oblique => "op",
            Self::Smith => "smith",
            Self::Zhou => "zhou",
        }
    }

    /// The method called `name`.
    pub fn parse(name: &str) -> Result<Self, PlanError> {
        Self::ALL.into_iter().find(|method| method.name() == name).ok_or_else(|| PlanError::UnknownMethod(name.to_owned()))
    }

    fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    #[error("there is no planning method {0:?}; known methods: {known}", known = Method::names())]
    UnknownMethod(String),
    #[error(
        "the flight cannot start at ({position}): {cause}; give another start in metres of the scene's frame, or none to have one chosen"
    )]
    Start { position: String, cause: Obstruction },
    #[error(
        "the gimbal of {rig:?} cannot look to pitch {pitch_deg:.1} degrees at the start; give a pitch from {least_deg:.1} to {most_deg:.1} \
         degrees, or no view"
    )]
    StartView { rig: String, pitch_deg: f64, least_deg: f64, most_deg: f64 },
    #[error(
        "the rig {rig:?} has no gimbal that could be given a view at the start; give none, or a rig with one camera on a gimbal"
    )]
    NoGimbal { rig: String },
    #[error("{iterations} iterations were asked for; the most is {most}", most = MOST_ITERATIONS)]
    Iterations { iterations: u32 },
    #[error("the method {method:?} takes no seconds, neither for its search nor for the flight; the method \"refined\" does")]
    NoSeconds { method: &'static str },
    #[error("{seconds} s will not do; give more than 0 and at most {most} s", most = MOST_BUDGET_S)]
    Seconds { seconds: f64 },
    #[error("a budget of seconds needs a stop token with a clock (`StopToken::timed`)")]
    NoClock,
    #[error("give either iterations or seconds for the search, and either a coverage goal or a time for the flight")]
    Twofold,
    #[error("there is no objective {0:?}; known objectives: time, eq6")]
    UnknownObjective(String),
    #[error("the objective \"eq6\" is for the method \"refined\" alone, and has no goals and no time for the flight")]
    Eq6,
    #[error("the method {method:?} plans for no matched views; the method \"refined\" does")]
    NoMatches { method: &'static str },
    #[error("a goal of {goal_percent} % will not do; give 0 to 100")]
    Goal { goal_percent: f64 },
    #[error("a ground sampling distance of {gsd_m} m will not do; give a length above 0, such as 0.01")]
    SamplingDistance { gsd_m: f64 },
    #[error("the region crosses itself or has no area; put its corners in order")]
    Region,
    #[error(
        "no flight of {within_s} s was found that captures anything; the shortest one takes {least_s:.1} s: give it more time, or a start \
         nearer to the structures"
    )]
    TooShort { within_s: f64, least_s: f64 },
    #[error(
        "no sample of the scene can be captured: no admissible view of {rig:?} comes within {range_m} m and sees enough of what is wanted; \
         ask for less (region, ground sampling distance), raise `flight.legal_ceiling_m` ({ceiling_m} m) or `coverage.range_m`, or take a rig with a wider view"
    )]
    NothingCapturable { rig: String, range_m: f64, ceiling_m: f64 },
    #[error("the computation was abandoned")]
    Abandoned,
    #[error(transparent)]
    Search(#[from] SearchError),
    #[error(transparent)]
    Baseline(BaselineError),
    #[error("the path failed the final safety check and is withheld: {0}; this is a defect of the planner")]
    Unsafe(#[from] UnsafeCurve),
}

/// The rig that a method really flies: oblique photography puts lenses of its own on the rig's sensors. With [`Settings::with_sight`] of it a
/// field sees as far as its cameras.
pub fn flown_rig(options: &PlanOptions, settings: &Settings) -> Rig {
    match options.method {
        Method::Oblique => baseline::oblique::adapted_rig(&options.rig, &settings.baseline),
        _ => options.rig.clone(),
    }
}

/// Plans one flight on a snapshot. A stop of the token ends the search with the best plan so far; only when the token is abandoned
/// there is none.
pub fn plan(
    snapshot: &Snapshot,
    settings: &Settings,
    options: &PlanOptions,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Plan, PlanError> {
    options.check()?;
    let settings = &with_goal(settings, options.goal_percent);
    let rig = &flown_rig(options, settings);
    let problem = Problem::wanted(snapshot, settings, rig.clone(), &Wanted { region: options.region()?, gsd_m: options.gsd_m });
    if problem.capturable == 0 {
        let (range_m, ceiling_m) = (problem.disks.range_m(), settings.flight.legal_ceiling_m);
        return Err(PlanError::NothingCapturable { rig: rig.name.clone(), range_m, ceiling_m });
    }
    let Found { route, convergence, stop: reason } = match options.method {
        Method::Refined => refined(snapshot, settings, &problem, options, stop, on_progress)?,
        Method::Paper => {
            let iterations = options.iterations.unwrap_or(settings.search.iterations);
            Found::of(tree_search(snapshot, settings, &problem, options, iterations, stop, on_progress)?, &problem)
        }
        Method::Oblique => baseline::oblique::fly(&problem, &settings.baseline, stop, on_progress)?,
        Method::Smith => baseline::smith::fly(&problem, &settings.baseline, options.seed, stop, on_progress)?,
        Method::Zhou => baseline::zhou::fly(&problem, &settings.baseline, options.seed, stop, on_progress)?,
    };

    let limits = Limits::new(rig, &settings.flight, &settings.dynamics);
    let deviations_m = safety::deviations_m(&route.waypoints, &limits, &snapshot.free);
    let profile = Profile::rounded(&route.waypoints, &limits, &deviations_m);
    let Exposed { mut images, delayed, dropped } = images::expose(&route, rig, &profile);
    let sightings = evaluate::sightings(snapshot, &problem.disks, &images, stop).ok_or(PlanError::Abandoned)?;
    let capture = sightings.capture(&problem, |_| true);
    // Eq. 6 sums from k = 2: what the views at the start see belongs to no leg.
    let at_start = sightings.capture(&problem, |image| image < rig.camera_count() as u32);
    let matched = problem.enough_matched(matched_goal_percent(settings, options));
    let selected = select::select(&problem, &sightings, images.len(), matched);
    images.iter_mut().zip(selected).for_each(|(image, selected)| image.selected = selected);
    let clearance_m = safety::check(profile.curve(), &snapshot.free)?;
    safety::check_views(rig, &images)?;
    let blur_px = images::blur_px(&images, rig, &profile, &snapshot.free.clearance);
    let figures = metrics(&problem, settings, &route, &profile, &capture, &at_start);
    let waypoint =
        |(pose, &deviation_m): (&Pose, &f64)| Waypoint { position_m: pose.position, direction: pose.direction, deviation_m };

    Ok(Plan {
        scene: SceneStamp { name: snapshot.scene.name.clone(), origin: snapshot.scene.frame.origin, revision: snapshot.revision },
        seed: options.seed,
        rig: rig.name.clone(),
        method: options.method.name().to_owned(),
        cameras: Camera::all_of(rig),
        metrics: Metrics { delayed_exposures: delayed, dropped_exposures: dropped, blur_px, ..figures },
        limits: Some(limits),
        waypoints: route.waypoints.iter().zip(&deviations_m).map(waypoint).collect(),
        images,
        cells: capture.cells,
        ceilings: problem.ceilings,
        goal_percent: settings.coverage.goal_percent,
        matched_goal_percent: matched_goal_percent(settings, options),
        clearance_m,
        convergence,
        stop: reason,
    })
}

fn with_goal(settings: &Settings, goal_percent: Option<f64>) -> Settings {
    let mut settings = settings.clone();
    settings.coverage.goal_percent = goal_percent.unwrap_or(settings.coverage.goal_percent);
    settings
}

/// The goal for matched samples, percent; 0 for methods and plans that have none.
fn matched_goal_percent(settings: &Settings, options: &PlanOptions) -> f64 {
    match (options.method, options.objective, options.within_s) {
        (Method::Refined, Objective::Time, None) => options.matched_percent.unwrap_or(settings.coverage.goal_percent),
        _ => 0.0,
    }
}

impl From<BaselineError> for PlanError {
    fn from(error: BaselineError) -> Self {
        if error == BaselineError::Abandoned { PlanError::Abandoned } else { PlanError::Baseline(error) }
    }
}

/// The paper's own method: a random tree, and the best path in it.
fn tree_search(
    snapshot: &Snapshot,
    settings: &Settings,
    problem: &Problem,
    options: &PlanOptions,
    iterations: u32,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Outcome, PlanError> {
    let start = start_pose(problem, options, stop)?;
    let confirm = |path: &[Pose]| confirmed(snapshot, settings, problem, path, stop).worth.captured;
    Ok(search(problem, start, iterations, options.seed, stop, &confirm, on_progress)?)
}

/// Beyond the paper: a small tree, whose flight is then improved.
fn refined(
    snapshot: &Snapshot,
    settings: &Settings,
    problem: &Problem,
    options: &PlanOptions,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Found, PlanError> {
    let rounds = options.iterations.unwrap_or_else(|| refine::rounds_of(settings, problem));
    let budget = match (options.budget_s, stop.elapsed_s()) {
        (None, _) => Budget::Rounds(rounds),
        (Some(seconds), Some(begun_s)) => Budget::Until(begun_s + seconds),
        (Some(_), None) => return Err(PlanError::NoClock),
    };
    let confirm = |path: &[Pose]| confirmed(snapshot, settings, problem, path, stop);
    let tree = tree_search(snapshot, settings, problem, options, settings.refine.tree_iterations, stop, &mut |_| {})?;
    if tree.path.len() < 2 {
        return Ok(Found::of(tree, problem));
    }
    let matched = problem.enough_matched(matched_goal_percent(settings, options));
    let (aim, counting) = match (options.objective, options.within_s) {
        (Objective::Eq6, _) => (Aim::MostObjective, Counting::Everything),
        (Objective::Time, Some(within_s)) => (Aim::MostCoverage { within_ns: (within_s * 1e9) as u64 }, Counting::Captured),
        (Objective::Time, None) => {
            let counting = if matched > 0 { Counting::Matched } else { Counting::Captured };
            (Aim::LeastTime { required: Worth { captured: problem.sufficient, matched } }, counting)
        }
    };
    let ground = Ground::new(problem, settings, options.start_m.is_some(), counting);
    let task = Task { aim, budget, seed: options.seed };
    let outcome = refine::refine(&ground, &tree.path, &task, stop, &confirm, on_progress);
    if let Some(within_s) = options.within_s {
        let least_s = profile(&outcome.path, snapshot, settings, problem).duration_s();
        if least_s > within_s {
            return Err(PlanError::TooShort { within_s, least_s });
        }
    }
    Ok(Found::of(outcome, problem))
}

/// What a finished path is really worth, by exact rays from its images.
fn confirmed(snapshot: &Snapshot, settings: &Settings, problem: &Problem, path: &[Pose], stop: &StopToken) -> Confirmed {
    let profile = profile(path, snapshot, settings, problem);
    let route = Route::continuous(path, &problem.rig, problem.image_spacing_m);
    let Exposed { images, .. } = images::expose(&route, &problem.rig, &profile);
    let worth = evaluate::sightings(snapshot, &problem.disks, &images, stop).map_or(Worth::default(), |sightings| {
        let Capture { captured, matched, .. } = sightings.capture(problem, |_| true);
        Worth { captured, matched }
    });
    Confirmed { worth, duration_s: profile.duration_s() }
}

/// The profile of the curve that is flown.
fn profile(path: &[Pose], snapshot: &Snapshot, settings: &Settings, problem: &Problem) -> Profile {
    let limits = Limits::new(&problem.rig, &settings.flight, &settings.dynamics);
    Profile::rounded(path, &limits, &safety::deviations_m(path, &limits, &snapshot.free))
}

/// The given start if it is safe, else the viewpoint; the given view, else the direction: whatever alone captures the most information,
/// so that the tree begins where there is something to see.
fn start_pose(problem: &Problem, options: &PlanOptions, stop: &StopToken) -> Result<Pose, PlanError> {
    if let Some(position) = options.start_m
        && let Some(cause) = problem.free.obstruction_at(&position)
    {
        let position = format!("{}, {}, {}", position.x, position.y, position.z);
        return Err(PlanError::Start { position, cause });
    }
    let positions = match options.start_m {
        Some(position) => vec![position],
        None => problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect(),
    };
    let directions = options.start_view.map_or_else(|| problem.rig.pose_directions(), |view| vec![Some(view)]);
    let mut scratch = problem.scratch();
    let nothing = vec![0; problem.field.samples.len()];
    let mut best = (Pose { position: positions[0], direction: directions[0] }, 0);
    for position in positions {
        if stop.is_abandoned() {
            return Err(PlanError::Abandoned);
        }
        for &direction in &directions {
            let pose = Pose { position, direction };
            let gain = problem.gain(&nothing, &problem.observe_pose(&pose, &mut scratch));
            if gain > best.1 {
                best = (pose, gain);
            }
        }
    }
    Ok(best.0)
}

fn metrics(
    problem: &Problem,
    settings: &Settings,
    route: &Route,
    profile: &Profile,
    capture: &Capture,
    at_start: &Capture,
) -> Metrics {
    let path = PathSums { information: capture.information - at_start.information, ..problem.objective.travel(&route.waypoints) };
    let movement_s = path.length_m / settings.flight.cruise_speed_mps;
    Metrics {
        length_m: path.length_m,
        movement_s,
        turning_s: path.turning_s,
        flight_s: movement_s + path.turning_s,
        profile_s: profile.duration_s(),
        battery_percent: problem.rig.battery.map(|battery| battery.percent(movement_s, path.turning_s)),
        coverage_percent: capture.coverage_percent,
        coverage_exposed_percent: capture.coverage_exposed_percent,
        capturable_percent: capture.capturable_percent,
        matched_percent: capture.matched_percent,
        information: problem.objective.gain(capture.information),
        objective: problem.objective.value(&path),
        ..Metrics::default()
    }
}
