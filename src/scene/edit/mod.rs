//! Edits of the proxy, one structure or one no-fly zone at a time.

mod shape;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use geo::Polygon;
use nalgebra::{Point3, Vector3};

use super::bounds::Bounds;
use super::proxy::{NoFlyZone, Scene, Shape, Structure, StructureId, ZoneSource};
use super::zone;
use crate::settings::ProxySettings;

/// No structure that is to be captured may be less tall after an edit, m.
const LEAST_HEIGHT_M: f64 = 1.0;

/// One change of the proxy.
#[derive(Clone, Debug, PartialEq)]
pub enum Edit {
    /// Heights above the structure's base are stretched so that its top rises by `by_m` (> 0).
    Raise {
        id: StructureId,
        by_m: f64,
    },
    /// As [`Edit::Raise`], downwards; the structure must stay at least 1 m tall.
    Lower {
        id: StructureId,
        by_m: f64,
    },
    Remove {
        id: StructureId,
    },
    /// A new structure called `name`.
    Add {
        name: String,
        shape: Shape,
    },
    /// Another shape under the same name.
    Replace {
        id: StructureId,
        shape: Shape,
    },
    /// Moves the structure horizontally, metres east and north.
    Move {
        id: StructureId,
        by_m: [f64; 2],
    },
    /// A new no-fly zone; wherever it says that it comes from, it comes from this edit.
    AddZone {
        zone: NoFlyZone,
    },
    RemoveZone {
        name: String,
    },
}

impl Edit {
    /// A new prism over an outline.
    pub fn add_prism(name: impl Into<String>, outline: Polygon<f64>, base_m: f64, top_m: f64) -> Self {
        Self::Add { name: name.into(), shape: Shape::Prism { footprint: outline.into(), base_m, top_m } }
    }
}

/// The box that an edit has touched, metres in the local frame: what stood there before together with what stands there now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirtyRegion {
    pub min: Point3<f64>,
    pub max: Point3<f64>,
}

/// Why an edit was refused. The scene is unchanged.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum EditError {
    #[error("scene {scene:?} has no structure {id}; list them with `overfly status {scene}`")]
    UnknownStructure { scene: String, id: StructureId },
    #[error("{name:?} cannot be raised or lowered by {by_m} m: give a number above 0")]
    Amount { name: String, by_m: f64 },
    #[error(
        "{name:?} would end {top_m} m above ground, over the limit of {limit_m} m: raise it less, or raise `proxy.max_height_m`"
    )]
    TooTall { name: String, top_m: f64, limit_m: f64 },
    #[error("{name:?} is {height_m} m tall and would be below {LEAST_HEIGHT_M} m: lower it less, or remove it")]
    TooLow { name: String, height_m: f64 },
    #[error("{name:?} cannot be moved by ({}, {}) m: give finite distances that keep it within {limit_m} m of the origin (`proxy.max_extent_m`)", .by_m[0], .by_m[1])]
    Distance { name: String, by_m: [f64; 2], limit_m: f64 },
    #[error("a structure cannot be added without a name: give one")]
    NoName,
    #[error("scene {scene:?} already has a structure {name:?}: give another name, or replace it")]
    NameTaken { scene: String, name: String },
    #[error(
        "{name:?} cannot stand between {base_m} m and {top_m} m: its base must not lie below the ground, its top must lie at least \
         {LEAST_HEIGHT_M} m above the base and at most {limit_m} m up (`proxy.max_height_m`)"
    )]
    Heights { name: String, base_m: f64, top_m: f64, limit_m: f64 },
    #[error(
        "the outline of {name:?} cannot be used: {problem}; give at least three corners of a polygon that does not cross itself, within {limit_m} m of the origin (`proxy.max_extent_m`)"
    )]
    Outline { name: String, problem: String, limit_m: f64 },
    #[error(
        "the mesh of {name:?} cannot be used: {problem}; give triangles with an area, in metres within {extent_m} m of the origin (`proxy.max_extent_m`) \
         and at most {height_m} m up (`proxy.max_height_m`)"
    )]
    Mesh { name: String, problem: &'static str, extent_m: f64, height_m: f64 },
    #[error(
        "the obstacle {name:?} cannot be used: {problem}; give a box in metres within {extent_m} m of the origin (`proxy.max_extent_m`) that ends above \
         the ground and at most {height_m} m up (`proxy.max_height_m`)"
    )]
    Obstacle { name: String, problem: &'static str, extent_m: f64, height_m: f64 },
    #[error("{name:?} is the ground of the scene, which no edit changes: load the scene anew from a corrected height model")]
    Terrain { name: String },
    #[error("{name:?} is the last structure of scene {scene:?} that is to be captured: a scene needs at least one")]
    LastStructure { scene: String, name: String },
    #[error("a no-fly zone cannot be added without a name: give one")]
    NoZoneName,
    #[error("scene {scene:?} already has a no-fly zone {name:?}: remove it first, or give another name")]
    ZoneTaken { scene: String, name: String },
    #[error(
        "scene {scene:?} has no no-fly zone {name:?}{known}; zones of the configuration (`flight.no_fly`) cannot be removed by an edit"
    )]
    UnknownZone { scene: String, name: String, known: String },
    #[error("the no-fly zone {name:?} {problem}, so it cannot be barred as it is given; {remedy}")]
    Zone { name: String, problem: String, remedy: &'static str },
}

