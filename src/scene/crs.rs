//! Projected coordinates: where a grid lies on Earth, how it is turned against north and how long its unit is.

use nalgebra::{Point3, Vector2};
use proj4rs::Proj;
use proj4rs::transform::transform;
use serde_json::Value;

use crate::frame::{Geodetic, LocalFrame};

/// How grid coordinates near one point become local ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    pub origin: Geodetic,
    /// Cosine and sine of the angle by which the grid is turned against true north, times the metres in a unit of the grid.
    turn: Vector2<f64>,
    /// The same as an angle (degrees, counter-clockwise) and a length.
    pub angle_deg: f64,
    pub unit_m: f64,
    /// Metres in a unit of height.
    pub height_unit_m: f64,
}

impl Placement {
    /// Offsets from the origin in grid units to metres east and north.
    pub fn turned(&self, offset: [f64; 2]) -> [f64; 2] {
        let [x, y] = offset;
        [x * self.turn.x - y * self.turn.y, x * self.turn.y + y * self.turn.x]
    }
}

/// Why a grid has no placement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unplaced {
    /// The code is not known here, or its projection is not.
    Unknown,
    /// The coordinates are degrees.
    Geographic,
}

/// Horizontal parts of codes that name a grid together with a vertical datum.
const COMPOUND: [(u32, u32); 10] = [
    (7415, 28992),
    (5554, 25831),
    (5555, 25832),
    (5556, 25833),
    (5698, 2154),
    (7405, 27700),
    (3903, 3067),
    (6190, 31370),
    (6697, 6668),
    (7423, 4258),
];

/// The EPSG code in a CityJSON reference system: `urn:ogc:def:crs:EPSG::7415`, `https://www.opengis.net/def/crs/EPSG/0/7415`,
/// `EPSG:7415`; of a compound the first.
pub(crate) fn epsg_code(reference: &Value) -> Option<u32> {
    let text = reference.as_str()?;
    let at = text.to_ascii_uppercase().find("EPSG")? + "EPSG".len();
    let rest = text.get(at..)?;
    let end = rest.find(',').unwrap_or(rest.len());
    let last = rest.get(..end)?.rsplit([':', '/']).next()?;
    last.parse().ok()
}

/// A projected reference system.
pub(crate) struct Grid {
    grid: Proj,
    wgs84: Proj,
}

impl Grid {
    /// The one of an EPSG code.
    pub fn new(epsg: u32) -> Result<Self, Unplaced> {
        let horizontal = COMPOUND.iter().find(|(compound, _)| *compound == epsg).map_or(epsg, |(_, horizontal)| *horizontal);
        let code = u16::try_from(horizontal).map_err(|_| Unplaced::Unknown)?;
        let definition = crs_definitions::from_code(code).ok_or(Unplaced::Unknown)?;
        let grid = Proj::from_proj_string(definition.proj4).map_err(|_| Unplaced::Unknown)?;
        if grid.is_latlong() || grid.is_geocent() {
            return Err(Unplaced::Geographic);
        }
        let wgs84 = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").map_err(|_| Unplaced::Unknown)?;
        Ok(Self { grid, wgs84 })
    }

    /// Where a point of the grid lies, at height 0; `None` for one that lies nowhere. Heights stay as they are: the datum's shift of the ellipsoid
    /// is not a shift of the ground. Rounded to a hundredth of a millimetre, because the projection's trigonometry may differ in the last bit
    /// between platforms.
    pub fn geodetic(&self, x: f64, y: f64) -> Option<Geodetic> {
        let exact = self.exact(x, y).ok()?;
        let rounded = |degrees: f64| (degrees * 1e10).round() / 1e10;
        Some(Geodetic { lat_deg: rounded(exact.lat_deg), lon_deg: rounded(exact.lon_deg), alt_m: 0.0 })
    }

    fn exact(&self, x: f64, y: f64) -> Result<Geodetic, Unplaced> {
        let mut point = (x, y, 0.0);
        transform(&self.grid, &self.wgs84, &mut point).map_err(|_| Unplaced::Unknown)?;
        let place = Geodetic { lat_deg: point.1.to_degrees(), lon_deg: point.0.to_degrees(), alt_m: 0.0 };
        let sound = place.lat_deg.abs() <= 90.0 && place.lon_deg.abs() <= 180.0;
        if sound { Ok(place) } else { Err(Unplaced::Unknown) }
    }
}

