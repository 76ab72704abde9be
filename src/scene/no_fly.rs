//! Where a no-fly zone bars: within its outline, between two heights above the ground below.
//!
//! Over terrain floor and ceiling rise and fall with it, so that a zone bars on a hill as much as in the valley. The heights of a straight line above the ground go
//! through all that lies between the least and the greatest, so that the test is exact for each part of the line within the outline.

use geo::{Coord, Intersects, Line, LineString};
use nalgebra::Point3;

use super::bounds::Bounds;
use super::proxy::{NoFlyZone, Scene};
use super::terrain::Terrain;

/// Heights may miss a zone by this for rounding and are in it all the same, m.
const ROUNDING_M: f64 = 1e-9;

impl Scene {
    /// The ground where it is not flat.
    pub fn terrain(&self) -> Option<&Terrain> {
        self.structures.iter().find_map(|structure| structure.terrain()).map(|terrain| &**terrain)
    }
}

impl NoFlyZone {
    /// The box around the zone, m; `None` for one that lies far away.
    pub fn bounds(&self, terrain: Option<&Terrain>) -> Option<Bounds> {
        let on_plane = Bounds::above(&self.outline, self.floor_m, self.ceiling_m)?;
        let [lowest_m, highest_m] = terrain.map_or([0.0; 2], |terrain| terrain.range_within_m(&on_plane));
        Bounds::above(&self.outline, lowest_m + self.floor_m, highest_m + self.ceiling_m)
    }

    /// Whether the segment from `a` to `b` enters the zone; its border belongs to it.
    pub fn meets(&self, a: &Point3<f64>, b: &Point3<f64>, terrain: Option<&Terrain>) -> bool {
        terrain.map_or_else(|| self.meets_over_plane(a, b), |terrain| self.meets_over(terrain, a, b))
    }

    fn meets_over_plane(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        let Some((enter, leave)) = share_between(a.z, b.z, self.floor_m, self.ceiling_m) else {
            return false;
        };
        let at = |t: f64| Coord { x: a.x + (b.x - a.x) * t, y: a.y + (b.y - a.y) * t };
        let (from, to) = (at(enter), at(leave));
        if from == to { self.outline.intersects(&from) } else { self.outline.intersects(&Line::new(from, to)) }
    }

    fn meets_over(&self, terrain: &Terrain, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        let [lowest_m, highest_m] = terrain.range_m();
        if a.z.max(b.z) - lowest_m < self.floor_m || a.z.min(b.z) - highest_m > self.ceiling_m {
            return false;
        }
        let bars = |from: &Point3<f64>, to: &Point3<f64>| {
            let [least_m, most_m] = terrain.altitudes_m(from, to);
            least_m <= self.ceiling_m + ROUNDING_M && most_m >= self.floor_m - ROUNDING_M
        };
        let coord = |p: &Point3<f64>| Coord { x: p.x, y: p.y };
        let line = Line::new(coord(a), coord(b));
        if line.start == line.end {
            return self.outline.intersects(&line.start) && bars(a, b);
        }
        if !self.outline.intersects(&line) || !bars(a, b) {
            return false;
        }
        let at = |share: f64| a + (b - a) * share;
        let shares = self.border_shares(&line);
        let touches = shares.iter().any(|&share| self.outline.intersects(&coord(&at(share))) && bars(&at(share), &at(share)));
        let is_inside = |ends: &[f64]| self.outline.intersects(&coord(&at((ends[0] + ends[1]) / 2.0)));
        touches || shares.windows(2).any(|ends| is_inside(ends) && bars(&at(ends[0]), &at(ends[1])))
    }

    /// The ends of a line and where it meets the outline's sides, as shares of it and in their order.
    fn border_shares(&self, line: &Line<f64>) -> Vec<f64> {
        let along = line.end - line.start;
        let length_squared = along.x * along.x + along.y * along.y;
        let mut shares = vec![0.0, 1.0];
        let rings = self.outline.iter().flat_map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()));
        for side in rings.flat_map(LineString::lines) {
            let (over, to) = (side.end - side.start, side.start - line.start);
            let across = along.x * over.y - along.y * over.x;
            if across != 0.0 {
                shares.push((to.x * over.y - to.y * over.x) / across);
            } else {
                // Along the line, if it lies on it.
                let of = |corner: Coord<f64>| (corner.x * along.x + corner.y * along.y) / length_squared;
                shares.extend([of(to), of(to + over)]);
            }
        }
        shares.retain(|share| (0.0..=1.0).contains(share));
        shares.sort_by(f64::total_cmp);
        shares.dedup();
        shares
    }
}

/// The part of 0..1 in which the height from `z0` to `z1` lies within `floor..ceiling`.
fn share_between(z0: f64, z1: f64, floor: f64, ceiling: f64) -> Option<(f64, f64)> {
    if z0 == z1 {
        return (floor..=ceiling).contains(&z0).then_some((0.0, 1.0));
    }
    let (t0, t1) = ((floor - z0) / (z1 - z0), (ceiling - z0) / (z1 - z0));
    let (enter, leave) = (t0.min(t1).max(0.0), t0.max(t1).min(1.0));
    (enter <= leave).then_some((enter, leave))
}

