//! Table 1: the terms of the objective.

use super::ReproductionError;
use super::figures::{self, ONE_CAMERA, of_plans};
use super::paper;
use super::site::Site;
use super::study::Study;
use super::table::{Cell, Table};
use crate::planner::Method;
use crate::settings::Settings;

/// Which terms stand beside E_g: E_e, E_t.
const TERMS: [[bool; 2]; 4] = [[false, false], [true, false], [false, true], [true, true]];

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let columns = [
        "Objective",
        "Length ↓ [m]",
        "#Waypoints ↓",
        "Movement ↓ [s]",
        "Turning ↓ [s]",
        "Profile time [s]",
        "Coverage of capturable [%]",
        "Iterations",
    ];
    let mut table = Table::new("table1", "Table 1. Terms of the objective (block of NY-1's size, one camera)", &columns);
    let settings = figures::benchmark(&study.settings);
    for ((objective, figures), terms) in paper::TABLE1.iter().zip(TERMS) {
        table.paper(&[objective], &figures.map(|figure| (figure, 0)));
        let cells = row(study, with_terms(&settings, terms))?;
        table.ours(&[objective], cells);
    }
    figures::note_settings(&mut table, &settings, study.seeds);
    table.note("E_g alone is eta = 0 and alpha_t = 0, without E_t alpha_t = 0, without E_e eta = 0; all with the same K and G.");
    table.note(
        "The paper's Movement is length / (8 m/s) plus its Turning (its first row alone is not); ours is given in the same way.",
    );
    Ok(table)
}

fn with_terms(settings: &Settings, [efficiency, turning]: [bool; 2]) -> Settings {
    let mut settings = settings.clone();
    if !efficiency {
        settings.objective.eta = 0.0;
    }
    if !turning {
        settings.objective.alpha_t = 0.0;
    }
    settings
}

fn row(study: &mut Study, settings: Settings) -> Result<Vec<Cell>, ReproductionError> {
    let trial = study.trial(Site::Ny1, ONE_CAMERA, Method::Paper, settings);
    let flights = study.flights(&trial)?;
    Ok(vec![
        figures::length(&flights),
        of_plans(&flights, 0, |plan| plan.waypoints.len() as f64),
        of_plans(&flights, 0, |plan| plan.metrics.flight_s),
        of_plans(&flights, 0, |plan| plan.metrics.turning_s),
        of_plans(&flights, 0, |plan| plan.metrics.profile_s),
        figures::coverage(&flights),
        of_plans(&flights, 0, |plan| plan.convergence.len() as f64),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_are_left_out_by_their_weights() {
        let settings = Settings::default();
        let weights = TERMS.map(|terms| {
            let objective = with_terms(&settings, terms).objective;
            [objective.eta > 0.0, objective.alpha_t > 0.0]
        });
        assert_eq!(weights, TERMS);
        assert_eq!(with_terms(&settings, [true, true]), settings);
    }
}
