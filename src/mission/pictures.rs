//! The images of a plan under names that files can be matched with, and how each of them is turned.
//!
//! An image is called `CAMERA_NNNNNN.jpg`: the name of its camera as it can stand in a file name, and how many images that camera has taken with it. Cameras of
//! one exposure have the same number. Sorted by name, the files of each camera follow the flight.

use std::collections::HashSet;

use nalgebra::{Matrix3, Vector3};

use crate::camera::pitch_rad;
use crate::frame::{Geodetic, LocalFrame};
use crate::quality::Which;
use crate::trajectory::plan::{Image, Plan};

/// An image with its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture<'a> {
    pub name: String,
    pub image: &'a Image,
    /// `None` for a plan without georeference.
    pub place: Option<Geodetic>,
}

/// Angles of a camera as photogrammetry counts them, degrees: yaw of the top of the image clockwise from north, pitch 0 straight down and 90 at the
/// horizon, roll with the right side down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    pub yaw_deg: f64,
    pub pitch_deg: f64,
    pub roll_deg: f64,
}

/// The images in the order of their exposure. Numbers count all images, whichever are wanted.
pub fn pictures(plan: &Plan, which: Which) -> Vec<Picture<'_>> {
    let frame = LocalFrame { origin: plan.scene.origin };
    let names = camera_names(plan);
    let mut taken = vec![0usize; names.len()];
    let mut pictures = Vec::with_capacity(plan.images.len());
    for image in &plan.images {
        let camera = (image.camera as usize).min(names.len() - 1);
        taken[camera] += 1;
        if which == Which::All || image.selected {
            let name = format!("{}_{:06}.jpg", names[camera], taken[camera]);
            pictures.push(Picture { name, image, place: frame.geodetic_from_local(&image.position_m) });
        }
    }
    pictures
}

/// The names of the plan's cameras as they can stand in a file name, each its own.
pub fn camera_names(plan: &Plan) -> Vec<String> {
    let mut known = HashSet::new();
    let own = |(index, name): (usize, &str)| {
        let mut name = plain_name(name);
        if !known.insert(name.clone()) {
            name = format!("{name}-{}", index + 1);
            while !known.insert(name.clone()) {
                name.push('x');
            }
        }
        name
    };
    plan.cameras.iter().map(|camera| camera.name.as_str()).enumerate().map(own).collect()
}

/// A name as it can stand in a file name on every system: letters, digits, `-` and `_` of ASCII, at most 60 of them.
pub fn plain_name(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '-' };
    let name: String = name.chars().take(60).map(plain).collect();
    if name.is_empty() { "flight".to_owned() } else { name }
}

impl Attitude {
    /// `None` for a panorama.
    pub fn of(image: &Image) -> Option<Self> {
        let direction = image.direction?;
        let right = direction.cross(&image.up);
        // The right side of a level image is horizontal, so that it tells the yaw straight down as well.
        let yaw_deg = (libm::atan2(right.x, right.y).to_degrees() - 90.0).rem_euclid(360.0);
        Some(Self {
            yaw_deg,
            pitch_deg: 90.0 + pitch_rad(&direction).to_degrees(),
            roll_deg: libm::asin((-right.z).clamp(-1.0, 1.0)).to_degrees(),
        })
    }
}

/// The rotation from the local frame into that of the camera: x to the right of the image, y down, z ahead. `None` for a panorama.
pub fn world_to_camera(image: &Image) -> Option<Matrix3<f64>> {
    let ahead: Vector3<f64> = image.direction?.into_inner();
    let right = ahead.cross(&image.up).try_normalize(1e-9)?;
    let down = ahead.cross(&right);
    Some(Matrix3::from_rows(&[right.transpose(), down.transpose(), ahead.transpose()]))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Unit};

    use super::*;
    use crate::camera::direction_of;
    use crate::mission::fixture::plan;

    fn image(direction: Unit<Vector3<f64>>, up: Vector3<f64>) -> Image {
        Image {
            position_m: Point3::new(1.0, 2.0, 3.0),
            direction: Some(direction),
            up,
            fov_deg: Some([60.0, 45.0]),
            camera: 0,
            time_s: 0.0,
            selected: true,
        }
    }

    #[test]
    fn attitudes_are_those_of_photogrammetry() {
        let level = |azimuth_deg: f64, pitch_deg: f64| {
            let direction = direction_of(azimuth_deg, pitch_deg);
            let right = direction.cross(&Vector3::z()).normalize();
            Attitude::of(&image(direction, right.cross(&direction))).unwrap()
        };
        for (azimuth_deg, pitch_deg) in [(0.0, -45.0), (90.0, -10.0), (200.0, -80.0), (359.0, 20.0)] {
            let attitude = level(azimuth_deg, pitch_deg);
            assert!((attitude.yaw_deg - azimuth_deg).abs() < 1e-6 && attitude.roll_deg.abs() < 1e-6, "{attitude:?}");
            assert!((attitude.pitch_deg - 90.0 - pitch_deg).abs() < 1e-6, "{attitude:?}");
        }
        let east_up = Attitude::of(&image(Unit::new_unchecked(-Vector3::z()), Vector3::x())).unwrap();
        assert!((east_up.yaw_deg - 90.0).abs() < 1e-9 && east_up.pitch_deg.abs() < 1e-9, "{east_up:?}");
    }

    #[test]
    fn a_camera_looks_along_its_third_axis_with_the_second_one_down() {
        let rotation = world_to_camera(&image(Vector3::y_axis(), Vector3::z())).unwrap();
        assert!((rotation * Vector3::y() - Vector3::z()).norm() < 1e-12, "north is ahead");
        assert!((rotation * Vector3::x() - Vector3::x()).norm() < 1e-12, "east is right");
        assert!((rotation * Vector3::z() + Vector3::y()).norm() < 1e-12, "up is not down");
        assert!((rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn names_are_plain_unique_and_numbered_by_camera() {
        let mut plan = plan("m300-oblique", &[[0.0, 0.0, 50.0], [40.0, 0.0, 50.0]]);
        for (camera, name) in plan.cameras.iter_mut().zip(["a/b", "a b", "a-b", "..\\x", "é"]) {
            camera.name = name.to_owned();
        }
        let names: Vec<String> = pictures(&plan, Which::All).into_iter().map(|picture| picture.name).collect();
        assert_eq!(
            &names[..6],
            ["a-b_000001.jpg", "a-b-2_000001.jpg", "a-b-3_000001.jpg", "---x_000001.jpg", "-_000001.jpg", "a-b_000002.jpg"]
        );
        assert_eq!(names.iter().collect::<HashSet<_>>().len(), plan.images.len());
        plan.images.iter_mut().take(5).for_each(|image| image.selected = false);
        assert_eq!(pictures(&plan, Which::Selected)[0].name, "a-b_000002.jpg");
    }
}
