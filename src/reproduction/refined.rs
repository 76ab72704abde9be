//! Refined flights beside those of the paper's own search, in the same time and at the same coverage. They are timed one after the other, so
//! that none waits for another; figures differ from machine to machine all the same.

use super::figures::{self, FIVE_CAMERAS, ONE_CAMERA, spread};
use super::site::Site;
use super::study::{Study, Trial};
use super::table::{Cell, Table};
use super::{Effort, ReproductionError};
use crate::camera::Rig;
use crate::field::Snapshot;
use crate::planner::{self, Method, PlanError, PlanOptions, StopToken};
use crate::quality::{COMPLETENESS_M, Compared, Which, compare};
use crate::search::Problem;
use crate::settings::MOST_ITERATIONS;
use crate::trajectory::plan::Plan;

const PANORAMIC: &str = "panoramic";

const SITES: [Site; 5] = [Site::Ny1, Site::Delfshaven, Site::Nihonbashi, Site::Manhattan, Site::Marunouchi];

/// A time for planning, and the flights that are planned in it.
struct Sitting {
    budget_s: f64,
    /// Rigs with the share of the paper's time that a refined flight was to take at most.
    rigs: [(&'static str, f64); 3],
}

/// A second is what a flight over an edited scene may take, ten are what a user waits for.
const SITTINGS: [Sitting; 2] = [
    Sitting { budget_s: 1.0, rigs: [(ONE_CAMERA, 0.55), (FIVE_CAMERAS, 0.6), (PANORAMIC, 0.40)] },
    Sitting { budget_s: 10.0, rigs: [(ONE_CAMERA, 0.45), (FIVE_CAMERAS, 0.5), (PANORAMIC, 0.33)] },
];

/// In a quick run times are so many times shorter.
const QUICK_SHARE: f64 = 0.05;

const COLUMNS: [&str; 20] = [
    "Scene",
    "Rig",
    "Given [s]",
    "Profile time, paper [s]",
    "Profile time, refined ↓ [s]",
    "Refined over paper ↓",
    "Goal",
    "Coverage of capturable, paper [%]",
    "Coverage of capturable, refined [%]",
    "Completeness 0.020 m, paper [%]",
    "Completeness 0.020 m, refined ↑ [%]",
    "Completeness 0.050 m, paper [%]",
    "Completeness 0.050 m, refined ↑ [%]",
    "Error 95 % on common samples, paper [m]",
    "Error 95 % on common samples, refined ↓ [m]",
    "Common samples [%]",
    "Planned in, paper [s]",
    "Planned in, refined [s]",
    "Iterations and rounds",
    "Seeds that reach both",
];

/// Place of the ratio behind the labels.
const RATIO: usize = 2;

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let mut table = Table::new("refined", "Refined against the paper's own search, in the same time", &COLUMNS);
    for sitting in &SITTINGS {
        for (rig, goal) in sitting.rigs {
            for site in SITES {
                if figures::is_there(study, &mut table, site) {
                    add_row(study, &mut table, sitting, rig, site, goal)?;
                }
            }
        }
    }
    add_notes(study, &mut table);
    Ok(table)
}

fn budget_s(study: &Study, sitting: &Sitting) -> f64 {
    let share = if study.effort == Effort::Quick { QUICK_SHARE } else { 1.0 };
    sitting.budget_s * share
}

/// Two flights of one seed.
struct Duel {
    plans: [Plan; 2],
    /// From the order to the checked plan, s.
    planned_s: [f64; 2],
    compared: Vec<Compared>,
}

impl Duel {
    fn ratio(&self) -> f64 {
        self.plans[1].metrics.profile_s / self.plans[0].metrics.profile_s
    }

