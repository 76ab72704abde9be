//! Missing walls of buildings.
//!
//! City models leave out the walls that terraced houses share. A house without its side walls has no inside, and shows none when the
//! neighbour is taken away, so upright openings are filled.

use std::collections::{BTreeMap, HashMap};

use nalgebra::Point3;

use super::faces;
use super::orient;
use super::proxy::Triangle;

/// An opening is upright when its normal is within this of level (sine of the angle).
const UPRIGHT: f64 = 0.1;

/// The corners of an opening may leave its plane by this much, m.
const FLATNESS_M: f64 = 0.3;

/// Smaller openings are left, m^2.
const LEAST_AREA_M2: f64 = 0.1;

/// Fills the upright openings of a mesh and returns how many there were. The walls look the same way as the faces around them.
pub(crate) fn close_walls(triangles: &mut Vec<Triangle>) -> usize {
    let corners = orient::weld(triangles);
    let points = points(triangles, &corners);
    let mut next = missing_edges(&corners);
    let starts: Vec<usize> = next.keys().copied().collect();
    let mut filled = 0;
    for start in starts {
        while let Some(walked) = walk(start, &mut next) {
            for opening in walked {
                let ring: Vec<Point3<f64>> = opening.iter().map(|vertex| points[vertex]).collect();
                if let Some(wall) = wall(ring) {
                    triangles.extend(wall);
                    filled += 1;
                }
            }
        }
    }
    filled
}

fn points(triangles: &[Triangle], corners: &[[usize; 3]]) -> HashMap<usize, Point3<f64>> {
    corners.iter().flatten().copied().zip(triangles.iter().flatten().copied()).collect()
}

/// The edges that a missing face would have: the reverse of each edge that no other face runs along. From each vertex, the
/// vertices that such edges lead to.
fn missing_edges(corners: &[[usize; 3]]) -> BTreeMap<usize, Vec<usize>> {
    let mut balance: BTreeMap<[usize; 2], i64> = BTreeMap::new();
    for &[a, b, c] in corners {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            *balance.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
        }
    }
    let mut next: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for ([low, high], surplus) in balance {
        let (from, to) = if surplus > 0 { (high, low) } else { (low, high) };
        if low != high {
            next.entry(from).or_default().extend(std::iter::repeat_n(to, surplus.unsigned_abs() as usize));
        }
    }
    next
}

/// Follows missing edges from `start` until there are no more, and returns the closed ways found; `None` when none leaves `start`.
/// A way that comes back to a vertex is cut off there, so that each has a vertex only once.
fn walk(start: usize, next: &mut BTreeMap<usize, Vec<usize>>) -> Option<Vec<Vec<usize>>> {
    let mut path = vec![start];
    let mut place: HashMap<usize, usize> = HashMap::from([(start, 0)]);
    let mut closed = Vec::new();
    while let Some(to) = path.last().and_then(|last| next.get_mut(last)).and_then(Vec::pop) {
        match place.get(&to) {
            Some(&at) => {
                let cycle = path.split_off(at);
                cycle.iter().for_each(|vertex| {
                    place.remove(vertex);
                });
                path.push(to);
                place.insert(to, at);
                closed.push(cycle);
            }
            None => {
                place.insert(to, path.len());
                path.push(to);
            }
        }
    }
    (path.len() > 1 || !closed.is_empty()).then_some(closed)
}

/// The face of an opening that is upright, flat and not tiny.
fn wall(ring: Vec<Point3<f64>>) -> Option<Vec<Triangle>> {
    let origin = *ring.first()?;
    let normal = faces::newell_normal(&ring).try_normalize(2.0 * LEAST_AREA_M2)?;
    let flat = ring.iter().all(|corner| (corner - origin).dot(&normal).abs() < FLATNESS_M);
    if normal.z.abs() > UPRIGHT || !flat {
        return None;
    }
    faces::triangulate(&[ring])
}

#[cfg(test)]
mod tests {
    use geo::{MultiPolygon, polygon};
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{Shape, Structure, StructureId};

    fn house() -> Structure {
        let footprint = MultiPolygon(vec![polygon![(x: 0.0, y: 0.0), (x: 6.0, y: 0.0), (x: 6.0, y: 10.0), (x: 0.0, y: 10.0)]]);
        Structure { id: StructureId::of_name("a"), name: "a".into(), shape: Shape::Prism { footprint, base_m: 0.0, top_m: 9.0 } }
    }

    fn meshed(triangles: Vec<Triangle>) -> Structure {
        Structure { shape: Shape::Mesh { triangles }, ..house() }
    }

    fn is_wall(triangle: &Triangle, axis: usize, at: f64) -> bool {
        triangle.iter().all(|corner| (corner[axis] - at).abs() < 1e-9)
    }

    proptest! {
        #[test]
        fn a_terraced_house_gets_its_side_walls_back(x in -3.0..9.0f64, y in -3.0..13.0f64, z in 0.1..12.0f64) {
            let whole = house().triangles();
            let mut open = whole.clone();
            open.retain(|triangle| !is_wall(triangle, 0, 0.0) && !is_wall(triangle, 0, 6.0));
            // A floor, as city models have it, keeps the openings apart.
            let floor = [[0.0, 0.0], [0.0, 10.0], [6.0, 10.0], [6.0, 0.0]].map(|[x, y]| Point3::new(x, y, 0.0));
            open.extend([[floor[0], floor[1], floor[2]], [floor[0], floor[2], floor[3]]]);
            prop_assert_eq!(close_walls(&mut open), 2);
            prop_assert_eq!(open.len(), whole.len() + 2);
            let point = Point3::new(x, y, z);
            prop_assume!(x.abs() > 1e-3 && (x - 6.0).abs() > 1e-3 && y.abs() > 1e-3 && (y - 10.0).abs() > 1e-3 && (z - 9.0).abs() > 1e-3);
            prop_assert_eq!(meshed(open).contains(&point), house().contains(&point));
        }
    }

    #[test]
    fn closed_meshes_and_level_openings_stay_as_they_are() {
        let mut standing = house().triangles();
        assert_eq!(close_walls(&mut standing), 0, "the missing floor is level");
        let mut roofless = standing.clone();
        roofless.retain(|triangle| !is_wall(triangle, 2, 9.0));
        assert_eq!(close_walls(&mut roofless), 0);
        assert_eq!(close_walls(&mut Vec::new()), 0);
    }
}
