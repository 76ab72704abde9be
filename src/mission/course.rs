//! A plan as an aircraft is sent out with it: what every mission format needs, in the frame of the Earth, one sortie for each battery.
//!
//! Each sortie is whole: it climbs at the take-off place to a height above everything, goes to where the flight begins, or where the sortie before
//! has ended, and comes home the same way, both around no-fly zones. Speed, camera trigger and gimbal are set again in each of them, so that none depends on another.
//!
//! Heights above the take-off place ([`Place::above_takeoff_m`]) are what missions use by default. Absolute heights ([`Place::geodetic`]) start from
//! the origin's `alt_m`, the height of the ground in the vertical reference of the scene's file: of a CityJSON file mostly a national one, that is above
//! mean sea level to within decimetres; in `overfly_origin` of a GeoJSON file what its author wrote; without it 0. No geoid is applied. Heights above the
//! ground below ([`Place::above_ground_m`]) are those above the scene's terrain; the ways out and home keep to heights above the take-off place all the same.

mod detour;
mod ground;
mod legs;
mod sorties;
mod transit;

use nalgebra::Point3;

use self::detour::Ways;
pub use self::ground::{Ground, RELIEF_M};
use self::legs::{Legs, distinct, mount};
use self::sorties::{Reach, Times};
use crate::frame::{Geodetic, LocalFrame};
use crate::scene::free_space::{FreeSpace, Obstruction};
use crate::trajectory::plan::Plan;

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
    /// The aircraft is in the air, on the plan or near it: nobody flies from the take-off place to where the plan begins.
    pub in_flight: bool,
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
    /// The ground below, as the aircraft knows it.
    Terrain,
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
    /// Corners of the way out at the height of transit, from the one behind the take-off place to the place above the first stop, and of the
    /// way home, from the place above the last stop on. Neither is ever empty, save the way out of a flight that goes on in the air where it is
    /// barred: nobody flies it.
    pub out: Vec<Place>,
    pub back: Vec<Place>,
    /// From take-off to landing, s, with slow climbs, and what that takes of a battery.
    pub duration_s: f64,
    pub battery_percent: Option<f64>,
}

/// A waypoint of a sortie.
#[derive(Clone, Debug, PartialEq)]
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
    /// Places on the leg that follows at which an aircraft that counts its heights from the ground is told them again.
    pub relief: Vec<Place>,
}

/// A point of the course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// In the plan's local frame.
    pub position_m: Point3<f64>,
    pub geodetic: Geodetic,
    pub above_takeoff_m: f64,
    /// Above the ground of the scene.
    pub above_ground_m: f64,
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
    #[error("the plan has {count} waypoints, more than a mission can hold ({most})")]
    TooManyWaypoints { count: usize, most: usize },
    #[error("the plan does not say how fast it is flown (`limits`); plan the flight again with this version")]
    NoLimits,
    #[error(
        "a sortie lasts {has_s:.0} s at most, and the one from waypoint {from} to the next at which it could end, with the ways out and home, \
         takes {needs_s:.0} s; keep a smaller reserve, take off nearer, or give its time with `--sortie-time`"
    )]
    SortieTooShort { from: usize, needs_s: f64, has_s: f64 },
    #[error(
        "heights above the terrain are those above the ground of the scene, which is not known; give its file with `--scene`, or take heights above \
         the take-off place (`--altitude relative`)"
    )]
    NoTerrain,
    #[error(
        "PX4 flies no missions with heights above the terrain; take heights above the take-off place (`--altitude relative`), or `--autopilot ardupilot`"
    )]
    TerrainFrame,
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

/// Missions number their waypoints with 16 bits; a few are for the ways out and home.
const MOST_WAYPOINTS: usize = 65_000;

