//! The timed curve as a list of instants, for whoever flies it.

use nalgebra::{Point3, Vector3};

use super::profile::Profile;

/// Where the drone is at an instant, and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    pub time_s: f64,
    pub position_m: Point3<f64>,
    pub velocity_mps: Vector3<f64>,
}

/// The straight line between two samples passes the curve at most this far away at any instant, m.
pub const TOLERANCE_M: f64 = 0.05;
/// Shorter pieces are not told apart, s.
const LEAST_PIECE_S: f64 = 1e-6;
/// Samples in one piece at most.
const MOST_IN_PIECE: f64 = 10_000.0;

/// Samples from the start to the end of the flight: at each change of its course, that is where an arc, a stop, speeding up, cruising or slowing
/// down begins, and as many in between that interpolating linearly in time errs by no more than [`TOLERANCE_M`]. Where the acceleration is at
/// most a, that takes one every sqrt(8 tolerance / a); none while cruising straight on.
pub fn samples(profile: &Profile) -> Vec<Sample> {
    let mut times_s = vec![0.0];
    for piece in profile.pieces() {
        let duration_s = piece.end_s - piece.start_s;
        if duration_s < LEAST_PIECE_S {
            continue;
        }
        let parts = (duration_s * (piece.acceleration_mps2 / (8.0 * TOLERANCE_M)).sqrt()).ceil().clamp(1.0, MOST_IN_PIECE) as u32;
        times_s.extend((1..parts).map(|part| piece.start_s + duration_s * f64::from(part) / f64::from(parts)));
        times_s.push(piece.end_s);
    }
    let at = |time_s: f64| profile.at(time_s).map(|passage| (time_s, passage));
    let passages = times_s.into_iter().filter_map(at);
    passages
        .map(|(time_s, passage)| Sample { time_s, position_m: passage.position_m, velocity_mps: passage.velocity_mps })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{Pose, Rig};
    use crate::settings::Settings;

    proptest! {
        #[test]
        fn between_samples_the_drone_is_where_a_straight_line_says(
            corners in prop::collection::vec([-60.0..60.0f64, -60.0..60.0, 5.0..60.0], 1..8), rig in 0usize..3,
        ) {
            let Settings { flight, dynamics, .. } = Settings::default();
            let path: Vec<Pose> = corners.iter().map(|&p| Pose { position: p.into(), direction: None }).collect();
            let rig = Rig::preset(["panoramic", "m300-oblique", "phantom4-rtk"][rig]).unwrap();
            let profile = Profile::new(&path, &rig, &flight, &dynamics);
            let samples = samples(&profile);
            prop_assert_eq!(samples[0].position_m, path[0].position);
            prop_assert!((samples[samples.len() - 1].position_m - path[path.len() - 1].position).norm() < 1e-6);
            prop_assert!((samples[samples.len() - 1].time_s - profile.duration_s()).abs() < 1e-6);
            for pair in samples.windows(2) {
                prop_assert!(pair[1].time_s > pair[0].time_s);
                for step in 0..=10 {
                    let share = f64::from(step) / 10.0;
                    let time_s = pair[0].time_s + (pair[1].time_s - pair[0].time_s) * share;
                    let between = pair[0].position_m + (pair[1].position_m - pair[0].position_m) * share;
                    let off_m = (profile.at(time_s).unwrap().position_m - between).norm();
                    prop_assert!(off_m < TOLERANCE_M * 1.001, "{} m at {} s", off_m, time_s);
                }
            }
        }
    }
}
