//! The take-off place, the ways out and home, and what the scene says of them.

use geo::{Coord, Intersects, Line, LineString, Polygon};
use nalgebra::Point3;

use super::{CourseError, Fence, Ground, HomeChoice, Sortie};
use crate::frame::{Geodetic, LocalFrame};
use crate::scene::free_space::{FreeSpace, Obstruction};
use crate::scene::{Bounds, NoFlyZone};

/// No radio and no rule lets a flight go farther than this from its take-off place, m.
const FARTHEST_HOME_M: f64 = 20_000.0;
/// Ways out and home are at least so far above all waypoints, m.
const ABOVE_WAYPOINTS_M: f64 = 2.0;
/// Above a take-off place that is higher than everything else, m.
const ABOVE_HOME_M: f64 = 5.0;
/// What many countries' rules allow, m above the ground.
const COMMON_CEILING_M: f64 = 120.0;
/// Free ground is looked for in circles around the first waypoint, so far apart and up to so far out, m, at so many azimuths.
const RING_M: f64 = 5.0;
const RINGS: u32 = 40;
const AZIMUTHS: u32 = 16;
/// An aircraft on the ground is this high, m: nothing has to be free below it.
const ON_GROUND_M: f64 = 0.5;
/// Heights that are compared are taken for so much larger, m.
const SLACK_M: f64 = 1e-6;

/// What is between two places of a way that was planned without them: nearer than the safety distance, or barred. Over a valley a way above everything
/// may be higher than the legal ceiling; that is noted ([`height_m`]).
pub fn obstruction(free: &FreeSpace, a: &Point3<f64>, b: &Point3<f64>) -> Option<Obstruction> {
    let around = free.structure_around(a).or_else(|| free.structure_around(b));
    around.map(|structure| Obstruction::Inside(structure.name.clone())).or_else(|| free.obstruction_at_any_altitude(a, b))
}

/// What a way passes through. Nearness alone does not count: a plan was checked with the safety distance of its own settings.
pub fn collision(free: &FreeSpace, a: &Point3<f64>, b: &Point3<f64>) -> Option<Obstruction> {
    let around = free.structure_around(a).or_else(|| free.structure_around(b));
    if let Some(structure) = around {
        return Some(Obstruction::Inside(structure.name.clone()));
    }
    if free.clearance.occluded(a, b) {
        return Some(Obstruction::TooNear { distance_m: 0.0, safety_m: free.safety_distance_m });
    }
    free.zone_between(a, b)
}

/// The take-off place in the local frame.
pub fn home(
    frame: &LocalFrame,
    path: &[Point3<f64>],
    free: Option<&FreeSpace>,
    choice: Option<HomeChoice>,
    notes: &mut Vec<String>,
) -> Result<Point3<f64>, CourseError> {
    let first = path.first().copied().unwrap_or_else(Point3::origin);
    if free.is_none() && choice.is_none_or(|choice| choice.alt_m.is_none()) {
        notes.push(
            "the take-off place is taken to lie at the scene's zero (its lowest ground), and all heights count from there; over hilly ground \
             give the scene with `--scene`, or the height of the place with `--home LAT,LON,ALT`"
                .to_owned(),
        );
    }
    match choice {
        Some(choice) => given_home(frame, &first, path, free, choice, notes),
        None => Ok(chosen_home(&first, path, free, notes)),
    }
}

