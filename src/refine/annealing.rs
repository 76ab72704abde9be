//! Simulated annealing in rounds: every sector of the flight is changed by a worker of its own, then the sectors are put together again.
//!
//! A worker changes the waypoints of its sector and sees all others as they were when the round began. Two workers may both give up views
//! of one sample in reliance on the other's; then samples are missing when the sectors are put together, their price rises, and the next
//! round gets them back. What a round gives depends on its number and on the state before it, never on threads or clocks.

use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;
use rayon::prelude::*;

use super::Confirmed;
use super::choice::{Choice, Returns};
use super::counts::Worth;
use super::draft::Splice;
use super::flight::{Demand, Flight, Prices, Pursuit, Trial, Waypoint};
use super::focus::Focus;
use super::ground::Ground;
use super::moves::{self, exponential};
use super::sectors;
use crate::camera::Pose;
use crate::scene::bounds::Bounds;
use crate::search::Iteration;
use crate::search::objective::PathSums;
use crate::stop::free_behind;

/// What is wanted: the least time at a coverage, the most coverage within a time, or the most of the paper's objective.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    LeastTime {
        required: Worth,
    },
    MostCoverage {
        within_ns: u64,
    },
    /// The least time at a coverage if it can be had within a time, else the most coverage within it.
    LeastTimeWithin {
        required: Worth,
        within_ns: u64,
    },
    /// Eq. 6, whatever it covers and takes.
    MostObjective,
}

impl Aim {
    /// Whether a finished flight is what was wanted.
    pub fn is_met_by(&self, really: &Confirmed) -> bool {
        match *self {
            Self::LeastTime { required } => really.worth.is_enough(required),
            Self::MostCoverage { within_ns } => really.is_within(within_ns),
            Self::LeastTimeWithin { required, within_ns } => really.is_within(within_ns) && really.worth.is_enough(required),
            Self::MostObjective => true,
        }
    }
}

/// How much dearer missing samples become by a round.
#[derive(Clone, Copy, Debug)]
enum Rise {
    /// What cannot be had near a place may be cheap elsewhere.
    Never,
    /// By as much less as the round is of one that tries a change at every waypoint.
    ByChanges,
    /// Most changes are tried for just those few that are missing.
    Whole,
}

/// A flight under annealing with the best that it has been.
#[derive(Clone)]
pub struct Annealing<'a> {
    ground: &'a Ground<'a>,
    aim: Aim,
    /// Time that the flight may take as it is timed here.
    within_ns: u64,
    seed: u64,
    /// The flight as it is, with a copy for each worker but the first.
    pub(super) flight: Flight,
    copies: Vec<Flight>,
    pub(super) demand: Demand,
    choice: Choice,
    /// What the flight was worth when the prices were adjusted last.
    worth: Worth,
    best: Best,
    /// Rounds so far, and changes that were tried in them.
    rounds: u32,
    pub tried: u64,
}

/// The best flight so far.
#[derive(Clone, Debug)]
pub struct Best {
    pub path: Vec<Pose>,
    /// The same with what is seen from there.
    waypoints: Vec<Waypoint>,
    pub worth: Worth,
    pub duration_ns: u64,
    record: Iteration,
}

/// What a matched sample is worth to begin with, as a share of a captured one: most that are captured are matched as well.
const MATCHED_SHARE: f64 = 0.1;

/// More samples than this share beyond the demand are far too many.
const LAVISH_SHARE: f64 = 0.01;

/// While a round leaves less than this share of the missing samples missing, their price will do.
const PROGRESS: f64 = 0.95;

/// What a captured sample is worth at the end of a search, as a multiple of the time that each took on average: 1.5 to 3.6 over nihonbashi (0.9 to 2.4 s).
const LATE_PRICE: f64 = 3.0;

/// What a sample costs at least and at most, ns.
const PRICES_NS: (f64, f64) = (1e7, 60e9);

