//! Flights at equal Completeness: ours ends as soon as it reconstructs no less than a flight of another method does.

use rayon::prelude::*;

use super::ReproductionError;
use super::figures::{self, FIVE_CAMERAS, ONE_CAMERA, spread};
use super::matched::{Grid, Matched, Rival, completeness_percent, match_completeness, match_goal};
use super::paper::{self, RealFlight};
use super::study::{Flights, Study, Trial};
use super::table::{Cell, Table};
use super::table3;
use crate::camera::Rig;
use crate::planner::{self, Method, PlanError, PlanOptions};
use crate::quality::{self, Compared, Quality, Which, compare};
use crate::settings::Settings;
use crate::trajectory::plan::Plan;

/// Whom our method is held against, with the rig that both fly.
const AGAINST: [(Method, &str); 3] = [(Method::Zhou, ONE_CAMERA), (Method::Smith, ONE_CAMERA), (Method::Oblique, FIVE_CAMERAS)];

/// Whom refined flights are held against, with the share of the other's time that they were to take at most and the one beyond the paper.
const REFINED_GOALS: [(Method, [f64; 2]); 2] = [(Method::Zhou, [0.6, 0.4]), (Method::Oblique, [0.8, 0.6])];

/// Few exposures of five cameras match nearly all samples; what lies between the samples is matched as well only where they are dense: over delfshaven flights
/// of 578 s reconstruct 95.83 % of the surface, and 95.54 % where 3000 samples are looked at (240 rounds).
const REFINED_SAMPLES: u32 = 10_000;

/// The figures that the paper has too stand first.
const COLUMNS: [&str; 22] = [
    "Scene",
    "Against",
    "Rig",
    "Ours by",
    "Their length [m]",
    "Our length ↓ [m]",
    "Their profile time [s]",
    "Our profile time ↓ [s]",
    "Our time over theirs ↓",
    "Their waypoints",
    "Our waypoints ↓",
    "Their Completeness 0.050 m [%]",
    "Our Completeness 0.050 m [%]",
    "... from post-selected images [%]",
    "Their error 95 % on common samples [m]",
    "Our error 95 % on common samples ↓ [m]",
    "Common samples [%]",
    "Their images",
    "Our images",
    "Our iterations K or rounds",
    "Our goal [%]",
    "Seeds that reach it",
];

/// Flights of the paper's method, with the rows of its Tables 4 and 5.
pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let mut table = Table::new("equal", "At equal Completeness: our flights end when they reconstruct no less", &COLUMNS);
    add_paper(&mut table, ONE_CAMERA, &paper::TABLE4);
    add_paper(&mut table, FIVE_CAMERAS, &paper::TABLE5);
    add_pairs(study, &mut table, &AGAINST, Method::Paper)?;
    add_notes(study, &mut table, Method::Paper);
    Ok(table)
}

/// Refined flights, which take hours with five cameras.
pub fn refined_table(study: &mut Study) -> Result<Table, ReproductionError> {
    let mut table = Table::new("equal-refined", "At equal Completeness: refined flights that reconstruct no less", &COLUMNS);
    let has_goal = |(method, _): &(Method, &str)| REFINED_GOALS.iter().any(|(rival, _)| rival == method);
    let against: Vec<_> = AGAINST.into_iter().filter(has_goal).collect();
    add_pairs(study, &mut table, &against, Method::Refined)?;
    add_notes(study, &mut table, Method::Refined);
    Ok(table)
}

