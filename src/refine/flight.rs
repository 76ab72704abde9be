//! A flight under improvement: its waypoints with all that follows from them, kept up to date change by change.

use std::collections::HashSet;
use std::sync::Arc;

use rayon::prelude::*;

use super::counts::{Counts, Worth};
use super::draft::{Draft, Splice, Stop};
use super::ground::{Ground, Look};
use super::sights::Sights;
use super::timeline::{Retimed, Timeline};
use crate::camera::Pose;
use crate::coverage::Information;
use crate::search::objective::{Objective, PathSums};

/// A flight with what its images cover and how long it takes.
#[derive(Clone, Debug)]
pub struct Flight {
    pub waypoints: Vec<Waypoint>,
    pub counts: Counts,
    timeline: Timeline,
    retimed: Retimed,
    journal: Journal,
}

/// What changes of a flight took from what its images see, and what they added, since the journal was taken last: so that another copy of the
/// flight can follow without being counted anew.
#[derive(Clone, Debug, Default)]
pub struct Journal {
    dropped: Vec<Arc<Sights>>,
    made: Vec<Arc<Sights>>,
}

/// A waypoint with what its image sees, and what those on the leg to the next waypoint see.
#[derive(Clone, Debug)]
pub struct Waypoint {
    pub pose: Pose,
    seen: Arc<Sights>,
    leg: Arc<Sights>,
}

/// What is wanted of a flight, and what it costs to fall short of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// Samples that are to be captured, and those that are to be matched.
    pub required: Worth,
    /// What a missing sample of either kind costs, ns.
    pub prices_ns: Prices,
    /// What a sample beyond those is worth, and what all cells or views of a sample are, as shares of the price.
    pub surplus_share: f64,
    pub parts_share: f64,
}

/// What a sample is worth that is captured, and one that is matched, ns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prices {
    pub captured: f64,
    pub matched: f64,
}

impl Flight {
    pub fn new(ground: &Ground, path: &[Pose]) -> Self {
        let [at_first, at_last] = ground.takes_at_ends;
        let takes = |k: usize| (k > 0 || at_first) && (k + 1 < path.len() || at_last);
        let nothing = || Arc::clone(&ground.nothing);
        let waypoint = |k: usize| {
            let pose = path[k];
            if ground.stop.is_abandoned() {
                return Waypoint { pose, seen: nothing(), leg: nothing() };
            }
            let seen = if takes(k) { ground.at_waypoint(&pose, Look::Rays) } else { nothing() };
            let leg = path.get(k + 1).map_or_else(nothing, |next| ground.on_leg(&pose, next, Look::Rays));
            Waypoint { pose, seen, leg }
        };
        Self::of_waypoints(ground, (0..path.len()).into_par_iter().map(waypoint).collect())
    }

    /// A flight whose waypoints see what they say, as far as it can be counted.
    pub fn of_waypoints(ground: &Ground, mut waypoints: Vec<Waypoint>) -> Self {
        let mut counts = ground.counts();
        // Of an abandoned flight nothing is taken away again that was not counted: no change is tried any more.
        for Waypoint { seen, leg, .. } in waypoints.iter_mut().take_while(|_| !ground.stop.is_abandoned()) {
            for sights in [seen, leg] {
                if counts.is_full(std::iter::once(sights.as_ref())) {
                    *sights = Arc::clone(&ground.nothing);
                }
                counts.add(sights);
            }
        }
        let path: Vec<Pose> = waypoints.iter().map(|waypoint| waypoint.pose).collect();
        let timeline = Timeline::new(ground.limits, &path);
        Self { waypoints, counts, timeline, retimed: Retimed::default(), journal: Journal::default() }
    }

    /// The journal since it was taken last.
    pub fn take_journal(&mut self) -> Journal {
        std::mem::take(&mut self.journal)
    }

    /// Makes the changes of another copy that were noted in its journal. What the waypoints are then is told by [`Flight::arrange`].
    pub fn follow(&mut self, Journal { dropped, made }: &Journal) {
        // What was made and dropped again has to be there before it can go.
        made.iter().for_each(|sights| self.counts.add(sights));
        dropped.iter().for_each(|sights| self.counts.remove(sights));
    }

