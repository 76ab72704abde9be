//! The solids of the structures: surface, box, outline from above, and the test for being inside.

use std::collections::HashMap;

use geo::orient::{Direction, Orient};
use geo::{
    Area, BooleanOps, BoundingRect, Contains, ConvexHull, LineString, MultiPoint, MultiPolygon, Point, Polygon, Rect,
    TriangulateEarcut,
};
use nalgebra::{Point3, Vector3};

use super::bounds::Bounds;
use super::proxy::{Scene, Shape, Structure, Triangle};

/// A mesh whose lowest vertex lies below this stands on the ground, so its missing floor does not matter, m.
const STANDS_ON_GROUND_M: f64 = 1.0;

/// Parts of an outline below this area are noise of the union, m^2.
const OUTLINE_NOISE_M2: f64 = 0.01;

/// So many triangles are united in one go.
const MOST_AT_ONCE: usize = 512;

impl Scene {
    /// The box around all structures on the ground; `None` for a scene without structures.
    pub fn bounds(&self) -> Option<Bounds> {
        let standing = self.structures.iter().filter(|structure| structure.terrain().is_none());
        standing.map(|structure| structure.bounds()).reduce(|a, b| a.union(&b))
    }
}

impl Structure {
    /// The surface, counter-clockwise seen from outside. The floor of a prism that stands on the ground is left out.
    pub fn triangles(&self) -> Vec<Triangle> {
        match &self.shape {
            Shape::Mesh { triangles } => triangles.clone(),
            Shape::Prism { footprint, base_m, top_m } | Shape::Obstacle { footprint, base_m, top_m } => {
                prism_triangles(footprint, *base_m, *top_m)
            }
            Shape::Terrain(terrain) => terrain.triangles(),
        }
    }

    pub fn bounds(&self) -> Bounds {
        let bounds = match &self.shape {
            Shape::Mesh { triangles } => Bounds::of_points(triangles.iter().flatten().copied()),
            Shape::Prism { footprint, base_m, top_m } | Shape::Obstacle { footprint, base_m, top_m } => {
                Bounds::above(footprint, *base_m, *top_m)
            }
            Shape::Terrain(terrain) => Some(terrain.bounds()),
        };
        bounds.unwrap_or(Bounds { min: Point3::origin(), max: Point3::origin() })
    }

    /// The surface that is to be captured, m^2, without cutting it into triangles first where that is not needed.
    pub fn surface_m2(&self) -> f64 {
        match &self.shape {
            Shape::Mesh { triangles } => triangles.iter().map(area_m2).sum(),
            Shape::Obstacle { .. } | Shape::Terrain(_) => 0.0,
            Shape::Prism { footprint, base_m, top_m } => {
                let rings = footprint.iter().flat_map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()));
                let edges_m: f64 = rings.flat_map(|ring| ring.lines()).map(|edge| edge.delta().x.hypot(edge.delta().y)).sum();
                let flat_sides = if *base_m > 0.0 { 2.0 } else { 1.0 };
                footprint.unsigned_area() * flat_sides + edges_m * (top_m - base_m)
            }
        }
    }

    /// The structure seen from above, m: exterior rings counter-clockwise, holes clockwise. The terrain, which is everywhere, has no outline.
    pub fn outlines(&self) -> MultiPolygon<f64> {
        match &self.shape {
            Shape::Prism { footprint, .. } | Shape::Obstacle { footprint, .. } => footprint.clone(),
            Shape::Mesh { triangles } => shadow(triangles),
            Shape::Terrain(_) => MultiPolygon(Vec::new()),
        }
    }

    /// Whether nothing gets inside without passing through the surface.
    pub fn is_closed(&self) -> bool {
        match &self.shape {
            Shape::Prism { .. } | Shape::Obstacle { .. } | Shape::Terrain(_) => true,
            Shape::Mesh { triangles } => is_closed(triangles),
        }
    }

    /// Whether `point` lies inside the solid. A mesh need not be closed: its generalised winding number decides (Jacobson et
    /// al., "Robust inside-outside segmentation using generalized winding numbers", 2013), taken together with its mirror image
    /// in the ground plane when it stands on the ground.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        match &self.shape {
            Shape::Prism { footprint, base_m, top_m } | Shape::Obstacle { footprint, base_m, top_m } => {
                *base_m < point.z && point.z < *top_m && footprint.contains(&Point::new(point.x, point.y))
            }
            Shape::Mesh { triangles } => {
                let bounds = self.bounds();
                bounds.contains(point) && winding_number(triangles, point, bounds.min.z < STANDS_ON_GROUND_M) > 0.5
            }
            Shape::Terrain(terrain) => terrain.contains(point),
        }
    }
}