/// The placement of a grid around `at` (grid units, the height in the grid's vertical unit).
pub(crate) fn place(epsg: u32, at: Point3<f64>) -> Result<Placement, Unplaced> {
    let grid = Grid::new(epsg)?;
    let geodetic = |x: f64, y: f64| grid.exact(x, y);
    let origin = geodetic(at.x, at.y)?;
    let frame = LocalFrame { origin: Some(origin) };
    let step = 100.0;
    let local = |x: f64, y: f64| -> Result<Vector2<f64>, Unplaced> {
        let point = frame.local_from_geodetic(&geodetic(x, y)?).ok_or(Unplaced::Unknown)?;
        Ok(Vector2::new(point.x, point.y) / step)
    };
    let (east, north) = (local(at.x + step, at.y)?, local(at.x, at.y + step)?);
    let mean = Vector2::new(east.x + north.y, east.y - north.x) / 2.0;
    let height_unit_m = grid.grid.to_meter();
    // Far outside of the projection's area its numbers mean nothing.
    if !(0.5..2.0).contains(&(mean.norm() / height_unit_m)) {
        return Err(Unplaced::Unknown);
    }
    Ok(placement(origin, mean, height_unit_m, at.z * height_unit_m))
}

/// Rounded to what is far below a millimetre over a scene, because the projection's trigonometry may differ in the last bit
/// between platforms.
fn placement(origin: Geodetic, turn: Vector2<f64>, height_unit_m: f64, ground_m: f64) -> Placement {
    let nano = |number: f64| (number * 1e9).round() / 1e9;
    let turn = turn.map(nano);
    Placement {
        origin: Geodetic {
            lat_deg: nano(origin.lat_deg),
            lon_deg: nano(origin.lon_deg),
            alt_m: (ground_m * 1000.0).round() / 1000.0,
        },
        turn,
        angle_deg: libm::atan2(turn.y, turn.x).to_degrees(),
        unit_m: libm::hypot(turn.x, turn.y),
        height_unit_m,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn codes_are_found_in_every_spelling() {
        for (text, code) in [
            ("urn:ogc:def:crs:EPSG::7415", Some(7415)),
            ("https://www.opengis.net/def/crs/EPSG/0/28992", Some(28992)),
            ("EPSG:4326", Some(4326)),
            ("urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5109", Some(28992)),
            ("urn:ogc:def:crs:OGC:1.3:CRS84", None),
            ("EPSG", None),
        ] {
            assert_eq!(epsg_code(&json!(text)), code, "{text}");
        }
        assert_eq!(epsg_code(&json!(28992)), None);
    }

    /// The reference point of the Dutch grid is the tower of Our Lady in Amersfoort; the Dutch survey gives its place.
    #[test]
    fn amersfoort_lies_where_it_should() {
        for code in [28992, 7415] {
            let placement = place(code, Point3::new(155_000.0, 463_000.0, 1.5)).unwrap();
            assert!((placement.origin.lat_deg - 52.155_174_4).abs() < 2e-5, "{placement:?}");
            assert!((placement.origin.lon_deg - 5.387_206_2).abs() < 2e-5, "{placement:?}");
            assert_eq!(placement.origin.alt_m, 1.5);
            assert!((placement.unit_m - 1.000_09).abs() < 2e-5, "{placement:?}");
            assert!(placement.angle_deg.abs() < 0.01, "{placement:?}");
        }
    }

    /// The local frame of one point is the oracle for the place of another.
    #[test]
    fn the_grid_is_turned_to_true_north() {
        let [x, y] = [90_759.0, 435_665.0];
        let here = place(28992, Point3::new(x, y, 0.0)).unwrap();
        let there = place(28992, Point3::new(x + 300.0, y - 200.0, 0.0)).unwrap();
        let frame = LocalFrame { origin: Some(here.origin) };
        let expected = frame.local_from_geodetic(&Geodetic { alt_m: 0.0, ..there.origin }).unwrap();
        let [east, north] = here.turned([300.0, -200.0]);
        assert!((expected.x - east).abs() < 0.005 && (expected.y - north).abs() < 0.005, "{expected} {east} {north}");
        assert!((0.5..1.0).contains(&here.angle_deg.abs()), "{}", here.angle_deg);
    }

    #[test]
    fn feet_become_metres() {
        let new_york = place(2263, Point3::new(981_000.0, 196_000.0, 30.0)).unwrap();
        assert!((new_york.unit_m - 0.3048).abs() < 1e-3 && (new_york.height_unit_m - 0.3048).abs() < 1e-5);
        assert!((new_york.origin.lat_deg - 40.70).abs() < 0.02 && (new_york.origin.lon_deg + 74.0).abs() < 0.03);
    }

    #[test]
    fn what_cannot_be_placed_says_why() {
        let at = Point3::new(1.0, 2.0, 0.0);
        assert_eq!(place(4326, at), Err(Unplaced::Geographic));
        assert_eq!(place(6697, at), Err(Unplaced::Geographic));
        assert_eq!(place(1, at), Err(Unplaced::Unknown));
        assert_eq!(place(700_000, at), Err(Unplaced::Unknown));
        assert!(place(28992, Point3::new(1e300, 1e300, 0.0)).is_err());
    }
}
