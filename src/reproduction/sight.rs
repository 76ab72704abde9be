//! How far cameras see: the paper gives neither the size of its coverage disks nor the distance at which a view counts no more.

use super::ReproductionError;
use super::figures::{self, ONE_CAMERA, of_plans, spread};
use super::paper;
use super::site::Site;
use super::study::{Flights, Study, Trial};
use super::table::{Cell, Row, Source, Table};
use super::table1::{self, REFINED_MOST_M, REFINED_SEEDS};
use crate::camera::Rig;
use crate::planner::Method;
use crate::quality::{self, COMPLETENESS_M, Quality, Which};
use crate::search::StopReason;
use crate::settings::Settings;
use crate::trajectory::plan::Plan;

/// Sights that are tried, as multiples of the distances in the settings; the first is theirs, the last the farthest.
const SCALES: [f64; 3] = [1.0, 1.5, 2.0];

const THETA0_DEG: [f64; 2] = [25.0, 28.0];

const METHODS: [Method; 2] = [Method::Paper, Method::Refined];

const SITES: [Site; 2] = [Site::Ny1, Site::Delfshaven];

const COLUMNS: [&str; 16] = [
    "Scene",
    "Range [m]",
    "Full disk up to [m]",
    "Ground sampling distance at the range [cm]",
    "theta0 [deg]",
    "Method",
    "Coverage of capturable [%]",
    "Capturable [%]",
    "Length ↓ [m]",
    "Profile time [s]",
    "#Waypoints ↓",
    "Images",
    "Completeness 0.020 m ↑ [%]",
    "Completeness 0.050 m ↑ [%]",
    "Iterations or rounds",
    "Flights at the goal",
];

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let mut table = Table::new("sight", "How far cameras see (one camera)", &COLUMNS);
    add_paper(&mut table);
    let mut outcomes = Vec::new();
    for site in SITES {
        if figures::is_there(study, &mut table, site) {
            add_site(study, &mut table, site, &mut outcomes)?;
        }
    }
    add_notes(study, &mut table);
    let goal_percent = figures::benchmark(&study.settings).coverage.goal_percent;
    searches(&outcomes, study.settings.search.iterations, goal_percent).into_iter().for_each(|note| table.note(note));
    table.note(short_refined(&outcomes, goal_percent));
    Ok(table)
}

/// The paper's full objective on NY-1.
fn add_paper(table: &mut Table) {
    let [length_m, waypoints, ..] = paper::TABLE1[3].1;
    let [_, goal_percent] = paper::BENCHMARK_PERCENT;
    let mut cells = vec![Cell::Missing; COLUMNS.len()];
    (cells[0], cells[5]) = (Cell::text("NY-1"), Cell::text("Ours"));
    (cells[6], cells[8], cells[10]) = (Cell::number(goal_percent, 0), Cell::number(length_m, 0), Cell::number(waypoints, 0));
    table.rows.push(Row { source: Source::Paper, cells });
}

/// What the notes say of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Outcome {
    site: Site,
    range_m: f64,
    theta0_deg: f64,
    method: Method,
    flights: usize,
    /// Searches that their goal has ended.
    ended: usize,
    /// Finished flights with as much coverage as the goal.
    at_goal: usize,
    /// Median.
    length_m: Option<f64>,
}

impl Outcome {
    fn of(trial: &Trial, flights: &Flights) -> Self {
        let coverage = &trial.settings.coverage;
        let count = |is: fn(&Plan, f64) -> bool| flights.plans.iter().filter(|plan| is(plan, coverage.goal_percent)).count();
        Self {
            site: trial.site,
            range_m: coverage.range_m,
            theta0_deg: coverage.theta0_deg,
            method: trial.method,
            flights: flights.plans.len(),
            ended: count(|plan, _| plan.stop == StopReason::GoalReached),
            at_goal: count(|plan, goal_percent| plan.metrics.coverage_percent >= goal_percent),
            length_m: figures::length(flights).value(),
        }
    }
}

