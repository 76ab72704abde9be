//! The flight of our method after the fewest iterations that reconstruct no less than another flight does.

use crate::camera::Rig;
use crate::field::Snapshot;
use crate::planner::{self, Method, PlanError, PlanOptions, StopToken};
use crate::quality::{self, COMPLETENESS_M, Quality, Truth, Which};
use crate::settings::{MOST_ITERATIONS, Settings};
use crate::trajectory::plan::Plan;

/// Points of a grid.
const POINTS: u32 = 64;

/// Steps of the grid in the usual number of iterations.
const STEPS_PER_SEARCH: u32 = 16;

/// Numbers of iterations that are tried: the multiples of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    pub step: u32,
    pub points: u32,
}

impl Grid {
    /// Up to four times the usual number of iterations: with K = 400 these are 25, 50, ... 1600.
    pub fn of(settings: &Settings) -> Self {
        Self { step: (settings.search.iterations / STEPS_PER_SEARCH).clamp(1, MOST_ITERATIONS / POINTS), points: POINTS }
    }

    pub fn most(self) -> u32 {
        self.step.saturating_mul(self.points)
    }
}

/// What our method plans on, and what its flights are held against.
#[derive(Clone, Copy)]
pub struct Rival<'a> {
    pub snapshot: &'a Snapshot,
    /// Of the plan; its goal is set aside.
    pub settings: &'a Settings,
    pub rig: &'a Rig,
    pub truth: &'a Truth,
    /// Settings by which quality is predicted.
    pub assessing: &'a Settings,
}

/// A flight of ours, and what all of its images make of the truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Matched {
    pub iterations: u32,
    pub plan: Plan,
    pub quality: Quality,
    /// `false`: this is the flight after the most iterations, and it still reconstructs less.
    pub is_reached: bool,
}

/// Share of the surface that is reconstructed to 0.05 m, percent.
pub fn completeness_percent(quality: &Quality) -> f64 {
    quality.completeness_percent(COMPLETENESS_M[1])
}

/// Our flight of one seed after the least number of iterations on the grid, as far as [`least_enough`] can tell, at which its Completeness
/// is no lower than theirs. One seed replays one search, so that more iterations only go on with it. A stopped search is
/// [`PlanError::Abandoned`]: its flight would say nothing.
pub fn match_completeness(
    rival: &Rival,
    grid: Grid,
    seed: u64,
    theirs: &Quality,
    stop: &StopToken,
) -> Result<Matched, PlanError> {
    let mut settings = rival.settings.clone();
    // More than all samples cannot be captured: no search ends before its last iteration.
    settings.coverage.goal_percent = 100.0;
    let wanted_percent = completeness_percent(theirs);
    let make = |point: u32| {
        let iterations = point.saturating_mul(grid.step);
        let options = PlanOptions { iterations: Some(iterations), ..PlanOptions::new(rival.rig.clone(), Method::Paper, seed) };
        matched(rival, &settings, &options, wanted_percent, stop)
    };
    least_enough(grid.points, make, |matched| matched.is_reached)
}

/// Flights that [`match_goal`] plans.
const GOALS: usize = 4;

/// Percent of Completeness for each percent of the goal, where only one side is known; measured on the block and on delfshaven.
const SLOPE: f64 = 0.8;

/// The goal that is aimed at lies by so much Completeness beyond the wanted one, percent.
const BEYOND_PERCENT: f64 = 0.3;

/// Goals that make sense, percent.
const LEAST_GOAL_PERCENT: f64 = 2.0;
const MOST_GOAL_PERCENT: f64 = 99.95;

/// The refined flight of the lowest time whose Completeness is no lower than theirs, of a few that differ in their goal for matched views, which
/// is what Completeness asks for; the covered hemisphere has none. When none is enough, the one that reconstructs most.
pub fn match_goal(rival: &Rival, rounds: u32, seed: u64, theirs: &Quality, stop: &StopToken) -> Result<Matched, PlanError> {
    let wanted_percent = completeness_percent(theirs);
    let mut found: Vec<Matched> = Vec::new();
    for _ in 0..GOALS {
        let tried: Vec<[f64; 2]> =
            found.iter().map(|one| [one.plan.matched_goal_percent, completeness_percent(&one.quality)]).collect();
        let options = PlanOptions {
            iterations: Some(rounds),
            goal_percent: Some(0.0),
            matched_percent: Some(next_goal_percent(&tried, wanted_percent)),
            ..PlanOptions::new(rival.rig.clone(), Method::Refined, seed)
        };
        found.push(matched(rival, rival.settings, &options, wanted_percent, stop)?);
    }
    let time_s = |one: &Matched| one.plan.metrics.profile_s;
    let order = |a: &Matched, b: &Matched| match (a.is_reached, b.is_reached) {
        (true, true) => time_s(a).total_cmp(&time_s(b)),
        (false, false) => completeness_percent(&b.quality).total_cmp(&completeness_percent(&a.quality)),
        (a, b) => b.cmp(&a),
    };
    found.sort_by(order);
    Ok(found.swap_remove(0))
}

