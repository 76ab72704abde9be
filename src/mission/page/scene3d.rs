//! What a page draws of a scene.

use std::collections::HashMap;
use std::sync::Arc;

use geo::{Coord, LineString, MultiPolygon, Polygon};
use nalgebra::Point3;
use overfly_table::FieldTable;
use overfly_table::field::PointRow;
use rayon::prelude::*;
use serde::Serialize;

use super::bytes::Packed;
use crate::frame::Geodetic;
use crate::scene::free_space::FreeSpace;
use crate::scene::terrain::Terrain;
use crate::scene::{Bounds, NoFlyZone, Scene, Shape, Structure, StructureId, TERRAIN_NAME, Triangle, ZoneSource};

/// So far around the structures the ground is drawn where it is not flat, m.
const GROUND_MARGIN_M: f64 = 250.0;

/// A scene in triangles, with the limits that flights keep.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scene3d {
    name: String,
    origin: Option<Geodetic>,
    revision: u64,
    /// Whether the triangles are those of the scene, or outlines from base to top.
    is_exact: bool,
    /// The box around what stands on the ground.
    min_m: [f64; 3],
    max_m: [f64; 3],
    /// Legal ceiling of flights above the ground; `None` where it is not known.
    ceiling_m: Option<f64>,
    structures: Vec<Body>,
    /// Corners, and three of them for each triangle; the structures' triangles stand one after another.
    corners: Packed,
    triangles: Packed,
    zones: Vec<Zone>,
}

/// A structure.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Body {
    /// In decimal digits: JavaScript has no numbers of 64 bits.
    id: String,
    name: String,
    kind: Kind,
    base_m: f64,
    top_m: f64,
    triangles: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    Structure,
    Obstacle,
    Terrain,
}

/// A no-fly zone.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Zone {
    name: String,
    floor_m: f64,
    /// `None` for one without an upper end.
    ceiling_m: Option<f64>,
    /// Its rings, exteriors and holes; the first corner is not repeated.
    rings: Vec<Vec<[f64; 2]>>,
    /// The area that it covers, two coordinates a corner, in triangles.
    area: Packed,
}

impl Scene3d {
    /// The true triangles of a scene, and its own no-fly zones.
    pub fn of_scene(scene: &Scene) -> Self {
        let bounds = scene.bounds();
        let triangles: Vec<Vec<Triangle>> =
            scene.structures.par_iter().map(|structure| drawn_triangles(structure, bounds.as_ref())).collect();
        let bodies = scene.structures.iter().map(|structure| {
            let kind = match &structure.shape {
                Shape::Terrain(_) => Kind::Terrain,
                Shape::Obstacle { .. } => Kind::Obstacle,
                Shape::Prism { .. } | Shape::Mesh { .. } => Kind::Structure,
            };
            let Bounds { min, max } = structure.bounds();
            (structure.id, structure.name.clone(), kind, [min.z, max.z])
        });
        let drawn = Self::new(scene.name.clone(), bounds, bodies, triangles);
        Self { origin: scene.frame.origin, is_exact: true, zones: scene.zones.iter().filter_map(Zone::new).collect(), ..drawn }
    }

    /// The scene as far as a field knows it: structures are their outlines from base to top, everything else is as it is.
    pub fn of_field(field: &FieldTable) -> Self {
        let facts = field.facts;
        let bounds = Bounds { min: facts.min_m.into(), max: facts.max_m.into() };
        let ground = ground(field).map(Arc::new);
        let structures = field.structures.iter().map(|row| {
            let name = field.name(row).into_owned();
            // What has an outline and no samples is nothing that anybody wants to capture.
            let kind = match (row.samples, row.rings) {
                (0, 0) if name == TERRAIN_NAME => Kind::Terrain,
                (0, _) => Kind::Obstacle,
                _ => Kind::Structure,
            };
            let shape = match ground.as_ref().filter(|_| kind == Kind::Terrain) {
                Some(ground) => Shape::Terrain(Arc::clone(ground)),
                None => Shape::Prism { footprint: footprint(field.outline(row)), base_m: row.base_m, top_m: row.top_m },
            };
            (Arc::new(Structure { id: StructureId(row.id), name, shape }), kind)
        });
        let structures: Vec<(Arc<Structure>, Kind)> = structures.collect();
        let triangles = structures.par_iter().map(|(structure, _)| drawn_triangles(structure, Some(&bounds))).collect();
        let bodies = structures.iter().zip(field.structures);
        let bodies =
            bodies.map(|((structure, kind), row)| (structure.id, structure.name.clone(), *kind, [row.base_m, row.top_m]));
        let drawn = Self::new(String::new(), Some(bounds), bodies, triangles);
        let place = Geodetic { lat_deg: facts.origin_lat_deg, lon_deg: facts.origin_lon_deg, alt_m: facts.origin_alt_m };
        let zones = field.zones.iter().map(|row| NoFlyZone {
            name: field.zone_name(row).into_owned(),
            outline: footprint(field.zone_outline(row)),
            floor_m: row.floor_m,
            ceiling_m: row.ceiling_m,
            source: ZoneSource::File,
        });
        Self {
            origin: (facts.georeferenced == 1).then_some(place),
            revision: facts.revision,
            ceiling_m: (facts.legal_ceiling_m > 0.0).then_some(facts.legal_ceiling_m),
            zones: zones.filter_map(|zone| Zone::new(&zone)).collect(),
            ..drawn
        }
    }

    /// Nothing but the ground: what there is to a plan without its scene.
    pub fn empty(name: &str, origin: Option<Geodetic>) -> Self {
        Self { origin, ..Self::new(name.to_owned(), None, std::iter::empty(), Vec::new()) }
    }