/// A row for each flight that ours are held against, over every scene.
fn add_pairs(
    study: &mut Study,
    table: &mut Table,
    against: &[(Method, &'static str)],
    ours: Method,
) -> Result<(), ReproductionError> {
    for (_, site) in table3::SCENES {
        if !figures::is_there(study, table, site) {
            continue;
        }
        let oblique = study.trial(site, FIVE_CAMERAS, Method::Oblique, figures::benchmark(&study.settings));
        let settings = figures::with_room_above(study, table, &oblique)?;
        for &(method, rig) in against {
            let theirs = study.trial(site, rig, method, settings.clone());
            add_pair(study, table, &theirs, ours)?;
        }
    }
    Ok(())
}

/// Rows come in pairs: the other method, then the paper's own.
fn add_paper(table: &mut Table, rig: &str, rows: &[RealFlight]) {
    for pair in rows.chunks_exact(2) {
        let ((scene, against, theirs), (_, _, ours)) = (pair[0], pair[1]);
        let [seconds_theirs, seconds_ours] = [theirs, ours].map(|figures| figures[1] * 60.0);
        let times = [(seconds_theirs, 0), (seconds_ours, 0), (seconds_ours / seconds_theirs, 2)];
        table.paper(&[scene, against, rig, "paper"], &[&[(theirs[0], 0), (ours[0], 0)], &times[..]].concat());
    }
}

/// One seed of ours beside the flight that it is held against.
struct Pair<'a> {
    theirs: (&'a Plan, &'a Quality),
    ours: Matched,
    compared: Vec<Compared>,
    selected_percent: f64,
}

fn add_pair(study: &mut Study, table: &mut Table, theirs: &Trial, method: Method) -> Result<(), ReproductionError> {
    let flights = study.flights(theirs)?;
    if !figures::is_flown(table, theirs, &flights) {
        return Ok(());
    }
    let qualities = study.qualities(theirs)?;
    let found = pairs(study, theirs, method, &flights, &qualities)?;
    match found.into_iter().collect::<Result<Vec<Pair>, PlanError>>() {
        Ok(pairs) => {
            add_row(table, theirs, method, &pairs);
            study.keep(table);
        }
        Err(error) => table.note(format!("No flight of ours over {}: {error}.", theirs.site.name())),
    }
    Ok(())
}

/// A pair for each seed, made side by side.
fn pairs<'a>(
    study: &mut Study,
    theirs: &Trial,
    method: Method,
    flights: &'a Flights,
    qualities: &'a [Quality],
) -> Result<Vec<Result<Pair<'a>, PlanError>>, ReproductionError> {
    let label = figures::label(theirs.method);
    study.step(&format!(
        "{}: flights of {} that reconstruct no less than {label} with {}",
        theirs.site.name(),
        method.name(),
        theirs.rig
    ))?;
    // The very cameras that they fly: oblique photography has lenses of its own.
    let rig = planner::flown_rig(&PlanOptions::new(Rig::preset(theirs.rig)?, theirs.method, 1), &theirs.settings);
    let mut ours = Trial { method, ..theirs.clone() };
    if method == Method::Refined && rig.camera_count() > 1 {
        ours.settings.surface.samples = ours.settings.surface.samples.max(REFINED_SAMPLES);
    }
    let (snapshot, truth) = (study.snapshot(&ours, 1)?, study.truth(ours.site)?);
    let assessing = &study.settings.clone().with_sight(rig.sight_scale());
    let stop = study.stop();
    let rival = Rival { snapshot: &snapshot, settings: &ours.settings, rig: &rig, truth: &truth, assessing };
    let grid = Grid::of(&ours.settings);
    let pair = |seed: u32| {
        // A method without chance has one flight for all seeds.
        let index = (seed as usize - 1).min(flights.plans.len() - 1);
        let theirs = (&flights.plans[index], &qualities[index]);
        let ours = match method {
            Method::Refined => match_goal(&rival, rounds(&ours.settings, &rig), seed.into(), theirs.1, stop)?,
            _ => match_completeness(&rival, grid, seed.into(), theirs.1, stop)?,
        };
        let selected = quality::shots(&ours.plan, Which::Selected);
        let selected = quality::assess(&truth, &selected, assessing, stop).ok_or(PlanError::Abandoned)?;
        let compared = compare(&[theirs.1, &ours.quality]).unwrap_or_default();
        Ok(Pair { theirs, ours, compared, selected_percent: completeness_percent(&selected) })
    };
    let found: Vec<Result<Pair, PlanError>> = (1..=study.seeds).into_par_iter().map(pair).collect();
    if stop.is_stopped() { Err(ReproductionError::Stopped) } else { Ok(found) }
}

