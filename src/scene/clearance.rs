//! Distances and lines of sight to the surfaces of a scene.
//!
//! The boxes of [`super::hierarchy`] find the candidate triangles, [`super::distance`] decides. The boxes are single precision and a little too large, the
//! decisions are double precision, so that every answer is exact and depends on the triangles alone, not on how the trees happen to be built.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use nalgebra::Point3;
use rayon::prelude::*;

use super::bounds::Bounds;
use super::boxes::Beam;
use super::differences::Differences;
use super::distance::{point_triangle_squared, segment_hits_triangle, segment_triangle_squared};
use super::hierarchy::{BvhNode, GONE, Group, Hierarchy, box_distance_squared, segment_meets_box};
use super::proxy::{Scene, Structure, Triangle};

/// All triangles of a scene, ready for queries: a hierarchy over the structures, and in each of them one over its triangles, so that an edit
/// makes only those of its own structures anew. Never changes.
#[derive(Debug)]
pub struct Clearance {
    /// By structure; shared with the scenes before and after an edit.
    bodies: Vec<Arc<Body>>,
    /// Most of them, in a hierarchy that is shared as well: that of a city takes longer than everything else about an edit's free space.
    early: Group,
    /// Those that have come since that was made.
    late: Group,
}

/// The triangles of one structure.
#[derive(Debug)]
struct Body {
    hierarchy: Hierarchy,
    triangles: Vec<Triangle>,
    is_ground: bool,
}

/// When more than one in so many has come or gone, all are put into one hierarchy again.
const SHARE_KEPT: usize = 16;

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
        Self::of_bodies_after(before, scene.structures.iter().zip(&differences.kept).map(body).collect(), &differences.kept)
    }

    /// The same of bodies that are the earlier ones at the places `kept`.
    fn of_bodies_after(before: &Self, bodies: Vec<Arc<Body>>, kept: &[Option<usize>]) -> Self {
        let mut now = vec![GONE; before.bodies.len()];
        kept.iter().zip(0..).for_each(|(kept, place)| kept.iter().for_each(|&old| now[old] = place));
        let early = before.early.moved(&now);
        let mut is_late = vec![true; bodies.len()];
        early.structures().for_each(|place| is_late[place] = false);
        let late: Vec<u32> = with_triangles(&bodies, |place| is_late[place]).collect();
        if (late.len() + early.gone()) * SHARE_KEPT > bodies.len() {
            return Self::of_bodies(bodies);
        }
        Self { late: group(&bodies, late), early, bodies }
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
        let early = group(&bodies, with_triangles(&bodies, |_| true).collect());
        Self { early, late: group(&bodies, Vec::new()), bodies }
    }

    /// The structures that have triangles.
    fn standing(&self) -> impl Iterator<Item = &Body> {
        self.bodies.iter().map(AsRef::as_ref).filter(|body| !body.triangles.is_empty())
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
        for group in [&self.early, &self.late] {
            group.any_met(&meets, |place| {
                found.borrow_mut().push(place);
                false
            });
        }
        let mut found = found.into_inner();
        found.sort_unstable();
        found
    }

    fn any(&self, beam: &Beam, hits: impl Fn(&Triangle) -> bool) -> bool {
        let is_hit = |place: usize| {
            let body = &self.bodies[place];
            body.hierarchy.any_near(beam, |triangle| hits(&body.triangles[triangle]))
        };
        self.early.any_near(beam, is_hit) || self.late.any_near(beam, is_hit)
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
        let look = |place: usize| {
            let body = &self.bodies[place];
            if !counts(body) {
                return false;
            }
            body.hierarchy.any_met(&is_near, |triangle| {
                best.set(best.get().min(exact(&body.triangles[triangle])));
                false
            })
        };
        for group in [&self.early, &self.late] {
            group.any_met(&is_near, look);
        }
        best.get().sqrt()
    }
}

fn group(bodies: &[Arc<Body>], places: Vec<u32>) -> Group {
    Group::of(places, |place| &bodies[place].hierarchy)
}