    /// Takes over waypoints that this flight, or a copy of it over the same ground, had before. Only sights that are not in both are counted.
    pub fn go_back(&mut self, ground: &Ground, waypoints: Vec<Waypoint>) {
        // What an image or a leg sees belongs to one waypoint; but for nothing, which counts for nothing.
        let [now, then] = [&self.waypoints, &waypoints].map(|waypoints| waypoints.iter().flat_map(|one| [&one.seen, &one.leg]));
        let [are_now, were_then] = [&now, &then].map(|all| all.clone().map(Arc::as_ptr).collect::<HashSet<_>>());
        now.filter(|sights| !were_then.contains(&Arc::as_ptr(sights))).for_each(|sights| self.counts.remove(sights));
        then.filter(|sights| !are_now.contains(&Arc::as_ptr(sights))).for_each(|sights| self.counts.add(sights));
        self.journal = Journal::default();
        self.arrange(ground, waypoints);
    }

    /// Takes over waypoints whose sights are counted already.
    pub fn arrange(&mut self, ground: &Ground, waypoints: Vec<Waypoint>) {
        self.waypoints = waypoints;
        self.timeline = Timeline::new(ground.limits, &self.path());
    }

    /// Its corners.
    pub fn path(&self) -> Vec<Pose> {
        self.waypoints.iter().map(|waypoint| waypoint.pose).collect()
    }

    /// Information of the view at the start, which belongs to no leg (Eq. 6 sums from k = 2).
    pub fn at_start(&self) -> Information {
        self.waypoints.first().map_or(0, |start| self.counts.cells.information_of(&start.seen))
    }

    /// Time of the speed profile.
    pub fn duration_ns(&self) -> u64 {
        self.timeline.total_ns()
    }

    /// Makes a change if it keeps all limits and makes the flight worse by no more than `most_ns`; a change that is not made leaves no trace.
    pub fn attempt(&mut self, ground: &Ground, splice: &Splice, pursuit: &Pursuit, most_ns: f64) -> Trial {
        let Self { waypoints, counts, timeline, retimed, journal } = self;
        let draft = Draft::new(waypoints, splice, ground.is_rigid);
        let mut trial = Trial::default();
        if draft.count < 2 || !draft.new_legs().all(|k| ground.problem.is_flyable(&draft.pose(k), &draft.pose(k + 1))) {
            return trial;
        }
        timeline.retime(retimed, splice.range.clone(), splice.stops.len(), |k| draft.pose(k));
        if !retimed.keeps_entry {
            return trial;
        }
        let longer_ns = retimed.total_ns as f64 - timeline.total_ns() as f64;
        // The shortfall with which the flight is as good as before, and the one with which it may be made.
        let [even, most] = pursuit.allowed(ground, waypoints, counts, &draft, [longer_ns, most_ns]);
        let is_safe = |k: usize| ground.problem.free.is_leg_safe(&draft.pose(k).position, &draft.pose(k + 1).position);
        if pursuit.least_shortfall(counts) > most || !draft.new_legs().all(is_safe) {
            return trial;
        }

        let dropped = Sighted::dropped(waypoints, &draft);
        dropped.iter().for_each(|sights| counts.cells.remove(sights));
        let mut made = Sighted::made(ground, &draft, Look::Field);
        trial.views += dropped.views() + made.views();
        if counts.is_full(made.iter()) {
            dropped.iter().for_each(|sights| counts.cells.add(sights));
            return trial;
        }
        made.iter().for_each(|sights| counts.cells.add(sights));
        // Most changes fail by their cells alone, whatever would match.
        if pursuit.least_shortfall_by_cells(counts) > most {
            made.iter().for_each(|sights| counts.cells.remove(sights));
            dropped.iter().for_each(|sights| counts.cells.add(sights));
            return trial;
        }
        trial.views += dropped.views() + made.views();
        dropped.iter().for_each(|sights| counts.matches.remove(sights));
        made.iter().for_each(|sights| counts.matches.add(sights));
        if pursuit.shortfall(counts) <= most {
            // The field promises enough. What counts is what the images really see.
            trial.views += RAY_VIEWS * made.views();
            made.iter().for_each(|sights| counts.remove(sights));
            made = Sighted::made(ground, &draft, Look::Rays);
            made.iter().for_each(|sights| counts.add(sights));
        }
        let shortfall = pursuit.shortfall(counts);
        if shortfall > most {
            made.iter().for_each(|sights| counts.remove(sights));
            dropped.iter().for_each(|sights| counts.add(sights));
            return trial;
        }
        journal.dropped.extend(dropped.shared().cloned());
        journal.made.extend(made.shared().cloned());
        let fresh = made.waypoints(ground, waypoints, &draft);
        waypoints.splice(draft.touched().start..splice.range.end, fresh);
        timeline.commit(retimed);
        Trial { gained: Some(even - shortfall), ..trial }
    }
}

