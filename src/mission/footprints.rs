//! What each image shows of the ground, as GeoJSON polygons. The ground is flat, and what stands on it hides nothing here.
//!
//! Near the horizon a footprint has no end. It is cut where a ray has gone farther than [`FARTHEST_M`] along the optical axis (four times the height of the camera, where
//! that is more); such a polygon is marked as `clipped`.

use geo::Coord;
use nalgebra::{Point3, Vector3};
use serde::Serialize;

use super::geojson::{collection, degrees};
use super::pictures::{Picture, pictures};
use crate::frame::LocalFrame;
use crate::quality::Which;
use crate::trajectory::plan::{Image, Plan};

/// Depth at which a footprint is cut, m.
pub const FARTHEST_M: f64 = 500.0;

/// The file's content; `None` for a plan without georeference, or with panoramas, which show all of the ground.
pub fn to_bytes(plan: &Plan, which: Which) -> Option<Vec<u8>> {
    let frame = LocalFrame { origin: plan.scene.origin };
    frame.origin?;
    let pictures = pictures(plan, which);
    let features: Option<Vec<Feature>> = pictures.iter().map(|picture| feature(plan, &frame, picture)).collect();
    Some(collection(features?.into_iter()))
}

#[derive(Serialize)]
struct Feature<'a> {
    r#type: &'static str,
    geometry: Option<Geometry>,
    properties: Properties<'a>,
}

#[derive(Serialize)]
struct Geometry {
    r#type: &'static str,
    coordinates: [Vec<[f64; 2]>; 1],
}

#[derive(Serialize)]
struct Properties<'a> {
    name: &'a str,
    camera: Option<&'a str>,
    time_s: f64,
    selected: bool,
    clipped: bool,
}

