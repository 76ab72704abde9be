//! How the best path changes with the iterations (the paper's supplement).

use super::ReproductionError;
use super::chart::{self, Drawing, Panel, Series};
use super::figures::{self, ONE_CAMERA, spread};
use super::site::Site;
use super::study::{Flights, Study};
use super::table::Table;
use crate::planner::Method;
use crate::search::Iteration;

/// Rows of the table: so many parts of the longest search.
const PARTS: usize = 8;

/// Column, decimals and figure of each quantity.
type Quantity = (&'static str, usize, fn(&Iteration) -> f64);

const QUANTITIES: [Quantity; 4] = [
    ("Coverage of capturable, by the field [%]", 1, |iteration| iteration.coverage_percent),
    ("Length [m]", 0, |iteration| iteration.length_m),
    ("Objective E (Eq. 6)", 0, |iteration| iteration.objective),
    ("Turning [s]", 0, |iteration| iteration.turning_s),
];

pub fn figure(study: &mut Study) -> Result<(Table, Drawing), ReproductionError> {
    let columns: Vec<&str> = std::iter::once("Iteration").chain(QUANTITIES.map(|(column, ..)| column)).collect();
    let title = "Convergence (block of NY-1's size, one camera)";
    let mut table = Table::new("convergence", title, &columns);
    let settings = figures::benchmark(&study.settings);
    let trial = study.trial(Site::Ny1, ONE_CAMERA, Method::Paper, settings.clone());
    let flights = study.flights(&trial)?;
    let longest = flights.plans.iter().map(|plan| plan.convergence.len()).max().unwrap_or(0);
    let rows = (1..=PARTS).map(|part| part * longest / PARTS).filter(|&iteration| iteration > 0);
    for iteration in rows {
        let reached: Vec<&Iteration> = flights.plans.iter().filter_map(|plan| at(&plan.convergence, iteration)).collect();
        let cells = QUANTITIES.map(|(_, decimals, figure)| spread(reached.iter().map(|iteration| figure(iteration)), decimals));
        table.ours(&[&iteration.to_string()], cells.to_vec());
    }
    figures::note_settings(&mut table, &settings, study.seeds);
    table.note(
        "The best path after each iteration; a search that has reached its goal keeps its last one. Drawn in convergence.svg.",
    );
    let svg = chart::lines("Best path after each iteration, by seed", "iterations", &panels(&flights));
    Ok((table, Drawing { file: "convergence.svg".to_owned(), svg }))
}

/// The state after so many iterations; a search that ended earlier keeps its last one.
fn at(convergence: &[Iteration], iteration: usize) -> Option<&Iteration> {
    convergence.get(iteration - 1).or(convergence.last())
}

fn panels(flights: &Flights) -> Vec<Panel> {
    let panel = |(title, _, figure): Quantity| {
        let series = flights.plans.iter().map(|plan| {
            let points = plan.convergence.iter().enumerate().map(|(index, state)| [(index + 1) as f64, figure(state)]);
            Series { name: format!("seed {}", plan.seed), points: points.collect() }
        });
        Panel { title: title.to_owned(), series: series.collect() }
    };
    QUANTITIES.map(panel).to_vec()
}
