//! Boxes eight by eight, for the question whether anything near a line is what is looked for: one look at eight of them takes little longer than one at one.
//!
//! A complete tree without pointers: eight boxes that follow each other in the order of another hierarchy's leaves are the children of one box, and so on
//! up to a single eight. All is in single precision; a beam is wider by more than that can be wrong, so that no box is passed over that a line meets.

use arrayvec::ArrayVec;
use nalgebra::Point3;
use wide::f32x8;

const EIGHT: usize = 8;

/// With eight children a node there are eleven levels to as many boxes as can be numbered.
const MOST_OPEN: usize = 11 * (EIGHT - 1) + 1;

/// Boxes of leaves with all that are around them.
#[derive(Debug)]
pub struct Boxes {
    /// From the top down to the boxes of the leaves.
    levels: Vec<Vec<Eight>>,
    /// The leaves in the order of their boxes.
    leaves: Vec<u32>,
}

/// Eight boxes, by axis. Those that are none lie where nothing goes.
#[derive(Clone, Copy, Debug)]
struct Eight {
    low: [[f32; EIGHT]; 3],
    high: [[f32; EIGHT]; 3],
}

/// A straight line from one point to another with everything around it up to a distance along any axis.
pub struct Beam {
    /// By axis: where it begins, so much farther up, and down, and the reciprocal of its way.
    up: [f32x8; 3],
    down: [f32x8; 3],
    inverse: [f32x8; 3],
}

/// Single precision is wrong by a sixteen-millionth with each step of a computation: so much of the coordinates is more than all of them together.
const ROUNDING: f64 = 1e-6;

impl Beam {
    pub fn new(a: &Point3<f64>, b: &Point3<f64>, distance_m: f64) -> Self {
        let (way, farthest_m) = (b - a, a.coords.amax().max(b.coords.amax()));
        let margin_m = distance_m + ROUNDING * (farthest_m + distance_m);
        let by_axis = |value: &dyn Fn(usize) -> f64| std::array::from_fn(|axis| f32x8::splat(value(axis) as f32));
        Self {
            up: by_axis(&|axis| a[axis] + margin_m),
            down: by_axis(&|axis| a[axis] - margin_m),
            inverse: by_axis(&|axis| 1.0 / way[axis]),
        }
    }
}

impl Boxes {
    /// `corners` gives the lowest and the highest corner of a leaf's box; neighbours in `order` are neighbours in space.
    pub fn new(order: Vec<u32>, corners: impl Fn(usize) -> [[f32; 3]; 2]) -> Self {
        let mut boxes: Vec<[[f32; 3]; 2]> = order.iter().map(|&leaf| corners(leaf as usize)).collect();
        let mut levels = Vec::new();
        while !boxes.is_empty() {
            let eights: Vec<Eight> = boxes.chunks(EIGHT).map(Eight::of).collect();
            let is_top = eights.len() == 1;
            boxes = if is_top { Vec::new() } else { boxes.chunks(EIGHT).map(around).collect() };
            levels.push(eights);
        }
        levels.reverse();
        Self { levels, leaves: order }
    }

    /// Whether any leaf whose box a beam meets is what is looked for; ends with the first one.
    pub fn any(&self, beam: &Beam, is_it: impl Fn(usize) -> bool) -> bool {
        let mut open = ArrayVec::<(usize, usize), MOST_OPEN>::new();
        if !self.levels.is_empty() {
            open.push((0, 0));
        }
        while let Some((level, index)) = open.pop() {
            let is_last = level + 1 == self.levels.len();
            let mut met = self.levels[level][index].met_by(beam);
            while met != 0 {
                let child = EIGHT * index + met.trailing_zeros() as usize;
                met &= met - 1;
                if !is_last {
                    open.push((level + 1, child));
                } else if is_it(self.leaves[child] as usize) {
                    return true;
                }
            }
        }
        false
    }
}

impl Eight {
    fn of(boxes: &[[[f32; 3]; 2]]) -> Self {
        let mut eight = Self { low: [[f32::MAX; EIGHT]; 3], high: [[f32::MAX; EIGHT]; 3] };
        for (k, [low, high]) in boxes.iter().enumerate() {
            for axis in 0..3 {
                (eight.low[axis][k], eight.high[axis][k]) = (low[axis], high[axis]);
            }
        }
        eight
    }

    /// Bit k is set where a beam meets box k (slab test). A beam whose edge lies exactly in a face gives 0 * infinity and may pass the box over: the line is
    /// farther from it than the distance asked for.
    #[inline]
    fn met_by(&self, beam: &Beam) -> u32 {
        let (mut enter, mut leave) = (f32x8::ZERO, f32x8::ONE);
        for axis in 0..3 {
            let low = (f32x8::from(self.low[axis]) - beam.up[axis]) * beam.inverse[axis];
            let high = (f32x8::from(self.high[axis]) - beam.down[axis]) * beam.inverse[axis];
            // The bounds come last: where a side gives no number, they stay what they were.
            enter = low.fast_min(high).fast_max(enter);
            leave = low.fast_max(high).fast_min(leave);
        }
        enter.simd_le(leave).to_bitmask()
    }
}

