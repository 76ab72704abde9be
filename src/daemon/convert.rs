//! The border between wire types and domain types.

use geo::{Coord, LineString, Polygon};
use nalgebra::Point3;
use overfly_wire::{EditOrder, PlanOrder, Refusal, RefusalCode};

use crate::camera::{Rig, direction_of};
use crate::planner::{Method, Objective, PlanOptions};
use crate::scene::edit::{Edit, EditError};
use crate::scene::{Scene, StructureId};

/// Refuses an order for a rig, method or view that does not exist, before it costs anybody a search.
pub fn check_plan(order: &PlanOrder) -> Result<(), Refusal> {
    plan_options(order).map(|_| ())
}

/// What the planner is asked for.
pub fn plan_options(order: &PlanOrder) -> Result<PlanOptions, Refusal> {
    let refusal = |error: &dyn std::fmt::Display| Refusal::new(RefusalCode::Plan, error.to_string());
    let rig = match &order.rig_file {
        Some(text) => Rig::parse(text),
        None => Rig::preset(&order.rig),
    };
    let rig = rig.map_err(|error| refusal(&error))?;
    let method = Method::parse(&order.method).map_err(|error| refusal(&error))?;
    let options = PlanOptions {
        iterations: order.iterations,
        budget_s: order.budget_s,
        goal_percent: order.goal_percent,
        objective: Objective::parse(&order.objective).map_err(|error| refusal(&error))?,
        matched_percent: order.matched_percent,
        within_s: order.within_s,
        gsd_m: order.gsd_m,
        overlap_percent: order.overlap_percent,
        region_m: (!order.region_m.is_empty()).then(|| order.region_m.clone()),
        start_m: order.start_m.map(Point3::from),
        start_view: order.start_view_deg.map(|[azimuth_deg, pitch_deg]| direction_of(azimuth_deg, pitch_deg)),
        ..PlanOptions::new(rig, method, order.seed)
    };
    options.check().map_err(|error| refusal(&error))?;
    Ok(options)
}

/// The edit of `scene` that a client means.
pub fn edit(scene: &Scene, order: &EditOrder) -> Result<Edit, Refusal> {
    Ok(match order {
        EditOrder::Raise { structure, by_m } => Edit::Raise { id: find(scene, structure)?, by_m: *by_m },
        EditOrder::Lower { structure, by_m } => Edit::Lower { id: find(scene, structure)?, by_m: *by_m },
        EditOrder::Remove { structure } => Edit::Remove { id: find(scene, structure)? },
        EditOrder::Move { structure, by_m } => Edit::Move { id: find(scene, structure)?, by_m: *by_m },
        EditOrder::Add { name, outline_m, base_m, top_m } => {
            let ring: LineString<f64> = outline_m.iter().map(|[x, y]| Coord { x: *x, y: *y }).collect();
            Edit::Add { name: name.clone(), footprint: Polygon::new(ring, Vec::new()), base_m: *base_m, top_m: *top_m }
        }
    })
}

/// Why the scene refused an edit.
pub fn edit_refusal(error: &EditError) -> Refusal {
    let code = match error {
        EditError::UnknownStructure { .. } => RefusalCode::UnknownStructure,
        _ => RefusalCode::Edit,
    };
    Refusal::new(code, error.to_string())
}

/// A structure by its name or, when none has that name, by its id in hexadecimal.
fn find(scene: &Scene, structure: &str) -> Result<StructureId, Refusal> {
    scene.find(structure).ok_or_else(|| {
        let count = scene.structures.len();
        let name = &scene.name;
        let message =
            format!("scene {name:?} has no structure {structure:?} among its {count}; list them with `overfly status {name}`");
        Refusal::new(RefusalCode::UnknownStructure, message)
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::frame::LocalFrame;
    use crate::scene::{Shape, Structure};

    fn scene(names: &[&str]) -> Scene {
        let structure = |name: &&str| {
            let shape = Shape::Mesh { triangles: Vec::new() };
            Arc::new(Structure { id: StructureId::of_name(name), name: (*name).into(), shape })
        };
        Scene {
            name: "town".into(),
            frame: LocalFrame::default(),
            structures: names.iter().map(structure).collect(),
            zones: vec![],
        }
    }

    #[test]
    fn a_structure_is_found_by_name_or_by_id() {
        let town = scene(&["hall", "tower"]);
        let id = StructureId::of_name("tower");
        for handle in ["tower".to_owned(), id.to_string()] {
            let order = EditOrder::Remove { structure: handle };
            assert_eq!(edit(&town, &order), Ok(Edit::Remove { id }));
        }
    }

    #[test]
    fn an_unknown_structure_is_refused_by_its_name() {
        let refusal = edit(&scene(&["hall"]), &EditOrder::Remove { structure: "shed".into() }).unwrap_err();
        assert_eq!(refusal.code, RefusalCode::UnknownStructure);
        assert!(refusal.message.contains("shed") && refusal.message.contains("town"), "{refusal}");
    }
}
