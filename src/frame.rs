//! The local frame: x east, y north, z up, metres; z = 0 is the ground plane of the scene.
//!
//! A scene has flat ground. So x and y are the east and north components of the tangent frame at the origin, taken from the point
//! at the origin's ellipsoid height under or above the one meant, and z is the height above the ground, which follows the
//! ellipsoid: the 2 m by which the ellipsoid has dropped below the tangent plane 5 km out do not enter z.

use libm::{atan2, cos, hypot, sin, sqrt};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Semi-major axis (m) and flattening of the WGS84 ellipsoid (NIMA TR8350.2).
const SEMI_MAJOR_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const ECCENTRICITY_2: f64 = FLATTENING * (2.0 - FLATTENING);

/// A position on the WGS84 ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    pub lat_deg: f64,
    pub lon_deg: f64,
    pub alt_m: f64,
}

/// The east-north-up frame of a scene. `origin` is `None` for a scene without georeference.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct LocalFrame {
    pub origin: Option<Geodetic>,
}

impl LocalFrame {
    /// The local position of `place`, or `None` for a frame without georeference. Meant for places within tens of kilometres.
    pub fn local_from_geodetic(&self, place: &Geodetic) -> Option<Point3<f64>> {
        let origin = self.origin?;
        let at_ground = Geodetic { alt_m: origin.alt_m, ..*place };
        let enu = enu_from_ecef(&origin, ecef_from_geodetic(&at_ground) - ecef_from_geodetic(&origin));
        Some(Point3::new(enu.x, enu.y, place.alt_m - origin.alt_m))
    }

    /// The inverse of [`LocalFrame::local_from_geodetic`].
    pub fn geodetic_from_local(&self, point_m: &Point3<f64>) -> Option<Geodetic> {
        let origin = self.origin?;
        let origin_ecef = ecef_from_geodetic(&origin);
        // The ellipsoid's drop below the tangent plane is not known beforehand; each round leaves a part in a thousand of its error.
        let mut up_m = 0.0;
        for _ in 0..4 {
            let place = geodetic_from_ecef(origin_ecef + ecef_from_enu(&origin, Vector3::new(point_m.x, point_m.y, up_m)));
            up_m += origin.alt_m - place.alt_m;
        }
        let place = geodetic_from_ecef(origin_ecef + ecef_from_enu(&origin, Vector3::new(point_m.x, point_m.y, up_m)));
        Some(Geodetic { alt_m: origin.alt_m + point_m.z, ..place })
    }
}

fn ecef_from_geodetic(place: &Geodetic) -> Vector3<f64> {
    let (lat, lon) = (place.lat_deg.to_radians(), place.lon_deg.to_radians());
    let prime_vertical_m = SEMI_MAJOR_M / sqrt(1.0 - ECCENTRICITY_2 * sin(lat) * sin(lat));
    let equatorial_m = (prime_vertical_m + place.alt_m) * cos(lat);
    Vector3::new(
        equatorial_m * cos(lon),
        equatorial_m * sin(lon),
        (prime_vertical_m * (1.0 - ECCENTRICITY_2) + place.alt_m) * sin(lat),
    )
}

/// Bowring's method (Survey Review 23, 1976); two rounds are exact to well below a micrometre near the ground.
fn geodetic_from_ecef(ecef_m: Vector3<f64>) -> Geodetic {
    let semi_minor_m = SEMI_MAJOR_M * (1.0 - FLATTENING);
    let second_eccentricity_2 = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2);
    let equatorial_m = hypot(ecef_m.x, ecef_m.y);
    let mut reduced_lat = atan2(ecef_m.z * SEMI_MAJOR_M, equatorial_m * semi_minor_m);
    let mut lat = 0.0;
    for _ in 0..2 {
        let (s, c) = (sin(reduced_lat), cos(reduced_lat));
        lat = atan2(
            ecef_m.z + second_eccentricity_2 * semi_minor_m * s * s * s,
            equatorial_m - ECCENTRICITY_2 * SEMI_MAJOR_M * c * c * c,
        );
        reduced_lat = atan2((1.0 - FLATTENING) * sin(lat), cos(lat));
    }
    let prime_vertical_m = SEMI_MAJOR_M / sqrt(1.0 - ECCENTRICITY_2 * sin(lat) * sin(lat));
    // Along the normal: this form has no division that fails at the poles or on the equator.
    let alt_m = equatorial_m * cos(lat) + ecef_m.z * sin(lat) - SEMI_MAJOR_M * SEMI_MAJOR_M / prime_vertical_m;
    Geodetic { lat_deg: lat.to_degrees(), lon_deg: atan2(ecef_m.y, ecef_m.x).to_degrees(), alt_m }
}

