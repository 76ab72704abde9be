//! Edits of the proxy, one structure at a time.

use std::sync::Arc;

use geo::{Coord, MapCoords, Polygon};
use nalgebra::{Point3, Vector3};

use super::footprint;
use super::proxy::{Scene, Shape, Structure, StructureId};
use super::report::ItemKind;
use super::solid::Bounds;
use crate::settings::ProxySettings;

/// No structure may be less tall after an edit, m.
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
    /// A new prism called `name`.
    Add {
        name: String,
        footprint: Polygon<f64>,
        base_m: f64,
        top_m: f64,
    },
    /// Moves the structure horizontally, metres east and north.
    Move {
        id: StructureId,
        by_m: [f64; 2],
    },
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
    #[error("scene {scene:?} already has a structure {name:?}: give another name")]
    NameTaken { scene: String, name: String },
    #[error(
        "{name:?} cannot stand between {base_m} m and {top_m} m: its base must not lie below the ground, its top must lie at least {LEAST_HEIGHT_M} m above the base and at most {limit_m} m up (`proxy.max_height_m`)"
    )]
    Heights { name: String, base_m: f64, top_m: f64, limit_m: f64 },
    #[error(
        "the outline of {name:?} cannot be used: {problem}; give at least three corners of a polygon that does not cross itself, within {limit_m} m of the origin (`proxy.max_extent_m`)"
    )]
    Outline { name: String, problem: String, limit_m: f64 },
    #[error("{name:?} is the last structure of scene {scene:?}: a scene needs at least one")]
    LastStructure { scene: String, name: String },
}

impl Scene {
    /// The scene after `edit`, and the region in which it differs from this one. `limits` holds for edits as for
    /// files: the greatest height and the greatest distance from the origin.
    pub fn edited(&self, edit: &Edit, limits: &ProxySettings) -> Result<(Scene, DirtyRegion), EditError> {
        match edit {
            Edit::Raise { id, by_m } => self.with_top_moved(*id, *by_m, 1.0, limits.max_height_m),
            Edit::Lower { id, by_m } => self.with_top_moved(*id, *by_m, -1.0, limits.max_height_m),
            Edit::Remove { id } => self.without(*id),
            Edit::Add { name, footprint, base_m, top_m } => self.with_prism(name, footprint, [*base_m, *top_m], limits),
            Edit::Move { id, by_m } => self.with_place_moved(*id, *by_m, limits.max_extent_m),
        }
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
        let shape = stretched(&structure.shape, bounds.min.z, height_m, new_height_m);
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
        let shape = match &structure.shape {
            Shape::Prism { footprint, base_m, top_m } => {
                let footprint = footprint.map_coords(|corner| Coord { x: corner.x + shift.x, y: corner.y + shift.y });
                Shape::Prism { footprint, base_m: *base_m, top_m: *top_m }
            }
            Shape::Mesh { triangles } => {
                Shape::Mesh { triangles: triangles.iter().map(|corners| corners.map(|corner| corner + shift)).collect() }
            }
        };
        Ok(self.with_shape(index, shape))
    }

    fn without(&self, id: StructureId) -> Result<(Scene, DirtyRegion), EditError> {
        let index = self.position(id)?;
        let structure = &self.structures[index];
        if self.structures.len() == 1 {
            return Err(EditError::LastStructure { scene: self.name.clone(), name: structure.name.clone() });
        }
        let mut scene = self.clone();
        let removed = scene.structures.remove(index);
        Ok((scene, region(removed.bounds())))
    }

    fn with_prism(
        &self,
        name: &str,
        footprint: &Polygon<f64>,
        [base_m, top_m]: [f64; 2],
        limits: &ProxySettings,
    ) -> Result<(Scene, DirtyRegion), EditError> {
        if name.trim().is_empty() {
            return Err(EditError::NoName);
        }
        let id = StructureId::of_name(name);
        let Err(index) = self.structures.binary_search_by_key(&id, |structure| structure.id) else {
            return Err(EditError::NameTaken { scene: self.name.clone(), name: name.to_owned() });
        };
        // Written so that NaN is refused too.
        if !(base_m >= 0.0 && top_m - base_m >= LEAST_HEIGHT_M && top_m <= limits.max_height_m) {
            return Err(EditError::Heights { name: name.to_owned(), base_m, top_m, limit_m: limits.max_height_m });
        }
        let limit_m = limits.max_extent_m;
        let shape = prism(footprint, [base_m, top_m], limit_m).map_err(|problem| EditError::Outline {
            name: name.to_owned(),
            problem,
            limit_m,
        })?;
        let structure = Structure { id, name: name.to_owned(), shape };
        let bounds = structure.bounds();
        let mut scene = self.clone();
        scene.structures.insert(index, Arc::new(structure));
        Ok((scene, region(bounds)))
    }

