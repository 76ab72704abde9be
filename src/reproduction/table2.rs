//! Table 2: imperfect proxies. Flights are planned on the degraded proxy and held against the true scene.

use super::ReproductionError;
use super::figures::{self, ONE_CAMERA, spread};
use super::paper::{self, Reconstruction};
use super::site::Site;
use super::study::{Proxy, Study, Trial};
use super::table::{Cell, Table};
use crate::planner::Method;
use crate::quality::{self, Flown};
use crate::scene::degrade::Boundary;
use crate::trajectory::plan::Plan;

/// Share by which heights are off, percent; in the order of the paper's rows.
const HEIGHTS_PERCENT: [f64; 3] = [0.0, 10.0, 20.0];

pub fn tables(study: &mut Study) -> Result<Vec<Table>, ReproductionError> {
    let heights = HEIGHTS_PERCENT.map(|heights_percent| Proxy { heights_percent, ..Proxy::EXACT });
    let boundaries = Boundary::ALL.map(|boundary| Proxy { boundary, ..Proxy::EXACT });
    let mut by_height = empty("table2-heights", "Table 2, top. Proxies with perturbed heights", "Height perturbation");
    fill(study, &mut by_height, paper::TABLE2_HEIGHTS.iter().zip(heights))?;
    let mut by_boundary = empty("table2-boundaries", "Table 2, bottom. Proxies with dilated boundaries", "Building boundary");
    fill(study, &mut by_boundary, paper::TABLE2_BOUNDARIES.iter().zip(boundaries))?;
    by_boundary.note("The paper gives no distances for its dilations; ours are 1, 2 and 4 m.");
    Ok(vec![by_height, by_boundary])
}

fn empty(key: &'static str, title: &str, label: &'static str) -> Table {
    let columns = [
        label,
        "Num. images",
        "Length [m]",
        "Error 90 % ↓ [m]",
        "Error 95 % ↓ [m]",
        "Completeness 0.020 m ↑ [%]",
        "Completeness 0.050 m ↑ [%]",
        "Completeness 0.075 m ↑ [%]",
        "Least clearance to the truth [m]",
        "Flights that collide",
        "Proxy wrong by up to [m]",
        "Proxies with a warning",
    ];
    Table::new(key, format!("{title} (block of NY-1's size, one camera)"), &columns)
}

fn fill<'a>(
    study: &mut Study,
    table: &mut Table,
    rows: impl Iterator<Item = (&'a (&'a str, Reconstruction), Proxy)>,
) -> Result<(), ReproductionError> {
    let settings = figures::benchmark(&study.settings);
    for ((label, figures), proxy) in rows {
        table.paper(&[label], &figures::printed(figures));
        let trial = Trial { proxy, ..study.trial(Site::Ny1, ONE_CAMERA, Method::Paper, settings.clone()) };
        let flights = study.flights(&trial)?;
        if figures::is_flown(table, &trial, &flights) {
            let mut cells = figures::reconstruction(&flights, &study.qualities(&trial)?);
            cells.extend(safety(study, &trial, &flights.plans)?);
            table.ours(&[label], cells);
        }
    }
    figures::note_settings(table, &settings, study.seeds);
    figures::note_quality(table, &settings);
    table.note(format!(
        "A warning is given when the proxy is wrong by more than the safety distance of {} m: then keeping it clear of the proxy does not \
         keep a flight clear of the truth.",
        settings.flight.safety_distance_m
    ));
    Ok(())
}

/// How near the flights come to what really stands there, and what was to be feared.
fn safety(study: &mut Study, trial: &Trial, plans: &[Plan]) -> Result<Vec<Cell>, ReproductionError> {
    let truth = study.truth(trial.site)?;
    let safety_distance_m = trial.settings.flight.safety_distance_m;
    let flown: Vec<Flown> = plans
        .iter()
        .map(|plan| {
            let curve: Vec<_> = plan.waypoints.iter().map(|waypoint| waypoint.position_m).collect();
            quality::flown(&truth, &curve, safety_distance_m)
        })
        .collect();
    let errors = study.proxy_errors(trial)?;
    let of_all = |count: usize, all: usize| Cell::text(format!("{count} of {all}"));
    Ok(vec![
        spread(flown.iter().map(|flown| flown.clearance_m), 2),
        of_all(flown.iter().filter(|flown| flown.collides).count(), flown.len()),
        spread(errors.iter().map(|error| error.vertical.max(error.lateral)), 2),
        of_all(errors.iter().filter(|error| error.exceeds(safety_distance_m)).count(), errors.len()),
    ])
}
