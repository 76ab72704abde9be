//! The images of a route: one for each camera and exposure, where the drone really is at their instants.

use std::iter;

use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::plan::Image;
use super::profile::{Passage, Profile};
use super::route::{Exposure, Route};
use crate::camera::{Cameras, Pose, Rig};
use crate::scene::clearance::Clearance;
use crate::search::leg::slerp;

/// The images of a flight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exposed {
    /// In the order of their exposure.
    pub images: Vec<Image>,
    /// How fast the drone flies at each image, m/s.
    pub speeds_mps: Vec<f64>,
    /// Exposures that wait for the shutter, and those that are left out because they would have to wait too long.
    pub delayed: u32,
    pub dropped: u32,
}

/// An exposure may wait for the shutter this share of its interval: further on, the view would be another one. One without which an overlap
/// would be lost waits as long as it has to.
const MOST_WAIT: f64 = 0.25;
/// Exposures that a worker takes at once, at least.
const LEAST_EXPOSURES: usize = 128;
/// Intervals are kept to within rounding of the times, s.
const TIME_TOLERANCE_S: f64 = 1e-9;

/// All images, at the points of the curve at which their places are passed. An arc is shorter than what it cuts off, so that images near
/// corners can come sooner than the shutter is ready again: they are taken when it is, a little farther on.
///
/// With an overlap no image is farther from the one before than the most along the curve: planned places are not, an exposure is only
/// left out where the next one is near enough without it, and one that waits is as far on as the flight comes in an interval.
pub fn expose(route: &Route, rig: &Rig, profile: &Profile) -> Exposed {
    let mut exposed = Exposed::default();
    let mut ready_s = f64::NEG_INFINITY;
    let mut last = None;
    let passings = route.exposures.par_iter().with_min_len(LEAST_EXPOSURES);
    let passings: Vec<Option<Passage>> = passings.map(|exposure| profile.passing(exposure.leg, exposure.flown_m)).collect();
    let cameras = rig.camera_count();
    exposed.images.reserve(passings.len() * cameras);
    exposed.speeds_mps.reserve(passings.len() * cameras);
    for (index, (exposure, planned)) in route.exposures.iter().zip(passings).enumerate() {
        let Some(planned) = planned else { continue };
        let wait_s = ready_s - planned.time_s;
        let (passage, direction) = if wait_s <= TIME_TOLERANCE_S {
            (planned, direction(exposure, rig, &planned))
        } else if (wait_s <= MOST_WAIT * rig.shutter_interval_s || is_missed(route, last.as_ref(), index))
            && ready_s <= profile.duration_s()
            && let Some(later) = profile.at(ready_s)
        {
            exposed.delayed += 1;
            (later, later_direction(route, rig, &later))
        } else {
            exposed.dropped += 1;
            continue;
        };
        ready_s = passage.time_s + rig.shutter_interval_s;
        exposed.images.extend(images(rig, &passage, direction));
        exposed.speeds_mps.extend(iter::repeat_n(passage.velocity_mps.norm(), cameras));
        last = Some(passage);
    }
    exposed
}

/// Whether an overlap would be lost without an exposure: the next one lies too far behind the last image, or there is none.
fn is_missed(route: &Route, last: Option<&Passage>, index: usize) -> bool {
    let (Some(most_m), Some(last)) = (route.most_apart_m, last) else { return false };
    let is_far = |next: &Exposure| {
        // Along the legs, which are longer than the arcs.
        let legs = route.waypoints.windows(2).take(next.leg).skip(last.leg);
        let between_m: f64 = legs.map(|ends| (ends[1].position - ends[0].position).norm()).sum();
        next.leg >= last.leg && between_m - last.flown_m + next.flown_m > most_m
    };
    route.exposures.get(index + 1).is_none_or(is_far)
}

/// The most that an image is smeared by the flight during its exposure, at the surface nearest to it, px; 0 without images.
pub fn blur_px(exposed: &Exposed, rig: &Rig, clearance: &Clearance) -> f64 {
    let smeared = |most_px: f64, (image, speed_mps): (&Image, &f64)| {
        let smear_px_m = speed_mps * rig.exposure_s / rig.pixel_rad(image.camera as usize);
        // A surface counts when it smears more than the most so far; farther ones are looked at by so little that rounding decides nothing, whatever was
        // the most so far. The ground is the surface when nothing is nearer.
        let cap_m = smear_px_m / most_px.max(f64::MIN_POSITIVE) * (1.0 + 1e-9);
        let distance_m = clearance.point_distance_m(&image.position_m, image.position_m.z.min(cap_m));
        if distance_m < cap_m { most_px.max(smear_px_m / distance_m.max(f64::MIN_POSITIVE)) } else { most_px }
    };
    let Exposed { images, speeds_mps, .. } = exposed;
    // Who knows a few images need not look far from all others.
    let of_few_px = images.iter().zip(speeds_mps).step_by(LEAST_EXPOSURES).fold(0.0, smeared);
    let images = images.par_iter().zip(speeds_mps).with_min_len(LEAST_EXPOSURES);
    images.fold(|| of_few_px, smeared).reduce(|| of_few_px, f64::max)
}

/// Where a rig is turned at an exposure: a gimbal as the route says; bolted cameras ahead along the curve, which on an arc is its
/// tangent. At the start the drone stands turned as the route says.
fn direction(exposure: &Exposure, rig: &Rig, passage: &Passage) -> Option<Unit<Vector3<f64>>> {
    let at_start = passage.leg == 0 && passage.flown_m == 0.0;
    match rig.cameras {
        Cameras::Rigid(_) if !at_start => Some(passage.heading),
        _ => exposure.pose.direction,
    }
}

/// The same a little later: a gimbal turns on along the leg.
fn later_direction(route: &Route, rig: &Rig, passage: &Passage) -> Option<Unit<Vector3<f64>>> {
    match rig.cameras {
        Cameras::Panoramic { .. } => None,
        Cameras::Rigid(_) => Some(passage.heading),
        Cameras::Gimbal { .. } => {
            let (from, to) = (&route.waypoints[passage.leg], &route.waypoints[passage.leg + 1]);
            let (first, last) = from.direction.zip(to.direction)?;
            let share = passage.flown_m / (to.position - from.position).norm();
            Some(if first == last { last } else { slerp(&first, &last, share.clamp(0.0, 1.0)) })
        }
    }
}

fn images(rig: &Rig, passage: &Passage, direction: Option<Unit<Vector3<f64>>>) -> impl Iterator<Item = Image> {
    let pose = Pose { position: passage.position_m, direction };
    let time_s = passage.time_s;
    (0..rig.camera_count()).map(move |camera| {
        let axis = rig.optical_axis(camera, &pose);
        Image {
            position_m: pose.position,
            direction: axis.map(|(direction, _)| direction),
            up: axis.map_or(Vector3::z(), |(_, up)| up),
            fov_deg: rig.camera(camera).1.map(|intrinsics| intrinsics.fov_deg()),
            camera: camera as u32,
            time_s,
            selected: true,
        }
    })
}