impl<'a> Annealing<'a> {
    /// Starts from a path that keeps all limits.
    pub fn new(ground: &'a Ground<'a>, path: &[Pose], aim: Aim, seed: u64) -> Self {
        let flight = Flight::new(ground, path);
        let (required, within_ns) = match aim {
            Aim::LeastTime { required } => (ground.share_of(required), u64::MAX),
            Aim::MostCoverage { within_ns } => (ground.most, within_ns),
            Aim::LeastTimeWithin { required, within_ns } => (ground.share_of(required), within_ns),
            Aim::MostObjective => (Worth::default(), u64::MAX),
        };
        let price_ns =
            (flight.duration_ns() as f64 / f64::from(flight.counts.worth().captured.max(1))).clamp(PRICES_NS.0, PRICES_NS.1);
        let settings = ground.settings;
        let demand = Demand {
            required,
            prices_ns: Prices { captured: price_ns, matched: price_ns * MATCHED_SHARE },
            surplus_share: settings.surplus_share,
            parts_share: settings.parts_share,
        };
        let record = Iteration { objective: f64::NEG_INFINITY, coverage_percent: 0.0, length_m: 0.0, turning_s: 0.0 };
        let waypoints = flight.waypoints.clone();
        let best = Best { path: path.to_vec(), waypoints, worth: Worth::default(), duration_ns: u64::MAX, record };
        let mut annealing = Self {
            ground,
            aim,
            within_ns,
            seed,
            flight,
            copies: Vec::new(),
            demand,
            choice: Choice::new(),
            worth: Worth::default(),
            best,
            rounds: 0,
            tried: 0,
        };
        annealing.keep_best();
        annealing
    }

    pub fn best(&self) -> &Best {
        &self.best
    }

    /// The path of the best flight of a search that is over. What its flights saw is thousands of pieces of memory, which are freed behind whoever waits.
    pub fn into_path(self) -> Vec<Pose> {
        free_behind((self.flight, self.copies, self.best.waypoints));
        self.best.path
    }

    /// Samples cost what they do when a search is nearly over: the next one takes longer than each took on average.
    pub fn price_as_late(&mut self) {
        let Prices { captured, matched } = &mut self.demand.prices_ns;
        for price_ns in [captured, matched] {
            *price_ns = (*price_ns * LATE_PRICE).min(PRICES_NS.1);
        }
    }

    /// The temperature of the last round, ns.
    pub fn coldest_ns(&self) -> f64 {
        self.ground.settings.coldest_s * 1e9
    }

    /// Takes note of what the best flight is really worth, and demands from now on what makes up for the difference; the search for the best
    /// flight begins anew from there. At the end no demand falls: what one measure has to spare is soon lost while the other one is mended.
    pub fn calibrate(&mut self, really: &Confirmed, is_end: bool) {
        // What it really covers changes nothing about what Eq. 6 wants.
        if self.aim == Aim::MostObjective {
            return;
        }
        if let Aim::LeastTime { required } | Aim::LeastTimeWithin { required, .. } = self.aim {
            let (most, seemingly, before) = (self.ground.most, self.best.worth, self.demand.required);
            let [required, really] = [required, really.worth].map(|worth| self.ground.share_of(worth));
            let demanded = |[required, seemingly, really, most, before]: [u32; 5]| {
                let least = if is_end { before } else { 1 };
                if required == 0 { 0 } else { (required + seemingly).saturating_sub(really).max(least).clamp(1, most.max(1)) }
            };
            let all = [required, seemingly, really, most, before];
            self.demand.required =
                Worth { captured: demanded(all.map(|worth| worth.captured)), matched: demanded(all.map(|worth| worth.matched)) };
        }
        if let Aim::MostCoverage { within_ns } | Aim::LeastTimeWithin { within_ns, .. } = self.aim {
            // Arcs that had to be tighter take longer.
            let longer_ns = ((really.duration_s * 1e9) as u64).saturating_sub(self.best.duration_ns);
            self.within_ns = within_ns.saturating_sub(longer_ns);
        }
        if self.flight.path() != self.best.path {
            self.flight.go_back(self.ground, self.best.waypoints.clone());
            self.copies.clear();
        }
        self.judge_anew();
    }

    /// Goes on with other samples. A sample costs what as many stand for it as before.
    pub fn move_to(&mut self, ground: &'a Ground<'a>) {
        let before = std::mem::replace(&mut self.ground, ground).most;
        let Demand { required, prices_ns: Prices { captured, matched }, .. } = &mut self.demand;
        let share = |part: u32, of: u32| f64::from(part.max(1)) / f64::from(of.max(1));
        *captured *= share(before.captured, ground.most.captured);
        *matched *= share(before.matched, ground.most.matched);
        *required = match self.aim {
            Aim::LeastTime { required } | Aim::LeastTimeWithin { required, .. } => ground.share_of(required),
            Aim::MostCoverage { .. } => ground.most,
            Aim::MostObjective => Worth::default(),
        };
        self.flight = Flight::new(ground, &self.flight.path());
        self.copies.clear();
        self.judge_anew();
    }

