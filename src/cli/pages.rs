//! Pages of plans, from what a command has at hand.

use std::fs;
use std::path::Path;

use overfly_table::FieldTable;
use serde_json::Value;

use super::failure::Failure;
use super::first_look;
use super::in_process::Planned;
use crate::mission::page::{self, Scene3d, Sighted};
use crate::mission::svg::SvgError;
use crate::session::Snapshot;
use crate::settings::Settings;
use crate::trajectory::evaluate::Sightings;
use crate::trajectory::plan::Plan;

/// A scene with one flight through it.
pub struct Shown {
    pub scene: Scene3d,
    pub flight: page::Flight,
}

impl Shown {
    /// A plan in the scene of `snapshot`, whose images see what `sightings` say.
    pub fn in_scene(
        label: &str,
        snapshot: &Snapshot,
        settings: &Settings,
        plan: &Plan,
        sightings: &Sightings,
    ) -> Result<Self, SvgError> {
        let sighted = Sighted::by_rays(&snapshot.field(), plan, sightings)?;
        let scene = Scene3d::of_scene(&snapshot.scene).within(&snapshot.free, settings.flight.legal_ceiling_m);
        let flight = page::flight(label, plan, Some(sighted)).from_ground(plan, &snapshot.free);
        Ok(Self { scene: scene.called(&plan.scene.name, plan.scene.revision), flight })
    }

    /// A plan on the field of its revision, all that a daemon's clients have.
    pub fn on_field(label: &str, field: &FieldTable, plan: &Plan, is_under_way: bool) -> Result<Self, SvgError> {
        let sighted = Sighted::by_field(field, plan, Some(is_under_way))?;
        let scene = Scene3d::of_field(field).called(&plan.scene.name, plan.scene.revision);
        Ok(Self { scene, flight: page::flight(label, plan, Some(sighted)) })
    }

    /// A plan of whose scene nothing is known.
    pub fn alone(label: &str, plan: &Plan) -> Self {
        let scene = Scene3d::empty(&plan.scene.name, plan.scene.origin);
        Self { scene, flight: page::flight(label, plan, None) }
    }

    /// The same as another revision of its scene.
    pub fn of_revision(self, name: &str, revision: u64) -> Self {
        Self { scene: self.scene.called(name, revision), flight: self.flight.of_revision(revision) }
    }

    /// The same with what a reader has to know.
    pub fn noted(self, notes: &[String]) -> Self {
        Self { flight: self.flight.noted(notes), ..self }
    }

    /// The same with why what it captures cannot be held against the plan beside it, if it cannot.
    pub fn apart(self, why: Option<&str>) -> Self {
        Self { flight: self.flight.apart(why), ..self }
    }

    pub fn is_alone(&self) -> bool {
        !self.flight.has_coverage()
    }
}

/// The page of one plan, or of both.
pub fn page_of(shown: Vec<Shown>) -> Vec<u8> {
    let scene = shown.first().map_or_else(|| Scene3d::empty("", None), |first| first.scene.clone());
    let flights: Vec<page::Flight> = shown.into_iter().map(|one| one.flight.through(one.scene)).collect();
    page::html(&page::data(&scene, &flights), None)
}

/// Whether a page that was written before shows the same flights, each of them in its scene.
pub fn shows_in_scene(file: &Path, shown: &[Shown]) -> bool {
    let bytes = fs::read(file).unwrap_or_default();
    let data: Value = page::data_of(&bytes).and_then(|data| serde_json::from_slice(data).ok()).unwrap_or_default();
    let flights = data["flights"].as_array().map_or(&[][..], Vec::as_slice);
    let is_shown = |there: &Value, here: &Shown| {
        let here = serde_json::to_value(&here.flight).unwrap_or_default();
        let scene = there["scene"].as_u64().map_or(&Value::Null, |scene| &data["scenes"][scene as usize]);
        let has_structures = scene["structures"].as_array().is_some_and(|structures| !structures.is_empty());
        // Directions of images are written with so few digits that some come back otherwise.
        let is_same = |part: &str| there.pointer(part).is_some() && there.pointer(part) == here.pointer(part);
        has_structures && ["/path", "/waypoints_m", "/images/times_s"].into_iter().all(is_same)
    };
    flights.len() == shown.len() && flights.iter().zip(shown).all(|(there, here)| is_shown(there, here))
}

/// The page of a plan that was made in this process.
pub fn of_planned(planned: &Planned, settings: &Settings) -> Result<Vec<u8>, Failure> {
    let shown = Shown::in_scene("plan", &planned.snapshot, settings, &planned.plan, &planned.sightings)?;
    Ok(page_of(vec![shown.noted(first_look::note(planned).as_slice())]))
}

/// The page of a plan that a daemon has made.
pub fn of_field(field: &FieldTable, plan: &Plan, is_under_way: bool) -> Result<Vec<u8>, Failure> {
    Ok(page_of(vec![Shown::on_field("plan", field, plan, is_under_way)?]))
}
