//! Distances and lines of sight to the surfaces of a scene.
//!
//! The only user of parry3d: its bounding volume hierarchies find the candidate triangles, [`super::distance`] decides. The boxes
//! are single precision and a little too large, the decisions are double precision, so that every answer is exact and depends on
//! the triangles alone, not on how the tree happens to be built. What is only asked whether there is any is found in [`super::boxes`], which keeps the
//! hierarchy's order.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode, TraversalAction};
use rayon::prelude::*;

use super::bounds::Bounds;
use super::boxes::{Beam, Boxes};
use super::differences::Differences;
use super::distance::{point_triangle_squared, segment_hits_triangle, segment_triangle_squared};
use super::proxy::{Scene, Structure, Triangle};

/// All triangles of a scene, ready for queries: a hierarchy over the structures, and in each of them one over its triangles, so that an edit
/// makes only those of its own structures anew. Never changes.
#[derive(Debug)]
pub struct Clearance {
    bvh: Bvh,
    boxes: Boxes,
    /// By structure; shared with the scenes before and after an edit.
    bodies: Vec<Arc<Body>>,
    /// Bodies that have triangles, by the leaves of the hierarchy.
    leaves: Vec<usize>,
}

/// The triangles of one structure.
#[derive(Debug)]
struct Body {
    bvh: Bvh,
    boxes: Boxes,
    triangles: Vec<Triangle>,
    is_ground: bool,
}

impl Clearance {
    pub fn new(scene: &Scene) -> Self {
        Self::of_bodies(scene.structures.par_iter().map(|structure| Arc::new(Body::of(structure))).collect())
    }

    /// Of a scene of which these structures are known from an earlier one.
    pub fn after(before: &Self, scene: &Scene, differences: &Differences) -> Self {
        let body = |(structure, kept): (&Arc<Structure>, &Option<usize>)| match kept {
            Some(index) => Arc::clone(&before.bodies[*index]),
            None => Arc::new(Body::of(structure)),
        };
        Self::of_bodies(scene.structures.iter().zip(&differences.kept).map(body).collect())
    }

    /// Only these structures of the scene, by their places in it.
    pub(super) fn only(&self, is_in: impl Fn(usize) -> bool) -> Self {
        let bodies = self.bodies.iter().enumerate().filter(|(index, _)| is_in(*index));
        Self::of_bodies(bodies.map(|(_, body)| Arc::clone(body)).collect())
    }

    /// Only the structures that are in a later scene no more.
    pub fn only_gone(&self, differences: &Differences) -> Self {
        let mut is_gone = vec![true; self.bodies.len()];
        differences.kept.iter().flatten().for_each(|&index| is_gone[index] = false);
        self.only(|index| is_gone[index])
    }

    pub fn of_triangles(triangles: Vec<Triangle>) -> Self {
        Self::of_bodies(vec![Arc::new(Body::new(triangles))])
    }

    fn of_bodies(bodies: Vec<Arc<Body>>) -> Self {
        let leaves: Vec<usize> = (0..bodies.len()).filter(|&index| !bodies[index].triangles.is_empty()).collect();
        let (bvh, boxes) = hierarchy(leaves.iter().map(|&index| bodies[index].bvh.root_aabb()).collect());
        Self { bvh, boxes, bodies, leaves }
    }

    /// Whether a triangle lies between `a` and `b`, the end points excluded.
    pub fn occluded(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        let direction = b - a;
        self.any(&Beam::new(a, b, 0.0), |triangle| segment_hits_triangle(a, &direction, triangle))
    }

    /// Whether the whole segment keeps at least `distance_m` from every triangle.
    pub fn keeps_distance(&self, a: &Point3<f64>, b: &Point3<f64>, distance_m: f64) -> bool {
        let squared = distance_m * distance_m;
        !self.any(&Beam::new(a, b, distance_m), |triangle| segment_triangle_squared(a, b, triangle) < squared)
    }

    /// Distance of `p` to the nearest triangle, m; `cap_m` when that is farther.
    pub fn point_distance_m(&self, p: &Point3<f64>, cap_m: f64) -> f64 {
        self.least(cap_m, |_| true, |node| box_distance_squared(p, node), |triangle| point_triangle_squared(p, triangle))
    }

