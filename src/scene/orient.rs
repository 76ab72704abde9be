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
    let edges = Edges::new(&weld(triangles));
    let mut flips = vec![None; triangles.len()];
    let mut turned = 0;
    for seed in 0..triangles.len() {
        if flips[seed].is_none() {
            turned += turn_body(seed, triangles, &edges, &mut flips);
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
    // Most meshes have fewer vertices than triangles.
    let mut numbers: HashMap<[i64; 3], usize> = HashMap::with_capacity(triangles.len());
    let mut number = |point: &Point3<f64>| {
        let next = numbers.len();
        let cell = [point.x, point.y, point.z].map(|metres| (metres / WELD_M).round() as i64);
        *numbers.entry(cell).or_insert(next)
    };
    triangles.iter().map(|triangle| [number(&triangle[0]), number(&triangle[1]), number(&triangle[2])]).collect()
}

/// A triangle at an edge, and whether it runs along it from the lower vertex to the higher.
#[derive(Clone, Copy)]
struct Side {
    triangle: usize,
    upwards: bool,
}

/// Which triangles meet at which edges.
struct Edges {
    /// By triangle the edges of its sides.
    of: Vec<[usize; 3]>,
    /// By edge where its triangles begin in `sides`; behind the last edge the end.
    first: Vec<usize>,
    sides: Vec<Side>,
}

impl Edges {
    fn new(corners: &[[usize; 3]]) -> Self {
        let ends = |number: usize| [corners[number / 3][number % 3], corners[number / 3][(number + 1) % 3]].map(|end| end as u32);
        // Sides are numbered through all triangles, and come in their order at each edge.
        let of_side = |number: usize| {
            let [from, to] = ends(number);
            ([from.min(to), from.max(to)], number as u32)
        };
        let mut all: Vec<([u32; 2], u32)> = (0..3 * corners.len()).map(of_side).collect();
        all.sort_unstable();
        let (mut of, mut first, mut end) = (vec![[0; 3]; corners.len()], vec![0], 0);
        for (edge, sides) in all.chunk_by(|(one, _), (other, _)| one == other).enumerate() {
            sides.iter().for_each(|&(_, number)| of[number as usize / 3][number as usize % 3] = edge);
            end += sides.len();
            first.push(end);
        }
        let side = |(_, number): ([u32; 2], u32)| {
            let [from, to] = ends(number as usize);
            Side { triangle: number as usize / 3, upwards: from < to }
        };
        Self { of, first, sides: all.into_iter().map(side).collect() }
    }

    /// The triangles at a side of one of them.
    fn at(&self, triangle: usize, side: usize) -> &[Side] {
        let edge = self.of[triangle][side];
        &self.sides[self.first[edge]..self.first[edge + 1]]
    }
}

/// Works on the body of `seed`: the triangles reached over edges that exactly two share. `flips` says of those that were reached whether they look the other
/// way than the first one of their body.
fn turn_body(seed: usize, triangles: &mut [Triangle], edges: &Edges, flips: &mut [Option<bool>]) -> usize {
    let mut body = vec![seed];
    let mut consistent = true;
    flips[seed] = Some(false);
    let mut next = 0;
    while let Some(&triangle) = body.get(next) {
        next += 1;
        for side in 0..3 {
            let &[a, b] = edges.at(triangle, side) else { continue };
            let (own, other) = if a.triangle == triangle { (a, b) } else { (b, a) };
            let flip = (flips[triangle] == Some(true)) ^ (own.upwards == other.upwards);
            match flips[other.triangle] {
                Some(known) => consistent &= known == flip || other.triangle == triangle,
                None => {
                    flips[other.triangle] = Some(flip);
                    body.push(other.triangle);
                }
            }
        }
    }
    if !consistent || !closed_above_floor(&body, triangles, edges) {
        return 0;
    }
    let is_flipped = |index: usize| flips[index] == Some(true);
    let volume_m3 = signed_volume(&body, triangles, is_flipped);
    // A level sheet is no body.
    if volume_m3.abs() < LEAST_VOLUME_M3 {
        return 0;
    }
    let inside_out = volume_m3 < 0.0;
    let mut turned = 0;
    for index in body {
        if is_flipped(index) != inside_out {
            triangles[index].swap(1, 2);
            turned += 1;
        }
    }
    turned
}

fn closed_above_floor(body: &[usize], triangles: &[Triangle], edges: &Edges) -> bool {
    let lowest_m = lowest(body, triangles);
    body.iter().all(|&index| {
        (0..3).all(|side| {
            let ends = [triangles[index][side], triangles[index][(side + 1) % 3]];
            edges.at(index, side).len().is_multiple_of(2) || ends.iter().all(|end| end.z < lowest_m + FLOOR_M)
        })
    })
}

/// About a point of the floor's plane, so that a missing floor takes nothing away.
fn signed_volume(body: &[usize], triangles: &[Triangle], is_flipped: impl Fn(usize) -> bool) -> f64 {
    let first = triangles[body[0]][0];
    let origin = Point3::new(first.x, first.y, lowest(body, triangles));
    let volume = |&index: &usize| {
        let [a, b, c] = triangles[index].map(|corner| corner - origin);
        let volume = a.dot(&b.cross(&c)) / 6.0;
        if is_flipped(index) { -volume } else { volume }
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
    fn a_body_with_a_hole_in_its_roof_keeps_its_faces() {
        // The faces of the roof come first.
        let mut open = court(0.0)[1..].to_vec();
        open[3].swap(0, 1);
        let before = open.clone();
        assert_eq!(turn_outwards(&mut open), 0);
        assert_eq!(open, before);
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
