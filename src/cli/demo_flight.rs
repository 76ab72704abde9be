//! The demo's flight: an aircraft is on its way along the plan while the scene changes three times, and flies on along the plan that comes.

use std::path::{Path, PathBuf};

use nalgebra::{Point3, distance};
use overfly_client::{Client, Domain, EditOrder, FlightReport, PlanMessage};

use super::daemon;
use super::failure::Failure;
use super::progress::Meter;
use super::received::{self, Made};
use crate::mission::svg::strip::{self, Stretch};
use crate::trajectory::plan::Plan;

/// The scene changes when so many of the images that were ahead have been taken.
const TAKEN_SHARE: f64 = 0.3;

/// Half the width of the crane that comes to stand on the path, and by how much it rises above the path, m.
const CRANE_HALF_M: f64 = 2.0;
const CRANE_ABOVE_M: f64 = 8.0;

/// By how much a building is raised, m.
const RAISE_M: f64 = 15.0;

/// Half the side of the no-fly zone, and how far up it reaches, m.
const ZONE_HALF_M: f64 = 22.0;
const ZONE_CEILING_M: f64 = 150.0;

/// What has come of the flight.
pub struct Flown {
    pub file: PathBuf,
    /// From each edit to the first safe plan.
    pub first_plans_ms: Vec<f64>,
    /// What all images capture when the aircraft has landed, percent of what can be captured.
    pub coverage_percent: f64,
}

/// Flies along the plan of `message` and draws the flight into `folder`.
pub fn fly(
    client: &Client,
    domain: &Domain,
    folder: &Path,
    scene: &str,
    message: PlanMessage,
    meter: &mut Meter,
) -> Result<Flown, Failure> {
    let (mut plan, _) = daemon::plan_of(&message)?;
    let (mut epoch, mut flown, mut flown_s) = (message.epoch(), Vec::new(), 0.0);
    let mut stretches = vec![stretch(client, "The flight begins", None, &flown, flown_s, &plan)?];
    let mut zones: Vec<Vec<[f64; 2]>> = Vec::new();
    let mut first_plans_ms = Vec::new();
    for number in 0..3 {
        meter.stage(&format!("in the air: change {} of 3", number + 1));
        let Some(here) = report(&plan, epoch) else { break };
        let taken_s = plan.images[here.images_taken as usize - 1].time_s;
        flown.extend(strip::flown_until(&plan, taken_s));
        flown.push(here.position_m.into());
        flown_s += taken_s;
        client.report(scene, &here)?;
        let (title, changed, edit) = change(client, scene, number, &plan, &here)?;
        if let EditOrder::AddZone { outline_m, .. } = &edit {
            zones.push(outline_m.clone());
        }
        let Made { edited, first, .. } = received::edit(client, domain, scene, &edit)?;
        first_plans_ms.push(1e3 * first.as_secs_f64());
        let message = client.await_replan(&edited, daemon::REPLAN, &mut |note| meter.note(note))?;
        (plan, epoch) = (daemon::plan_of(&message)?.0, message.epoch());
        let mut next = stretch(client, &title, changed.as_deref(), &flown, flown_s, &plan)?;
        next.zones.clone_from(&zones);
        stretches.push(next);
    }
    let file = folder.join("flight.svg");
    let svg = strip::to_bytes("A flight while the scene changes three times", &stretches);
    std::fs::write(&file, svg).map_err(|cause| Failure::write(&file, cause))?;
    Ok(Flown { file, first_plans_ms, coverage_percent: plan.metrics.coverage_percent })
}

/// What the aircraft reports on its way along a plan; `None` where there is next to nothing to fly.
fn report(plan: &Plan, epoch: u64) -> Option<FlightReport> {
    let taken = (plan.images.len() as f64 * TAKEN_SHARE) as usize;
    let last = plan.images.get(taken.checked_sub(1)?)?;
    let passage = plan.profile()?.at(last.time_s)?;
    Some(FlightReport {
        epoch,
        images_taken: taken as u64,
        position_m: passage.position_m.into(),
        velocity_mps: passage.velocity_mps.into(),
        ..FlightReport::default()
    })
}

/// What happens: in words, to which structure, and as an edit.
fn change(
    client: &Client,
    scene: &str,
    number: usize,
    plan: &Plan,
    here: &FlightReport,
) -> Result<(String, Option<String>, EditOrder), Failure> {
    let here_m = Point3::from(here.position_m);
    let ahead = plan.waypoints.iter().map(|waypoint| waypoint.position_m).skip(plan.waypoints.len() / 2);
    let square = |centre: &Point3<f64>, half_m: f64| {
        let corner = |x: f64, y: f64| [centre.x + x * half_m, centre.y + y * half_m];
        vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]
    };
    let nothing = || Failure::Unexpected("there is nothing left to fly".to_owned());
    Ok(match number {
        0 => {
            let on_path = ahead.clone().next().ok_or_else(nothing)?;
            let crane = EditOrder::add_prism("crane", square(&on_path, CRANE_HALF_M), 0.0, on_path.z + CRANE_ABOVE_M);
            ("A crane stands on the path".to_owned(), Some("crane".to_owned()), crane)
        }
        1 => {
            let mut structures = client.structures(scene)?;
            structures.sort_by(|a, b| a.top_m.total_cmp(&b.top_m).then(a.id.cmp(&b.id)));
            let structure = structures.get(structures.len() * 3 / 4).map(|one| one.name.clone()).ok_or_else(nothing)?;
            let title = format!("{structure} turns out to be {RAISE_M} m taller");
            (title, Some(structure.clone()), EditOrder::Raise { structure, by_m: RAISE_M })
        }
        _ => {
            let away = ahead.max_by(|a, b| distance(a, &here_m).total_cmp(&distance(b, &here_m))).ok_or_else(nothing)?;
            let outline_m = square(&away, ZONE_HALF_M);
            let zone = EditOrder::AddZone { name: "closed".to_owned(), outline_m, floor_m: 0.0, ceiling_m: Some(ZONE_CEILING_M) };
            ("A part of the air is closed".to_owned(), None, zone)
        }
    })
}

fn stretch(
    client: &Client,
    title: &str,
    changed: Option<&str>,
    flown: &[Point3<f64>],
    flown_s: f64,
    plan: &Plan,
) -> Result<Stretch, Failure> {
    let map = client.field(&plan.scene.name)?;
    let metrics = &plan.metrics;
    let caption =
        format!("{flown_s:.0} s flown, {:.0} s ahead, {:.1} % captured in the end", metrics.profile_s, metrics.coverage_percent);
    Ok(Stretch::new(title.to_owned(), caption, &map.table(), changed, flown, plan))
}