fn add_site(study: &mut Study, table: &mut Table, site: Site, outcomes: &mut Vec<Outcome>) -> Result<(), ReproductionError> {
    let base = study.trial(site, ONE_CAMERA, Method::Paper, figures::benchmark(&study.settings));
    let lattice_m = study.snapshot(&base, 1)?.field().facts.lattice_spacing_m;
    let assessing = farther(&base.settings, SCALES[SCALES.len() - 1]);
    let mut viewpoints = Vec::new();
    for scale in SCALES {
        let seeing = if scale > 1.0 { as_dense(farther(&base.settings, scale), lattice_m) } else { base.settings.clone() };
        for theta0_deg in THETA0_DEG {
            for method in METHODS {
                let trial = with(&base, &seeing, theta0_deg, method, study.seeds.min(REFINED_SEEDS));
                add_row(study, table, &trial, &assessing, outcomes)?;
            }
        }
        let counted = study.snapshot(&with(&base, &seeing, THETA0_DEG[0], METHODS[0], 1), 1)?;
        viewpoints.push(counted.field().viewpoints.len().to_string());
    }
    table.note(format!(
        "The lattice of the field stays as dense as it is at the least range, so that visibility is as exact: {lattice_m:.1} m over {}, which takes {} viewpoints.",
        site.name(),
        viewpoints.join(", ")
    ));
    Ok(())
}

/// The settings with `scale` times the distances of the coverage model and of the shell of viewpoints. What they say of the rig stays as it
/// is: the rig is the same one, so that nothing may scale the distances back.
fn farther(settings: &Settings, scale: f64) -> Settings {
    let own = settings.coverage.sight_scale;
    let mut settings = settings.clone().with_sight(own * scale);
    settings.coverage.sight_scale = own;
    settings
}

/// The settings with a lattice of viewpoints no coarser than `lattice_m`. More of them than the target fill a thicker shell, so that it is
/// no finer either.
fn as_dense(mut settings: Settings, lattice_m: f64) -> Settings {
    settings.field.max_spacing_m = lattice_m;
    settings
}

/// The trial of a row. On the block refined flights have as many rounds as in Table 1.
fn with(base: &Trial, seeing: &Settings, theta0_deg: f64, method: Method, seeds: u32) -> Trial {
    let is_longer = method == Method::Refined && base.site == Site::Ny1;
    let mut settings = if is_longer { table1::with_rounds(seeing) } else { seeing.clone() };
    settings.coverage.theta0_deg = theta0_deg;
    Trial { method, settings, seeds, ..base.clone() }
}

fn add_row(
    study: &mut Study,
    table: &mut Table,
    trial: &Trial,
    assessing: &Settings,
    outcomes: &mut Vec<Outcome>,
) -> Result<(), ReproductionError> {
    let coverage = &trial.settings.coverage;
    study.step(&format!("{}: a sight of {} m, theta0 = {}", trial.site.name(), coverage.range_m, coverage.theta0_deg))?;
    let flights = study.flights(trial)?;
    if !figures::is_flown(table, trial, &flights) {
        return Ok(());
    }
    let qualities = qualities(study, trial, &flights, assessing)?;
    let outcome = Outcome::of(trial, &flights);
    let gsd_m = coverage.range_m * Rig::preset(trial.rig)?.coarsest_pixel_rad();
    let completeness = |within_m: f64| spread(qualities.iter().map(|quality| quality.completeness_percent(within_m)), 2);
    let cells = vec![
        Cell::number(coverage.range_m, 0),
        Cell::number(coverage.full_disk_m, 0),
        Cell::number(gsd_m * 100.0, 1),
        Cell::number(coverage.theta0_deg, 0),
        Cell::text(figures::label(trial.method)),
        figures::coverage(&flights),
        of_plans(&flights, 1, |plan| plan.metrics.capturable_percent),
        figures::length(&flights),
        of_plans(&flights, 0, |plan| plan.metrics.profile_s),
        of_plans(&flights, 0, |plan| plan.waypoints.len() as f64),
        of_plans(&flights, 0, |plan| plan.images.len() as f64),
        completeness(COMPLETENESS_M[0]),
        completeness(COMPLETENESS_M[1]),
        of_plans(&flights, 0, |plan| plan.convergence.len() as f64),
        Cell::text(format!("{} of {}", outcome.at_goal, outcome.flights)),
    ];
    table.ours(&[trial.site.name()], cells);
    outcomes.push(outcome);
    Ok(())
}

