//! What the images of a plan see that comes from a file.

use super::{PlanError, PlanOptions, StopToken};
use crate::field::Snapshot;
use crate::search::{Problem, Wanted};
use crate::settings::Settings;
use crate::trajectory::evaluate::{self, Sightings};
use crate::trajectory::plan::Plan;

/// The plan with what a file does not hold, its covered cells and what its rig can cover at all, and who sees what. `options` say what was wanted:
/// the region, the sampling distance and the rig.
pub fn look(
    snapshot: &Snapshot,
    settings: &Settings,
    options: &PlanOptions,
    plan: Plan,
    stop: &StopToken,
) -> Result<(Plan, Sightings), PlanError> {
    let wanted = Wanted { region: options.region()?, gsd_m: options.gsd_m, ..Wanted::default() };
    let problem = Problem::wanted(snapshot, settings, options.rig.clone(), &wanted);
    let sightings = evaluate::sightings(snapshot, &problem.disks, &plan.images, stop).ok_or(PlanError::Abandoned)?;
    let cells = sightings.capture(&problem, |_| true).cells;
    Ok((Plan { cells, ceilings: problem.ceilings, ..plan }, sightings))
}
