//! Beyond the paper: the flight of the tree search is improved by local search on its waypoints and view directions.
//!
//! The tree finds a feasible flight fast, but hangs every waypoint at random. Here waypoints are removed, inserted, moved, turned, reversed and
//! put elsewhere, always with the images all along the path, and a change stays when it saves time without losing coverage. Visibility
//! comes from the field while a change is judged and from rays before it is made, so that the search cannot profit from the field's errors.

mod annealing;
mod cells;
mod choice;
mod counts;
mod draft;
mod flight;
mod focus;
mod ground;
mod levels;
mod matches;
mod moves;
mod sectors;
mod sights;
#[cfg(test)]
mod tests;
mod timeline;

pub use annealing::{Aim, Annealing, Best};
pub use counts::Worth;
pub use ground::{Counting, Ground};

use overfly_table::field::FieldFacts;

use self::focus::Focus;
use self::levels::Levels;
use crate::camera::Pose;
use crate::scene::bounds::Bounds;
use crate::search::leg::headed;
use crate::search::{Iteration, Outcome, Progress, StopReason};
use crate::settings::{MOST_ITERATIONS, Settings};
use crate::stop::StopToken;

/// What is asked of a refinement.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    pub aim: Aim,
    pub budget: Budget,
    pub seed: u64,
    /// The path is that of an earlier search, of which most is as good as it was: it is not made hot again.
    pub is_resumed: bool,
    /// Boxes in which the scene changed with the last edit, m.
    pub changed: Vec<Bounds>,
}

/// How long a flight is improved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    Rounds(u32),
    /// About until the stop token's clock shows so many seconds. They only decide how many rounds there are: the same number of rounds
    /// gives the same flight again.
    Until(f64),
}

/// What a finished flight is really worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Confirmed {
    /// What its images capture and match.
    pub worth: Worth,
    pub duration_s: f64,
}

impl Confirmed {
    fn is_within(&self, within_ns: u64) -> bool {
        self.duration_s * 1e9 <= within_ns as f64
    }
}

/// Rounds where nobody asks for a number: the setting for scenes of the reference scene's size, more for larger ones.
pub fn rounds_of(settings: &Settings, field: &FieldFacts) -> u32 {
    let size = field.reference_area_m2 / settings.objective.reference_area_m2;
    (f64::from(settings.refine.rounds) * size.max(1.0)).min(f64::from(MOST_ITERATIONS)) as u32
}

/// Rounds at the highest temperature: a tenth of all, but at least so many. With a budget of seconds it is decided at their end how many rounds fit,
/// so that the same number of rounds gives the same flight.
const HOT_SHARE: u32 = 10;
const LEAST_HOT: u32 = 8;

/// Later rounds take this share of the time of the latest hot ones: fewer changes are accepted.
const LATER_SHARE: f64 = 0.8;

/// Share of the time that is left for the last repairs.
const RESERVE: f64 = 0.05;

/// How often it is looked at what the flight really captures: after shares of the rounds, as far as all samples count in them, then at the end, as long
/// as samples are missing and with more rounds each time: such a share of all, then twice as many, and so on. Those come on top of what was asked for, up to
/// a tenth of it where that is more than twelve rounds; what is found missing before the rounds are over costs none.
const CALIBRATIONS: [f64; 5] = [0.5, 0.75, 0.9, 0.95, 0.98];
/// A flight that goes on with an earlier one is looked at sooner, for whoever flies that one, but not before so many rounds.
const EARLY_LOOKS: [f64; 5] = [0.05, 0.1, 0.175, 0.25, 0.35];
const LEAST_BEFORE_LOOK: u32 = 4;
const REPAIRS: u32 = 6;
const REPAIR_SHARE: f64 = 0.005;
const LEAST_REPAIR: u32 = 2;
/// A flight that goes on with an earlier one is mended first: what the edit took is mostly had again after a few cold rounds, long before the annealing is
/// over. Whoever flies it waits for that, so that it is looked at after one round, and one more after every so many looks.
const MENDS: u32 = 8;
const MENDS_PER_ROUND: u32 = 3;
/// So many looks come first that change the flight only near what the edit changed.
const NEAR_FIRST: u32 = 2;

