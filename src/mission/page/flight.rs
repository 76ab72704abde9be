//! What a page shows of one plan.

use nalgebra::Point3;
use serde::Serialize;
use serde_json::Value;

use super::Scene3d;
use super::bytes::Packed;
use super::sighted::{Sighted, Surface};
use crate::mission::course::{Course, CourseError, CourseOptions};
use crate::mission::plan_json;
use crate::mission::svg::flight::timed_path;
use crate::scene::free_space::FreeSpace;
use crate::trajectory::plan::{Camera, Image, Plan};
use crate::trajectory::profile::Profile;
use crate::trajectory::samples::samples;

/// A plan as a page has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Flight {
    label: String,
    scene_name: String,
    revision: u64,
    rig: String,
    method: String,
    seed: u64,
    /// What was to be captured of what can be, percent; `None` where the plan does not say.
    goal_percent: Option<f64>,
    /// Those of `plan.json`.
    figures: Value,
    clearance_m: Option<f64>,
    cruise_mps: Option<f64>,
    duration_s: f64,
    path: Path,
    waypoints_m: Packed,
    cameras: Vec<Lens>,
    images: Images,
    sorties: Vec<Battery>,
    /// Why the flight is not divided into sorties.
    sorties_note: Option<String>,
    coverage: Option<Sighted>,
    /// What a reader has to know.
    notes: Vec<String>,
    /// Why what it captures cannot be held against the flight before it.
    apart: Option<String>,
    #[serde(skip)]
    own_scene: Option<Scene3d>,
}

/// The curve that is flown; between its samples the drone is where a straight line says.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Path {
    count: usize,
    times_s: Packed,
    positions_m: Packed,
    speeds_mps: Packed,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Lens {
    name: String,
    /// Horizontal and vertical; `None` for a panorama.
    fov_deg: Option<[f64; 2]>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Images {
    count: usize,
    times_s: Packed,
    positions_m: Packed,
    /// Of panoramas, which look everywhere, zero.
    directions: Packed,
    ups: Packed,
    cameras: Packed,
    selected: Packed,
}

/// What is flown on one battery.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Battery {
    number: usize,
    /// When its part of the flight begins and ends, s since the start of the whole flight, without the ways out and home.
    start_s: f64,
    end_s: f64,
    /// From take-off to landing.
    duration_s: f64,
    battery_percent: Option<f64>,
    first_waypoint: usize,
    last_waypoint: usize,
}

/// A plan for a page under a name. Without `sighted` it is not shown what it captures.
pub fn flight(label: &str, plan: &Plan, sighted: Option<Sighted>) -> Flight {
    let profile = plan.profile();
    let path = Path::of(plan, profile.as_ref());
    let last_s = plan.images.iter().map(|image| image.time_s).fold(plan.metrics.profile_s, f64::max);
    let (sorties, sorties_note) = sorties(plan, profile.as_ref(), None);
    Flight {
        label: label.to_owned(),
        scene_name: plan.scene.name.clone(),
        revision: plan.scene.revision,
        rig: plan.rig.clone(),
        method: plan.method.clone(),
        seed: plan.seed,
        goal_percent: (plan.goal_percent > 0.0).then_some(plan.goal_percent),
        figures: plan_json::metrics(plan),
        clearance_m: (plan.clearance_m > 0.0).then_some(plan.clearance_m),
        cruise_mps: plan.limits.map(|limits| limits.cruise_mps),
        duration_s: profile.as_ref().map_or(last_s, Profile::duration_s),
        path,
        waypoints_m: Packed::f32(plan.waypoints.iter().flat_map(|waypoint| <[f64; 3]>::from(waypoint.position_m.coords))),
        cameras: plan.cameras.iter().enumerate().map(|(index, camera)| Lens::of(plan, index, camera)).collect(),
        images: Images::of(&plan.images),
        sorties,
        sorties_note,
        coverage: sighted,
        notes: Vec::new(),
        apart: None,
        own_scene: None,
    }
}

impl Flight {
    /// The same through a scene of its own: that of another revision for example.
    #[must_use]
    pub fn through(self, scene: Scene3d) -> Self {
        Self { own_scene: Some(scene), ..self }
    }

    /// The same with sorties whose ways out and home keep clear of what stands there.
    #[must_use]
    pub fn from_ground(mut self, plan: &Plan, free: &FreeSpace) -> Self {
        (self.sorties, self.sorties_note) = sorties(plan, plan.profile().as_ref(), Some(free));
        self
    }