fn enu_from_ecef(origin: &Geodetic, offset_m: Vector3<f64>) -> Vector3<f64> {
    let [east, north, up] = axes(origin);
    Vector3::new(east.dot(&offset_m), north.dot(&offset_m), up.dot(&offset_m))
}

fn ecef_from_enu(origin: &Geodetic, enu_m: Vector3<f64>) -> Vector3<f64> {
    let [east, north, up] = axes(origin);
    east * enu_m.x + north * enu_m.y + up * enu_m.z
}

fn axes(origin: &Geodetic) -> [Vector3<f64>; 3] {
    let (lat, lon) = (origin.lat_deg.to_radians(), origin.lon_deg.to_radians());
    [
        Vector3::new(-sin(lon), cos(lon), 0.0),
        Vector3::new(-sin(lat) * cos(lon), -sin(lat) * sin(lon), cos(lat)),
        Vector3::new(cos(lat) * cos(lon), cos(lat) * sin(lon), sin(lat)),
    ]
}

#[cfg(test)]
mod tests {
    use geo::{Distance, Geodesic, Point};
    use proptest::prelude::*;

    use super::*;

    fn frame(lat_deg: f64, lon_deg: f64, alt_m: f64) -> LocalFrame {
        LocalFrame { origin: Some(Geodetic { lat_deg, lon_deg, alt_m }) }
    }

    proptest! {
        #[test]
        fn there_and_back_is_below_a_tenth_of_a_millimetre(
            lat in -85.0..85.0f64, lon in -180.0..180.0f64, alt in -100.0..4000.0f64,
            x in -5000.0..5000.0f64, y in -5000.0..5000.0f64, z in -10.0..500.0f64,
        ) {
            let frame = frame(lat, lon, alt);
            let point = Point3::new(x, y, z);
            let place = frame.geodetic_from_local(&point).unwrap();
            prop_assert!((place.alt_m - alt - z).abs() < 1e-9);
            let back = frame.local_from_geodetic(&place).unwrap();
            prop_assert!((back - point).norm() < 1e-4, "{point} came back as {back}");
        }

        /// Karney's geodesic is the oracle for distances from the origin on the ellipsoid.
        #[test]
        fn distances_agree_with_the_geodesic(lat in -80.0..80.0f64, lon in -180.0..180.0f64, x in -2000.0..2000.0f64, y in -2000.0..2000.0f64) {
            let frame = frame(lat, lon, 0.0);
            let place = frame.geodetic_from_local(&Point3::new(x, y, 77.0)).unwrap();
            let geodesic_m = Geodesic.distance(Point::new(lon, lat), Point::new(place.lon_deg, place.lat_deg));
            prop_assert!((geodesic_m - x.hypot(y)).abs() < 1e-3);
        }
    }

    #[test]
    fn an_arc_of_the_equator_has_its_known_length() {
        let place = Geodetic { lat_deg: 0.0, lon_deg: 10.01, alt_m: 30.0 };
        let local = frame(0.0, 10.0, 0.0).local_from_geodetic(&place).unwrap();
        let expected_m = SEMI_MAJOR_M * 0.01f64.to_radians().sin();
        assert!((local - Point3::new(expected_m, 0.0, 30.0)).norm() < 1e-6, "{local}");
    }

    #[test]
    fn the_ground_stays_flat_far_out() {
        let place = Geodetic { lat_deg: 52.04, lon_deg: 4.07, alt_m: 0.0 };
        let local = frame(52.0, 4.0, 0.0).local_from_geodetic(&place).unwrap();
        assert_eq!(local.z, 0.0);
        assert!(local.x > 4700.0 && local.y > 4400.0);
    }

    #[test]
    fn a_frame_without_origin_has_no_places() {
        assert_eq!(LocalFrame::default().geodetic_from_local(&Point3::origin()), None);
    }
}
