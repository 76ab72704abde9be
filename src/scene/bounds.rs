//! Boxes along the axes.

use geo::{BoundingRect, MultiPolygon};
use nalgebra::{Point2, Point3, Vector3};

/// Cosines are taken for so much larger that rounding decides nothing.
const ANGLE_SLACK: f64 = 1e-9;

/// Lengths are taken for so much larger, m, that rounding decides nothing.
const LENGTH_SLACK_M: f64 = 1e-6;

/// A box along the axes, metres in the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub min: Point3<f64>,
    pub max: Point3<f64>,
}

impl Bounds {
    /// The box of some points; `None` without points.
    pub fn of_points(points: impl IntoIterator<Item = Point3<f64>>) -> Option<Self> {
        points.into_iter().map(|point| Self { min: point, max: point }).reduce(|a, b| a.union(&b))
    }

    /// The box between two heights over an outline; `None` for one without corners.
    pub fn above(outline: &MultiPolygon<f64>, base_m: f64, top_m: f64) -> Option<Self> {
        let rect = outline.bounding_rect()?;
        let corner = |at: geo::Coord, z: f64| Point3::new(at.x, at.y, z);
        Some(Self { min: corner(rect.min(), base_m), max: corner(rect.max(), top_m) })
    }

    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }

    /// The box with this much more on every side, m.
    pub fn grown(&self, by_m: f64) -> Self {
        let by = Vector3::repeat(by_m);
        Self { min: self.min - by, max: self.max + by }
    }

    /// Whether two boxes have a point in common.
    pub fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    /// Squared distance of `point` to the box, m^2; 0 within.
    pub fn distance_squared(&self, point: &Point3<f64>) -> f64 {
        let outside = |axis: usize| (self.min[axis] - point[axis]).max(point[axis] - self.max[axis]).max(0.0);
        (0..3).map(|axis| outside(axis) * outside(axis)).sum()
    }

    /// Whether the segment from `a` to `b` meets the box.
    #[inline]
    pub fn meets_segment(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for axis in 0..3 {
            let (from, along) = (a[axis], b[axis] - a[axis]);
            if along == 0.0 {
                if from < self.min[axis] || from > self.max[axis] {
                    return false;
                }
                continue;
            }
            let (low, high) = ((self.min[axis] - from) / along, (self.max[axis] - from) / along);
            enter = enter.max(low.min(high));
            leave = leave.min(low.max(high));
        }
        enter <= leave
    }

    /// The circle around the box, seen from above: its middle and its radius, m.
    fn circle(&self) -> (Point2<f64>, f64) {
        let half = (self.max - self.min).xy() / 2.0;
        (self.min.xy() + half, half.norm())
    }

    /// Whether a line between two other boxes may lead over this one.
    pub fn may_lie_between(&self, a: &Self, b: &Self) -> bool {
        let ((own, own_m), (from, from_m), (to, to_m)) = (self.circle(), a.circle(), b.circle());
        // Seen from above, all such lines lie within the wider one's radius of the line between the middles.
        let (along, away) = (to - from, own - from);
        let share = (away.dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        self.meets(&a.union(b)) && (away - along * share).norm() <= own_m + from_m.max(to_m) + LENGTH_SLACK_M
    }

    /// Whether a line from `from` into the box may lead over `other`, seen from above: by the angles at which their circles appear.
    pub fn may_be_behind(&self, other: &Self, from: &Point3<f64>) -> bool {
        let ((middle, own_m), (other_middle, others_m)) = (self.circle(), other.circle());
        let (to_self, to_other) = (middle - from.xy(), other_middle - from.xy());
        let (self_m, other_m) = (to_self.norm(), to_other.norm());
        if self_m <= own_m || other_m <= others_m {
            return true;
        }
        let (sine, other_sine) = (own_m / self_m, others_m / other_m);
        let cosine = |sine: f64| (1.0 - sine * sine).sqrt();
        // Half the angles at which the two appear, together, and the angle between their middles: both are between 0 and 180 degrees.
        let apart = to_self.dot(&to_other) / (self_m * other_m);
        other_m - others_m <= self_m + own_m && apart >= cosine(sine) * cosine(other_sine) - sine * other_sine - ANGLE_SLACK
    }

    /// Whether `point` lies in the box or on its sides.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn a_box() -> impl Strategy<Value = Bounds> {
        let place = [-60.0..60.0f64, -60.0..60.0, 0.0..30.0];
        (place, [0.0..25.0f64, 0.0..25.0, 0.0..25.0]).prop_map(|(min, size)| {
            let min = Point3::from(min);
            Bounds { min, max: min + Vector3::from(size) }
        })
    }

    fn within(bounds: &Bounds, shares: [f64; 3]) -> Point3<f64> {
        bounds.min + (bounds.max - bounds.min).component_mul(&Vector3::from(shares))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn no_line_that_leads_through_a_box_is_passed_over(
            boxes in [a_box(), a_box(), a_box()],
            ends in prop::array::uniform2([0.0..=1.0f64, 0.0..=1.0, 0.0..=1.0]),
        ) {
            let [changed, from, to] = boxes;
            let (a, b) = (within(&from, ends[0]), within(&to, ends[1]));
            if changed.meets_segment(&a, &b) {
                prop_assert!(changed.may_lie_between(&from, &to));
                prop_assert!(to.may_be_behind(&changed, &a));
            }
        }
    }

    #[test]
    fn what_lies_aside_and_what_lies_beyond_is_left_out() {
        let at = |x: f64, y: f64| Bounds { min: Point3::new(x, y, 0.0), max: Point3::new(x + 4.0, y + 4.0, 30.0) };
        let (from, to) = (at(0.0, 0.0), at(60.0, 0.0));
        let view = Point3::new(2.0, 2.0, 20.0);
        for (other, expected) in [(at(30.0, 0.0), true), (at(30.0, 20.0), false), (at(-30.0, 0.0), false), (at(90.0, 0.0), false)]
        {
            assert_eq!(other.may_lie_between(&from, &to), expected, "{other:?}");
            assert_eq!(to.may_be_behind(&other, &view), expected, "{other:?}");
        }
    }
}
