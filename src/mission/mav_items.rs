//! A sortie as MAVLink mission items (<https://mavlink.io/en/messages/common.html>), for PX4 and for ArduPilot.
//!
//! Commands between two waypoints are carried out when the first one is reached, so that speed, camera trigger and gimbal are set before the waypoint that
//! the leg leads to. An autopilot turns gimbal and nose at the beginning of a leg; the plan turns them evenly along it.

use super::course::{Altitudes, CameraMount, Course, CourseError, Place, Sortie, Stop};

/// Whose dialect is spoken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Autopilot {
    Px4,
    ArduPilot,
}

impl Autopilot {
    /// Refuses what its missions cannot say.
    pub fn check(self, altitudes: Altitudes) -> Result<(), CourseError> {
        match (self, altitudes) {
            (Self::Px4, Altitudes::Terrain) => Err(CourseError::TerrainFrame),
            _ => Ok(()),
        }
    }
}

/// One mission item.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MavItem {
    /// MAV_CMD.
    pub command: u16,
    /// MAV_FRAME: [`FRAME_ABSOLUTE`], [`FRAME_RELATIVE`], [`FRAME_TERRAIN`] or [`FRAME_MISSION`].
    pub frame: u8,
    /// Parameters 1 to 4; NaN for one that is left to the autopilot.
    pub params: [f64; 4],
    /// Parameters 5 to 7 of a command without a place.
    pub lat_deg: f64,
    pub lon_deg: f64,
    pub alt_m: f64,
    /// The plan's waypoint that it leads to, if it does.
    pub waypoint: Option<usize>,
}

/// A place with its height above mean sea level, one with its height above the take-off place, one above the ground below, and no place.
pub const FRAME_ABSOLUTE: u8 = 0;
pub const FRAME_RELATIVE: u8 = 3;
pub const FRAME_TERRAIN: u8 = 10;
pub const FRAME_MISSION: u8 = 2;

pub const WAYPOINT: u16 = 16;
pub const RETURN_TO_LAUNCH: u16 = 20;
pub const TAKEOFF: u16 = 22;
pub const CONDITION_YAW: u16 = 115;
pub const CHANGE_SPEED: u16 = 178;
pub const MOUNT_CONTROL: u16 = 205;
pub const TRIGGER_DISTANCE: u16 = 206;
pub const GIMBAL_PITCHYAW: u16 = 1000;

/// CHANGE_SPEED: over the ground, and with the throttle left alone.
const GROUND_SPEED: f64 = 1.0;
const NO_CHANGE: f64 = -1.0;
/// MOUNT_CONTROL, parameter 7: angles as given. 0 would retract the mount.
const MAVLINK_TARGETING: f64 = 2.0;
/// GIMBAL_PITCHYAW, parameter 5: roll and pitch against the horizon, yaw against north (GIMBAL_MANAGER_FLAGS 4, 8 and 16).
const LOCKED: f64 = 28.0;
/// A waypoint counts as reached within this distance, m, where the aircraft stops and where it is in transit.
const STOP_RADIUS_M: f64 = 0.5;
const TRANSIT_RADIUS_M: f64 = 2.0;
/// How long it waits at a stop, s: long enough to come to rest.
const HOLD_S: f64 = 1.0;
/// What is set already is not set again when it differs by less: m/s, degrees of gimbal and nose.
const SAME_MPS: f64 = 0.1;
const SAME_DEG: f64 = 0.5;
/// Way between two images, as a share of the planned one, from which to which the trigger is left as it is.
const SAME_SPACING: [f64; 2] = [0.85, 1.02];
/// More items than a board without an SD card holds (ArduPilot on common boards: 724).
pub const MANY_ITEMS: usize = 700;

/// The items of a sortie, from take-off to the return.
pub fn items(course: &Course, sortie: &Sortie, autopilot: Autopilot) -> Vec<MavItem> {
    let mut list = List { course, autopilot, items: Vec::new(), set: Set::default() };
    let above_home = course.above_home();
    list.push_takeoff(&above_home);
    list.set_speed(course.cruise_mps);
    sortie.out.iter().for_each(|place| list.push_transit(place));
    // The camera points ahead of the first stop, and the shutter begins there.
    for (k, stop) in sortie.stops.iter().enumerate() {
        let before = k.checked_sub(1).map(|before| &sortie.stops[before]);
        list.set_speed(before.map_or(course.cruise_mps, |before| before.speed_mps));
        if let Some(before) = before {
            list.set_trigger(before.spacing_m);
        }
        list.set_view(stop);
        before.iter().flat_map(|before| &before.relief).for_each(|place| list.push_relief(place));
        list.push_stop(stop);
    }
    list.set_trigger(None);
    list.set_speed(course.cruise_mps);
    sortie.back.iter().for_each(|place| list.push_transit(place));
    list.push_transit(&above_home);
    list.push_plain(RETURN_TO_LAUNCH, [0.0; 4]);
    list.items
}