fn feature<'a>(plan: &'a Plan, frame: &LocalFrame, picture: &'a Picture) -> Option<Feature<'a>> {
    let (corners, clipped) = footprint(picture.image)?;
    let position = |corner: &Coord<f64>| {
        frame.geodetic_from_local(&Point3::new(corner.x, corner.y, 0.0)).map(|p| [degrees(p.lon_deg), degrees(p.lat_deg)])
    };
    let mut ring: Vec<[f64; 2]> = corners.iter().map(position).collect::<Option<_>>()?;
    ring.extend(ring.first().copied());
    Some(Feature {
        r#type: "Feature",
        geometry: (!ring.is_empty()).then_some(Geometry { r#type: "Polygon", coordinates: [ring] }),
        properties: Properties {
            name: &picture.name,
            camera: plan.cameras.get(picture.image.camera as usize).map(|camera| camera.name.as_str()),
            time_s: picture.image.time_s,
            selected: picture.image.selected,
            clipped,
        },
    })
}

/// The corners on the ground, counter-clockwise seen from above and without repeating the first one, and whether the footprint was cut. No corners for an image that
/// shows no ground; `None` for a panorama.
pub fn footprint(image: &Image) -> Option<(Vec<Coord<f64>>, bool)> {
    let (direction, fov_deg) = image.direction.zip(image.fov_deg)?;
    let [tan_x, tan_y] = fov_deg.map(|fov_deg| libm::tan(fov_deg.to_radians() / 2.0));
    let height_m = image.position_m.z;
    if height_m <= 0.0 {
        return Some((Vec::new(), false));
    }
    let (right, up) = (direction.cross(&image.up), image.up);
    let ray = |[u, v]: [f64; 2]| direction.into_inner() + right * u + up * v;
    // A ray of depth 1 meets the ground at the depth height / -z.
    let least_fall = height_m / FARTHEST_M.max(4.0 * height_m);
    let margin = |ray: &Vector3<f64>| -ray.z - least_fall;
    let frame = [[-tan_x, -tan_y], [tan_x, -tan_y], [tan_x, tan_y], [-tan_x, tan_y]].map(ray);
    let mut rays = Vec::with_capacity(6);
    for (index, from) in frame.iter().enumerate() {
        let to = &frame[(index + 1) % frame.len()];
        let (at_from, at_to) = (margin(from), margin(to));
        if at_from >= 0.0 {
            rays.push(*from);
        }
        if (at_from >= 0.0) != (at_to >= 0.0) {
            rays.push(from + (to - from) * (at_from / (at_from - at_to)));
        }
    }
    let is_clipped = frame.iter().any(|ray| margin(ray) < 0.0);
    let meets = |ray: &Vector3<f64>| {
        let ground = image.position_m + ray * (height_m / -ray.z);
        Coord { x: ground.x, y: ground.y }
    };
    let mut corners: Vec<Coord<f64>> = rays.iter().map(meets).collect();
    if doubled_area_m2(&corners) < 0.0 {
        corners.reverse();
    }
    Some((corners, is_clipped))
}

fn doubled_area_m2(corners: &[Coord<f64>]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| a.x * b.y - a.y * b.x).sum()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{View, direction_of};

    fn image(height_m: f64, azimuth_deg: f64, pitch_deg: f64) -> Image {
        let direction = direction_of(azimuth_deg, pitch_deg);
        let right = direction.cross(&Vector3::z()).normalize();
        Image {
            position_m: Point3::new(5.0, -7.0, height_m),
            direction: Some(direction),
            up: right.cross(&direction),
            fov_deg: Some([73.74, 53.13]),
            camera: 0,
            time_s: 0.0,
            selected: true,
        }
    }

    #[test]
    fn straight_down_it_is_the_sensor_on_the_ground() {
        let (corners, is_clipped) = footprint(&image(100.0, 0.0, -89.9999)).unwrap();
        let wide = |of: fn(&Coord<f64>) -> f64| {
            let values: Vec<f64> = corners.iter().map(of).collect();
            values.iter().copied().fold(f64::MIN, f64::max) - values.iter().copied().fold(f64::MAX, f64::min)
        };
        assert!(!is_clipped && corners.len() == 4);
        assert!((wide(|corner| corner.x) - 150.0).abs() < 0.1 && (wide(|corner| corner.y) - 100.0).abs() < 0.1, "{corners:?}");
    }

    #[test]
    fn at_the_horizon_it_ends_and_above_there_is_none() {
        let (corners, is_clipped) = footprint(&image(40.0, 90.0, 0.0)).unwrap();
        let farthest = corners.iter().map(|corner| corner.x - 5.0).fold(0.0, f64::max);
        assert!(is_clipped && (farthest - FARTHEST_M).abs() < 1e-6, "{farthest}");
        assert_eq!(footprint(&image(40.0, 90.0, 60.0)), Some((Vec::new(), true)));
    }

    proptest! {
        #[test]
        fn its_inside_is_what_the_image_frames(
            height_m in 5.0..120.0f64, azimuth_deg in 0.0..360.0f64, pitch_deg in -89.0..30.0f64, place in [-300.0..300.0f64, -300.0..300.0],
        ) {
            let image = image(height_m, azimuth_deg, pitch_deg);
            let (corners, _) = footprint(&image).unwrap();
            let ground = Point3::new(place[0], place[1], 0.0);
            let depth_m = (ground - image.position_m).dot(&image.direction.unwrap());
            prop_assume!(depth_m < FARTHEST_M - 1.0);
            let sides = corners.iter().zip(corners.iter().cycle().skip(1));
            let nearest_m = sides
                .map(|(a, b)| ((b.x - a.x) * (ground.y - a.y) - (b.y - a.y) * (ground.x - a.x)) / (b.x - a.x).hypot(b.y - a.y))
                .fold(f64::INFINITY, f64::min);
            prop_assume!(nearest_m.abs() > 1e-6);
            let is_inside = !corners.is_empty() && nearest_m > 0.0;
            let view: View = image.view().unwrap();
            prop_assert_eq!(view.frames(&ground), is_inside);
        }
    }
}