/// What all images of the flights make of the true scene, by settings that are the same for every row.
fn qualities(
    study: &mut Study,
    trial: &Trial,
    flights: &Flights,
    assessing: &Settings,
) -> Result<Vec<Quality>, ReproductionError> {
    let truth = study.truth(trial.site)?;
    let stop = study.stop();
    let assess = |plan| quality::assess(&truth, &quality::shots(plan, Which::All), assessing, stop);
    flights.plans.iter().map(|plan| assess(plan).ok_or(ReproductionError::Stopped)).collect()
}

/// One note for each scene and theta0: at which sights the goal ends the paper's search, and from which one on.
fn searches(outcomes: &[Outcome], iterations: u32, goal_percent: f64) -> Vec<String> {
    let mut notes = Vec::new();
    for site in SITES {
        for theta0_deg in THETA0_DEG {
            let is_it = |one: &&Outcome| (one.site, one.theta0_deg, one.method) == (site, theta0_deg, Method::Paper);
            let of_site: Vec<&Outcome> = outcomes.iter().filter(is_it).collect();
            if of_site.is_empty() {
                continue;
            }
            let counts: Vec<String> =
                of_site.iter().map(|one| format!("{} of {} at {} m", one.ended, one.flights, one.range_m)).collect();
            let least = match least_reaching(&of_site) {
                Some(one) => format!(
                    "from {} m on most do, there with a median length of {:.0} m",
                    one.range_m,
                    one.length_m.unwrap_or(f64::NAN)
                ),
                None => "at no sight do most".to_owned(),
            };
            notes.push(format!(
                "Searches of the paper's method over {}, theta0 = {theta0_deg}, that reach {goal_percent} % within K = {iterations}: {}; {least}.",
                site.name(),
                counts.join(", ")
            ));
        }
    }
    notes
}

/// The least sight from which on more than half of the searches reach their goal; the outcomes are in the order of their sights.
fn least_reaching<'a>(outcomes: &[&'a Outcome]) -> Option<&'a Outcome> {
    outcomes.iter().rev().take_while(|one| 2 * one.ended > one.flights).last().copied()
}

/// Which refined rows are as short as the refined flight was to be.
fn short_refined(outcomes: &[Outcome], goal_percent: f64) -> String {
    let is_short = |one: &&Outcome| {
        let is_at_goal = 2 * one.at_goal > one.flights;
        one.method == Method::Refined && is_at_goal && one.length_m.is_some_and(|length_m| length_m <= REFINED_MOST_M)
    };
    let name = |one: &Outcome| {
        let length_m = one.length_m.unwrap_or(f64::NAN);
        format!("{} at {} m with theta0 = {} ({length_m:.0} m)", one.site.name(), one.range_m, one.theta0_deg)
    };
    let short: Vec<String> = outcomes.iter().filter(is_short).map(name).collect();
    let short = if short.is_empty() { "none".to_owned() } else { short.join(", ") };
    format!("Refined rows of at most {REFINED_MOST_M:.0} m (median) with most flights at the goal of {goal_percent} %: {short}.")
}