/// The way of a course from one place to another at the height of transit, and what stops the camera on it: for an aircraft that is elsewhere than its
/// mission begins.
pub fn way_items(course: &Course, places: &[Place], autopilot: Autopilot) -> Vec<MavItem> {
    let mut list = List { course, autopilot, items: Vec::new(), set: Set::default() };
    list.set_trigger(None);
    list.set_speed(course.cruise_mps);
    places.iter().for_each(|place| list.push_transit(place));
    list.items
}

/// It sets what a leg is flown with, not where the camera looks.
pub fn is_of_legs(item: &MavItem) -> bool {
    matches!(item.command, CHANGE_SPEED | TRIGGER_DISTANCE)
}

/// What has been set so far.
#[derive(Default)]
struct Set {
    speed_mps: Option<f64>,
    /// `Some(None)` for a trigger that was stopped.
    spacing_m: Option<Option<f64>>,
    pitch_deg: Option<f64>,
    heading_deg: Option<f64>,
}

struct List<'a> {
    course: &'a Course,
    autopilot: Autopilot,
    items: Vec<MavItem>,
    set: Set,
}

impl List<'_> {
    fn push_plain(&mut self, command: u16, params: [f64; 4]) {
        self.push_wide(command, params, [0.0; 3]);
    }

    /// A command without a place, with all of its seven parameters.
    fn push_wide(&mut self, command: u16, params: [f64; 4], [lat_deg, lon_deg, alt_m]: [f64; 3]) {
        self.items.push(MavItem { command, frame: FRAME_MISSION, params, lat_deg, lon_deg, alt_m, waypoint: None });
    }

    fn push_at(&mut self, command: u16, params: [f64; 4], place: &Place, altitudes: Altitudes, waypoint: Option<usize>) {
        let (frame, alt_m) = match altitudes {
            Altitudes::Relative => (FRAME_RELATIVE, place.above_takeoff_m),
            Altitudes::Absolute => (FRAME_ABSOLUTE, place.geodetic.alt_m),
            Altitudes::Terrain => (FRAME_TERRAIN, place.above_ground_m),
        };
        let (lat_deg, lon_deg) = (place.geodetic.lat_deg, place.geodetic.lon_deg);
        self.items.push(MavItem { command, frame, params, lat_deg, lon_deg, alt_m, waypoint });
    }

    /// Take-off and the ways at one height are level wherever the ground is.
    fn level(&self) -> Altitudes {
        if self.course.altitudes == Altitudes::Terrain { Altitudes::Relative } else { self.course.altitudes }
    }

    fn push_takeoff(&mut self, above_home: &Place) {
        self.push_at(TAKEOFF, [0.0, 0.0, 0.0, f64::NAN], above_home, self.level(), None);
    }

    fn push_transit(&mut self, place: &Place) {
        self.push_at(WAYPOINT, [0.0, TRANSIT_RADIUS_M, 0.0, f64::NAN], place, self.level(), None);
    }

    /// On the way to the next stop, without a halt.
    fn push_relief(&mut self, place: &Place) {
        self.push_at(WAYPOINT, [0.0, TRANSIT_RADIUS_M, 0.0, f64::NAN], place, Altitudes::Terrain, None);
    }

    fn push_stop(&mut self, stop: &Stop) {
        // A vehicle that passes the waypoint no farther than this has turned as the plan allows.
        let (hold_s, radius_m) = if stop.deviation_m > 0.0 { (0.0, stop.deviation_m) } else { (HOLD_S, STOP_RADIUS_M) };
        let yaw_deg = if self.course.mount == CameraMount::Gimbal { stop.heading_deg } else { f64::NAN };
        self.push_at(WAYPOINT, [hold_s, radius_m, 0.0, yaw_deg], &stop.at, self.course.altitudes, Some(stop.waypoint));
    }

    fn set_speed(&mut self, speed_mps: f64) {
        if self.set.speed_mps.is_some_and(|set_mps| (set_mps - speed_mps).abs() < SAME_MPS) {
            return;
        }
        self.set.speed_mps = Some(speed_mps);
        self.push_plain(CHANGE_SPEED, [GROUND_SPEED, speed_mps, NO_CHANGE, 0.0]);
    }

    /// Images so far apart on the leg that follows; none with `None`.
    fn set_trigger(&mut self, spacing_m: Option<f64>) {
        let is_same = match (self.set.spacing_m, spacing_m) {
            (Some(Some(set_m)), Some(spacing_m)) => (SAME_SPACING[0] * spacing_m..=SAME_SPACING[1] * spacing_m).contains(&set_m),
            (Some(None), None) => true,
            _ => false,
        };
        if is_same {
            return;
        }
        self.set.spacing_m = Some(spacing_m);
        let fires_now = if spacing_m.is_some() { 1.0 } else { 0.0 };
        self.push_plain(TRIGGER_DISTANCE, [spacing_m.unwrap_or(0.0), 0.0, fires_now, 0.0]);
    }

    /// Turns the gimbal, and for ArduPilot, whose waypoints know no yaw, the nose.
    fn set_view(&mut self, stop: &Stop) {
        let Some(pitch_deg) = stop.gimbal_pitch_deg else { return };
        let differs = |set_deg: Option<f64>, deg: f64| set_deg.is_none_or(|set_deg| turn_deg(set_deg, deg) > SAME_DEG);
        let pitches = differs(self.set.pitch_deg, pitch_deg);
        let turns = differs(self.set.heading_deg, stop.heading_deg);
        match self.autopilot {
            Autopilot::Px4 if pitches || turns => {
                let params = [pitch_deg, stop.heading_deg, f64::NAN, f64::NAN];
                self.push_wide(GIMBAL_PITCHYAW, params, [LOCKED, 0.0, 0.0]);
            }
            Autopilot::Px4 => {}
            Autopilot::ArduPilot => {
                if pitches {
                    self.push_wide(MOUNT_CONTROL, [pitch_deg, 0.0, 0.0, 0.0], [0.0, 0.0, MAVLINK_TARGETING]);
                }
                if turns {
                    self.push_plain(CONDITION_YAW, [stop.heading_deg, 0.0, 0.0, 0.0]);
                }
            }
        }
        if pitches {
            self.set.pitch_deg = Some(pitch_deg);
        }
        if turns {
            self.set.heading_deg = Some(stop.heading_deg);
        }
    }
}

