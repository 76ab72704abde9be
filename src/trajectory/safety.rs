//! The final safety check: no plan is published whose curve leaves the safe space anywhere.

use nalgebra::Point3;
use rayon::prelude::*;

use super::corner::Corner;
use super::curve::{Arc, Curve};
use super::known::Scope;
use super::limits::Limits;
use super::plan::Image;
use crate::camera::{Pose, Rig, pitch_rad};
use crate::scene::free_space::{FreeSpace, Obstruction};

/// A leg or waypoint that is not safe.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnsafeCurve {
    #[error("waypoint {index} at ({position}) is not safe: {cause}")]
    Waypoint { index: usize, position: String, cause: Obstruction },
    #[error("image {index} looks to pitch {pitch_deg:.2} degrees, beyond the gimbal's range")]
    View { index: usize, pitch_deg: f64 },
    #[error("the leg from waypoint {from} to the next is not safe: {cause}")]
    Leg { from: usize, cause: Obstruction },
    #[error("the arc at waypoint {index} is not safe: {cause}")]
    Arc { index: usize, cause: Obstruction },
    #[error("leg {leg}, on which the aircraft is to get out of where it must not be, comes nearer to something")]
    Egress { leg: usize },
}

/// Arcs are checked by the triangles of chords and tangents; a chord keeps this close to its arc, m. All sides of the triangles keep the safety
/// distance, so that an arc between them falls short of it by no more than a centimetre squared over twice that distance: 10 micrometres at 5 m.
const SAGITTA_M: f64 = 1e-2;
/// Points of an arc for what has no edge, m: a hole that lets an arc in is wider than twice the safety distance.
const COARSE_SAGITTA_M: f64 = 0.1;
/// An arc that is not safe is tried again at half the distance from its corner, this often; then the drone stops there.
const HALVINGS: i32 = 5;
/// Legs or arcs that a worker takes at once, at least.
const LEAST_PARTS: usize = 32;

/// How far the arc at each waypoint may pass from it, m: as far as the settings say, less where that arc would not be safe, and not at all
/// where none is. The legs of the path are safe, so there is always a way to fly it.
pub fn deviations_m(path: &[Pose], limits: &Limits, scope: Scope) -> Vec<f64> {
    let widest_m = limits.dynamics.corner_deviation_m;
    let safe_m = |at: &[Pose]| {
        let (before, corner, after) = (&at[0].position, &at[1].position, &at[2].position);
        let is_safe = |deviation_m: &f64| {
            let rounded = Corner::new(&(corner - before), &(after - corner), *deviation_m);
            let free = scope.round_corner([before, corner, after], *deviation_m);
            arc_obstruction(&Arc::new(before, corner, after, &rounded), free).is_none()
        };
        (0..=HALVINGS).map(|halved| widest_m / f64::from(1 << halved)).find(is_safe).unwrap_or(0.0)
    };
    let mut deviations_m = vec![0.0; path.len()];
    let inner = deviations_m.par_iter_mut().skip(1).zip(path.par_windows(3)).with_min_len(LEAST_PARTS);
    inner.for_each(|(deviation_m, at)| *deviation_m = safe_m(at));
    deviations_m
}

/// Checks the whole of the curve, its arcs included, and every waypoint; returns the smallest distance of the curve to a structure or to the
/// ground, m: up to two centimetres too small where that lies on an arc.
pub fn check(curve: &Curve, free: &FreeSpace) -> Result<f64, UnsafeCurve> {
    check_behind(curve, 0, Scope::everywhere(free))
}

/// The same without the first legs, which have rules of their own ([`super::egress`]); the smallest distance is that of the whole curve.
pub fn check_behind(curve: &Curve, legs: usize, scope: Scope) -> Result<f64, UnsafeCurve> {
    let waypoints = curve.waypoints.par_iter().enumerate().skip(legs).with_min_len(LEAST_PARTS).find_map_first(|(index, p)| {
        let cause = scope.at(p).obstruction_at(p)?;
        Some(UnsafeCurve::Waypoint { index, position: format!("{:.1}, {:.1}, {:.1}", p.x, p.y, p.z), cause })
    });
    let straight_parts = || {
        (legs..curve.legs()).into_par_iter().with_min_len(LEAST_PARTS).find_map_first(|from| {
            let [start, end] = curve.straight(from);
            scope.along_straight(curve, from).obstruction_between(&start, &end).map(|cause| UnsafeCurve::Leg { from, cause })
        })
    };
    let arcs =
        || {
            curve.arcs.par_iter().enumerate().skip(legs).with_min_len(LEAST_PARTS).find_map_first(|(index, arc)| {
                arc_obstruction(arc, scope.on_arc(arc)).map(|cause| UnsafeCurve::Arc { index, cause })
            })
        };
    if let Some(unsafe_part) = waypoints.or_else(straight_parts).or_else(arcs) {
        return Err(unsafe_part);
    }
    Ok(least_distance_m(curve, scope.free()))
}

