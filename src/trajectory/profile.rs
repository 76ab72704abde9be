//! The speed profile: how long a drone of given limits takes along a path. One profile with the same limits ranks every method.
//!
//! Eq. 5 makes a hairpin (2.25 s) cheaper than two turns of 45 degrees (2.72 s), so it cannot rank paths. Here every corner is rounded by an
//! arc that keeps within `corner_deviation_m` of the corner; the arc's radius limits the speed by the lateral acceleration and, where the
//! drone flies nose first, by its yaw rate. Straight parts are flown with bounded acceleration up to the cruise speed, or slower where the
//! camera has to turn. The flight begins and ends at rest.

use nalgebra::{Unit, Vector3};

use crate::camera::{Cameras, Pose, Rig, pitch_rad};
use crate::search::leg::{angle_rad, heading, slerp};
use crate::settings::{DynamicsSettings, FlightSettings};

/// A timed path.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    legs: Vec<TimedLeg>,
    duration_s: f64,
}

/// What a rig can do in the air. Each rule looks at a few neighbouring waypoints, so that a change of a path changes its times nearby.
#[derive(Clone, Debug)]
pub struct Limits {
    turning: Turning,
    cruise_mps: f64,
    dynamics: DynamicsSettings,
}

/// What has to turn along a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turning {
    Nothing,
    /// A camera on a gimbal turns along the legs.
    View,
    /// Bolted cameras turn with the nose, in the corners.
    Nose,
}

/// A leg between the arcs at its ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct TimedLeg {
    /// When the drone passes the leg's start: the middle of the arc there, s.
    start_s: f64,
    /// Length of the polyline's leg and what the arcs at both ends cut off it, m.
    length_m: f64,
    cut_m: [f64; 2],
    /// Time in the second half of the first arc and in the first half of the last one, s.
    arc_s: [f64; 2],
    straight: Straight,
}

/// A straight part flown from one speed to another without exceeding a third.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Straight {
    length_m: f64,
    from_mps: f64,
    to_mps: f64,
    peak_mps: f64,
    acceleration_mps2: f64,
}

/// A corner with the largest arc that keeps near it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Corner {
    deviation_rad: f64,
    radius_m: f64,
    /// What the arc cuts off each of the two legs, m.
    pub cut_m: f64,
    /// How far the nose turns where the cameras are bolted to the airframe, rad.
    yaw_rad: f64,
    /// Speed on the arc.
    pub speed_mps: f64,
}

/// A corner with a smaller arc is flown at rest, m.
const LEAST_RADIUS_M: f64 = 1e-3;

/// Parts of a leg in which the turning of the camera is looked at.
const TURN_PARTS: u32 = 8;

impl Profile {
    pub fn new(path: &[Pose], rig: &Rig, flight: &FlightSettings, dynamics: &DynamicsSettings) -> Self {
        let limits = Limits::new(rig, flight, dynamics);
        let lengths_m: Vec<f64> = path.windows(2).map(|ends| (ends[1].position - ends[0].position).norm()).collect();
        let speeds_mps: Vec<f64> = path.windows(2).map(|ends| limits.leg_mps(&ends[0], &ends[1])).collect();
        let mut corners: Vec<Corner> = vec![Corner::default()];
        for (k, at) in path.windows(3).enumerate() {
            corners.push(limits.corner(&at[0], &at[1], &at[2], speeds_mps[k].min(speeds_mps[k + 1])));
        }
        corners.push(Corner::default());
        bound_speeds(&limits, &mut corners, &lengths_m);
        let mut profile = Self { legs: Vec::with_capacity(lengths_m.len()), duration_s: 0.0 };
        for (k, &length_m) in lengths_m.iter().enumerate() {
            let ends = [corners[k], corners[k + 1]];
            let timed = TimedLeg::new(profile.duration_s, length_m, &ends, speeds_mps[k], dynamics);
            profile.duration_s = timed.end_s();
            profile.legs.push(timed);
        }
        profile
    }

    /// Time of the whole flight, s.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// When the drone is `flown_m` from the start of a leg, s since the start of the flight. A place that an arc cuts off is passed on
    /// the arc.
    pub fn time_at_s(&self, leg: usize, flown_m: f64) -> f64 {
        self.legs.get(leg).map_or(0.0, |leg| leg.time_at_s(flown_m))
    }
}

