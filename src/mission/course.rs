//! A plan as an aircraft is sent out with it: what every mission format needs, in the frame of the Earth, one sortie for each battery.
//!
//! Each sortie is whole: it climbs at the take-off place to a height above everything, goes to where the flight begins, or where the sortie before
//! has ended, and comes home the same way. Speed, camera trigger and gimbal are set again in each of them, so that none depends on another.
//!
//! Heights above the take-off place ([`Place::above_takeoff_m`]) are what missions use by default. Absolute heights ([`Place::geodetic`]) start from
//! the origin's `alt_m`, the height of the ground in the vertical reference of the scene's file: of a CityJSON file mostly a national one, that is above
//! mean sea level to within decimetres; in `overfly_origin` of a GeoJSON file what its author wrote; without it 0. No geoid is applied.

mod sorties;
mod transit;

use nalgebra::{Point3, Unit, Vector3};

use self::sorties::{Reach, Times};
use crate::camera::{Pose, pitch_rad};
use crate::frame::{Geodetic, LocalFrame};
use crate::scene::free_space::{FreeSpace, Obstruction};
use crate::search::leg::heading;
use crate::trajectory::corner::Corner;
use crate::trajectory::limits::{Limits, Turning};
use crate::trajectory::plan::Plan;
use crate::trajectory::profile::Profile;

/// What the user decides on.
#[derive(Clone, Debug, PartialEq)]
pub struct CourseOptions {
    /// Share of a battery that is left when the aircraft is home again, percent.
    pub reserve_percent: f64,
    /// Time of a sortie from take-off to landing, s; in place of what the battery gives.
    pub sortie_s: Option<f64>,
    /// Where the aircraft takes off; without one, on free ground as near to the first waypoint as there is.
    pub home: Option<HomeChoice>,
    pub altitudes: Altitudes,
}

/// A take-off place as it is given; its height is that of the ground of the scene where it is not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomeChoice {
    pub lat_deg: f64,
    pub lon_deg: f64,
    pub alt_m: Option<f64>,
}

/// From where the heights of a mission count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Altitudes {
    /// The take-off place.
    #[default]
    Relative,
    /// The zero of the scene's vertical reference, taken for mean sea level.
    Absolute,
}

/// How the cameras follow the aircraft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraMount {
    /// One camera that sees in all directions.
    Panoramic,
    /// One camera that is pitched by a gimbal and turned with the nose.
    Gimbal,
    /// Bolted to the airframe: the nose goes ahead.
    Fixed,
}

/// A flight in sorties.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// The scene's name.
    pub name: String,
    pub rig: String,
    pub mount: CameraMount,
    pub altitudes: Altitudes,
    /// Where the aircraft takes off and lands.
    pub home: Place,
    /// On the ways out and home it flies at this height above the take-off place, m.
    pub transit_m: f64,
    pub cruise_mps: f64,
    /// One after the other they fly the whole plan; never empty.
    pub sorties: Vec<Sortie>,
    /// How the images follow each other, over the whole flight; `None` for a plan with fewer than two exposures.
    pub trigger: Option<Trigger>,
    /// No-fly zones that the whole course lies outside of, seen from above.
    pub fences: Vec<Fence>,
    /// Where else the aircraft may land.
    pub rally: Vec<Place>,
    /// What a reader of the mission has to know.
    pub notes: Vec<String>,
}

/// A flight on one battery: at least two stops.
#[derive(Clone, Debug, PartialEq)]
pub struct Sortie {
    /// The first one is 1.
    pub number: usize,
    pub stops: Vec<Stop>,
    /// Above the first and above the last stop, at the height of transit.
    pub entry: Place,
    pub exit: Place,
    /// From take-off to landing, s, with slow climbs, and what that takes of a battery.
    pub duration_s: f64,
    pub battery_percent: Option<f64>,
}

/// A waypoint of a sortie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Its place among the plan's waypoints.
    pub waypoint: usize,
    pub at: Place,
    /// Of the nose, clockwise from north, 0 to 360 degrees: where the camera on a gimbal looks, for other rigs along the leg that follows.
    pub heading_deg: f64,
    /// Up from the horizon; `None` for rigs that set no gimbal.
    pub gimbal_pitch_deg: Option<f64>,
    /// On the leg that follows; at the last stop of a sortie on the one before.
    pub speed_mps: f64,
    /// How far the path may pass from it, m; at 0 the aircraft stops here.
    pub deviation_m: f64,
    /// How far before and behind it the path that the plan was checked on leaves the legs, m: less than half of either leg.
    pub cut_m: f64,
    /// Releases of the shutter from here on, up to and with the next stop, and the way from one to the next, m. `None` without any.
    pub exposures: usize,
    pub spacing_m: Option<f64>,
}

