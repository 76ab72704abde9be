//! What a rig can do in the air.

use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::corner::Corner;
use super::straight::{Ramp, Straight};
use crate::camera::{Cameras, Pose, Rig, pitch_rad};
use crate::search::leg::{angle_rad, heading, slerp};
use crate::settings::{DynamicsSettings, FlightSettings};

/// What a rig can do in the air. Each rule looks at a few neighbouring waypoints, so that a change of a path changes its times nearby.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    pub turning: Turning,
    pub cruise_mps: f64,
    pub dynamics: DynamicsSettings,
    /// Speed at the start of the flight, m/s: 0 from rest. A flight that begins in the air goes on with the speed that the drone has.
    #[serde(default, skip_serializing_if = "is_rest")]
    pub entry_mps: f64,
}

/// What has to turn along a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Turning {
    Nothing,
    /// A camera on a gimbal turns along the legs.
    View,
    /// Bolted cameras turn with the nose, in the corners.
    Nose,
}

/// No arc passes farther from its corner, m.
pub const MOST_DEVIATION_M: f64 = 100.0;
/// Parts of a leg in which the turning of the camera is looked at.
const TURN_PARTS: u32 = 8;
/// A direction with a smaller horizontal part looks straight down or up, and every yaw will do.
const VERTICAL: f64 = 1e-6;

impl Limits {
    pub fn new(rig: &Rig, flight: &FlightSettings, dynamics: &DynamicsSettings) -> Self {
        let turning = match rig.cameras {
            Cameras::Panoramic { .. } => Turning::Nothing,
            Cameras::Gimbal { .. } => Turning::View,
            Cameras::Rigid(_) => Turning::Nose,
        };
        Self { turning, cruise_mps: flight.cruise_speed_mps, dynamics: *dynamics, entry_mps: 0.0 }
    }

    /// Whether every number is one that a drone can fly by; limits that somebody else has written are not trusted.
    pub fn are_sound(&self) -> bool {
        let DynamicsSettings { acceleration_mps2, jerk_mps3, lateral_mps2, corner_deviation_m, yaw_rate_dps, gimbal_rate_dps } =
            self.dynamics;
        let rates = [self.cruise_mps, acceleration_mps2, jerk_mps3, lateral_mps2, yaw_rate_dps, gimbal_rate_dps];
        rates.iter().all(|rate| (0.01..=1e4).contains(rate))
            && (0.0..=MOST_DEVIATION_M).contains(&corner_deviation_m)
            && (0.0..=1e4).contains(&self.entry_mps)
    }

    /// Speed on a leg: that of the cruise, or less where the camera needs longer to turn than the leg takes, m/s.
    pub fn leg_mps(&self, from: &Pose, to: &Pose) -> f64 {
        if self.turning != Turning::View {
            return self.cruise_mps;
        }
        let Some((first, last)) = from.direction.zip(to.direction).filter(|(first, last)| first != last) else {
            return self.cruise_mps;
        };
        let leg_m = (to.position - from.position).norm();
        let turning_s = turning_s(&first, &last, &self.dynamics, leg_m / self.cruise_mps);
        if turning_s > 0.0 { self.cruise_mps.min(leg_m / turning_s) } else { self.cruise_mps }
    }

    /// The start of a path: no corner, and passed with the speed that the drone has there.
    pub fn entry(&self) -> Corner {
        Corner::default().at_mps(self.entry_mps)
    }

    /// Way on which the drone comes to rest from a speed, m.
    pub fn braking_m(&self, speed_mps: f64) -> f64 {
        self.ramp().length_m(speed_mps, 0.0)
    }

    /// The corner at a waypoint between two others; `limit_mps` is the lower speed of the two legs.
    pub fn corner(&self, before: &Pose, at: &Pose, after: &Pose, limit_mps: f64) -> Corner {
        self.corner_within(before, at, after, limit_mps, self.dynamics.corner_deviation_m)
    }

    /// The same with an arc that keeps within `deviation_m` of the waypoint.
    pub fn corner_within(&self, before: &Pose, at: &Pose, after: &Pose, limit_mps: f64, deviation_m: f64) -> Corner {
        let corner = Corner::new(&(at.position - before.position), &(after.position - at.position), deviation_m);
        match self.turning {
            Turning::Nothing => corner.limited(0.0, limit_mps, &self.dynamics),
            Turning::Nose => corner.limited(yaw_between(before, at, after), limit_mps, &self.dynamics),
            // The view turns with the length of the legs, and an arc is shorter than what it cuts off.
            Turning::View if corner.cut_m > 0.0 => {
                corner.limited(0.0, limit_mps * corner.arc_m() / (2.0 * corner.cut_m), &self.dynamics)
            }
            Turning::View => corner.limited(0.0, limit_mps, &self.dynamics),
        }
    }

    /// The speed that can be reached from another one along a leg between two corners, m/s; speeding up and slowing down alike.
    pub fn reachable_mps(&self, from_mps: f64, leg_m: f64, ends: [&Corner; 2]) -> f64 {
        self.ramp().reachable_mps(from_mps, (leg_m - ends[0].cut_m - ends[1].cut_m).max(0.0))
    }