fn add_notes(study: &Study, table: &mut Table) {
    let settings = figures::benchmark(&study.settings);
    let farthest = farther(&settings, SCALES[SCALES.len() - 1]);
    figures::note_settings(table, &settings, study.seeds.min(REFINED_SEEDS));
    table.note(format!(
        "theta0 is that of the row, and M grows with the shell. `coverage.full_disk_m`, `coverage.range_m`, `coverage.falloff_m` and `field.shell_m` grow in \
         proportion: from {}, {}, {} and {} m to {}, {}, {} and {} m.",
        settings.coverage.full_disk_m,
        settings.coverage.range_m,
        settings.coverage.falloff_m,
        settings.field.shell_m,
        farthest.coverage.full_disk_m,
        farthest.coverage.range_m,
        farthest.coverage.falloff_m,
        farthest.field.shell_m
    ));
    table.note(format!(
        "Completeness counts images up to {} m in every row, also where the flight was planned for a shorter sight, so that rows can be compared; in the other \
         tables it ends at the range of the settings.",
        farthest.coverage.range_m
    ));
    figures::note_quality_of(table, &settings, "all images");
    table.note(
        "What can be captured at all depends on sight and theta0: coverages of different rows are shares of different samples. A flight is at the goal when its \
         exposed images have as much coverage by exact rays; a search ends by the coverage of its path, before corners are rounded.",
    );
    table.note(format!(
        "The coverage in the paper's row is the goal that ends its search; the paper prints neither the coverage that its flight has nor the iterations it took, \
         only that they are at most {}.",
        paper::MOST_ITERATIONS
    ));
    let rounds = settings.refine.rounds;
    table.note(format!(
        "Refined flights have {} rounds on the block, as in Table 1, and {rounds} elsewhere.",
        rounds.saturating_mul(2)
    ));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::StopToken;
    use crate::reproduction::site::quick_block;
    use crate::reproduction::study::build_field;
    use crate::scene::generate_block;

    #[test]
    fn all_distances_grow_in_proportion_and_the_rig_stays_the_same() {
        let settings = Settings::default();
        assert_eq!(farther(&settings, 1.0), settings);
        let twice = farther(&settings, 2.0);
        let distances_m = |s: &Settings| [s.coverage.range_m, s.coverage.full_disk_m, s.coverage.falloff_m, s.field.shell_m];
        assert_eq!(distances_m(&twice), distances_m(&settings).map(|distance_m| 2.0 * distance_m));
        // Adapting them to the rig of the rows changes nothing more.
        let rig = Rig::preset(ONE_CAMERA).unwrap();
        assert_eq!(twice.clone().with_sight(rig.sight_scale()), twice);
    }

    #[test]
    fn a_thicker_shell_has_more_viewpoints_and_not_wider_spaced_ones() {
        let mut settings = Settings::default();
        (settings.surface.samples, settings.field.viewpoints) = (150, 1000);
        let field = |settings: &Settings| {
            let snapshot = build_field(generate_block(&quick_block()), settings, &StopToken::default()).unwrap();
            (snapshot.field().facts.lattice_spacing_m, snapshot.field().viewpoints.len())
        };
        let (lattice_m, viewpoints) = field(&settings);
        assert!(lattice_m < settings.field.max_spacing_m, "the target decides");
        let (without_m, _) = field(&farther(&settings, 2.0));
        assert!(without_m > lattice_m, "with the same target a thicker shell has a coarser lattice");
        let (thicker_m, more) = field(&as_dense(farther(&settings, 2.0), lattice_m));
        assert_eq!(thicker_m, lattice_m);
        assert!(more > viewpoints, "{more} against {viewpoints}");
    }

    fn outcome(range_m: f64, method: Method, reached: usize, length_m: f64) -> Outcome {
        let (site, theta0_deg) = (Site::Ny1, THETA0_DEG[0]);
        Outcome { site, range_m, theta0_deg, method, flights: 3, ended: reached, at_goal: reached, length_m: Some(length_m) }
    }

    #[test]
    fn the_sight_from_which_on_searches_reach_the_goal_is_the_least_after_which_most_do() {
        let least = |reached: [usize; 4]| {
            let outcomes: Vec<Outcome> =
                reached.iter().enumerate().map(|(k, &reached)| outcome(k as f64, Method::Paper, reached, 0.0)).collect();
            least_reaching(&outcomes.iter().collect::<Vec<_>>()).map(|one| one.range_m)
        };
        assert_eq!(least([0, 0, 0, 0]), None);
        assert_eq!(least([3, 3, 3, 1]), None);
        assert_eq!(least([0, 1, 2, 3]), Some(2.0));
        assert_eq!(least([2, 1, 2, 2]), Some(2.0));
        assert_eq!(least([3, 3, 3, 3]), Some(0.0));
    }

    #[test]
    fn notes_are_those_of_the_rows() {
        let outcomes = [
            outcome(80.0, Method::Paper, 0, 8800.0),
            outcome(80.0, Method::Refined, 3, 4700.0),
            outcome(160.0, Method::Paper, 2, 5000.0),
            outcome(160.0, Method::Refined, 1, 2000.0),
        ];
        let notes = searches(&outcomes, 400, 95.0);
        assert_eq!(notes.len(), 1, "one theta0 of one scene");
        assert!(notes[0].contains("0 of 3 at 80 m, 2 of 3 at 160 m; from 160 m on most do"), "{}", notes[0]);
        assert!(short_refined(&outcomes, 95.0).ends_with(": none."), "long, or short of the goal");
        let short = [outcome(120.0, Method::Refined, 2, REFINED_MOST_M), outcome(120.0, Method::Paper, 3, 2000.0)];
        let note = short_refined(&short, 95.0);
        assert!(note.ends_with(": block of NY-1's size at 120 m with theta0 = 25 (2700 m)."), "{note}");
    }
}
