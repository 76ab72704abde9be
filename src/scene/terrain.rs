//! The ground of a scene where it is not flat: heights on a grid, and triangles between them.
//!
//! The terrain is a structure like others for lines of sight and safety distances, and nobody wants to capture it. Flights keep their least altitude
//! and their legal ceiling above it. Beyond its edges it goes on as high as there.

use nalgebra::Point3;

use super::bounds::Bounds;
use super::proxy::Triangle;

/// The name of a scene's terrain among its structures.
pub const TERRAIN_NAME: &str = "terrain";

/// So far beyond its edges the terrain has triangles, m: farther than flights leave the box around the structures.
const SKIRT_M: f64 = 1000.0;

/// Altitudes may fall short by this for rounding, m.
const ROUNDING_M: f64 = 1e-9;

/// Heights of the ground at the corners of square cells along the axes of the local frame. Each cell is halved from its south-west to its north-east
/// corner, and the ground is flat in each half.
#[derive(Clone, Debug, PartialEq)]
pub struct Terrain {
    /// The south-west corner, m.
    origin: [f64; 2],
    cell_m: f64,
    /// Corners from west to east and from south to north, at least two each.
    corners: [usize; 2],
    /// Heights above the plane z = 0, m: rows from the south, in each from the west.
    heights_m: Vec<f64>,
    lowest_m: f64,
    highest_m: f64,
}

impl Terrain {
    /// `None` when the numbers do not make a grid: fewer than two corners a side, another number of heights, or something that is not finite.
    pub fn new(origin: [f64; 2], cell_m: f64, corners: [usize; 2], heights_m: Vec<f64>) -> Option<Self> {
        let [across, up] = corners;
        let is_whole = across >= 2 && up >= 2 && across.checked_mul(up) == Some(heights_m.len()) && cell_m > 0.0;
        let is_finite = origin.iter().chain(&heights_m).chain([&cell_m]).all(|number| number.is_finite());
        let lowest_m = heights_m.iter().copied().fold(f64::INFINITY, f64::min);
        let highest_m = heights_m.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (is_whole && is_finite).then_some(Self { origin, cell_m, corners, heights_m, lowest_m, highest_m })
    }

    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// The south-west corner, m.
    pub fn origin_m(&self) -> [f64; 2] {
        self.origin
    }

    /// Corners from west to east and from south to north.
    pub fn corners(&self) -> [usize; 2] {
        self.corners
    }

    /// Heights of all corners above the plane z = 0, m: rows from the south, in each from the west.
    pub fn heights_m(&self) -> &[f64] {
        &self.heights_m
    }

    /// The lowest and the highest place of the ground, m.
    pub fn range_m(&self) -> [f64; 2] {
        [self.lowest_m, self.highest_m]
    }

    /// The same ground with its heights counted from another plane, which lies so high above z = 0, m.
    pub fn lowered(&self, by_m: f64) -> Self {
        let heights_m = self.heights_m.iter().map(|z| z - by_m).collect();
        Self { heights_m, lowest_m: self.lowest_m - by_m, highest_m: self.highest_m - by_m, ..*self }
    }

    /// Height of the ground at a place, m.
    pub fn height_m(&self, x: f64, y: f64) -> f64 {
        let [u, v] = self.place(x, y);
        let (i, j) = ((u as usize).min(self.corners[0] - 2), (v as usize).min(self.corners[1] - 2));
        let (along, up) = (u - i as f64, v - j as f64);
        let corner = |i: usize, j: usize| self.heights_m[j * self.corners[0] + i];
        let (low, high) = (corner(i, j), corner(i + 1, j + 1));
        let (first, second, share) = if along >= up { (along, up, corner(i + 1, j)) } else { (up, along, corner(i, j + 1)) };
        low + first * (share - low) + second * (high - share)
    }

    /// The highest corner of the cells that meet a box, seen from above, or of its edge where it lies outside, m: no ground in it is higher; and the
    /// lowest one.
    pub fn range_within_m(&self, bounds: &Bounds) -> [f64; 2] {
        let ([west, south], [east, north]) = (self.place(bounds.min.x, bounds.min.y), self.place(bounds.max.x, bounds.max.y));
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for j in south.floor() as usize..=north.ceil() as usize {
            for i in west.floor() as usize..=east.ceil() as usize {
                let height_m = self.heights_m[j * self.corners[0] + i];
                range = [range[0].min(height_m), range[1].max(height_m)];
            }
        }
        range
    }