    /// The same to what stands on the ground: the terrain does not count.
    pub fn standing_distance_m(&self, p: &Point3<f64>, cap_m: f64) -> f64 {
        let is_standing = |body: &Body| !body.is_ground;
        self.least(cap_m, is_standing, |node| box_distance_squared(p, node), |triangle| point_triangle_squared(p, triangle))
    }

    /// Distance of the segment to the nearest triangle, m; `cap_m` when that is farther.
    pub fn segment_distance_m(&self, a: &Point3<f64>, b: &Point3<f64>, cap_m: f64) -> f64 {
        self.segment_distance_to_m(a, b, cap_m, |_| true)
    }

    /// The same to what stands on the ground: the terrain does not count.
    pub fn standing_segment_distance_m(&self, a: &Point3<f64>, b: &Point3<f64>, cap_m: f64) -> f64 {
        self.segment_distance_to_m(a, b, cap_m, |body| !body.is_ground)
    }

    fn segment_distance_to_m(&self, a: &Point3<f64>, b: &Point3<f64>, cap_m: f64, counts: impl Fn(&Body) -> bool) -> f64 {
        let inverse = (b - a).map(|d| 1.0 / d);
        // The slab test gives no distance, so a box counts as near when the segment meets it grown by the cap.
        self.least(
            cap_m,
            counts,
            |node| if segment_meets_box(a, &inverse, node, cap_m) { 0.0 } else { f64::INFINITY },
            |triangle| segment_triangle_squared(a, b, triangle),
        )
    }

    /// The structures of the scene, by their places in it, whose boxes meet a box; perhaps a few more, because the boxes here are a little too large.
    pub fn structures_near(&self, bounds: &Bounds) -> Vec<usize> {
        let (low, high) = (bounds.min, bounds.max);
        let meets = |node: &BvhNode| {
            let (min, max) = (node.mins(), node.maxs());
            (0..3).all(|axis| f64::from(min[axis]) <= high[axis] && low[axis] <= f64::from(max[axis]))
        };
        let found = RefCell::new(Vec::new());
        any_leaf(&self.bvh, &meets, |leaf| {
            found.borrow_mut().push(self.leaves[leaf]);
            false
        });
        let mut found = found.into_inner();
        found.sort_unstable();
        found
    }

    fn any(&self, beam: &Beam, hits: impl Fn(&Triangle) -> bool) -> bool {
        self.boxes.any(beam, |leaf| {
            let body = &self.bodies[self.leaves[leaf]];
            body.boxes.any(beam, |triangle| hits(&body.triangles[triangle]))
        })
    }

    fn least(
        &self,
        cap_m: f64,
        counts: impl Fn(&Body) -> bool,
        bound: impl Fn(&BvhNode) -> f64,
        exact: impl Fn(&Triangle) -> f64,
    ) -> f64 {
        let best = Cell::new(cap_m * cap_m);
        let is_near = |node: &BvhNode| bound(node) < best.get();
        any_leaf(&self.bvh, &is_near, |leaf| {
            let body = &self.bodies[self.leaves[leaf]];
            if !counts(body) {
                return false;
            }
            any_leaf(&body.bvh, &is_near, |triangle| {
                best.set(best.get().min(exact(&body.triangles[triangle])));
                false
            })
        });
        best.get().sqrt()
    }
}

/// The surfaces that only one of two scenes has: what they hide tells which lines of sight have to be looked at again.
#[derive(Debug)]
pub struct Exchange {
    gone: Side,
    come: Side,
}

/// The surfaces that one of the scenes has alone.
#[derive(Debug)]
struct Side {
    clearance: Clearance,
    /// By structure, where these are few: most lines pass by all of them, which is seen sooner here.
    boxes: Option<Vec<Bounds>>,
}

/// Looking through more boxes takes longer than the hierarchy.
const MOST_BOXES: usize = 8;
/// Boxes are taken for so much larger, m, that rounding decides nothing.
const SLACK_M: f64 = 1e-3;

