//! Where and when the images of a flight are taken.

use nalgebra::Vector3;

use super::plan::Image;
use crate::camera::{Pose, Rig};
use crate::search::Problem;
use crate::search::problem::image_poses;

/// Along-path sums of a flight at a constant cruise speed with the turning times of Eq. 5.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlightSums {
    pub length_m: f64,
    pub turning_s: f64,
}

/// All images of the path in the order of their exposure, with the sums at its end.
pub fn place(path: &[Pose], problem: &Problem, cruise_speed_mps: f64) -> (Vec<Image>, FlightSums) {
    let mut images = Vec::new();
    let mut sums = FlightSums::default();
    let expose = |images: &mut Vec<Image>, pose: &Pose, time_s: f64| images.extend(exposure(&problem.rig, pose, time_s));
    if let Some(first) = path.first() {
        expose(&mut images, first, 0.0);
    }
    for (k, leg) in path.windows(2).enumerate() {
        let [from, to] = [leg[0], leg[1]];
        if k > 0 {
            let arriving = from.position - path[k - 1].position;
            sums.turning_s += problem.objective.turn_s(&arriving, &(to.position - from.position));
        }
        for pose in image_poses(&from, &to, problem.image_spacing_m) {
            let flown_m = sums.length_m + (pose.position - from.position).norm();
            expose(&mut images, &pose, flown_m / cruise_speed_mps + sums.turning_s);
        }
        sums.length_m += (to.position - from.position).norm();
    }
    (images, sums)
}

/// The images of one exposure, one for each camera.
fn exposure(rig: &Rig, pose: &Pose, time_s: f64) -> impl Iterator<Item = Image> + use<> {
    let image = match rig {
        Rig::Panoramic => Image {
            position_m: pose.position,
            direction: None,
            up: Vector3::z(),
            fov_deg: None,
            camera: 0,
            time_s,
            selected: true,
        },
    };
    std::iter::once(image)
}
