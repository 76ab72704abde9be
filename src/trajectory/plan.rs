//! A finished plan and the figures that are reported for it.

use nalgebra::{Point3, Unit, Vector3};

use super::curve::Arc;
use super::egress::Egress;
use super::limits::Limits;
use super::profile::Profile;
use crate::camera::{Intrinsics, Pose, Rig, View};
use crate::frame::Geodetic;

pub use crate::search::outcome::{Iteration, StopReason};

/// One continuous flight that has passed the final safety check. Everything in it is a function of scene, settings, seed and budget.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    pub scene: SceneStamp,
    pub seed: u64,
    pub rig: String,
    pub method: String,
    /// The rig's cameras, indexed by [`Image::camera`].
    pub cameras: Vec<Camera>,
    pub waypoints: Vec<Waypoint>,
    pub images: Vec<Image>,
    pub metrics: Metrics,
    /// What the flight was timed with; `None` for a plan of a file that does not say.
    pub limits: Option<Limits>,
    /// Covered hemisphere cells of each sample of the field, in its order, by exact rays from the images; empty where they are not counted yet.
    pub cells: Vec<u16>,
    /// Cells of each sample that the rig's views from all viewpoints together cover: what a sample can reach at all; empty with `cells`.
    pub ceilings: Vec<u16>,
    /// Coverage goal G, percent of the capturable samples.
    pub goal_percent: f64,
    /// Goal for [`Metrics::matched_percent`]; 0 where none was asked for.
    pub matched_goal_percent: f64,
    /// Legs at the beginning that are safe only by rules of their own, for an aircraft that is where it must not be.
    pub egress: Egress,
    /// Smallest distance of the whole curve to a structure or the ground, m.
    pub clearance_m: f64,
    /// The best path after each iteration of the search.
    pub convergence: Vec<Iteration>,
    pub stop: StopReason,
}

impl Plan {
    /// Images that the reconstruction should use.
    pub fn selected_images(&self) -> usize {
        self.images.iter().filter(|image| image.selected).count()
    }

    /// Whether it is known what it captures.
    pub fn is_counted(&self) -> bool {
        self.stop != StopReason::Safe
    }

    /// The waypoints, as a search goes on with them.
    pub fn poses(&self) -> Vec<Pose> {
        self.waypoints.iter().map(|waypoint| Pose { position: waypoint.position_m, direction: waypoint.direction }).collect()
    }

    /// The timed curve: a function of waypoints and limits alone. `None` where the limits are not known.
    pub fn profile(&self) -> Option<Profile> {
        let path = self.poses();
        let deviations_m: Vec<f64> = self.waypoints.iter().map(|waypoint| waypoint.deviation_m).collect();
        self.limits.map(|limits| Profile::rounded(&path, &limits, &deviations_m))
    }

    /// Points of the curve that is flown, so near to each other that the lines between them keep within a centimetre of it (wide arcs: within 1/200 of
    /// what they may pass from their corner), and the waypoint that each of them comes behind. Without limits the corners are all that is known.
    pub fn flown_points(&self) -> Vec<(Point3<f64>, usize)> {
        let Some(profile) = self.profile() else {
            return self.waypoints.iter().enumerate().map(|(index, waypoint)| (waypoint.position_m, index)).collect();
        };
        let arcs = profile.curve().arcs.iter().zip(&self.waypoints).enumerate();
        let points = |(index, (arc, waypoint)): (usize, (&Arc, &Waypoint))| {
            arc.points((waypoint.deviation_m / 200.0).max(0.01)).map(move |point| (point, index))
        };
        arcs.flat_map(points).collect()
    }

    /// Whether sample `i` of the field can be captured by this rig at all; `threshold_cells` is the field's.
    pub fn is_capturable(&self, i: usize, threshold_cells: u32) -> bool {
        u32::from(self.ceilings[i]) > threshold_cells
    }
}

/// A camera of the rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    pub name: String,
    /// `None` for a panorama.
    pub intrinsics: Option<Intrinsics>,
    /// Angle that one pixel spans, rad.
    pub pixel_rad: f64,
}

impl Camera {
    /// The cameras of a rig, in the order of the images of one exposure.
    pub fn all_of(rig: &Rig) -> Vec<Self> {
        let camera = |index| {
            let (name, intrinsics) = rig.camera(index);
            Self { name: name.to_owned(), intrinsics: intrinsics.copied(), pixel_rad: rig.pixel_rad(index) }
        };
        (0..rig.camera_count()).map(camera).collect()
    }
}

/// How far cameras see, as [`crate::camera::sight_scale`] has it.
pub fn sight_scale(cameras: &[Camera]) -> f64 {
    crate::camera::sight_scale(cameras.iter().filter(|camera| camera.intrinsics.is_some()).map(|camera| camera.pixel_rad))
}

/// Which scene, in which state, a plan belongs to.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneStamp {
    pub name: String,
    pub origin: Option<Geodetic>,
    pub revision: u64,
}

/// A corner of the path; `direction` is the camera's view direction, the heading of a rig that is bolted on, `None` for a panoramic rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    pub position_m: Point3<f64>,
    pub direction: Option<Unit<Vector3<f64>>>,
    /// How far the arc that rounds the corner may pass from it, m; at 0 the drone stops there.
    pub deviation_m: f64,
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
    /// Whether the reconstruction should use it (section 5.3).
    pub selected: bool,
}

impl Image {
    /// Its frustum; `None` for a panorama.
    pub fn view(&self) -> Option<View> {
        let fov_deg = self.fov_deg?;
        let half_tangents = fov_deg.map(|fov_deg| libm::tan(fov_deg.to_radians() / 2.0));
        self.direction.map(|direction| View::new(self.position_m, &direction, &self.up, half_tangents))
    }
}

/// The figures of a plan, as in `plan.json`. Those of what it captures are NaN, all of them, where that is not counted yet ([`StopReason::Safe`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Metrics {
    pub length_m: f64,
    /// Length over cruise speed (Eq. 4).
    pub movement_s: f64,
    /// Sum of Eq. 5 over the inner waypoints.
    pub turning_s: f64,
    pub flight_s: f64,
    /// Time of the speed profile.
    pub profile_s: f64,
    /// What the flight draws from a full battery by movement and turning (Tables 4 and 5); `None` for a rig without a battery.
    pub battery_percent: Option<f64>,
    pub coverage_percent: f64,
    pub coverage_exposed_percent: f64,
    pub capturable_percent: f64,
    /// Share of the samples with enough matched views (`quality.least_views`) among those that can have them, percent.
    pub matched_percent: f64,
    pub information: f64,
    pub objective: f64,
    /// Exposures that wait for the shutter near a corner, and those that are left out because they would have to wait too long.
    pub delayed_exposures: u32,
    pub dropped_exposures: u32,
    /// The most that the flight smears an image at the surface nearest to it, px.
    pub blur_px: f64,
}

impl Metrics {
    /// Without what a flight captures.
    pub fn uncounted() -> Self {
        Self {
            coverage_percent: f64::NAN,
            coverage_exposed_percent: f64::NAN,
            capturable_percent: f64::NAN,
            matched_percent: f64::NAN,
            information: f64::NAN,
            objective: f64::NAN,
            ..Self::default()
        }
    }
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
