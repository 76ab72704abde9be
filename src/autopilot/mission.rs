//! A plan as the mission items that go to an autopilot, and where the aircraft is in the plan while one of them is current.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::dialect::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame};
use crate::frame::{Geodetic, LocalFrame};
use crate::mission::course::{Course, CourseError, CourseOptions, HomeChoice};
use crate::mission::mav_items::{self, Autopilot, MavItem};
use crate::scene::free_space::FreeSpace;
use crate::trajectory::plan::{Plan, Waypoint};

/// A mission that is joined in flight sets speed, trigger and gimbal anew on the legs to so many waypoints: at whichever of them the aircraft is when
/// the upload is through, nothing depends on an item that it has skipped.
const SET_ANEW: usize = 8;
/// A new path is joined where the aircraft is nearest to it, on so much of it from where it is looked for, m.
const JOINED_WITHIN_M: f64 = 150.0;
/// An aircraft that is nearer to the beginning of a path than this is there, m; and the beginning counts as reached within this.
const BEFORE_M: f64 = 2.0;
/// A later leg is only taken where it is nearer by so much, m.
const NEARER_M: f64 = 0.5;
/// Degrees of latitude and longitude are whole numbers of this on the wire.
const DEGREE: f64 = 1e7;

/// A plan to be flown.
#[derive(Clone, Debug)]
pub struct NewPlan {
    /// As the daemon counts plans; 0 for one from a file.
    pub epoch: u64,
    pub plan: Arc<Plan>,
    /// The plan before it, and the first waypoint that is not as it was there.
    pub differs_from: Option<(u64, usize)>,
}

/// What a mission is made with.
#[derive(Clone, Copy, Debug)]
pub struct MissionOptions<'a> {
    pub course: &'a CourseOptions,
    /// The space around the ways out and home, where it is known.
    pub free: Option<&'a FreeSpace>,
    /// From 1; whoever joins in flight is on the one that leads there.
    pub sortie: usize,
    pub autopilot: Autopilot,
}

/// How an aircraft in the air goes over to a mission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joined {
    /// The waypoint at the end of the leg that it joins.
    pub waypoint: usize,
    /// Where an aircraft is that is too far from the path to fly there straight: it climbs above everything, flies across and comes down where
    /// the leg begins.
    pub from_m: Option<Point3<f64>>,
}

/// A plan, or the sortie of it that one battery flies, as mission items.
#[derive(Clone, Debug)]
pub struct Mission {
    pub epoch: u64,
    pub plan: Arc<Plan>,
    pub frame: LocalFrame,
    pub home: HomeChoice,
    /// Height of the take-off place, from which the heights of the items count, in the local frame, m.
    pub home_z_m: f64,
    pub items: Vec<MISSION_ITEM_INT_DATA>,
    pub stops: Vec<StopItem>,
    /// The item that the way from an aircraft far away begins with.
    pub way_in: Option<usize>,
    /// Number of the sortie, and how many there are.
    pub sortie: usize,
    pub sorties: usize,
    pub notes: Vec<String>,
}

/// The items of one waypoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopItem {
    /// Its place among the plan's waypoints.
    pub waypoint: usize,
    /// The item that leads to it, and the first one of those that prepare the way there.
    pub item: usize,
    pub begins: usize,
}

/// Why a plan does not become a mission.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MissionError {
    #[error(transparent)]
    Course(#[from] CourseError),
    #[error("the plan has {has} sortie(s), and there is none of number {wanted}; give `--sortie` from 1 to {has}")]
    NoSortie { wanted: usize, has: usize },
    #[error("the mission holds the command {command}, which cannot be sent; this is a defect, please report it with the plan")]
    Command { command: u16 },
}

