//! Meshes out of a file made into structures: strays and flat ground left out, faces turned outwards, all put into the local frame.

use nalgebra::{Point3, Vector3};

use super::anchor::Anchor;
use super::bounds::Bounds;
use super::crs::{self, Placement, Unplaced};
use super::faces;
use super::locate::median;
use super::names::Names;
use super::orient;
use super::proxy::{Scene, Shape, Structure, StructureId, Triangle};
use super::read::{ImportError, assemble};
use super::report::{Format, ImportReport, ItemKind, Place};
use crate::frame::LocalFrame;
use crate::settings::{ProxySettings, UpAxis};

/// A mesh that ends lower above the ground is the ground itself, m.
const LEAST_TOP_M: f64 = 0.5;

/// Smaller triangles are left out, m^2.
const LEAST_AREA_M2: f64 = 1e-8;

/// A mesh as it stands in the file.
pub(crate) struct RawMesh {
    pub name: String,
    pub place: Place,
    pub triangles: Vec<Triangle>,
    /// Faces without area, and faces with a vertex that is no place.
    pub degenerate: usize,
}

impl RawMesh {
    pub fn empty(name: String, place: Place) -> Self {
        Self { name, place, triangles: Vec::new(), degenerate: 0 }
    }

    /// Adds what [`face`] has made of a face.
    pub fn add(&mut self, face: Option<Vec<Triangle>>) {
        match face {
            Some(triangles) => self.triangles.extend(triangles),
            None => self.degenerate += 1,
        }
    }

    fn bounds(&self) -> Option<Bounds> {
        Bounds::of_points(self.triangles.iter().flatten().copied())
    }
}

/// A ground that is no farther from zero is at zero, m.
const ROUNDING_M: f64 = 1e-6;

/// Coordinates beyond this are no metres.
const FARTHEST_M: f64 = 1e8;

/// What a mesh file says, in its own coordinates.
pub(crate) struct MeshFile {
    pub format: Format,
    pub meshes: Vec<RawMesh>,
    /// How many faces there are, usable or not.
    pub faces: usize,
    /// What is meant by [`UpAxis::File`].
    pub up: UpAxis,
}

/// The triangles of a face; `None` for one without area or with a corner that is no place.
pub(crate) fn face(corners: Vec<Point3<f64>>) -> Option<Vec<Triangle>> {
    let is_sound = corners.iter().flat_map(|corner| corner.iter()).all(|coordinate| coordinate.abs() < FARTHEST_M);
    if is_sound { faces::triangulate(&[corners]) } else { None }
}

/// The bodies of a file without names: each set of faces that share corners is one. The triangles of a face come with its place.
pub(crate) fn by_body(faces: impl Iterator<Item = (Place, Option<Vec<Triangle>>)>) -> Vec<RawMesh> {
    let (mut triangles, mut places, mut degenerate) = (Vec::new(), Vec::new(), 0);
    for (place, cut) in faces {
        match cut {
            Some(cut) => {
                places.resize(places.len() + cut.len(), place);
                triangles.extend(cut);
            }
            None => degenerate += 1,
        }
    }
    let mut meshes: Vec<RawMesh> = Vec::new();
    for ((triangle, place), body) in triangles.iter().zip(&places).zip(orient::bodies(&triangles)) {
        if body == meshes.len() {
            meshes.push(RawMesh::empty(format!("body-{}", body + 1), place.clone()));
        }
        meshes[body].triangles.push(*triangle);
    }
    // A face without area belongs to no body of its own; the first body reports them all.
    if let Some(first) = meshes.first_mut() {
        first.degenerate = degenerate;
    }
    meshes
}