impl Scene {
    /// The scene after `edit`, and the region in which it differs from this one. `limits` holds for edits as for
    /// files: the greatest height and the greatest distance from the origin.
    pub fn edited(&self, edit: &Edit, limits: &ProxySettings) -> Result<(Scene, DirtyRegion), EditError> {
        self.check_not_terrain(edit)?;
        match edit {
            Edit::Raise { id, by_m } => self.with_top_moved(*id, *by_m, 1.0, limits.max_height_m),
            Edit::Lower { id, by_m } => self.with_top_moved(*id, *by_m, -1.0, limits.max_height_m),
            Edit::Remove { id } => self.without(*id),
            Edit::Add { name, shape } => self.with_structure(name, shape, limits),
            Edit::Replace { id, shape } => self.with_shape_replaced(*id, shape, limits),
            Edit::Move { id, by_m } => self.with_place_moved(*id, *by_m, limits.max_extent_m),
            Edit::AddZone { zone } => self.with_zone(zone),
            Edit::RemoveZone { name } => self.without_zone(name),
        }
    }

    fn check_not_terrain(&self, edit: &Edit) -> Result<(), EditError> {
        let (Edit::Raise { id, .. }
        | Edit::Lower { id, .. }
        | Edit::Remove { id }
        | Edit::Replace { id, .. }
        | Edit::Move { id, .. }) = edit
        else {
            return Ok(());
        };
        let terrain = self.structure(*id).filter(|structure| structure.terrain().is_some());
        terrain.map_or(Ok(()), |terrain| Err(EditError::Terrain { name: terrain.name.clone() }))
    }

    /// The structure that is called `name_or_id`, or whose id it is in 16 hexadecimal digits.
    pub fn find(&self, name_or_id: &str) -> Option<StructureId> {
        let by_name = StructureId::of_name(name_or_id);
        if self.structures.iter().any(|structure| structure.id == by_name && structure.name == name_or_id) {
            return Some(by_name);
        }
        let digits = name_or_id.len() == 16 && name_or_id.bytes().all(|byte| byte.is_ascii_hexdigit());
        let by_id = StructureId(u64::from_str_radix(name_or_id, 16).ok().filter(|_| digits)?);
        self.structure(by_id).map(|structure| structure.id)
    }

    /// The structure with this id.
    pub fn structure(&self, id: StructureId) -> Option<&Arc<Structure>> {
        self.position(id).ok().map(|index| &self.structures[index])
    }

    fn position(&self, id: StructureId) -> Result<usize, EditError> {
        self.structures
            .binary_search_by_key(&id, |structure| structure.id)
            .map_err(|_| EditError::UnknownStructure { scene: self.name.clone(), id })
    }

    fn with_top_moved(&self, id: StructureId, by_m: f64, sign: f64, limit_m: f64) -> Result<(Scene, DirtyRegion), EditError> {
        let index = self.position(id)?;
        let structure = &self.structures[index];
        let name = structure.name.clone();
        if !(by_m.is_finite() && by_m > 0.0) {
            return Err(EditError::Amount { name, by_m });
        }
        let bounds = structure.bounds();
        let height_m = bounds.max.z - bounds.min.z;
        let new_height_m = height_m + sign * by_m;
        if sign < 0.0 && new_height_m < LEAST_HEIGHT_M {
            return Err(EditError::TooLow { name, height_m });
        }
        if sign > 0.0 && bounds.min.z + new_height_m > limit_m {
            return Err(EditError::TooTall { name, top_m: bounds.min.z + new_height_m, limit_m });
        }
        let shape = shape::stretched(&structure.shape, bounds.min.z, height_m, new_height_m);
        Ok(self.with_shape(index, shape))
    }

