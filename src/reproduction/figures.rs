//! Figures that several tables give, and settings that several tables share.

use super::ReproductionError;
use super::paper::{self, RECONSTRUCTION_DECIMALS, Reconstruction};
use super::site::Site;
use super::study::{Flights, Study, Trial};
use super::table::{Cell, Table};
use crate::planner::Method;
use crate::quality::{Compared, Quality, Which};
use crate::settings::Settings;
use crate::trajectory::plan::Plan;

/// The cameras of the two drones of the paper's field tests.
pub const ONE_CAMERA: &str = "phantom4-rtk";
pub const FIVE_CAMERAS: &str = "m300-oblique";

/// Half-angle of the disks on real scenes, degrees: with h = 15 % a single frontal view of 25 degrees would do.
const REAL_THETA0_DEG: f64 = 20.0;

/// The settings of the paper's benchmarks (section 6): h = 30, G = 95.
pub fn benchmark(settings: &Settings) -> Settings {
    let [threshold_percent, goal_percent] = paper::BENCHMARK_PERCENT;
    let mut settings = settings.clone();
    (settings.coverage.threshold_percent, settings.coverage.goal_percent) = (threshold_percent, goal_percent);
    settings
}

/// The settings of the paper's real scenes: h = 15, G = 85.
pub fn real(settings: &Settings) -> Settings {
    let [threshold_percent, goal_percent] = paper::REAL_PERCENT;
    let mut settings = settings.clone();
    let coverage = &mut settings.coverage;
    (coverage.threshold_percent, coverage.goal_percent, coverage.theta0_deg) = (threshold_percent, goal_percent, REAL_THETA0_DEG);
    settings
}

/// Says with which thresholds the flights of a table were planned.
pub fn note_settings(table: &mut Table, settings: &Settings, seeds: u32) {
    let coverage = &settings.coverage;
    table.note(format!(
        "Planned with h = {} %, G = {} %, theta0 = {} degrees, K = {}, N = {}, M = {}, eta = {}, alpha_t = {}; median of {seeds} seeds with [least..most].",
        coverage.threshold_percent,
        coverage.goal_percent,
        coverage.theta0_deg,
        settings.search.iterations,
        settings.surface.samples,
        settings.field.viewpoints,
        settings.objective.eta,
        settings.objective.alpha_t,
    ));
}

/// Says what Error and Completeness are here, of post-selected images.
pub fn note_quality(table: &mut Table, settings: &Settings) {
    note_quality_of(table, settings, "the selected images");
}

/// Says what Error and Completeness of some images are.
pub fn note_quality_of(table: &mut Table, settings: &Settings, images: &str) {
    let quality = &settings.quality;
    table.note(format!(
        "The paper's Error and Completeness are measured on reconstructed meshes; ours are predicted: {} px of noise through the geometry of \
         {images}, for samples with at least {} views matched at {} to {} degrees. Compare methods within our rows, not with the paper's.",
        quality.pixel_noise_px, quality.least_views, quality.min_parallax_deg, quality.max_parallax_deg
    ));
}

/// Says why a flight above all buildings may see little.
pub fn note_range(table: &mut Table, settings: &Settings) {
    table.note(format!(
        "A view from farther away than {} m times the sight of its camera (`coverage.sight_scale`: 1 for the Phantom's 8.8 mm) counts for nothing, in \
         our coverage and in our Error and Completeness; OP flies above the tallest structure.",
        settings.coverage.range_m
    ));
}

/// Says that a scene is not there; `true` when it is.
pub fn is_there(study: &Study, table: &mut Table, site: Site) -> bool {
    let is_there = study.scene(site).is_some();
    if !is_there {
        let file = site.file().unwrap_or_default();
        table.note(format!("Skipped {}: there is no {file} in the folder of scenes.", site.name()));
    }
    is_there
}

/// Says why a method gives no flights; `true` when it gives some.
pub fn is_flown(table: &mut Table, trial: &Trial, flights: &Flights) -> bool {
    if let Some(refusal) = &flights.refusal {
        table.note(format!("No flight of {} over {}: {refusal}.", trial.method.name(), trial.site.name()));
    }
    flights.refusal.is_none()
}