/// The scene of a mesh file. Its lowest vertex lies on the ground unless the anchor says otherwise. With a reference system
/// (`proxy.epsg`) the coordinates are a grid's, turned to true north; without one they stay as they are unless they lie far from zero.
pub(crate) fn scene_of(
    file: &str,
    mut found: MeshFile,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let mut report = ImportReport::new(found.format);
    if found.meshes.iter().all(|mesh| mesh.triangles.is_empty()) && found.faces > 0 {
        let what = format!("none of the {} faces has an area and finite vertices", found.faces);
        return Err(ImportError::Coordinates { file: file.into(), what });
    }
    let up = if settings.up == UpAxis::File { found.up } else { settings.up };
    let (unit_m, offset_m) = (settings.unit_m, Vector3::from(settings.offset_m));
    for corner in found.meshes.iter_mut().flat_map(|mesh| mesh.triangles.iter_mut().flatten()) {
        let metres = *corner * unit_m;
        // The z of a file whose y points up points south when its x points east.
        let upright = if up == UpAxis::Y { Point3::new(metres.x, -metres.z, metres.y) } else { metres };
        *corner = upright + offset_m;
    }
    drop_strays(&mut found.meshes, settings.max_extent_m, &mut report);
    let frame = to_local(file, &mut found.meshes, settings, anchor, &mut report)?;
    let structures = structures(found.meshes, &mut report);
    if structures.is_empty() {
        return Err(ImportError::NoStructures { file: file.into(), objects: found.faces, first: report.first_item() });
    }
    Ok(assemble(file, frame, structures, Vec::new(), report))
}

fn to_local(
    file: &str,
    meshes: &mut [RawMesh],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
    report: &mut ImportReport,
) -> Result<LocalFrame, ImportError> {
    let Some(bounds) = bounds(meshes) else { return Ok(LocalFrame::default()) };
    let middle = nalgebra::center(&bounds.min, &bounds.max);
    if settings.epsg != 0 {
        let origin = match anchor {
            Some(anchor) => Point3::from(anchor.grid(file, Some(settings.epsg))?),
            None => Point3::new(middle.x, middle.y, bounds.min.z),
        };
        return to_frame(file, meshes, Some(settings.epsg), origin, settings, report);
    }
    let is_far = libm::hypot(middle.x, middle.y) > settings.max_extent_m;
    let [x, y] = if is_far { [middle.x, middle.y] } else { [0.0; 2] };
    let shift = match anchor {
        Some(anchor) => Vector3::from(anchor.mesh(file)?),
        None => Vector3::new(x, y, if bounds.min.z.abs() < ROUNDING_M { 0.0 } else { bounds.min.z }),
    };
    report.anchor = Some(Anchor::Mesh { origin_m: shift.into() });
    if shift != Vector3::zeros() {
        report.notes.push(format!("the local origin is ({}, {}, {}) in the file", shift.x, shift.y, shift.z));
    }
    for corner in meshes.iter_mut().flat_map(|mesh| mesh.triangles.iter_mut().flatten()) {
        *corner -= shift;
    }
    Ok(LocalFrame::default())
}

/// Moves meshes from a grid to the local frame: `origin` of the grid becomes its origin, and its z the ground.
pub(crate) fn to_frame(
    file: &str,
    meshes: &mut [RawMesh],
    epsg: Option<u32>,
    origin: Point3<f64>,
    settings: &ProxySettings,
    report: &mut ImportReport,
) -> Result<LocalFrame, ImportError> {
    report.epsg = epsg;
    report.anchor = Some(Anchor::Grid { epsg, origin: origin.into() });
    let placement = match epsg.map(|epsg| (epsg, crs::place(epsg, origin))) {
        Some((_, Ok(placement))) => Some(placement),
        Some((epsg, Err(Unplaced::Geographic))) => return Err(ImportError::Geographic { file: file.into(), epsg }),
        // Whoever names a reference system wants the scene to be there.
        Some((epsg, Err(Unplaced::Unknown))) if settings.epsg == epsg => {
            return Err(ImportError::UnknownGrid { file: file.into(), epsg, example: [origin.x, origin.y] });
        }
        Some((epsg, Err(Unplaced::Unknown))) => {
            report.notes.push(format!("EPSG:{epsg} cannot be projected to WGS84: the scene has no place on Earth"));
            None
        }
        None => {
            report.notes.push("the file names no EPSG code: the scene has no place on Earth; `--epsg` gives one".into());
            None
        }
    };
    if let Some(placement) = &placement {
        report.notes.push(note_of(placement));
    }
    for corner in meshes.iter_mut().flat_map(|mesh| mesh.triangles.iter_mut().flatten()) {
        let offset = *corner - origin;
        let ([x, y], z) = match &placement {
            Some(placement) => (placement.turned([offset.x, offset.y]), offset.z * placement.height_unit_m),
            None => ([offset.x, offset.y], offset.z),
        };
        *corner = Point3::new(x, y, z);
    }
    Ok(LocalFrame { origin: placement.map(|placement| placement.origin) })
}