    fn with_place_moved(&self, id: StructureId, by_m: [f64; 2], limit_m: f64) -> Result<(Scene, DirtyRegion), EditError> {
        let index = self.position(id)?;
        let structure = &self.structures[index];
        let shift = Vector3::new(by_m[0], by_m[1], 0.0);
        let bounds = structure.bounds();
        let reach = [bounds.min + shift, bounds.max + shift];
        // Written so that NaN is refused too.
        if !reach.iter().all(|corner| corner.x.abs() <= limit_m && corner.y.abs() <= limit_m) {
            return Err(EditError::Distance { name: structure.name.clone(), by_m, limit_m });
        }
        Ok(self.with_shape(index, shape::shifted(&structure.shape, shift)))
    }

    fn without(&self, id: StructureId) -> Result<(Scene, DirtyRegion), EditError> {
        let index = self.position(id)?;
        self.check_not_last(index)?;
        let mut scene = self.clone();
        let removed = scene.structures.remove(index);
        Ok((scene, region(removed.bounds())))
    }

    fn check_not_last(&self, index: usize) -> Result<(), EditError> {
        let mut captured = self.structures.iter().enumerate().filter(|(_, structure)| structure.is_captured());
        if captured.next().is_some_and(|(first, _)| first == index) && captured.next().is_none() {
            let name = self.structures[index].name.clone();
            return Err(EditError::LastStructure { scene: self.name.clone(), name });
        }
        Ok(())
    }

    fn with_structure(&self, name: &str, shape: &Shape, limits: &ProxySettings) -> Result<(Scene, DirtyRegion), EditError> {
        if name.trim().is_empty() {
            return Err(EditError::NoName);
        }
        let id = StructureId::of_name(name);
        let Err(index) = self.structures.binary_search_by_key(&id, |structure| structure.id) else {
            return Err(EditError::NameTaken { scene: self.name.clone(), name: name.to_owned() });
        };
        let structure = Structure { id, name: name.to_owned(), shape: shape::checked(name, shape, limits)? };
        let bounds = structure.bounds();
        let mut scene = self.clone();
        scene.structures.insert(index, Arc::new(structure));
        Ok((scene, region(bounds)))
    }

    fn with_shape_replaced(
        &self,
        id: StructureId,
        shape: &Shape,
        limits: &ProxySettings,
    ) -> Result<(Scene, DirtyRegion), EditError> {
        let index = self.position(id)?;
        let shape = shape::checked(&self.structures[index].name, shape, limits)?;
        if matches!(shape, Shape::Obstacle { .. }) {
            self.check_not_last(index)?;
        }
        Ok(self.with_shape(index, shape))
    }

    fn with_shape(&self, index: usize, shape: Shape) -> (Scene, DirtyRegion) {
        let old = &self.structures[index];
        let new = Structure { id: old.id, name: old.name.clone(), shape };
        let touched = old.bounds().union(&new.bounds());
        let mut scene = self.clone();
        scene.structures[index] = Arc::new(new);
        (scene, region(touched))
    }

    fn with_zone(&self, new: &NoFlyZone) -> Result<(Scene, DirtyRegion), EditError> {
        let name = new.name.clone();
        if name.trim().is_empty() {
            return Err(EditError::NoZoneName);
        }
        if self.zones.iter().any(|zone| zone.name == name) {
            return Err(EditError::ZoneTaken { scene: self.name.clone(), name });
        }
        zone::check_heights(new.floor_m, new.ceiling_m)
            .and_then(|()| zone::checked(&new.outline))
            .map(|outline| {
                let zone = NoFlyZone { outline, source: ZoneSource::Edit, ..new.clone() };
                let mut scene = self.clone();
                let touched = self.zone_region(&zone);
                scene.zones.push(zone);
                (scene, touched)
            })
            .map_err(|(problem, remedy)| EditError::Zone { name, problem, remedy })
    }

    fn without_zone(&self, name: &str) -> Result<(Scene, DirtyRegion), EditError> {
        let Some(index) = self.zones.iter().position(|zone| zone.name == name) else {
            let known: Vec<String> = self.zones.iter().take(20).map(|zone| format!("{:?}", zone.name)).collect();
            let known = if known.is_empty() { String::new() } else { format!(", only {}", known.join(", ")) };
            return Err(EditError::UnknownZone { scene: self.name.clone(), name: name.to_owned(), known });
        };
        let mut scene = self.clone();
        let removed = scene.zones.remove(index);
        Ok((scene, self.zone_region(&removed)))
    }

    /// A zone that lies far away touches nothing.
    fn zone_region(&self, zone: &NoFlyZone) -> DirtyRegion {
        region(zone.bounds(self.terrain()).unwrap_or(Bounds { min: Point3::origin(), max: Point3::origin() }))
    }
}

fn region(bounds: Bounds) -> DirtyRegion {
    DirtyRegion { min: bounds.min, max: bounds.max }
}