/// Checks that the gimbal can be pitched to every image.
pub fn check_views(rig: &Rig, images: &[Image]) -> Result<(), UnsafeCurve> {
    let beyond = images.iter().enumerate().find_map(|(index, image)| {
        let direction = image.direction.filter(|direction| !rig.reaches(direction))?;
        Some(UnsafeCurve::View { index, pitch_deg: pitch_rad(&direction).to_degrees() })
    });
    beyond.map_or(Ok(()), Err)
}

/// Why an arc between two safe legs is not safe. It lies within the triangle of its corner and its ends, so that it keeps the limits of the
/// flight, which are convex, where these do.
fn arc_obstruction(arc: &Arc, free: &FreeSpace) -> Option<Obstruction> {
    let [start, end] = arc.ends();
    // All sides of the hull keep the altitudes above the terrain, and the arc between them, where the ground is no steeper than 45 degrees, to twice the
    // sagitta.
    if free.terrain().is_some()
        && let Some(cause) = arc.hull(SAGITTA_M).flatten().find_map(|[from, to]| free.altitude_between(&from, &to))
    {
        return Some(cause);
    }
    // Most arcs are far from everything: one look at the whole arc is enough, but for zones, of which some are thinner than an arc, and for what
    // lies behind a large hole of a mesh.
    if free.clearance.keeps_distance(&start, &end, free.safety_distance_m + arc.sagitta_m()) {
        let around = arc
            .points(COARSE_SAGITTA_M)
            .find_map(|p| free.open_structure_around(&p).map(|s| Obstruction::Inside(s.name.clone())));
        return around.or_else(|| arc.hull(SAGITTA_M).flatten().find_map(|[from, to]| free.zone_between(&from, &to)));
    }
    arc.hull(SAGITTA_M).flatten().find_map(|[from, to]| free.obstruction_between(&from, &to))
}

/// Nearly every flight passes something about as closely as it may, which is soon found where nothing farther away is looked at.
const NEAR_SHARE: f64 = 1.2;

fn least_distance_m(curve: &Curve, free: &FreeSpace) -> f64 {
    let near_m = NEAR_SHARE * free.safety_distance_m;
    let found_m = least_distance_within_m(near_m, curve, free);
    if found_m < near_m { found_m } else { least_distance_within_m(f64::INFINITY, curve, free) }
}

/// The smallest distance if it is below `cap_m`, else that.
fn least_distance_within_m(cap_m: f64, curve: &Curve, free: &FreeSpace) -> f64 {
    let clearance = &free.clearance;
    let distance_m = |least_m: f64, [from, to]: [Point3<f64>; 2]| clearance.segment_distance_m(&from, &to, least_m);
    let lowest_m = |points: &mut dyn Iterator<Item = Point3<f64>>| points.map(|p| p.z).fold(f64::INFINITY, f64::min);
    // A curve of straight parts and arcs is lowest at the end of an arc or on one, which lies between its ends and its corner.
    let ends_m = lowest_m(&mut curve.arcs.iter().flat_map(Arc::ends)).min(cap_m);
    let lower = curve.arcs.iter().filter(|arc| arc.corner.z < ends_m);
    let ground_m = lowest_m(&mut lower.flat_map(|arc| arc.hull(SAGITTA_M)).flatten().flatten()).min(ends_m);
    let first_m = curve.waypoints.first().map_or(ground_m, |p| clearance.point_distance_m(p, ground_m.min(p.z)));
    let least = |one_m: f64, other_m: f64| one_m.min(other_m);
    let legs = (0..curve.legs()).into_par_iter().with_min_len(LEAST_PARTS).map(|leg| curve.straight(leg));
    let of_legs_m = legs.fold(|| first_m.min(ground_m), distance_m).reduce(|| f64::INFINITY, least).min(first_m.min(ground_m));
    let of_arc_m = |least_m: f64, arc: &Arc| {
        let [start, end] = arc.ends();
        if clearance.keeps_distance(&start, &end, least_m + arc.sagitta_m()) {
            return least_m;
        }
        arc.hull(SAGITTA_M).flatten().fold(least_m, distance_m)
    };
    let arcs = curve.arcs.par_iter().with_min_len(LEAST_PARTS);
    arcs.fold(|| of_legs_m, of_arc_m).reduce(|| of_legs_m, least)
}

