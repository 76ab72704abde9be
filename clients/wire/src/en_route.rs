//! What an aircraft in the air tells of itself.

use serde::{Deserialize, Serialize};

use crate::message::{MAX_COORDINATE_M, MAX_SECONDS, Refusal, RefusalCode};

/// Fastest aircraft that plans are made for, m/s.
pub const MAX_SPEED_MPS: f64 = 50.0;

/// Where an aircraft is on its flight, and what it has done of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FlightReport {
    /// The plan that it flies, by its epoch; 0 for the one that the daemon published last.
    pub epoch: u64,
    /// So many images of that plan were taken, from its first one on. Images of plans that it flew before stay taken.
    pub images_taken: u64,
    /// Where it is, m in the local frame, and how it moves, m/s.
    pub position_m: [f64; 3],
    pub velocity_mps: [f64; 3],
    /// Where a camera on a gimbal looks: azimuth clockwise from north and pitch up from the horizon, degrees; `None` for a rig without one, or to let the
    /// planner choose.
    pub view_deg: Option<[f64; 2]>,
    /// The flight has to end within this time, s; `None` for as long as it takes.
    pub time_left_s: Option<f64>,
    /// Where it has to end, m in the local frame, a place as safe as any other; `None` for anywhere.
    pub landing_m: Option<[f64; 3]>,
}

impl FlightReport {
    /// Judges the values; the error says what is wrong and what is allowed.
    pub fn check(&self) -> Result<(), Refusal> {
        let places = [("position", Some(self.position_m)), ("landing place", self.landing_m)];
        for (what, place) in places.into_iter().filter_map(|(what, place)| Some((what, place?))) {
            if !place.iter().all(|value| value.abs() <= MAX_COORDINATE_M) {
                return invalid(format!(
                    "the {what} of the aircraft is {place:?}; give finite metres of at most {MAX_COORDINATE_M} in the scene's local frame"
                ));
            }
        }
        let [x, y, z] = self.velocity_mps;
        let speed_mps = x.hypot(y).hypot(z);
        if !speed_mps.is_finite() || speed_mps > MAX_SPEED_MPS {
            return invalid(format!("the aircraft flies at {speed_mps} m/s; give a velocity of at most {MAX_SPEED_MPS} m/s"));
        }
        if let Some([azimuth_deg, pitch_deg]) = self.view_deg
            && !(azimuth_deg.abs() <= 360.0 && pitch_deg.abs() <= 90.0)
        {
            return invalid(format!("the camera looks to {azimuth_deg}, {pitch_deg}; give -360 to 360 and -90 to 90 degrees"));
        }
        match self.time_left_s {
            Some(left_s) if !(left_s > 0.0 && left_s <= MAX_SECONDS) => {
                invalid(format!("{left_s} s are left; give more than 0 and at most {MAX_SECONDS} s"))
            }
            _ => Ok(()),
        }
    }
}

fn invalid(message: String) -> Result<(), Refusal> {
    Err(Refusal::new(RefusalCode::Invalid, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_that_make_no_sense_are_refused() {
        let report = FlightReport { velocity_mps: [3.0, 4.0, 0.0], ..FlightReport::default() };
        assert_eq!(report.check(), Ok(()));
        let faults = [
            FlightReport { position_m: [0.0, f64::NAN, 5.0], ..report.clone() },
            FlightReport { position_m: [1e9, 0.0, 5.0], ..report.clone() },
            FlightReport { velocity_mps: [50.0, 1.0, 0.0], ..report.clone() },
            FlightReport { velocity_mps: [f64::NAN, 0.0, 0.0], ..report.clone() },
            FlightReport { velocity_mps: [f64::INFINITY, 0.0, 0.0], ..report.clone() },
            FlightReport { view_deg: Some([0.0, 91.0]), ..report.clone() },
            FlightReport { view_deg: Some([f64::NAN, 0.0]), ..report.clone() },
            FlightReport { time_left_s: Some(0.0), ..report.clone() },
            FlightReport { time_left_s: Some(f64::NAN), ..report.clone() },
            FlightReport { landing_m: Some([0.0, 0.0, f64::INFINITY]), ..report },
        ];
        for fault in faults {
            assert_eq!(fault.check().unwrap_err().code, RefusalCode::Invalid, "{fault:?}");
        }
    }
}
