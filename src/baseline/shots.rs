//! Views that a method may choose, with the samples that they see.

use nalgebra::{Point3, Unit, Vector3};

use super::pairs::Ray;
use crate::camera::{Cameras, Pose, Rig};
use crate::search::Problem;

/// A sample that a view sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    pub sample: u32,
    pub ray: Ray,
}

/// A view with all capturable samples that it sees, in ascending order.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    pub pose: Pose,
    pub sights: Vec<Sight>,
}

impl Shot {
    pub fn new(problem: &Problem, pose: Pose) -> Self {
        Self { pose, sights: framed(problem, &pose, &sights_at(problem, &pose.position)) }
    }
}

/// Every capturable sample that the field shows at a position, whatever the view direction.
pub fn sights_at(problem: &Problem, position: &Point3<f64>) -> Vec<Sight> {
    let capturable = problem.sighted(position).filter(|&(i, _)| problem.is_capturable(i));
    capturable.map(|(i, _)| Sight { sample: i as u32, ray: Ray::new(&problem.frames[i], position) }).collect()
}

/// Of the sights at a position those that a view frames.
pub fn framed(problem: &Problem, pose: &Pose, sights: &[Sight]) -> Vec<Sight> {
    framed_indices(problem, pose, sights).into_iter().map(|index| sights[index as usize]).collect()
}

/// Where in `sights` the samples are that a view frames.
pub fn framed_indices(problem: &Problem, pose: &Pose, sights: &[Sight]) -> Vec<u32> {
    let frusta = problem.rig.frusta(pose);
    let is_framed = |sight: &Sight| {
        let target = &problem.frames[sight.sample as usize].position;
        frusta.as_ref().is_none_or(|views| views.iter().any(|view| view.frames(target)))
    };
    (0..sights.len() as u32).filter(|&index| is_framed(&sights[index as usize])).collect()
}

/// The view direction nearest in pitch to the way from `from` to `to` that the gimbal reaches; `None` for a rig that sees in all
/// directions.
pub fn aimed(rig: &Rig, from: &Point3<f64>, to: &Point3<f64>) -> Option<Unit<Vector3<f64>>> {
    rig.has_gimbal().then(|| within_reach(rig, &Unit::try_new(to - from, 1e-9).unwrap_or(Vector3::y_axis())))
}

/// A direction with its pitch clamped to the range of the gimbal; north where it has no azimuth.
pub fn within_reach(rig: &Rig, direction: &Unit<Vector3<f64>>) -> Unit<Vector3<f64>> {
    let Cameras::Gimbal { sin_pitch: [low, high], .. } = &rig.cameras else { return *direction };
    if (*low..=*high).contains(&direction.z) {
        return *direction;
    }
    let level = Unit::try_new(Vector3::new(direction.x, direction.y, 0.0), 1e-9).unwrap_or(Vector3::y_axis());
    let sin = direction.z.clamp(*low, *high);
    Unit::new_normalize(level.into_inner() * (1.0 - sin * sin).max(0.0).sqrt() + Vector3::z() * sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{direction_of, pitch_rad};

    #[test]
    fn a_direction_beyond_the_gimbal_keeps_its_azimuth() {
        let rig = Rig::preset("phantom4-rtk").unwrap();
        let clamped = within_reach(&rig, &direction_of(70.0, 60.0));
        assert!((clamped.into_inner() - direction_of(70.0, 30.0).into_inner()).norm() < 1e-9);
        assert!(rig.reaches(&clamped));
        let kept = direction_of(200.0, -89.0);
        assert_eq!(within_reach(&rig, &kept), kept);
        let up = within_reach(&rig, &Vector3::z_axis());
        assert!((pitch_rad(&up).to_degrees() - 30.0).abs() < 1e-9);
    }
}