/// A point of the course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// In the plan's local frame.
    pub position_m: Point3<f64>,
    pub geodetic: Geodetic,
    pub above_takeoff_m: f64,
}

/// Medians over the flight: the way along the legs, and the time, from one exposure to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trigger {
    pub distance_m: f64,
    pub interval_s: f64,
}

/// A part of a no-fly zone: its corners, the first one not repeated, at the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Fence {
    pub name: String,
    pub corners: Vec<Geodetic>,
    /// Above the ground of the scene, m; without an upper end `f64::MAX`.
    pub floor_m: f64,
    pub ceiling_m: f64,
}

/// Why a plan cannot be flown as a mission.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CourseError {
    #[error(
        "the plan over {scene:?} has no georeference, so that its waypoints are no places on the Earth; plan it on a scene that has one (GeoJSON in \
         degrees, CityJSON with a reference system)"
    )]
    NoGeoreference { scene: String },
    #[error("the plan has {count} waypoint(s), and a mission needs two at different places; plan the flight again")]
    TooFewWaypoints { count: usize },
    #[error("the plan does not say how fast it is flown (`limits`); plan the flight again with this version")]
    NoLimits,
    #[error(
        "a sortie lasts {has_s:.0} s at most, and the one from waypoint {from} to the next at which it could end, with the ways out and home, \
         takes {needs_s:.0} s; keep a smaller reserve, take off nearer, or give its time with `--sortie-time`"
    )]
    SortieTooShort { from: usize, needs_s: f64, has_s: f64 },
    #[error("the flight would take more than {most} sorties; give them more time")]
    TooManySorties { most: usize },
    #[error(
        "the take-off place is {value}, which is no place on the Earth; give latitude, longitude and height as `--home LAT,LON,ALT`"
    )]
    NoPlace { value: String },
    #[error(
        "the take-off place lies {distance_m:.0} m from the first waypoint, farther than {most_m:.0} m; give it as `--home LAT,LON`, latitude first"
    )]
    FarHome { distance_m: f64, most_m: f64 },
    #[error("{what} cannot be flown in this scene: {obstruction}; {remedy}")]
    Obstructed { what: String, obstruction: Obstruction, remedy: &'static str },
}

/// Times are compared to within rounding, s.
const TOLERANCE_S: f64 = 1e-6;
/// Waypoints that lie nearer together than this are one, m.
const LEAST_LEG_M: f64 = 1e-3;
/// A direction with a smaller horizontal part looks straight down or up, and every heading will do.
const VERTICAL: f64 = 1e-6;

impl Default for CourseOptions {
    fn default() -> Self {
        Self { reserve_percent: 25.0, sortie_s: None, home: None, altitudes: Altitudes::Relative }
    }
}

impl Course {
    /// The course of a plan. With the space around it, ways out and home keep clear of structures and zones; without, nothing is known of them.
    pub fn new(plan: &Plan, free: Option<&FreeSpace>, options: &CourseOptions) -> Result<Self, CourseError> {
        let frame = LocalFrame { origin: plan.scene.origin };
        let Some(origin) = frame.origin else {
            return Err(CourseError::NoGeoreference { scene: plan.scene.name.clone() });
        };
        let kept = distinct(plan);
        if kept.len() < 2 {
            return Err(CourseError::TooFewWaypoints { count: kept.len() });
        }
        let limits = plan.limits.ok_or(CourseError::NoLimits)?;
        let legs = Legs::new(plan, kept, &limits);
        let mut notes = Vec::new();
        legs.check(plan, free)?;

        let home_m = transit::home(&frame, &legs.points(), free, options.home, &mut notes)?;
        let transit_z_m = transit::height_m(&legs.points(), home_m.z, free, &mut notes);
        let place = |position_m: Point3<f64>| Place {
            position_m,
            geodetic: frame.geodetic_from_local(&position_m).unwrap_or(origin),
            above_takeoff_m: position_m.z - home_m.z,
        };
        let reach = Reach::new(&legs, &limits, home_m, transit_z_m, free);
        let battery_percent = plan.metrics.battery_percent.filter(|percent| *percent > 0.0);
        let times = Times::new(&legs, battery_percent, options, &mut notes);
        let parts = sorties::split(&legs, &reach, &times)?;
        let above = |index: usize| place(Point3::new(legs.path[index].position.x, legs.path[index].position.y, transit_z_m));
        let sortie = |(index, &(from, to)): (usize, &(usize, usize))| {
            let duration_s = reach.duration_s(&legs, from, to);
            Sortie {
                number: index + 1,
                stops: (from..=to).map(|k| legs.stop(k, (from, to), &limits, &place)).collect(),
                entry: above(from),
                exit: above(to),
                duration_s,
                battery_percent: times.percent_a_second.map(|percent| percent * duration_s),
            }
        };
        let sorties: Vec<Sortie> = parts.iter().enumerate().map(sortie).collect();
        let fences = transit::fences(&frame, free, home_m, &sorties, &mut notes);
        if options.altitudes == Altitudes::Absolute && origin.alt_m == 0.0 {
            notes.push(
                "the scene says that its ground lies at 0 m, and absolute heights start from there; where that is not so, use heights above the \
                 take-off place"
                    .to_owned(),
            );
        }
        let home = place(home_m);
        Ok(Self {
            name: plan.scene.name.clone(),
            rig: plan.rig.clone(),
            mount: mount(&limits),
            altitudes: options.altitudes,
            transit_m: transit_z_m - home_m.z,
            cruise_mps: limits.cruise_mps,
            trigger: legs.trigger(),
            rally: vec![home],
            home,
            sorties,
            fences,
            notes,
        })
    }

