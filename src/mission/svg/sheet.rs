//! Where everything stands on the sheet, and how metres become pixels.

use nalgebra::Point3;
use overfly_table::FieldTable;

use super::pen::Place;
use crate::trajectory::plan::Plan;

pub const WIDTH: f64 = 1600.0;
pub const MARGIN: f64 = 56.0;
/// Top of the drawings; the title and the key figures stand above.
pub const DRAWING_TOP: f64 = 246.0;
/// Room for the labels of the vertical axes.
pub const AXIS: f64 = 46.0;
pub const LEGEND_WIDTH: f64 = 300.0;
const LEGEND_GAP: f64 = 44.0;
/// Largest drawing of the top view, pixels.
const TOP_VIEW_WIDTH: f64 = WIDTH - 2.0 * MARGIN - AXIS - LEGEND_GAP - LEGEND_WIDTH;
const TOP_VIEW_HEIGHT: f64 = 1150.0;
/// Between the two views: axis labels, scale bar and heading.
const BETWEEN_VIEWS: f64 = 112.0;
const FOOTER: f64 = 76.0;
/// Height that the legend needs at least.
const LEGEND_HEIGHT: f64 = 960.0;

/// A rectangle on the sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
}

/// The layout of one sheet: both views have the same scale and the same west edge.
#[derive(Clone, Debug)]
pub struct Sheet {
    pub height: f64,
    pub pixels_per_m: f64,
    pub top_view: Frame,
    pub side_view: Frame,
    pub legend_left: f64,
    /// Corners of the drawn box, m.
    pub min: Point3<f64>,
    pub max: Point3<f64>,
}

impl Frame {
    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }
}

impl Sheet {
    /// Lays out a sheet on which structures and flight have room on all sides.
    pub fn of(field: &FieldTable, plan: &Plan) -> Self {
        let (min, max) = drawn_box(field.facts.min_m.into(), field.facts.max_m.into(), plan);
        Self::over(min, max)
    }

    /// The same for one view from above: a scene by the corners of its box, and the flight.
    pub fn from_above(min: Point3<f64>, max: Point3<f64>, plan: &Plan) -> Self {
        let (min, max) = drawn_box(min, max, plan);
        let sheet = Self::over(min, max);
        let height = (sheet.top_view.bottom() + BETWEEN_VIEWS / 2.0).max(DRAWING_TOP + LEGEND_HEIGHT) + FOOTER;
        Self { height, ..sheet }
    }

    fn over(min: Point3<f64>, max: Point3<f64>) -> Self {
        let extent = max - min;
        let pixels_per_m = (TOP_VIEW_WIDTH / extent.x).min(TOP_VIEW_HEIGHT / extent.y);
        let left = MARGIN + AXIS + (TOP_VIEW_WIDTH - extent.x * pixels_per_m) / 2.0;
        let width = extent.x * pixels_per_m;
        let top_view = Frame { left, top: DRAWING_TOP, width, height: extent.y * pixels_per_m };
        let side_top = top_view.bottom() + BETWEEN_VIEWS;
        let side_view = Frame { left, top: side_top, width, height: extent.z * pixels_per_m };
        let height = side_view.bottom().max(DRAWING_TOP + LEGEND_HEIGHT) + FOOTER;
        Self { height, pixels_per_m, top_view, side_view, legend_left: WIDTH - MARGIN - LEGEND_WIDTH, min, max }
    }

    /// Size of marks (dots, squares, lines of the path) against that on a small scene, where one metre has 2.5 pixels or more.
    pub fn mark_scale(&self) -> f64 {
        (self.pixels_per_m / 2.5).sqrt().clamp(0.45, 1.0)
    }

    /// Where a point stands in the top view (north up).
    pub fn seen_from_above(&self, x_m: f64, y_m: f64) -> Place {
        let Frame { left, top, .. } = self.top_view;
        [left + (x_m - self.min.x) * self.pixels_per_m, top + (self.max.y - y_m) * self.pixels_per_m]
    }

    /// Where a point stands in the side view (looking north).
    pub fn seen_from_south(&self, x_m: f64, z_m: f64) -> Place {
        let Frame { left, top, .. } = self.side_view;
        [left + (x_m - self.min.x) * self.pixels_per_m, top + (self.max.z - z_m) * self.pixels_per_m]
    }
}

/// Round values between `from` and `to` that are at least `least_gap` apart.
pub fn round_ticks(from: f64, to: f64, least_gap: f64) -> Vec<f64> {
    let step = round_up(least_gap);
    let first = (from / step).ceil() as i64;
    let last = (to / step).floor() as i64;
    (first..=last).map(|tick| tick as f64 * step).collect()
}

/// The smallest of 1, 2, 5, 10, 20, 50, ... that is not below `value`.
pub fn round_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.max(1e-3).log10().floor());
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|factor| factor * decade >= value * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * decade
}

fn drawn_box(mut min: Point3<f64>, mut max: Point3<f64>, plan: &Plan) -> (Point3<f64>, Point3<f64>) {
    let waypoints = plan.waypoints.iter().map(|waypoint| waypoint.position_m);
    for point in waypoints.chain(plan.images.iter().map(|image| image.position_m)) {
        min = min.inf(&point);
        max = max.sup(&point);
    }
    let room_m = 0.03 * (max.x - min.x).max(max.y - min.y).max(20.0);
    min -= nalgebra::Vector3::new(room_m, room_m, 0.0);
    max += nalgebra::Vector3::new(room_m, room_m, room_m.min(10.0));
    min.z = min.z.min(0.0);
    (min, max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_no_smaller_than_asked() {
        for (asked, given) in [(0.7, 1.0), (1.0, 1.0), (1.1, 2.0), (37.0, 50.0), (61.0, 100.0), (100.0, 100.0)] {
            assert_eq!(round_up(asked), given, "{asked}");
        }
    }

    #[test]
    fn ticks_stay_between_their_limits() {
        assert_eq!(round_ticks(-130.0, 90.0, 40.0), [-100.0, -50.0, 0.0, 50.0]);
    }
}