impl Limits {
    pub fn new(rig: &Rig, flight: &FlightSettings, dynamics: &DynamicsSettings) -> Self {
        let turning = match rig.cameras {
            Cameras::Panoramic { .. } => Turning::Nothing,
            Cameras::Gimbal { .. } => Turning::View,
            Cameras::Rigid(_) => Turning::Nose,
        };
        Self { turning, cruise_mps: flight.cruise_speed_mps, dynamics: *dynamics }
    }

    /// Speed on a leg: that of the cruise, or less where the camera needs longer to turn than the leg takes, m/s.
    pub fn leg_mps(&self, from: &Pose, to: &Pose) -> f64 {
        let Some((first, last)) = from.direction.zip(to.direction).filter(|(first, last)| first != last) else {
            return self.cruise_mps;
        };
        if self.turning != Turning::View {
            return self.cruise_mps;
        }
        let turning_s = turning_s(&first, &last, &self.dynamics);
        if turning_s > 0.0 { self.cruise_mps.min((to.position - from.position).norm() / turning_s) } else { self.cruise_mps }
    }

    /// The corner at a waypoint between two others; `limit_mps` is the lower speed of the two legs.
    pub fn corner(&self, before: &Pose, at: &Pose, after: &Pose, limit_mps: f64) -> Corner {
        let yaw_rad = if self.turning == Turning::Nose { yaw_between(before, at, after) } else { 0.0 };
        Corner::new(&(at.position - before.position), &(after.position - at.position), yaw_rad, limit_mps, &self.dynamics)
    }

    /// The speed that can be reached from another one along a leg between two corners, m/s; speeding up and slowing down alike.
    pub fn reachable_mps(&self, from_mps: f64, leg_m: f64, ends: [&Corner; 2]) -> f64 {
        let straight_m = (leg_m - ends[0].cut_m - ends[1].cut_m).max(0.0);
        (from_mps * from_mps + 2.0 * self.dynamics.acceleration_mps2 * straight_m).sqrt()
    }

    /// Time of a leg from the middle of the arc at its start to the middle of that at its end, s; the corners have their final speeds.
    pub fn leg_s(&self, leg_m: f64, ends: &[Corner; 2], limit_mps: f64) -> f64 {
        TimedLeg::new(0.0, leg_m, ends, limit_mps, &self.dynamics).end_s()
    }
}

impl TimedLeg {
    fn new(start_s: f64, length_m: f64, ends: &[Corner; 2], limit_mps: f64, dynamics: &DynamicsSettings) -> Self {
        let straight = Straight::new(
            (length_m - ends[0].cut_m - ends[1].cut_m).max(0.0),
            ends.map(|corner| corner.speed_mps),
            limit_mps,
            dynamics.acceleration_mps2,
        );
        let arc_s = ends.map(|corner| corner.duration_s(dynamics) / 2.0);
        Self { start_s, length_m, cut_m: ends.map(|corner| corner.cut_m), arc_s, straight }
    }

    fn end_s(&self) -> f64 {
        self.start_s + self.arc_s[0] + self.straight.duration_s() + self.arc_s[1]
    }

    fn time_at_s(&self, flown_m: f64) -> f64 {
        let [first_m, last_m] = self.cut_m;
        let flown_m = flown_m.clamp(0.0, self.length_m);
        let straight_s = self.straight.duration_s();
        if flown_m < first_m {
            return self.start_s + self.arc_s[0] * flown_m / first_m;
        }
        let into_last_m = flown_m - (self.length_m - last_m);
        if into_last_m > 0.0 {
            return self.start_s + self.arc_s[0] + straight_s + self.arc_s[1] * (into_last_m / last_m).min(1.0);
        }
        let at_end_s = if flown_m == self.length_m { self.arc_s[1] } else { 0.0 };
        self.start_s + self.arc_s[0] + self.straight.time_at_s(flown_m - first_m) + at_end_s
    }
}

impl Straight {
    fn new(length_m: f64, [from_mps, to_mps]: [f64; 2], limit_mps: f64, acceleration_mps2: f64) -> Self {
        let squared = (from_mps * from_mps + to_mps * to_mps) / 2.0 + acceleration_mps2 * length_m;
        let peak_mps = squared.sqrt().min(limit_mps).max(from_mps).max(to_mps);
        Self { length_m, from_mps, to_mps, peak_mps, acceleration_mps2 }
    }

