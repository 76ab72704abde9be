//! Forward overlap: how near to each other images have to be, and how slowly a flight has to cruise for that.

use super::{PlanError, PlanOptions};
use crate::camera::Rig;
use crate::field::Snapshot;
use crate::search::Wanted;
use crate::search::spacing::LEAST_SHARE;
use crate::settings::Settings;

/// A flight for images is no slower, m/s: at less it hovers rather than flies.
const LEAST_CRUISE_MPS: f64 = 0.5;
/// Images are no nearer to each other, m: no setting of their distance (`search.image_spacing_m`) is less either.
const LEAST_APART_M: f64 = 0.5;

/// The most that images may be apart for the overlap that is wanted, m, and settings with a cruise that leaves the shutter the time for it.
pub(super) fn with_overlap(
    settings: &Settings,
    snapshot: &Snapshot,
    rig: &Rig,
    options: &PlanOptions,
    wanted: &Wanted,
) -> Result<(Settings, Option<f64>), PlanError> {
    let mut settings = settings.clone();
    let Some(percent) = options.overlap_percent else { return Ok((settings, None)) };
    let footprint_m = footprint_m(rig, reference_m(snapshot, rig, wanted))?;
    let most_m = (1.0 - percent / 100.0) * footprint_m;
    if most_m < LEAST_APART_M {
        let least_m = LEAST_APART_M;
        return Err(PlanError::OverlapSpacing { percent, footprint_m, most_m, least_m });
    }
    let interval_s = rig.shutter_interval_s;
    let shutter_mps = LEAST_SHARE * most_m / interval_s;
    let cruise_mps = &mut settings.flight.cruise_speed_mps;
    if shutter_mps < *cruise_mps {
        if shutter_mps < LEAST_CRUISE_MPS {
            let least_mps = LEAST_CRUISE_MPS;
            return Err(PlanError::OverlapSpeed { percent, most_m, interval_s, cruise_mps: shutter_mps, least_mps });
        }
        *cruise_mps = shutter_mps;
    }
    Ok((settings, Some(most_m)))
}

/// The distance that surfaces are taken to be seen from, m: where an image has the wanted ground sampling distance, as far as views show
/// anything, or in the middle (as distances grow) between the nearest and the farthest view that there is.
fn reference_m(snapshot: &Snapshot, rig: &Rig, wanted: &Wanted) -> f64 {
    let sight_m = wanted.sight_m(rig, snapshot.disks.range_m());
    match wanted.gsd_m {
        Some(_) => sight_m,
        None => (snapshot.free.safety_distance_m * sight_m).sqrt(),
    }
}

/// What the shorter side of an image shows of a surface that is seen frontally from a distance, m; of several cameras the least.
fn footprint_m(rig: &Rig, distance_m: f64) -> Result<f64, PlanError> {
    let shorter = |camera: usize| {
        let [width, height] = rig.camera(camera).1?.half_tangents();
        Some(2.0 * width.min(height) * distance_m)
    };
    let least_m = (0..rig.camera_count()).map(shorter).try_fold(f64::INFINITY, |least_m, side_m| Some(least_m.min(side_m?)));
    least_m.ok_or_else(|| PlanError::NoFrame { rig: rig.name.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_footprint_is_that_of_the_shorter_side_and_of_the_smallest_image() {
        // Worked out by hand: 8.8 mm of sensor behind 8.8 mm of focal length.
        let phantom = Rig::preset("phantom4-rtk").unwrap();
        assert!((footprint_m(&phantom, 20.0).unwrap() - 20.0).abs() < 1e-9);
        // Upright it is the same image, turned.
        let upright = include_str!("../../config/rigs/phantom4-rtk.toml").replace("[13.2, 8.8]", "[8.8, 13.2]");
        assert!((footprint_m(&Rig::parse(&upright).unwrap(), 20.0).unwrap() - 20.0).abs() < 1e-9);
        // One of five lenses is twice as long: 15.6 mm behind 70 mm instead of 35.
        let oblique = include_str!("../../config/rigs/m300-oblique.toml");
        let longer = oblique.replacen("focal_mm = 35.0", "focal_mm = 70.0", 1);
        for (text, expected_m) in [(oblique, 30.0 * 15.6 / 35.0), (&longer, 30.0 * 15.6 / 70.0)] {
            let found_m = footprint_m(&Rig::parse(text).unwrap(), 30.0).unwrap();
            assert!((found_m - expected_m).abs() < 1e-9, "{found_m} m, not {expected_m} m");
        }
        assert!(matches!(footprint_m(&Rig::preset("panoramic").unwrap(), 20.0), Err(PlanError::NoFrame { .. })));
    }
}