impl Mission {
    /// The mission of a plan for an autopilot; one that is `joined` in flight at a waypoint leaves nothing to items that are skipped.
    pub fn new(new: &NewPlan, options: &MissionOptions, joined: Option<Joined>) -> Result<Self, MissionError> {
        let &MissionOptions { course: course_options, free, sortie, autopilot } = options;
        autopilot.check(course_options.altitudes)?;
        let in_flight = course_options.in_flight || joined.is_some();
        let course = Course::new(&new.plan, free, &CourseOptions { in_flight, ..course_options.clone() })?;
        let sorties = course.sorties.len();
        // One that joins is on the sortie that flies the leg there.
        let leads_there = |joined: Joined| course.sorties.iter().rposition(|sortie| sortie.stops[0].waypoint < joined.waypoint);
        let sortie = joined.map_or(sortie, |joined| 1 + leads_there(joined).unwrap_or(0));
        let flown = sortie.checked_sub(1).and_then(|index| course.sorties.get(index));
        let flown = flown.ok_or(MissionError::NoSortie { wanted: sortie, has: sorties })?;
        let waypoints: Vec<usize> = flown.stops.iter().map(|stop| stop.waypoint).collect();
        let mut list = mav_items::items(&course, flown, autopilot);
        let mut way_in = None;
        if let Some(joined) = joined {
            let next = waypoints.partition_point(|&waypoint| waypoint < joined.waypoint);
            // One that comes down to the path flies the leg from its beginning, with all of its images.
            let first = if joined.from_m.is_some() { next.saturating_sub(1) } else { next };
            list = set_anew(&list, first..first + SET_ANEW);
            if let Some((from_m, &stop)) = joined.from_m.zip(stop_items(&list).get(first)) {
                let to_m = new.plan.waypoints[stop.waypoint].position_m;
                let way = course.way_over(&new.plan, free, &from_m, &to_m)?;
                let mut items = mav_items::way_items(&course, &way, autopilot);
                // Of the leg that leads there only the view is left: the nose and the gimbal for the first image.
                let group = list[stop.begins..stop.item].rsplit(is_relief).next().unwrap_or_default();
                items.extend(group.iter().filter(|item| !mav_items::is_of_legs(item)));
                list.splice(stop.begins..stop.item, items);
                way_in = Some(stop.begins);
            }
        }
        if autopilot == Autopilot::ArduPilot {
            // Its item 0 is the home position, and is never flown to.
            list.insert(0, home_item(&course));
            way_in = way_in.map(|item| item + 1);
        }
        let stops = stop_items(&list);
        let goes_on = joined.and_then(|joined| stops.iter().find(|stop| stop.waypoint >= joined.waypoint));
        let begins = way_in.or(goes_on.map(|stop| stop.begins)).unwrap_or(0);
        if let Some(stop) = stops.first().filter(|_| joined.is_some()) {
            // A flight that goes on does not wait where its path begins.
            let [hold_s, radius_m, ..] = &mut list[stop.item].params;
            (*hold_s, *radius_m) = (0.0, BEFORE_M);
        }
        let wire = list.iter().enumerate().map(|(seq, item)| wire(item, seq == begins));
        Ok(Self {
            epoch: new.epoch,
            plan: Arc::clone(&new.plan),
            frame: LocalFrame { origin: new.plan.scene.origin },
            home: HomeChoice {
                lat_deg: course.home.geodetic.lat_deg,
                lon_deg: course.home.geodetic.lon_deg,
                alt_m: Some(course.home.geodetic.alt_m),
            },
            home_z_m: course.home.position_m.z,
            items: wire.collect::<Result<_, _>>()?,
            stops,
            way_in,
            sortie,
            sorties,
            notes: course.notes,
        })
    }

    /// The plan's waypoint that the aircraft flies to while an item is current: the first one on the way out, `None` behind the last one.
    pub fn waypoint_ahead(&self, item: usize) -> Option<usize> {
        self.stops.iter().find(|stop| stop.item >= item).map(|stop| stop.waypoint)
    }

    /// The items of a waypoint, or of the next one that has any: waypoints at one place are one.
    pub fn stop_from(&self, waypoint: usize) -> Option<StopItem> {
        self.stops.iter().copied().find(|stop| stop.waypoint >= waypoint)
    }

