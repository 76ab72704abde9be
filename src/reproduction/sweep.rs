//! How the constants that the paper leaves open act: one is changed at a time.

use super::ReproductionError;
use super::figures::{self, ONE_CAMERA, of_plans};
use super::site::Site;
use super::study::Study;
use super::table::Table;
use crate::planner::Method;
use crate::settings::Settings;

/// A constant, the values that it is given, and where it stands.
type Constant = (&'static str, &'static [f64], fn(&mut Settings) -> &mut f64);

const CONSTANTS: [Constant; 3] = [
    ("coverage.theta0_deg", &[15.0, 20.0, 25.0, 28.0], |settings| &mut settings.coverage.theta0_deg),
    ("objective.eta", &[0.05, 0.1, 0.2, 0.3, 1.0], |settings| &mut settings.objective.eta),
    ("search.neighbour_share", &[0.10, 0.15, 0.20], |settings| &mut settings.search.neighbour_share),
];

const SITES: [Site; 3] = [Site::Ny1, Site::Delfshaven, Site::Nihonbashi];

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let columns = ["Scene", "Setting", "Value", "Coverage of capturable [%]", "Capturable [%]", "Length [m]", "Profile time [s]"];
    let mut table = Table::new("sweep", "Sweep of constants that the paper leaves open (one camera)", &columns);
    let built_in = figures::benchmark(&study.settings);
    for site in SITES {
        if !figures::is_there(study, &mut table, site) {
            continue;
        }
        for (name, values, place) in CONSTANTS {
            for &value in values {
                let mut settings = built_in.clone();
                *place(&mut settings) = value;
                study.step(&format!("{}: {name} = {value}", site.name()))?;
                let trial = study.trial(site, ONE_CAMERA, Method::Paper, settings);
                let flights = study.flights(&trial)?;
                if figures::is_flown(&mut table, &trial, &flights) {
                    let cells = vec![
                        figures::coverage(&flights),
                        of_plans(&flights, 1, |plan| plan.metrics.capturable_percent),
                        figures::length(&flights),
                        of_plans(&flights, 0, |plan| plan.metrics.profile_s),
                    ];
                    table.ours(&[site.name(), name, &value.to_string()], cells);
                }
            }
        }
    }
    figures::note_settings(&mut table, &built_in, study.seeds);
    table.note("The note above gives the values of what is not swept. What can be captured at all depends on theta0 too: compare coverages within one theta0.");
    Ok(table)
}