#[cfg(test)]
mod tests {
    use geo::polygon;
    use proptest::prelude::*;

    use super::*;
    use crate::scene::differences::Differences;
    use crate::scene::free_space::FreeSpace;
    use crate::scene::terrain::tests::hill;
    use crate::scene::{Shape, Structure, StructureId, TERRAIN_NAME, ZoneSource};
    use crate::settings::Settings;

    fn zone(floor_m: f64, ceiling_m: f64) -> NoFlyZone {
        let outline = polygon!(
            exterior: [(x: -60.0, y: -40.0), (x: 60.0, y: -30.0), (x: 50.0, y: 50.0), (x: 5.0, y: 20.0), (x: -45.0, y: 55.0)],
            interiors: [[(x: -10.0, y: -10.0), (x: -10.0, y: 5.0), (x: 10.0, y: 0.0)]],
        );
        NoFlyZone { name: "pad".into(), outline: outline.into(), floor_m, ceiling_m, source: ZoneSource::Edit }
    }

    fn point() -> impl Strategy<Value = Point3<f64>> {
        [-90.0..90.0f64, -90.0..90.0f64, 0.0..120.0f64].prop_map(Point3::from)
    }

    proptest! {
        #[test]
        fn a_zone_bars_between_heights_above_the_ground_below(
            a in point(), b in point(), floor_m in 0.0..60.0f64, height_m in 1.0..40.0f64,
        ) {
            let terrain = hill(40.0, 80.0, 200.0, 10.0);
            let zone = zone(floor_m, floor_m + height_m);
            let is_in = |p: &Point3<f64>, by_m: f64| {
                let altitude_m = p.z - terrain.height_m(p.x, p.y);
                zone.outline.intersects(&Coord { x: p.x, y: p.y }) && altitude_m >= floor_m - by_m && altitude_m <= floor_m + height_m + by_m
            };
            let places: Vec<Point3<f64>> = (0..=3000).map(|k| a + (b - a) * (f64::from(k) / 3000.0)).collect();
            let meets = zone.meets(&a, &b, Some(&terrain));
            prop_assert!(meets || !places.iter().any(|p| is_in(p, 0.0)));
            prop_assert!(!meets || places.iter().any(|p| is_in(p, 0.2)) || places.iter().any(|p| is_in(&(p + (b - a) / 6000.0), 0.2)));
            prop_assert!(!meets || zone.bounds(Some(&terrain)).unwrap().grown(1e-6).meets_segment(&a, &b));
        }

        #[test]
        fn level_terrain_is_the_plane(a in point(), b in point(), floor_m in 0.0..60.0f64, height_m in 1.0..40.0f64) {
            let level = Terrain::new([-100.0; 2], 100.0, [3, 3], vec![0.0; 9]).unwrap();
            let zone = zone(floor_m, floor_m + height_m);
            prop_assert_eq!(zone.meets(&a, &b, Some(&level)), zone.meets(&a, &b, None));
        }
    }

    #[test]
    fn a_ceiling_above_the_ground_bars_on_the_hill_as_well() {
        let terrain = hill(40.0, 80.0, 200.0, 10.0);
        let zone = zone(0.0, 30.0);
        let over_the_hill = [Point3::new(-40.0, 12.0, 60.0), Point3::new(40.0, 12.0, 60.0)];
        assert!(zone.meets(&over_the_hill[0], &over_the_hill[1], Some(&terrain)), "22 m above the ground");
        assert!(!zone.meets(&over_the_hill[0], &over_the_hill[1], None));
        let high = over_the_hill.map(|p| Point3::new(p.x, p.y, 71.0));
        assert!(!zone.meets(&high[0], &high[1], Some(&terrain)));

        // A scene on the hill bars the same, and an edit of the zone touches all that it bars.
        let (name, shape) = (TERRAIN_NAME.to_owned(), Shape::Terrain(terrain.into()));
        let ground = Structure { id: StructureId::of_name(&name), name, shape };
        let scene =
            Scene { name: "hill".into(), frame: Default::default(), structures: vec![ground.into()], zones: vec![zone.clone()] };
        let free = FreeSpace::new(&scene, &Settings::default().flight).unwrap();
        assert!(free.zone_between(&over_the_hill[0], &over_the_hill[1]).is_some());
        assert!(free.zone_between(&high[0], &high[1]).is_none());
        let without = Scene { zones: Vec::new(), ..scene.clone() };
        let touched = Differences::between(&without, &scene).barred[0];
        assert!(touched.max.z >= 60.0 && touched.contains(&Point3::new(0.0, 12.0, 60.0)), "{touched:?}");
    }
}