    /// The item that an aircraft at a place goes on with to reach a waypoint, and the last one that leads there: places on the way at which it is told its
    /// height again, and which lie behind it, are left out.
    pub fn goes_on(&self, waypoint: usize, position_m: &Point3<f64>) -> Option<[usize; 2]> {
        let stop = self.stop_from(waypoint)?;
        let away_m = |item: usize| {
            let [lat_deg, lon_deg] = [self.items[item].x, self.items[item].y].map(|degrees| f64::from(degrees) / DEGREE);
            let alt_m = self.frame.origin.map_or(0.0, |origin| origin.alt_m);
            self.frame.local_from_geodetic(&Geodetic { lat_deg, lon_deg, alt_m })
        };
        let goal_m = away_m(stop.item)?;
        let is_behind =
            |item: usize| away_m(item).is_some_and(|at| (at.xy() - goal_m.xy()).norm() > (position_m.xy() - goal_m.xy()).norm());
        let passed = (stop.begins..stop.item)
            .rev()
            .find(|&item| self.items[item].command == MavCmd::MAV_CMD_NAV_WAYPOINT && is_behind(item));
        Some([passed.map_or(stop.begins, |item| item + 1), stop.item])
    }

    /// The item behind which the plan, or this sortie of it, is flown.
    pub fn last_item(&self) -> usize {
        self.stops.last().map_or(0, |stop| stop.item)
    }
}

/// Where a new path is flown on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Join {
    /// The waypoint that is flown to next.
    pub waypoint: usize,
    /// How far the aircraft is from the leg that leads there, m.
    pub off_m: f64,
}

/// The first waypoint that is not as it was.
pub fn first_changed(old: &[Waypoint], new: &[Waypoint]) -> usize {
    old.iter().zip(new).take_while(|(old, new)| old == new).count()
}

/// Where an aircraft goes over to a new path: at the waypoint `ahead`, to which it flies anyhow, where nothing up to there has changed; else where it is
/// nearest to the new path, which begins at the pose that it has reported. The path is looked at from waypoint `from` on.
pub fn join(waypoints: &[Waypoint], changed: usize, ahead: Option<usize>, position_m: &Point3<f64>, from: usize) -> Join {
    let points: Vec<Point3<f64>> = waypoints.iter().map(|waypoint| waypoint.position_m).collect();
    let off_m = |leg: usize| away(position_m, &points[leg], &points[leg + 1]).norm();
    if let Some(waypoint) = ahead.filter(|&ahead| ahead < changed && ahead < points.len()) {
        return Join { waypoint, off_m: if waypoint > 0 { off_m(waypoint - 1) } else { 0.0 } };
    }
    let mut best = Join { waypoint: points.len().saturating_sub(1), off_m: f64::INFINITY };
    let mut way_m = 0.0;
    for leg in from.min(points.len().saturating_sub(2))..points.len().saturating_sub(1) {
        let off_m = off_m(leg);
        if off_m < best.off_m - NEARER_M {
            best = Join { waypoint: leg + 1, off_m };
        }
        way_m += (points[leg + 1] - points[leg]).norm();
        if way_m > JOINED_WITHIN_M {
            break;
        }
    }
    // One that has not come to where the path begins flies there first: straight on to the next waypoint it would cut a corner.
    let is_before = best.waypoint == 1 && from == 0 && (points[0] - position_m).dot(&(points[1] - points[0])) > 0.0;
    if is_before && best.off_m > BEFORE_M { Join { waypoint: 0, ..best } } else { best }
}

