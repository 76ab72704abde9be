//! Repairs of footprints: any rings in, a valid footprint out, with a word on everything that had to be changed.

use geo::algorithm::bool_ops::{FillRule, OpType};
use geo::orient::{Direction, Orient};
use geo::{Area, BooleanOps, Coord, LineString, MultiPolygon, Polygon};

use super::report::ItemKind;

/// Vertices closer than this are one, and edges that part by less than this are a spike, m.
const SAME_POINT_M: f64 = 1e-3;

/// Exchanged corners lengthen a ring by more than the rounding of its coordinates, m.
const STEP_BACK_M: f64 = 0.01;

/// Footprints and parts below this area are left out, m^2.
const LEAST_AREA_M2: f64 = 0.01;

/// Areas agree within this share; the boolean operations work on a grid of about a billionth of the extent.
const AREA_TOLERANCE: f64 = 1e-6;

/// Footprints of more corners are left out: resolving the crossings of a hostile ring takes the square of its corners.
pub(crate) const MOST_CORNERS: usize = 2000;

/// A repair and what it did, in words.
pub(crate) type Repair = (ItemKind, String);

/// A polygon as it stands in a file: rings of corners, m, the exterior first, not yet known to be closed or free of crossings.
pub(crate) type RawPolygon = Vec<Vec<Coord<f64>>>;

/// A valid footprint of these polygons (exteriors counter-clockwise, holes clockwise, no crossings), or the reason why there is
/// none. Crossing lobes of an exterior ring all count as built (non-zero winding).
pub(crate) fn repair(polygons: &[RawPolygon], repairs: &mut Vec<Repair>) -> Result<MultiPolygon<f64>, String> {
    let corners: usize = polygons.iter().flatten().map(Vec::len).sum();
    if corners > MOST_CORNERS {
        return Err(format!("its {corners} corners are more than {MOST_CORNERS}; simplify it"));
    }
    let mut counts = RingCounts::default();
    let parts: Vec<_> = polygons.iter().filter_map(|rings| repair_polygon(rings, &mut counts, repairs)).collect();
    counts.tell(repairs);
    let nothing = || "its rings enclose no area".to_owned();
    if parts.is_empty() {
        return Err(nothing());
    }
    if parts.len() < polygons.len() {
        repairs.push((
            ItemKind::PartsDropped,
            format!("{} of {} parts have no area: dropped", polygons.len() - parts.len(), polygons.len()),
        ));
    }
    let footprint = unite(parts, repairs);
    if footprint.0.is_empty() { Err(nothing()) } else { Ok(footprint) }
}

/// The footprint cleaned as by [`repair`], for rings whose closing vertex is repeated.
pub(crate) fn repair_closed(polygons: &[Polygon<f64>], repairs: &mut Vec<Repair>) -> Result<MultiPolygon<f64>, String> {
    let raw: Vec<RawPolygon> = polygons
        .iter()
        .map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(|ring| ring.0.clone()).collect())
        .collect();
    repair(&raw, repairs)
}

/// Defects of rings that are mended, counted.
#[derive(Default)]
pub(crate) struct RingCounts {
    open: usize,
    duplicates: usize,
    spikes: usize,
    reversed: usize,
}

impl RingCounts {
    pub fn tell(&self, repairs: &mut Vec<Repair>) {
        if self.open > 0 {
            repairs.push((ItemKind::OpenRing, format!("{} open rings closed", self.open)));
        }
        if self.duplicates > 0 {
            repairs.push((ItemKind::DuplicateVertices, format!("{} duplicate vertices removed", self.duplicates)));
        }
        if self.spikes > 0 {
            repairs.push((ItemKind::Spike, format!("{} spikes removed", self.spikes)));
        }
        if self.reversed > 0 {
            repairs.push((ItemKind::WrongWinding, format!("{} rings turned round", self.reversed)));
        }
    }
}

fn repair_polygon(rings: &RawPolygon, counts: &mut RingCounts, repairs: &mut Vec<Repair>) -> Option<MultiPolygon<f64>> {
    let (exterior, holes) = rings.split_first()?;
    let exterior = clean_ring(exterior, counts)?;
    let exterior = uncrossed(exterior, Winding::CounterClockwise, counts, repairs);
    let mut body = exterior;
    for hole in holes {
        let Some(hole) = clean_ring(hole, counts) else {
            repairs.push((ItemKind::HoleDropped, "a hole without area dropped".into()));
            continue;
        };
        let hole = uncrossed(hole, Winding::Clockwise, counts, repairs);
        body = cut(body, &hole, repairs);
    }
    body.0.retain(|polygon| polygon.unsigned_area() >= LEAST_AREA_M2);
    (!body.0.is_empty()).then_some(body)
}

