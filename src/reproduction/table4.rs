//! Table 4: one camera over real scenes, beside Zhou et al. 2020. The figures of Table 5 are the same.

use super::ReproductionError;
use super::figures::{self, ONE_CAMERA, of_plans};
use super::paper::{self, RealFlight};
use super::site::Site;
use super::study::{Flights, Study};
use super::table::{Cell, Table};
use crate::planner::Method;

const SITES: [Site; 2] = [Site::Delfshaven, Site::Nihonbashi];

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let mut table = empty("table4", "Table 4. One camera over real scenes");
    add_paper(&mut table, &paper::TABLE4);
    let settings = figures::real(&study.settings);
    for site in SITES {
        if !figures::is_there(study, &mut table, site) {
            continue;
        }
        for method in [Method::Zhou, Method::Paper] {
            let trial = study.trial(site, ONE_CAMERA, method, settings.clone());
            let flights = study.flights(&trial)?;
            if figures::is_flown(&mut table, &trial, &flights) {
                table.ours(&[site.name(), figures::label(method)], cells(method, &flights));
            }
        }
    }
    finish(&mut table, study);
    Ok(table)
}

/// A table of flights over real scenes.
pub fn empty(key: &'static str, title: &str) -> Table {
    let columns =
        ["Scene", "Method", "Length ↓ [m]", "Flight time ↓ [min]", "Battery ↓ [%]", "Coverage of capturable [%]", "Images used"];
    Table::new(key, title, &columns)
}

pub fn add_paper(table: &mut Table, rows: &[RealFlight]) {
    for (scene, method, [length_m, time_min, battery_percent]) in rows {
        table.paper(&[scene, method], &[(*length_m, 0), (*time_min, 1), (*battery_percent, 0)]);
    }
}

pub fn cells(method: Method, flights: &Flights) -> Vec<Cell> {
    vec![
        figures::length(flights),
        of_plans(flights, 1, |plan| plan.metrics.profile_s / 60.0),
        of_plans(flights, 0, |plan| plan.metrics.battery_percent.unwrap_or(f64::NAN)),
        figures::coverage(flights),
        of_plans(flights, 0, |plan| figures::used_images(method, plan) as f64),
    ]
}

pub fn finish(table: &mut Table, study: &Study) {
    figures::note_settings(table, &figures::real(&study.settings), study.seeds);
    table.note("Our scenes are other ones than the paper's. Our flight time is that of the speed profile, with the same limits for every method.");
    table.note("Methods reach different coverages: read a shorter flight together with what it covers.");
}
