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
    table.note(format!(
        "Common samples are those that every method of the scene reconstructs with the same seed; methods that reconstruct less than \
         {LEAST_COMMON_PERCENT} % of the surface are left out, because next to nothing would be left."
    ));
    figures::note_range(&mut table, &settings);
    Ok(table)
}

/// A method that reconstructs less than this is left out of the common samples, percent of the surface: next to nothing would be left.
pub const LEAST_COMMON_PERCENT: f64 = 25.0;

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
        cells.extend(figures::common(&compared[index]));
        cells.push(figures::coverage(flights));
        table.ours(&[site.name(), figures::label(trial.method)], cells);
    }
    Ok(())
}

/// For each method its figures on the samples that the methods have in common, seed by seed; none for a method that is left out.
fn compared(qualities: &[Arc<Vec<Quality>>]) -> Vec<Vec<Compared>> {
    let kept: Vec<usize> = (0..qualities.len()).filter(|&method| reconstructs_enough(&qualities[method])).collect();
    let seeds = kept.iter().map(|&method| qualities[method].len()).max().unwrap_or(0);
    let mut found = vec![Vec::new(); qualities.len()];
    for seed in 0..seeds {
        // A method without chance has one flight for all seeds.
        let of_seed: Vec<&Quality> = kept.iter().filter_map(|&method| of_seed(&qualities[method], seed)).collect();
        for (&method, one) in kept.iter().zip(compare(&of_seed).into_iter().flatten()) {
            found[method].push(one);
        }
    }
    found
}

fn of_seed(qualities: &[Quality], seed: usize) -> Option<&Quality> {
    qualities.get(seed).or(qualities.last())
}

fn reconstructs_enough(qualities: &[Quality]) -> bool {
    let is_enough = |quality: &Quality| quality.share_percent(|i| quality.is_reconstructed(i)) >= LEAST_COMMON_PERCENT;
    !qualities.is_empty() && qualities.iter().all(is_enough)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::{Deviation, SampleQuality};
    use crate::settings::Settings;

    /// Samples of equal area, off by so many metres, or not reconstructed.
    fn quality(deviations_m: &[Option<f64>]) -> Quality {
        let sample = |deviation_m: &Option<f64>| SampleQuality {
            deviation: deviation_m.map(|normal_m| Deviation { normal_m, rms_m: normal_m }),
            ..Default::default()
        };
        let samples = deviations_m.iter().map(sample).collect();
        Quality::new(samples, vec![1; deviations_m.len()], 0, &Settings::default())
    }

    #[test]
    fn methods_are_compared_seed_by_seed_and_one_that_sees_next_to_nothing_is_left_out() {
        let ours = [[Some(0.01), Some(0.5), None, Some(0.01)], [Some(0.02), None, None, Some(0.02)]];
        let other = [Some(0.03), None, Some(0.03), Some(0.03)];
        let poor = [None, None, None, None];
        let all = [
            Arc::new(ours.iter().map(|deviations| quality(deviations)).collect::<Vec<_>>()),
            Arc::new(vec![quality(&other)]),
            Arc::new(vec![quality(&poor)]),
        ];
        let found = compared(&all);
        assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2, 0]);
        assert!(found[..2].iter().flatten().all(|one| one.common_percent == 50.0));
        // Of normal errors, 90 % lie within 1.644854 deviations.
        let errors = [&found[0][0], &found[0][1], &found[1][0]].map(|one| one.error_90_m.unwrap() / 1.644_854);
        assert!(errors.iter().zip([0.01, 0.02, 0.03]).all(|(found, expected)| (found - expected).abs() < 1e-7), "{errors:?}");
    }
}