    fn is_reached(&self) -> bool {
        let [paper, refined] = &self.plans;
        refined.metrics.coverage_percent >= paper.metrics.coverage_percent
            && refined.metrics.matched_percent >= paper.metrics.matched_percent
    }
}

fn add_row(
    study: &mut Study,
    table: &mut Table,
    sitting: &Sitting,
    rig: &'static str,
    site: Site,
    goal: f64,
) -> Result<(), ReproductionError> {
    let budget_s = budget_s(study, sitting);
    let trial = study.trial(site, rig, Method::Paper, figures::benchmark(&study.settings));
    let snapshot = study.snapshot(&trial, 1)?;
    let mut duels = Vec::new();
    for seed in 1..=u64::from(study.seeds) {
        study.step(&format!("{}: refined against paper in {budget_s} s with {rig}, seed {seed}", site.name()))?;
        match duel(study, &trial, &snapshot, budget_s, seed)? {
            Ok(duel) => duels.push(duel),
            Err(error) => {
                table.note(format!("No flight over {} with {rig}: {error}.", site.name()));
                return Ok(());
            }
        }
    }
    let cells = cells(&duels, goal);
    let missed = match cells[RATIO].value() {
        Some(ratio) if ratio <= goal => None,
        Some(ratio) => Some(format!("{ratio:.2}")),
        None => Some("no flight with as much coverage and matching".to_owned()),
    };
    if let Some(missed) = missed {
        table.note(format!("Missed: {missed} instead of {goal:.2} over {} with {rig} after {budget_s} s.", site.name()));
    }
    table.ours(&[site.name(), rig, &format!("{budget_s}")], cells);
    Ok(())
}

/// The paper's search until the time is over, then the refinement in as much time, with the coverage of the first as its goal.
fn duel(
    study: &mut Study,
    trial: &Trial,
    snapshot: &Snapshot,
    budget_s: f64,
    seed: u64,
) -> Result<Result<Duel, PlanError>, ReproductionError> {
    let paper =
        PlanOptions { iterations: Some(MOST_ITERATIONS), ..PlanOptions::new(Rig::preset(trial.rig)?, Method::Paper, seed) };
    let (paper, paper_s) = match plan_within(study, trial, snapshot, &paper, budget_s) {
        Ok(planned) => planned,
        Err(error) => return stopped_or(study, error),
    };
    let mut equal = trial.clone();
    // More than this share is asked for: a trace less, so that as many samples are enough.
    equal.settings.coverage.goal_percent = paper.metrics.coverage_percent * (1.0 - 1e-9);
    let matched_percent = Some(paper.metrics.matched_percent * (1.0 - 1e-9));
    // The refinement counts its seconds from when the problem is set up, the search above from the order on.
    let left_s = (budget_s - setup_s(study, trial, snapshot)?).max(budget_s / 2.0);
    let rig = Rig::preset(trial.rig)?;
    let refined = PlanOptions { budget_s: Some(left_s), matched_percent, ..PlanOptions::new(rig, Method::Refined, seed) };
    let (refined, refined_s) = match plan_within(study, &equal, snapshot, &refined, budget_s) {
        Ok(planned) => planned,
        Err(error) => return stopped_or(study, error),
    };
    let truth = study.truth(trial.site)?;
    let qualities = [study.assess(&truth, &paper, Which::All)?, study.assess(&truth, &refined, Which::All)?];
    let compared = compare(&[&qualities[0], &qualities[1]]).unwrap_or_default();
    Ok(Ok(Duel { plans: [paper, refined], planned_s: [paper_s, refined_s], compared }))
}

/// Seconds from an order until a search begins.
fn setup_s(study: &Study, trial: &Trial, snapshot: &Snapshot) -> Result<f64, ReproductionError> {
    let begun_s = study.now_s();
    let problem = Problem::new(snapshot, &trial.settings, Rig::preset(trial.rig)?);
    // Used, so that it is made at all.
    Ok(if problem.capturable == 0 { 0.0 } else { study.now_s() - begun_s })
}

/// A user's stop is an error of the whole run, anything else belongs to the row.
fn stopped_or(study: &Study, error: PlanError) -> Result<Result<Duel, PlanError>, ReproductionError> {
    if study.stop().is_stopped() { Err(ReproductionError::Stopped) } else { Ok(Err(error)) }
}

/// A plan with the seconds that it took. The tree search, which knows no clock, is stopped when its time is over.
fn plan_within(
    study: &Study,
    trial: &Trial,
    snapshot: &Snapshot,
    options: &PlanOptions,
    budget_s: f64,
) -> Result<(Plan, f64), PlanError> {
    let (clock, outer) = (study.clock(), study.stop());
    let begun_s = clock();
    let stop = StopToken::timed(move || clock() - begun_s);
    let elapsed_s = || stop.elapsed_s().unwrap_or(0.0);
    let mut on_progress = |_: &planner::Progress| {
        if outer.is_stopped() {
            stop.abandon();
        } else if options.method == Method::Paper && elapsed_s() >= budget_s {
            stop.stop();
        }
    };
    let plan = planner::plan(snapshot, &trial.settings, options, &stop, &mut on_progress)?;
    Ok((plan, elapsed_s()))
}

/// Figures of the seeds whose refined flight reaches the coverage; what the paper's search gave and the times are of all seeds.
fn cells(duels: &[Duel], goal: f64) -> Vec<Cell> {
    let reached: Vec<&Duel> = duels.iter().filter(|duel| duel.is_reached()).collect();
    let of_paper = |decimals, figure: fn(&Duel) -> f64| spread(duels.iter().map(figure), decimals);
    let of_refined = |decimals, figure: fn(&Duel) -> f64| spread(reached.iter().map(|duel| figure(duel)), decimals);
    let compared = |duel: &Duel, which: usize, figure: fn(&Compared) -> f64| duel.compared.get(which).map_or(f64::NAN, figure);
    let of_both = |decimals, figure: fn(&Compared) -> f64| {
        [
            spread(duels.iter().map(|duel| compared(duel, 0, figure)), decimals),
            spread(reached.iter().map(|duel| compared(duel, 1, figure)), decimals),
        ]
    };
    let mut cells = vec![
        of_paper(0, |duel| duel.plans[0].metrics.profile_s),
        of_refined(0, |duel| duel.plans[1].metrics.profile_s),
        of_refined(2, Duel::ratio),
        Cell::number(goal, 2),
        of_paper(1, |duel| duel.plans[0].metrics.coverage_percent),
        of_refined(1, |duel| duel.plans[1].metrics.coverage_percent),
    ];
    debug_assert_eq!(COMPLETENESS_M[..2], [0.020, 0.050]);
    cells.extend(of_both(2, |compared| compared.completeness_percent[0]));
    cells.extend(of_both(2, |compared| compared.completeness_percent[1]));
    cells.extend(of_both(3, |compared| compared.error_95_m.unwrap_or(f64::NAN)));
    let counts =
        |which: usize| Cell::spread(&duels.iter().map(|duel| duel.plans[which].convergence.len() as f64).collect::<Vec<_>>(), 0);
    let [iterations, rounds] = [0, 1].map(|which| counts(which).value().unwrap_or(f64::NAN));
    cells.extend([
        spread(duels.iter().map(|duel| compared(duel, 0, |compared| compared.common_percent)), 1),
        of_paper(2, |duel| duel.planned_s[0]),
        of_paper(2, |duel| duel.planned_s[1]),
        Cell::text(format!("{iterations:.0} and {rounds:.0}")),
        Cell::text(format!("{} of {}", reached.len(), duels.len())),
    ]);
    cells
}

fn add_notes(study: &Study, table: &mut Table) {
    let settings = figures::benchmark(&study.settings);
    table.note(format!(
        "Timed by the wall clock, one flight after the other, with {} threads: unlike the tables above, these figures differ from machine to machine \
         and from run to run. The field is made before; the time counts from the order on, the tree that the refinement begins with included. What comes \
         after the search (evaluation, selection, safety check, and the refinement's last repairs) is in \"Planned in\".",
        rayon::current_num_threads()
    ));
    table.note(
        "The paper's search is stopped when its time is over, or ends by itself at 95 % of the capturable samples. The refined flight has the coverage of \
         the paper's and its share of samples in matched views as its goals, by exact rays; a flight that misses one counts for nothing but in the last column.",
    );
    table.note(format!(
        "Median and [least..most] of {} seeds after {} s and after {} s.",
        study.seeds,
        budget_s(study, &SITTINGS[0]),
        budget_s(study, &SITTINGS[1])
    ));
    figures::note_quality_of(table, &settings, "all images");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_rig_is_given_a_second_everywhere_and_is_to_be_better_after_ten() {
        let [short, long] = &SITTINGS;
        for ((rig, goal), (same, better)) in short.rigs.iter().zip(&long.rigs) {
            assert_eq!(rig, same);
            assert!(better < goal && short.budget_s < long.budget_s);
        }
    }
}