/// What came of a change that was tried.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trial {
    /// By how much the flight became better if the change was made, in the units of the shortfall.
    pub gained: Option<f64>,
    /// Views of samples that were looked at.
    pub views: usize,
}

/// A view by a ray takes about as long as so many by the field.
const RAY_VIEWS: usize = 8;

/// What a flight is improved for.
#[derive(Clone, Copy, Debug)]
pub enum Pursuit<'a> {
    /// The least time, missing samples at their price; the shortfall is in ns.
    Time(Demand),
    /// The most of Eq. 6; the shortfall is the information gain E_g, below nothing.
    Objective(&'a Objective),
}

impl Pursuit<'_> {
    /// The shortfalls with which a flight that a change makes longer by `longer_ns` is as good as before, and worse by `most_ns`.
    fn allowed(
        &self,
        ground: &Ground,
        waypoints: &[Waypoint],
        counts: &Counts,
        draft: &Draft,
        [longer_ns, most_ns]: [f64; 2],
    ) -> [f64; 2] {
        let objective = match self {
            // Time and shortfall may grow by so much together.
            Self::Time(demand) => return [0.0, most_ns].map(|most_ns| demand.shortfall_ns(counts) + most_ns - longer_ns),
            Self::Objective(objective) => objective,
        };
        let before = objective.travel(&waypoints.iter().map(|waypoint| waypoint.pose).collect::<Vec<_>>());
        let after = objective.travel(&(0..draft.count).map(|k| draft.pose(k)).collect::<Vec<_>>());
        let at_start = |sights: &Sights| counts.cells.information_of(sights);
        let information = counts.cells.totals().information.saturating_sub(at_start(&waypoints[0].seen));
        let now = objective.value(&PathSums { information, ..before });
        // Eq. 6 sums from k = 2: what the view at the start sees belongs to no leg.
        let new = match draft.stop(0) {
            Stop::Kept(start) => at_start(&waypoints[start].seen),
            Stop::New(pose) => at_start(&ground.at_waypoint(&pose, Look::Rays)),
        };
        let new = objective.gain(new);
        [0.0, most_ns].map(|most_ns| -objective.gain_for(now - objective.worth_of_s(most_ns * 1e-9), &after) - new)
    }

    fn shortfall(&self, counts: &Counts) -> f64 {
        match self {
            Self::Time(demand) => demand.shortfall_ns(counts),
            Self::Objective(objective) => -objective.gain(counts.cells.totals().information),
        }
    }

    /// The least that a flight with these covered cells could have.
    fn least_shortfall_by_cells(&self, counts: &Counts) -> f64 {
        match self {
            Self::Time(demand) => demand.least_shortfall_by_cells_ns(counts),
            Self::Objective(_) => self.shortfall(counts),
        }
    }

    /// The least that any flight could have.
    fn least_shortfall(&self, counts: &Counts) -> f64 {
        match self {
            Self::Time(demand) => demand.least_shortfall_ns(counts),
            Self::Objective(objective) => -objective.gain(counts.cells.most_information()),
        }
    }
}

impl Demand {
    /// What is missing costs, ns. A cell is worth its share of a sample, so that half a sample draws towards the whole one; so is a view.
    pub fn shortfall_ns(&self, counts: &Counts) -> f64 {
        let parts = [counts.cells.missing_samples(), counts.matches.missing_samples()].map(|missing| self.parts_share * missing);
        self.cost_ns(counts.worth(), parts)
    }

