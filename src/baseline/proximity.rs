//! Which of many points lie near each other.

use nalgebra::Point3;
use rayon::prelude::*;

/// Points from west to east, which are asked for the neighbours of one of them.
#[derive(Clone, Debug)]
pub struct Neighbours {
    by_x: Vec<u32>,
    xs: Vec<f64>,
    radius_m: f64,
}

impl Neighbours {
    pub fn new(points: &[Point3<f64>], radius_m: f64) -> Self {
        let mut by_x: Vec<u32> = (0..points.len() as u32).collect();
        by_x.sort_by(|&a, &b| points[a as usize].x.total_cmp(&points[b as usize].x).then(a.cmp(&b)));
        let xs = by_x.iter().map(|&index| points[index as usize].x).collect();
        Self { by_x, xs, radius_m }
    }

    /// Of the same points those within the radius of one, nearest first, the earlier one of two equals.
    pub fn of(&self, points: &[Point3<f64>], index: usize) -> Vec<u32> {
        let (p, radius_m) = (&points[index], self.radius_m);
        let [from, to] = [self.xs.partition_point(|&x| x < p.x - radius_m), self.xs.partition_point(|&x| x <= p.x + radius_m)];
        let others = self.by_x[from..to].iter().map(|&other| ((points[other as usize] - p).norm(), other));
        let mut found: Vec<(f64, u32)> = others.filter(|&(d, other)| d <= radius_m && other as usize != index).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.into_iter().map(|(_, other)| other).collect()
    }
}

/// For each point the others within `radius_m`, nearest first, the earlier one of two equals.
pub fn within(points: &[Point3<f64>], radius_m: f64) -> Vec<Vec<u32>> {
    let neighbours = Neighbours::new(points, radius_m);
    (0..points.len()).into_par_iter().map(|index| neighbours.of(points, index)).collect()
}

/// The `count` points nearest to `p`, nearest first, the earlier one of two equals.
pub fn nearest(points: &[Point3<f64>], p: &Point3<f64>, count: usize) -> Vec<u32> {
    let mut found: Vec<(f64, u32)> = points.iter().enumerate().map(|(index, q)| ((q - p).norm_squared(), index as u32)).collect();
    let order = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if count < found.len() {
        found.select_nth_unstable_by(count, order);
        found.truncate(count);
    }
    found.sort_by(order);
    found.into_iter().map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn both_agree_with_brute_force(points in proptest::collection::vec([-20.0..20.0f64, -20.0..20.0, 0.0..9.0], 1..60), radius in 0.0..30.0f64) {
            let points: Vec<Point3<f64>> = points.into_iter().map(Point3::from).collect();
            let found = within(&points, radius);
            for (index, p) in points.iter().enumerate() {
                let mut expected: Vec<u32> = (0..points.len() as u32).collect();
                expected.sort_by(|&a, &b| (points[a as usize] - p).norm().total_cmp(&(points[b as usize] - p).norm()).then(a.cmp(&b)));
                prop_assert_eq!(&nearest(&points, p, 7), &expected[..7.min(points.len())]);
                expected.retain(|&other| other as usize != index && (points[other as usize] - p).norm() <= radius);
                prop_assert_eq!(&found[index], &expected);
            }
        }
    }
}