/// Area of a triangle, m^2.
pub fn area_m2([a, b, c]: &Triangle) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// Whether each edge of the surface is passed as often one way as the other, so that no line gets in without meeting it.
fn is_closed(triangles: &[Triangle]) -> bool {
    // Adding zero makes the two zeros one.
    let key = |corner: &Point3<f64>| corner.coords.map(|v| (v + 0.0).to_bits()).into();
    let mut passes: HashMap<[[u64; 3]; 2], i32> = HashMap::with_capacity(2 * triangles.len());
    for corners in triangles {
        for k in 0..3 {
            let (from, to): ([u64; 3], [u64; 3]) = (key(&corners[k]), key(&corners[(k + 1) % 3]));
            let (edge, way) = if from < to { ([from, to], 1) } else { ([to, from], -1) };
            *passes.entry(edge).or_default() += way;
        }
    }
    passes.values().all(|passes| *passes == 0)
}

fn prism_triangles(footprint: &MultiPolygon<f64>, base_m: f64, top_m: f64) -> Vec<Triangle> {
    let mut triangles = Vec::new();
    for polygon in footprint {
        for corners in flat_triangles(polygon) {
            let [a, b, c] = corners.map(|[x, y]| Point3::new(x, y, top_m));
            triangles.push([a, b, c]);
            if base_m > 0.0 {
                let [a, b, c] = corners.map(|[x, y]| Point3::new(x, y, base_m));
                triangles.push([a, c, b]);
            }
        }
        for ring in std::iter::once(polygon.exterior()).chain(polygon.interiors()) {
            for edge in ring.lines() {
                let [a, b] = [edge.start, edge.end].map(|end| Point3::new(end.x, end.y, base_m));
                let [above_a, above_b] = [edge.start, edge.end].map(|end| Point3::new(end.x, end.y, top_m));
                triangles.push([a, b, above_b]);
                triangles.push([a, above_b, above_a]);
            }
        }
    }
    triangles
}

/// A polygon cut into counter-clockwise triangles.
fn flat_triangles(polygon: &Polygon<f64>) -> Vec<[[f64; 2]; 3]> {
    if polygon.exterior().0.len() < 4 || polygon.interiors().iter().any(|hole| hole.0.len() < 4) {
        return Vec::new();
    }
    let cut = polygon.earcut_triangles_raw();
    let corners = cut.triangle_indices.chunks_exact(3).map(|corner| [0, 1, 2].map(|i| cut.vertices[corner[i]]));
    corners.filter_map(counter_clockwise).collect()
}

/// The triangle turned counter-clockwise; `None` when it has no area.
fn counter_clockwise([a, b, c]: [[f64; 2]; 3]) -> Option<[[f64; 2]; 3]> {
    let doubled_m2 = cross(a, b, c);
    (doubled_m2.abs() > 1e-8).then_some(if doubled_m2 < 0.0 { [a, c, b] } else { [a, b, c] })
}

fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The union of the projected triangles. A structure of upright sheets has none: then the hull of its vertices, and when that is
/// a line too, its box grown to 10 cm.
fn shadow(triangles: &[Triangle]) -> MultiPolygon<f64> {
    let flat: Vec<_> = triangles
        .iter()
        .map(|corners| corners.map(|corner| [corner.x, corner.y]))
        .filter_map(counter_clockwise)
        .map(|corners| Polygon::new(LineString::from(corners.to_vec()), Vec::new()))
        .collect();
    let mut united = united_all(&flat).orient(Direction::Default);
    united.0.retain(|polygon| polygon.unsigned_area() > OUTLINE_NOISE_M2);
    for polygon in &mut united.0 {
        let (exterior, mut holes) = std::mem::replace(polygon, Polygon::empty()).into_inner();
        holes.retain(|hole| Polygon::new(hole.clone(), Vec::new()).unsigned_area() > OUTLINE_NOISE_M2);
        *polygon = Polygon::new(exterior, holes);
    }
    if !united.0.is_empty() {
        return united;
    }
    let points: MultiPoint<f64> = triangles.iter().flatten().map(|corner| Point::new(corner.x, corner.y)).collect();
    let hull = points.convex_hull();
    if hull.unsigned_area() > OUTLINE_NOISE_M2 {
        return MultiPolygon(vec![hull.orient(Direction::Default)]);
    }
    let Some(rect) = points.bounding_rect() else { return MultiPolygon(Vec::new()) };
    let margin_m = 0.05;
    let grown = Rect::new((rect.min().x - margin_m, rect.min().y - margin_m), (rect.max().x + margin_m, rect.max().y + margin_m));
    MultiPolygon(vec![grown.to_polygon().orient(Direction::Default)])
}

