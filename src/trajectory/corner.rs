//! Corners: the arc that rounds one, and the speed on it.

use nalgebra::Vector3;

use crate::search::leg::angle_rad;
use crate::settings::DynamicsSettings;

/// A corner with the largest arc that keeps near it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Corner {
    /// How far the path turns, rad.
    pub deviation_rad: f64,
    /// Of the arc, m; 0 where the drone stops and turns on the spot.
    pub radius_m: f64,
    /// What the arc cuts off each of the two legs, m.
    pub cut_m: f64,
    /// How far the nose turns where the cameras are bolted to the airframe, rad.
    pub yaw_rad: f64,
    /// Speed on the arc.
    pub speed_mps: f64,
}

/// A corner with a smaller arc is flown at rest, m.
const LEAST_RADIUS_M: f64 = 1e-3;

impl Corner {
    /// The corner between two legs with an arc that keeps within `deviation_m` of it; its speed is that of a boundless drone until
    /// [`Corner::limited`] says otherwise.
    pub fn new(before: &Vector3<f64>, after: &Vector3<f64>, deviation_m: f64) -> Self {
        let deviation_rad = angle_rad(before, after);
        let (sin_half, cos_half) = libm::sincos(deviation_rad / 2.0);
        // The arc touches both legs and its middle lies `deviation_m` from the corner; it may take half of the shorter leg.
        let nearest_m = deviation_m * cos_half / (1.0 - cos_half).max(1e-12);
        let fitting_m = before.norm().min(after.norm()) / 2.0 * cos_half / sin_half.max(1e-12);
        let radius_m = nearest_m.min(fitting_m).max(0.0);
        if radius_m < LEAST_RADIUS_M {
            return Self { deviation_rad, ..Self::default() };
        }
        let cut_m = radius_m * sin_half / cos_half.max(1e-12);
        Self { deviation_rad, radius_m, cut_m, yaw_rad: 0.0, speed_mps: f64::INFINITY }
    }

    /// The corner flown within the limits: across the path, of the nose that turns by `yaw_rad` on it, and of the legs.
    pub fn limited(self, yaw_rad: f64, limit_mps: f64, dynamics: &DynamicsSettings) -> Self {
        if self.is_stop() {
            return Self { yaw_rad, speed_mps: 0.0, ..self };
        }
        let lateral_mps = (dynamics.lateral_mps2 * self.radius_m).sqrt();
        let yaw_mps = if yaw_rad > 0.0 { self.arc_m() * dynamics.yaw_rate_dps.to_radians() / yaw_rad } else { f64::INFINITY };
        Self { yaw_rad, speed_mps: limit_mps.min(lateral_mps).min(yaw_mps), ..self }
    }

    /// The same corner, passed at another speed.
    pub fn at_mps(self, speed_mps: f64) -> Self {
        Self { speed_mps, ..self }
    }

    /// Whether the drone comes to rest at the corner.
    pub fn is_stop(&self) -> bool {
        self.radius_m == 0.0
    }

    /// Acceleration towards the centre of the arc, m/s^2; none at rest.
    pub fn lateral_mps2(&self) -> f64 {
        if self.is_stop() { 0.0 } else { self.speed_mps * self.speed_mps / self.radius_m }
    }

    /// Length of the arc, m.
    pub fn arc_m(&self) -> f64 {
        self.radius_m * self.deviation_rad
    }

    /// Time on the arc; at rest that of turning the nose, s.
    pub fn duration_s(&self, dynamics: &DynamicsSettings) -> f64 {
        if self.speed_mps > 0.0 { self.arc_m() / self.speed_mps } else { self.yaw_rad / dynamics.yaw_rate_dps.to_radians() }
    }
}