/// The box around some boxes.
fn around(boxes: &[[[f32; 3]; 2]]) -> [[f32; 3]; 2] {
    let axis = |corner: usize, axis: usize, pick: fn(f32, f32) -> f32| {
        boxes.iter().map(|corners| corners[corner][axis]).reduce(pick).expect("there is a box")
    };
    [std::array::from_fn(|k| axis(0, k, f32::min)), std::array::from_fn(|k| axis(1, k, f32::max))]
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;

    /// Whether a line meets a box that is larger by `by_m` on all sides, in double precision.
    fn meets([low, high]: &[[f32; 3]; 2], a: &Point3<f64>, b: &Point3<f64>, by_m: f64) -> bool {
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for axis in 0..3 {
            let (from, way) = (a[axis], b[axis] - a[axis]);
            let sides = [f64::from(low[axis]) - by_m - from, f64::from(high[axis]) + by_m - from];
            if way == 0.0 {
                if sides[0] > 0.0 || sides[1] < 0.0 {
                    return false;
                }
                continue;
            }
            let [first, last] = sides.map(|side| side / way);
            (enter, leave) = (enter.max(first.min(last)), leave.min(first.max(last)));
        }
        enter <= leave
    }

    fn place() -> impl Strategy<Value = [f64; 3]> {
        [-50.0..50.0f64, -50.0..50.0f64, 0.0..40.0f64]
    }

    proptest! {
        #[test]
        fn no_box_is_passed_over_that_a_beam_meets_and_hardly_any_other_is_looked_at(
            boxes in proptest::collection::vec((place(), [0.0..6.0f64, 0.0..6.0, 0.0..6.0]), 0..600), a in place(), b in place(),
            touching in proptest::collection::vec((0.0..1.0f64, 0..3usize), 0..40), flat in 0..8usize, distance_m in prop_oneof![Just(0.0), 0.0..8.0f64], shift_m in prop_oneof![Just(0.0), 0.0..20_000.0f64],
        ) {
            // Far from the origin too, where single precision is coarse; along the axes; and a mere point.
            let moved = |p: [f64; 3]| Point3::new(p[0] + shift_m, p[1] - shift_m, p[2]);
            let (a, mut b) = (moved(a), moved(b));
            (0..3).filter(|axis| flat >> axis & 1 == 1).for_each(|axis| b[axis] = a[axis]);
            let boxes = boxes.iter().map(|(low, size)| [moved(*low), moved(*low) + Vector3::from(*size)]);
            // Boxes that begin just where the beam ends.
            let beside = touching.iter().map(|&(share, axis)| {
                let mut low = a + (b - a) * share - Vector3::repeat(2.0);
                low[axis] += 2.0 + distance_m;
                [low, low + Vector3::repeat(4.0)]
            });
            let single = |corner: Point3<f64>| [corner.x as f32, corner.y as f32, corner.z as f32];
            let corners: Vec<[[f32; 3]; 2]> = boxes.chain(beside).map(|corners| corners.map(single)).collect();
            let order: Vec<u32> = (0..corners.len() as u32).rev().collect();
            let tree = Boxes::new(order, |leaf| corners[leaf]);
            let met = RefCell::new(Vec::new());
            let found = tree.any(&Beam::new(&a, &b, distance_m), |leaf| {
                met.borrow_mut().push(leaf);
                false
            });
            prop_assert!(!found);
            let mut met = met.into_inner();
            met.sort_unstable();
            let within = |by_m: f64| (0..corners.len()).filter(|&leaf| meets(&corners[leaf], &a, &b, by_m)).collect::<Vec<_>>();
            let near = within(distance_m + 4.0 * ROUNDING * (shift_m + 100.0));
            prop_assert!(within(distance_m).iter().all(|leaf| met.binary_search(leaf).is_ok()), "{met:?}");
            prop_assert!(met.iter().all(|leaf| near.binary_search(leaf).is_ok()), "{met:?}");
            // It ends with the first one that is what is looked for.
            if let Some(&wanted) = met.first() {
                let asked = RefCell::new(Vec::new());
                let found = tree.any(&Beam::new(&a, &b, distance_m), |leaf| {
                    asked.borrow_mut().push(leaf);
                    leaf == wanted
                });
                prop_assert!(found);
                prop_assert_eq!(asked.into_inner().last().copied(), Some(wanted));
            }
        }
    }
}