impl Default for CourseOptions {
    fn default() -> Self {
        Self { reserve_percent: 25.0, sortie_s: None, home: None, altitudes: Altitudes::Relative, in_flight: false }
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
        if kept.len() > MOST_WAYPOINTS {
            return Err(CourseError::TooManyWaypoints { count: kept.len(), most: MOST_WAYPOINTS });
        }
        let limits = plan.limits.ok_or(CourseError::NoLimits)?;
        let follows_ground = options.altitudes == Altitudes::Terrain;
        if follows_ground && free.is_none() {
            return Err(CourseError::NoTerrain);
        }
        let ground = Ground::of(free);
        let legs = Legs::new(plan, kept, &limits);
        let mut notes = Vec::new();

        let home_m = transit::home(&frame, &legs.points(), free, options.home, &mut notes)?;
        let transit_z_m = transit::height_m(&legs.points(), &home_m, free, &mut notes);
        let place = |position_m: Point3<f64>| Place {
            position_m,
            geodetic: frame.geodetic_from_local(&position_m).unwrap_or(origin),
            above_takeoff_m: position_m.z - home_m.z,
            above_ground_m: position_m.z - ground.height_m(position_m.x, position_m.y),
        };
        let above_home_m = Point3::new(home_m.x, home_m.y, transit_z_m);
        let ways = Ways::new(free, above_home_m);
        let reach = Reach::new(&legs, &limits, &home_m, &ways, free, transit_z_m);
        let battery_percent = plan.metrics.battery_percent.filter(|percent| *percent > 0.0);
        let times = Times::new(&legs, battery_percent, options, &mut notes);
        let parts = sorties::split(&legs, &reach, &times, options.in_flight)?;
        let out = |index: usize| reach.way(index).iter().map(|corner| place(*corner)).collect::<Vec<Place>>();
        let stop = |k: usize, ends: (usize, usize)| {
            let mut stop = legs.stop(k, ends, &limits, &place);
            if follows_ground && k < ends.1 {
                let [from, to] = [k, k + 1].map(|index| legs.path[index].position);
                stop.relief = ground.relief(&from, &to).into_iter().map(place).collect();
            }
            stop
        };
        let sortie = |(index, &(from, to)): (usize, &(usize, usize))| {
            let duration_s = reach.duration_s(&legs, from, to);
            Sortie {
                number: index + 1,
                stops: (from..=to).map(|k| stop(k, (from, to))).collect(),
                out: out(from),
                back: out(to).into_iter().rev().collect(),
                duration_s,
                battery_percent: times.percent_a_second.map(|percent| percent * duration_s),
            }
        };
        let sorties: Vec<Sortie> = parts.iter().enumerate().map(sortie).collect();
        let count: usize = sorties.iter().flat_map(|sortie| &sortie.stops).map(|stop| 1 + stop.relief.len()).sum();
        if count > MOST_WAYPOINTS {
            return Err(CourseError::TooManyWaypoints { count, most: MOST_WAYPOINTS });
        }
        let fences = transit::fences(&frame, free, home_m, &sorties, &mut notes);
        reach.note(&mut notes);
        if options.altitudes == Altitudes::Absolute && origin.alt_m == 0.0 {
            notes.push(
                "the scene says that its ground lies at 0 m, and absolute heights start from there; where that is not so, use heights above the \
                 take-off place"
                    .to_owned(),
            );
        }
        if follows_ground {
            let least_m = legs.path.windows(2).map(|ends| ground.least_above_m(&ends[0].position, &ends[1].position));
            let least_m = least_m.fold(f64::INFINITY, f64::min);
            notes.push(format!(
                "heights count from the ground as the aircraft knows it, and the flight comes down to {least_m:.1} m above the ground of the scene: compare \
                 the aircraft's terrain data with that before the flight; it flies as much too low or too high as they differ"
            ));
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

    /// Refuses a course that the scene, as it is given, does not let pass: of the same plan in the same free space. What leads out of where an aircraft must
    /// not be has rules of its own.
    pub fn check(&self, plan: &Plan, free: &FreeSpace) -> Result<(), CourseError> {
        let ground = Ground::of(Some(free));
        let legs = self.sorties.iter().flat_map(|sortie| sortie.stops.windows(2));
        for (from, to) in legs.map(|ends| (&ends[0], &ends[1])).filter(|(from, _)| from.waypoint >= plan.egress.legs()) {
            let places = std::iter::once(&from.at).chain(&from.relief).chain([&to.at]).map(|place| place.position_m);
            let places: Vec<Point3<f64>> = places.collect();
            let followed = |ends: &[Point3<f64>]| match self.altitudes {
                Altitudes::Terrain => ground.followed(&ends[0], &ends[1]),
                Altitudes::Relative | Altitudes::Absolute => ends.to_vec(),
            };
            let flown: Vec<Point3<f64>> = places.windows(2).flat_map(followed).collect();
            if let Some(obstruction) = flown.windows(2).find_map(|ends| transit::collision(free, &ends[0], &ends[1])) {
                let what = format!("the leg from waypoint {} to waypoint {}", from.waypoint, to.waypoint);
                let remedy =
                    "the plan was made for another state of the scene: plan it again, or give its own scene with `--scene`";
                return Err(CourseError::Obstructed { what, obstruction, remedy });
            }
        }
        Ok(())
    }

    /// The way of an aircraft that is far from where it has to go: straight up to the height of transit, across, and above its goal; `plan` is that of the
    /// course.
    pub fn way_over(
        &self,
        plan: &Plan,
        free: Option<&FreeSpace>,
        from_m: &Point3<f64>,
        to_m: &Point3<f64>,
    ) -> Result<Vec<Place>, CourseError> {
        let frame = LocalFrame { origin: plan.scene.origin };
        let ground = Ground::of(free);
        let z_m = (self.home.position_m.z + self.transit_m).max(from_m.z);
        let [up, above] = [from_m, to_m].map(|p| Point3::new(p.x, p.y, z_m));
        let barred = |what: &str, obstruction| CourseError::Obstructed {
            what: what.to_owned(),
            obstruction,
            remedy: "fly it by hand to where it can climb and fly on freely",
        };
        if let Some(obstruction) = free.and_then(|free| transit::collision(free, from_m, &up)) {
            return Err(barred("the climb from where the aircraft is", obstruction));
        }
        let corners = Ways::new(free, up).to(&above);
        let corners = corners.map_err(|obstruction| barred("the way from above the aircraft to above the path", obstruction))?;
        if let Some(obstruction) = free.and_then(|free| transit::collision(free, &above, to_m)) {
            return Err(barred("the descent to the path", obstruction));
        }
        let place = |position_m: Point3<f64>| Place {
            position_m,
            geodetic: frame.geodetic_from_local(&position_m).unwrap_or(self.home.geodetic),
            above_takeoff_m: position_m.z - self.home.position_m.z,
            above_ground_m: position_m.z - ground.height_m(position_m.x, position_m.y),
        };
        Ok(std::iter::once(up).chain(corners).chain([above]).map(place).collect())
    }

    /// The place above the take-off place at the height of transit.
    pub fn above_home(&self) -> Place {
        let by_m = self.transit_m;
        let Place { position_m, geodetic, above_takeoff_m, above_ground_m } = self.home;
        Place {
            position_m: position_m + nalgebra::Vector3::z() * by_m,
            geodetic: Geodetic { alt_m: geodetic.alt_m + by_m, ..geodetic },
            above_takeoff_m: above_takeoff_m + by_m,
            above_ground_m: above_ground_m + by_m,
        }
    }

    /// Releases of the shutter on the whole flight.
    pub fn exposures(&self) -> usize {
        self.sorties.iter().flat_map(|sortie| &sortie.stops).map(|stop| stop.exposures).sum()
    }
}

#[cfg(test)]
mod tests;