#[cfg(test)]
mod tests {
    use geo::{LineString, MultiPolygon, Polygon};
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{BlockSettings, NoFlyZone, ZoneSource, generate_block};
    use crate::settings::Settings;
    use crate::trajectory::profile::Profile;

    fn free_space(zone: [[f64; 2]; 4]) -> (FreeSpace, Limits) {
        let Settings { flight, dynamics, .. } = Settings::default();
        let mut scene = generate_block(&BlockSettings { seed: 3, extent_m: [130.0, 130.0], buildings: 9, ..Default::default() });
        let outline = MultiPolygon::new(vec![Polygon::new(LineString::from(zone.map(|[x, y]| (x, y)).to_vec()), vec![])]);
        let source = ZoneSource::File;
        scene.zones.push(NoFlyZone { name: "pad".to_owned(), outline, floor_m: 0.0, ceiling_m: 60.0, source });
        let free = FreeSpace::new(&scene, &flight).unwrap();
        (free, Limits::new(&Rig::preset("panoramic").unwrap(), &Settings::default().flight, &dynamics))
    }

    const FAR_ZONE: [[f64; 2]; 4] = [[20.0, 20.0], [40.0, 20.0], [40.0, 40.0], [20.0, 40.0]];

    proptest! {
        #![proptest_config(ProptestConfig { cases: 150, max_global_rejects: 100_000, ..ProptestConfig::default() })]
        #[test]
        fn arcs_round_safe_corners_keep_out_of_everything(
            corners in prop::collection::vec([-70.0..70.0f64, -70.0..70.0, 5.0..45.0], 3..4), widest_m in 0.5..12.0f64,
        ) {
            let (free, mut limits) = free_space(FAR_ZONE);
            limits.dynamics.corner_deviation_m = widest_m;
            let path: Vec<Pose> = corners.iter().map(|&p| Pose { position: p.into(), direction: None }).collect();
            prop_assume!(path.iter().all(|pose| free.is_safe(&pose.position)));
            prop_assume!(path.windows(2).all(|leg| free.is_leg_safe(&leg[0].position, &leg[1].position)));
            let deviations_m = deviations_m(&path, &limits, Scope::everywhere(&free));
            let profile = Profile::rounded(&path, &limits, &deviations_m);
            let clearance_m = check(profile.curve(), &free);
            prop_assert!(clearance_m.is_ok(), "{:?}", clearance_m);
            let mut least_m = f64::INFINITY;
            let steps = 500;
            for k in 0..=steps {
                let arc = &profile.curve().arcs[1];
                let p = arc.at(arc.deviation_rad * f64::from(k) / f64::from(steps)).0;
                least_m = least_m.min(free.clearance.point_distance_m(&p, 100.0)).min(p.z);
                prop_assert!(least_m >= free.safety_distance_m - 1e-5, "{} m at {}", least_m, p);
                prop_assert!(free.limits.contains(&p) && free.structure_around(&p).is_none());
                prop_assert!(!(20.0..=40.0).contains(&p.x) || !(20.0..=40.0).contains(&p.y) || p.z > 60.0, "{} lies in the zone", p);
            }
            prop_assert!(clearance_m.unwrap() <= least_m + 1e-9);
        }
    }

    #[test]
    fn an_arc_that_would_cut_through_a_zone_is_made_smaller_and_at_last_a_stop() {
        // A right angle round a zone whose corner comes within `gap_m` of the path's.
        let corner = |gap_m: f64| {
            let inner = 100.0 + gap_m;
            let (mut free, limits) = free_space([[inner, inner], [180.0, inner], [180.0, 180.0], [inner, 180.0]]);
            (free.limits.min, free.limits.max) = ([-500.0, -500.0, 5.0].into(), [500.0; 3].into());
            let at = |x, y| Pose { position: Point3::new(x, y, 50.0), direction: None };
            let path = [at(160.0, 100.0), at(100.0, 100.0), at(100.0, 160.0)];
            let deviations_m = deviations_m(&path, &limits, Scope::everywhere(&free));
            assert!(check(Profile::rounded(&path, &limits, &deviations_m).curve(), &free).is_ok(), "{gap_m}");
            if deviations_m[1] < 1.0 {
                let whole = Profile::rounded(&path, &limits, &[1.0; 3]);
                assert!(matches!(check(whole.curve(), &free), Err(UnsafeCurve::Arc { index: 1, .. })), "{gap_m}");
            }
            deviations_m[1]
        };
        // The arc's middle lies on the diagonal, where the zone's corner is the gap times the root of 2 away.
        assert_eq!([1.0, 0.5, 0.2, 0.01].map(corner), [1.0, 0.5, 0.25, 0.0]);
    }
}
