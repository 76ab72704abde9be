//! The curve that is flown: legs without what the arcs at their ends cut off, and the arcs.

use nalgebra::{Point3, Vector3};

use super::corner::Corner;

/// The curve through a path's waypoints; at each of them lies an arc.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    pub waypoints: Vec<Point3<f64>>,
    /// One for each waypoint; at the ends of the path and where the drone stops it is the waypoint itself.
    pub arcs: Vec<Arc>,
}

/// The arc that rounds a corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    pub corner: Point3<f64>,
    /// Where it leaves the first leg, and the leg's direction.
    start: Point3<f64>,
    ahead: Vector3<f64>,
    /// From the start towards the centre.
    inward: Vector3<f64>,
    pub radius_m: f64,
    pub deviation_rad: f64,
}

impl Curve {
    /// `corners` has one for each waypoint.
    pub fn new(waypoints: Vec<Point3<f64>>, corners: &[Corner]) -> Self {
        let arc = |k: usize| match (k.checked_sub(1).map(|before| waypoints[before]), waypoints.get(k + 1)) {
            (Some(before), Some(after)) => Arc::new(&before, &waypoints[k], after, &corners[k]),
            _ => Arc::at_rest(waypoints[k]),
        };
        let arcs = (0..waypoints.len()).map(arc).collect();
        Self { waypoints, arcs }
    }

    /// Number of legs.
    pub fn legs(&self) -> usize {
        self.waypoints.len().saturating_sub(1)
    }

    /// The ends of the straight part of a leg.
    pub fn straight(&self, leg: usize) -> [Point3<f64>; 2] {
        [self.arcs[leg].ends()[1], self.arcs[leg + 1].start]
    }
}

impl Arc {
    /// The arc of `corner` at `at` between two other waypoints.
    pub fn new(before: &Point3<f64>, at: &Point3<f64>, after: &Point3<f64>, corner: &Corner) -> Self {
        let (ahead, on) = ((at - before).normalize(), (after - at).normalize());
        // A path that goes straight on has no inward side, and its arc is a point or as good as straight.
        let inward = (on - ahead * ahead.dot(&on)).try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        if corner.is_stop() {
            return Self::at_rest(*at);
        }
        let (radius_m, deviation_rad) = (corner.radius_m, corner.deviation_rad);
        Self { corner: *at, start: at - ahead * corner.cut_m, ahead, inward, radius_m, deviation_rad }
    }

    fn at_rest(corner: Point3<f64>) -> Self {
        Self { corner, start: corner, ahead: Vector3::zeros(), inward: Vector3::zeros(), radius_m: 0.0, deviation_rad: 0.0 }
    }

    /// Where the arc is after it has turned by an angle, and the direction of flight there.
    pub fn at(&self, turned_rad: f64) -> (Point3<f64>, Vector3<f64>) {
        let (sin, cos) = libm::sincos(turned_rad);
        let half = libm::sin(turned_rad / 2.0);
        let position = self.start + self.ahead * (self.radius_m * sin) + self.inward * (2.0 * self.radius_m * half * half);
        (position, self.ahead * cos + self.inward * sin)
    }

    /// Where it leaves the first leg and where it meets the second one.
    pub fn ends(&self) -> [Point3<f64>; 2] {
        [self.start, self.at(self.deviation_rad).0]
    }

    /// How far it passes from the straight line between its ends, m.
    pub fn sagitta_m(&self) -> f64 {
        let sin_quarter = libm::sin(self.deviation_rad / 4.0);
        2.0 * self.radius_m * sin_quarter * sin_quarter
    }

    /// Triangles that together hold the arc, as the chord and the two tangents of each piece of it; the chords keep within `sagitta_m` of the
    /// arc. None where the drone stops.
    pub fn hull(&self, sagitta_m: f64) -> impl Iterator<Item = [[Point3<f64>; 2]; 3]> + use<> {
        let (arc, chords) = (*self, self.chords(sagitta_m));
        (0..chords).map(move |k| {
            let [from_rad, to_rad] = [k, k + 1].map(|k| arc.deviation_rad * f64::from(k) / f64::from(chords));
            let ((from, ahead), (to, _)) = (arc.at(from_rad), arc.at(to_rad));
            let tip = from + ahead * (arc.radius_m * libm::tan((to_rad - from_rad) / 2.0));
            [[from, to], [from, tip], [tip, to]]
        })
    }

    /// Points on the arc, both ends among them, whose chords keep within `sagitta_m` of it.
    pub fn points(&self, sagitta_m: f64) -> impl Iterator<Item = Point3<f64>> + use<> {
        let (arc, chords) = (*self, self.chords(sagitta_m));
        (0..=chords).map(move |k| arc.at(arc.deviation_rad * f64::from(k) / f64::from(chords.max(1))).0)
    }

    /// Number of chords: one over the angle b stays within r b^2 / 8 of its arc.
    fn chords(&self, sagitta_m: f64) -> u32 {
        (self.deviation_rad * (self.radius_m / (8.0 * sagitta_m)).sqrt()).ceil().clamp(0.0, 1e6) as u32
    }
}