/// Improves a flight round by round. `confirm` tells what a finished flight is really worth; what it captures more or less than was
/// counted on decides how many samples are demanded.
pub fn refine(
    ground: &Ground,
    path: &[Pose],
    task: &Task,
    confirm: &mut dyn FnMut(&[Pose]) -> Confirmed,
    on_progress: &mut dyn FnMut(&Progress),
) -> Outcome {
    let Task { aim, budget, seed, is_resumed, ref changed } = *task;
    let stop = &ground.stop;
    let levels = if is_resumed { Levels::fine(ground) } else { Levels::new(ground, aim) };
    let mut level = 0;
    if stop.is_abandoned() {
        // Nobody looks at it any more.
        return Outcome { path: path.to_vec(), convergence: Vec::new(), stop: StopReason::Cancelled };
    }
    let mut annealing = Annealing::new(levels.ground(level), path, aim, seed);
    let mut convergence: Vec<Iteration> = Vec::new();
    let mut rounds = match budget {
        Budget::Rounds(rounds) => rounds,
        Budget::Until(_) => u32::MAX,
    };
    let mut tell = |record: Iteration, done: u32, rounds: u32| {
        let Iteration { coverage_percent, length_m, objective, .. } = record;
        on_progress(&Progress { iteration: done, iterations: rounds.max(done), coverage_percent, length_m, objective });
    };
    if is_resumed {
        annealing.price_as_late();
        // What the flight really captures is known already: no more is demanded than that takes.
        annealing.calibrate(&confirm(&annealing.best().path), false);
        let focus = annealing.focus(changed);
        let mut mending = Mending { aim, stop, focus, confirm: &mut *confirm, on_round: &mut |record| tell(record, 0, rounds) };
        mending.mend(&mut annealing, MENDS, |attempt| (1 + attempt / MENDS_PER_ROUND).min(rounds));
    }
    let (mut pace, mut measured_s) = (Pace::default(), Vec::new());
    pace.note(0, stop.elapsed_s());
    let mut done = 0;
    while done < rounds && !stop.is_stopped() {
        // Never before it is known how many rounds there are.
        while level < levels.last() && done >= levels.end(level, rounds).max(hot_rounds(rounds)) {
            level += 1;
            annealing.move_to(levels.ground(level));
        }
        annealing.round(temperature_s(ground, task, done, rounds) * 1e9);
        if stop.is_abandoned() {
            break;
        }
        done += 1;
        convergence.push(annealing.record());
        if let Budget::Until(until_s) = budget
            && rounds == u32::MAX
        {
            pace.note(done, stop.elapsed_s());
            // Rounds that go on with a flight are alike.
            let later_s = |measured_s: &[f64], s: f64| match is_resumed {
                true => s,
                false => levels.later_s(1.0 / f64::from(HOT_SHARE), s * LATER_SHARE, measured_s),
            };
            // Late enough that the flight has grown, and early enough that it is not decided yet.
            let is_soon = || pace.estimate(until_s, |s| later_s(&[], s)).is_some_and(|all| all / HOT_SHARE <= 2 * done);
            if !is_resumed && measured_s.is_empty() && is_soon() {
                measured_s = levels_s(&annealing, &levels, stop);
            }
            rounds = pace.fitting(until_s, |s| later_s(&measured_s, s)).unwrap_or(u32::MAX);
        }
        tell(annealing.record(), done, rounds);
        let is_at = |shares: &[f64]| shares.iter().any(|share| done == (f64::from(rounds) * share) as u32);
        let is_due = level == levels.last() && done > hot_rounds(rounds) && is_at(&CALIBRATIONS);
        if is_due || is_resumed && done >= LEAST_BEFORE_LOOK && is_at(&EARLY_LOOKS) {
            annealing.calibrate(&confirm(&annealing.best().path), false);
        }
    }

    if stop.is_abandoned() {
        // Nobody looks at it any more.
        let path = headed(&ground.problem.rig, &annealing.into_path());
        return Outcome { path, convergence, stop: StopReason::Cancelled };
    }
    if level < levels.last() {
        annealing.move_to(ground);
    }
    let mut reason = if stop.is_stopped() { StopReason::Cancelled } else { StopReason::IterationsUsed };
    let mut mending =
        Mending { aim, stop, focus: None, confirm: &mut *confirm, on_round: &mut |record| tell(record, done, rounds) };
    let share = |attempt: u32| (f64::from(rounds) * f64::from(attempt) * REPAIR_SHARE).ceil() as u32;
    let is_met = mending.mend(&mut annealing, REPAIRS, |attempt| share(attempt).max(LEAST_REPAIR));
    if is_met && matches!(aim, Aim::LeastTime { .. } | Aim::LeastTimeWithin { .. }) {
        reason = StopReason::GoalReached;
    }
    Outcome { path: headed(&ground.problem.rig, &annealing.into_path()), convergence, stop: reason }
}

/// Cold rounds for what a flight is short of where it is really looked at.
struct Mending<'a> {
    aim: Aim,
    stop: &'a StopToken,
    /// The neighbourhood of what changed, where that is why it is short.
    focus: Option<Focus>,
    confirm: &'a mut dyn FnMut(&[Pose]) -> Confirmed,
    on_round: &'a mut dyn FnMut(Iteration),
}

