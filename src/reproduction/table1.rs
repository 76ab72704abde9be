//! Table 1: the terms of the objective.

use super::ReproductionError;
use super::figures::{self, ONE_CAMERA, of_plans};
use super::paper;
use super::site::Site;
use super::study::{Flights, Study, Trial};
use super::table::{Cell, Table};
use crate::planner::Method;
use crate::settings::Settings;

/// Which terms stand beside E_g: E_e, E_t.
const TERMS: [[bool; 2]; 4] = [[false, false], [true, false], [false, true], [true, true]];

/// The refined flight was to be no longer than this, m.
pub const REFINED_MOST_M: f64 = 2700.0;

/// Refined flights take longer to plan than the others.
pub const REFINED_SEEDS: u32 = 3;

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
        let trial = study.trial(Site::Ny1, ONE_CAMERA, Method::Paper, with_terms(&settings, terms));
        let cells = row(study, &trial)?;
        table.ours(&[objective], cells);
    }
    let refined = study.trial(Site::Ny1, ONE_CAMERA, Method::Refined, with_rounds(&settings));
    let refined = Trial { seeds: study.seeds.min(REFINED_SEEDS), ..refined };
    let cells = row(study, &refined)?;
    table.ours(&["full, refined"], cells);
    figures::note_settings(&mut table, &settings, study.seeds);
    table.note("E_g alone is eta = 0 and alpha_t = 0, without E_t alpha_t = 0, without E_e eta = 0; all with the same K and G.");
    table.note(
        "The paper's Movement is length / (8 m/s) plus its Turning (its first row alone is not); ours is given in the same way.",
    );
    let flights = study.flights(&refined)?;
    note_refined(&mut table, &refined, &flights);
    Ok(table)
}

/// Says how the refined row was made, and what of its goal it misses.
fn note_refined(table: &mut Table, trial: &Trial, flights: &Flights) {
    let goal_percent = trial.settings.coverage.goal_percent;
    let enough = flights.plans.iter().filter(|plan| plan.metrics.coverage_percent >= goal_percent).count();
    table.note(format!(
        "The refined row goes beyond the paper: the flight of a small tree, improved by local search for {} rounds, whose goal is {goal_percent} % of \
         the capturable samples, by exact rays; seeds 1 to {}. {enough} of {} flights reach it.",
        trial.settings.refine.rounds,
        trial.seeds,
        flights.plans.len()
    ));
    let lengths_m = flights.figures(|plan| plan.metrics.length_m);
    if let Some(length_m) = Cell::spread(&lengths_m, 0).value().filter(|&length_m| length_m > REFINED_MOST_M) {
        table.note(format!(
            "Its length was to be at most {REFINED_MOST_M:.0} m and is {length_m:.0} m. A greedy choice of free views, which no flight can match, takes 263 \
             images here, and {REFINED_MOST_M:.0} m have room for {:.0}.",
            REFINED_MOST_M / trial.settings.search.image_spacing_m
        ));
    }
}

/// Twice the usual number of rounds.
pub fn with_rounds(settings: &Settings) -> Settings {
    let mut settings = settings.clone();
    settings.refine.rounds = settings.refine.rounds.saturating_mul(2);
    settings
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

fn row(study: &mut Study, trial: &Trial) -> Result<Vec<Cell>, ReproductionError> {
    let flights = study.flights(trial)?;
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