/// How a method is called in the paper's tables.
pub fn label(method: Method) -> &'static str {
    match method {
        Method::Refined => "Refined",
        Method::Paper => "Ours",
        Method::Zhou => "Zhou",
        Method::Smith => "Smith",
        Method::Oblique => "OP",
    }
}

/// Which images the reconstruction takes: the post-selection belongs to our method, the others choose as many views as they need.
pub fn used(method: Method) -> Which {
    if method == Method::Paper { Which::Selected } else { Which::All }
}

/// How many they are.
pub fn used_images(method: Method, plan: &Plan) -> usize {
    match used(method) {
        Which::All => plan.images.len(),
        Which::Selected => plan.selected_images(),
    }
}

/// The figures of a reconstruction as the paper prints them.
pub fn printed(figures: &Reconstruction) -> Vec<(f64, usize)> {
    figures.iter().copied().zip(RECONSTRUCTION_DECIMALS).collect()
}

/// The same figures of ours: images, length, error, completeness.
pub fn reconstruction(flights: &Flights, qualities: &[Quality]) -> Vec<Cell> {
    let summaries: Vec<_> = qualities.iter().map(Quality::summary).collect();
    let mut cells = vec![spread(summaries.iter().map(|summary| summary.images as f64), 0), length(flights)];
    cells.push(spread(summaries.iter().map(|summary| summary.error_90_m.unwrap_or(f64::NAN)), 3));
    cells.push(spread(summaries.iter().map(|summary| summary.error_95_m.unwrap_or(f64::NAN)), 3));
    cells.extend((0..3).map(|k| spread(summaries.iter().map(|summary| summary.completeness_percent[k]), 2)));
    cells
}

/// Error on the samples that all methods reconstruct, and their share.
pub fn common(compared: &[Compared]) -> Vec<Cell> {
    vec![
        spread(compared.iter().map(|one| one.error_90_m.unwrap_or(f64::NAN)), 3),
        spread(compared.iter().map(|one| one.error_95_m.unwrap_or(f64::NAN)), 3),
        spread(compared.iter().map(|one| one.common_percent), 1),
    ]
}

pub fn length(flights: &Flights) -> Cell {
    of_plans(flights, 0, |plan| plan.metrics.length_m)
}

pub fn coverage(flights: &Flights) -> Cell {
    of_plans(flights, 1, |plan| plan.metrics.coverage_percent)
}

/// Median and range of one figure of the plans.
pub fn of_plans(flights: &Flights, decimals: usize, figure: impl Fn(&Plan) -> f64) -> Cell {
    Cell::spread(&flights.figures(figure), decimals)
}

pub fn spread(values: impl Iterator<Item = f64>, decimals: usize) -> Cell {
    Cell::spread(&values.collect::<Vec<_>>(), decimals)
}

/// Settings in which oblique photography may fly over a site, for all methods: with the ceiling raised when the legal one is too low. What
/// was raised is said in the table.
pub fn with_room_above(study: &mut Study, table: &mut Table, trial: &Trial) -> Result<Settings, ReproductionError> {
    let refused = study.flights(trial)?.refusal.is_some();
    let mut settings = trial.settings.clone();
    if let (true, Some(bounds)) = (refused, study.scene(trial.site).and_then(|scene| scene.bounds())) {
        let needed_m = (bounds.max.z + settings.flight.above_tallest_m).ceil();
        if needed_m > settings.flight.legal_ceiling_m {
            table.note(format!(
                "Oblique photography cannot fly over {} below the legal ceiling of {} m (the tallest structure has {:.0} m): here \
                 `flight.legal_ceiling_m` = {needed_m} for all methods.",
                trial.site.name(),
                settings.flight.legal_ceiling_m,
                bounds.max.z
            ));
            settings.flight.legal_ceiling_m = needed_m;
        }
    }
    Ok(settings)
}