    fn with_shape(&self, index: usize, shape: Shape) -> (Scene, DirtyRegion) {
        let old = &self.structures[index];
        let new = Structure { id: old.id, name: old.name.clone(), shape };
        let touched = old.bounds().union(&new.bounds());
        let mut scene = self.clone();
        scene.structures[index] = Arc::new(new);
        (scene, region(touched))
    }
}

fn stretched(shape: &Shape, base_m: f64, height_m: f64, new_height_m: f64) -> Shape {
    match shape {
        Shape::Prism { footprint, base_m, .. } => {
            Shape::Prism { footprint: footprint.clone(), base_m: *base_m, top_m: base_m + new_height_m }
        }
        Shape::Mesh { triangles } => {
            // A level mesh has no height to stretch: it moves as a whole.
            let height =
                |z: f64| if height_m > 0.0 { base_m + (z - base_m) / height_m * new_height_m } else { base_m + new_height_m };
            let lift = |corner: Point3<f64>| Point3::new(corner.x, corner.y, height(corner.z));
            Shape::Mesh { triangles: triangles.iter().map(|corners| corners.map(lift)).collect() }
        }
    }
}

/// A prism over an outline that needs no repair beyond closing and turning its rings.
fn prism(outline: &Polygon<f64>, [base_m, top_m]: [f64; 2], limit_m: f64) -> Result<Shape, String> {
    let corners = || outline.exterior().coords().chain(outline.interiors().iter().flat_map(|hole| hole.coords()));
    if !corners().all(|corner| corner.x.abs() <= limit_m && corner.y.abs() <= limit_m) {
        return Err("a corner is not finite or too far away".into());
    }
    let mut repairs = Vec::new();
    let footprint = footprint::repair_closed(std::slice::from_ref(outline), &mut repairs)?;
    let harmless = [ItemKind::WrongWinding, ItemKind::OpenRing, ItemKind::DuplicateVertices];
    match repairs.into_iter().find(|(kind, _)| !harmless.contains(kind)) {
        Some((_, problem)) => Err(problem),
        None => Ok(Shape::Prism { footprint, base_m, top_m }),
    }
}

fn region(bounds: Bounds) -> DirtyRegion {
    DirtyRegion { min: bounds.min, max: bounds.max }
}

#[cfg(test)]
mod tests {
    use geo::polygon;
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{BlockSettings, generate_block};
    use crate::settings::Settings;

    /// A generated block in which every third structure is a mesh.
    fn block() -> Scene {
        let mut scene = generate_block(&BlockSettings { buildings: 12, extent_m: [120.0, 120.0], ..Default::default() });
        for structure in scene.structures.iter_mut().step_by(3) {
            let shape = Shape::Mesh { triangles: structure.triangles() };
            *structure = Arc::new(Structure { shape, ..Structure::clone(structure) });
        }
        scene
    }

    fn limits() -> ProxySettings {
        Settings::default().proxy
    }

    fn corners(structure: &Structure) -> Vec<Point3<f64>> {
        structure.triangles().into_iter().flatten().collect()
    }