/// The angle from one direction to another, the shorter way, degrees.
fn turn_deg(from_deg: f64, to_deg: f64) -> f64 {
    ((to_deg - from_deg + 540.0).rem_euclid(360.0) - 180.0).abs()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mission::course::CourseOptions;
    use crate::mission::fixture::{corners, plan};

    proptest! {
        #[test]
        fn every_sortie_takes_off_sets_speed_trigger_and_gimbal_and_comes_home(
            corners in corners(2..40), rig in 0usize..3, sortie_s in 400.0..900.0f64, is_ardupilot: bool,
        ) {
            let (rig, mount) = [("panoramic", None), ("m300-oblique", None), ("phantom4-rtk", Some(()))][rig];
            let options = CourseOptions { sortie_s: Some(sortie_s), ..CourseOptions::default() };
            let course = Course::new(&plan(rig, &corners), None, &options).unwrap();
            let autopilot = if is_ardupilot { Autopilot::ArduPilot } else { Autopilot::Px4 };
            for sortie in &course.sorties {
                let items = items(&course, sortie, autopilot);
                let place = |command: u16| items.iter().position(|item| item.command == command);
                let count = |command: u16| items.iter().filter(|item| item.command == command).count();
                prop_assert_eq!((items[0].command, items[items.len() - 1].command), (TAKEOFF, RETURN_TO_LAUNCH));
                prop_assert_eq!(count(WAYPOINT), sortie.stops.len() + 3);
                prop_assert!(place(CHANGE_SPEED) < place(WAYPOINT));
                let triggers: Vec<&MavItem> = items.iter().filter(|item| item.command == TRIGGER_DISTANCE).collect();
                prop_assert!(triggers.len() >= 2 && triggers[0].params[0] > 0.0 && triggers[0].params[2] == 1.0);
                prop_assert_eq!(triggers[triggers.len() - 1].params[0], 0.0);
                let gimbal = [count(GIMBAL_PITCHYAW), count(MOUNT_CONTROL)];
                prop_assert_eq!(gimbal[usize::from(is_ardupilot)] > 0, mount.is_some());
                prop_assert_eq!(gimbal[usize::from(!is_ardupilot)], 0);
                prop_assert!(items.iter().all(|item| item.command != MOUNT_CONTROL || item.alt_m == 2.0));
                let is_place = |item: &MavItem| [WAYPOINT, TAKEOFF].contains(&item.command);
                prop_assert!(items.iter().all(|item| item.frame == [FRAME_MISSION, FRAME_RELATIVE][usize::from(is_place(item))]));
            }
        }
    }

    #[test]
    fn what_is_set_is_not_set_again() {
        let corners: Vec<[f64; 3]> = (0..20).map(|k| [40.0 * f64::from(k), 0.0, 30.0]).collect();
        let course = Course::new(&plan("panoramic", &corners), None, &CourseOptions::default()).unwrap();
        let items = items(&course, &course.sorties[0], Autopilot::Px4);
        let count = |command: u16| items.iter().filter(|item| item.command == command).count();
        assert_eq!((count(CHANGE_SPEED), count(TRIGGER_DISTANCE), count(GIMBAL_PITCHYAW)), (1, 2, 0));
    }
}
