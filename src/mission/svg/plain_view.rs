//! How metres become pixels in a plain view from above.

use super::pen::Place;

/// Room around everything that is drawn, share of its width.
const ROOM: f64 = 0.04;

/// The scale of views of one width.
pub struct PlainView {
    min: [f64; 2],
    max: [f64; 2],
    pub pixels_per_m: f64,
    pub width: f64,
    pub height: f64,
}

impl PlainView {
    /// Over places in metres east and north, `width` pixels wide.
    pub fn over(places: impl Iterator<Item = [f64; 2]>, width: f64) -> Self {
        let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for place in places {
            for axis in 0..2 {
                (min[axis], max[axis]) = (min[axis].min(place[axis]), max[axis].max(place[axis]));
            }
        }
        if min[0] > max[0] {
            (min, max) = ([0.0; 2], [1.0; 2]);
        }
        let room_m = ROOM * (max[0] - min[0]).max(max[1] - min[1]).max(10.0);
        let (min, max) = (min.map(|v| v - room_m), max.map(|v| v + room_m));
        let pixels_per_m = width / (max[0] - min[0]);
        Self { min, max, pixels_per_m, width, height: (max[1] - min[1]) * pixels_per_m }
    }

    /// Where a place lies in the view whose upper left corner is `corner`.
    pub fn at(&self, corner: Place, [x_m, y_m]: [f64; 2]) -> Place {
        [corner[0] + (x_m - self.min[0]) * self.pixels_per_m, corner[1] + (self.max[1] - y_m) * self.pixels_per_m]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_lies_within_its_frame_and_nothing_is_too_little_to_draw() {
        let places = [[-5.0, -5.0], [70.0, 30.0], [55.0, 30.0]];
        let view = PlainView::over(places.into_iter(), 700.0);
        for place in places {
            let [left, top] = view.at([0.0, 0.0], place);
            assert!((0.0..=view.width).contains(&left) && (0.0..=view.height).contains(&top), "{place:?}");
        }
        let [west, east] = [places[0], places[1]].map(|place| view.at([10.0, 20.0], place));
        assert!((east[0] - west[0] - 75.0 * view.pixels_per_m).abs() < 1e-9 && east[1] < west[1], "north is up");
        assert!(PlainView::over(std::iter::empty(), 700.0).height > 0.0);
    }
}