/// Rounds of a refined flight: with several cameras a round takes longer.
fn rounds(settings: &Settings, rig: &Rig) -> u32 {
    if rig.camera_count() > 1 { settings.refine.rounds / 2 } else { settings.refine.rounds }
}

fn add_row(table: &mut Table, theirs: &Trial, method: Method, pairs: &[Pair]) {
    let (scene, label) = (theirs.site.name(), figures::label(theirs.method));
    for pair in pairs.iter().filter(|pair| !pair.ours.is_reached) {
        let Matched { iterations, plan, quality, .. } = &pair.ours;
        table.note(format!(
            "Not reached over {scene} against {label} with seed {}: after {iterations} iterations ours by {} has {:.2} % of their {:.2} %, on {:.0} m in {:.0} s.",
            plan.seed,
            plan.method,
            completeness_percent(quality),
            completeness_percent(pair.theirs.1),
            plan.metrics.length_m,
            plan.metrics.profile_s
        ));
    }
    let is_poor = |pair: &Pair| completeness_percent(pair.theirs.1) < table3::LEAST_COMMON_PERCENT;
    if pairs.iter().any(is_poor) {
        table.note(format!(
            "{label} over {scene} reconstructs less than {} %: no lower Completeness is next to nothing there, and the ratio of times says nothing \
             about flights for a reconstruction.",
            table3::LEAST_COMMON_PERCENT
        ));
    }
    let reached = match method {
        Method::Refined => String::new(),
        _ => format!(" by K = {}", Grid::of(&theirs.settings).most()),
    };
    let cells = cells(pairs, &reached);
    if let (Method::Refined, Some(ratio)) = (method, cells[RATIO].value()) {
        note_goals(table, theirs, ratio);
    }
    table.ours(&[scene, label, theirs.rig, method.name()], cells);
}

/// Place of the ratio behind the labels.
const RATIO: usize = 4;

/// Says what was to be reached.
fn note_goals(table: &mut Table, theirs: &Trial, ratio: f64) {
    let Some((method, [goal, beyond])) = REFINED_GOALS.iter().find(|(method, _)| *method == theirs.method) else { return };
    let (scene, label) = (theirs.site.name(), figures::label(*method));
    let verdict = |goal: &f64| if ratio <= *goal { "reached" } else { "missed" };
    table.note(format!(
        "Refined against {label} over {scene}: {ratio:.2}; a ratio of {goal} was wanted ({}), and {beyond} beyond the paper ({}).",
        verdict(goal),
        verdict(beyond)
    ));
}

/// Their figures from all seeds, ours from those that reach the Completeness.
fn cells(pairs: &[Pair], reached_by: &str) -> Vec<Cell> {
    let reached: Vec<&Pair> = pairs.iter().filter(|pair| pair.ours.is_reached).collect();
    let their_plans = |decimals, figure: fn(&Plan) -> f64| spread(pairs.iter().map(|pair| figure(pair.theirs.0)), decimals);
    let our_plans = |decimals, figure: fn(&Plan) -> f64| spread(reached.iter().map(|pair| figure(&pair.ours.plan)), decimals);
    let of_reached = |decimals, figure: fn(&Pair) -> f64| spread(reached.iter().map(|pair| figure(pair)), decimals);
    vec![
        their_plans(0, |plan| plan.metrics.length_m),
        our_plans(0, |plan| plan.metrics.length_m),
        their_plans(0, |plan| plan.metrics.profile_s),
        our_plans(0, |plan| plan.metrics.profile_s),
        of_reached(2, |pair| pair.ours.plan.metrics.profile_s / pair.theirs.0.metrics.profile_s),
        their_plans(0, |plan| plan.waypoints.len() as f64),
        our_plans(0, |plan| plan.waypoints.len() as f64),
        spread(pairs.iter().map(|pair| completeness_percent(pair.theirs.1)), 2),
        of_reached(2, |pair| completeness_percent(&pair.ours.quality)),
        of_reached(2, |pair| pair.selected_percent),
        of_reached(3, |pair| error_95_m(pair, 0)),
        of_reached(3, |pair| error_95_m(pair, 1)),
        of_reached(1, |pair| pair.compared.first().map_or(f64::NAN, |compared| compared.common_percent)),
        their_plans(0, |plan| plan.images.len() as f64),
        our_plans(0, |plan| plan.images.len() as f64),
        of_reached(0, |pair| pair.ours.iterations.into()),
        our_plans(1, goal_percent),
        Cell::text(format!("{} of {}{reached_by}", reached.len(), pairs.len())),
    ]
}

