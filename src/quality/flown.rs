//! Whether a path is safe in the truth, which may be another scene than the one that it was planned in.

use nalgebra::Point3;

use super::truth::Truth;

/// How near a curve comes to the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flown {
    /// Least distance to a structure or to the ground, m; 0 where the curve touches or enters one.
    pub clearance_m: f64,
    /// Whether the curve touches or enters a structure or the ground.
    pub collides: bool,
    /// Whether it comes nearer than the safety distance.
    pub too_near: bool,
    /// Where it is nearest, m in the truth's frame; the start of the first leg that does.
    pub nearest_m: Option<Point3<f64>>,
    /// The waypoint at which that leg starts.
    pub leg: usize,
}

/// Steps along a leg in which entered structures and the nearest place are looked for, m.
const STEP_M: f64 = 0.5;

/// Follows the curve through the truth. A curve without points is nowhere near.
pub fn flown(truth: &Truth, curve: &[Point3<f64>], safety_distance_m: f64) -> Flown {
    let legs: Vec<[Point3<f64>; 2]> = match curve {
        [only] => vec![[*only, *only]],
        _ => curve.windows(2).map(|ends| [ends[0], ends[1]]).collect(),
    };
    let mut least = (f64::INFINITY, 0);
    for (index, leg) in legs.iter().enumerate() {
        let distance_m = leg_distance_m(truth, leg, least.0);
        if distance_m < least.0 {
            least = (distance_m, index);
        }
    }
    let (clearance_m, leg) = least;
    let nearest_m = legs.get(leg).map(|leg| nearest(truth, leg));
    Flown { clearance_m, collides: clearance_m <= 0.0, too_near: clearance_m < safety_distance_m, nearest_m, leg }
}

fn leg_distance_m(truth: &Truth, leg: &[Point3<f64>; 2], cap_m: f64) -> f64 {
    let ground_m = leg[0].z.min(leg[1].z);
    if ground_m <= 0.0 || passes_scene(truth, leg) && points_of(leg).any(|point| truth.free.structure_around(&point).is_some()) {
        return 0.0;
    }
    truth.free.clearance.segment_distance_m(&leg[0], &leg[1], ground_m.min(cap_m))
}

/// Whether the box around the leg meets that of the scene: else there is nothing to enter.
fn passes_scene(truth: &Truth, leg: &[Point3<f64>; 2]) -> bool {
    let (low, high) = (leg[0].inf(&leg[1]), leg[0].sup(&leg[1]));
    truth.scene().bounds().is_some_and(|bounds| (0..3).all(|i| bounds.min[i] <= high[i] && low[i] <= bounds.max[i]))
}

/// The first place inside a structure or the ground, else the one that is nearest to one.
fn nearest(truth: &Truth, leg: &[Point3<f64>; 2]) -> Point3<f64> {
    let distance_m = |point: &Point3<f64>| match truth.free.structure_around(point) {
        Some(_) => 0.0,
        None => truth.free.clearance.point_distance_m(point, point.z.max(0.0)),
    };
    let points = points_of(leg).map(|point| (distance_m(&point), point));
    points.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(leg[0], |(_, point)| point)
}

fn points_of(leg: &[Point3<f64>; 2]) -> impl Iterator<Item = Point3<f64>> + use<> {
    let [from, to] = *leg;
    let steps = ((to - from).norm() / STEP_M).ceil().clamp(1.0, 1e6) as u32;
    (0..=steps).map(move |step| from + (to - from) * (f64::from(step) / f64::from(steps)))
}
