//! Places of images on a grid, so that a sample need not look at those of the whole town.

use nalgebra::{Point3, distance_squared};

/// So much more of the reach, as a share, is looked at that rounding decides nothing.
const SLACK: f64 = 1e-9;

/// Numbered places that can be asked for within one reach.
pub struct Places {
    reach_m: f64,
    corner: [f64; 2],
    side_m: f64,
    /// Columns and rows.
    size: [usize; 2],
    /// Where each cell's places begin, row by row, and where the last one's end.
    begins: Vec<u32>,
    places: Vec<(Point3<f64>, u32)>,
}

impl Places {
    /// Takes up to 2^32 places with their numbers.
    pub fn new(places: impl Iterator<Item = (u32, Point3<f64>)> + Clone, reach_m: f64) -> Self {
        let (mut corner, mut end, mut count) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], 1.0);
        for (_, place) in places.clone() {
            corner = [corner[0].min(place.x), corner[1].min(place.y)];
            end = [end[0].max(place.x), end[1].max(place.y)];
            count += 1.0;
        }
        let extent = [end[0] - corner[0], end[1] - corner[1]].map(|extent| extent.max(0.0));
        // No more than about three cells for each place, however far they are apart.
        let least_m = (extent[0] * extent[1] / count).sqrt().max(extent[0] / count).max(extent[1] / count);
        let side_m = (0.5 * reach_m).max(least_m);
        let size = extent.map(|extent| (extent / side_m) as usize + 1);
        let mut grid = Self { reach_m: reach_m * (1.0 + SLACK), corner, side_m, size, begins: Vec::new(), places: Vec::new() };
        let mut begins = vec![0; size[0] * size[1] + 1];
        places.clone().for_each(|(_, place)| begins[grid.cell(&place) + 1] += 1);
        (1..begins.len()).for_each(|cell| begins[cell] += begins[cell - 1]);
        let mut next = begins.clone();
        grid.places = vec![(Point3::origin(), 0); begins.last().map_or(0, |&end| end as usize)];
        for (number, place) in places {
            let at = &mut next[grid.cell(&place)];
            grid.places[*at as usize] = (place, number);
            *at += 1;
        }
        grid.begins = begins;
        grid
    }

    fn step(&self, axis: usize, at_m: f64) -> usize {
        // What lies before the first cell counts as in it.
        (((at_m - self.corner[axis]) / self.side_m) as usize).min(self.size[axis] - 1)
    }

    fn cell(&self, place: &Point3<f64>) -> usize {
        self.step(1, place.y) * self.size[0] + self.step(0, place.x)
    }

    fn near<'p>(&'p self, place: &'p Point3<f64>) -> impl Iterator<Item = u32> + 'p {
        let reach_m = self.reach_m;
        let [columns, rows] =
            [(0, place.x), (1, place.y)].map(|(axis, at_m)| self.step(axis, at_m - reach_m)..=self.step(axis, at_m + reach_m));
        let slices = rows.map(move |row| {
            let [first, last] = [*columns.start(), *columns.end()].map(|column| row * self.size[0] + column);
            &self.places[self.begins[first] as usize..self.begins[last + 1] as usize]
        });
        let is_near = move |other: &Point3<f64>| distance_squared(other, place) <= reach_m * reach_m;
        slices.flatten().filter(move |(other, _)| is_near(other)).map(|&(_, number)| number)
    }

    /// The numbers of the places that are no farther than the reach, in order.
    pub fn within(&self, place: &Point3<f64>) -> Vec<usize> {
        let mut near: Vec<usize> = self.near(place).map(|number| number as usize).collect();
        near.sort_unstable();
        near
    }

    /// Whether there is any.
    pub fn is_any_within(&self, place: &Point3<f64>) -> bool {
        self.near(place).next().is_some()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn place() -> impl Strategy<Value = Point3<f64>> {
        prop_oneof![
            9 => [-300.0..300.0f64, -300.0..300.0, 0.0..100.0],
            1 => [-1e300..1e300f64, -1e9..1e9, -1e3..1e3],
        ]
        .prop_map(Point3::from)
    }

    proptest! {
        #[test]
        fn those_are_found_that_are_within_reach(
            places in proptest::collection::vec(place(), 0..60), asked in proptest::collection::vec(place(), 1..20), reach_m in 1.0..500.0f64,
        ) {
            let grid = Places::new((0..).zip(places.iter().copied()), reach_m);
            for at in places.iter().chain(&asked) {
                let is_near = |k: &usize| distance_squared(&places[*k], at) <= reach_m * reach_m;
                let expected: Vec<usize> = (0..places.len()).filter(is_near).collect();
                prop_assert_eq!(grid.is_any_within(at), !expected.is_empty());
                prop_assert_eq!(grid.within(at), expected);
            }
        }
    }
}