    /// The same as a flight in another revision of its scene.
    #[must_use]
    pub fn of_revision(self, revision: u64) -> Self {
        Self { revision, ..self }
    }

    /// The same with what a reader has to know.
    #[must_use]
    pub fn noted(self, notes: &[String]) -> Self {
        Self { notes: notes.to_vec(), ..self }
    }

    /// The same with why what it captures cannot be held against the flight before it on the page, if it cannot.
    #[must_use]
    pub fn apart(self, why: Option<&str>) -> Self {
        Self { apart: why.map(str::to_owned), ..self }
    }

    pub fn has_coverage(&self) -> bool {
        self.coverage.is_some()
    }

    pub(super) fn own_scene(&self) -> Option<&Scene3d> {
        self.own_scene.as_ref()
    }

    pub(super) fn surface(&self) -> Option<&Surface> {
        self.coverage.as_ref().map(|sighted| &sighted.surface)
    }
}

impl Path {
    fn of(plan: &Plan, profile: Option<&Profile>) -> Self {
        let rows: Vec<(f64, Point3<f64>, f64)> = match profile {
            Some(profile) => {
                let samples = samples(profile).into_iter();
                samples.map(|sample| (sample.time_s, sample.position_m, sample.velocity_mps.norm())).collect()
            }
            None => {
                let path = timed_path(plan);
                let speed = |k: usize| {
                    let (from, to) = (&path[k.saturating_sub(1)], &path[k]);
                    let duration_s = to.time_s - from.time_s;
                    if duration_s > 0.0 { (to.position_m - from.position_m).norm() / duration_s } else { 0.0 }
                };
                path.iter().enumerate().map(|(k, instant)| (instant.time_s, instant.position_m, speed(k))).collect()
            }
        };
        Self {
            count: rows.len(),
            times_s: Packed::f32(rows.iter().map(|row| row.0)),
            positions_m: Packed::f32(rows.iter().flat_map(|row| <[f64; 3]>::from(row.1.coords))),
            speeds_mps: Packed::f32(rows.iter().map(|row| row.2)),
        }
    }
}

impl Lens {
    fn of(plan: &Plan, index: usize, camera: &Camera) -> Self {
        let own = plan.images.iter().find(|image| image.camera as usize == index);
        Self { name: camera.name.clone(), fov_deg: own.and_then(|image| image.fov_deg) }
    }
}

impl Images {
    fn of(images: &[Image]) -> Self {
        let direction = |image: &Image| image.direction.map_or([0.0; 3], |direction| direction.into_inner().into());
        Self {
            count: images.len(),
            times_s: Packed::f32(images.iter().map(|image| image.time_s)),
            positions_m: Packed::f32(images.iter().flat_map(|image| <[f64; 3]>::from(image.position_m.coords))),
            directions: Packed::f32(images.iter().flat_map(direction)),
            ups: Packed::f32(images.iter().flat_map(|image| <[f64; 3]>::from(image.up))),
            cameras: Packed::u8(images.iter().map(|image| image.camera.min(255) as u8)),
            selected: Packed::u8(images.iter().map(|image| u8::from(image.selected))),
        }
    }
}

fn sorties(plan: &Plan, profile: Option<&Profile>, free: Option<&FreeSpace>) -> (Vec<Battery>, Option<String>) {
    let course = match Course::new(plan, free, &CourseOptions::default()) {
        Ok(course) => course,
        Err(CourseError::NoGeoreference { .. }) => {
            return (
                Vec::new(),
                Some("the scene has no georeference, so that there is no mission to divide into sorties".to_owned()),
            );
        }
        Err(error) => return (Vec::new(), Some(error.to_string())),
    };
    let passed_s = |waypoint: usize| {
        profile.map_or(0.0, |profile| {
            if waypoint + 1 < plan.waypoints.len() { profile.time_at_s(waypoint, 0.0) } else { profile.duration_s() }
        })
    };
    let battery = |sortie: &crate::mission::course::Sortie| {
        let [first, last] = [sortie.stops.first(), sortie.stops.last()].map(|stop| stop.map_or(0, |stop| stop.waypoint));
        Battery {
            number: sortie.number,
            start_s: passed_s(first),
            end_s: passed_s(last),
            duration_s: sortie.duration_s,
            battery_percent: sortie.battery_percent,
            first_waypoint: first,
            last_waypoint: last,
        }
    };
    (course.sorties.iter().map(battery).collect(), None)
}
