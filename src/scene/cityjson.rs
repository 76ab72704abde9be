//! CityJSON 1.0, 1.1 and 2.0, and sequences of CityJSON features: buildings, bridges and other constructions at their highest level of
//! detail, or the highest that is wanted.
//!
//! A Building with its parts and installations is one structure, named by the Building. Only the outer shell of a solid is taken.
//! Walls that the file leaves out between terraced houses are filled in, so that a house has an inside. The ground plane is the
//! median of the structures' lowest points. Where the reference system is known, the grid is turned to true north and scaled to
//! true metres, so that the local frame is east-north-up at the middle of the scene.

mod model;
pub(super) mod sequence;

use std::collections::BTreeMap;

use nalgebra::Point3;

use self::model::{CityModel, CityObject, Lists, Transform};

use super::anchor::Anchor;
use super::close;
use super::crs;
use super::faces;
use super::meshes::{self, RawMesh};
use super::names::tidy;
use super::proxy::Scene;
use super::read::{ImportError, assemble};
use super::report::{Format, ImportReport, ItemKind, Place};
use crate::frame::LocalFrame;
use crate::settings::ProxySettings;

/// The types that become structures or parts of one.
const TAKEN: [&str; 10] = [
    "Building",
    "BuildingPart",
    "BuildingInstallation",
    "BuildingConstructiveElement",
    "Bridge",
    "BridgePart",
    "BridgeInstallation",
    "BridgeConstructiveElement",
    "BridgeConstructionElement",
    "OtherConstruction",
];

/// Longer chains of parents are no building and its parts.
const MOST_GENERATIONS: usize = 16;

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let model: CityModel = serde_json::from_slice(bytes).map_err(|source| ImportError::Json { file: file.into(), source })?;
    scene_of(file, &model, Format::CityJson, settings, anchor)
}

fn scene_of(
    file: &str,
    model: &CityModel,
    format: Format,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let mut report = ImportReport::new(format);
    note_version(model, &mut report);
    let vertices = vertices(model);
    let mut meshes = Vec::new();
    for (root, members) in families(model, &mut report) {
        meshes.push(mesh(file, root, &members, &vertices, settings.lod, &mut report)?);
    }
    let objects = model.objects.len();
    if !meshes.is_empty() && !vertices.iter().any(|vertex| vertex.iter().all(|metres| metres.is_finite())) {
        return Err(ImportError::Coordinates { file: file.into(), what: "no vertex is finite".into() });
    }
    meshes::drop_strays(&mut meshes, settings.max_extent_m, &mut report);
    let frame = to_local(file, model, &mut meshes, settings, anchor, &mut report)?;
    for mesh in &mut meshes {
        let walls = close::close_walls(&mut mesh.triangles);
        if walls > 0 {
            report.add(&mesh.name, mesh.place.clone(), ItemKind::WallsClosed, format!("{walls} missing walls filled in"));
        }
    }
    let structures = meshes::structures(meshes, &mut report);
    if structures.is_empty() {
        return Err(ImportError::NoStructures { file: file.into(), objects, first: report.first_item() });
    }
    Ok(assemble(file, frame, structures, Vec::new(), report))
}

fn note_version(model: &CityModel, report: &mut ImportReport) {
    let version = model.version.text().unwrap_or("(none)");
    if !["1.0", "1.1", "2.0"].iter().any(|known| version.starts_with(known)) {
        report.notes.push(format!("CityJSON version {:?} is not known: read as 2.0", tidy(version)));
    }
}

fn vertices(model: &CityModel) -> Vec<Point3<f64>> {
    let place = |vertex: &[f64; 3]| match &model.transform {
        Some(Transform { scale, translate }) => Point3::from([0, 1, 2].map(|axis| vertex[axis] * scale[axis] + translate[axis])),
        None => Point3::from(*vertex),
    };
    model.vertices.iter().map(place).collect()
}

/// The taken objects with their descendants, by key; the others are counted.
fn families<'a>(model: &'a CityModel, report: &mut ImportReport) -> BTreeMap<&'a str, Vec<(&'a str, &'a CityObject)>> {
    let mut families: BTreeMap<&str, Vec<(&str, &CityObject)>> = BTreeMap::new();
    for (key, object) in &model.objects {
        if TAKEN.contains(&object.kind.as_str()) {
            families.entry(ancestor(model, key, object)).or_default().push((key, object));
        } else {
            report.ignore(tidy(&object.kind));
        }
    }
    families
}

/// The topmost taken object above an object. Where parents run in a circle it is the first of the circle by key.
fn ancestor<'a>(model: &'a CityModel, key: &'a str, object: &'a CityObject) -> &'a str {
    let mut line = vec![key];
    let mut object = object;
    loop {
        let known = object.parents.iter().flatten().filter_map(|parent| model.objects.get_key_value(parent));
        let Some((parent_key, parent)) = known.into_iter().find(|(_, parent)| TAKEN.contains(&parent.kind.as_str())) else {
            return line[line.len() - 1];
        };
        if let Some(start) = line.iter().position(|seen| seen == parent_key) {
            return line[start..].iter().min().copied().unwrap_or(key);
        }
        if line.len() == MOST_GENERATIONS {
            return key;
        }
        line.push(parent_key);
        object = parent;
    }
}