/// What ended the flight: the goal G of the paper's method, that for matched views of a refined flight.
fn goal_percent(plan: &Plan) -> f64 {
    if plan.matched_goal_percent > 0.0 { plan.matched_goal_percent } else { plan.goal_percent }
}

/// Of theirs (0) or of ours (1).
fn error_95_m(pair: &Pair, which: usize) -> f64 {
    pair.compared.get(which).and_then(|compared| compared.error_95_m).unwrap_or(f64::NAN)
}

fn add_notes(study: &Study, table: &mut Table, ours: Method) {
    let settings = figures::benchmark(&study.settings);
    figures::note_settings(table, &settings, study.seeds);
    figures::note_quality_of(table, &settings, "all images");
    table.note(if ours == Method::Refined { goals(&settings) } else { iterations(Grid::of(&settings)) });
    table.note(
        "Completeness is that of all images of both flights, unlike in Table 3: the post-selection (section 5.3) is meant mainly for five \
         cameras and costs no flight time. What ours keeps of it stands beside.",
    );
    table.note("Their figures are of all seeds, ours, the ratio and what is common of the seeds that reach their Completeness.");
    table.note(format!("Both fly the same cameras: against OP, ours have its {} mm lenses too.", settings.baseline.op_focal_mm));
    table.note("There is no chance in OP: it has one flight, which is held beside each seed of ours.");
    if ours == Method::Paper {
        table.note("The paper's rows are those of its Tables 4 and 5: other scenes, real flights, and no equal Completeness.");
    }
    figures::note_range(table, &settings);
}

/// How long the paper's method searches here.
fn iterations(grid: Grid) -> String {
    format!(
        "Here G = 100 % for the paper's method, so that its goal never ends the search, and K is not that above: it is the first of {}, {}, ... {} at which \
         the flight has no lower predicted Completeness (0.050 m) than theirs, by doubling and halving. The step before K is not enough; Completeness \
         need not rise with every step, so that one farther below may be. Nothing is tried below K = {}.",
        grid.step,
        2 * grid.step,
        grid.most(),
        grid.step
    )
}

/// What refined flights are asked for here.
fn goals(settings: &Settings) -> String {
    format!(
        "Refined flights are asked for no covered hemisphere here (G = 0), but for a share of the samples in at least {} views that match: of four such \
         shares, each nearer to their Completeness than the one before, the flight of the lowest time that is enough; {} rounds with one camera, {} with \
         five and N = {REFINED_SAMPLES}.",
        settings.quality.least_views,
        settings.refine.rounds,
        settings.refine.rounds / 2
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_s_ratios_are_those_of_its_flight_times() {
        let mut table = Table::new("equal", "", &COLUMNS);
        add_paper(&mut table, ONE_CAMERA, &paper::TABLE4);
        add_paper(&mut table, FIVE_CAMERAS, &paper::TABLE5);
        let ratios: Vec<f64> = table.rows.iter().map(|row| row.cells[8].value().unwrap()).collect();
        // 13.7/41.0, 15.5/28.1, 22/34, 42/51.
        let expected = [0.334_146, 0.551_601, 0.647_059, 0.823_529];
        assert_eq!(ratios.len(), expected.len());
        assert!(ratios.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6), "{ratios:?}");
        assert_eq!(table.rows[0].cells[4..8].iter().filter_map(Cell::value).collect::<Vec<_>>(), [7233.0, 4137.0, 2460.0, 822.0]);
    }
}