    /// The search for the best flight begins anew with the flight as it is.
    fn judge_anew(&mut self) {
        self.worth = self.flight.counts.worth();
        self.best.worth = Worth::default();
        self.best.duration_ns = u64::MAX;
        self.keep_best();
    }

    /// The best flight so far.
    pub fn record(&self) -> Iteration {
        self.best.record
    }

    /// One round at a temperature: how much worse a change may make the flight, ns, on average. One that is abandoned ends at once, anywhere.
    pub fn round(&mut self, temperature_ns: f64) {
        self.round_in(None, Rise::ByChanges, temperature_ns);
    }

    /// The same for the last missing samples.
    pub fn round_mending(&mut self, temperature_ns: f64) {
        self.round_in(None, Rise::Whole, temperature_ns);
    }

    /// The same with changes near a place.
    pub fn round_near(&mut self, focus: &Focus, temperature_ns: f64) {
        self.round_in(Some(focus), Rise::Never, temperature_ns);
    }

    /// The neighbourhood of what changed in the scene, as far as the flight goes.
    pub fn focus(&self, changed: &[Bounds]) -> Option<Focus> {
        Focus::new(self.ground, &self.flight, changed)
    }

    /// The neighbourhood that has so many waypoints, and the path as it is.
    fn round_in(&mut self, focus: Option<&Focus>, rise: Rise, temperature_ns: f64) {
        let (ground, required, steps) = (self.ground, self.demand.required, self.ground.settings.round_moves);
        let pursuit = match self.aim {
            Aim::MostObjective => Pursuit::Objective(&ground.problem.objective),
            _ => Pursuit::Time(self.demand),
        };
        let sectors = sectors::of(ground, &self.flight, focus, &mut random(self.seed, self.rounds, BORDERS));
        self.copies.resize_with(sectors.len() - 1, || self.flight.clone());
        let (seed, rounds, choice) = (self.seed, self.rounds, &self.choice);
        let mut flights: Vec<&mut Flight> = std::iter::once(&mut self.flight).chain(&mut self.copies).collect();
        let returns: Vec<Returns> = flights
            .par_iter_mut()
            .zip(&sectors)
            .enumerate()
            .map(|(worker, (flight, sector))| {
                let mut random = random(seed, rounds, worker as u8);
                let (mut splice, mut returns) = (Splice::default(), Returns::default());
                for _ in 0..steps {
                    if ground.stop.is_abandoned() {
                        break;
                    }
                    let kind = choice.draw(&mut random);
                    let mut trial = Trial::default();
                    if moves::propose(ground, flight, required, *sector, kind, &mut random, &mut splice) {
                        let most_ns = temperature_ns * exponential(&mut random);
                        trial = flight.attempt(ground, &splice, &pursuit, most_ns);
                    }
                    returns.note(kind, trial.gained.unwrap_or(0.0), trial.views);
                }
                returns
            })
            .collect();
        if ground.stop.is_abandoned() {
            // Nobody looks at the flight any more: its parts stay apart.
            return;
        }
        sectors::join(ground, &mut flights, &sectors);
        self.choice.learn(returns.iter());
        self.tried += u64::from(steps) * sectors.len() as u64;
        self.rounds += 1;
        let tries = f64::from(steps) * sectors.len() as f64 / self.flight.waypoints.len() as f64;
        self.adjust_price(rise, tries.min(1.0));
        self.keep_best();
    }

