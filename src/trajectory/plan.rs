//! A finished plan and the figures that are reported for it.

use nalgebra::{Point3, Unit, Vector3};

use crate::frame::Geodetic;

pub use crate::search::outcome::{Iteration, StopReason};

/// One continuous flight that has passed the final safety check. Everything in it is a function of scene, settings, seed and budget.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    pub scene: SceneStamp,
    pub seed: u64,
    pub rig: String,
    pub method: String,
    /// Names of the rig's cameras, indexed by [`Image::camera`].
    pub cameras: Vec<String>,
    pub waypoints: Vec<Waypoint>,
    pub images: Vec<Image>,
    pub metrics: Metrics,
    /// Covered hemisphere cells of each sample of the field, in its order, by exact rays from the images.
    pub cells: Vec<u16>,
    /// Coverage goal G, percent of the capturable samples.
    pub goal_percent: f64,
    /// Smallest distance of the whole curve to a structure or the ground, m.
    pub clearance_m: f64,
    /// The best path after each iteration of the search.
    pub convergence: Vec<Iteration>,
    pub stop: StopReason,
}

/// Which scene, in which state, a plan belongs to.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneStamp {
    pub name: String,
    pub origin: Option<Geodetic>,
    pub revision: u64,
}

/// A corner of the path; `direction` is the camera's view direction, `None` for a panoramic rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    pub position_m: Point3<f64>,
    pub direction: Option<Unit<Vector3<f64>>>,
}

/// One image of one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Image {
    pub position_m: Point3<f64>,
    pub direction: Option<Unit<Vector3<f64>>>,
    pub up: Vector3<f64>,
    /// Horizontal and vertical field of view; `None` for a panoramic image.
    pub fov_deg: Option<[f64; 2]>,
    /// Index into [`Plan::cameras`].
    pub camera: u32,
    /// Since the start of the flight, s.
    pub time_s: f64,
    pub selected: bool,
}

/// The figures of a plan, as in `plan.json`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Metrics {
    pub length_m: f64,
    /// Length over cruise speed (Eq. 4).
    pub movement_s: f64,
    /// Sum of Eq. 5 over the inner waypoints.
    pub turning_s: f64,
    pub flight_s: f64,
    pub coverage_percent: f64,
    pub coverage_exposed_percent: f64,
    pub capturable_percent: f64,
    pub information: f64,
    pub objective: f64,
}

/// What varies between runs of the same plan: written to `run.json`, never to `plan.json`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunTimes {
    /// Building the field, s; 0 when it was there already.
    pub field_s: f64,
    pub search_s: f64,
    /// Exact evaluation and safety check, s.
    pub check_s: f64,
    /// From taking up the request to the finished plan, s.
    pub total_s: f64,
    pub threads: u32,
}
