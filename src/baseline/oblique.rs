//! Oblique photography: serpentine lines at one height above all buildings, as commercial software flies them (sections 6.2 and 6.3).
//!
//! Lines run along the longer side of the box around the structures. Their distance and that of the images follow from the footprint of an image
//! on the ground and from the overlaps. Five cameras bolted to the drone see everything in one pass over an area that is wider than the scene, so
//! that the oblique ones see the outer walls of its border. A single camera on a gimbal flies five passes, one looking down and four looking
//! obliquely along and across the lines, each over the area from which its images fall on the scene. A rig that sees in all directions flies one
//! pass, as a camera of 13.2 by 8.8 mm would.

use nalgebra::{Point3, Unit, Vector3};

use super::assembly::Assembly;
use super::shots::within_reach;
use super::{BaselineError, Reporter, found};
use crate::camera::{Cameras, Intrinsics, Rig, direction_of, pitch_rad};
use crate::search::{Problem, Progress};
use crate::settings::BaselineSettings;
use crate::stop::StopToken;
use crate::trajectory::route::Found;

/// The camera that stands for a rig that sees in all directions.
const STAND_IN: Intrinsics = Intrinsics { focal_mm: 8.8, sensor_mm: [13.2, 8.8], pixels: [5472, 3648] };

/// Pitch of the oblique passes, degrees.
const OBLIQUE_DEG: f64 = -45.0;

/// An image's upper edge counts as no flatter than this below the horizon, degrees: a footprint up to the horizon has no end.
const FLATTEST_DEG: f64 = 10.0;

/// Room above the safety distance, and the least height, where the height is chosen, m: the paper flew at 50 and 70 m.
const HEADROOM_M: f64 = 5.0;
const LEAST_HEIGHT_M: f64 = 50.0;

const MOST_IMAGES: usize = 200_000;

/// The rig with the focal length of oblique photography on its own sensors; unchanged when the setting is 0.
pub fn adapted_rig(rig: &Rig, settings: &BaselineSettings) -> Rig {
    let mut adapted = rig.clone();
    if settings.op_focal_mm == 0.0 {
        return adapted;
    }
    let mut blur_share = f64::INFINITY;
    let mut change = |intrinsics: &mut Intrinsics| {
        blur_share = blur_share.min(intrinsics.focal_mm / settings.op_focal_mm);
        intrinsics.focal_mm = settings.op_focal_mm;
    };
    match &mut adapted.cameras {
        Cameras::Panoramic { .. } => return adapted,
        Cameras::Gimbal { intrinsics, .. } => change(intrinsics),
        Cameras::Rigid(mounts) => mounts.iter_mut().for_each(|mount| change(&mut mount.intrinsics)),
    }
    // The same blur in pixels is a smaller angle behind a longer lens.
    adapted.blur_limit_rad_s *= blur_share;
    adapted
}

/// A rectangle on the ground plane, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Area {
    min: [f64; 2],
    max: [f64; 2],
}

/// One serpentine.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pass {
    area: Area,
    /// Size of an image on the ground along and across the lines, m.
    footprint_m: [f64; 2],
    /// The camera's direction; `None` where it has none of its own.
    look: Option<Unit<Vector3<f64>>>,
}

