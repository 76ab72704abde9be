//! The images of a route: one for each camera and exposure, at the instants of the speed profile.

use nalgebra::Vector3;

use super::plan::Image;
use super::profile::Profile;
use super::route::{Exposure, Route};
use crate::camera::Rig;

/// All images in the order of their exposure.
pub fn expose(route: &Route, rig: &Rig, profile: &Profile) -> Vec<Image> {
    route
        .exposures
        .iter()
        .flat_map(|exposure| exposed(exposure, rig, profile.time_at_s(exposure.leg, exposure.flown_m)))
        .collect()
}

fn exposed(exposure: &Exposure, rig: &Rig, time_s: f64) -> impl Iterator<Item = Image> {
    (0..rig.camera_count()).map(move |camera| {
        let axis = rig.optical_axis(camera, &exposure.pose);
        Image {
            position_m: exposure.pose.position,
            direction: axis.map(|(direction, _)| direction),
            up: axis.map_or(Vector3::z(), |(_, up)| up),
            fov_deg: rig.camera(camera).1.map(|intrinsics| intrinsics.fov_deg()),
            camera: camera as u32,
            time_s,
            selected: true,
        }
    })
}
