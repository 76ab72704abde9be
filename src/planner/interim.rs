//! Flights that are handed out while the search goes on, each better than the one before.

use super::order::{Before, Order};
use super::{Made, Objective, PlanError};
use crate::camera::Pose;
use crate::refine::{Confirmed, Worth};
use crate::search::Outcome;
use crate::search::leg::headed;
use crate::stop::free_behind;
use crate::trajectory::evaluate::Capture;
use crate::trajectory::plan::StopReason;
use crate::trajectory::record::Record;
use crate::trajectory::route::Found;

/// What has been handed out so far of a search that goes on with an earlier flight.
pub struct Interim<'i> {
    order: &'i Order<'i>,
    on_interim: &'i mut (dyn FnMut(Made) + Send),
    best: Option<Best>,
    /// What the images of the last flight see that was looked at.
    looked: Option<Record>,
}

/// The best flight that was handed out: the part of it that is searched.
struct Best {
    path: Vec<Pose>,
    standing: Standing,
}

/// What flights are compared by.
struct Standing {
    worth: Worth,
    duration_s: f64,
    /// Eq. 6.
    objective: f64,
}

/// A record is as many pieces of memory as the field has samples.
impl Drop for Interim<'_> {
    fn drop(&mut self) {
        if let Some(record) = self.looked.take() {
            free_behind(record);
        }
    }
}

impl<'i> Interim<'i> {
    pub fn new(order: &'i Order<'i>, on_interim: &'i mut (dyn FnMut(Made) + Send)) -> Self {
        Self { order, on_interim, best: None, looked: None }
    }

    /// Whether somebody has a flight already while the search goes on.
    pub fn has_handed_out(&self) -> bool {
        self.best.is_some()
    }

    /// Hands a flight out if it is short enough and better than all before.
    pub fn offer(&mut self, path: &[Pose], made: Made) {
        if self.order.stop.is_abandoned() {
            free_behind(made.record);
            return;
        }
        let standing = self.standing(&made);
        let is_short_enough = self.order.within_s().is_none_or(|within_s| standing.duration_s <= within_s);
        if is_short_enough && self.best.as_ref().is_none_or(|best| self.is_better(&standing, &best.standing)) {
            self.best = Some(Best { path: path.to_vec(), standing });
            self.looked = Some(made.record.clone());
            (self.on_interim)(made);
        } else {
            self.looked = Some(made.record);
        }
    }

    /// What a path is worth, which is handed out if it is better than all before.
    pub fn confirmed(&mut self, path: &[Pose]) -> Confirmed {
        let order = self.order;
        if let Some(Best { standing, .. }) = self.best.as_ref().filter(|best| best.path == path) {
            // Known since it was handed out.
            return Confirmed { worth: standing.worth, duration_s: standing.duration_s - order.before_s() };
        }
        let before = self.looked.take().map_or(Before::Nothing, Before::Look);
        match order.on_the_way(&headed(&order.problem.rig, path), StopReason::Improved, before) {
            Ok(made) => {
                let Standing { worth, duration_s, .. } = self.standing(&made);
                self.offer(path, made);
                Confirmed { worth, duration_s: duration_s - order.before_s() }
            }
            // Whatever is wrong with it, the search may go on.
            Err(_) => order.confirmed(path),
        }
    }

    /// The last flight of the search, or the best one that was handed out where that is better: nothing that comes later is worse.
    pub fn last(self, made: Made) -> Result<Made, PlanError> {
        let standing = self.standing(&made);
        match &self.best {
            Some(best) if self.is_better(&best.standing, &standing) => {
                let is_enough = best.standing.worth.is_enough(self.order.required());
                let stop = if is_enough && made.plan.stop == StopReason::IterationsUsed {
                    StopReason::GoalReached
                } else {
                    made.plan.stop
                };
                let path = headed(&self.order.problem.rig, &best.path);
                let outcome = Outcome { path, convergence: made.plan.convergence, stop };
                self.order.finished(Found::of(outcome, self.order.problem), Before::Nothing)
            }
            _ => Ok(made),
        }
    }

    fn standing(&self, made: &Made) -> Standing {
        let Capture { captured, matched, .. } = made.record.capture(self.order.problem);
        let metrics = &made.plan.metrics;
        Standing { worth: Worth { captured, matched }, duration_s: metrics.profile_s, objective: metrics.objective }
    }

    fn is_better(&self, one: &Standing, other: &Standing) -> bool {
        let required = self.order.required();
        let counted = |standing: &Standing| standing.worth.counted(required).sum();
        let options = self.order.options;
        match (options.objective, options.within_s) {
            (Objective::Eq6, _) => one.objective > other.objective,
            // Within a time the most counts, beyond the goals too.
            (Objective::Time, Some(_)) => one.worth.captured > other.worth.captured,
            // Else the shortest of those that come as near to the goals.
            (Objective::Time, None) => {
                counted(one).cmp(&counted(other)).then(other.duration_s.total_cmp(&one.duration_s)).is_gt()
            }
        }
    }
}