/// Plans a flight. The problem's rig is the adapted one. A stop ends it after the legs made so far.
pub fn fly(
    problem: &Problem,
    settings: &BaselineSettings,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Found, BaselineError> {
    let mut report = Reporter::new(on_progress);
    report.tell(0);
    let height_m = height_m(problem, settings)?;
    let facts = &problem.field.facts;
    let scene = Area { min: [facts.min_m[0], facts.min_m[1]], max: [facts.max_m[0], facts.max_m[1]] };
    let axis = usize::from(scene.max[1] - scene.min[1] > scene.max[0] - scene.min[0]);
    let passes = passes(problem, settings, &scene, axis, height_m);
    let spacing_m = |footprint_m: f64, overlap: f64| (footprint_m * (1.0 - overlap)).max(problem.spacing.least_leg_m);
    let [along, across] = [settings.op_forward_overlap, settings.op_side_overlap];
    let planned: Vec<(Pass, [f64; 2])> = passes
        .into_iter()
        .map(|pass| (pass, [spacing_m(pass.footprint_m[0], along), spacing_m(pass.footprint_m[1], across)]))
        .collect();
    check_number(problem, &planned, axis)?;

    let mut assembly = Assembly::new(problem, height_m);
    for (number, (pass, spacings_m)) in planned.iter().enumerate() {
        let mut lines = serpentine(&pass.area, axis, pass.footprint_m[1], *spacings_m, problem.spacing.least_leg_m, height_m);
        turn_towards(&mut lines, assembly.route.waypoints.last().map(|pose| pose.position));
        for line in lines {
            // Even a stopped flight has a line.
            if stop.is_stopped() && !assembly.route.exposures.is_empty() {
                break;
            }
            assembly.fly_line(&line, pass.look);
        }
        report.last.length_m = problem.objective.travel(&assembly.route.waypoints).length_m;
        report.tell_views(
            20 * (number as u32 + 1) * 5 / planned.len() as u32,
            problem,
            assembly.route.exposures.iter().map(|e| &e.pose),
        );
    }
    if assembly.route.exposures.is_empty() {
        return Err(BaselineError::NoView { method: "op" });
    }
    found(assembly.route, stop)
}

/// The height that the settings give, or the lowest one with some room above the tallest structure, m above the ground.
fn height_m(problem: &Problem, settings: &BaselineSettings) -> Result<f64, BaselineError> {
    let tallest_m = problem.field.facts.max_m[2];
    let limits = &problem.free.limits;
    // A little more than the safety distance: at exactly this distance rounding decides.
    let least_m = (tallest_m + problem.free.safety_distance_m + 0.01).max(limits.min.z);
    let most_m = limits.max.z;
    if least_m > most_m {
        return Err(BaselineError::NoHeight { needed_m: least_m, tallest_m, ceiling_m: most_m });
    }
    let given_m = settings.op_height_m;
    if given_m == 0.0 {
        return Ok((least_m + HEADROOM_M).max(LEAST_HEIGHT_M).min(most_m));
    }
    if !(least_m..=most_m).contains(&given_m) {
        return Err(BaselineError::Height { height_m: given_m, least_m, most_m });
    }
    Ok(given_m)
}

/// Size of an image on the ground for a camera at a pitch below the horizon: at right angles to its azimuth in the middle of the image, and
/// along it between the image's edges, m.
fn footprint_m(intrinsics: &Intrinsics, pitch_rad: f64, height_m: f64) -> [f64; 2] {
    let [right, up] = intrinsics.half_tangents();
    let below_rad = -pitch_rad;
    let half_rad = libm::atan(up);
    let flattest_rad = FLATTEST_DEG.to_radians();
    let reach_m = |angle_rad: f64| height_m * libm::cos(angle_rad) / libm::sin(angle_rad);
    let (near_rad, far_rad) = ((below_rad + half_rad).max(flattest_rad), (below_rad - half_rad).max(flattest_rad));
    let width_m = 2.0 * right * height_m / libm::sin(below_rad.max(flattest_rad));
    [width_m, reach_m(far_rad) - reach_m(near_rad)]
}

fn passes(problem: &Problem, settings: &BaselineSettings, scene: &Area, axis: usize, height_m: f64) -> Vec<Pass> {
    let limits = &problem.free.limits;
    let within = |area: Area| Area {
        min: [area.min[0].max(limits.min.x), area.min[1].max(limits.min.y)],
        max: [area.max[0].min(limits.max.x), area.max[1].min(limits.max.y)],
    };
    let wider = |by_m: f64| within(Area { min: scene.min.map(|v| v - by_m), max: scene.max.map(|v| v + by_m) });
    let straight_down = -std::f64::consts::FRAC_PI_2;
    match &problem.rig.cameras {
        Cameras::Panoramic { .. } => {
            let focal_mm = if settings.op_focal_mm == 0.0 { STAND_IN.focal_mm } else { settings.op_focal_mm };
            let [across, along] = footprint_m(&Intrinsics { focal_mm, ..STAND_IN }, straight_down, height_m);
            vec![Pass { area: wider(height_m), footprint_m: [along, across], look: None }]
        }
        Cameras::Rigid(mounts) => {
            // The camera that looks down most steeply sets the distances: it alone sees the roofs frontally.
            let lowest = mounts.iter().min_by(|a, b| a.pitch_deg.total_cmp(&b.pitch_deg));
            let footprint =
                lowest.map_or([0.0; 2], |mount| footprint_m(&mount.intrinsics, mount.pitch_deg.to_radians(), height_m));
            vec![Pass { area: wider(height_m), footprint_m: [footprint[1], footprint[0]], look: None }]
        }
        Cameras::Gimbal { intrinsics, .. } => {
            let looking = |direction: Unit<Vector3<f64>>| {
                let look = within_reach(&problem.rig, &direction);
                let pitch = pitch_rad(&look);
                let [width_m, depth_m] = footprint_m(intrinsics, pitch, height_m);
                // The image's width lies east and west when the camera looks down, north or south.
                let is_level_axis_x = look.x.abs() < 0.5 * libm::hypot(look.x, look.y) || libm::hypot(look.x, look.y) < 1e-6;
                let by_axis = if is_level_axis_x { [width_m, depth_m] } else { [depth_m, width_m] };
                let ahead_m = height_m * libm::hypot(look.x, look.y) / (-look.z).max(libm::sin(FLATTEST_DEG.to_radians()));
                let ahead = Vector3::new(look.x, look.y, 0.0).try_normalize(1e-9).unwrap_or_default() * ahead_m;
                let behind = |v: [f64; 2]| [v[0] - ahead.x, v[1] - ahead.y];
                let area = within(Area { min: behind(scene.min), max: behind(scene.max) });
                Pass { area, footprint_m: [by_axis[axis], by_axis[1 - axis]], look: Some(look) }
            };
            let oblique = [0.0, 90.0, 180.0, 270.0].map(|azimuth_deg| direction_of(azimuth_deg, OBLIQUE_DEG));
            std::iter::once(-Vector3::z_axis()).chain(oblique).map(looking).collect()
        }
    }
}

/// Where along `width_m` the lines lie so that their footprints cover it: no farther apart than `spacing_m`, none beyond the border.
fn offsets_m(width_m: f64, footprint_m: f64, spacing_m: f64) -> Vec<f64> {
    if width_m <= footprint_m {
        return vec![width_m / 2.0];
    }
    let gaps = ((width_m - footprint_m) / spacing_m).ceil().max(1.0);
    (0..=gaps as usize).map(|k| footprint_m / 2.0 + (width_m - footprint_m) * (k as f64 / gaps)).collect()
}

/// Number of images on a line: no farther apart than wanted, unless they would be nearer than they may be.
fn images_of(length_m: f64, spacing_m: f64, least_m: f64) -> usize {
    let gaps = (length_m / spacing_m).ceil().min((length_m / least_m).floor()).max(0.0);
    gaps as usize + 1
}

/// The lines of a pass, each with the positions of its images, flown to and fro.
fn serpentine(
    area: &Area,
    axis: usize,
    across_m: f64,
    spacings_m: [f64; 2],
    least_m: f64,
    height_m: f64,
) -> Vec<Vec<Point3<f64>>> {
    let other = 1 - axis;
    let length_m = (area.max[axis] - area.min[axis]).max(0.0);
    let images = images_of(length_m, spacings_m[0], least_m);
    let line = |(number, offset_m): (usize, f64)| {
        let position = |k: usize| {
            let mut place = [0.0; 2];
            let k = if number % 2 == 0 { k } else { images - 1 - k };
            place[axis] = area.min[axis] + if images == 1 { length_m / 2.0 } else { length_m * (k as f64 / (images - 1) as f64) };
            place[other] = area.min[other] + offset_m;
            Point3::new(place[0], place[1], height_m)
        };
        (0..images).map(position).collect()
    };
    let width_m = (area.max[other] - area.min[other]).max(0.0);
    // A footprint much smaller than the distance of lines that the shutter allows still has its lines at the borders.
    offsets_m(width_m, across_m, spacings_m[1]).into_iter().enumerate().map(line).collect()
}

/// Of the four ways to fly a serpentine the one that begins nearest to where the drone is.
fn turn_towards(lines: &mut [Vec<Point3<f64>>], from: Option<Point3<f64>>) {
    let (Some(from), false) = (from, lines.is_empty()) else { return };
    let distance_m = |p: Option<&Point3<f64>>| p.map_or(f64::INFINITY, |p| (p - from).norm());
    let (first, last) = (&lines[0], &lines[lines.len() - 1]);
    let starts = [first.first(), first.last(), last.first(), last.last()].map(distance_m);
    let best = (0..4).min_by(|&a, &b| starts[a].total_cmp(&starts[b])).unwrap_or(0);
    if best >= 2 {
        lines.reverse();
    }
    if best % 2 == 1 {
        lines.iter_mut().for_each(|line| line.reverse());
    }
}

fn check_number(problem: &Problem, planned: &[(Pass, [f64; 2])], axis: usize) -> Result<(), BaselineError> {
    let number = |(pass, [along_m, across_m]): &(Pass, [f64; 2])| {
        let sides = [0, 1].map(|i| (pass.area.max[i] - pass.area.min[i]).max(0.0));
        (sides[axis] / along_m + 1.0) * (sides[1 - axis] / across_m + 2.0)
    };
    let images = planned.iter().map(number).sum::<f64>() * problem.rig.camera_count() as f64;
    if images > MOST_IMAGES as f64 { Err(BaselineError::TooManyImages { images, most: MOST_IMAGES }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn footprints_are_those_computed_by_hand() {
        let camera = Intrinsics { focal_mm: 30.0, sensor_mm: [24.0, 18.0], pixels: [4000, 3000] };
        let close = |found: [f64; 2], expected: [f64; 2]| (0..2).all(|i| (found[i] - expected[i]).abs() < 1e-3);
        // Straight down from 50 m: 2 * 50 * 12/30 = 40 m by 2 * 50 * 9/30 = 30 m.
        let down = footprint_m(&camera, -std::f64::consts::FRAC_PI_2, 50.0);
        assert!(close(down, [40.0, 30.0]), "{down:?}");
        // At 45 degrees: the middle is 50 sqrt 2 m away, so 40 sqrt 2 m wide. The edges lie 45 -+ atan 0.3 degrees below the horizon, whose
        // cotangents are (1 +- 0.3)/(1 -+ 0.3): 50 (1.857143 - 0.538462) m deep.
        let oblique = footprint_m(&camera, -std::f64::consts::FRAC_PI_4, 50.0);
        assert!(close(oblique, [56.56854, 65.93407]), "{oblique:?}");
    }

    #[test]
    fn lines_and_images_have_the_number_and_the_distance_computed_by_hand() {
        // 100 m wide, 40 m footprint, 15 % overlap: 34 m. (100 - 40)/34 = 1.76, so 2 gaps of 30 m, the outer footprints end at the border.
        assert_eq!(offsets_m(100.0, 40.0, 34.0), [20.0, 50.0, 80.0]);
        assert_eq!(offsets_m(108.0, 40.0, 34.0), [20.0, 54.0, 88.0]);
        assert_eq!(offsets_m(39.0, 40.0, 34.0), [19.5]);
        // 100 m at most 12 m apart: 9 gaps. At most 8.5 m, at least 8 m apart: 12 gaps of 8.33 m fit.
        assert_eq!(images_of(100.0, 12.0, 8.0), 10);
        assert_eq!(images_of(100.0, 8.5, 8.0), 13);
        // At most 8 m apart would be 13 gaps of 7.7 m: too near, so 12.
        assert_eq!(images_of(100.0, 8.0, 8.0), 13);
        assert_eq!(images_of(5.0, 8.0, 8.0), 1);
        let area = Area { min: [-50.0, 0.0], max: [50.0, 100.0] };
        let lines = serpentine(&area, 0, 40.0, [25.0, 34.0], 8.0, 60.0);
        let ends: Vec<_> = lines.iter().map(|line| (line.len(), line[0], line[4])).collect();
        let p = |x: f64, y: f64| Point3::new(x, y, 60.0);
        assert_eq!(ends, [(5, p(-50., 20.), p(50., 20.)), (5, p(50., 50.), p(-50., 50.)), (5, p(-50., 80.), p(50., 80.))]);
    }

    #[test]
    fn the_adapted_rig_has_the_field_of_view_of_its_new_lens() {
        let settings = Settings::default().baseline;
        let phantom = adapted_rig(&Rig::preset("phantom4-rtk").unwrap(), &settings);
        let fov_deg = phantom.camera(0).1.unwrap().fov_deg();
        // 2 atan(6.6/30) and 2 atan(4.4/30).
        assert!((fov_deg[0] - 24.8148).abs() < 1e-3 && (fov_deg[1] - 16.6878).abs() < 1e-3, "{fov_deg:?}");
        let own = BaselineSettings { op_focal_mm: 0.0, ..settings };
        assert_eq!(adapted_rig(&phantom, &own), phantom);
    }
}