/// The ring closed, without repeated vertices and spikes; `None` when fewer than three corners are left.
pub(crate) fn clean_ring(ring: &[Coord<f64>], counts: &mut RingCounts) -> Option<Vec<Coord<f64>>> {
    let mut corners = ring.to_vec();
    if corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    } else if corners.len() > 2 {
        counts.open += 1;
    }
    let mut kept: Vec<Coord<f64>> = Vec::with_capacity(corners.len());
    for corner in corners {
        push_corner(&mut kept, corner, counts);
    }
    // The seam: what was said of neighbours holds across the ends of the list too.
    let mut seam = &kept[..];
    while let [first, second, .., before, last] | [first, second @ before, last] = seam {
        if near(*first, *last) {
            counts.duplicates += 1;
            seam = &seam[..seam.len() - 1];
        } else if is_spike(*before, *last, *first) {
            counts.spikes += 1;
            seam = &seam[..seam.len() - 1];
        } else if is_spike(*last, *first, *second) {
            counts.spikes += 1;
            seam = &seam[1..];
        } else {
            break;
        }
    }
    (seam.len() >= 3).then(|| seam.to_vec())
}

fn push_corner(kept: &mut Vec<Coord<f64>>, corner: Coord<f64>, counts: &mut RingCounts) {
    loop {
        match kept[..] {
            [.., last] if near(last, corner) => {
                counts.duplicates += 1;
                return;
            }
            [.., before, last] if is_spike(before, last, corner) => {
                counts.spikes += 1;
                kept.pop();
            }
            _ => break,
        }
    }
    kept.push(corner);
}

fn near(a: Coord<f64>, b: Coord<f64>) -> bool {
    (a.x - b.x).abs() <= SAME_POINT_M && (a.y - b.y).abs() <= SAME_POINT_M
}

/// Whether the way a-tip-b runs out and back on itself.
fn is_spike(a: Coord<f64>, tip: Coord<f64>, b: Coord<f64>) -> bool {
    let (u, v) = (a - tip, b - tip);
    let dot = u.x * v.x + u.y * v.y;
    if dot <= 0.0 {
        return false;
    }
    let longer = (u.x * u.x + u.y * u.y).max(v.x * v.x + v.y * v.y).sqrt();
    let distance_m = (u.x * v.y - u.y * v.x).abs() / longer;
    distance_m <= SAME_POINT_M
}

/// How a ring should run in the file.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Winding {
    CounterClockwise,
    Clockwise,
}

/// The area that a ring encloses. `expected` is how it should run in the file; the result is oriented as a footprint.
pub(crate) fn uncrossed(
    corners: Vec<Coord<f64>>,
    expected: Winding,
    counts: &mut RingCounts,
    repairs: &mut Vec<Repair>,
) -> MultiPolygon<f64> {
    let ring = Polygon::new(LineString(corners), Vec::new());
    let signed_m2 = ring.signed_area();
    let swept = ring.boolean_op_with_fill_rule(&Polygon::empty(), OpType::Union, FillRule::NonZero);
    let simple = swept.0.len() == 1 && swept.0[0].interiors().is_empty() && agree(swept.unsigned_area(), signed_m2.abs());
    if !simple {
        repairs.push((ItemKind::SelfIntersection, format!("a ring that crosses itself resolved into {} parts", swept.0.len())));
        return swept.orient(Direction::Default);
    }
    if steps_back(ring.exterior()) {
        let done = "a step runs back on itself, as if two corners were exchanged; left as it is";
        repairs.push((ItemKind::SuspectOrder, done.into()));
    }
    if (signed_m2 > 0.0) != (expected == Winding::CounterClockwise) {
        counts.reversed += 1;
    }
    // The sweep rounds to its grid, so a sound ring stays as it is.
    MultiPolygon(vec![ring.orient(Direction::Default)])
}

/// Whether exchanging two neighbouring corners would shorten a ring. Steps and bays of buildings are at their shortest as they
/// are, so this is a sign of corners in the wrong order where the ring does not quite cross itself.
fn steps_back(ring: &LineString<f64>) -> bool {
    let corners = &ring.0[..ring.0.len().saturating_sub(1)];
    let at = |index: usize| corners[index % corners.len()];
    let distance = |a: Coord<f64>, b: Coord<f64>| libm::hypot(a.x - b.x, a.y - b.y);
    corners.len() >= 4
        && (0..corners.len()).any(|index| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|step| at(index + step));
            distance(a, b) + distance(c, d) - distance(a, c) - distance(b, d) > STEP_BACK_M
        })
}

