//! Which row of the field answers for a queried position. The only user of kiddo.

use std::num::NonZero;
use std::sync::OnceLock;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Point3;
use overfly_table::field::ViewpointRow;

use crate::scene::clearance::Clearance;

/// A tree over the field's viewpoints (paper, section 4.3: "we adopt a KD-tree").
pub struct Lookup {
    /// Grown when it is asked for the first time: the first safe plan after an edit is not.
    tree: OnceLock<Option<ImmutableKdTree<f64, 3>>>,
    positions: Vec<Point3<f64>>,
}

/// How many of the nearest viewpoints are tried for a line of sight.
const CANDIDATES: NonZero<usize> = NonZero::new(8).expect("eight is not zero");

impl Lookup {
    /// `None` when there are no viewpoints.
    pub fn new(viewpoints: &[ViewpointRow]) -> Option<Self> {
        let positions: Vec<Point3<f64>> = viewpoints.iter().map(|row| row.position_m.into()).collect();
        (!positions.is_empty()).then(|| Self { tree: OnceLock::new(), positions })
    }

    fn tree(&self) -> Option<&ImmutableKdTree<f64, 3>> {
        let grow = || {
            let entries: Vec<[f64; 3]> = self.positions.iter().map(|position| position.coords.into()).collect();
            ImmutableKdTree::new_from_slice(&entries).ok()
        };
        self.tree.get_or_init(grow).as_ref()
    }

    /// The nearest viewpoint, whatever stands between.
    pub fn nearest(&self, p: &Point3<f64>) -> Option<usize> {
        let nearest = self.tree()?.query(&[p.x, p.y, p.z]).nearest_one::<SquaredEuclidean<f64>>().execute();
        Some(nearest.item as usize)
    }

    /// The nearest viewpoint with a line of sight to `p`: a nearer one behind a corner sees another street.
    pub fn nearest_in_sight(&self, p: &Point3<f64>, clearance: &Clearance) -> Option<usize> {
        let nearest = self.nearest(p)?;
        if !clearance.occluded(p, &self.positions[nearest]) {
            return Some(nearest);
        }
        let candidates = self.tree()?.query(&[p.x, p.y, p.z]).nearest_n::<SquaredEuclidean<f64>>(CANDIDATES).execute();
        candidates.iter().map(|found| found.item as usize).find(|&j| !clearance.occluded(p, &self.positions[j]))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn without_obstacles_the_answer_is_the_brute_force_nearest(
            points in proptest::collection::vec([-50.0..50.0f64, -50.0..50.0, 0.0..50.0], 1..200), query in [-60.0..60.0f64, -60.0..60.0, 0.0..60.0],
        ) {
            let rows: Vec<_> = points.iter().map(|&position_m| ViewpointRow { position_m, clearance_m: 9.0, ..Default::default() }).collect();
            let query = Point3::from(query);
            let found = Lookup::new(&rows).expect("there are points").nearest_in_sight(&query, &Clearance::of_triangles(vec![]));
            let distance = |j: usize| (Point3::from(points[j]) - query).norm_squared();
            let nearest = (0..points.len()).map(distance).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(found.map(distance), Some(nearest));
        }
    }

    #[test]
    fn a_viewpoint_behind_a_wall_does_not_answer() {
        let wall = [Point3::new(1.0, -90.0, -9.0), Point3::new(1.0, 90.0, -9.0), Point3::new(1.0, 0.0, 90.0)];
        let rows = [[2.0, 0.0, 0.0], [-9.0, 0.0, 0.0]].map(|position_m| ViewpointRow {
            position_m,
            clearance_m: 1.0,
            ..Default::default()
        });
        let lookup = Lookup::new(&rows).expect("there are points");
        assert_eq!(lookup.nearest_in_sight(&Point3::origin(), &Clearance::of_triangles(vec![wall])), Some(1));
    }
}