    fn assert_near(a: &Structure, b: &Structure) {
        let (a, b) = (corners(a), corners(b));
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).norm() < 1e-9));
    }

    fn holds(region: &DirtyRegion, structure: &Structure) -> bool {
        corners(structure).iter().all(|corner| Bounds { min: region.min, max: region.max }.contains(corner))
    }

    fn edits() -> impl Strategy<Value = (usize, f64, [f64; 2])> {
        (0usize..12, 0.5..80.0f64, prop::array::uniform2(-50.0..50.0f64))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn raise_then_lower_gives_the_scene_back((index, by_m, _) in edits()) {
            let scene = block();
            let id = scene.structures[index].id;
            let (raised, _) = scene.edited(&Edit::Raise { id, by_m }, &limits()).unwrap();
            let top_m = |scene: &Scene| scene.structure(id).unwrap().bounds().max.z;
            prop_assert!((top_m(&raised) - top_m(&scene) - by_m).abs() < 1e-9);
            let (back, _) = raised.edited(&Edit::Lower { id, by_m }, &limits()).unwrap();
            assert_near(scene.structure(id).unwrap(), back.structure(id).unwrap());
        }

        #[test]
        fn an_edit_touches_its_structure_alone((index, by_m, way) in edits()) {
            let scene = block();
            let id = scene.structures[index].id;
            let square = polygon![(x: way[0], y: way[1]), (x: way[0] + 9.0, y: way[1]), (x: way[0], y: way[1] + 9.0)];
            let added = StructureId::of_name("new");
            for (touched, edit) in [
                (id, Edit::Raise { id, by_m }),
                (id, Edit::Remove { id }),
                (id, Edit::Move { id, by_m: way }),
                (added, Edit::Add { name: "new".into(), footprint: square.clone(), base_m: 0.0, top_m: 20.0 }),
            ] {
                let (edited, region) = scene.edited(&edit, &limits()).unwrap();
                prop_assert!(edited.structures.is_sorted_by(|a, b| a.id < b.id));
                for structure in scene.structures.iter().filter(|structure| structure.id != touched) {
                    prop_assert!(Arc::ptr_eq(structure, edited.structure(structure.id).unwrap()));
                }
                for state in [&scene, &edited] {
                    prop_assert!(state.structure(touched).is_none_or(|structure| holds(&region, structure)));
                }
            }
        }

        #[test]
        fn a_move_there_and_back_gives_the_scene_back((index, _, way) in edits()) {
            let scene = block();
            let id = scene.structures[index].id;
            let (moved, _) = scene.edited(&Edit::Move { id, by_m: way }, &limits()).unwrap();
            let (back, _) = moved.edited(&Edit::Move { id, by_m: way.map(|way| -way) }, &limits()).unwrap();
            assert_near(scene.structure(id).unwrap(), back.structure(id).unwrap());
        }
    }

    #[test]
    fn edits_that_make_no_sense_are_refused() {
        let scene = block();
        let structure = &scene.structures[0];
        let id = structure.id;
        let height_m = structure.bounds().max.z - structure.bounds().min.z;
        let triangle = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 0.0, y: 9.0)];
        let crossing = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 9.0), (x: 9.0, y: 0.0), (x: 0.0, y: 9.0)];
        let line = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 9.0)];
        let infinite = polygon![(x: 0.0, y: 0.0), (x: f64::INFINITY, y: 9.0), (x: 9.0, y: 0.0)];
        let add = |name: &str, footprint: &Polygon<f64>, base_m: f64, top_m: f64| Edit::Add {
            name: name.into(),
            footprint: footprint.clone(),
            base_m,
            top_m,
        };
        let refused = [
            Edit::Remove { id: StructureId(1) },
            Edit::Raise { id, by_m: f64::NAN },
            Edit::Raise { id, by_m: 0.0 },
            Edit::Raise { id, by_m: -1.0 },
            Edit::Raise { id, by_m: 1e4 },
            Edit::Lower { id, by_m: height_m - 0.9 },
            Edit::Lower { id, by_m: f64::INFINITY },
            Edit::Move { id, by_m: [f64::NAN, 0.0] },
            Edit::Move { id, by_m: [1e9, 0.0] },
            add(" ", &triangle, 0.0, 10.0),
            add(&structure.name, &triangle, 0.0, 10.0),
            add("a", &triangle, -1.0, 10.0),
            add("a", &triangle, 5.0, 5.5),
            add("a", &triangle, 0.0, 2000.0),
            add("a", &triangle, f64::NAN, 10.0),
            add("a", &crossing, 0.0, 10.0),
            add("a", &line, 0.0, 10.0),
            add("a", &infinite, 0.0, 10.0),
            add("a", &Polygon::empty(), 0.0, 10.0),
        ];
        for edit in refused {
            let error = scene.edited(&edit, &limits()).expect_err(&format!("{edit:?}"));
            assert!(error.to_string().len() > 30, "{error}");
        }
        let alone = Scene { structures: scene.structures[..1].to_vec(), ..scene.clone() };
        assert!(matches!(alone.edited(&Edit::Remove { id }, &limits()), Err(EditError::LastStructure { .. })));
        assert!(scene.edited(&Edit::Lower { id, by_m: height_m - 1.0 }, &limits()).is_ok());
    }

    #[test]
    fn the_limits_are_those_of_the_settings() {
        let scene = block();
        let id = scene.structures[0].id;
        let high = ProxySettings { max_height_m: 2000.0, max_extent_m: 60_000.0, ..limits() };
        for edit in [Edit::Raise { id, by_m: 1500.0 }, Edit::Move { id, by_m: [50_000.0, 0.0] }] {
            let error = scene.edited(&edit, &limits()).unwrap_err();
            assert!(error.to_string().contains("`proxy.max_"), "{error}");
            assert!(scene.edited(&edit, &high).is_ok());
        }
    }

    #[test]
    fn structures_are_found_by_name_and_by_id() {
        let scene = block();
        let structure = &scene.structures[3];
        assert_eq!(scene.find(&structure.name), Some(structure.id));
        assert_eq!(scene.find(&structure.id.to_string()), Some(structure.id));
        assert_eq!(scene.find("nowhere"), None);
        assert_eq!(scene.find("00000000000000ff"), None);
        assert_eq!(scene.find("+123456789abcdef"), None);
    }
}