/// The goal to try next, after pairs of a goal and the Completeness that came of it: on the line between the nearest that was not enough and the
/// nearest that was, or on one of the usual slope while one of them is missing.
fn next_goal_percent(tried: &[[f64; 2]], wanted_percent: f64) -> f64 {
    let target = wanted_percent + BEYOND_PERCENT;
    let is_enough = |point: &&[f64; 2]| point[1] >= wanted_percent;
    let above = tried.iter().filter(is_enough).min_by(|a, b| a[0].total_cmp(&b[0]));
    let below = tried.iter().filter(|point| !is_enough(point)).max_by(|a, b| a[0].total_cmp(&b[0]));
    let goal_percent = match (below, above) {
        (None, None) => wanted_percent + 1.5,
        (Some(one), None) | (None, Some(one)) => {
            let step = (target - one[1]) / SLOPE;
            one[0] + if one[1] >= wanted_percent { step.min(-1.0) } else { step.max(1.0) }
        }
        (Some(below), Some(above)) => {
            let share = ((target - below[1]) / (above[1] - below[1])).clamp(0.2, 0.9);
            below[0] + share * (above[0] - below[0])
        }
    };
    goal_percent.clamp(LEAST_GOAL_PERCENT, MOST_GOAL_PERCENT)
}

/// A flight of ours and what all its images make of the truth. A stopped search is [`PlanError::Abandoned`]: its flight would say nothing.
fn matched(
    rival: &Rival,
    settings: &Settings,
    options: &PlanOptions,
    wanted_percent: f64,
    stop: &StopToken,
) -> Result<Matched, PlanError> {
    let plan = planner::plan(rival.snapshot, settings, options, stop, &mut |_| ())?;
    let shots = quality::shots(&plan, Which::All);
    let quality = quality::assess(rival.truth, &shots, rival.assessing, stop).ok_or(PlanError::Abandoned)?;
    let is_reached = completeness_percent(&quality) >= wanted_percent;
    let iterations = options.iterations.unwrap_or_default();
    if stop.is_stopped() { Err(PlanError::Abandoned) } else { Ok(Matched { iterations, plan, quality, is_reached }) }
}

/// What is made at the least of the points 1, 2, ... at which it is enough, by doubling and halving; at the last point when it is not enough
/// at any point that was looked at. The point before the one that is returned is not enough; those farther below neither, if what is once
/// enough stays so.
fn least_enough<T, E>(points: u32, make: impl Fn(u32) -> Result<T, E>, is_enough: impl Fn(&T) -> bool) -> Result<T, E> {
    let (mut below, mut point) = (0, 1);
    let mut found = make(point)?;
    while !is_enough(&found) {
        if point >= points {
            return Ok(found);
        }
        (below, point) = (point, (2 * point).min(points));
        found = make(point)?;
    }
    while point - below > 1 {
        let middle = below + (point - below) / 2;
        let made = make(middle)?;
        if is_enough(&made) {
            (point, found) = (middle, made);
        } else {
            below = middle;
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::convert::Infallible;

    use super::*;

    #[test]
    fn the_least_point_is_found_wherever_it_lies() {
        for points in 1..=70 {
            for least in 1..=points + 1 {
                let tried = RefCell::new(Vec::new());
                let make = |point: u32| {
                    tried.borrow_mut().push(point);
                    Ok::<u32, Infallible>(point)
                };
                let Ok(found) = least_enough(points, make, |&point| point >= least);
                assert_eq!(found, least.min(points), "of {points}");
                let mut tried = tried.into_inner();
                assert!(tried.iter().all(|point| (1..=points).contains(point)) && tried.len() <= 14, "{tried:?}");
                tried.sort_unstable();
                assert!(tried.windows(2).all(|two| two[0] < two[1]), "twice the same: {tried:?}");
            }
        }
    }

    #[test]
    fn goals_come_close_to_the_least_one_that_is_enough() {
        for wanted_percent in [15.0, 40.0, 70.0, 89.0, 95.0] {
            // Completeness saturates with the goal.
            let completeness = |goal_percent: f64| 100.0 * libm::pow(goal_percent / 100.0, 0.5);
            let mut tried: Vec<[f64; 2]> = Vec::new();
            for _ in 0..10 {
                let goal_percent = next_goal_percent(&tried, wanted_percent);
                assert!((LEAST_GOAL_PERCENT..=MOST_GOAL_PERCENT).contains(&goal_percent));
                tried.push([goal_percent, completeness(goal_percent)]);
            }
            let enough = tried.iter().map(|point| point[1]).filter(|&percent| percent >= wanted_percent);
            let nearest = enough.fold(f64::INFINITY, f64::min);
            assert!(nearest <= wanted_percent + 2.0, "{wanted_percent}: {tried:?}");
        }
    }

    #[test]
    fn where_enough_does_not_stay_enough_the_point_before_is_not_enough() {
        // Enough at 5, 6 and from 11: doubling meets 8, which is not, and 16, which is.
        let is_enough = |point: &u32| [5, 6].contains(point) || *point >= 11;
        assert_eq!(least_enough(64, Ok::<u32, Infallible>, is_enough), Ok(11));
    }

    #[test]
    fn the_usual_grid_has_steps_of_25_up_to_1600() {
        let grid = Grid::of(&Settings::default());
        assert_eq!((grid.step, grid.most()), (25, 1600));
        let mut settings = Settings::default();
        settings.search.iterations = 0;
        assert_eq!(Grid::of(&settings).step, 1);
        settings.search.iterations = MOST_ITERATIONS;
        assert!(Grid::of(&settings).most() <= MOST_ITERATIONS);
    }
}