fn note_of(placement: &Placement) -> String {
    format!(
        "grid turned by {:.3} degrees to true north and scaled by {:.5}; ground at {:.2} m in the file",
        placement.angle_deg, placement.unit_m, placement.origin.alt_m
    )
}

/// Drops what lies more than `max_extent` from the median of all, and meshes without a face; both are reported.
pub(crate) fn drop_strays(meshes: &mut Vec<RawMesh>, max_extent: f64, report: &mut ImportReport) {
    let centres: Vec<Point3<f64>> = meshes.iter().filter_map(RawMesh::bounds).map(|b| nalgebra::center(&b.min, &b.max)).collect();
    let middle = [0, 1].map(|axis| median(centres.iter().map(|centre| centre[axis])));
    meshes.retain(|mesh| {
        let Some(bounds) = mesh.bounds() else {
            report.add(&mesh.name, mesh.place.clone(), ItemKind::NoGeometry, no_faces(mesh));
            return false;
        };
        let reach = |axis: usize| (bounds.max[axis] - middle[axis]).abs().max((bounds.min[axis] - middle[axis]).abs());
        let distance = libm::hypot(reach(0), reach(1));
        let kept = distance <= max_extent;
        if !kept {
            let km = distance / 1000.0;
            report.add(
                &mesh.name,
                mesh.place.clone(),
                ItemKind::Outlier,
                format!("{km:.0} km from the middle of the scene: left out"),
            );
        }
        kept
    });
}

/// The box around all meshes.
pub(crate) fn bounds(meshes: &[RawMesh]) -> Option<Bounds> {
    meshes.iter().filter_map(RawMesh::bounds).reduce(|a, b| a.union(&b))
}

/// The height of the ground: the median of the meshes' lowest points.
pub(crate) fn ground(meshes: &[RawMesh]) -> f64 {
    median(meshes.iter().filter_map(RawMesh::bounds).map(|bounds| bounds.min.z))
}

/// The structures of meshes in local metres.
pub(crate) fn structures(meshes: Vec<RawMesh>, report: &mut ImportReport) -> Vec<Structure> {
    let mut names = Names::default();
    let mut structures = Vec::with_capacity(meshes.len());
    for mut mesh in meshes {
        let top_m = mesh.bounds().map_or(0.0, |bounds| bounds.max.z);
        if top_m < LEAST_TOP_M {
            report.add(
                &mesh.name,
                mesh.place,
                ItemKind::NoGeometry,
                format!("ends {top_m:.2} m above ground: left out as ground"),
            );
            continue;
        }
        let name = names.unique(&mesh.name);
        if name != mesh.name {
            report.add(
                &name,
                mesh.place.clone(),
                ItemKind::Renamed,
                format!("another structure is called {}: renamed to {name}", mesh.name),
            );
        }
        if mesh.degenerate > 0 {
            let done = format!("{} faces without area dropped", mesh.degenerate);
            report.add(&name, mesh.place.clone(), ItemKind::DegenerateFaces, done);
        }
        let turned = put_in_order(&mut mesh.triangles);
        if turned > 0 {
            report.add(&name, mesh.place, ItemKind::FacesTurned, format!("{turned} triangles of closed bodies turned outwards"));
        }
        if mesh.triangles.is_empty() {
            continue;
        }
        structures.push(Structure { id: StructureId::of_name(&name), name, shape: Shape::Mesh { triangles: mesh.triangles } });
    }
    structures
}

/// Turns closed bodies outwards, leaves slivers out, and returns how many triangles were turned.
pub(crate) fn put_in_order(triangles: &mut Vec<Triangle>) -> usize {
    let turned = orient::turn_outwards(triangles);
    // Slivers hold a surface together while its faces are turned; afterwards a triangle without a normal only does harm.
    triangles.retain(|[a, b, c]| (b - a).cross(&(c - a)).norm() > 2.0 * LEAST_AREA_M2);
    turned
}

fn no_faces(mesh: &RawMesh) -> String {
    match mesh.degenerate {
        0 => "it has no faces: left out".into(),
        count => format!("all of its {count} faces are without area: left out"),
    }
}