impl Side {
    fn new(clearance: Clearance) -> Self {
        let bodies = || clearance.leaves.iter().map(|&index| &clearance.bodies[index]);
        let of_body = |body: &Arc<Body>| Bounds::of_points(body.triangles.iter().flatten().copied());
        let is_few = clearance.leaves.len() <= MOST_BOXES;
        let boxes = is_few.then(|| bodies().filter_map(of_body).map(|bounds| bounds.grown(SLACK_M)).collect());
        Self { boxes, clearance }
    }

    fn blocks(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        let may_block = self.boxes.as_ref().is_none_or(|boxes| boxes.iter().any(|bounds| bounds.meets_segment(a, b)));
        may_block && self.clearance.occluded(a, b)
    }
}

impl Exchange {
    pub fn between(before: &Clearance, after: &Clearance, differences: &Differences) -> Self {
        let come = after.only(|index| differences.kept[index].is_none());
        Self { gone: Side::new(before.only_gone(differences)), come: Side::new(come) }
    }

    /// Whether the earlier scene has surfaces that the later one has not. Otherwise every line that was blocked is blocked still.
    pub fn is_any_gone(&self) -> bool {
        !self.gone.clearance.leaves.is_empty()
    }

    /// Whether the line from `a` to `b` may be blocked in one of the scenes alone, when in the earlier one it was blocked or not. For a free line the answer
    /// is exact: it is blocked in the later scene if it is here.
    pub fn may_change(&self, was_blocked: bool, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        // What was blocked by nothing that is gone is blocked by something that is still there.
        if was_blocked { self.gone.blocks(a, b) } else { self.come.blocks(a, b) }
    }
}

impl Body {
    fn of(structure: &Structure) -> Self {
        Self { is_ground: structure.terrain().is_some(), ..Self::new(structure.triangles()) }
    }

    fn new(triangles: Vec<Triangle>) -> Self {
        let (bvh, boxes) = hierarchy(triangles.iter().map(outer_box).collect());
        Self { bvh, boxes, triangles, is_ground: false }
    }
}

/// The hierarchy over some boxes, and the same boxes for those who only ask whether there is any.
fn hierarchy(boxes: Vec<Aabb>) -> (Bvh, Boxes) {
    let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
    let order = bvh.leaves(|_| true).collect();
    let corners = |leaf: usize| [boxes[leaf].mins, boxes[leaf].maxs].map(|corner| [corner.x, corner.y, corner.z]);
    (bvh, Boxes::new(order, corners))
}

/// Whether a leaf among the nodes that are met is what is looked for; ends with the first one.
fn any_leaf(bvh: &Bvh, meets: &impl Fn(&BvhNode) -> bool, is_it: impl Fn(usize) -> bool) -> bool {
    let mut found = false;
    bvh.traverse(|node| {
        if !meets(node) {
            return TraversalAction::Prune;
        }
        if node.leaf_data().is_some_and(|leaf| is_it(leaf as usize)) {
            found = true;
            return TraversalAction::EarlyExit;
        }
        TraversalAction::Continue
    });
    found
}

/// The box of a triangle in single precision, grown so that rounding can never cut anything off.
fn outer_box(triangle: &Triangle) -> Aabb {
    let [a, b, c] = triangle;
    let grow = |v: f64| 1e-3 + v.abs() * 2e-7;
    let low = a.coords.inf(&b.coords).inf(&c.coords).map(|v| (v - grow(v)) as f32);
    let high = a.coords.sup(&b.coords).sup(&c.coords).map(|v| (v + grow(v)) as f32);
    Aabb::new(Vector::new(low.x, low.y, low.z), Vector::new(high.x, high.y, high.z))
}

/// Slab test of the segment that starts at `a` and runs for `1 / inverse`, against the node's box grown by `margin_m`.
fn segment_meets_box(a: &Point3<f64>, inverse: &Vector3<f64>, node: &BvhNode, margin_m: f64) -> bool {
    let (low, high) = (node.mins(), node.maxs());
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for (from, inverse, low, high) in
        [(a.x, inverse.x, low.x, high.x), (a.y, inverse.y, low.y, high.y), (a.z, inverse.z, low.z, high.z)]
    {
        let low = (f64::from(low) - margin_m - from) * inverse;
        let high = (f64::from(high) + margin_m - from) * inverse;
        // A segment exactly within a face of the grown box gives 0 * infinity and may be pruned: the triangle is farther away
        // than the growth.
        enter = enter.max(low.min(high));
        leave = leave.min(low.max(high));
    }
    enter <= leave
}