/// Many triangles are united in halves: random triangles cross each other in a number that grows with the square of theirs, but
/// their union is simple.
fn united_all(polygons: &[Polygon<f64>]) -> MultiPolygon<f64> {
    if polygons.len() <= MOST_AT_ONCE {
        return geo::unary_union(polygons);
    }
    let (left, right) = polygons.split_at(polygons.len() / 2);
    united_all(left).union(&united_all(right))
}

/// How often the surface winds round `point`: 1 inside, 0 outside, in between where the surface has gaps.
fn winding_number(triangles: &[Triangle], point: &Point3<f64>, with_mirror_image: bool) -> f64 {
    let mut angle = AngleSum::default();
    triangles.iter().for_each(|triangle| angle.add_solid_angle(triangle, point));
    if with_mirror_image {
        let image = Point3::new(point.x, point.y, -point.z);
        // The mirrored surface seen from the point is the surface seen from the mirrored point, turned inside out twice.
        triangles.iter().for_each(|triangle| angle.add_solid_angle(triangle, &image));
    }
    // A whole turn of half solid angles is 2 pi.
    angle.turns()
}

/// A sum of angles without an arc tangent for each: unit complex numbers are multiplied, and passing the negative real axis is
/// counted.
struct AngleSum {
    re: f64,
    im: f64,
    whole_turns: i32,
}

impl Default for AngleSum {
    fn default() -> Self {
        Self { re: 1.0, im: 0.0, whole_turns: 0 }
    }
}

impl AngleSum {
    /// Adds half the signed solid angle of a triangle (van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30(2), 1983), positive
    /// from inside.
    fn add_solid_angle(&mut self, triangle: &Triangle, point: &Point3<f64>) {
        let [a, b, c]: [Vector3<f64>; 3] = triangle.map(|corner| corner - point);
        let [length_a, length_b, length_c] = [a.norm(), b.norm(), c.norm()];
        let volume = a.dot(&b.cross(&c));
        let spread = length_a * length_b * length_c + a.dot(&b) * length_c + b.dot(&c) * length_a + c.dot(&a) * length_b;
        self.add(spread, volume);
    }

    /// Adds the angle of the complex number `re + i im`.
    fn add(&mut self, re: f64, im: f64) {
        let size = re.abs() + im.abs();
        if size == 0.0 {
            return;
        }
        let (re, im) = (re / size, im / size);
        let (was_above, adds_above) = (self.im >= 0.0, im >= 0.0);
        (self.re, self.im) = (self.re * re - self.im * im, self.re * im + self.im * re);
        let scale = self.re.abs() + self.im.abs();
        (self.re, self.im) = (self.re / scale, self.im / scale);
        // Two angles of one sign whose sum has the other sign have passed half a turn.
        if was_above == adds_above && (self.im >= 0.0) != was_above {
            self.whole_turns += if was_above { 1 } else { -1 };
        }
    }

    fn turns(&self) -> f64 {
        f64::from(self.whole_turns) + libm::atan2(self.im, self.re) / (2.0 * std::f64::consts::PI)
    }
}

#[cfg(test)]
mod tests {
    use geo::polygon;
    use proptest::prelude::*;

    use super::*;
    use crate::scene::StructureId;
    use crate::scene::clearance::Clearance;

    fn structure(shape: Shape) -> Structure {
        Structure { id: StructureId::of_name("a"), name: "a".into(), shape }
    }

    fn court() -> MultiPolygon<f64> {
        MultiPolygon(vec![
            polygon!(
                exterior: [(x: 0.0, y: 0.0), (x: 30.0, y: 0.0), (x: 30.0, y: 20.0), (x: 12.0, y: 25.0), (x: 0.0, y: 20.0)],
                interiors: [[(x: 8.0, y: 6.0), (x: 8.0, y: 14.0), (x: 20.0, y: 14.0), (x: 20.0, y: 6.0)]],
            ),
            polygon![(x: 40.0, y: 0.0), (x: 44.0, y: 0.0), (x: 40.0, y: 9.0)],
        ])
    }

