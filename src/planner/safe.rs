//! The first flight after an edit, before there is a field of the scene as it is: what of the flight before can be flown there, checked all along its curve.
//!
//! Whether a flight is safe depends on structures, zones and limits alone. So an aircraft need not wait for viewpoints, samples and lines of sight, which tell
//! what the flight captures: the plan that follows tells that.

use std::sync::Arc;

use super::order::Order;
use super::{Ordered, PlanError, PlanOptions, StopToken, matched_goal_percent, ordered};
use crate::field::{Cleared, Snapshot};
use crate::search::Problem;
use crate::settings::Settings;
use crate::trajectory::known::{Known, SafeFlight};
use crate::trajectory::plan::Plan;

/// What can be flown of `options.earlier` in a scene that was edited since `before`; nothing where too little of it is left, or where it takes longer than
/// there is time. Ways round what is new lead over the viewpoints of the field before. `known` is the flight before, if it was found safe in that scene: it
/// changes nothing but the time that this takes.
pub fn safe(
    before: &Snapshot,
    cleared: &Cleared,
    settings: &Settings,
    options: &PlanOptions,
    known: Option<&Arc<SafeFlight>>,
    stop: &StopToken,
) -> Result<Option<(Plan, Arc<SafeFlight>)>, PlanError> {
    let snapshot = &before.carried_to(cleared);
    let Ordered { settings, rig, wanted } = &ordered(snapshot, settings, options)?;
    let problem = Problem::to_fly(snapshot, settings, rig.clone(), wanted);
    let known = known.filter(|flight| flight.is_safe_in(&before.free));
    let known = known.and_then(|flight| Known::new(Arc::clone(flight), cleared.free.only_new(&cleared.differences)));
    let matched_goal_percent = matched_goal_percent(settings, options);
    let mut order = Order { snapshot, settings, options, problem: &problem, matched_goal_percent, stop, departure: None, known };
    if let Some(en_route) = &options.en_route {
        order.departure = Some(order.depart(en_route)?);
    }
    order.check_wanted()?;
    let Some(path) = order.resumed() else { return Ok(None) };
    let made = order.safe_plan(&path)?;
    let is_short_enough = order.within_s().is_none_or(|within_s| made.0.metrics.profile_s <= within_s);
    Ok(is_short_enough.then_some(made))
}