fn box_distance_squared(p: &Point3<f64>, node: &BvhNode) -> f64 {
    let (low, high) = (node.mins(), node.maxs());
    let outside = |v: f64, low: f32, high: f32| (f64::from(low) - v).max(v - f64::from(high)).max(0.0);
    let (x, y, z) = (outside(p.x, low.x, high.x), outside(p.y, low.y, high.y), outside(p.z, low.z, high.z));
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = Point3<f64>> {
        [-50.0..50.0f64, -50.0..50.0f64, 0.0..40.0f64].prop_map(|[x, y, z]| Point3::new(x, y, z))
    }

    fn small_triangle() -> impl Strategy<Value = Triangle> {
        (point(), [-8.0..8.0f64, -8.0..8.0, -8.0..8.0, -8.0..8.0, -8.0..8.0, -8.0..8.0])
            .prop_map(|(p, d)| [p, p + Vector3::new(d[0], d[1], d[2]), p + Vector3::new(d[3], d[4], d[5])])
    }

    proptest! {
        #[test]
        fn queries_agree_with_a_look_at_every_triangle(
            triangles in proptest::collection::vec(small_triangle(), 0..60), a in point(), b in point(), cap in 0.5..60.0f64,
        ) {
            let clearance = Clearance::of_triangles(triangles.clone());
            let direction = b - a;
            prop_assert_eq!(clearance.occluded(&a, &b), triangles.iter().any(|t| segment_hits_triangle(&a, &direction, t)));
            let nearest = triangles.iter().map(|t| segment_triangle_squared(&a, &b, t).sqrt()).fold(cap, f64::min);
            prop_assert_eq!(clearance.segment_distance_m(&a, &b, cap), nearest);
            let too_near = triangles.iter().any(|t| segment_triangle_squared(&a, &b, t) < cap * cap);
            prop_assert_eq!(clearance.keeps_distance(&a, &b, cap), !too_near);
            let to_point = triangles.iter().map(|t| point_triangle_squared(&a, t).sqrt()).fold(cap, f64::min);
            prop_assert_eq!(clearance.point_distance_m(&a, cap), to_point);
        }
    }

    proptest! {
        #[test]
        fn only_lines_that_an_exchange_names_change(
            kept in proptest::collection::vec(small_triangle(), 0..20), gone in proptest::collection::vec(small_triangle(), 0..20),
            come in proptest::collection::vec(small_triangle(), 0..20), a in point(), b in point(),
        ) {
            let of = |bodies: [&Vec<Triangle>; 2]| Clearance::of_bodies(bodies.map(|body| Arc::new(Body::new(body.clone()))).to_vec());
            let (before, after) = (of([&kept, &gone]), of([&come, &kept]));
            let differences = Differences { kept: vec![None, Some(0)], ..Default::default() };
            let exchange = Exchange::between(&before, &after, &differences);
            let (was_blocked, is_blocked) = (before.occluded(&a, &b), after.occluded(&a, &b));
            let may_change = exchange.may_change(was_blocked, &a, &b);
            prop_assert!(may_change || was_blocked == is_blocked);
            prop_assert!(was_blocked || may_change == is_blocked);
        }
    }

    #[test]
    fn a_segment_within_the_plane_of_a_box_face_is_not_lost() {
        let triangle = [Point3::new(0.0, 0.0, 0.0), Point3::new(10.0, 0.0, 0.0), Point3::new(0.0, 10.0, 0.0)];
        let clearance = Clearance::of_triangles(vec![triangle]);
        let (above, below) = (Point3::new(0.0, 2.0, 5.0), Point3::new(0.0, 2.0, -5.0));
        assert!(clearance.occluded(&above, &below));
        assert!(!clearance.keeps_distance(&above, &below, 1.0));
    }
}