    /// Time of a leg from the middle of the arc at its start to the middle of that at its end, s; the corners have their final speeds.
    pub fn leg_s(&self, leg_m: f64, ends: &[Corner; 2], limit_mps: f64) -> f64 {
        let arcs_s = (ends[0].duration_s(&self.dynamics) + ends[1].duration_s(&self.dynamics)) / 2.0;
        self.straight(leg_m, ends, limit_mps).duration_s() + arcs_s
    }

    /// The part of a leg between the arcs at its ends.
    pub fn straight(&self, leg_m: f64, ends: &[Corner; 2], limit_mps: f64) -> Straight {
        let length_m = (leg_m - ends[0].cut_m - ends[1].cut_m).max(0.0);
        Straight::new(length_m, ends.map(|corner| corner.speed_mps), limit_mps, self.ramp())
    }

    fn ramp(&self) -> Ramp {
        Ramp { acceleration_mps2: self.dynamics.acceleration_mps2, jerk_mps3: self.dynamics.jerk_mps3 }
    }
}

fn is_rest(entry_mps: &f64) -> bool {
    *entry_mps == 0.0
}

/// Time that yaw and gimbal need along the great circle between two view directions, s; nothing when that is less than `given_s`.
fn turning_s(first: &Unit<Vector3<f64>>, last: &Unit<Vector3<f64>>, dynamics: &DynamicsSettings, given_s: f64) -> f64 {
    let (gimbal_rad_s, yaw_rad_s) = (dynamics.gimbal_rate_dps.to_radians(), dynamics.yaw_rate_dps.to_radians());
    let normal = first.cross(last);
    let sin = normal.norm();
    let angle_rad = libm::atan2(sin, first.dot(last));
    let level = [first, last].map(|direction| (direction.x * direction.x + direction.y * direction.y).sqrt());
    if level[0].min(level[1]) < VERTICAL {
        // On a meridian only the pitch changes.
        return angle_rad / gimbal_rad_s;
    }
    // The yaw turns fastest where the circle is steepest; its steepest point has the height of its normal's horizontal part.
    let least_level = level[0].min(level[1]).min(normal.z.abs() / sin.max(1e-12));
    let bound_s = (angle_rad / gimbal_rad_s).max(angle_rad / (least_level.max(1e-12) * yaw_rad_s));
    if bound_s <= given_s { 0.0 } else { slowest_part_s(first, last, gimbal_rad_s, yaw_rad_s) }
}

/// The fastest part sets the pace, because the direction advances evenly along the leg.
fn slowest_part_s(first: &Unit<Vector3<f64>>, last: &Unit<Vector3<f64>>, gimbal_rad_s: f64, yaw_rad_s: f64) -> f64 {
    let mut before = *first;
    let mut most_s = 0.0f64;
    for part in 1..=TURN_PARTS {
        let after = slerp(first, last, f64::from(part) / f64::from(TURN_PARTS));
        let pitch_s = (pitch_rad(&after) - pitch_rad(&before)).abs() / gimbal_rad_s;
        let yaw_rad = yaw_rad(&before).zip(yaw_rad(&after)).map_or(0.0, |(before, after)| shorter_way_rad(after - before));
        most_s = most_s.max(pitch_s).max(yaw_rad / yaw_rad_s);
        before = after;
    }
    most_s * f64::from(TURN_PARTS)
}

/// Azimuth of a direction; none straight down or up.
fn yaw_rad(direction: &Unit<Vector3<f64>>) -> Option<f64> {
    (libm::hypot(direction.x, direction.y) > VERTICAL).then(|| libm::atan2(direction.x, direction.y))
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
    use proptest::prelude::*;

    use super::*;
    use crate::camera::direction_of;
    use crate::settings::Settings;

    proptest! {
        #[test]
        fn the_quick_look_at_a_turn_never_hides_a_slow_one(
            azimuths in prop::array::uniform2(-180.0..180.0f64), pitches in prop::array::uniform2(-90.0..30.0f64), given_s in 0.0..5.0f64,
        ) {
            let dynamics = Settings::default().dynamics;
            let [first, last] = [0, 1].map(|k| direction_of(azimuths[k], pitches[k]));
            let rates = [dynamics.gimbal_rate_dps, dynamics.yaw_rate_dps].map(f64::to_radians);
            let whole_s = slowest_part_s(&first, &last, rates[0], rates[1]);
            let quick_s = turning_s(&first, &last, &dynamics, given_s);
            // Straight down the angle is taken at once and not in parts: the same but for rounding.
            prop_assert!((quick_s - whole_s).abs() <= 1e-9 || quick_s == 0.0 && whole_s <= given_s * (1.0 + 1e-9), "{quick_s} s, but {whole_s} s");
        }
    }

    #[test]
    fn from_straight_down_only_the_pitch_changes() {
        let dynamics = DynamicsSettings { gimbal_rate_dps: 45.0, ..Settings::default().dynamics };
        let turn_s = turning_s(&direction_of(0.0, -90.0), &direction_of(120.0, 0.0), &dynamics, 0.0);
        assert!((turn_s - 2.0).abs() < 1e-9, "{turn_s}");
    }
}
