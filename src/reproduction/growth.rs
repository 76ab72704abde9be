//! How time and memory of a field grow with the area of a city: generated cities of one density, sampled equally densely.

use std::sync::Arc;

use super::chart::{self, Drawing, Panel, Series};
use super::study::Study;
use super::table::{Cell, Table};
use super::{Effort, ReproductionError};
use crate::field::Snapshot;
use crate::scene::edit::Edit;
use crate::scene::{BlockSettings, StructureId, generate_block};
use crate::session::Session;

/// Areas of the cities, km^2.
const AREAS_KM2: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];
const QUICK_AREAS_KM2: [f64; 2] = [0.01, 0.02];

/// Building lots on a square kilometre, as on the block that `overfly generate` writes.
const LOTS_PER_KM2: f64 = 667.0;

/// Edits of which the median is told.
const EDITS: usize = 9;

/// By how much a structure is raised and lowered in turn, m.
const STEP_M: f64 = 4.0;

/// What was measured of one city.
struct City {
    area_km2: f64,
    structures: usize,
    samples: usize,
    viewpoints: usize,
    build_s: f64,
    update_ms: f64,
    field_mb: f64,
}

pub fn figure(study: &mut Study) -> Result<(Table, Drawing), ReproductionError> {
    let columns = [
        "Area [km2]",
        "Structures",
        "Samples",
        "Viewpoints",
        "Build [s]",
        "Build per km2 [s]",
        "Update after an edit [ms]",
        "Field [MB]",
        "Field per km2 [MB]",
    ];
    let mut table = Table::new("growth", "A field by the area of its city", &columns);
    let areas_km2: &[f64] = if study.effort == Effort::Quick { &QUICK_AREAS_KM2 } else { &AREAS_KM2 };
    let mut cities = Vec::new();
    for &area_km2 in areas_km2 {
        study.step(&format!("a city of {area_km2} km2"))?;
        cities.push(city(study, area_km2)?);
    }
    for city in &cities {
        let count = |count: usize| Cell::number(count as f64, 0);
        let cells = vec![
            count(city.structures),
            count(city.samples),
            count(city.viewpoints),
            Cell::number(city.build_s, 2),
            Cell::number(city.build_s / city.area_km2, 2),
            Cell::number(city.update_ms, 1),
            Cell::number(city.field_mb, 1),
            Cell::number(city.field_mb / city.area_km2, 1),
        ];
        table.ours(&[&city.area_km2.to_string()], cells);
    }
    let spacing_m = study.settings.surface.max_spacing_m;
    table.note(format!(
        "Generated cities with {LOTS_PER_KM2} building lots on a square kilometre; samples at most {spacing_m} m apart, whatever their number, viewpoints {} m. \
         Build is sampling and field on {} threads, update the median of {EDITS} edits that raise or lower the structure in the middle by {STEP_M} m. Drawn in growth.svg.",
        study.settings.field.max_spacing_m,
        rayon::current_num_threads()
    ));
    let svg = chart::lines("A field by the area of its city", "area [km2]", &panels(&cities));
    Ok((table, Drawing { file: "growth.svg".to_owned(), svg }))
}

fn city(study: &Study, area_km2: f64) -> Result<City, ReproductionError> {
    let stop = study.stop();
    let mut settings = study.settings.clone();
    // The greatest spacings hold, and nothing but memory limits the number.
    (settings.surface.samples, settings.surface.max_samples) = (1, u32::MAX);
    settings.field.viewpoints = 1;
    let side_m = 1000.0 * area_km2.sqrt();
    let buildings = (LOTS_PER_KM2 * area_km2).round() as u32;
    let block = BlockSettings { seed: 1, extent_m: [side_m, side_m], buildings, ..BlockSettings::default() };
    let mut session = Session::new(generate_block(&block), Arc::new(settings), stop)?;
    let begun_s = study.now_s();
    let mut snapshot = session.survey(stop)?.into_snapshot(stop)?;
    let build_s = study.now_s() - begun_s;
    let middle = middle(&session);
    let mut updates_ms = Vec::with_capacity(EDITS);
    for number in 0..EDITS {
        let edit = match number % 2 {
            0 => Edit::Raise { id: middle, by_m: STEP_M },
            _ => Edit::Lower { id: middle, by_m: STEP_M },
        };
        session.apply(&edit).map_err(|error| ReproductionError::Edit(error.to_string()))?;
        let begun_s = study.now_s();
        let next: Snapshot = session.survey_after(&snapshot, stop)?.into_snapshot(stop)?;
        updates_ms.push(1e3 * (study.now_s() - begun_s));
        snapshot = next;
    }
    updates_ms.sort_by(f64::total_cmp);
    let field = snapshot.field();
    Ok(City {
        area_km2,
        structures: session.scene().structures.len(),
        samples: field.samples.len(),
        viewpoints: field.viewpoints.len(),
        build_s,
        update_ms: updates_ms[EDITS / 2],
        field_mb: field.bytes() as f64 / 1e6,
    })
}

/// The structure nearest to the middle of the city.
fn middle(session: &Session) -> StructureId {
    let away_m = |id: &StructureId| {
        let bounds = session.scene().structure(*id).map(|structure| structure.bounds());
        bounds.map_or(f64::INFINITY, |bounds| nalgebra::center(&bounds.min, &bounds.max).coords.xy().norm())
    };
    let ids = session.scene().structures.iter().map(|structure| structure.id);
    ids.min_by(|a, b| away_m(a).total_cmp(&away_m(b))).expect("a city has structures")
}

fn panels(cities: &[City]) -> Vec<Panel> {
    let panel = |title: &str, figure: fn(&City) -> f64| {
        let points = cities.iter().map(|city| [city.area_km2, figure(city)]).collect();
        Panel { title: title.to_owned(), series: vec![Series { name: title.to_owned(), points }] }
    };
    vec![
        panel("Build of the field [s]", |city| city.build_s),
        panel("Field [MB]", |city| city.field_mb),
        panel("Update after an edit [ms]", |city| city.update_ms),
        panel("Viewpoints [thousands]", |city| city.viewpoints as f64 / 1e3),
    ]
}
