//! The daemon as commands see it.

use std::time::Duration;

use overfly_client::{Client, ClientError, Domain, PlanMessage};
use serde_json::Value;

use super::arguments::OrderArgs;
use super::failure::Failure;
use super::outputs::{self, FileNames, Flight, Scenery};
use super::rig_file::GivenRig;
use super::shortfall::Heights;
use crate::mission::plan_table;
use crate::mission::run_json::Engine;
use crate::settings::Settings;
use crate::trajectory::plan::{Plan, RunTimes};

/// How long a command waits for a daemon that may be starting.
const CONNECT: Duration = Duration::from_millis(500);
/// A replan takes as long as its scene takes; beyond this something is wrong.
pub const REPLAN: Duration = Duration::from_secs(3600);

/// The domain of this name, or of the built-in settings.
pub fn domain(name: Option<&str>) -> Result<Domain, Failure> {
    let name = name.map_or_else(|| Settings::default().daemon.domain, str::to_owned);
    Ok(Domain::new(&name)?)
}

/// A client of the daemon in the domain of this name.
pub fn connect(name: Option<&str>) -> Result<Client, Failure> {
    Ok(Client::connect(&domain(name)?, CONNECT)?)
}

/// What the command line asks of the daemon.
pub fn order(order: &OrderArgs, given: &GivenRig) -> overfly_client::PlanOrder {
    overfly_client::PlanOrder {
        rig: given.rig.name.clone(),
        method: order.method.clone(),
        seed: order.seed,
        iterations: order.iterations,
        budget_s: order.budget,
        goal_percent: order.coverage,
        objective: order.objective.clone(),
        matched_percent: order.matched,
        within_s: order.max_time,
        gsd_m: order.gsd,
        overlap_percent: order.overlap,
        region_m: order.region.clone().map_or(Vec::new(), |region| region.0),
        start_m: order.start.map(|start| start.0),
        start_view_deg: order.look.map(|look| look.0),
        en_route: None,
        rig_file: given.text.clone(),
    }
}

/// The domain plan of a published one.
pub fn plan_of(message: &PlanMessage) -> Result<(Plan, RunTimes), Failure> {
    plan_table::from_table(&message.table()).map_err(|error| Failure::Daemon(error.to_string()))
}

/// Writes the files of a published plan. When the scene has changed since, the field of the plan is gone and the drawing is left out.
pub fn write(
    client: &Client,
    folder: &std::path::Path,
    names: &FileNames,
    flight: &Flight,
) -> Result<(Vec<std::path::PathBuf>, Option<&'static str>), Failure> {
    let map = client.field(&flight.plan.scene.name)?;
    let field = map.table();
    let is_current = field.facts.revision == flight.plan.scene.revision;
    let remark = "note: the scene has been edited since this plan was made, so there are no drawings of it";
    let scenery = if is_current { Scenery::Field(&field) } else { Scenery::Gone };
    let written = outputs::write(folder, names, flight, &scenery)?;
    Ok((written, (!is_current).then_some(remark)))
}

/// A plan from the daemon as outputs take it.
pub fn flight(plan: &Plan, times: RunTimes, edit_to_plan_s: Option<f64>, import: Option<Value>) -> Flight<'_> {
    Flight {
        plan,
        times,
        engine: Engine::Daemon,
        edit_to_plan_s,
        import,
        order: None,
        settings: None,
        scene_file: None,
        ground_file: None,
        // What a daemon publishes of a scene has no ground.
        terrain: None,
    }
}

/// How far up the structures and views of a plan's scene reach, while its field still stands.
pub fn heights(client: &Client, plan: &Plan) -> Option<Heights> {
    let map = client.field(&plan.scene.name).ok()?;
    let field = map.table();
    (field.facts.revision == plan.scene.revision).then(|| Heights::of(&field, None))
}

/// Cancels the search of a scene from the signal's thread, by a client of its own.
pub fn cancel(domain: Option<&str>, scene: &str) {
    let cancelled = connect(domain).and_then(|client| Ok(client.cancel(scene)?));
    if let Err(failure) = cancelled {
        eprintln!("overfly: the search could not be stopped: {failure}");
    }
}

/// Whether the daemon is simply not there.
pub fn is_absent(failure: &Failure) -> bool {
    matches!(failure, Failure::Client(ClientError::NoDaemon { .. }))
}
