//! Table 5: five cameras over real scenes, beside oblique photography.

use super::ReproductionError;
use super::figures::{self, FIVE_CAMERAS};
use super::paper;
use super::site::Site;
use super::study::Study;
use super::table::Table;
use super::table4;
use crate::planner::Method;

const SITES: [Site; 2] = [Site::Delfshaven, Site::Manhattan];

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let mut table = table4::empty("table5", "Table 5. Five cameras over real scenes");
    table4::add_paper(&mut table, &paper::TABLE5);
    for site in SITES {
        if !figures::is_there(study, &mut table, site) {
            continue;
        }
        let legal = study.trial(site, FIVE_CAMERAS, Method::Oblique, figures::real(&study.settings));
        let settings = figures::with_room_above(study, &mut table, &legal)?;
        for method in [Method::Oblique, Method::Paper] {
            let trial = study.trial(site, FIVE_CAMERAS, method, settings.clone());
            let flights = study.flights(&trial)?;
            if figures::is_flown(&mut table, &trial, &flights) {
                table.ours(&[site.name(), figures::label(method)], table4::cells(method, &flights));
            }
        }
    }
    table4::finish(&mut table, study);
    figures::note_range(&mut table, &study.settings);
    Ok(table)
}
