//! Outlines of no-fly zones. A zone is barred exactly as it is given or not at all: what cannot be read without doubt is an error,
//! and no repair may make a zone smaller.

use geo::{Area, BooleanOps, Coord, MultiPolygon, Polygon};
use nalgebra::Point3;

use super::footprint::{self, MOST_CORNERS, RawPolygon, Repair, RingCounts, Winding};
use super::locate::DEGREE_M;
use super::report::ItemKind;
use crate::frame::{Geodetic, LocalFrame};

pub(crate) const ONLY_POLYGONS: &str = "give it as a Polygon or MultiPolygon without anything else";
const SIMPLIFY: &str = "simplify its outline so that the simpler one lies around it";
const REDRAW: &str = "correct its outline so that no ring crosses itself or another";
const DEGREES: &str = "give its corners as [longitude, latitude] in degrees";
const METRES: &str = "give its corners in metres in the scene's local frame";
const SPLIT: &str = "split it at the 180th meridian (RFC 7946, section 3.1.9)";

/// No structure leaves three times the greatest extent, and no flight goes farther from the structures than this, m.
const FARTHEST_FLIGHT_M: f64 = 10_000.0;

/// Corners that edits give lie no farther from the origin, m: beyond, rounding would move the outline.
const FARTHEST_CORNER_M: f64 = 1e6;

/// An edge is straight in degrees, not in the local frame; over this many degrees the difference is a few centimetres.
const STEP_DEG: f64 = 0.01;

/// Corners of a zone after its long edges are divided.
const MOST_DIVIDED: usize = 50_000;