    fn duration_s(&self) -> f64 {
        self.time_at_s(self.length_m)
    }

    /// Time after `x_m` of the part: speeding up, at the peak, slowing down.
    fn time_at_s(&self, x_m: f64) -> f64 {
        let Self { length_m, from_mps, to_mps, peak_mps, acceleration_mps2: a } = *self;
        if peak_mps <= 0.0 {
            return 0.0;
        }
        let speed_after = |speed_mps: f64, x_m: f64| (speed_mps * speed_mps + 2.0 * a * x_m).max(0.0).sqrt();
        let rise_m = (peak_mps * peak_mps - from_mps * from_mps) / (2.0 * a);
        let fall_m = (peak_mps * peak_mps - to_mps * to_mps) / (2.0 * a);
        let rising_s = |x_m: f64| (speed_after(from_mps, x_m) - from_mps) / a;
        if x_m < rise_m {
            return rising_s(x_m);
        }
        let level_m = (length_m - rise_m - fall_m).max(0.0);
        let left_m = (length_m - x_m).max(0.0);
        let until_fall_s = rising_s(rise_m) + level_m / peak_mps;
        if left_m >= fall_m {
            return rising_s(rise_m) + (x_m - rise_m).min(level_m) / peak_mps;
        }
        until_fall_s + (peak_mps - speed_after(to_mps, left_m)) / a
    }
}

impl Corner {
    /// The same corner, passed at another speed.
    pub fn at_mps(self, speed_mps: f64) -> Self {
        Self { speed_mps, ..self }
    }

    fn new(before: &Vector3<f64>, after: &Vector3<f64>, yaw_rad: f64, limit_mps: f64, dynamics: &DynamicsSettings) -> Self {
        let deviation_rad = angle_rad(before, after);
        let (sin_half, cos_half) = libm::sincos(deviation_rad / 2.0);
        // The arc touches both legs and its middle lies `corner_deviation_m` from the corner; it may take half of the shorter leg.
        let nearest_m = dynamics.corner_deviation_m * cos_half / (1.0 - cos_half).max(1e-12);
        let fitting_m = before.norm().min(after.norm()) / 2.0 * cos_half / sin_half.max(1e-12);
        let radius_m = nearest_m.min(fitting_m).max(0.0);
        let corner = Self { deviation_rad, radius_m, cut_m: radius_m * sin_half / cos_half.max(1e-12), yaw_rad, speed_mps: 0.0 };
        if radius_m < LEAST_RADIUS_M {
            return Self { radius_m: 0.0, cut_m: 0.0, ..corner };
        }
        let lateral_mps = (dynamics.lateral_mps2 * radius_m).sqrt();
        let yaw_mps =
            if yaw_rad > 0.0 { radius_m * deviation_rad * dynamics.yaw_rate_dps.to_radians() / yaw_rad } else { f64::INFINITY };
        Self { speed_mps: limit_mps.min(lateral_mps).min(yaw_mps), ..corner }
    }

    /// Time on the arc; at rest that of turning the nose, s.
    fn duration_s(&self, dynamics: &DynamicsSettings) -> f64 {
        if self.speed_mps > 0.0 {
            self.radius_m * self.deviation_rad / self.speed_mps
        } else {
            self.yaw_rad / dynamics.yaw_rate_dps.to_radians()
        }
    }
}

/// Lowers the corners' speeds until each can be reached from its neighbours.
fn bound_speeds(limits: &Limits, corners: &mut [Corner], lengths_m: &[f64]) {
    for (k, &length_m) in lengths_m.iter().enumerate() {
        let reachable_mps = limits.reachable_mps(corners[k].speed_mps, length_m, [&corners[k], &corners[k + 1]]);
        corners[k + 1].speed_mps = corners[k + 1].speed_mps.min(reachable_mps);
    }
    for (k, &length_m) in lengths_m.iter().enumerate().rev() {
        let reachable_mps = limits.reachable_mps(corners[k + 1].speed_mps, length_m, [&corners[k], &corners[k + 1]]);
        corners[k].speed_mps = corners[k].speed_mps.min(reachable_mps);
    }
}