fn given_home(
    frame: &LocalFrame,
    first: &Point3<f64>,
    path: &[Point3<f64>],
    free: Option<&FreeSpace>,
    choice: HomeChoice,
    notes: &mut Vec<String>,
) -> Result<Point3<f64>, CourseError> {
    let HomeChoice { lat_deg, lon_deg, alt_m } = choice;
    let ground_m = frame.origin.map_or(0.0, |origin| origin.alt_m);
    let place = Geodetic { lat_deg, lon_deg, alt_m: alt_m.unwrap_or(ground_m) };
    let is_place = lat_deg.abs() <= 90.0 && lon_deg.abs() <= 180.0 && (place.alt_m - ground_m).abs() <= 10_000.0;
    let home = frame.local_from_geodetic(&place).filter(|_| is_place);
    let Some(mut home) = home else {
        return Err(CourseError::NoPlace { value: format!("{lat_deg}, {lon_deg}, {} m", place.alt_m) });
    };
    let distance_m = (home.xy() - first.xy()).norm();
    if distance_m.is_nan() || distance_m > FARTHEST_HOME_M {
        return Err(CourseError::FarHome { distance_m, most_m: FARTHEST_HOME_M });
    }
    let Some(free) = free else { return Ok(home) };
    if alt_m.is_none() {
        home.z = Ground::of(Some(free)).height_m(home.x, home.y);
    }
    let (low, high) = column(&home, path, free);
    if let Some(obstruction) = collision(free, &low, &high) {
        let what = "the climb at the take-off place".to_owned();
        return Err(CourseError::Obstructed { what, obstruction, remedy: "take off elsewhere, with `--home LAT,LON`" });
    }
    let clear_m = free.clearance.standing_segment_distance_m(&low, &high, free.safety_distance_m);
    if clear_m < free.safety_distance_m {
        notes.push(format!(
            "the climb at the take-off place comes within {clear_m:.1} m of a structure, nearer than the safety distance of {} m",
            free.safety_distance_m
        ));
    }
    Ok(home)
}

/// Under the first waypoint, or as near to it as the ground is free.
fn chosen_home(first: &Point3<f64>, path: &[Point3<f64>], free: Option<&FreeSpace>, notes: &mut Vec<String>) -> Point3<f64> {
    let under = Point3::new(first.x, first.y, 0.0);
    let Some(free) = free else {
        notes.push(
            "the take-off place is the ground under the first waypoint; nothing is known of what stands there: give another one with `--home`, or \
             the scene with `--scene`"
                .to_owned(),
        );
        return under;
    };
    let last = path.last().unwrap_or(first);
    let ground = Ground::of(Some(free));
    let can_climb = |home: &Point3<f64>| {
        let (low, high) = column(home, path, free);
        let clear_m = free.clearance.standing_segment_distance_m(&low, &high, free.safety_distance_m);
        collision(free, &low, &high).is_none() && clear_m >= free.safety_distance_m
    };
    // Best with straight ways out and home.
    let is_free = |home: &Point3<f64>| {
        let (_, high) = column(home, path, free);
        let above = |p: &Point3<f64>| Point3::new(p.x, p.y, high.z);
        can_climb(home) && [above(first), above(last)].iter().all(|goal| obstruction(free, &high, goal).is_none())
    };
    let ring = |ring: u32| {
        (0..AZIMUTHS).map(move |k| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(AZIMUTHS));
            under + nalgebra::Vector3::new(sin, cos, 0.0) * (RING_M * f64::from(ring))
        })
    };
    let on_ground = |p: Point3<f64>| Point3::new(p.x, p.y, ground.height_m(p.x, p.y));
    let under = on_ground(under);
    let places = || std::iter::once(under).chain((1..=RINGS).flat_map(ring).map(on_ground));
    match places().find(is_free).or_else(|| places().find(can_climb)) {
        Some(home) if home == under => home,
        Some(home) => {
            let distance_m = (home.xy() - under.xy()).norm();
            notes.push(format!(
                "the ground under the first waypoint is not free; the take-off place is {distance_m:.0} m beside it (`--home` gives another one)"
            ));
            home
        }
        None => {
            notes.push("there is no free ground near the first waypoint; give the take-off place with `--home`".to_owned());
            under
        }
    }
}

/// The climb at a take-off place. The ground that is known may lie a few metres above the real one, and a place that was measured under it.
fn column(home: &Point3<f64>, path: &[Point3<f64>], free: &FreeSpace) -> (Point3<f64>, Point3<f64>) {
    let ground_m = Ground::of(Some(free)).height_m(home.x, home.y);
    let low = Point3::new(home.x, home.y, home.z.max(ground_m) + ON_GROUND_M);
    (low, Point3::new(home.x, home.y, top_m(path, home, Some(free))[1]))
}

