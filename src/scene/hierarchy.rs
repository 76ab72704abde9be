//! Hierarchies of boxes around triangles and around structures: what lies near enough to be looked at.
//!
//! The only user of parry3d, whose glam vectors go no further. What is only asked whether there is any is found in [`super::boxes`], which keeps the order of
//! parry3d's leaves.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
pub use parry3d::partitioning::BvhNode;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, TraversalAction};

use super::boxes::{Beam, Boxes};
use super::proxy::Triangle;

/// Some of the structures in a hierarchy.
#[derive(Debug)]
pub struct Group {
    hierarchy: Arc<Hierarchy>,
    /// By leaf the structure's place in the scene; [`GONE`] where it is there no more.
    places: Vec<u32>,
}

/// Boxes, to be searched for the nearest one, and for whether there is any.
#[derive(Debug)]
pub struct Hierarchy {
    bvh: Bvh,
    boxes: Boxes,
}

/// The place of what is not in the scene any more.
pub const GONE: u32 = u32::MAX;

impl Group {
    /// Structures at some places of the scene, with the hierarchies of their own triangles.
    pub fn of<'h>(places: Vec<u32>, own: impl Fn(usize) -> &'h Hierarchy) -> Self {
        let root = |&place: &u32| own(place as usize).bvh.root_aabb();
        Self { hierarchy: Arc::new(Hierarchy::of(&places.iter().map(root).collect::<Vec<Aabb>>())), places }
    }

    /// The same in a later scene, where what was at a place is `now`.
    pub fn moved(&self, now: &[u32]) -> Self {
        let places = self.places.iter().map(|&place| now.get(place as usize).copied().unwrap_or(GONE)).collect();
        Self { hierarchy: Arc::clone(&self.hierarchy), places }
    }

    /// The places of those that are still there.
    pub fn structures(&self) -> impl Iterator<Item = usize> {
        self.places.iter().filter(|&&place| place != GONE).map(|&place| place as usize)
    }

    #[cfg(test)]
    pub fn shares_hierarchy_with(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.hierarchy, &other.hierarchy)
    }

    /// Those that are there no more.
    pub fn gone(&self) -> usize {
        self.places.len() - self.structures().count()
    }

    /// Whether a structure near a beam is what is looked for.
    pub fn any_near(&self, beam: &Beam, is_it: impl Fn(usize) -> bool) -> bool {
        self.hierarchy.boxes.any(beam, |leaf| self.places[leaf] != GONE && is_it(self.places[leaf] as usize))
    }

    /// The same of the structures whose boxes are met.
    pub fn any_met(&self, meets: &impl Fn(&BvhNode) -> bool, is_it: impl Fn(usize) -> bool) -> bool {
        self.hierarchy.any_met(meets, |leaf| self.places[leaf] != GONE && is_it(self.places[leaf] as usize))
    }
}

impl Hierarchy {
    pub fn of_triangles(triangles: &[Triangle]) -> Self {
        Self::of(&triangles.iter().map(outer_box).collect::<Vec<Aabb>>())
    }

    fn of(boxes: &[Aabb]) -> Self {
        let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, boxes);
        let order = bvh.leaves(|_| true).collect();
        let corners = |leaf: usize| [boxes[leaf].mins, boxes[leaf].maxs].map(|corner| [corner.x, corner.y, corner.z]);
        Self { boxes: Boxes::new(order, corners), bvh }
    }

    /// Whether a triangle near a beam is what is looked for.
    pub fn any_near(&self, beam: &Beam, is_it: impl Fn(usize) -> bool) -> bool {
        self.boxes.any(beam, is_it)
    }

    /// Whether a leaf among the nodes that are met is what is looked for; ends with the first one.
    pub fn any_met(&self, meets: &impl Fn(&BvhNode) -> bool, is_it: impl Fn(usize) -> bool) -> bool {
        let mut found = false;
        self.bvh.traverse(|node| {
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
pub fn segment_meets_box(a: &Point3<f64>, inverse: &Vector3<f64>, node: &BvhNode, margin_m: f64) -> bool {
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

pub fn box_distance_squared(p: &Point3<f64>, node: &BvhNode) -> f64 {
    let (low, high) = (node.mins(), node.maxs());
    let outside = |v: f64, low: f32, high: f32| (f64::from(low) - v).max(v - f64::from(high)).max(0.0);
    let (x, y, z) = (outside(p.x, low.x, high.x), outside(p.y, low.y, high.y), outside(p.z, low.z, high.z));
    x * x + y * y + z * z
}
