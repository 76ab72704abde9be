//! Triangle meshes: bodies that hang together, and which way their faces look.

use std::collections::HashMap;

use nalgebra::Point3;

use super::proxy::Triangle;

/// Vertices closer than this are one, m.
const WELD_M: f64 = 1e-3;

/// Open edges this near to the lowest point of a body belong to its missing floor, m.
const FLOOR_M: f64 = 0.05;

/// Bodies below this have no inside, m^3.
const LEAST_VOLUME_M3: f64 = 1e-6;

/// Turns the faces of each closed body outwards; a body whose only opening is its floor counts as closed. Other bodies keep their
/// faces as they are. Returns how many triangles were turned.
pub(crate) fn turn_outwards(triangles: &mut [Triangle]) -> usize {
    let corners = weld(triangles);
    let edges = edges(&corners);
    let mut visited = vec![false; triangles.len()];
    let mut turned = 0;
    for seed in 0..triangles.len() {
        if !visited[seed] {
            turned += turn_body(seed, triangles, &corners, &edges, &mut visited);
        }
    }
    turned
}

/// For each triangle the number of the body that it belongs to, from 0 in the order of the triangles: bodies are sets of
/// triangles that share vertices.
pub(crate) fn bodies(triangles: &[Triangle]) -> Vec<usize> {
    let corners = weld(triangles);
    let vertices = corners.iter().flatten().max().map_or(0, |most| most + 1);
    let mut roots: Vec<usize> = (0..vertices).collect();
    for &[a, b, c] in &corners {
        for other in [b, c] {
            let (a, b) = (root(&mut roots, a), root(&mut roots, other));
            roots[a.max(b)] = a.min(b);
        }
    }
    let mut numbers: HashMap<usize, usize> = HashMap::new();
    corners
        .iter()
        .map(|corner| {
            let next = numbers.len();
            *numbers.entry(root(&mut roots, corner[0])).or_insert(next)
        })
        .collect()
}

fn root(roots: &mut [usize], mut vertex: usize) -> usize {
    while roots[vertex] != vertex {
        roots[vertex] = roots[roots[vertex]];
        vertex = roots[vertex];
    }
    vertex
}

/// The corners of the triangles by number, the same number for corners at one place.
pub(crate) fn weld(triangles: &[Triangle]) -> Vec<[usize; 3]> {
    let mut numbers: HashMap<[i64; 3], usize> = HashMap::new();
    let mut number = |point: &Point3<f64>| {
        let next = numbers.len();
        let cell = [point.x, point.y, point.z].map(|metres| (metres / WELD_M).round() as i64);
        *numbers.entry(cell).or_insert(next)
    };
    triangles.iter().map(|triangle| [number(&triangle[0]), number(&triangle[1]), number(&triangle[2])]).collect()
}

/// The triangles at each edge (lower vertex first), with whether they run along it from lower to higher.
type Edges = HashMap<[usize; 2], Vec<(usize, bool)>>;

fn edges(corners: &[[usize; 3]]) -> Edges {
    let mut edges = Edges::with_capacity(corners.len() * 3 / 2);
    for (index, corner) in corners.iter().enumerate() {
        for (key, upwards) in sides(corner) {
            edges.entry(key).or_default().push((index, upwards));
        }
    }
    edges
}

fn sides(corner: &[usize; 3]) -> [([usize; 2], bool); 3] {
    [[0, 1], [1, 2], [2, 0]].map(|[i, j]| {
        let (a, b) = (corner[i], corner[j]);
        ([a.min(b), a.max(b)], a < b)
    })
}