/// Height of the ways out and home above the plane z = 0, m: above all waypoints and, where it is known, all that stands and the ground around.
pub fn height_m(path: &[Point3<f64>], home: &Point3<f64>, free: Option<&FreeSpace>, notes: &mut Vec<String>) -> f64 {
    let [lowest_m, height_m] = top_m(path, home, free);
    if free.is_none() {
        notes.push(
            "the scene is not known: the ways out and home lie above all waypoints, but perhaps not above all structures, and no-fly zones are not \
             looked at (`--scene` gives it)"
                .to_owned(),
        );
    }
    if height_m - lowest_m > COMMON_CEILING_M {
        let below = if lowest_m < home.z { "the lowest ground around" } else { "the take-off place" };
        notes.push(format!(
            "the ways out and home lie {:.0} m above {below}, to be above everything; many countries' rules allow {COMMON_CEILING_M} m",
            height_m - lowest_m
        ));
    }
    height_m
}

/// The lowest ground around a path and its take-off place, and the height that is above everything, m.
fn top_m(path: &[Point3<f64>], home: &Point3<f64>, free: Option<&FreeSpace>) -> [f64; 2] {
    let waypoints_m = path.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max) + ABOVE_WAYPOINTS_M;
    let mut top_m = waypoints_m.max(home.z + ABOVE_HOME_M);
    let Some(free) = free else { return [home.z, top_m] };
    let above = |height_m: f64| height_m + free.safety_distance_m + SLACK_M;
    if let Some(bounds) = free.bounds {
        top_m = top_m.max(above(bounds.max.z));
    }
    let around = Bounds::of_points(path.iter().copied().chain([*home]));
    let ground_m = free.terrain().zip(around).map(|(terrain, around)| terrain.range_within_m(&around));
    let [lowest_m, highest_m] = ground_m.unwrap_or([home.z, f64::NEG_INFINITY]);
    [lowest_m.min(home.z), top_m.max(above(highest_m))]
}

/// The zones as areas that must not be entered at any height. One that the course passes over or under cannot be given so.
pub fn fences(
    frame: &LocalFrame,
    free: Option<&FreeSpace>,
    home_m: Point3<f64>,
    sorties: &[Sortie],
    notes: &mut Vec<String>,
) -> Vec<Fence> {
    let coord = |p: &Point3<f64>| Coord { x: p.x, y: p.y };
    let course = |sortie: &Sortie| {
        let stops = sortie.stops.iter().map(|stop| &stop.at);
        let places = sortie.out.iter().chain(stops).chain(&sortie.back).map(|place| coord(&place.position_m));
        let begins = (!sortie.out.is_empty()).then(|| coord(&home_m));
        let corners: Vec<_> = begins.into_iter().chain(places).chain([coord(&home_m)]).collect();
        corners.windows(2).map(|ends| Line::new(ends[0], ends[1])).collect::<Vec<_>>()
    };
    let lines: Vec<Line<f64>> = sorties.iter().flat_map(course).collect();
    let mut fences = Vec::new();
    for zone in free.map_or(&[] as &[NoFlyZone], FreeSpace::zones) {
        // A fence has no holes.
        let filled = |polygon: &Polygon<f64>| Polygon::new(polygon.exterior().clone(), Vec::new());
        let parts: Vec<Polygon<f64>> = zone.outline.iter().map(filled).collect();
        if parts.iter().any(|part| lines.iter().any(|line| part.intersects(line))) {
            notes.push(format!(
                "the no-fly zone {:?} is not in the geofence: the course keeps out of it by its height or in a hole of it, which a fence does not know",
                zone.name
            ));
            continue;
        }
        fences.extend(parts.iter().filter_map(|part| fence(frame, zone, part.exterior())));
    }
    fences
}

fn fence(frame: &LocalFrame, zone: &NoFlyZone, ring: &LineString<f64>) -> Option<Fence> {
    let mut corners = &ring.0[..];
    if corners.len() > 1 && corners.first() == corners.last() {
        corners = &corners[..corners.len() - 1];
    }
    let place = |corner: &Coord<f64>| frame.geodetic_from_local(&Point3::new(corner.x, corner.y, 0.0));
    let corners: Vec<Geodetic> = corners.iter().map(place).collect::<Option<_>>()?;
    (corners.len() >= 3).then(|| Fence { name: zone.name.clone(), corners })
}
