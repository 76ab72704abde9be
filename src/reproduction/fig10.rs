//! Fig. 10: what the paths of several methods take to fly.

use super::ReproductionError;
use super::chart::{self, BarPanel, Drawing};
use super::figures::{self, of_plans};
use super::paper;
use super::study::{Flights, Study};
use super::table::{Cell, Table};
use super::table3;

/// The measures, with their columns.
const COLUMNS: [&str; 6] = ["Scene", "Method", "#Waypoints", "Turning [s]", "Movement [s]", "Profile time [s]"];

/// Methods in the order of the paper's tables.
const METHODS: [&str; 4] = ["Smith", "Zhou", "OP", "Ours"];

pub fn figure(study: &mut Study) -> Result<(Table, Drawing), ReproductionError> {
    let mut table = Table::new("fig10", "Fig. 10. Paths of several methods", &COLUMNS);
    let [_, waypoints, whole_s, turning_s] = paper::TABLE1[3].1;
    table.paper(&["NY-1", "Ours"], &[(waypoints, 0), (turning_s, 0), (whole_s - turning_s, 0)]);
    let mut groups: Vec<(String, Vec<Vec<Cell>>)> = Vec::new();
    for (_, site) in table3::SCENES {
        if !figures::is_there(study, &mut table, site) {
            continue;
        }
        let flown = table3::trials(study, &mut table, site)?;
        let mut bars = vec![Vec::new(); METHODS.len()];
        for (trial, flights) in &flown {
            let label = figures::label(trial.method);
            let cells = cells(flights);
            table.ours(&[site.name(), label], cells.clone());
            if let Some(place) = METHODS.iter().position(|method| *method == label) {
                bars[place] = cells;
            }
        }
        groups.push((site.name().to_owned(), bars));
    }
    figures::note_settings(&mut table, &figures::benchmark(&study.settings), study.seeds);
    table.note(
        "The paper gives its Fig. 10 as a chart without figures; its row here is that of Table 1, movement less the turning in it. OP flies five \
         cameras and is there for reference.",
    );
    table.note("Drawn in fig10.svg.");
    let panels: Vec<BarPanel> = (0..4).map(|measure| panel(&groups, measure)).collect();
    let svg = chart::bars("Paths of several methods (medians)", &METHODS, &panels);
    Ok((table, Drawing { file: "fig10.svg".to_owned(), svg }))
}

fn cells(flights: &Flights) -> Vec<Cell> {
    vec![
        of_plans(flights, 0, |plan| plan.waypoints.len() as f64),
        of_plans(flights, 0, |plan| plan.metrics.turning_s),
        of_plans(flights, 0, |plan| plan.metrics.movement_s),
        of_plans(flights, 0, |plan| plan.metrics.profile_s),
    ]
}

fn panel(groups: &[(String, Vec<Vec<Cell>>)], measure: usize) -> BarPanel {
    let bars = |bars: &Vec<Vec<Cell>>| bars.iter().map(|cells| cells.get(measure).and_then(Cell::value)).collect();
    let groups = groups.iter().map(|(name, methods)| (name.clone(), bars(methods))).collect();
    BarPanel { title: COLUMNS[2 + measure].to_owned(), groups }
}
