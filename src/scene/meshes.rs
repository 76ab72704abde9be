//! Meshes out of a file made into structures: strays and flat ground left out, faces turned outwards.

use nalgebra::Point3;

use super::bounds::Bounds;
use super::locate::median;
use super::names::Names;
use super::orient;
use super::proxy::{Shape, Structure, StructureId, Triangle};
use super::report::{ImportReport, ItemKind, Place};

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
    fn bounds(&self) -> Option<Bounds> {
        Bounds::of_points(self.triangles.iter().flatten().copied())
    }
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
