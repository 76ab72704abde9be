//! The ground under a course, and how an aircraft flies that counts its heights from there.
//!
//! Between two places such an aircraft changes its height above the ground evenly, so that it rises and sinks with whatever lies between. Where that would
//! lead it away from the straight leg that a plan was checked on, it is told its height again.

use nalgebra::Point3;

use crate::scene::free_space::FreeSpace;
use crate::scene::terrain::Terrain;

/// An aircraft that follows the ground of the scene is no farther above or below the straight leg than this, m.
pub const RELIEF_M: f64 = 0.5;
/// Shorter legs than this, seen from above, are climbs, m.
const CLIMB_M: f64 = 0.1;

/// The terrain of a scene, or the plane z = 0 where it has none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ground<'a> {
    terrain: Option<&'a Terrain>,
}

impl<'a> Ground<'a> {
    pub fn of(free: Option<&'a FreeSpace>) -> Self {
        Self { terrain: free.and_then(FreeSpace::terrain) }
    }

    pub fn height_m(&self, x: f64, y: f64) -> f64 {
        self.terrain.map_or(0.0, |terrain| terrain.height_m(x, y))
    }

    /// The least height of the straight line from `a` to `b` above the ground, m.
    pub fn least_above_m(&self, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
        self.terrain.map_or(a.z.min(b.z), |terrain| terrain.altitudes_m(a, b)[0])
    }

    /// Places on the straight leg from `a` to `b` at which an aircraft is told its height again, without the ends: as few as a division at the worst place
    /// finds (Douglas and Peucker, Cartographica 10, 1973).
    pub fn relief(&self, a: &Point3<f64>, b: &Point3<f64>) -> Vec<Point3<f64>> {
        let profile = self.profile(a, b);
        let mut kept = vec![false; profile.len()];
        let mut parts = vec![(0, profile.len().saturating_sub(1))];
        while let Some((from, to)) = parts.pop() {
            let worst = (from + 1..to).map(|k| (k, off_m(&profile, from, to, k).abs())).max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((k, _)) = worst.filter(|(_, off_m)| *off_m > RELIEF_M) {
                kept[k] = true;
                parts.extend([(from, k), (k, to)]);
            }
        }
        profile.iter().zip(kept).filter(|(_, is_kept)| *is_kept).map(|((share, _), _)| a + (b - a) * *share).collect()
    }

    /// Corners of the way from `a` to `b` of an aircraft that keeps to heights above this ground.
    pub fn followed(&self, a: &Point3<f64>, b: &Point3<f64>) -> Vec<Point3<f64>> {
        let profile = self.profile(a, b);
        let last = profile.len() - 1;
        let place = |k: usize| {
            let on_leg = a + (b - a) * profile[k].0;
            Point3::new(on_leg.x, on_leg.y, on_leg.z + if k == 0 || k == last { 0.0 } else { off_m(&profile, 0, last, k) })
        };
        (0..=last).map(place).collect()
    }

    /// Height of the ground where its slope changes along a leg, by the share of the leg.
    fn profile(&self, a: &Point3<f64>, b: &Point3<f64>) -> Vec<(f64, f64)> {
        let shares = match self.terrain {
            Some(terrain) if (b.xy() - a.xy()).norm() > CLIMB_M => terrain.sides_passed(a, b),
            _ => vec![0.0, 1.0],
        };
        let height_m = |share: f64| {
            let at = a + (b - a) * share;
            self.height_m(at.x, at.y)
        };
        shares.into_iter().map(|share| (share, height_m(share))).collect()
    }
}

/// How far the ground lies above the straight line between two places of its profile, m.
fn off_m(profile: &[(f64, f64)], from: usize, to: usize, k: usize) -> f64 {
    let ((start, low_m), (end, high_m), (share, height_m)) = (profile[from], profile[to], profile[k]);
    height_m - low_m - (high_m - low_m) * (share - start) / (end - start)
}
