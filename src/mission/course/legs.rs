//! The legs of a plan, timed, with the images on them.

use nalgebra::{Point3, Unit, Vector3};

use super::{CameraMount, Place, Stop, Trigger};
use crate::camera::{Pose, pitch_rad};
use crate::search::leg::heading;
use crate::trajectory::corner::Corner;
use crate::trajectory::limits::{Limits, Turning};
use crate::trajectory::plan::Plan;
use crate::trajectory::profile::Profile;

/// Times are compared to within rounding, s.
const TOLERANCE_S: f64 = 1e-6;
/// Waypoints that lie nearer together than this are one, m.
const LEAST_LEG_M: f64 = 1e-3;
/// A direction with a smaller horizontal part looks straight down or up, and every heading will do.
const VERTICAL: f64 = 1e-6;

pub fn mount(limits: &Limits) -> CameraMount {
    match limits.turning {
        Turning::Nothing => CameraMount::Panoramic,
        Turning::View => CameraMount::Gimbal,
        Turning::Nose => CameraMount::Fixed,
    }
}

/// The plan's waypoints without those that repeat the one before.
pub fn distinct(plan: &Plan) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::with_capacity(plan.waypoints.len());
    for (index, waypoint) in plan.waypoints.iter().enumerate() {
        let is_far = |&before: &usize| (waypoint.position_m - plan.waypoints[before].position_m).norm() >= LEAST_LEG_M;
        if kept.last().is_none_or(is_far) {
            kept.push(index);
        }
    }
    kept
}

/// The timed legs of a plan.
pub struct Legs {
    /// Places of the waypoints in the plan.
    pub kept: Vec<usize>,
    pub path: Vec<Pose>,
    deviations_m: Vec<f64>,
    /// When each waypoint is reached, s.
    pub arrivals_s: Vec<f64>,
    /// On each leg: exposures, and how many of them are taken where it starts.
    exposures: Vec<[usize; 2]>,
    /// How far along the legs each exposure is taken, m, and when, s.
    taken: Vec<(f64, f64)>,
    headings_deg: Vec<f64>,
    mount: CameraMount,
}

impl Legs {
    pub fn new(plan: &Plan, kept: Vec<usize>, limits: &Limits) -> Self {
        let path: Vec<Pose> = kept
            .iter()
            .map(|&index| Pose { position: plan.waypoints[index].position_m, direction: plan.waypoints[index].direction })
            .collect();
        let deviations_m: Vec<f64> = kept.iter().map(|&index| plan.waypoints[index].deviation_m).collect();
        let profile = Profile::rounded(&path, limits, &deviations_m);
        let length_m = |leg: usize| (path[leg + 1].position - path[leg].position).norm();
        let arrivals = (0..path.len() - 1).map(|leg| profile.time_at_s(leg, length_m(leg)));
        let arrivals_s: Vec<f64> = std::iter::once(0.0).chain(arrivals).collect();
        let mut starts_m = vec![0.0];
        (0..path.len() - 1).for_each(|leg| starts_m.push(starts_m[leg] + length_m(leg)));

        // Cameras of one exposure share its time.
        let mut times_s: Vec<f64> = plan.images.iter().map(|image| image.time_s).collect();
        times_s.sort_by(f64::total_cmp);
        times_s.dedup();
        let mut exposures = vec![[0; 2]; path.len() - 1];
        let taken = |&time_s: &f64| {
            // An image where two legs meet belongs to the one that arrives.
            let reached = arrivals_s.partition_point(|arrival_s| *arrival_s < time_s - TOLERANCE_S);
            let leg = reached.saturating_sub(1).min(exposures.len() - 1);
            exposures[leg][0] += 1;
            exposures[leg][1] += usize::from(time_s <= arrivals_s[leg] + TOLERANCE_S);
            let flown_m =
                profile.at(time_s).filter(|passage| passage.leg == leg).map_or(length_m(leg), |passage| passage.flown_m);
            (starts_m[leg] + flown_m, time_s)
        };
        let taken = times_s.iter().map(taken).collect();
        let mount = mount(limits);
        let headings_deg = headings_deg(&path, mount);
        Self { kept, path, deviations_m, arrivals_s, exposures, taken, headings_deg, mount }
    }

    pub fn points(&self) -> Vec<Point3<f64>> {
        self.path.iter().map(|pose| pose.position).collect()
    }

    fn length_m(&self, leg: usize) -> f64 {
        (self.path[leg + 1].position - self.path[leg].position).norm()
    }

    /// Waypoint `k` in the sortie from one waypoint to another.
    pub fn stop(&self, k: usize, (from, to): (usize, usize), limits: &Limits, place: &impl Fn(Point3<f64>) -> Place) -> Stop {
        let is_inner = from < k && k < to;
        let deviation_m = if is_inner { self.deviations_m[k] } else { 0.0 };
        let cut_m = if is_inner {
            let [before, at, after] = [k - 1, k, k + 1].map(|index| self.path[index].position);
            Corner::new(&(at - before), &(after - at), deviation_m).cut_m
        } else {
            0.0
        };
        let leg = k.min(to - 1);
        let [exposures, at_start] = if k < to { self.exposures[k] } else { [0; 2] };
        let onward = exposures - at_start;
        Stop {
            waypoint: self.kept[k],
            at: place(self.path[k].position),
            heading_deg: self.headings_deg[k],
            gimbal_pitch_deg: self.pitch_deg(k),
            speed_mps: limits.leg_mps(&self.path[leg], &self.path[leg + 1]),
            deviation_m,
            cut_m,
            exposures,
            spacing_m: (exposures > 0).then(|| self.length_m(leg) / onward.max(1) as f64),
            relief: Vec::new(),
        }
    }

    fn pitch_deg(&self, k: usize) -> Option<f64> {
        let direction = self.path[k].direction.filter(|_| self.mount == CameraMount::Gimbal)?;
        Some(pitch_rad(&direction).to_degrees())
    }

    pub fn trigger(&self) -> Option<Trigger> {
        let gaps = |value: fn(&(f64, f64)) -> f64| self.taken.windows(2).map(move |pair| value(&pair[1]) - value(&pair[0]));
        let distance_m = median(gaps(|taken| taken.0).collect())?;
        let interval_s = median(gaps(|taken| taken.1).collect())?;
        (distance_m > 0.0 && interval_s > 0.0).then_some(Trigger { distance_m, interval_s })
    }
}

/// Where the nose points at each waypoint, degrees clockwise from north.
fn headings_deg(path: &[Pose], mount: CameraMount) -> Vec<f64> {
    let along = |k: usize| heading(&path[k.min(path.len() - 2)].position, &path[(k + 1).min(path.len() - 1)].position);
    let looks =
        |pose: &Pose| pose.direction.filter(|view| mount == CameraMount::Gimbal && libm::hypot(view.x, view.y) > VERTICAL);
    let mut latest: Option<Unit<Vector3<f64>>> = path.iter().find_map(looks);
    let headed = |(k, pose): (usize, &Pose)| {
        // Straight down every heading will do; the nose stays as it is.
        latest = looks(pose).or(latest);
        let ahead = latest.unwrap_or_else(|| along(k));
        libm::atan2(ahead.x, ahead.y).to_degrees().rem_euclid(360.0)
    };
    path.iter().enumerate().map(headed).collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
