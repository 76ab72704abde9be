//! Scenes, fields, truths and flights of one reproduction: each is made once, whatever tables ask for it.

use std::sync::Arc;

use rayon::prelude::*;

use super::figures;
use super::site::Site;
use super::table::Table;
use super::{Effort, ReproductionError};
use crate::camera::Rig;
use crate::field::{FieldError, Snapshot};
use crate::planner::{self, Method, PlanError, PlanOptions, StopToken};
use crate::quality::{self, Quality, Truth, Which};
use crate::scene::Scene;
use crate::scene::degrade::{Boundary, Degradation, LargestError, degrade};
use crate::session::Session;
use crate::settings::Settings;
use crate::trajectory::plan::{Plan, sight_scale};

/// Seconds since any fixed moment.
pub type Clock = Arc<dyn Fn() -> f64 + Send + Sync>;

/// What a run is told from outside: when to end, whom to tell of each step, and the time.
pub struct Watch<'a> {
    pub stop: &'a StopToken,
    pub on_step: &'a mut dyn FnMut(&str),
    /// Is given a table that takes hours whenever a row has come, so that an interrupted run leaves what it has.
    pub on_row: &'a mut dyn FnMut(&Table),
    /// Only planning times are measured with it, and plans that are given so much time.
    pub clock: Clock,
}

/// One way to plan flights over one scene; there is a flight for each seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    pub site: Site,
    pub rig: &'static str,
    pub method: Method,
    pub settings: Settings,
    pub proxy: Proxy,
    /// Flights of seeds 1 to this, unless the method knows no chance.
    pub seeds: u32,
}

impl Trial {
    /// What is planned, for people.
    fn describe(&self) -> String {
        let flights = format!("{}: flights of {} with {}", self.site.name(), self.method.name(), self.rig);
        if self.proxy == Proxy::EXACT {
            return flights;
        }
        format!("{flights}, heights {} % off, boundaries {}", self.proxy.heights_percent, self.proxy.boundary.name())
    }
}

/// What flights are planned on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proxy {
    pub heights_percent: f64,
    pub boundary: Boundary,
}

impl Proxy {
    /// The scene as it is.
    pub const EXACT: Self = Self { heights_percent: 0.0, boundary: Boundary::Original };

    /// What is done to the scene for one seed; boundaries do not depend on it.
    fn degradation(self, seed: u64) -> Degradation {
        let seed = if self.heights_percent == 0.0 { 0 } else { seed };
        Degradation { heights_percent: self.heights_percent, boundary: self.boundary, seed }
    }
}

/// The flights of a trial, in the order of their seeds; none when the method refuses the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Flights {
    pub plans: Vec<Plan>,
    pub refusal: Option<String>,
}

impl Flights {
    pub fn figures(&self, figure: impl Fn(&Plan) -> f64) -> Vec<f64> {
        self.plans.iter().map(figure).collect()
    }
}

/// A field, and all that it was made of.
struct Made {
    site: Site,
    degradation: Degradation,
    field_hash: u64,
    neighbours: [f64; 3],
    snapshot: Snapshot,
}

/// Everything that the tables share.
pub struct Study<'a> {
    pub seeds: u32,
    pub effort: Effort,
    /// The settings of the benchmarks; those of real scenes are made of them.
    pub settings: Settings,
    watch: Watch<'a>,
    scenes: Vec<(Site, Arc<Scene>)>,
    fields: Vec<Made>,
    truths: Vec<(Site, Arc<Truth>)>,
    flights: Vec<(Trial, Arc<Flights>)>,
    qualities: Vec<(Trial, Arc<Vec<Quality>>)>,
}

impl<'a> Study<'a> {
    pub fn new(settings: Settings, effort: Effort, seeds: u32, scenes: Vec<(Site, Scene)>, watch: Watch<'a>) -> Self {
        let scenes = scenes.into_iter().map(|(site, scene)| (site, Arc::new(scene))).collect();
        Self {
            seeds,
            effort,
            settings,
            watch,
            scenes,
            fields: Vec::new(),
            truths: Vec::new(),
            flights: Vec::new(),
            qualities: Vec::new(),
        }
    }

    /// Tells what is done next, and whether it is still wanted.
    pub fn step(&mut self, what: &str) -> Result<(), ReproductionError> {
        (self.watch.on_step)(what);
        if self.watch.stop.is_stopped() { Err(ReproductionError::Stopped) } else { Ok(()) }
    }

    /// Hands out a table that is not yet whole.
    pub fn keep(&mut self, table: &Table) {
        (self.watch.on_row)(table);
    }

    /// The scene of a site; `None` when it is missing.
    pub fn scene(&self, site: Site) -> Option<Arc<Scene>> {
        self.scenes.iter().find(|(known, _)| *known == site).map(|(_, scene)| Arc::clone(scene))
    }

    pub fn stop(&self) -> &StopToken {
        self.watch.stop
    }

    /// Seconds, by the clock that the caller gave.
    pub fn now_s(&self) -> f64 {
        (self.watch.clock)()
    }

    /// The clock itself, for a stop token.
    pub fn clock(&self) -> Clock {
        Arc::clone(&self.watch.clock)
    }

    /// The trial of a site with the scene as its own proxy. Its settings are adapted to the sight of the cameras that are flown.
    pub fn trial(&self, site: Site, rig: &'static str, method: Method, settings: Settings) -> Trial {
        let settings = match Rig::preset(rig) {
            Ok(rig) => {
                settings.clone().with_sight(planner::flown_rig(&PlanOptions::new(rig, method, 1), &settings).sight_scale())
            }
            // The flights will say so.
            Err(_) => settings,
        };
        Trial { site, rig, method, settings, proxy: Proxy::EXACT, seeds: self.seeds }
    }