/// The places of the structures that have triangles; no other than those at the places asked for is looked at.
fn with_triangles(bodies: &[Arc<Body>], is_asked: impl Fn(usize) -> bool) -> impl Iterator<Item = u32> {
    let places = (0..bodies.len()).filter(move |&place| is_asked(place) && !bodies[place].triangles.is_empty());
    places.map(|place| place as u32)
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
        let of_body = |body: &Body| Bounds::of_points(body.triangles.iter().flatten().copied());
        let is_few = clearance.standing().count() <= MOST_BOXES;
        let boxes = is_few.then(|| clearance.standing().filter_map(of_body).map(|bounds| bounds.grown(SLACK_M)).collect());
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
        self.gone.clearance.standing().next().is_some()
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
        Self { hierarchy: Hierarchy::of_triangles(&triangles), triangles, is_ground: false }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
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

    proptest! {
        /// Structures come, go and come back; what is shared with the scenes before decides nothing.
        #[test]
        fn queries_after_edits_are_those_of_a_scene_made_anew(
            triangles in proptest::collection::vec(small_triangle(), 64), edits in proptest::collection::vec(0..64usize, 1..24), a in point(),
            cap in 0.5..60.0f64,
        ) {
            let bodies: Vec<Arc<Body>> = triangles.iter().map(|triangle| Arc::new(Body::new(vec![*triangle]))).collect();
            // Half of them stand at first.
            let mut standing: Vec<usize> = (0..64).step_by(2).collect();
            let of = |standing: &[usize]| -> Vec<Arc<Body>> { standing.iter().map(|&k| Arc::clone(&bodies[k])).collect() };
            let mut clearance = Clearance::of_bodies(of(&standing));
            for edited in edits {
                let before = standing.clone();
                match standing.binary_search(&edited) {
                    Ok(place) => drop(standing.remove(place)),
                    Err(place) => standing.insert(place, edited),
                }
                let kept: Vec<Option<usize>> = standing.iter().map(|k| before.binary_search(k).ok()).collect();
                clearance = Clearance::of_bodies_after(&clearance, of(&standing), &kept);
                let anew = Clearance::of_bodies(of(&standing));
                // Lines through each of them, and through those that do not stand.
                for [p, q, r] in &triangles {
                    let through = a + (nalgebra::center(p, &nalgebra::center(q, r)) - a) * 1.5;
                    let around = Bounds { min: a.inf(&through), max: a.sup(&through) };
                    prop_assert_eq!(clearance.structures_near(&around), anew.structures_near(&around));
                    prop_assert_eq!(clearance.occluded(&a, &through), anew.occluded(&a, &through));
                    for distance_m in [0.1, cap] {
                        prop_assert_eq!(clearance.keeps_distance(&a, p, distance_m), anew.keeps_distance(&a, p, distance_m));
                    }
                    prop_assert_eq!(clearance.segment_distance_m(&a, &through, cap), anew.segment_distance_m(&a, &through, cap));
                    prop_assert_eq!(clearance.point_distance_m(p, cap), anew.point_distance_m(p, cap));
                }
            }
        }
    }

    #[test]
    fn an_edit_leaves_most_structures_in_the_hierarchy_that_was_made_before_it() {
        let at =
            |x: f64| Arc::new(Body::new(vec![[Point3::new(x, 0.0, 0.0), Point3::new(x, 5.0, 0.0), Point3::new(x, 0.0, 5.0)]]));
        let mut bodies: Vec<Arc<Body>> = (0..64).map(|k| at(f64::from(k))).collect();
        let before = Clearance::of_bodies(bodies.clone());
        bodies[10] = at(-20.0);
        let kept: Vec<Option<usize>> = (0..64).map(|k| (k != 10).then_some(k)).collect();
        let after = Clearance::of_bodies_after(&before, bodies, &kept);
        assert!(after.early.shares_hierarchy_with(&before.early));
        assert_eq!((after.early.gone(), after.late.structures().collect::<Vec<_>>()), (1, vec![10]));
        let line = |x: f64| (Point3::new(x - 0.4, 1.0, 1.0), Point3::new(x + 0.4, 1.0, 1.0));
        let is_blocked = |clearance: &Clearance, (a, b): (Point3<f64>, Point3<f64>)| clearance.occluded(&a, &b);
        assert!(is_blocked(&before, line(10.0)) && !is_blocked(&after, line(10.0)));
        assert!(is_blocked(&after, line(-20.0)) && !is_blocked(&before, line(-20.0)));
        // When much has changed there is a new one.
        let all_new = Clearance::of_bodies_after(&after, (0..64).map(|k| at(f64::from(k))).collect(), &[None; 64]);
        assert!(!all_new.early.shares_hierarchy_with(&after.early));
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
