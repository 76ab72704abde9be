//! What a flight costs and what it gives: profile time against predicted Completeness, by all methods.

use super::ReproductionError;
use super::chart::{self, Drawing, Panel, Series};
use super::figures::{self, FIVE_CAMERAS, ONE_CAMERA};
use super::matched::completeness_percent;
use super::site::Site;
use super::study::{Study, Trial};
use super::table::{Cell, Table};
use crate::planner::Method;
use crate::quality::Which;

const SITES: [Site; 2] = [Site::Ny1, Site::Delfshaven];

/// Goals G of the methods that have one, percent.
const GOALS_PERCENT: [f64; 4] = [70.0, 80.0, 90.0, 95.0];

/// The lines of a panel, in the order of the legend.
const LINES: [(&str, Method); 5] = [
    ("refined, one camera", Method::Refined),
    ("paper, one camera", Method::Paper),
    ("Zhou, one camera", Method::Zhou),
    ("Smith, one camera", Method::Smith),
    ("OP, five cameras", Method::Oblique),
];

/// The paper's search is given so many times its iterations, to get nearer to the higher goals.
const MORE_ITERATIONS: u32 = 4;

const COLUMNS: [&str; 7] =
    ["Scene", "Method", "Rig", "Goal G [%]", "Profile time [s]", "Completeness 0.050 m [%]", "Coverage of capturable [%]"];

pub fn figure(study: &mut Study) -> Result<(Table, Drawing), ReproductionError> {
    let mut table = Table::new("pareto", "Time against Completeness, seed 1", &COLUMNS);
    let mut panels = Vec::new();
    for site in SITES {
        if !figures::is_there(study, &mut table, site) {
            continue;
        }
        let mut series = Vec::new();
        for (name, method) in LINES {
            series.push(Series { name: name.to_owned(), points: points(study, &mut table, site, method)? });
        }
        panels.push(Panel { title: format!("{}: Completeness within 0.05 m [%]", site.name()), series });
    }
    table.note(format!(
        "One flight each, of seed 1. The refinement ({} rounds) and the paper's search (K = {}) are given goals of {GOALS_PERCENT:?} %; a search that does not \
         reach its goal ends after its last iteration. The others have no goal, and OP, with five cameras, is there for reference.",
        study.settings.refine.rounds,
        study.settings.search.iterations.saturating_mul(MORE_ITERATIONS)
    ));
    table.note("Completeness is predicted from all images of a flight. Drawn in pareto.svg: up and to the left is better.");
    let svg = chart::scatter("Profile time against predicted Completeness", "profile time [s]", &panels);
    Ok((table, Drawing { file: "pareto.svg".to_owned(), svg }))
}

/// Time and Completeness of the flights of one method.
fn points(study: &mut Study, table: &mut Table, site: Site, method: Method) -> Result<Vec<[f64; 2]>, ReproductionError> {
    let rig = if method == Method::Oblique { FIVE_CAMERAS } else { ONE_CAMERA };
    let has_goal = matches!(method, Method::Refined | Method::Paper);
    let goals: &[f64] = if has_goal { &GOALS_PERCENT } else { &GOALS_PERCENT[3..] };
    let mut points = Vec::new();
    for &goal_percent in goals {
        let mut settings = figures::benchmark(&study.settings);
        settings.coverage.goal_percent = goal_percent;
        if method == Method::Paper {
            settings.search.iterations = settings.search.iterations.saturating_mul(MORE_ITERATIONS);
        }
        let trial = Trial { seeds: 1, ..study.trial(site, rig, method, settings) };
        let flights = study.flights(&trial)?;
        let Some(plan) = flights.plans.first().filter(|_| figures::is_flown(table, &trial, &flights)) else { continue };
        let truth = study.truth(site)?;
        let point = [plan.metrics.profile_s, completeness_percent(&study.assess(&truth, plan, Which::All)?)];
        points.push(point);
        let goal = if has_goal { Cell::number(goal_percent, 0) } else { Cell::Missing };
        let coverage = Cell::number(plan.metrics.coverage_percent, 1);
        let figures = vec![goal, Cell::number(point[0], 0), Cell::number(point[1], 2), coverage];
        table.ours(&[site.name(), method.name(), rig], figures);
    }
    Ok(points)
}
