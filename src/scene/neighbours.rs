//! The height of a building of which nothing is known, after the buildings near it.

use std::collections::HashMap;

use geo::Coord;

use super::locate::median;

/// The buildings of a quarter are about as tall; those of the next one are better than none. m.
const NEAR_M: [f64; 2] = [100.0, 300.0];

/// Fewer buildings say nothing about the next one.
const LEAST_NEIGHBOURS: usize = 3;

/// Known heights by the place of their buildings.
pub(crate) struct KnownHeights {
    /// By cells as wide as the nearer of the two distances.
    cells: HashMap<[i64; 2], Vec<(Coord<f64>, f64)>>,
}

/// A height after the neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Guess {
    pub height_m: f64,
    pub neighbours: usize,
    pub within_m: f64,
}

impl KnownHeights {
    /// Of buildings at these places, m, with these heights, m.
    pub fn new(buildings: impl Iterator<Item = (Coord<f64>, f64)>) -> Self {
        let mut cells: HashMap<[i64; 2], Vec<(Coord<f64>, f64)>> = HashMap::new();
        buildings.for_each(|(place, height_m)| cells.entry(cell(place)).or_default().push((place, height_m)));
        Self { cells }
    }

    /// The median height of the buildings near a place; `None` where there are too few.
    pub fn near(&self, place: Coord<f64>) -> Option<Guess> {
        NEAR_M.into_iter().find_map(|within_m| {
            let heights = self.within(place, within_m);
            let neighbours = heights.len();
            let height_m = median(heights.into_iter());
            (neighbours >= LEAST_NEIGHBOURS).then_some(Guess { height_m, neighbours, within_m })
        })
    }

    fn within(&self, place: Coord<f64>, within_m: f64) -> Vec<f64> {
        let [column, row] = cell(place);
        let steps = (within_m / NEAR_M[0]).ceil() as i64;
        let around =
            (column - steps..=column + steps).flat_map(|column| (row - steps..=row + steps).map(move |row| [column, row]));
        let near = around.filter_map(|cell| self.cells.get(&cell)).flatten();
        let is_near = |other: &Coord<f64>| libm::hypot(other.x - place.x, other.y - place.y) <= within_m;
        near.filter(|(other, _)| is_near(other)).map(|(_, height_m)| *height_m).collect()
    }
}

fn cell(place: Coord<f64>) -> [i64; 2] {
    [place.x, place.y].map(|metres| (metres / NEAR_M[0]).floor() as i64)
}

#[cfg(test)]
mod tests {
    use geo::coord;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn it_is_the_median_of_all_that_are_near(
            buildings in prop::collection::vec((-500.0..500.0f64, -500.0..500.0f64, 2.0..60.0f64), 0..60),
            x in -500.0..500.0f64, y in -500.0..500.0f64,
        ) {
            let place = coord! { x: x, y: y };
            let known = KnownHeights::new(buildings.iter().map(|&(x, y, height_m)| (coord! { x: x, y: y }, height_m)));
            let expected = NEAR_M.into_iter().find_map(|within_m| {
                let mut near: Vec<f64> = buildings.iter().filter(|b| (b.0 - x).hypot(b.1 - y) <= within_m).map(|b| b.2).collect();
                near.sort_by(f64::total_cmp);
                (near.len() >= 3).then(|| Guess { height_m: near[(near.len() - 1) / 2], neighbours: near.len(), within_m })
            });
            prop_assert_eq!(known.near(place), expected);
        }
    }
}