/// Works on the body of `seed`: the triangles reached over edges that exactly two share.
fn turn_body(seed: usize, triangles: &mut [Triangle], corners: &[[usize; 3]], edges: &Edges, visited: &mut [bool]) -> usize {
    let mut flips: HashMap<usize, bool> = HashMap::from([(seed, false)]);
    let mut body = vec![seed];
    let mut consistent = true;
    visited[seed] = true;
    let mut next = 0;
    while let Some(&triangle) = body.get(next) {
        next += 1;
        for (key, upwards) in sides(&corners[triangle]) {
            let [(a, _), (b, _)] = edges[&key][..] else { continue };
            let other = if a == triangle { b } else { a };
            let other_upwards = edges[&key].iter().find(|(index, _)| *index == other).is_some_and(|(_, upwards)| *upwards);
            let flip = flips[&triangle] ^ (upwards == other_upwards);
            match flips.get(&other) {
                Some(known) => consistent &= *known == flip || other == triangle,
                None => {
                    flips.insert(other, flip);
                    visited[other] = true;
                    body.push(other);
                }
            }
        }
    }
    if !consistent || !closed_above_floor(&body, triangles, corners, edges) {
        return 0;
    }
    let volume_m3 = signed_volume(&body, triangles, &flips);
    // A level sheet is no body.
    if volume_m3.abs() < LEAST_VOLUME_M3 {
        return 0;
    }
    let inside_out = volume_m3 < 0.0;
    let mut turned = 0;
    for index in body {
        if flips[&index] != inside_out {
            triangles[index].swap(1, 2);
            turned += 1;
        }
    }
    turned
}

fn closed_above_floor(body: &[usize], triangles: &[Triangle], corners: &[[usize; 3]], edges: &Edges) -> bool {
    let lowest_m = lowest(body, triangles);
    body.iter().all(|&index| {
        sides(&corners[index]).iter().enumerate().all(|(side, (key, _))| {
            let ends = [triangles[index][side], triangles[index][(side + 1) % 3]];
            edges[key].len().is_multiple_of(2) || ends.iter().all(|end| end.z < lowest_m + FLOOR_M)
        })
    })
}

/// About a point of the floor's plane, so that a missing floor takes nothing away.
fn signed_volume(body: &[usize], triangles: &[Triangle], flips: &HashMap<usize, bool>) -> f64 {
    let first = triangles[body[0]][0];
    let origin = Point3::new(first.x, first.y, lowest(body, triangles));
    let volume = |index: &usize| {
        let [a, b, c] = triangles[*index].map(|corner| corner - origin);
        let volume = a.dot(&b.cross(&c)) / 6.0;
        if flips[index] { -volume } else { volume }
    };
    body.iter().map(volume).sum()
}

fn lowest(body: &[usize], triangles: &[Triangle]) -> f64 {
    body.iter().flat_map(|&index| triangles[index]).map(|corner| corner.z).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use geo::{MultiPolygon, polygon};
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{Shape, Structure, StructureId};

    fn court(base_m: f64) -> Vec<Triangle> {
        let footprint = MultiPolygon(vec![polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 30.0, y: 0.0), (x: 30.0, y: 20.0), (x: 0.0, y: 20.0)],
            interiors: [[(x: 8.0, y: 6.0), (x: 8.0, y: 14.0), (x: 20.0, y: 14.0), (x: 20.0, y: 6.0)]],
        )]);
        let shape = Shape::Prism { footprint, base_m, top_m: 12.0 };
        Structure { id: StructureId::of_name("a"), name: "a".into(), shape }.triangles()
    }

    proptest! {
        /// With and without a floor, however many faces look the wrong way.
        #[test]
        fn a_body_comes_out_as_it_was(base_m in prop_oneof![Just(0.0), Just(3.0)], wrong in prop::collection::vec(any::<bool>(), 64)) {
            let sound = court(base_m);
            let mut mixed = sound.clone();
            let mut swapped = 0;
            for (triangle, wrong) in mixed.iter_mut().zip(&wrong) {
                if *wrong {
                    triangle.swap(1, 2);
                    swapped += 1;
                }
            }
            prop_assert_eq!(turn_outwards(&mut mixed), swapped);
            prop_assert_eq!(mixed, sound);
        }
    }

    #[test]
    fn an_open_sheet_keeps_its_faces() {
        let mut sheet = court(3.0)[..4].to_vec();
        sheet[1].swap(0, 1);
        let before = sheet.clone();
        assert_eq!(turn_outwards(&mut sheet), 0);
        assert_eq!(sheet, before);
    }

    #[test]
    fn bodies_are_told_apart() {
        let mut two = court(0.0);
        let first = two.len();
        two.extend(
            court(0.0).into_iter().map(|triangle| triangle.map(|corner| corner + nalgebra::Vector3::new(100.0, 0.0, 0.0))),
        );
        let numbers = bodies(&two);
        assert!(numbers[..first].iter().all(|&number| number == 0));
        assert!(numbers[first..].iter().all(|&number| number == 1));
        assert_eq!(bodies(&[]), Vec::<usize>::new());
    }
}
