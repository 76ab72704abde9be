//! Shapes that edits give, checked, and shapes that they change.

use geo::{Area, Coord, MapCoords, MultiPolygon, Polygon};
use nalgebra::{Point3, Vector3};

use super::{EditError, LEAST_HEIGHT_M};
use crate::scene::bounds::Bounds;
use crate::scene::footprint;
use crate::scene::meshes;
use crate::scene::proxy::{Shape, Triangle};
use crate::scene::report::ItemKind;
use crate::settings::ProxySettings;

/// The shape as a scene holds it, put in order as those of files are; nothing is repaired that would change what is meant.
pub(super) fn checked(name: &str, shape: &Shape, limits: &ProxySettings) -> Result<Shape, EditError> {
    match shape {
        Shape::Prism { footprint, base_m, top_m } => prism(name, footprint, [*base_m, *top_m], limits),
        Shape::Mesh { triangles } => mesh(name, triangles, limits),
        Shape::Obstacle { footprint, base_m, top_m } => {
            check_obstacle(footprint, [*base_m, *top_m], limits).map_err(|problem| EditError::Obstacle {
                name: name.to_owned(),
                problem,
                extent_m: limits.max_extent_m,
                height_m: limits.max_height_m,
            })?;
            Ok(shape.clone())
        }
        Shape::Terrain(_) => Err(EditError::Terrain { name: name.to_owned() }),
    }
}

/// A prism over an outline that needs no repair beyond closing and turning its rings.
fn prism(name: &str, outline: &MultiPolygon<f64>, [base_m, top_m]: [f64; 2], limits: &ProxySettings) -> Result<Shape, EditError> {
    // Written so that NaN is refused too.
    if !(base_m >= 0.0 && top_m - base_m >= LEAST_HEIGHT_M && top_m <= limits.max_height_m) {
        return Err(EditError::Heights { name: name.to_owned(), base_m, top_m, limit_m: limits.max_height_m });
    }
    let limit_m = limits.max_extent_m;
    let refuse = |problem: String| EditError::Outline { name: name.to_owned(), problem, limit_m };
    if !are_near(outline, limit_m) {
        return Err(refuse("a corner is not finite or too far away".into()));
    }
    let mut repairs = Vec::new();
    let footprint = footprint::repair_closed(&outline.0, &mut repairs).map_err(refuse)?;
    match repairs.into_iter().find(|(kind, _)| !HARMLESS.contains(kind)) {
        Some((_, problem)) => Err(refuse(problem)),
        None => Ok(Shape::Prism { footprint, base_m, top_m }),
    }
}

/// Repairs that leave an outline what it was.
const HARMLESS: [ItemKind; 3] = [ItemKind::WrongWinding, ItemKind::OpenRing, ItemKind::DuplicateVertices];

fn are_near(outline: &MultiPolygon<f64>, limit_m: f64) -> bool {
    let rings = |polygon: &Polygon<f64>| -> Vec<Coord> {
        std::iter::once(polygon.exterior()).chain(polygon.interiors()).flat_map(|ring| ring.coords().copied()).collect()
    };
    outline.iter().flat_map(rings).all(|corner| corner.x.abs() <= limit_m && corner.y.abs() <= limit_m)
}

/// A mesh with its closed bodies turned outwards and its slivers left out.
fn mesh(name: &str, triangles: &[Triangle], limits: &ProxySettings) -> Result<Shape, EditError> {
    let (extent_m, height_m) = (limits.max_extent_m, limits.max_height_m);
    let refuse = |problem| EditError::Mesh { name: name.to_owned(), problem, extent_m, height_m };
    let is_near = |corner: &Point3<f64>| {
        corner.x.abs() <= extent_m && corner.y.abs() <= extent_m && corner.z.abs() <= extent_m && corner.z <= height_m
    };
    // Checked first: what is not finite cannot be put in order.
    if !triangles.iter().flatten().all(is_near) {
        return Err(refuse("a corner is not finite or too far away"));
    }
    let mut triangles = triangles.to_vec();
    meshes::put_in_order(&mut triangles);
    let Some(bounds) = Bounds::of_points(triangles.iter().flatten().copied()) else {
        return Err(refuse("none of its triangles has an area"));
    };
    if bounds.max.z < LEAST_HEIGHT_M {
        return Err(refuse("it ends less than 1 m above the ground"));
    }
    Ok(Shape::Mesh { triangles })
}

fn check_obstacle(outline: &MultiPolygon<f64>, [base_m, top_m]: [f64; 2], limits: &ProxySettings) -> Result<(), &'static str> {
    if !are_near(outline, limits.max_extent_m) || outline.0.is_empty() {
        return Err("a corner is not finite or too far away");
    }
    if outline.iter().any(|polygon| polygon.exterior().0.len() < 4 || polygon.unsigned_area() <= 0.0) {
        return Err("it has no extent");
    }
    if !(base_m >= 0.0 && top_m > base_m && top_m <= limits.max_height_m) {
        return Err("it does not end above the ground, or too high");
    }
    Ok(())
}

/// The shape with its heights above its base stretched to another height.
pub(super) fn stretched(shape: &Shape, base_m: f64, height_m: f64, new_height_m: f64) -> Shape {
    let mut shape = shape.clone();
    match &mut shape {
        Shape::Prism { base_m, top_m, .. } | Shape::Obstacle { base_m, top_m, .. } => *top_m = *base_m + new_height_m,
        Shape::Mesh { triangles } => {
            // A level mesh has no height to stretch: it moves as a whole.
            let height =
                |z: f64| if height_m > 0.0 { base_m + (z - base_m) / height_m * new_height_m } else { base_m + new_height_m };
            triangles.iter_mut().flatten().for_each(|corner| corner.z = height(corner.z));
        }
        // No edit comes this far with it.
        Shape::Terrain(_) => {}
    }
    shape
}

pub(super) fn shifted(shape: &Shape, shift: Vector3<f64>) -> Shape {
    let mut shape = shape.clone();
    match &mut shape {
        Shape::Prism { footprint, .. } | Shape::Obstacle { footprint, .. } => {
            *footprint = footprint.map_coords(|corner| Coord { x: corner.x + shift.x, y: corner.y + shift.y });
        }
        Shape::Mesh { triangles } => triangles.iter_mut().flatten().for_each(|corner| *corner += shift),
        Shape::Terrain(_) => {}
    }
    shape
}
