//! The border between wire types and domain types.

use std::sync::Arc;

use geo::{Coord, LineString, MultiPolygon, Polygon};
use nalgebra::Point3;
use overfly_wire::{
    EditOrder, FlightReport, PlanOrder, ReadOrder, Refusal, RefusalCode, SceneChanges, ShapeOrder, StructureInfo, StructureKind,
    ZoneInfo,
};

use crate::camera::{Rig, direction_of};
use crate::planner::{EnRoute, Method, Objective, PlanError, PlanOptions};
use crate::scene::edit::{Edit, EditError};
use crate::scene::update::Changes;
use crate::scene::{NoFlyZone, Scene, Shape, Structure, StructureId, ZoneSource};
use crate::settings::{MissingHeights, Settings, UpAxis};

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
        en_route: order.en_route.as_ref().map(en_route),
        ..PlanOptions::new(rig, method, order.seed)
    };
    options.check().map_err(|error| refusal(&error))?;
    Ok(options)
}

/// The settings that a file is read by.
pub fn read_as(order: &ReadOrder, settings: &Settings) -> Result<Settings, Refusal> {
    let ReadOrder { epsg, up, unit_m, offset_m, lod, missing_heights, default_height_m } = order;
    let mut settings = settings.clone();
    let proxy = &mut settings.proxy;
    let refusal = |error: String| Refusal::new(RefusalCode::Invalid, error);
    if let Some(name) = up {
        proxy.up =
            UpAxis::parse(name).ok_or_else(|| refusal(format!("{name:?} is no axis that points up; give y, z or file")))?;
    }
    if let Some(name) = missing_heights {
        let unknown = || refusal(format!("{name:?} is no way to deal with unknown heights; give neighbours, constant or drop"));
        proxy.missing_heights = MissingHeights::parse(name).ok_or_else(unknown)?;
    }
    proxy.epsg = epsg.unwrap_or(proxy.epsg);
    proxy.unit_m = unit_m.unwrap_or(proxy.unit_m);
    proxy.offset_m = offset_m.unwrap_or(proxy.offset_m);
    proxy.lod = lod.unwrap_or(proxy.lod);
    proxy.default_height_m = default_height_m.unwrap_or(proxy.default_height_m);
    settings.check().map_err(|error| refusal(error.to_string()))?;
    Ok(settings)
}

/// An aircraft that has reported itself. What it has captured is not in its report.
pub fn en_route(report: &FlightReport) -> EnRoute {
    EnRoute {
        position_m: report.position_m.into(),
        velocity_mps: report.velocity_mps.into(),
        view: report.view_deg.map(|[azimuth_deg, pitch_deg]| direction_of(azimuth_deg, pitch_deg)),
        captured: Arc::default(),
        time_left_s: report.time_left_s,
        landing_m: report.landing_m.map(Point3::from),
    }
}

/// Why there is no plan, for programs: whether the aircraft has to hold, or to land.
pub fn plan_code(error: &PlanError) -> RefusalCode {
    match error {
        PlanError::Hold { .. } | PlanError::CannotBrake { .. } | PlanError::NoWayHome { .. } => RefusalCode::Hold,
        PlanError::LandNow { .. } => RefusalCode::Land,
        _ => RefusalCode::Plan,
    }
}

/// The edit of `scene` that a client means.
pub fn edit(scene: &Scene, order: &EditOrder) -> Result<Edit, Refusal> {
    Ok(match order {
        EditOrder::Raise { structure, by_m } => Edit::Raise { id: find(scene, structure)?, by_m: *by_m },
        EditOrder::Lower { structure, by_m } => Edit::Lower { id: find(scene, structure)?, by_m: *by_m },
        EditOrder::Remove { structure } => Edit::Remove { id: find(scene, structure)? },
        EditOrder::Move { structure, by_m } => Edit::Move { id: find(scene, structure)?, by_m: *by_m },
        EditOrder::Add { name, shape: order } => Edit::Add { name: name.clone(), shape: shape(order) },
        EditOrder::Replace { structure, shape: order } => Edit::Replace { id: find(scene, structure)?, shape: shape(order) },
        EditOrder::AddZone { name, outline_m, floor_m, ceiling_m } => Edit::AddZone {
            zone: NoFlyZone {
                name: name.clone(),
                outline: outline(outline_m),
                floor_m: *floor_m,
                ceiling_m: ceiling_m.unwrap_or(f64::MAX),
                source: ZoneSource::Edit,
            },
        },
        EditOrder::RemoveZone { name } => Edit::RemoveZone { name: name.clone() },
    })
}

/// The shape that a client means. The numbers of a mesh's vertices were checked when the order came in.
fn shape(order: &ShapeOrder) -> Shape {
    match order {
        ShapeOrder::Prism { outline_m, base_m, top_m } => {
            Shape::Prism { footprint: outline(outline_m), base_m: *base_m, top_m: *top_m }
        }
        ShapeOrder::Mesh { vertices_m, triangles } => {
            let vertex = |index: u32| vertices_m.get(index as usize).map_or(Point3::origin(), |at| Point3::from(*at));
            Shape::Mesh { triangles: triangles.iter().map(|corners| corners.map(vertex)).collect() }
        }
        ShapeOrder::Obstacle { centre_m, size_m, yaw_deg } => {
            Shape::obstacle_box(Point3::from(*centre_m), *size_m, yaw_deg.to_radians())
        }
    }
}

fn outline(corners_m: &[[f64; 2]]) -> MultiPolygon<f64> {
    let ring: LineString<f64> = corners_m.iter().map(|[x, y]| Coord { x: *x, y: *y }).collect();
    MultiPolygon(vec![Polygon::new(ring, Vec::new())])
}

/// What a new version of a file has changed, as clients read it.
pub fn changes(changes: Changes) -> SceneChanges {
    let Changes { structures, zones } = changes;
    SceneChanges {
        added: structures.added,
        removed: structures.removed,
        changed: structures.changed,
        zones_added: zones.added,
        zones_removed: zones.removed,
        zones_changed: zones.changed,
    }
}

/// A structure as clients know it; `samples` are its own.
pub fn structure_info(structure: &Structure, samples: u64) -> StructureInfo {
    let bounds = structure.bounds();
    let kind = match structure.shape {
        Shape::Prism { .. } => StructureKind::Prism,
        Shape::Mesh { .. } => StructureKind::Mesh,
        Shape::Obstacle { .. } => StructureKind::Obstacle,
        Shape::Terrain(_) => StructureKind::Terrain,
    };
    let name = structure.name.clone();
    StructureInfo { id: structure.id.0, name, base_m: bounds.min.z, top_m: bounds.max.z, samples, kind }
}

/// A zone as clients know it.
pub fn zone_info(zone: &NoFlyZone) -> ZoneInfo {
    ZoneInfo {
        name: zone.name.clone(),
        floor_m: zone.floor_m,
        ceiling_m: (zone.ceiling_m < f64::MAX).then_some(zone.ceiling_m),
        by_edit: zone.source == ZoneSource::Edit,
    }
}

/// Why the scene refused an edit.
pub fn edit_refusal(error: &EditError) -> Refusal {
    let code = match error {
        EditError::UnknownStructure { .. } | EditError::UnknownZone { .. } => RefusalCode::UnknownStructure,
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
    use super::*;
    use crate::frame::LocalFrame;

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