fn mesh(
    file: &str,
    root: &str,
    members: &[(&str, &CityObject)],
    vertices: &[Point3<f64>],
    most_detail: f64,
    report: &mut ImportReport,
) -> Result<RawMesh, ImportError> {
    let mut mesh = RawMesh { name: tidy(root), place: Place::Object(tidy(root)), triangles: Vec::new(), degenerate: 0 };
    let detail = |object: &CityObject| detail(object, most_detail);
    let parts_detail = members.iter().filter(|(key, _)| *key != root).map(|(_, object)| detail(object)).fold(0.0, f64::max);
    for (key, object) in members {
        let own = detail(object);
        // A coarse hull of the whole would swallow its finer parts.
        if *key == root && own < parts_detail {
            continue;
        }
        for geometry in object.geometry.0.iter().filter(|geometry| own > 0.0 && geometry.level == own) {
            if let Some(bad) = &geometry.boundaries.bad {
                return Err(no_vertex(file, key, bad, vertices));
            }
            let mut surfaces = Vec::new();
            if !gather(&geometry.kind, &geometry.boundaries.root, &mut surfaces) {
                let done = format!("a geometry of type {:?} is not read", tidy(&geometry.kind));
                report.add(&mesh.name, Place::Object(tidy(key)), ItemKind::PartsDropped, done);
            }
            for surface in surfaces {
                add_surface(file, key, surface, vertices, &mut mesh)?;
            }
        }
    }
    Ok(mesh)
}

/// The level of detail at which an object is read: the highest that is wanted (0: that there is), else the lowest with a volume; 0 where there is none.
fn detail(object: &CityObject, most: f64) -> f64 {
    let levels = || object.geometry.0.iter().map(|geometry| geometry.level).filter(|level| *level >= 1.0);
    let wanted = levels().filter(|level| most == 0.0 || *level <= most).fold(0.0, f64::max);
    if wanted > 0.0 { wanted } else { levels().reduce(f64::min).unwrap_or(0.0) }
}

/// Collects the surfaces (lists of rings) of a geometry; says whether its type is one that has them.
fn gather<'a>(kind: &str, boundaries: &'a Lists, surfaces: &mut Vec<&'a [Lists]>) -> bool {
    let parts = boundaries.parts();
    match kind {
        "MultiSurface" | "CompositeSurface" => surfaces.extend(parts.iter().map(Lists::parts)),
        "Solid" => surfaces.extend(parts.first().into_iter().flat_map(Lists::parts).map(Lists::parts)),
        "MultiSolid" | "CompositeSolid" => return parts.iter().all(|solid| gather("Solid", solid, surfaces)),
        _ => return false,
    }
    true
}

fn add_surface(
    file: &str,
    object: &str,
    surface: &[Lists],
    vertices: &[Point3<f64>],
    mesh: &mut RawMesh,
) -> Result<(), ImportError> {
    let mut rings = Vec::with_capacity(surface.len());
    for ring in surface {
        let indices: &[u32] = if let Lists::Ring(indices) = ring { indices } else { &[] };
        let vertex = |index: &u32| {
            let vertex = vertices.get(*index as usize).copied();
            vertex.ok_or_else(|| no_vertex(file, object, &index.to_string(), vertices))
        };
        rings.push(indices.iter().map(vertex).collect::<Result<Vec<_>, _>>()?);
    }
    match faces::triangulate(&rings) {
        Some(triangles) => mesh.triangles.extend(triangles),
        None => mesh.degenerate += 1,
    }
    Ok(())
}

fn no_vertex(file: &str, object: &str, index: &str, vertices: &[Point3<f64>]) -> ImportError {
    ImportError::VertexIndex { file: file.into(), object: tidy(object), index: index.into(), vertices: vertices.len() }
}

/// Moves the meshes to the local frame: the middle of their box, or the anchor, becomes the origin, the ground z = 0.
fn to_local(
    file: &str,
    model: &CityModel,
    meshes: &mut [RawMesh],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
    report: &mut ImportReport,
) -> Result<LocalFrame, ImportError> {
    let Some(bounds) = meshes::bounds(meshes) else { return Ok(LocalFrame::default()) };
    let named = crs::epsg_code(&model.metadata.reference_system.0);
    report.epsg = if settings.epsg == 0 { named } else { Some(settings.epsg) };
    let origin = match anchor {
        Some(anchor) => Point3::from(anchor.grid(file, report.epsg)?),
        None => {
            let middle = nalgebra::center(&bounds.min, &bounds.max);
            Point3::new(middle.x, middle.y, meshes::ground(meshes))
        }
    };
    meshes::to_frame(file, meshes, report.epsg, origin, settings, report)
}

#[cfg(test)]
mod tests;
