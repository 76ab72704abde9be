//! Pages of plans, from what a command has at hand.

use overfly_table::FieldTable;

use super::failure::Failure;
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
    pub fn on_field(label: &str, field: &FieldTable, plan: &Plan) -> Result<Self, SvgError> {
        let sighted = Sighted::by_field(field, plan)?;
        let scene = Scene3d::of_field(field).called(&plan.scene.name, plan.scene.revision);
        Ok(Self { scene, flight: page::flight(label, plan, Some(sighted)) })
    }

    /// A plan of whose scene nothing is known.
    pub fn alone(label: &str, plan: &Plan) -> Self {
        let scene = Scene3d::empty(&plan.scene.name, plan.scene.origin);
        Self { scene, flight: page::flight(label, plan, None) }
    }

    pub fn page(self) -> Vec<u8> {
        page::html(&page::data(&self.scene, &[self.flight]), None)
    }

    /// Both on one page.
    pub fn against(self, other: Self) -> Vec<u8> {
        page::html(&page::data(&self.scene, &[self.flight, other.flight.through(other.scene)]), None)
    }
}

/// The page of a plan that was made in this process.
pub fn of_planned(planned: &Planned, settings: &Settings) -> Result<Vec<u8>, Failure> {
    Ok(Shown::in_scene("plan", &planned.snapshot, settings, &planned.plan, &planned.sightings)?.page())
}

/// The page of a plan that a daemon has made.
pub fn of_field(field: &FieldTable, plan: &Plan) -> Result<Vec<u8>, Failure> {
    Ok(Shown::on_field("plan", field, plan)?.page())
}