    /// The flights of a trial, one for each seed, planned side by side.
    pub fn flights(&mut self, trial: &Trial) -> Result<Arc<Flights>, ReproductionError> {
        if let Some((_, flights)) = self.flights.iter().find(|(known, _)| known == trial) {
            return Ok(Arc::clone(flights));
        }
        self.step(&trial.describe())?;
        let rig = Rig::preset(trial.rig)?;
        let seeds: Vec<u64> = (1..=seeds_of(trial)).collect();
        let snapshots = seeds.iter().map(|&seed| self.snapshot(trial, seed)).collect::<Result<Vec<_>, _>>()?;
        let stop = self.watch.stop;
        let plan = |(snapshot, &seed): (&Snapshot, &u64)| {
            // As many rounds on every site, whatever its size.
            let rounds = (trial.method == Method::Refined).then_some(trial.settings.refine.rounds);
            let options = PlanOptions { iterations: rounds, ..PlanOptions::new(rig.clone(), trial.method, seed) };
            planner::plan(snapshot, &trial.settings, &options, stop, &mut |_| ())
        };
        let planned: Vec<Result<Plan, PlanError>> = snapshots.par_iter().zip(&seeds).map(plan).collect();
        if stop.is_stopped() {
            return Err(ReproductionError::Stopped);
        }
        let flights = Arc::new(match planned.into_iter().collect::<Result<Vec<_>, _>>() {
            Ok(plans) => Flights { plans, refusal: None },
            Err(error) => Flights { plans: Vec::new(), refusal: Some(error.to_string()) },
        });
        self.flights.push((trial.clone(), Arc::clone(&flights)));
        Ok(flights)
    }

    /// The field of the proxy that a trial plans on with one seed.
    pub fn snapshot(&mut self, trial: &Trial, seed: u64) -> Result<Snapshot, ReproductionError> {
        let degradation = trial.proxy.degradation(seed);
        let search = &trial.settings.search;
        let neighbours = [search.neighbour_share, search.neighbour_min_m, search.neighbour_max_m];
        let (site, field_hash) = (trial.site, trial.settings.field_hash());
        let is_it = |made: &&Made| {
            (made.site, made.field_hash) == (site, field_hash) && made.degradation == degradation && made.neighbours == neighbours
        };
        if let Some(made) = self.fields.iter().find(is_it) {
            return Ok(made.snapshot.clone());
        }
        let scene = degrade(&*self.known_scene(site)?, &degradation).scene;
        let snapshot = build_field(scene, &trial.settings, self.watch.stop)?;
        self.fields.push(Made { site, degradation, field_hash, neighbours, snapshot: snapshot.clone() });
        Ok(snapshot)
    }

    /// How wrong the proxy of a trial is, for each seed.
    pub fn proxy_errors(&self, trial: &Trial) -> Result<Vec<LargestError>, ReproductionError> {
        let scene = self.known_scene(trial.site)?;
        let seeds = 1..=u64::from(self.seeds);
        Ok(seeds.map(|seed| degrade(&scene, &trial.proxy.degradation(seed)).largest_error_m).collect())
    }

    /// Dense samples of a true scene.
    pub fn truth(&mut self, site: Site) -> Result<Arc<Truth>, ReproductionError> {
        if let Some((_, truth)) = self.truths.iter().find(|(known, _)| *known == site) {
            return Ok(Arc::clone(truth));
        }
        self.step(&format!("{}: sampling the truth", site.name()))?;
        let truth = Arc::new(Truth::new((*self.known_scene(site)?).clone(), &self.settings, self.watch.stop)?);
        self.truths.push((site, Arc::clone(&truth)));
        Ok(truth)
    }

    /// What the images of a trial's flights make of the true scene, flight by flight.
    pub fn qualities(&mut self, trial: &Trial) -> Result<Arc<Vec<Quality>>, ReproductionError> {
        if let Some((_, qualities)) = self.qualities.iter().find(|(known, _)| known == trial) {
            return Ok(Arc::clone(qualities));
        }
        let flights = self.flights(trial)?;
        let truth = self.truth(trial.site)?;
        self.step(&format!("{}: predicting what {} reconstructs", trial.site.name(), trial.method.name()))?;
        let assess = |plan| self.assess(&truth, plan, figures::used(trial.method));
        let qualities = Arc::new(flights.plans.iter().map(assess).collect::<Result<Vec<_>, _>>()?);
        self.qualities.push((trial.clone(), Arc::clone(&qualities)));
        Ok(qualities)
    }

    /// What the images of one plan make of a truth; always by the settings of the benchmarks, so that figures can be
    /// compared, for the sight of its cameras.
    pub fn assess(&self, truth: &Truth, plan: &Plan, which: Which) -> Result<Quality, ReproductionError> {
        let shots = quality::shots(plan, which);
        let settings = self.settings.clone().with_sight(sight_scale(&plan.cameras));
        quality::assess(truth, &shots, &settings, self.watch.stop).ok_or(ReproductionError::Stopped)
    }

    fn known_scene(&self, site: Site) -> Result<Arc<Scene>, ReproductionError> {
        self.scene(site).ok_or(ReproductionError::NoScene { site: site.name() })
    }
}

/// How many flights a trial has: there is no chance in oblique photography.
fn seeds_of(trial: &Trial) -> u64 {
    match trial.method {
        Method::Oblique => 1,
        Method::Refined | Method::Paper | Method::Smith | Method::Zhou => trial.seeds.into(),
    }
}

/// A field in memory of its own.
pub fn build_field(scene: Scene, settings: &Settings, stop: &StopToken) -> Result<Snapshot, FieldError> {
    Session::new(scene, Arc::new(settings.clone()), stop)?.survey(stop)?.into_snapshot(stop)
}