    /// Whether the whole straight line from `a` to `b` keeps between two altitudes above the ground, m.
    pub fn keeps_altitude(&self, a: &Point3<f64>, b: &Point3<f64>, [least_m, most_m]: [f64; 2]) -> bool {
        let (low, high) = (a.z.min(b.z), a.z.max(b.z));
        if low - self.highest_m >= least_m && high - self.lowest_m <= most_m {
            return true;
        }
        let [lowest_m, highest_m] = self.altitudes_m(a, b);
        lowest_m >= least_m - ROUNDING_M && highest_m <= most_m + ROUNDING_M
    }

    /// The least and the greatest altitude above the ground of the straight line from `a` to `b`, m. The ground is flat between the sides of the
    /// triangles, so that both lie where the line passes one, or at its ends.
    pub fn altitudes_m(&self, a: &Point3<f64>, b: &Point3<f64>) -> [f64; 2] {
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        self.for_each_side(a, b, |share| {
            let p = a + (b - a) * share;
            let altitude_m = p.z - self.height_m(p.x, p.y);
            range = [range[0].min(altitude_m), range[1].max(altitude_m)];
        });
        range
    }

    /// Where the straight line from `a` to `b`, seen from above, passes the sides of the triangles, as shares of it and in their order, with both of its
    /// ends: between two of them the ground rises evenly.
    pub fn sides_passed(&self, a: &Point3<f64>, b: &Point3<f64>) -> Vec<f64> {
        let mut shares = Vec::new();
        self.for_each_side(a, b, |share| shares.push(share));
        shares.sort_by(f64::total_cmp);
        shares.dedup();
        shares
    }

    /// Shows both ends of a line, 0 and 1, and the shares of it at which it passes a side of a triangle.
    fn for_each_side(&self, a: &Point3<f64>, b: &Point3<f64>, mut look: impl FnMut(f64)) {
        look(0.0);
        look(1.0);
        let in_cells = |p: &Point3<f64>| [(p.x - self.origin[0]) / self.cell_m, (p.y - self.origin[1]) / self.cell_m];
        let ([u0, v0], [u1, v1]) = (in_cells(a), in_cells(b));
        let [across, up] = self.corners.map(|corners| (corners - 1) as f64);
        for (from, to, first, last) in [(u0, u1, 0.0, across), (v0, v1, 0.0, up), (u0 - v0, u1 - v1, -up, across)] {
            let (low, high) = (from.min(to).max(first).ceil(), from.max(to).min(last).floor());
            if from == to || low > high {
                continue;
            }
            for k in 0..=(high - low) as usize {
                look(((low + k as f64 - from) / (to - from)).clamp(0.0, 1.0));
            }
        }
    }

    /// Whether a point lies in the ground.
    pub fn contains(&self, p: &Point3<f64>) -> bool {
        p.z < self.height_m(p.x, p.y)
    }

