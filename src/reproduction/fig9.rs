//! Fig. 9: quality against the number of images that the reconstruction uses.

use super::ReproductionError;
use super::chart::{self, Drawing, Panel, Series};
use super::figures::{self, FIVE_CAMERAS, spread};
use super::site::Site;
use super::study::Study;
use super::table::{Cell, Table};
use crate::camera::Rig;
use crate::planner::Method;
use crate::quality::{Summary, Which};
use crate::search::Problem;
use crate::trajectory::evaluate::sightings;
use crate::trajectory::plan::Plan;
use crate::trajectory::select::ranking;

/// How many images are taken, as shares of those of the post-selection, percent; all images stand behind them.
const SHARES_PERCENT: [f64; 8] = [10.0, 25.0, 50.0, 75.0, 100.0, 150.0, 200.0, 400.0];

pub fn figure(study: &mut Study) -> Result<(Table, Drawing), ReproductionError> {
    let columns = [
        "Images, as a share of the selection [%]",
        "Num. images",
        "Error 90 % ↓ [m]",
        "Error 95 % ↓ [m]",
        "Completeness 0.020 m ↑ [%]",
        "Completeness 0.050 m ↑ [%]",
        "Completeness 0.075 m ↑ [%]",
    ];
    let mut table =
        Table::new("fig9", "Fig. 9. Quality against the number of images (block of NY-1's size, five cameras)", &columns);
    let settings = figures::benchmark(&study.settings);
    let by_share = summaries(study)?;
    for (label, summaries) in &by_share {
        table.ours(&[label], cells(summaries));
    }
    figures::note_settings(&mut table, &settings, study.seeds);
    figures::note_quality(&mut table, &settings);
    table.note(
        "Images are taken in the order in which the post-selection takes them (section 5.3): always the one of the largest gain.",
    );
    table.note(
        "The paper gives its Fig. 9 as a chart without figures: completeness rises with the number of images; error falls at first, then rises \
         when there are too many.",
    );
    table.note("Drawn in fig9.svg.");
    let svg = chart::lines("Quality against the number of images (medians)", "images", &panels(&table));
    Ok((table, Drawing { file: "fig9.svg".to_owned(), svg }))
}

/// What each share of the images makes of the truth, flight by flight.
fn summaries(study: &mut Study) -> Result<Vec<(String, Vec<Summary>)>, ReproductionError> {
    let trial = study.trial(Site::Ny1, FIVE_CAMERAS, Method::Paper, figures::benchmark(&study.settings));
    let (flights, truth) = (study.flights(&trial)?, study.truth(trial.site)?);
    let snapshot = study.snapshot(&trial, 1)?;
    let problem = Problem::new(&snapshot, &trial.settings, Rig::preset(trial.rig)?);
    let labels = SHARES_PERCENT.iter().map(|share| format!("{share:.0}")).chain(["all images".to_owned()]);
    let mut found: Vec<(String, Vec<Summary>)> = labels.map(|label| (label, Vec::new())).collect();
    for (number, plan) in flights.plans.iter().enumerate() {
        study.step(&format!("fewer and more images of flight {} of {}", number + 1, flights.plans.len()))?;
        let seen = sightings(&snapshot, &snapshot.disks, &plan.images, study.stop()).ok_or(ReproductionError::Stopped)?;
        let order = ranking(&problem, &seen, plan.images.len());
        for (count, (_, summaries)) in counts(plan).into_iter().zip(&mut found) {
            let part = with_images(plan, &order[..count]);
            summaries.push(study.assess(&truth, &part, Which::Selected)?.summary());
        }
    }
    Ok(found)
}

/// Numbers of images, the last one being all of them.
fn counts(plan: &Plan) -> Vec<usize> {
    let (all, selected) = (plan.images.len(), plan.selected_images() as f64);
    let of_share = |share: &f64| ((selected * share / 100.0).round() as usize).min(all);
    SHARES_PERCENT.iter().map(of_share).chain([all]).collect()
}

fn with_images(plan: &Plan, selected: &[usize]) -> Plan {
    let mut plan = plan.clone();
    plan.images.iter_mut().for_each(|image| image.selected = false);
    selected.iter().for_each(|&image| plan.images[image].selected = true);
    plan
}

fn cells(summaries: &[Summary]) -> Vec<Cell> {
    let mut cells = vec![
        spread(summaries.iter().map(|summary| summary.images as f64), 0),
        spread(summaries.iter().map(|summary| summary.error_90_m.unwrap_or(f64::NAN)), 4),
        spread(summaries.iter().map(|summary| summary.error_95_m.unwrap_or(f64::NAN)), 4),
    ];
    cells.extend((0..3).map(|k| spread(summaries.iter().map(|summary| summary.completeness_percent[k]), 2)));
    cells
}

/// The table's medians over its number of images.
fn panels(table: &Table) -> Vec<Panel> {
    let series = |column: usize| {
        let points = table.rows.iter().filter_map(|row| Some([row.cells[1].value()?, row.cells[column].value()?]));
        Series { name: table.columns[column].to_owned(), points: points.collect() }
    };
    [4, 5, 6, 2, 3].map(|column| Panel { title: table.columns[column].to_owned(), series: vec![series(column)] }).to_vec()
}
