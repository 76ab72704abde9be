//! Table 3: reconstruction by the methods of others and by ours.

use std::sync::Arc;

use super::ReproductionError;
use super::figures::{self, FIVE_CAMERAS, ONE_CAMERA};
use super::paper;
use super::site::Site;
use super::study::{Flights, Study, Trial};
use super::table::Table;
use crate::planner::Method;
use crate::quality::{Compared, Quality, compare};

/// Our scenes in the places of the paper's.
pub const SCENES: [(&str, Site); 3] = [("NY-1", Site::Ny1), ("UK-1", Site::Delfshaven), ("Bridge-1", Site::Nihonbashi)];

/// In the order of the paper's rows.
const METHODS: [Method; 4] = [Method::Smith, Method::Zhou, Method::Oblique, Method::Paper];

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let columns = [
        "Scene",
        "Method",
        "Num. images",
        "Length [m]",
        "Error 90 % ↓ [m]",
        "Error 95 % ↓ [m]",
        "Completeness 0.020 m ↑ [%]",
        "Completeness 0.050 m ↑ [%]",
        "Completeness 0.075 m ↑ [%]",
        "Error 90 % on common samples [m]",
        "Error 95 % on common samples [m]",
        "Common samples [%]",
        "Coverage of capturable [%]",
    ];
    let mut table = Table::new("table3", "Table 3. Reconstruction by several methods", &columns);
    for (name, site) in SCENES {
        for (scene, method, figures) in paper::TABLE3.iter().filter(|(scene, ..)| *scene == name) {
            table.paper(&[scene, method], &figures::printed(figures));
        }
        if figures::is_there(study, &mut table, site) {
            add_scene(study, &mut table, site)?;
        }
    }
    let settings = figures::benchmark(&study.settings);
    figures::note_settings(&mut table, &settings, study.seeds);
    figures::note_quality(&mut table, &settings);
    table.note("delfshaven and nihonbashi stand in the places of UK-1 and Bridge-1: they are other scenes than the paper's.");
    table.note("Oblique photography (OP) flies five cameras, all other methods one.");
    table.note("Ours reconstructs from its post-selected images (section 5.3), the other methods from all of theirs.");
    table.note("There is no chance in OP: it has one flight, which is held beside each seed of the others.");
    table.note("Coverage is of what the method's own rig can capture.");
    table.note("Common samples are those that every method of the scene reconstructs with the same seed.");
    Ok(table)
}

/// The flights of all methods over a site, in the paper's order; all with room above for oblique photography.
pub fn trials(study: &mut Study, table: &mut Table, site: Site) -> Result<Vec<(Trial, Arc<Flights>)>, ReproductionError> {
    let settings = figures::benchmark(&study.settings);
    let oblique = study.trial(site, FIVE_CAMERAS, Method::Oblique, settings);
    let settings = figures::with_room_above(study, table, &oblique)?;
    let mut flown = Vec::new();
    for method in METHODS {
        let rig = if method == Method::Oblique { FIVE_CAMERAS } else { ONE_CAMERA };
        let trial = study.trial(site, rig, method, settings.clone());
        let flights = study.flights(&trial)?;
        if figures::is_flown(table, &trial, &flights) {
            flown.push((trial, flights));
        }
    }
    Ok(flown)
}

fn add_scene(study: &mut Study, table: &mut Table, site: Site) -> Result<(), ReproductionError> {
    let flown = trials(study, table, site)?;
    let mut qualities: Vec<Arc<Vec<Quality>>> = Vec::new();
    for (trial, _) in &flown {
        qualities.push(study.qualities(trial)?);
    }
    let compared = compared(&qualities);
    for (index, (trial, flights)) in flown.iter().enumerate() {
        let mut cells = figures::reconstruction(flights, &qualities[index]);
        let of_method: Vec<Compared> = compared.iter().map(|of_seed| of_seed[index]).collect();
        cells.extend(figures::common(&of_method));
        cells.push(figures::coverage(flights));
        table.ours(&[site.name(), figures::label(trial.method)], cells);
    }
    Ok(())
}

/// For each seed, all methods on the samples that they have in common.
fn compared(qualities: &[Arc<Vec<Quality>>]) -> Vec<Vec<Compared>> {
    let seeds = qualities.iter().map(|of_method| of_method.len()).max().unwrap_or(0);
    // A method without chance has one flight for all seeds.
    let of_seed = |seed: usize| {
        let qualities: Option<Vec<&Quality>> =
            qualities.iter().map(|of_method| of_method.get(seed).or(of_method.last())).collect();
        compare(&qualities?)
    };
    (0..seeds).filter_map(of_seed).collect()
}
