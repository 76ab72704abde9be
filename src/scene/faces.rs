//! Polygon faces in space cut into triangles.

use geo::{LineString, Polygon, TriangulateEarcut};
use nalgebra::{Point3, Vector3};

use super::proxy::Triangle;

/// Smaller faces are degenerate, m^2.
const LEAST_AREA_M2: f64 = 1e-6;

/// The triangles of a face, which run round as its exterior ring does; `None` for a face without area. The rings need not be
/// exactly plane: they are cut in the plane of two axes that the face's normal is farthest from.
pub(crate) fn triangulate(rings: &[Vec<Point3<f64>>]) -> Option<Vec<Triangle>> {
    let rings: Vec<Vec<Point3<f64>>> = rings.iter().map(|ring| without_repeats(ring)).collect();
    let (exterior, holes) = rings.split_first()?;
    if exterior.len() < 3 {
        return None;
    }
    let normal = newell_normal(exterior);
    if !normal.iter().all(|part| part.is_finite()) || normal.norm() / 2.0 < LEAST_AREA_M2 {
        return None;
    }
    if let ([a, b, c], []) = (&exterior[..], holes) {
        return Some(vec![[*a, *b, *c]]);
    }
    let triangles = cut(exterior, holes, normal);
    (!triangles.is_empty()).then_some(triangles)
}

fn without_repeats(ring: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut kept: Vec<Point3<f64>> = Vec::with_capacity(ring.len());
    for point in ring {
        if kept.last() != Some(point) {
            kept.push(*point);
        }
    }
    while kept.len() > 1 && kept.first() == kept.last() {
        kept.pop();
    }
    kept
}

/// Twice the area along the normal (Newell's method), about the first corner so that far coordinates lose nothing.
pub(crate) fn newell_normal(ring: &[Point3<f64>]) -> Vector3<f64> {
    let origin = ring.first().copied().unwrap_or_default();
    ring.iter().zip(ring.iter().cycle().skip(1)).map(|(a, b)| (a - origin).cross(&(b - origin))).sum()
}

fn cut(exterior: &[Point3<f64>], holes: &[Vec<Point3<f64>>], normal: Vector3<f64>) -> Vec<Triangle> {
    let [u, v] = match normal.abs().imax() {
        0 => [1, 2],
        1 => [2, 0],
        _ => [0, 1],
    };
    let origin = exterior[0];
    let flat = |ring: &[Point3<f64>]| -> LineString<f64> {
        ring.iter().map(|point| (point[u] - origin[u], point[v] - origin[v])).collect()
    };
    let holes: Vec<&Vec<Point3<f64>>> = holes.iter().filter(|hole| hole.len() >= 3).collect();
    let polygon = Polygon::new(flat(exterior), holes.iter().map(|hole| flat(hole)).collect());
    let corners: Vec<&Point3<f64>> = exterior.iter().chain(holes.iter().copied().flatten()).collect();
    let indices = polygon.earcut_triangles_raw().triangle_indices;
    let mut triangles: Vec<Triangle> = indices
        .chunks_exact(3)
        .filter_map(|corner| {
            let [a, b, c] = [0, 1, 2].map(|i| corners.get(corner[i]).map(|point| **point));
            Some([a?, b?, c?])
        })
        .collect();
    // All or none: in a face that is not quite plane a sliver may look the other way, yet must keep its place in the surface.
    let around: Vector3<f64> = triangles.iter().map(|[a, b, c]| (b - a).cross(&(c - a))).sum();
    if around.dot(&normal) < 0.0 {
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    triangles
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn area_vector(triangles: &[Triangle]) -> Vector3<f64> {
        triangles.iter().map(|[a, b, c]| (b - a).cross(&(c - a)) / 2.0).sum()
    }

    /// A square of 10 m with a hole of 4 m, upright or level or slanting.
    fn face(east: Vector3<f64>, up: Vector3<f64>) -> Vec<Vec<Point3<f64>>> {
        let at = |a: f64, b: f64| Point3::new(90_000.0, 435_000.0, 3.0) + east * a + up * b;
        vec![
            vec![at(0.0, 0.0), at(10.0, 0.0), at(10.0, 10.0), at(0.0, 10.0), at(0.0, 0.0)],
            vec![at(3.0, 3.0), at(3.0, 7.0), at(7.0, 7.0), at(7.0, 3.0)],
        ]
    }

    proptest! {
        #[test]
        fn area_and_direction_are_kept(a in prop::array::uniform3(-1.0..1.0f64), b in prop::array::uniform3(-1.0..1.0f64)) {
            let (east, other) = (Vector3::from(a), Vector3::from(b));
            prop_assume!(east.norm() > 0.1 && other.cross(&east).norm() > 0.1);
            let east = east.normalize();
            let up = (other - east * other.dot(&east)).normalize();
            let expected = east.cross(&up) * 84.0;
            let triangles = triangulate(&face(east, up)).unwrap();
            prop_assert!((area_vector(&triangles) - expected).norm() < 1e-6);
            let sum: f64 = triangles.iter().map(|triangle| area_vector(std::slice::from_ref(triangle)).norm()).sum();
            prop_assert!((sum - 84.0).abs() < 1e-6);
        }
    }

    #[test]
    fn faces_without_area_are_dropped() {
        let [a, b] = [Point3::origin(), Point3::new(1.0, 2.0, 3.0)];
        for ring in [vec![], vec![a], vec![a, b], vec![a, b, a], vec![a, b, b, a], vec![a, b, a + (b - a) * 2.0]] {
            assert_eq!(triangulate(&[ring]), None);
        }
        assert_eq!(triangulate(&[]), None);
        assert_eq!(triangulate(&[vec![a, b, Point3::new(f64::NAN, 0.0, 0.0)]]), None);
    }
}