    fn new(
        name: String,
        bounds: Option<Bounds>,
        bodies: impl Iterator<Item = (StructureId, String, Kind, [f64; 2])>,
        triangles: Vec<Vec<Triangle>>,
    ) -> Self {
        let structures = bodies.zip(&triangles).map(|((id, name, kind, [base_m, top_m]), triangles)| Body {
            id: id.0.to_string(),
            name,
            kind,
            base_m,
            top_m,
            triangles: triangles.len(),
        });
        let structures = structures.collect();
        let [min, max] = bounds.map_or([Point3::origin(); 2], |bounds| [bounds.min, bounds.max]);
        let (corners, triangles) = shared_corners(triangles.iter().flatten());
        Self {
            name,
            origin: None,
            revision: 1,
            is_exact: false,
            min_m: min.coords.into(),
            max_m: max.coords.into(),
            ceiling_m: None,
            structures,
            corners,
            triangles,
            zones: Vec::new(),
        }
    }

    /// The same with all zones that flights keep out of, those of the settings as well, and with the legal ceiling.
    #[must_use]
    pub fn within(self, free: &FreeSpace, ceiling_m: f64) -> Self {
        Self { zones: free.zones().iter().filter_map(Zone::new).collect(), ceiling_m: Some(ceiling_m), ..self }
    }

    /// Whether coordinates mean the same in both.
    pub fn is_in_frame_of(&self, other: &Self) -> bool {
        self.origin == other.origin
    }

    /// The same as another revision, and under the name by which users know it.
    #[must_use]
    pub fn called(self, name: &str, revision: u64) -> Self {
        Self { name: name.to_owned(), revision, ..self }
    }
}

/// The triangles of a structure; of the ground those around the other structures.
fn drawn_triangles(structure: &Arc<Structure>, bounds: Option<&Bounds>) -> Vec<Triangle> {
    let triangles = structure.triangles();
    let Some(bounds) = bounds.filter(|_| structure.terrain().is_some()) else { return triangles };
    let bounds = bounds.grown(GROUND_MARGIN_M);
    let within = |corner: Point3<f64>| {
        Point3::new(corner.x.clamp(bounds.min.x, bounds.max.x), corner.y.clamp(bounds.min.y, bounds.max.y), corner.z)
    };
    let moved = triangles.into_iter().map(|corners| corners.map(within));
    moved.filter(|[a, b, c]| (b - a).cross(&(c - a)).z > 1e-6).collect()
}

/// The ground of a field where it is not flat.
fn ground(field: &FieldTable) -> Option<Terrain> {
    let facts = field.facts;
    let corners = facts.ground_corners.map(|corners| corners as usize);
    Terrain::new(facts.ground_origin_m, facts.ground_cell_m, corners, field.ground_m.to_vec())
}

fn footprint<'a>(rings: impl Iterator<Item = &'a [PointRow]>) -> MultiPolygon<f64> {
    let mut polygons: Vec<Polygon<f64>> = Vec::new();
    for ring in rings {
        let corners: LineString<f64> = ring.iter().map(|&[x, y]| Coord { x, y }).collect();
        match polygons.last_mut().filter(|_| is_hole(ring)) {
            Some(polygon) => polygon.interiors_push(corners),
            None => polygons.push(Polygon::new(corners, Vec::new())),
        }
    }
    MultiPolygon(polygons)
}

/// Holes run clockwise.
fn is_hole(ring: &[PointRow]) -> bool {
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).map(|([ax, ay], [bx, by])| ax * by - bx * ay).sum::<f64>() < 0.0
}

/// Corners that several triangles share stand there once.
fn shared_corners<'a>(triangles: impl Iterator<Item = &'a Triangle>) -> (Packed, Packed) {
    let (mut corners, mut indices) = (Vec::<[f32; 3]>::new(), Vec::<u32>::new());
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    for corner in triangles.flatten() {
        let corner = [corner.x, corner.y, corner.z].map(|value| value as f32);
        let index = *known.entry(corner.map(f32::to_bits)).or_insert_with(|| {
            corners.push(corner);
            corners.len() as u32 - 1
        });
        indices.push(index);
    }
    (Packed::f32(corners.into_iter().flatten().map(f64::from)), Packed::u32(indices))
}

impl Zone {
    /// `None` for a zone that lies wholly outside of where flights go.
    fn new(zone: &NoFlyZone) -> Option<Self> {
        let rings = |polygon: &Polygon<f64>| {
            let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors());
            let open = |ring: &LineString<f64>| ring.0[..ring.0.len().saturating_sub(1)].iter().map(|c| [c.x, c.y]).collect();
            rings.map(open).collect::<Vec<Vec<[f64; 2]>>>()
        };
        // A prism as thin as can be has the area as its top.
        let shape = Shape::Prism { footprint: zone.outline.clone(), base_m: 0.0, top_m: 1.0 };
        let sheet = Structure { id: StructureId(0), name: String::new(), shape };
        let tops = sheet.triangles().into_iter().filter(|corners| corners.iter().all(|corner| corner.z == 1.0));
        let area: Vec<f64> = tops.flatten().flat_map(|corner| [corner.x, corner.y]).collect();
        (!area.is_empty()).then(|| Self {
            name: zone.name.clone(),
            floor_m: zone.floor_m,
            ceiling_m: (zone.ceiling_m < f64::MAX).then_some(zone.ceiling_m),
            rings: zone.outline.iter().flat_map(rings).collect(),
            area: Packed::f32(area),
        })
    }
}