/// `body` without `hole`.
fn cut(body: MultiPolygon<f64>, hole: &MultiPolygon<f64>, repairs: &mut Vec<Repair>) -> MultiPolygon<f64> {
    let (body_m2, hole_m2) = (body.unsigned_area(), hole.unsigned_area());
    let left = body.difference(hole);
    let left_m2 = left.unsigned_area();
    if left_m2 < LEAST_AREA_M2 {
        repairs.push((ItemKind::HoleDropped, "a hole larger than its polygon dropped".into()));
        return body;
    }
    if agree(left_m2, body_m2) && hole_m2 > AREA_TOLERANCE * body_m2 {
        repairs.push((ItemKind::HoleDropped, "a hole outside of its polygon dropped".into()));
        return body;
    }
    let inside = agree(left_m2, body_m2 - hole_m2) && left.0.len() == body.0.len();
    if !inside {
        repairs.push((ItemKind::SelfIntersection, "a hole that crosses its polygon or another hole cut to it".into()));
        return left.orient(Direction::Default);
    }
    insert_hole(body, hole).unwrap_or_else(|| left.orient(Direction::Default))
}

/// Adds a sound hole to a sound body with its vertices as they are; `None` where that is not possible.
fn insert_hole(body: MultiPolygon<f64>, hole: &MultiPolygon<f64>) -> Option<MultiPolygon<f64>> {
    let ([polygon], [hole]) = (&body.0[..], &hole.0[..]) else { return None };
    // A hole that touches the exterior or another hole in more than a point changes the number of rings.
    if polygon.difference(hole).0.first()?.interiors().len() != polygon.interiors().len() + 1 {
        return None;
    }
    let (exterior, mut holes) = polygon.clone().into_inner();
    let mut ring = hole.exterior().clone();
    ring.0.reverse();
    holes.push(ring);
    Some(MultiPolygon(vec![Polygon::new(exterior, holes)]))
}

fn unite(mut parts: Vec<MultiPolygon<f64>>, repairs: &mut Vec<Repair>) -> MultiPolygon<f64> {
    if parts.len() == 1 {
        return parts.swap_remove(0);
    }
    let polygons: Vec<Polygon<f64>> = parts.into_iter().flat_map(|part| part.0).collect();
    let sum_m2: f64 = polygons.iter().map(Area::unsigned_area).sum();
    let mut united = geo::unary_union(&polygons).orient(Direction::Default);
    if united.0.len() == polygons.len() && agree(united.unsigned_area(), sum_m2) {
        return MultiPolygon(polygons);
    }
    united.0.retain(|polygon| polygon.unsigned_area() >= LEAST_AREA_M2);
    repairs
        .push((ItemKind::PartsUnited, format!("{} parts that overlap or touch united into {}", polygons.len(), united.0.len())));
    united
}

pub(crate) fn agree(a_m2: f64, b_m2: f64) -> bool {
    (a_m2 - b_m2).abs() <= AREA_TOLERANCE * a_m2.max(b_m2) + 1e-6
}

#[cfg(test)]
mod tests {
    use geo::{Validation, coord};
    use proptest::prelude::*;

    use super::*;

    fn ring(corners: &[[f64; 2]]) -> Vec<Coord<f64>> {
        corners.iter().map(|&[x, y]| coord! { x: x, y: y }).collect()
    }

