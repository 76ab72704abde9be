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
        let plan = planner::plan(rival.snapshot, &settings, &options, stop, &mut |_| ())?;
        let shots = quality::shots(&plan, Which::All);
        let quality = quality::assess(rival.truth, &shots, rival.assessing, stop).ok_or(PlanError::Abandoned)?;
        let is_reached = completeness_percent(&quality) >= wanted_percent;
        if stop.is_stopped() { Err(PlanError::Abandoned) } else { Ok(Matched { iterations, plan, quality, is_reached }) }
    };
    least_enough(grid.points, make, |matched| matched.is_reached)
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
