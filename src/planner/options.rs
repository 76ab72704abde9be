//! What can be asked of a planner, and why it may have no plan.

use geo::{Area, Coord, LineString, Polygon, Validation};
use nalgebra::{Point3, Unit, Vector3};

use super::en_route::{EnRoute, MOST_SPEED_MPS};
use crate::baseline::BaselineError;
use crate::camera::{Cameras, Pose, Rig, pitch_rad};
use crate::scene::free_space::Obstruction;
use crate::search::SearchError;
use crate::settings::MOST_ITERATIONS;
use crate::trajectory::safety::UnsafeCurve;

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
    /// For the methods `refined` and `paper`: forward overlap, the share of an image that the next one of the same camera shows as well, percent
    /// above 0 and below 100; `None` asks for none. It is meant for a flat surface, seen frontally from where an image has the ground sampling
    /// distance that is wanted (else from the geometric mean of the safety distance and the range of sight), and a camera that moves parallel to
    /// the shorter side of its image. It holds for all images of the flight, not for those that are selected.
    pub overlap_percent: Option<f64>,
    /// Corners of the area whose samples count, m in the local frame; `None` for the whole scene.
    pub region_m: Option<Vec<[f64; 2]>>,
    /// Where the flight starts, m in the local frame; `None` chooses a start. The baselines begin where their tours do.
    pub start_m: Option<Point3<f64>>,
    /// Where a camera on a gimbal looks at the start; `None` chooses the direction.
    pub start_view: Option<Unit<Vector3<f64>>>,
    /// Waypoints of an earlier flight over the scene as it was. For the methods `refined` and `paper` what can still be flown of it is a plan at
    /// once ([`super::replan`]), and the refinement goes on with it; `None` begins anew.
    pub earlier: Option<Vec<Pose>>,
    /// For the method `refined`: an aircraft that is in the air already; `None` for a flight that begins at rest.
    pub en_route: Option<EnRoute>,
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
            overlap_percent: None,
            region_m: None,
            start_m: None,
            start_view: None,
            earlier: None,
            en_route: None,
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
        let time_left_s = self.en_route.as_ref().and_then(|en_route| en_route.time_left_s);
        if let Some(seconds) = time_left_s.filter(|seconds| !(*seconds > 0.0 && *seconds <= MOST_BUDGET_S)) {
            return Err(PlanError::Seconds { seconds });
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
        self.check_overlap()?;
        self.check_en_route()?;
        self.region().map(|_| ())?;
        let Some(view) = self.view() else { return Ok(()) };
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
    /// Where a camera on a gimbal looks at first, if anybody says so.
    fn view(&self) -> Option<Unit<Vector3<f64>>> {
        self.en_route.as_ref().map_or(self.start_view, |en_route| en_route.view)
    }

    fn check_en_route(&self) -> Result<(), PlanError> {
        let Some(en_route) = &self.en_route else { return Ok(()) };
        if self.method != Method::Refined || self.objective != Objective::Time {
            return Err(PlanError::NotEnRoute);
        }
        if self.start_m.is_some() || self.start_view.is_some() {
            return Err(PlanError::TwoStarts);
        }
        en_route.check()
    }

    fn check_overlap(&self) -> Result<(), PlanError> {
        let Some(percent) = self.overlap_percent else { return Ok(()) };
        if !(percent > 0.0 && percent < 100.0) {
            return Err(PlanError::Overlap { percent });
        }
        if !matches!(self.method, Method::Refined | Method::Paper) {
            return Err(PlanError::NoOverlap { method: self.method.name() });
        }
        // A panorama shows all of what the next one shows, however far away.
        let has_frame = !matches!(self.rig.cameras, Cameras::Panoramic { .. });
        if has_frame { Ok(()) } else { Err(PlanError::NoFrame { rig: self.rig.name.clone() }) }
    }

    /// The area whose samples count.
    pub(super) fn region(&self) -> Result<Option<Polygon>, PlanError> {
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
    #[error(
        "give either iterations or seconds for the search, and either goals (coverage, matched views) or a time for the flight"
    )]
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
    #[error("an overlap of {percent} % will not do; give more than 0 and less than 100, such as 80")]
    Overlap { percent: f64 },
    #[error("the method {method:?} does not plan for an overlap; the methods \"refined\" and \"paper\" do")]
    NoOverlap { method: &'static str },
    #[error(
        "the images of {rig:?} show everything around and have no frame that an overlap could be a share of; give no overlap, or a rig with a lens, \
         such as \"phantom4-rtk\""
    )]
    NoFrame { rig: String },
    #[error(
        "for an overlap of {percent} % images would have to be {most_m:.2} m apart (of a footprint of {footprint_m:.1} m); the least is {least_m} m: \
         ask for less overlap or a larger ground sampling distance, or take a rig with a wider view"
    )]
    OverlapSpacing { percent: f64, footprint_m: f64, most_m: f64, least_m: f64 },
    #[error(
        "for an overlap of {percent} % an image is needed every {most_m:.2} m at least, and with {interval_s} s between images of this rig the flight \
         would cruise at {cruise_mps:.2} m/s; the least is {least_mps} m/s: ask for less overlap or a larger ground sampling distance, or take a rig \
         with a faster shutter (`shutter_interval_s`)"
    )]
    OverlapSpeed { percent: f64, most_m: f64, interval_s: f64, cruise_mps: f64, least_mps: f64 },
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
    #[error(
        "only the method \"refined\" with the objective \"time\" goes on from an aircraft in the air; ask for these, or plan from a start at rest"
    )]
    NotEnRoute,
    #[error("a flight begins either at a start, at rest, or at the pose of an aircraft in the air; give one of them")]
    TwoStarts,
    #[error(
        "the pose of the aircraft will not do: it moves at {speed_mps} m/s; give finite metres in the scene's frame, and at most {most} m/s", most = MOST_SPEED_MPS
    )]
    Pose { speed_mps: f64 },
    #[error("the flight cannot end at ({position}): {cause}; give a safe place above the one to land at, or none")]
    Landing { position: String, cause: Obstruction },
    #[error(
        "hold: from ({position}) the aircraft meets something within the {braking_m:.1} m that it needs to brake; brake as hard as it can, and ask again from \
         where it is at rest"
    )]
    CannotBrake { position: String, braking_m: f64 },
    #[error(
        "hold: at ({position}) the aircraft is where it must not be ({cause}), and no straight way out was found that does not lead nearer to something; \
         correct the scene, or fly it out by hand"
    )]
    Hold { position: String, cause: Obstruction },
    #[error("no safe way to the landing place ({landing}) was found; hold, and give another one")]
    NoWayHome { landing: String },
    #[error("land now: the shortest safe way to the end of the flight takes {way_s:.1} s, and {left_s:.1} s are left")]
    LandNow { left_s: f64, way_s: f64 },
    #[error("the computation was abandoned")]
    Abandoned,
    #[error(transparent)]
    Search(#[from] SearchError),
    #[error(transparent)]
    Baseline(BaselineError),
    #[error("the path failed the final safety check and is withheld: {0}; this is a defect of the planner")]
    Unsafe(#[from] UnsafeCurve),
}

impl From<BaselineError> for PlanError {
    fn from(error: BaselineError) -> Self {
        if error == BaselineError::Abandoned { PlanError::Abandoned } else { PlanError::Baseline(error) }
    }
}