/// The way from the nearest point between `a` and `b` to `p`.
pub fn away(p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> Vector3<f64> {
    let along = b - a;
    let share = if along.norm_squared() > 0.0 { ((p - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
    p - (a + along * share)
}

fn is_flown_to(item: &MavItem) -> bool {
    matches!(item.command, mav_items::WAYPOINT | mav_items::TAKEOFF | mav_items::RETURN_TO_LAUNCH)
}

/// The items with everything that is set before each stop of a range set right there, if it is not anyhow.
fn set_anew(items: &[MavItem], range: std::ops::Range<usize>) -> Vec<MavItem> {
    let mut set: BTreeMap<u16, MavItem> = BTreeMap::new();
    let mut all: Vec<MavItem> = Vec::with_capacity(items.len() + 5 * range.len());
    let mut group: Vec<MavItem> = Vec::new();
    let mut stops = 0usize;
    for item in items {
        if !is_flown_to(item) {
            group.push(*item);
            continue;
        }
        if (item.waypoint.is_some() || is_relief(item)) && range.contains(&stops) {
            let missing = set.values().filter(|set| group.iter().all(|item| item.command != set.command));
            all.extend(missing);
        }
        stops += usize::from(item.waypoint.is_some());
        set.extend(group.iter().map(|item| (item.command, *item)));
        all.append(&mut group);
        all.push(*item);
    }
    all.append(&mut group);
    all
}

/// A place on the way to a stop where an aircraft that follows the ground is told its height again.
fn is_relief(item: &MavItem) -> bool {
    item.waypoint.is_none() && item.frame == mav_items::FRAME_TERRAIN
}

/// The items of each waypoint of a sortie.
fn stop_items(items: &[MavItem]) -> Vec<StopItem> {
    let mut begins = 0;
    let mut stops = Vec::new();
    for (index, item) in items.iter().enumerate().filter(|(_, item)| is_flown_to(item) && !is_relief(item)) {
        stops.extend(item.waypoint.map(|waypoint| StopItem { waypoint, item: index, begins }));
        begins = index + 1;
    }
    stops
}

fn home_item(course: &Course) -> MavItem {
    let place = course.home.geodetic;
    MavItem {
        command: mav_items::WAYPOINT,
        frame: mav_items::FRAME_ABSOLUTE,
        params: [0.0; 4],
        lat_deg: place.lat_deg,
        lon_deg: place.lon_deg,
        alt_m: place.alt_m,
        waypoint: None,
    }
}

/// An item as it is sent.
fn wire(item: &MavItem, is_current: bool) -> Result<MISSION_ITEM_INT_DATA, MissionError> {
    let command = match item.command {
        mav_items::WAYPOINT => MavCmd::MAV_CMD_NAV_WAYPOINT,
        mav_items::RETURN_TO_LAUNCH => MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mav_items::TAKEOFF => MavCmd::MAV_CMD_NAV_TAKEOFF,
        mav_items::CONDITION_YAW => MavCmd::MAV_CMD_CONDITION_YAW,
        mav_items::CHANGE_SPEED => MavCmd::MAV_CMD_DO_CHANGE_SPEED,
        mav_items::MOUNT_CONTROL => MavCmd::MAV_CMD_DO_MOUNT_CONTROL,
        mav_items::TRIGGER_DISTANCE => MavCmd::MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mav_items::GIMBAL_PITCHYAW => MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        command => return Err(MissionError::Command { command }),
    };
    let (frame, scale) = match item.frame {
        mav_items::FRAME_ABSOLUTE => (MavFrame::MAV_FRAME_GLOBAL, DEGREE),
        mav_items::FRAME_RELATIVE => (MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT, DEGREE),
        mav_items::FRAME_TERRAIN => (MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT, DEGREE),
        // Parameters that are no place go as they are.
        _ => (MavFrame::MAV_FRAME_MISSION, 1.0),
    };
    let whole = |value: f64| if value.is_nan() { i32::MAX } else { (value * scale).round() as i32 };
    let [param1, param2, param3, param4] = item.params.map(|param| param as f32);
    Ok(MISSION_ITEM_INT_DATA {
        param1,
        param2,
        param3,
        param4,
        x: whole(item.lat_deg),
        y: whole(item.lon_deg),
        z: item.alt_m as f32,
        command,
        frame,
        current: u8::from(is_current),
        autocontinue: 1,
        ..MISSION_ITEM_INT_DATA::DEFAULT
    })
}

#[cfg(test)]
mod tests;