    proptest! {
        #[test]
        fn angles_add_up_as_their_arc_tangents_do(numbers in proptest::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 0..40)) {
            let mut sum = AngleSum::default();
            numbers.iter().for_each(|&(re, im)| sum.add(re, im));
            let expected: f64 = numbers.iter().map(|&(re, im)| im.atan2(re)).sum::<f64>() / (2.0 * std::f64::consts::PI);
            prop_assert!((sum.turns() - expected).abs() < 1e-9, "{} against {expected}", sum.turns());
        }
    }

    fn signed_volume(triangles: &[Triangle]) -> f64 {
        triangles.iter().map(|[a, b, c]| a.coords.dot(&b.coords.cross(&c.coords)) / 6.0).sum()
    }

    #[test]
    fn a_prism_encloses_its_volume() {
        let footprint = court();
        let area = footprint.unsigned_area();
        let floating = structure(Shape::Prism { footprint: footprint.clone(), base_m: 4.0, top_m: 10.0 });
        assert!((signed_volume(&floating.triangles()) - area * 6.0).abs() < 1e-6);
        // The missing floor lies in the plane z = 0 and takes nothing from the sum.
        let standing = structure(Shape::Prism { footprint, base_m: 0.0, top_m: 10.0 });
        assert!((signed_volume(&standing.triangles()) - area * 10.0).abs() < 1e-6);
        assert!(standing.triangles().len() < floating.triangles().len());
    }

    #[test]
    fn a_mesh_casts_the_outline_of_its_prism() {
        let prism = structure(Shape::Prism { footprint: court(), base_m: 0.0, top_m: 10.0 });
        let mesh = structure(Shape::Mesh { triangles: prism.triangles() });
        let outline = mesh.outlines();
        assert!((outline.unsigned_area() - court().unsigned_area()).abs() < 0.01);
        assert!(outline.signed_area() > 0.0);
        assert_eq!(outline.0.iter().map(|polygon| polygon.interiors().len()).sum::<usize>(), 1);
        assert_eq!(mesh.bounds(), prism.bounds());
    }

    #[test]
    fn a_surface_with_a_hole_is_not_closed() {
        let of = |triangles: Vec<Triangle>| structure(Shape::Mesh { triangles });
        let mut triangles = structure(Shape::Prism { footprint: court(), base_m: 4.0, top_m: 10.0 }).triangles();
        assert!(of(triangles.clone()).is_closed());
        let lost = triangles.pop().expect("it has triangles");
        assert!(!of(triangles.clone()).is_closed());
        triangles.push([lost[0], lost[2], lost[1]]);
        assert!(!of(triangles).is_closed(), "turned round it closes nothing");
    }

    proptest! {
        #[test]
        fn a_line_that_meets_no_closed_surface_stays_inside_or_outside(
            a in [-5.0..50.0f64, -5.0..30.0, 0.5..16.0], b in [-5.0..50.0f64, -5.0..30.0, 0.5..16.0],
        ) {
            let prism = structure(Shape::Prism { footprint: court(), base_m: 4.0, top_m: 10.0 });
            let mesh = structure(Shape::Mesh { triangles: prism.triangles() });
            let (a, b) = (Point3::from(a), Point3::from(b));
            if !Clearance::of_triangles(prism.triangles()).occluded(&a, &b) {
                prop_assert_eq!(mesh.contains(&a), mesh.contains(&b));
            }
        }
    }

    #[test]
    fn an_upright_sheet_has_an_outline_too() {
        let [a, b, c] = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 0.0, 5.0]].map(Point3::from);
        let outline = structure(Shape::Mesh { triangles: vec![[a, b, c]] }).outlines();
        assert!((outline.unsigned_area() - 10.1 * 0.1).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn inside_the_mesh_is_inside_the_prism(
            base_m in prop_oneof![Just(0.0), 2.0..8.0f64],
            x in -5.0..50.0f64, y in -5.0..30.0f64, z in 0.05..16.0f64,
        ) {
            let prism = structure(Shape::Prism { footprint: court(), base_m, top_m: 12.0 });
            let mesh = structure(Shape::Mesh { triangles: prism.triangles() });
            let point = Point3::new(x, y, z);
            use geo::{Distance, Euclidean};
            let off_walls = court().0.iter().all(|polygon| {
                std::iter::once(polygon.exterior()).chain(polygon.interiors()).all(|ring| Euclidean.distance(&Point::new(x, y), ring) > 1e-3)
            });
            prop_assume!(off_walls && (z - base_m).abs() > 1e-3 && (z - 12.0).abs() > 1e-3);
            prop_assert_eq!(prism.contains(&point), mesh.contains(&point));
        }
    }
}