impl Mending<'_> {
    /// So many attempts, each of as many rounds as `rounds` says of its number; whether the best flight is what was wanted.
    fn mend(&mut self, annealing: &mut Annealing, attempts: u32, rounds: impl Fn(u32) -> u32) -> bool {
        for attempt in 1..=attempts {
            if self.stop.is_abandoned() {
                // Nobody looks at it any more: not even at what it is worth.
                return false;
            }
            let really = (self.confirm)(&annealing.best().path);
            if self.aim.is_met_by(&really) {
                return true;
            }
            if self.stop.is_stopped() {
                return false;
            }
            annealing.calibrate(&really, true);
            // Near what changed at first, and later in turns with everywhere.
            let focus = self.focus.as_ref().filter(|_| attempt <= NEAR_FIRST || attempt % 2 == 1);
            for _ in 0..rounds(attempt) {
                match focus {
                    Some(focus) => annealing.round_near(focus, annealing.coldest_ns()),
                    None => annealing.round_mending(annealing.coldest_ns()),
                }
                if self.stop.is_abandoned() {
                    return false;
                }
                (self.on_round)(annealing.record());
                if self.stop.is_stopped() {
                    break;
                }
            }
        }
        self.aim.is_met_by(&(self.confirm)(&annealing.best().path))
    }
}

/// From the hottest to the coldest, by equal factors; hottest while it is not known how many rounds there will be.
fn temperature_s(ground: &Ground, task: &Task, done: u32, rounds: u32) -> f64 {
    let settings = ground.settings;
    let hottest = if task.is_resumed { settings.resumed_s } else { settings.hottest_s };
    let coldest = settings.coldest_s.min(hottest);
    let hot = hot_rounds(rounds);
    if done < hot || rounds <= hot + 1 {
        return hottest;
    }
    let share = f64::from(done - hot) / f64::from(rounds - hot - 1);
    hottest * libm::pow(coldest / hottest, share)
}

/// How long a cold round takes on each level, s: tried on a copy of the flight. Nothing without a clock.
fn levels_s(annealing: &Annealing, levels: &Levels, stop: &StopToken) -> Vec<f64> {
    let round_s = |level: usize| {
        let mut copy = annealing.clone();
        if level > 0 {
            copy.move_to(levels.ground(level));
        }
        let mut round = || {
            copy.round(copy.coldest_ns());
            stop.elapsed_s()
        };
        // The first one makes the copies for the workers.
        let times_s = [round(), round()];
        copy.into_path();
        Some(times_s[1]? - times_s[0]?)
    };
    (0..=levels.last()).map_while(round_s).collect()
}

/// How many of the rounds are hot.
fn hot_rounds(rounds: u32) -> u32 {
    (rounds / HOT_SHARE).max(LEAST_HOT)
}

/// When each of the hot rounds ended, s; where there is a clock.
#[derive(Debug, Default)]
struct Pace(Vec<f64>);

impl Pace {
    fn note(&mut self, done: u32, now_s: Option<f64>) {
        self.0.extend(now_s.filter(|_| done as usize == self.0.len()));
    }

    /// About how many rounds fit in until `until_s`, once enough are over to tell. `later_s` tells how long the others take on average where one of those with
    /// as many samples as these takes so long.
    fn estimate(&self, until_s: f64, later_s: impl Fn(f64) -> f64) -> Option<u32> {
        let done = u32::try_from(self.0.len().checked_sub(1)?).ok().filter(|&done| done >= LEAST_HOT)?;
        let (now_s, half) = (self.0[done as usize], done / 2);
        let round_s = later_s((now_s - self.0[half as usize]) / f64::from(done - half));
        let left_s = until_s - (until_s - self.0[0]) * RESERVE - now_s;
        Some(done + (left_s.max(0.0) / round_s.max(1e-6)).min(f64::from(MOST_ITERATIONS)) as u32)
    }

    /// All rounds that fit in, if the hot ones of them are over: as many as make just those the hot ones.
    fn fitting(&self, until_s: f64, later_s: impl Fn(f64) -> f64) -> Option<u32> {
        let fitting = self.estimate(until_s, later_s)?;
        let done = self.0.len() as u32 - 1;
        if done == LEAST_HOT && fitting < (LEAST_HOT + 1) * HOT_SHARE {
            return Some(fitting);
        }
        (fitting / HOT_SHARE <= done).then_some(done * HOT_SHARE)
    }
}

#[cfg(test)]
mod pace_tests {
    use super::*;

    #[test]
    fn the_rounds_that_fit_are_decided_when_a_tenth_of_them_is_over() {
        for (round_s, until_s) in [(0.02, 1.0), (0.02, 10.0), (0.001, 1.0), (0.5, 1.0), (0.003, 7.0)] {
            let mut pace = Pace::default();
            let decided = (0..100_000u32).find_map(|done| {
                pace.note(done, Some(f64::from(done) * round_s));
                Some((done, pace.fitting(until_s, |s| s * LATER_SHARE)?))
            });
            let (done, rounds) = decided.expect("some time they are");
            assert_eq!(done, hot_rounds(rounds), "{rounds} rounds of {round_s} s until {until_s} s");
            let most = (until_s / (round_s * LATER_SHARE)).max(f64::from(LEAST_HOT));
            assert!(f64::from(rounds) <= most && f64::from(rounds) >= 0.85 * (until_s / round_s).min(most), "{rounds} of {most}");
        }
    }

    #[test]
    fn without_a_clock_nothing_is_decided() {
        let mut pace = Pace::default();
        (0..20).for_each(|done| pace.note(done, None));
        assert_eq!(pace.fitting(1.0, |s| s), None);
    }
}
