//! Where on Earth the features of a GeoJSON file lie, and which of them cannot be meant.

use geo::Coord;

use super::footprint::RawPolygon;
use crate::frame::Geodetic;

/// Metres in a degree of latitude, near enough to tell the scene from its outliers.
pub(crate) const DEGREE_M: f64 = 111_195.0;

/// What is to be done with one feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Location {
    Kept,
    /// It belongs to the scene once latitude and longitude are exchanged.
    Swapped,
    /// So far from the middle of the scene, km.
    Outlier {
        distance_km: f64,
    },
    /// No place on Earth.
    OffEarth,
}

/// Why the file as a whole has no place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Nowhere {
    /// Most features make sense only with latitude and longitude exchanged; the pair of one of them.
    Swapped([f64; 2]),
    /// Most features lie outside the range of degrees; the pair of one of them.
    Projected([f64; 2]),
}

/// The location of each feature (corners: x longitude, y latitude, degrees), judged by the median of all.
pub(crate) fn locate(features: &[&[RawPolygon]], max_extent_m: f64) -> Result<Vec<Location>, Nowhere> {
    let boxes: Vec<Option<[Coord<f64>; 2]>> = features.iter().map(|polygons| box_of(polygons)).collect();
    let placed: Vec<[Coord<f64>; 2]> = boxes.iter().flatten().copied().collect();
    let on_earth: Vec<[Coord<f64>; 2]> = placed.iter().filter(|corners| corners.iter().all(in_range)).copied().collect();
    if on_earth.len() * 2 < placed.len() {
        let swapped = placed.iter().filter(|corners| corners.iter().all(|&corner| in_range(&exchanged(corner)))).count();
        let example =
            placed.iter().find(|corners| !corners.iter().all(in_range)).map_or([0.0; 2], |corners| [corners[0].x, corners[0].y]);
        return Err(if swapped * 2 >= placed.len() { Nowhere::Swapped(example) } else { Nowhere::Projected(example) });
    }
    let middle = Coord { x: median(on_earth.iter().map(centre_x)), y: median(on_earth.iter().map(centre_y)) };
    Ok(boxes.iter().map(|corners| corners.map_or(Location::Kept, |corners| judge(corners, middle, max_extent_m))).collect())
}

/// The middle of the box around some corners, at height 0; `None` without corners. Works across the 180th meridian.
pub(crate) fn centre(corners: &[Coord<f64>]) -> Option<Geodetic> {
    let first = corners.first()?;
    let (mut west, mut east, mut south, mut north) = (0.0f64, 0.0f64, f64::INFINITY, f64::NEG_INFINITY);
    for corner in corners {
        let offset = turn(corner.x - first.x);
        (west, east) = (west.min(offset), east.max(offset));
        (south, north) = (south.min(corner.y), north.max(corner.y));
    }
    Some(Geodetic { lat_deg: (south + north) / 2.0, lon_deg: turn(first.x + (west + east) / 2.0), alt_m: 0.0 })
}

/// Distance of two places for telling outliers, m.
pub(crate) fn rough_distance_m(a: Coord<f64>, b: Coord<f64>) -> f64 {
    let cos_lat = libm::cos(b.y.to_radians()).max(0.01);
    libm::hypot(turn(a.x - b.x) * cos_lat, a.y - b.y) * DEGREE_M
}

fn judge(corners: [Coord<f64>; 2], middle: Coord<f64>, max_extent_m: f64) -> Location {
    let farthest_m =
        |corners: [Coord<f64>; 2]| corners.iter().map(|&corner| rough_distance_m(corner, middle)).fold(0.0, f64::max);
    let on_earth = corners.iter().all(in_range);
    if on_earth && farthest_m(corners) <= max_extent_m {
        return Location::Kept;
    }
    let swapped = corners.map(exchanged);
    if swapped.iter().all(in_range) && farthest_m(swapped) <= max_extent_m {
        return Location::Swapped;
    }
    if on_earth { Location::Outlier { distance_km: farthest_m(corners) / 1000.0 } } else { Location::OffEarth }
}

fn box_of(polygons: &[RawPolygon]) -> Option<[Coord<f64>; 2]> {
    polygons.iter().flatten().flatten().fold(None, |corners, corner| {
        let [low, high] = corners.unwrap_or([*corner; 2]);
        Some([
            Coord { x: low.x.min(corner.x), y: low.y.min(corner.y) },
            Coord { x: high.x.max(corner.x), y: high.y.max(corner.y) },
        ])
    })
}

fn in_range(corner: &Coord<f64>) -> bool {
    corner.x.abs() <= 180.0 && corner.y.abs() <= 90.0
}

fn exchanged(corner: Coord<f64>) -> Coord<f64> {
    Coord { x: corner.y, y: corner.x }
}

fn centre_x(corners: &[Coord<f64>; 2]) -> f64 {
    (corners[0].x + corners[1].x) / 2.0
}

fn centre_y(corners: &[Coord<f64>; 2]) -> f64 {
    (corners[0].y + corners[1].y) / 2.0
}

/// The lower median; 0 of nothing.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied().unwrap_or(0.0)
}

/// An angle brought into -180 to 180 degrees.
fn turn(degrees: f64) -> f64 {
    degrees - 360.0 * (degrees / 360.0).round()
}

#[cfg(test)]
mod tests {
    use geo::coord;

    use super::*;

    fn square(lon: f64, lat: f64) -> Vec<RawPolygon> {
        let corner = |dx: f64, dy: f64| coord! { x: lon + dx, y: lat + dy };
        vec![vec![vec![corner(0.0, 0.0), corner(1e-4, 0.0), corner(1e-4, 1e-4), corner(0.0, 0.0)]]]
    }

    fn located(places: &[[f64; 2]]) -> Result<Vec<Location>, Nowhere> {
        let features: Vec<_> = places.iter().map(|&[lon, lat]| square(lon, lat)).collect();
        locate(&features.iter().map(Vec::as_slice).collect::<Vec<_>>(), 20_000.0)
    }

    #[test]
    fn strays_are_told_from_the_scene() {
        let found =
            located(&[[139.77, 35.68], [139.771, 35.681], [35.68, 139.77], [0.0, 0.0], [139.772, 35.68], [9e5, 4e6]]).unwrap();
        assert_eq!(found[..3], [Location::Kept, Location::Kept, Location::Swapped]);
        assert!(matches!(found[3], Location::Outlier { distance_km } if distance_km > 10_000.0));
        assert_eq!(found[4..], [Location::Kept, Location::OffEarth]);
    }

    #[test]
    fn a_file_that_is_wrong_throughout_is_refused() {
        assert!(matches!(located(&[[35.68, 139.77], [35.681, 139.77]]), Err(Nowhere::Swapped(_))));
        assert!(matches!(located(&[[90_759.0, 435_665.0], [90_800.0, 435_700.0]]), Err(Nowhere::Projected(_))));
    }

    #[test]
    fn a_scene_across_the_date_line_holds_together() {
        let found = located(&[[179.9995, -17.0], [-179.9995, -17.0], [179.999, -17.001]]).unwrap();
        assert_eq!(found, [Location::Kept; 3]);
        let middle = centre(&[coord! { x: 179.999, y: -17.0 }, coord! { x: -179.997, y: -17.002 }]).unwrap();
        assert!((middle.lon_deg + 179.999).abs() < 1e-9 && (middle.lat_deg + 17.001).abs() < 1e-9);
    }
}