/// Why a zone cannot be used, and the remedy.
type Refusal = (String, &'static str);

/// The outline of a zone in the local frame around `origin`, of corners in degrees. It is exact within the surroundings of the
/// scene and ends there; it is empty for a zone that lies wholly outside of them.
pub(crate) fn outline(
    polygons: &[RawPolygon],
    origin: Geodetic,
    max_extent_m: f64,
    repairs: &mut Vec<Repair>,
) -> Result<MultiPolygon<f64>, Refusal> {
    check(polygons)?;
    let area = Surroundings::new(origin, 3.0 * max_extent_m + FARTHEST_FLIGHT_M);
    let mut counts = RingCounts::default();
    let mut outline = Vec::new();
    let mut corners_left = MOST_DIVIDED;
    for polygon in polygons {
        // The surroundings may reach over the 180th meridian.
        for turn_deg in [-360.0, 0.0, 360.0] {
            let rings: Vec<Vec<Coord<f64>>> = polygon.iter().map(|ring| area.clip(ring, turn_deg)).collect();
            if rings.first().is_none_or(Vec::is_empty) {
                continue;
            }
            let whole = polygon.iter().flatten().all(|corner| area.holds(shifted(*corner, turn_deg)));
            let rings = rings.iter().map(|ring| local(ring, origin, &mut corners_left)).collect::<Option<RawPolygon>>();
            let rings = rings.ok_or_else(|| ("has edges too long and too many".to_owned(), SIMPLIFY))?;
            match body(&rings, &mut counts, repairs)? {
                Some(body) => outline.extend(body.0),
                None if whole => return Err(("has a part that encloses no area".into(), REDRAW)),
                None => {}
            }
        }
    }
    counts.tell(repairs);
    if outline.is_empty() {
        let exchanged = |ring: &Vec<Coord<f64>>| ring.iter().map(|corner| Coord { x: corner.y, y: corner.x }).collect::<Vec<_>>();
        if polygons.iter().flatten().any(|ring| !area.clip(&exchanged(ring), 0.0).is_empty()) {
            return Err(("lies far away, but near the scene with latitude and longitude exchanged".into(), DEGREES));
        }
        let km = area.reach_m / 1000.0;
        repairs
            .push((ItemKind::Outlier, format!("the zone lies wholly more than {km:.0} km from the scene: it bars nothing here")));
    }
    Ok(MultiPolygon(outline))
}

/// The outline that an edit gives in local metres, put in order. What crosses itself is refused, since it cannot be told what is meant.
pub(crate) fn checked(outline: &MultiPolygon<f64>) -> Result<MultiPolygon<f64>, Refusal> {
    let rings = |polygon: &Polygon<f64>| -> RawPolygon {
        std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(|ring| ring.0.clone()).collect()
    };
    let polygons: Vec<RawPolygon> = outline.iter().map(rings).collect();
    let corners: usize = polygons.iter().flatten().map(Vec::len).sum();
    if corners > MOST_CORNERS {
        return Err((format!("has {corners} corners, more than {MOST_CORNERS}"), SIMPLIFY));
    }
    if !polygons
        .iter()
        .flatten()
        .flatten()
        .all(|corner| corner.x.abs() <= FARTHEST_CORNER_M && corner.y.abs() <= FARTHEST_CORNER_M)
    {
        return Err(("has a corner that is not finite or too far away".into(), METRES));
    }
    let (mut counts, mut repairs, mut parts) = (RingCounts::default(), Vec::new(), Vec::new());
    for polygon in &polygons {
        let part = body(polygon, &mut counts, &mut repairs)?;
        parts.extend(part.ok_or_else(|| ("has a part that encloses no area".to_owned(), REDRAW))?.0);
    }
    match repairs.into_iter().next() {
        Some((_, problem)) => Err((format!("has an outline that is not sound ({problem})"), REDRAW)),
        None if parts.is_empty() => Err(("has no outline".into(), REDRAW)),
        None => Ok(MultiPolygon(parts)),
    }
}

/// A zone without a ceiling has [`f64::MAX`].
pub(crate) fn check_heights(floor_m: f64, ceiling_m: f64) -> Result<(), Refusal> {
    // Written so that NaN is refused too.
    if floor_m.is_finite() && ceiling_m > floor_m.max(0.0) && ceiling_m <= f64::MAX {
        return Ok(());
    }
    let problem = format!("has its floor at {floor_m} m and its ceiling at {ceiling_m} m");
    Err((problem, "give a floor below the ceiling, which lies above the ground, or no ceiling"))
}

fn check(polygons: &[RawPolygon]) -> Result<(), Refusal> {
    let corners: usize = polygons.iter().flatten().map(Vec::len).sum();
    if corners > MOST_CORNERS {
        return Err((format!("has {corners} corners, more than {MOST_CORNERS}"), SIMPLIFY));
    }
    if polygons.iter().any(|rings| rings.first().is_none_or(|ring| ring.len() < 3)) {
        return Err(("has a part of fewer than three corners".into(), REDRAW));
    }
    for ring in polygons.iter().flatten() {
        if let Some(corner) = ring.iter().find(|corner| !(corner.x.abs() <= 180.0 && corner.y.abs() <= 90.0)) {
            return Err((format!("has the corner [{}, {}], which is no longitude and latitude", corner.x, corner.y), DEGREES));
        }
        let next = ring.iter().cycle().skip(1);
        if ring.iter().zip(next).any(|(a, b)| (a.x - b.x).abs() > 180.0) {
            return Err(("has an edge over more than 180 degrees of longitude".into(), SPLIT));
        }
    }
    Ok(())
}

/// The exterior as far as any winding fills it, without the holes; `None` when it encloses no area.
fn body(rings: &RawPolygon, counts: &mut RingCounts, repairs: &mut Vec<Repair>) -> Result<Option<MultiPolygon<f64>>, Refusal> {
    let Some((exterior, holes)) = rings.split_first() else { return Ok(None) };
    let Some(exterior) = footprint::clean_ring(exterior, counts) else { return Ok(None) };
    // Non-zero winding fills all lobes, so it contains the zone whichever rule its author had in mind.
    let mut body = footprint::uncrossed(exterior, Winding::CounterClockwise, counts, repairs);
    for hole in holes {
        // What is dropped here is barred.
        let Some(hole) = footprint::clean_ring(hole, counts) else { continue };
        let mut found = Vec::new();
        let hole = footprint::uncrossed(hole, Winding::Clockwise, counts, &mut found);
        let left = body.difference(&hole);
        let cut_m2 = body.unsigned_area() - left.unsigned_area();
        let crosses = found.iter().any(|(kind, _)| *kind == ItemKind::SelfIntersection);
        if crosses || !footprint::agree(cut_m2, hole.unsigned_area()) {
            return Err(("has a hole that crosses itself, another hole or the outline".into(), REDRAW));
        }
        body = left;
    }
    Ok((body.unsigned_area() > 0.0).then_some(body))
}

fn shifted(corner: Coord<f64>, turn_deg: f64) -> Coord<f64> {
    Coord { x: corner.x + turn_deg, y: corner.y }
}

/// The box in degrees that holds every flight over the scene.
struct Surroundings {
    low: Coord<f64>,
    high: Coord<f64>,
    reach_m: f64,
}

impl Surroundings {
    fn new(origin: Geodetic, reach_m: f64) -> Self {
        let half_lat = reach_m / DEGREE_M;
        let cos_lat = libm::cos((origin.lat_deg.abs() + half_lat).min(90.0).to_radians());
        let half_lon = (half_lat / cos_lat.max(0.001)).min(180.0);
        Self {
            low: Coord { x: origin.lon_deg - half_lon, y: origin.lat_deg - half_lat },
            high: Coord { x: origin.lon_deg + half_lon, y: origin.lat_deg + half_lat },
            reach_m,
        }
    }

    fn holds(&self, corner: Coord<f64>) -> bool {
        (self.low.x..=self.high.x).contains(&corner.x) && (self.low.y..=self.high.y).contains(&corner.y)
    }

    /// The ring turned by `turn_deg` and cut to the box (Sutherland and Hodgman, Communications of the ACM 17, 1974). Within the
    /// box its winding stays as it is, whether it crosses itself or not.
    fn clip(&self, ring: &[Coord<f64>], turn_deg: f64) -> Vec<Coord<f64>> {
        let mut ring: Vec<Coord<f64>> = ring.iter().map(|corner| shifted(*corner, turn_deg)).collect();
        if ring.iter().all(|corner| self.holds(*corner)) {
            return ring;
        }
        if ring.first() == ring.last() {
            ring.pop();
        }
        let ring = cut(ring, |corner| corner.x - self.low.x);
        let ring = cut(ring, |corner| self.high.x - corner.x);
        let ring = cut(ring, |corner| corner.y - self.low.y);
        let mut ring = cut(ring, |corner| self.high.y - corner.y);
        ring.dedup();
        ring.extend(ring.first().copied());
        ring
    }
}

/// The part of a ring where `inside` is not negative; it is linear in the coordinates.
fn cut(ring: Vec<Coord<f64>>, inside: impl Fn(Coord<f64>) -> f64) -> Vec<Coord<f64>> {
    let mut kept = Vec::with_capacity(ring.len());
    for (a, b) in ring.iter().copied().zip(ring.iter().copied().cycle().skip(1)) {
        let (at_a, at_b) = (inside(a), inside(b));
        if at_a >= 0.0 {
            kept.push(a);
        }
        if (at_a >= 0.0) != (at_b >= 0.0) {
            kept.push(a + (b - a) * (at_a / (at_a - at_b)));
        }
    }
    kept
}

/// A ring of degrees in local metres, long edges divided; `None` when there are too many corners.
fn local(ring: &[Coord<f64>], origin: Geodetic, corners_left: &mut usize) -> Option<Vec<Coord<f64>>> {
    let frame = LocalFrame { origin: Some(origin) };
    let mut corners = Vec::with_capacity(ring.len());
    for (index, &a) in ring.iter().enumerate() {
        let b = ring[(index + 1) % ring.len()];
        let longest = (b.x - a.x).abs().max((b.y - a.y).abs());
        // The last edge closes the ring; where the file repeats the first corner it has no length.
        let steps = if a == b { 1 } else { (longest / STEP_DEG).ceil() as usize };
        *corners_left = corners_left.checked_sub(steps.max(1))?;
        for step in 0..steps.max(1) {
            let corner = a + (b - a) * (step as f64 / steps.max(1) as f64);
            let place = Geodetic { lat_deg: corner.y, lon_deg: corner.x, alt_m: 0.0 };
            let point: Point3<f64> = frame.local_from_geodetic(&place)?;
            corners.push(Coord { x: point.x, y: point.y });
        }
    }
    Some(corners)
}

#[cfg(test)]
mod tests {
    use geo::{Contains, Intersects, Point, coord};
    use proptest::prelude::*;

    use super::*;

    const ORIGIN: Geodetic = Geodetic { lat_deg: 52.0, lon_deg: 4.0, alt_m: 0.0 };

    fn ring(corners: &[[f64; 2]]) -> Vec<Coord<f64>> {
        corners.iter().map(|&[x, y]| coord! { x: x, y: y }).collect()
    }

    fn rectangle(west: f64, south: f64, east: f64, north: f64) -> Vec<Coord<f64>> {
        ring(&[[west, south], [east, south], [east, north], [west, north], [west, south]])
    }

    fn outlined(polygon: RawPolygon, origin: Geodetic) -> Result<(MultiPolygon<f64>, Vec<ItemKind>), Refusal> {
        let mut repairs = Vec::new();
        let outline = outline(&[polygon], origin, 20_000.0, &mut repairs)?;
        Ok((outline, repairs.into_iter().map(|(kind, _)| kind).collect()))
    }

    #[test]
    fn a_zone_is_judged_by_what_it_covers_not_by_its_extent() {
        for rectangle in
            [rectangle(3.0, 51.0, 5.0, 53.0), rectangle(-80.0, -89.0, 90.0, 90.0), rectangle(3.99, 51.99, 60.0, 52.01)]
        {
            let (outline, kinds) = outlined(vec![rectangle], ORIGIN).unwrap();
            assert!(outline.contains(&Point::new(0.0, 0.0)), "{outline:?}");
            assert_eq!(kinds, []);
        }
        let (outline, kinds) = outlined(vec![rectangle(-74.1, 40.6, -73.9, 40.8)], ORIGIN).unwrap();
        assert_eq!((outline.0.len(), kinds), (0, vec![ItemKind::Outlier]));
    }

    #[test]
    fn a_zone_beside_the_180th_meridian_reaches_over_it() {
        let origin = Geodetic { lat_deg: -17.0, lon_deg: 179.999, alt_m: 0.0 };
        let (outline, _) = outlined(vec![rectangle(-180.0, -17.1, -179.9, -16.9)], origin).unwrap();
        assert!(outline.contains(&Point::new(500.0, 0.0)) && !outline.intersects(&Point::new(0.0, 0.0)));
        let (problem, remedy) = outlined(vec![rectangle(-179.9, -17.1, 179.9, -16.9)], origin).unwrap_err();
        assert!(problem.contains("180 degrees") && remedy.contains("meridian"));
    }

    #[test]
    fn a_crossing_outline_bars_all_its_lobes() {
        let bow = ring(&[[3.9, 51.9], [4.1, 52.1], [4.1, 51.9], [3.9, 52.1], [3.9, 51.9]]);
        let (outline, kinds) = outlined(vec![bow], ORIGIN).unwrap();
        assert!(outline.contains(&Point::new(-5000.0, 0.0)) && outline.contains(&Point::new(5000.0, 0.0)));
        assert_eq!(kinds, [ItemKind::SelfIntersection]);
    }

    #[test]
    fn sound_holes_are_open_and_others_are_refused() {
        let hole = rectangle(3.99, 51.99, 4.01, 52.01);
        let (outline, _) = outlined(vec![rectangle(3.0, 51.0, 5.0, 53.0), hole], ORIGIN).unwrap();
        assert!(!outline.intersects(&Point::new(0.0, 0.0)) && outline.contains(&Point::new(5000.0, 0.0)));
        let crossing = ring(&[[3.99, 51.99], [4.01, 52.01], [4.01, 51.99], [3.99, 52.01], [3.99, 51.99]]);
        for hole in [crossing, rectangle(4.05, 51.99, 4.2, 52.01)] {
            assert!(outlined(vec![rectangle(3.9, 51.9, 4.1, 52.1), hole], ORIGIN).unwrap_err().0.contains("hole"));
        }
    }

    #[test]
    fn what_cannot_be_barred_exactly_is_refused_with_a_remedy() {
        let round = |count: usize| -> Vec<Coord<f64>> {
            let angle = |index: usize| index as f64 / count as f64 * std::f64::consts::TAU;
            (0..count)
                .map(|index| coord! { x: 4.0 + 0.1 * libm::cos(angle(index)), y: 52.0 + 0.1 * libm::sin(angle(index)) })
                .collect()
        };
        assert!(outlined(vec![round(MOST_CORNERS)], ORIGIN).is_ok());
        let cases = [
            (vec![round(MOST_CORNERS + 1)], "corners"),
            (vec![ring(&[[4.0, 52.0], [4.1, 52.0], [4.0, 52.0], [4.0, 52.0]])], "no area"),
            (vec![ring(&[[4.0, 52.0], [4.1, 52.0]])], "three corners"),
            (vec![rectangle(90_000.0, 435_000.0, 91_000.0, 436_000.0)], "no longitude"),
            (vec![rectangle(51.9, 3.9, 52.1, 4.1)], "exchanged"),
            (vec![], "three corners"),
        ];
        for (polygon, words) in cases {
            let (problem, remedy) = outlined(polygon, ORIGIN).unwrap_err();
            assert!(problem.contains(words) && remedy.len() > 20, "{problem}");
        }
    }

    proptest! {
        /// Inside of any quadrilateral by even-odd counting in degrees means inside of its outline in metres.
        #[test]
        fn nothing_that_is_given_is_left_open(
            corners in prop::array::uniform4(prop::array::uniform2(-2.0..2.0f64)), at in prop::array::uniform2(-0.3..0.3f64)
        ) {
            let given = ring(&corners.map(|[x, y]| [4.0 + x, 52.0 + y]));
            let place = coord! { x: 4.0 + at[0], y: 52.0 + at[1] };
            let edges = given.iter().zip(given.iter().cycle().skip(1));
            let crossed = |(a, b): (&Coord<f64>, &Coord<f64>)| {
                (a.y > place.y) != (b.y > place.y) && a.x + (b.x - a.x) * (place.y - a.y) / (b.y - a.y) > place.x
            };
            let inside = edges.filter(|edge| crossed(*edge)).count() % 2 == 1;
            prop_assume!(inside);
            let (outline, _) = outlined(vec![given], ORIGIN).unwrap();
            let frame = LocalFrame { origin: Some(ORIGIN) };
            let point = frame.local_from_geodetic(&Geodetic { lat_deg: place.y, lon_deg: place.x, alt_m: 0.0 }).unwrap();
            // Within the accuracy of divided edges.
            let [x, y] = [point.x, point.y];
            let near = Polygon::new(rectangle(x - 0.1, y - 0.1, x + 0.1, y + 0.1).into(), vec![]);
            prop_assert!(outline.intersects(&near), "{outline:?}");
        }
    }
}