/// Time that yaw and gimbal need along the great circle between two view directions, s.
fn turning_s(first: &Unit<Vector3<f64>>, last: &Unit<Vector3<f64>>, dynamics: &DynamicsSettings) -> f64 {
    let at = |part: u32| slerp(first, last, f64::from(part) / f64::from(TURN_PARTS));
    let directions: Vec<_> = (0..=TURN_PARTS).map(|part| if part == 0 { *first } else { at(part) }).collect();
    let part_s = |ends: &[Unit<Vector3<f64>>]| {
        let pitch_s = (pitch_rad(&ends[1]) - pitch_rad(&ends[0])).abs() / dynamics.gimbal_rate_dps.to_radians();
        // Straight down every yaw will do.
        let yaw_rad = yaw_rad(&ends[0]).zip(yaw_rad(&ends[1])).map_or(0.0, |(before, after)| shorter_way_rad(after - before));
        pitch_s.max(yaw_rad / dynamics.yaw_rate_dps.to_radians())
    };
    // The fastest part sets the pace, because the direction advances evenly along the leg.
    directions.windows(2).map(part_s).fold(0.0, f64::max) * f64::from(TURN_PARTS)
}

/// Azimuth of a direction; none straight down or up.
fn yaw_rad(direction: &Unit<Vector3<f64>>) -> Option<f64> {
    (libm::hypot(direction.x, direction.y) > 1e-6).then(|| libm::atan2(direction.x, direction.y))
}

fn yaw_between(before: &Pose, corner: &Pose, after: &Pose) -> f64 {
    angle_rad(&heading(&before.position, &corner.position), &heading(&corner.position, &after.position))
}