    const SQUARE: [[f64; 2]; 5] = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]];

    fn repaired(polygons: &[RawPolygon]) -> (Result<MultiPolygon<f64>, String>, Vec<ItemKind>) {
        let mut repairs = Vec::new();
        let footprint = repair(polygons, &mut repairs);
        (footprint, repairs.into_iter().map(|(kind, _)| kind).collect())
    }

    fn area_and_kinds(polygons: &[RawPolygon]) -> (f64, Vec<ItemKind>) {
        let (footprint, kinds) = repaired(polygons);
        let footprint = footprint.expect("something is left");
        assert!(footprint.is_valid(), "{footprint:?}");
        assert!(footprint.signed_area() > 0.0);
        (footprint.unsigned_area().round(), kinds)
    }

    #[test]
    fn a_sound_square_is_left_alone() {
        let (footprint, kinds) = repaired(&[vec![ring(&SQUARE)]]);
        assert_eq!(kinds, []);
        assert_eq!(footprint.unwrap().0[0].exterior().0, ring(&SQUARE));
    }

    #[test]
    fn each_defect_is_named() {
        let hole = |low: f64, high: f64| ring(&[[low, low], [low, high], [high, high], [high, low], [low, low]]);
        let moved = |by: f64| SQUARE.map(|[x, y]| [x + by, y]);
        let cases: [(Vec<RawPolygon>, f64, Vec<ItemKind>); 11] = [
            (vec![vec![ring(&SQUARE[..4])]], 100.0, vec![ItemKind::OpenRing]),
            (vec![vec![SQUARE.iter().rev().flat_map(|&corner| ring(&[corner])).collect()]], 100.0, vec![ItemKind::WrongWinding]),
            (
                vec![vec![SQUARE.iter().flat_map(|&corner| ring(&[corner, corner])).collect()]],
                100.0,
                vec![ItemKind::DuplicateVertices],
            ),
            (
                vec![vec![ring(&[[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0], [0.0, 0.0]])]],
                50.0,
                vec![ItemKind::SelfIntersection],
            ),
            (
                vec![vec![ring(&[[0.0, 0.0], [10.0, 0.0], [30.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]])]],
                100.0,
                vec![ItemKind::DuplicateVertices, ItemKind::Spike],
            ),
            (vec![vec![ring(&SQUARE), hole(-1.0, 11.0)]], 100.0, vec![ItemKind::HoleDropped]),
            (vec![vec![ring(&SQUARE), hole(20.0, 30.0)]], 100.0, vec![ItemKind::HoleDropped]),
            (vec![vec![ring(&SQUARE), hole(5.0, 15.0)]], 75.0, vec![ItemKind::SelfIntersection]),
            (vec![vec![ring(&SQUARE), hole(2.0, 8.0)]], 64.0, vec![]),
            (vec![vec![ring(&SQUARE)], vec![ring(&moved(5.0))]], 150.0, vec![ItemKind::PartsUnited]),
            (vec![vec![ring(&SQUARE)], vec![ring(&moved(50.0))]], 200.0, vec![]),
        ];
        for (polygons, area_m2, kinds) in cases {
            assert_eq!(area_and_kinds(&polygons), (area_m2, kinds), "{polygons:?}");
        }
    }

    #[test]
    fn exchanged_corners_show_even_where_nothing_crosses() {
        let step = [[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [9.0, 10.0], [9.0, 10.5], [0.0, 10.5], [0.0, 0.0]];
        assert_eq!(area_and_kinds(&[vec![ring(&step)]]).1, []);
        let mut exchanged = step;
        exchanged.swap(3, 4);
        assert_eq!(area_and_kinds(&[vec![ring(&exchanged)]]).1, [ItemKind::SuspectOrder]);
    }

    #[test]
    fn nothing_is_left_of_rings_without_area() {
        for corners in [&[[1.0, 1.0]; 4][..], &[[0.0, 0.0], [9.0, 3.0], [0.0, 0.0], [0.0, 0.0]], &[], &[[0.0, 0.0], [5.0, 0.0]]] {
            assert!(repaired(&[vec![ring(corners)]]).0.is_err(), "{corners:?}");
        }
        assert!(repaired(&[vec![]]).0.is_err());
    }

    /// Thousands of corners that cross each other everywhere: the worst that is let in, and one corner more.
    #[test]
    fn a_hostile_ring_ends() {
        let scatter = |count: usize| -> Vec<Coord<f64>> {
            let hash = |index: usize| {
                (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(31).wrapping_mul(0xbf58_476d_1ce4_e5b9)
            };
            (0..count)
                .map(|index| coord! { x: (hash(index) >> 40) as f64 / 1e4, y: (hash(index) << 24 >> 40) as f64 / 1e4 })
                .collect()
        };
        assert!(repaired(&[vec![scatter(MOST_CORNERS)]]).0.is_ok());
        assert!(repaired(&[vec![scatter(MOST_CORNERS + 1)]]).0.unwrap_err().contains("simplify"));
    }

    proptest! {
        #[test]
        fn any_rings_become_a_valid_footprint(
            rings in prop::collection::vec(prop::collection::vec((-20i32..20, -20i32..20), 0..12), 1..4)
        ) {
            let polygon: RawPolygon = rings.iter().map(|r| r.iter().map(|&(x, y)| coord! { x: f64::from(x), y: f64::from(y) }).collect()).collect();
            let mut repairs = Vec::new();
            if let Ok(footprint) = repair(&[polygon], &mut repairs) {
                prop_assert!(footprint.is_valid(), "{footprint:?}");
                prop_assert!(footprint.signed_area() >= LEAST_AREA_M2);
                let mut again = Vec::new();
                // A part narrower than a spike may still go.
                let second = repair_closed(&footprint.0, &mut again);
                prop_assert!((second.map_or(0.0, |s: MultiPolygon<f64>| s.unsigned_area()) - footprint.unsigned_area()).abs() < 0.05);
            }
        }
    }
}