    /// The surface, seen from above, also beyond the edges.
    pub fn triangles(&self) -> Vec<Triangle> {
        let [across, up] = self.corners;
        let place = |index: usize, count: usize, origin: f64| {
            let inner = index.clamp(1, count) - 1;
            let beyond = if index == 0 {
                -SKIRT_M
            } else if index > count {
                SKIRT_M
            } else {
                0.0
            };
            (inner, origin + inner as f64 * self.cell_m + beyond)
        };
        let corner = |i: usize, j: usize| {
            let ((column, x), (row, y)) = (place(i, across, self.origin[0]), place(j, up, self.origin[1]));
            Point3::new(x, y, self.heights_m[row * across + column])
        };
        let mut triangles = Vec::with_capacity(2 * (across + 1) * (up + 1));
        for j in 0..=up {
            for i in 0..=across {
                let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        triangles
    }

    /// The box around the ground, from the plane z = 0 or its lowest place on, and as far as it has triangles.
    pub fn bounds(&self) -> Bounds {
        let [width_m, depth_m] = self.corners.map(|corners| (corners - 1) as f64 * self.cell_m + SKIRT_M);
        let [west, south] = self.origin;
        Bounds {
            min: Point3::new(west - SKIRT_M, south - SKIRT_M, self.lowest_m.min(0.0)),
            max: Point3::new(west + width_m, south + depth_m, self.highest_m),
        }
    }

    /// A place in cells from the south-west corner, moved onto the grid where it lies outside.
    fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let within = |offset_m: f64, corners: usize| {
            // Written so that what is not a number comes out as a place too.
            let cells = (offset_m / self.cell_m).max(0.0);
            cells.min((corners - 1) as f64)
        };
        [within(x - self.origin[0], self.corners[0]), within(y - self.origin[1], self.corners[1])]
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::clearance::Clearance;

    /// A round hill on a plain: so many metres high, its top at the origin.
    pub(crate) fn hill(height_m: f64, radius_m: f64, extent_m: f64, cell_m: f64) -> Terrain {
        let corners = (extent_m / cell_m).round() as usize + 1;
        let at = |index: usize| index as f64 * cell_m - extent_m / 2.0;
        let height = |k: usize| {
            let share = libm::hypot(at(k % corners), at(k / corners)) / radius_m;
            height_m * (1.0 - share * share).max(0.0)
        };
        let heights_m = (0..corners * corners).map(height).collect();
        Terrain::new([-extent_m / 2.0; 2], cell_m, [corners; 2], heights_m).expect("it is a grid")
    }

    fn point() -> impl Strategy<Value = Point3<f64>> {
        [-180.0..180.0f64, -180.0..180.0f64, 0.0..70.0f64].prop_map(Point3::from)
    }

    proptest! {
        #[test]
        fn the_ground_is_its_triangles(a in point()) {
            let terrain = hill(40.0, 80.0, 200.0, 10.0);
            let surface = Clearance::of_triangles(terrain.triangles());
            let ground_m = terrain.height_m(a.x, a.y);
            let at = |z: f64| Point3::new(a.x, a.y, z);
            prop_assert!(surface.occluded(&at(ground_m - 1e-6), &at(ground_m + 1e-6)), "{} m", ground_m);
            prop_assert_eq!(terrain.contains(&a), surface.occluded(&a, &at(500.0)) && a.z < ground_m);
            prop_assert!(terrain.bounds().contains(&at(ground_m)));
        }

        #[test]
        fn no_place_of_a_line_is_nearer_to_the_ground_than_its_least_altitude(a in point(), b in point()) {
            let terrain = hill(40.0, 80.0, 200.0, 10.0);
            let [least_m, most_m] = terrain.altitudes_m(&a, &b);
            let (mut sampled_least_m, mut sampled_most_m) = (f64::INFINITY, f64::NEG_INFINITY);
            for k in 0..=2000 {
                let p = a + (b - a) * (f64::from(k) / 2000.0);
                let altitude_m = p.z - terrain.height_m(p.x, p.y);
                (sampled_least_m, sampled_most_m) = (sampled_least_m.min(altitude_m), sampled_most_m.max(altitude_m));
            }
            prop_assert!(least_m <= sampled_least_m + 1e-9 && sampled_least_m < least_m + 0.5, "{} {}", least_m, sampled_least_m);
            prop_assert!(most_m >= sampled_most_m - 1e-9 && sampled_most_m > most_m - 0.5, "{} {}", most_m, sampled_most_m);
            prop_assert!(terrain.keeps_altitude(&a, &b, [least_m, most_m]) && !terrain.keeps_altitude(&a, &b, [least_m + 0.01, most_m]));
            prop_assert!(!terrain.keeps_altitude(&a, &b, [least_m, most_m - 0.01]));
        }
    }

    #[test]
    fn what_makes_no_grid_is_refused() {
        assert!(Terrain::new([0.0; 2], 5.0, [2, 2], vec![0.0; 4]).is_some());
        assert!(Terrain::new([0.0; 2], 5.0, [1, 4], vec![0.0; 4]).is_none());
        assert!(Terrain::new([0.0; 2], 5.0, [2, 2], vec![0.0; 3]).is_none());
        assert!(Terrain::new([0.0; 2], 0.0, [2, 2], vec![0.0; 4]).is_none());
        assert!(Terrain::new([0.0; 2], 5.0, [2, 2], vec![f64::NAN; 4]).is_none());
    }
}