    /// The least that a flight with these covered cells could have.
    fn least_shortfall_by_cells_ns(&self, counts: &Counts) -> f64 {
        let worth = Worth { matched: counts.most().matched, ..counts.worth() };
        self.cost_ns(worth, [self.parts_share * counts.cells.missing_samples(), 0.0])
    }

    /// The least that any flight could have.
    fn least_shortfall_ns(&self, counts: &Counts) -> f64 {
        self.cost_ns(counts.most(), [0.0; 2])
    }

    fn cost_ns(&self, worth: Worth, [cells, views]: [f64; 2]) -> f64 {
        let Self { required, prices_ns, .. } = self;
        prices_ns.captured * (self.missing(required.captured, worth.captured) + cells)
            + prices_ns.matched * (self.missing(required.matched, worth.matched) + views)
    }

    /// Missing samples, each of those beyond the first few as several: a flight must not run away from its goal while the price is low.
    fn missing(&self, required: u32, there: u32) -> f64 {
        let missing = f64::from(required) - f64::from(there);
        if missing < 0.0 {
            return missing * self.surplus_share;
        }
        let few = f64::from(required) * FEW_SHARE;
        let (steep, beyond) = (missing.min(few), (missing - few).max(0.0));
        missing + (MOST_FACTOR - 1.0) * (steep * steep / (2.0 * few).max(1e-9) + beyond)
    }
}

/// Share of the required samples that are few, and the factor of the price of those beyond them. It grows from 1 on.
const FEW_SHARE: f64 = 0.02;
const MOST_FACTOR: f64 = 4.0;

/// What images see that come or go with a change: those at waypoints and those on legs, with their numbers.
struct Sighted {
    waypoints: Vec<(usize, Arc<Sights>)>,
    legs: Vec<(usize, Arc<Sights>)>,
}

impl Sighted {
    fn dropped(waypoints: &[Waypoint], draft: &Draft) -> Self {
        let (stops, legs) = draft.dropped();
        Self {
            waypoints: stops.into_iter().map(|old| (old, Arc::clone(&waypoints[old].seen))).collect(),
            legs: legs.into_iter().map(|old| (old, Arc::clone(&waypoints[old].leg))).collect(),
        }
    }

    fn made(ground: &Ground, draft: &Draft, look: Look) -> Self {
        let stops = draft.touched().filter_map(|k| match draft.stop(k) {
            Stop::New(pose) => Some((k, ground.at_waypoint(&pose, look))),
            Stop::Kept(_) => None,
        });
        let legs = draft.new_legs().map(|k| (k, ground.on_leg(&draft.pose(k), &draft.pose(k + 1), look)));
        Self { waypoints: stops.collect(), legs: legs.collect() }
    }

    /// Views of samples in all of them.
    fn views(&self) -> usize {
        self.iter().map(Sights::len).sum()
    }

    fn iter(&self) -> impl Iterator<Item = &Sights> + Clone {
        self.shared().map(Arc::as_ref)
    }

    fn shared(&self) -> impl Iterator<Item = &Arc<Sights>> + Clone {
        self.waypoints.iter().chain(&self.legs).map(|(_, sights)| sights)
    }

    /// The waypoints that the change touches, as they will be.
    fn waypoints(self, ground: &Ground, old: &[Waypoint], draft: &Draft) -> Vec<Waypoint> {
        let (mut stops, mut legs) = (self.waypoints.into_iter(), self.legs.into_iter());
        let waypoint = |k: usize| {
            let seen = match draft.stop(k) {
                Stop::Kept(stop) => Arc::clone(&old[stop].seen),
                Stop::New(_) => stops.next().expect("every new waypoint has its sights").1,
            };
            let leg = if k + 1 == draft.count {
                Arc::clone(&ground.nothing)
            } else if let Some(same) = draft.same_leg(k) {
                Arc::clone(&old[same].leg)
            } else {
                legs.next().expect("every new leg has its sights").1
            };
            Waypoint { pose: draft.pose(k), seen, leg }
        };
        draft.touched().map(waypoint).collect()
    }
}