fn shorter_way_rad(difference_rad: f64) -> f64 {
    let turned = difference_rad.abs() % std::f64::consts::TAU;
    turned.min(std::f64::consts::TAU - turned)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;
    use crate::camera::direction_of;
    use crate::settings::Settings;

    fn limits() -> (FlightSettings, DynamicsSettings) {
        let Settings { flight, .. } = Settings::default();
        let dynamics = DynamicsSettings {
            acceleration_mps2: 2.0,
            lateral_mps2: 2.0,
            corner_deviation_m: 1.0,
            yaw_rate_dps: 90.0,
            gimbal_rate_dps: 45.0,
        };
        (FlightSettings { cruise_speed_mps: 8.0, ..flight }, dynamics)
    }

    fn path(corners: &[[f64; 3]]) -> Vec<Pose> {
        corners.iter().map(|&corner| Pose { position: Point3::from(corner), direction: None }).collect()
    }

    fn profile(rig: &str, path: &[Pose]) -> Profile {
        let (flight, dynamics) = limits();
        Profile::new(path, &Rig::preset(rig).unwrap(), &flight, &dynamics)
    }

    #[test]
    fn a_straight_leg_is_flown_with_one_rise_and_one_fall() {
        // From rest to 8 m/s at 2 m/s^2: 4 s on 16 m, the same at the end; 68 m at 8 m/s between.
        let long = profile("panoramic", &path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0]]));
        assert!((long.duration_s() - (4.0 + 68.0 / 8.0 + 4.0)).abs() < 1e-9);
        for (flown_m, time_s) in [(0.0, 0.0), (4.0, 2.0), (16.0, 4.0), (50.0, 8.25), (84.0, 12.5), (96.0, 14.5), (100.0, 16.5)] {
            assert!((long.time_at_s(0, flown_m) - time_s).abs() < 1e-9, "{flown_m} m");
        }
        // Too short for the cruise speed: half of it speeding up.
        let short = profile("panoramic", &path(&[[0.0, 0.0, 30.0], [8.0, 0.0, 30.0]]));
        assert!((short.duration_s() - 2.0 * (2.0f64 * 4.0 / 2.0).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn a_right_angle_is_rounded_as_wide_as_its_deviation_allows() {
        let turn = profile("panoramic", &path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0], [100.0, 100.0, 30.0]]));
        // r (1/cos 45 - 1) = 1 m, so r = cut = 2.414 m and v = sqrt(2 r) = 2.197 m/s.
        let radius_m = 1.0 / (2f64.sqrt() - 1.0);
        let speed_mps = (2.0 * radius_m).sqrt();
        let fall_s = (8.0 - speed_mps) / 2.0;
        let fall_m = (64.0 - speed_mps * speed_mps) / 4.0;
        let leg_s = 4.0 + (100.0 - radius_m - 16.0 - fall_m) / 8.0 + fall_s;
        let arc_s = radius_m * std::f64::consts::FRAC_PI_2 / speed_mps;
        assert!((turn.duration_s() - (2.0 * leg_s + arc_s)).abs() < 1e-9);
        assert!((turn.time_at_s(0, 100.0) - turn.time_at_s(1, 0.0)).abs() < 1e-9, "the corner is passed once");
        assert!((turn.time_at_s(0, 100.0) - turn.duration_s() / 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_hairpin_is_a_stop_and_a_nose_first_drone_turns_round_in_it() {
        let there_and_back = path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0], [0.0, 0.0, 30.0]]);
        assert!((profile("panoramic", &there_and_back).duration_s() - 33.0).abs() < 1e-6);
        assert!((profile("m300-oblique", &there_and_back).duration_s() - 35.0).abs() < 1e-6);
    }

    #[test]
    fn a_camera_that_turns_far_slows_its_leg_down() {
        let mut leg = path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0]]);
        leg[0].direction = Some(direction_of(0.0, 0.0));
        leg[1].direction = Some(direction_of(0.0, -80.0));
        let slow = profile("phantom4-rtk", &leg).duration_s();
        leg[1].direction = Some(direction_of(0.0, -60.0));
        let pitching = profile("phantom4-rtk", &leg).duration_s();
        assert!((pitching - 16.5).abs() < 1e-9, "60 degrees at 45 degrees a second fit into 100 m: {pitching}");
        assert!((slow - 16.5).abs() < 1e-9, "80 degrees as well: {slow}");
        leg[1].position.x = 8.0;
        let turning = profile("phantom4-rtk", &leg).duration_s();
        // 60 degrees at 45 degrees a second: 8 m in 4/3 s would need 6 m/s, which is never reached on 8 m.
        assert!((turning - 4.0).abs() < 1e-9, "{turning}");
        leg[1].direction = Some(direction_of(170.0, -30.0));
        assert!(profile("phantom4-rtk", &leg).duration_s() > 4.0);
    }

    proptest! {
        #[test]
        fn time_runs_forward_and_never_beats_the_limits(
            corners in prop::collection::vec([-100.0..100.0f64, -100.0..100.0, 5.0..100.0], 2..9), rig in 0usize..3,
        ) {
            prop_assume!(corners.windows(2).all(|pair| (Point3::from(pair[1]) - Point3::from(pair[0])).norm() > 8.0));
            let path = path(&corners);
            let profile = profile(["panoramic", "m300-oblique", "phantom4-rtk"][rig], &path);
            let mut length_m = 0.0;
            let (mut before_s, mut cut_m) = (-1e-9, 0.0);
            for (leg, ends) in path.windows(2).enumerate() {
                let leg_m = (ends[1].position - ends[0].position).norm();
                length_m += leg_m;
                cut_m += profile.legs[leg].cut_m.iter().sum::<f64>();
                prop_assert!(profile.legs[leg].cut_m.iter().sum::<f64>() <= leg_m + 1e-9);
                for step in 0..=40 {
                    let time_s = profile.time_at_s(leg, leg_m * f64::from(step) / 40.0);
                    prop_assert!(time_s >= before_s - 1e-9, "leg {} step {}: {} after {}", leg, step, time_s, before_s);
                    before_s = time_s;
                }
            }
            prop_assert!((profile.duration_s() - before_s).abs() < 1e-6);
            prop_assert!(profile.duration_s() >= (length_m - cut_m) / 8.0);
            // Not slower than stopping at every corner and turning round there.
            let stops: f64 = path.windows(2).map(|ends| {
                let leg_m = (ends[1].position - ends[0].position).norm();
                if leg_m > 32.0 { 8.0 + (leg_m - 32.0) / 8.0 } else { 2.0 * (leg_m / 2.0).sqrt() * 2f64.sqrt() / 1.0 }
            }).sum();
            prop_assert!(profile.duration_s() <= stops + 2.0 * (path.len() - 2) as f64 + 1e-6);
        }
    }
}