    /// A sample becomes dearer while samples are missing and do not get much fewer, and cheaper while there are enough; much cheaper while there
    /// are far too many. By as much less as a round is of one that tries a change at every waypoint: what a price does shows after that.
    fn adjust_price(&mut self, rise: Rise, share: f64) {
        let (worth, required, most) = (self.flight.counts.worth(), self.demand.required, self.ground.most);
        let before = std::mem::replace(&mut self.worth, worth);
        let is_early = self.flight.duration_ns() < self.within_ns;
        let settings = self.ground.settings;
        let adjusted = |price_ns: f64, [before, worth, required, most]: [u32; 4]| {
            let missing = |worth: u32| f64::from(required.saturating_sub(worth));
            let rise_share = match rise {
                Rise::Never => 0.0,
                Rise::ByChanges => share,
                Rise::Whole => 1.0,
            };
            if worth < required && missing(worth) < libm::pow(PROGRESS, rise_share) * missing(before) {
                return price_ns;
            }
            let (is_short, is_lavish) = match self.aim {
                Aim::LeastTime { .. } => {
                    (worth < required, f64::from(worth.saturating_sub(required)) > LAVISH_SHARE * f64::from(most))
                }
                // Nothing is worth the time that there is not.
                Aim::LeastTimeWithin { .. } => (worth < required && is_early, false),
                Aim::MostCoverage { .. } | Aim::MostObjective => (is_early, false),
            };
            let factor = match (is_short, is_lavish) {
                (true, _) => libm::pow(settings.price_rise, rise_share),
                (false, false) => libm::pow(settings.price_fall, share),
                (false, true) => libm::pow(settings.price_fall, 3.0 * share),
            };
            (price_ns * factor).clamp(PRICES_NS.0, PRICES_NS.1)
        };
        let Prices { captured, matched } = self.demand.prices_ns;
        self.demand.prices_ns = Prices {
            captured: adjusted(captured, [before, worth, required, most].map(|worth| worth.captured)),
            matched: adjusted(matched, [before, worth, required, most].map(|worth| worth.matched)),
        };
    }

    fn keep_best(&mut self) {
        let (worth, duration_ns) = (self.flight.counts.worth(), self.flight.duration_ns());
        let best = &self.best;
        let is_better = match self.aim {
            Aim::LeastTime { .. } => {
                let required = self.demand.required;
                (worth.counted(required).sum(), best.duration_ns) > (best.worth.counted(required).sum(), duration_ns)
            }
            // Of the most coverage all counts that there can be.
            Aim::MostCoverage { .. } | Aim::LeastTimeWithin { .. } => {
                let excess_ns = |duration_ns: u64| duration_ns.saturating_sub(self.within_ns);
                let counted = |worth: Worth| worth.counted(self.demand.required).sum();
                (excess_ns(best.duration_ns), counted(worth), best.duration_ns)
                    > (excess_ns(duration_ns), counted(best.worth), duration_ns)
            }
            Aim::MostObjective => self.present().objective > best.record.objective,
        };
        if is_better {
            let (path, waypoints) = (self.flight.path(), self.flight.waypoints.clone());
            self.best = Best { path, waypoints, worth, duration_ns, record: self.present() };
        }
    }

    /// The flight as it is; information is that which its legs gain from the samples that are looked at.
    fn present(&self) -> Iteration {
        let problem = self.ground.problem;
        let information = self.flight.counts.cells.totals().information;
        let information = information.saturating_sub(self.flight.at_start() + self.ground.captured_information);
        let sums = PathSums { information, ..problem.objective.travel(&self.flight.path()) };
        Iteration {
            objective: problem.objective.value(&sums),
            coverage_percent: self.coverage_percent(),
            length_m: sums.length_m,
            turning_s: sums.turning_s,
        }
    }

    /// Captured share of the samples that are looked at and can be captured.
    fn coverage_percent(&self) -> f64 {
        let Ground { problem, wanted, most, .. } = self.ground;
        let counts = &self.flight.counts;
        let (captured, of) = if most.captured > 0 {
            (counts.worth().captured, most.captured)
        } else {
            // None has to be captured, so that the counters do not tell.
            let capturable = || wanted.iter().map(|&i| i as usize).filter(|&i| problem.is_capturable(i));
            let captured = capturable().filter(|&i| counts.cells.cells(i) > problem.thresholds[i]);
            (captured.count() as u32, capturable().count() as u32)
        };
        100.0 * f64::from(captured) / f64::from(of.max(1))
    }
}

/// The number of the stream that the borders between sectors are drawn from; the others are those of the workers.
const BORDERS: u8 = 0xff;

/// What is drawn from in one stream of a round.
fn random(seed: u64, round: u32, stream: u8) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(u64::from(round) << 8 | u64::from(stream));
    random
}
