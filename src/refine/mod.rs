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
mod ground;
mod matches;
mod moves;
mod sights;
#[cfg(test)]
mod tests;
mod timeline;

pub use annealing::{Aim, Annealing, Best};
pub use counts::Worth;
pub use ground::{Counting, Ground};

use crate::camera::Pose;
use crate::search::{Iteration, Outcome, Problem, Progress, StopReason};
use crate::settings::{MOST_ITERATIONS, Settings};
use crate::stop::StopToken;

/// What is asked of a refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task {
    pub aim: Aim,
    pub budget: Budget,
    pub seed: u64,
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

/// Rounds where nobody asks for a number: the setting for scenes of the reference scene's size, more for larger ones.
pub fn rounds_of(settings: &Settings, problem: &Problem) -> u32 {
    let size = problem.field.facts.reference_area_m2 / settings.objective.reference_area_m2;
    (f64::from(settings.refine.rounds) * size.max(1.0)).min(f64::from(MOST_ITERATIONS)) as u32
}

/// Rounds before it is decided how many fit into the seconds.
const WARM_UP: u32 = 8;

/// Later rounds take this share of the time of the first ones: the flight is shorter then, and fewer changes are accepted.
const LATER_SHARE: f64 = 0.75;

/// How often it is looked at what the flight really captures: after shares of the rounds, then at the end, as long as samples are missing and
/// with so many more rounds each time, as a share of all.
const CALIBRATIONS: [f64; 3] = [0.5, 0.75, 0.9];
const REPAIRS: u32 = 4;
const REPAIR_SHARE: f64 = 0.04;

/// Improves a flight round by round. `confirm` tells what a finished flight is really worth; what it captures more or less than was
/// counted on decides how many samples are demanded.
pub fn refine(
    ground: &Ground,
    path: &[Pose],
    task: &Task,
    stop: &StopToken,
    confirm: &dyn Fn(&[Pose]) -> Confirmed,
    on_progress: &mut dyn FnMut(&Progress),
) -> Outcome {
    let Task { aim, budget, seed } = *task;
    let mut annealing = Annealing::new(ground, path, aim, seed);
    let mut convergence: Vec<Iteration> = Vec::new();
    let mut rounds = match budget {
        Budget::Rounds(rounds) => rounds,
        Budget::Until(_) => u32::MAX,
    };
    let begun_s = stop.elapsed_s();
    let mut tell = |record: Iteration, done: u32, rounds: u32| {
        let Iteration { coverage_percent, length_m, objective, .. } = record;
        on_progress(&Progress { iteration: done, iterations: rounds.max(done), coverage_percent, length_m, objective });
    };
    let mut done = 0;
    while done < rounds && !stop.is_stopped() {
        annealing.round(temperature_s(ground, done, rounds) * 1e9);
        done += 1;
        convergence.push(annealing.record());
        if done == WARM_UP
            && let (Budget::Until(until_s), Some(begun_s), Some(now_s)) = (budget, begun_s, stop.elapsed_s())
        {
            let round_s = (now_s - begun_s) / f64::from(WARM_UP) * LATER_SHARE;
            rounds = done + ((until_s - now_s).max(0.0) / round_s.max(1e-6)) as u32;
        }
        tell(annealing.record(), done, rounds);
        if done > WARM_UP && CALIBRATIONS.iter().any(|share| done == (f64::from(rounds) * share) as u32) {
            annealing.calibrate(&confirm(&annealing.best().path));
        }
    }

    let mut reason = if stop.is_stopped() { StopReason::Cancelled } else { StopReason::IterationsUsed };
    for repair in 0..=REPAIRS {
        let really = confirm(&annealing.best().path);
        if aim.is_met_by(&really) {
            if matches!(aim, Aim::LeastTime { .. }) {
                reason = StopReason::GoalReached;
            }
            break;
        }
        if repair == REPAIRS || stop.is_stopped() {
            break;
        }
        annealing.calibrate(&really);
        for _ in 0..(f64::from(rounds) * REPAIR_SHARE).ceil() as u32 {
            annealing.round(ground.settings.coldest_s * 1e9);
            tell(annealing.record(), done, rounds);
        }
    }
    Outcome { path: ground.headed(&annealing.best().path), convergence, stop: reason }
}

/// From the hottest to the coldest, by equal factors; hottest while it is not known how many rounds there will be.
fn temperature_s(ground: &Ground, done: u32, rounds: u32) -> f64 {
    let [hottest, coldest] = [ground.settings.hottest_s, ground.settings.coldest_s];
    if done < WARM_UP || rounds <= WARM_UP + 1 {
        return hottest;
    }
    let share = f64::from(done - WARM_UP) / f64::from(rounds - WARM_UP - 1);
    hottest * libm::pow(coldest / hottest, share)
}