    /// The height of a place as the mission counts heights, m.
    pub fn alt_m(&self, place: &Place) -> f64 {
        match self.altitudes {
            Altitudes::Relative => place.above_takeoff_m,
            Altitudes::Absolute => place.geodetic.alt_m,
        }
    }

    /// Releases of the shutter on the whole flight.
    pub fn exposures(&self) -> usize {
        self.sorties.iter().flat_map(|sortie| &sortie.stops).map(|stop| stop.exposures).sum()
    }
}

fn mount(limits: &Limits) -> CameraMount {
    match limits.turning {
        Turning::Nothing => CameraMount::Panoramic,
        Turning::View => CameraMount::Gimbal,
        Turning::Nose => CameraMount::Fixed,
    }
}

/// The plan's waypoints without those that repeat the one before.
fn distinct(plan: &Plan) -> Vec<usize> {
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
struct Legs {
    /// Places of the waypoints in the plan.
    kept: Vec<usize>,
    path: Vec<Pose>,
    deviations_m: Vec<f64>,
    /// When each waypoint is reached, s.
    arrivals_s: Vec<f64>,
    /// On each leg: exposures, and how many of them are taken where it starts.
    exposures: Vec<[usize; 2]>,
    /// How far along the legs each exposure is taken, m, and when, s.
    taken: Vec<(f64, f64)>,
    headings_deg: Vec<f64>,
    mount: CameraMount,
}

impl Legs {
    fn new(plan: &Plan, kept: Vec<usize>, limits: &Limits) -> Self {
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

    fn points(&self) -> Vec<Point3<f64>> {
        self.path.iter().map(|pose| pose.position).collect()
    }

    fn length_m(&self, leg: usize) -> f64 {
        (self.path[leg + 1].position - self.path[leg].position).norm()
    }

    /// Refuses a plan that the scene, as it is given, does not let pass.
    fn check(&self, plan: &Plan, free: Option<&FreeSpace>) -> Result<(), CourseError> {
        let Some(free) = free else { return Ok(()) };
        for (leg, ends) in self.path.windows(2).enumerate().skip(plan.egress.legs()) {
            let (from, to) = (&ends[0].position, &ends[1].position);
            if let Some(obstruction) = transit::collision(free, from, to) {
                let what = format!("the leg from waypoint {} to waypoint {}", self.kept[leg], self.kept[leg + 1]);
                let remedy =
                    "the plan was made for another state of the scene: plan it again, or give its own scene with `--scene`";
                return Err(CourseError::Obstructed { what, obstruction, remedy });
            }
        }
        Ok(())
    }

    /// Waypoint `k` in the sortie from one waypoint to another.
    fn stop(&self, k: usize, (from, to): (usize, usize), limits: &Limits, place: &impl Fn(Point3<f64>) -> Place) -> Stop {
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
        }
    }

    fn pitch_deg(&self, k: usize) -> Option<f64> {
        let direction = self.path[k].direction.filter(|_| self.mount == CameraMount::Gimbal)?;
        Some(pitch_rad(&direction).to_degrees())
    }

    fn trigger(&self) -> Option<Trigger> {
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

#[cfg(test)]
mod tests;
