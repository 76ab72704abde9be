//! Predicted quality: what the images see against brute force, geometry that is known by hand, and the same on any number of threads.

mod block;
mod support;

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};
use overfly::camera::direction_of;
use overfly::coverage::{DiskModel, SampleFrame, reconstructability_percent};
use overfly::frame::{Geodetic, LocalFrame};
use overfly::mission::{plan_json, plan_read};
use overfly::planner::{StopToken, plan};
use overfly::quality::{self, Misplaced, Quality, Shot, Truth, Which};
use overfly::scene::{Scene, Shape, Structure, StructureId};
use overfly::settings::Settings;
use overfly::trajectory::plan::{Image, Plan};
use overfly_table::FieldTable;
use proptest::prelude::*;
use support::{crosses, rig_options, session, small_block, small_settings, snapshot};

fn settings(samples: u32) -> Settings {
    let mut settings = small_settings();
    settings.quality.samples = samples;
    settings
}

fn truth(scene: Scene, settings: &Settings) -> Truth {
    Truth::new(scene, settings, &StopToken::default()).expect("the scene has a surface")
}

fn assess(truth: &Truth, shots: &[Shot], settings: &Settings) -> Quality {
    quality::assess(truth, shots, settings, &StopToken::default()).expect("nobody stops it")
}

fn panorama(position: [f64; 3]) -> Shot {
    let image = Image {
        position_m: position.into(),
        direction: None,
        up: Vector3::z(),
        fov_deg: None,
        camera: 0,
        time_s: 0.0,
        selected: true,
    };
    Shot { image, pixel_rad: 3e-4 }
}

/// An upright image; wider than high.
fn picture(position: [f64; 3], azimuth_deg: f64, pitch_deg: f64) -> Shot {
    let direction = direction_of(azimuth_deg, pitch_deg);
    let right = direction.cross(&Vector3::z()).normalize();
    let mut shot = panorama(position);
    shot.image.direction = Some(direction);
    shot.image.up = right.cross(&direction);
    shot.image.fov_deg = Some([70.0, 50.0]);
    shot
}

/// A slab of 40 m by 40 m around the origin.
fn slab(top_m: f64) -> Scene {
    let ring = geo::LineString::from(vec![(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0), (-20.0, -20.0)]);
    let footprint = geo::MultiPolygon::new(vec![geo::Polygon::new(ring, vec![])]);
    let shape = Shape::Prism { footprint, base_m: 0.0, top_m };
    let structure = Structure { id: StructureId::of_name("slab"), name: "slab".to_owned(), shape };
    Scene { name: "slab".to_owned(), frame: LocalFrame::default(), structures: vec![Arc::new(structure)], zones: vec![] }
}

fn small_plan(rig: &str) -> (Plan, Settings) {
    let settings = settings(500);
    let snapshot = snapshot(&session(small_block(8), &settings));
    let plan = plan(&snapshot, &settings, &rig_options(rig, 3, 80), &StopToken::default(), &mut |_| {}).unwrap();
    (plan, settings)
}

#[test]
fn views_are_those_that_a_ray_against_every_triangle_finds() {
    let settings = settings(400);
    let scene = small_block(5);
    let triangles: Vec<_> = scene.structures.iter().flat_map(|structure| structure.triangles()).collect();
    let truth = truth(scene, &settings);
    let mut shots = Vec::new();
    for k in 0..40 {
        let at = |key: u64| block::chance(key * 40 + k) - 0.5;
        let position = [160.0 * at(0), 160.0 * at(1), 25.0 + 40.0 * at(2)];
        let shot = if k % 3 == 0 { panorama(position) } else { picture(position, 360.0 * at(3), -35.0 + 60.0 * at(4)) };
        shots.push(shot);
    }
    let quality = assess(&truth, &shots, &settings);
    let disks = DiskModel::new(&settings.coverage);
    let (mut total, mut partly) = (0, 0);
    for (sample, found) in truth.samples().iter().zip(&quality.samples) {
        let frame = &sample.frame;
        let end = frame.position + frame.normal * settings.surface.exposure_offset_m;
        let sees = |shot: &&Shot| {
            let to_view: Vector3<f64> = shot.image.position_m - frame.position;
            let distance_m = to_view.norm();
            distance_m <= settings.coverage.range_m
                && (to_view / distance_m).dot(&frame.normal) >= settings.coverage.max_incidence_deg.to_radians().cos()
                && is_framed(&shot.image, &frame.position)
                && !triangles.iter().any(|triangle| crosses(&shot.image.position_m, &end, triangle))
        };
        let seen: Vec<&Shot> = shots.iter().filter(sees).collect();
        assert_eq!(found.views as usize, seen.len(), "{:?}", frame.position);
        let directions: Vec<_> = seen.iter().map(|shot| (shot.image.position_m - frame.position).normalize()).collect();
        let angle = |a: &Vector3<f64>, b: &Vector3<f64>| a.cross(b).norm().atan2(a.dot(b));
        let angles = |i: usize| directions.iter().enumerate().filter(move |(j, _)| *j != i).map(move |(_, other)| other);
        let largest = (0..directions.len()).flat_map(|i| angles(i).map(move |other| (i, other)));
        let largest = largest.map(|(i, other)| angle(&directions[i], other)).fold(0.0, f64::max);
        assert!((found.parallax_rad - largest).abs() < 1e-7);
        let matches = |i: &usize| angles(*i).any(|other| (5.0..=45.0).contains(&angle(&directions[*i], other).to_degrees()));
        let matched = (0..directions.len()).filter(matches).count();
        assert_eq!((found.matched_views as usize, found.deviation.is_some()), (matched, matched >= 3));
        let gsd_m = seen.iter().map(|shot| 3e-4 * (shot.image.position_m - frame.position).norm()).fold(f64::INFINITY, f64::min);
        assert_eq!(found.gsd_m.is_some(), !seen.is_empty());
        assert!(found.gsd_m.is_none_or(|found| (found - gsd_m).abs() < 1e-12));
        let cells = seen.iter().fold(0, |mask, shot| mask | disks.exact_mask(frame, &shot.image.position_m));
        assert!((found.covered.reconstructability_percent() - reconstructability_percent(cells)).abs() < 5.0);
        total += seen.len();
        partly += usize::from(matched > 0 && matched < seen.len());
    }
    assert!(total > 500 && partly > 0, "{total} views, {partly} samples with some views matched");
}

/// Angles in the image, by arc tangents: written differently from the frustum's own test.
fn is_framed(image: &Image, target: &Point3<f64>) -> bool {
    let (Some(direction), Some([width_deg, height_deg])) = (image.direction, image.fov_deg) else { return true };
    let to_target = target - image.position_m;
    let right = direction.cross(&image.up);
    let (depth, across, upward) = (to_target.dot(&direction), to_target.dot(&right), to_target.dot(&image.up));
    let within = |side: f64, fov_deg: f64| side.atan2(depth).abs() <= (fov_deg / 2.0).to_radians();
    depth > 0.0 && within(across, width_deg) && within(upward, height_deg)
}

#[test]
fn two_panoramas_over_a_roof_fix_it_as_well_as_the_normal_case_says() {
    let mut settings = settings(2000);
    settings.quality.least_views = 2;
    let truth = truth(slab(10.0), &settings);
    // 30 m over the roof, 20 m apart: a parallax of 36.9 degrees below the middle, within the limits of matching.
    let shots = [panorama([-10.0, 0.0, 40.0]), panorama([10.0, 0.0, 40.0])];
    let quality = assess(&truth, &shots, &settings);
    let middle = |sample: &SampleFrame| sample.normal.z > 0.9 && sample.position.coords.xy().norm() < 1.0;
    let i = truth.samples().iter().position(|sample| middle(&sample.frame)).expect("a sample in the middle of the roof");
    let found = &quality.samples[i];
    assert_eq!((found.views, found.matched_views), (2, 2));
    assert!((found.parallax_rad.to_degrees() - 36.87).abs() < 0.2, "{}", found.parallax_rad.to_degrees());
    // sigma_z = spread / (sqrt 2 sin a) = 0.5 * 3e-4 * 31.62 / (1.414 * 0.3162) = 10.6 mm; off the middle by a few per cent.
    let deviation = found.deviation.unwrap();
    assert!((deviation.normal_m - 0.010_607).abs() < 0.000_3, "{deviation:?}");
    assert!((found.gsd_m.unwrap() - 3e-4 * 31.62).abs() < 3e-4, "{:?}", found.gsd_m);
    // A third view is asked for by default, and these are only two.
    settings.quality.least_views = 3;
    assert_eq!(assess(&truth, &shots, &settings).summary().reconstructed_percent, 0.0);
}

#[test]
fn a_roof_under_one_frontal_view_has_the_r_of_its_disk() {
    let settings = settings(2000);
    let truth = truth(slab(10.0), &settings);
    let quality = assess(&truth, &[panorama([0.0, 0.0, 40.0])], &settings);
    let below = |sample: &SampleFrame| sample.normal.z > 0.9 && sample.position.coords.xy().norm() < 1.0;
    let i = truth.samples().iter().position(|sample| below(&sample.frame)).unwrap();
    let expected = 100.0 * 25f64.to_radians().sin().powi(2);
    let found = quality.samples[i].covered.reconstructability_percent();
    assert!((found - expected).abs() < 1.2, "{found} against {expected}");
    assert_eq!((quality.samples[i].smith, quality.samples[i].parallax_rad), (0.0, 0.0));
}

#[test]
fn the_quality_is_the_same_on_one_two_and_five_threads() {
    let (plan, settings) = small_plan("phantom4-rtk");
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let truth = truth(small_block(8), &settings);
            let quality = assess(&truth, &quality::shots(&plan, Which::All), &settings);
            (quality.summary(), quality)
        })
    };
    let reference = on(1);
    assert!(reference.0.reconstructed_percent > 10.0, "{:?}", reference.0);
    assert_eq!(on(2), reference);
    assert_eq!(on(5), reference);
}

#[test]
fn fewer_images_see_no_more() {
    let (plan, settings) = small_plan("panoramic");
    let truth = truth(small_block(8), &settings);
    let of = |which| assess(&truth, &quality::shots(&plan, which), &settings);
    let (all, selected) = (of(Which::All), of(Which::Selected));
    assert!(selected.images < all.images && selected.images == plan.selected_images());
    for (all, selected) in all.samples.iter().zip(&selected.samples) {
        assert!(selected.views <= all.views && selected.matched_views <= all.matched_views && selected.smith <= all.smith);
        assert!(all.deviation.map(|d| d.rms_m) <= selected.deviation.map(|d| d.rms_m) || selected.deviation.is_none());
    }
    let [near, middle, far] = all.summary().completeness_percent;
    assert!(near <= middle && middle <= far && far <= all.summary().reconstructed_percent);
    assert!(all.summary().error_90_m < all.summary().error_95_m);
}

#[test]
fn a_scene_that_is_nearly_all_buried_takes_no_more_memory_than_others() {
    let mut scene = slab(10.0);
    for index in 0..300 {
        let name = format!("buried {index}");
        let Shape::Prism { footprint, .. } = slab(9.0).structures[0].shape.clone() else { unreachable!() };
        let shape = Shape::Prism { footprint: geo::Scale::scale(&footprint, 0.9), base_m: 1.0, top_m: 9.0 };
        scene.structures.push(Arc::new(Structure { id: StructureId::of_name(&name), name, shape }));
    }
    let samples = truth(scene, &settings(500)).samples().len();
    // The slab has 4800 m^2 besides its underside, of 300 times 3750 m^2: ten times the target in all leaves about 20 for it.
    assert!((1..100).contains(&samples), "{samples} samples");
}

#[test]
fn a_stopped_assessment_has_no_result() {
    let settings = settings(100);
    let truth = truth(slab(10.0), &settings);
    let stop = StopToken::default();
    stop.stop();
    assert_eq!(quality::assess(&truth, &[panorama([0.0, 0.0, 40.0])], &settings, &stop), None);
    assert!(Truth::new(slab(10.0), &settings, &stop).is_err());
}

#[test]
fn a_path_is_followed_through_a_truth_that_is_not_its_proxy() {
    let (plan, settings) = small_plan("panoramic");
    let curve: Vec<_> = plan.flown_points().into_iter().map(|(point, _)| point).collect();
    let own = quality::flown(&truth(small_block(8), &settings), &curve, 5.0);
    // The plan's own figure errs to the safe side where it lies on an arc.
    assert!((-0.01..0.03).contains(&(own.clearance_m - plan.clearance_m)) && !own.collides && !own.too_near, "{own:?}");

    let truth = truth(slab(10.0), &settings);
    let over = |z_m: f64| quality::flown(&truth, &[Point3::new(-60.0, 1.0, z_m), Point3::new(60.0, 1.0, z_m)], 5.0);
    let (safe, near, through) = (over(16.0), over(13.0), over(5.0));
    assert!((safe.clearance_m - 6.0).abs() < 1e-9 && !safe.too_near && !safe.collides, "{safe:?}");
    assert!((near.clearance_m - 3.0).abs() < 1e-9 && near.too_near && !near.collides, "{near:?}");
    let place = through.nearest_m.unwrap();
    assert!(through.collides && through.clearance_m == 0.0 && place.x.abs() <= 20.5, "{through:?}");
    // Wholly inside: no surface is touched.
    assert!(quality::flown(&truth, &[Point3::new(-1.0, 0.0, 5.0), Point3::new(1.0, 0.0, 5.0)], 0.5).collides);
    assert!(quality::flown(&truth, &[Point3::new(50.0, 0.0, 30.0), Point3::new(50.0, 0.0, -1.0)], 5.0).collides);
}

fn moved(scene: &Scene, origin: Geodetic) -> Scene {
    Scene { frame: LocalFrame { origin: Some(origin) }, ..scene.clone() }
}

#[test]
fn a_plan_is_carried_into_another_frame_by_way_of_the_earth() {
    let (mut plan, settings) = small_plan("phantom4-rtk");
    plan.scene.origin = Some(Geodetic { lat_deg: 51.9, lon_deg: 4.4, alt_m: 0.0 });
    let scene = small_block(8);
    let other = moved(&scene, Geodetic { lat_deg: 51.92, lon_deg: 4.43, alt_m: 2.0 });
    let carried = quality::carried(&plan, &other).unwrap();
    let (from, to) = (LocalFrame { origin: plan.scene.origin }, &other.frame);
    // Meridians converge: 0.03 degrees of longitude at 51.9 degrees north turn north by 0.03 sin(51.9) degrees.
    let turned =
        |a: &Unit<Vector3<f64>>, b: &Unit<Vector3<f64>>| (a.x * b.y - a.y * b.x).atan2(a.x * b.x + a.y * b.y).to_degrees();
    for (before, after) in plan.images.iter().zip(&carried.images) {
        let place = from.geodetic_from_local(&before.position_m).unwrap();
        assert!((to.local_from_geodetic(&place).unwrap() - after.position_m).norm() < 1e-6);
        let (before, after) = (before.direction.unwrap(), after.direction.unwrap());
        assert!((before.z - after.z).abs() < 1e-12);
        if before.z > -0.9 {
            let expected_deg = 0.03 * 51.91f64.to_radians().sin();
            assert!((turned(&before, &after).abs() - expected_deg).abs() < 1e-3, "{}", turned(&before, &after));
        }
    }
    let back = quality::carried(&carried, &moved(&scene, plan.scene.origin.unwrap())).unwrap();
    for (before, after) in plan.images.iter().zip(&back.images) {
        assert!((before.position_m - after.position_m).norm() < 1e-3);
        assert!((before.direction.unwrap().into_inner() - after.direction.unwrap().into_inner()).norm() < 1e-5);
    }
    assert_eq!(quality::carried(&plan, &moved(&scene, plan.scene.origin.unwrap())), Ok(plan.clone()));
    let apart = quality::check_reach(&carried, &other, settings.coverage.range_m);
    assert!(matches!(apart, Err(Misplaced::Apart { distance_m, .. }) if distance_m > 1000.0), "{apart:?}");
    assert_eq!(quality::check_reach(&plan, &scene, settings.coverage.range_m), Ok(()));
    let plain = Scene { frame: LocalFrame::default(), ..scene };
    assert!(matches!(quality::carried(&plan, &plain), Err(Misplaced::OneFrame { plan_has: true, .. })));
}

#[test]
fn a_plan_reads_back_as_it_was_written() {
    for rig in ["panoramic", "phantom4-rtk", "m300-oblique"] {
        let (plan, _) = small_plan(rig);
        let read = plan_read::read("plan.json", &plan_json::to_bytes(&plan)).unwrap();
        assert_eq!((&read.scene, read.seed, &read.rig, &read.method), (&plan.scene, plan.seed, &plan.rig, &plan.method));
        assert_eq!((&read.cameras, &read.waypoints, &read.images), (&plan.cameras, &plan.waypoints, &plan.images));
        assert_eq!(read.metrics, plan.metrics);
        assert_eq!(plan_json::to_bytes(&read), plan_json::to_bytes(&plan));
    }
}

fn made_up_plan() -> Vec<u8> {
    let blocks = block::field(&block::city(1, 1));
    plan_json::to_bytes(&block::plan(&FieldTable::open(&blocks, &[]).unwrap()))
}

proptest! {
    #[test]
    fn a_cut_or_damaged_plan_is_an_error_and_never_a_panic(at in 0.0..1.0f64, byte in any::<u8>()) {
        let bytes = made_up_plan();
        let place = (at * (bytes.len() - 3) as f64) as usize;
        prop_assert!(plan_read::read("plan.json", &bytes[..place]).is_err());
        let mut damaged = bytes;
        damaged[place] = byte;
        let _ = plan_read::read("plan.json", &damaged);
    }
}

#[test]
fn what_is_wrong_in_a_plan_is_named_by_file_and_key() {
    let text = String::from_utf8(made_up_plan()).unwrap();
    let image = r#""direction":null,"up":[0.0,0.0,1.0]"#;
    for (from, to, named) in [
        (r#""overfly-plan/1""#, r#""overfly-plan/2""#, "overfly-plan/2"),
        (r#"  "cameras""#, r#"  "cams""#, "cameras"),
        (r#""pixel_rad":0.0006"#, r#""pixel_rad":0.0"#, "cameras[0].pixel_rad"),
        (r#""pixel_rad":0.0006"#, r#""pixel_rad":"wide""#, "cameras[0].pixel_rad"),
        (
            r#""pixel_rad":0.0006"#,
            r#""focal_mm":0.0,"sensor_mm":[13.2,8.8],"pixels":[5472,3648],"pixel_rad":0.0006"#,
            "cameras[0].focal_mm",
        ),
        (image, r#""direction":null,"up":[0.0,0.0,2.0]"#, "images[0].up"),
        (image, r#""direction":[0.0,2.0,0.0],"up":[0.0,0.0,1.0],"fov_deg":[60.0,40.0]"#, "images[0].direction"),
        (image, r#""direction":[0.0,1.0,0.0],"up":[0.0,0.0,1.0]"#, "images[0].fov_deg"),
        (image, r#""direction":[0.0,1.0,0.0],"up":[0.0,1.0,0.0],"fov_deg":[60.0,40.0]"#, "images[0].up"),
        (image, r#""direction":[0.0,1.0,0.0],"up":[0.0,0.0,1.0],"fov_deg":[60.0,240.0]"#, "images[0].fov_deg"),
        (image, r#""up":[0.0,0.0,1.0]"#, "direction"),
        (r#""camera":"panorama""#, r#""camera":"left""#, "images[0].camera"),
        (r#""time_s":0.0"#, r#""time_s":-1.0"#, "images[0].time_s"),
        (r#""time_s":0.0"#, r#""time_s":1e999"#, "images[0].time_s"),
        (r#""lat_deg":51.9"#, r#""lat_deg":151.9"#, "scene.origin"),
        (r#""format""#, r#""form""#, "format"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = plan_read::read("some/plan.json", text.replacen(from, to, 1).as_bytes()).expect_err(to).to_string();
        assert!(error.starts_with("some/plan.json: ") && error.contains(named), "{to} gave {error}");
    }
    for (bytes, named) in [
        (&b""[..], "empty"),
        (b" \n", "empty"),
        (b"\x1f\x8b\x08\x00", "gzip"),
        (b"[1, 2]", "no JSON object"),
        (br#"{"type": "FeatureCollection", "features": []}"#, "a scene"),
        (br#"{"format": "overfly-plan/1"}"#, "scene"),
        (br#"{"format": 3}"#, "format"),
    ] {
        let error = plan_read::read("x", bytes).expect_err(named).to_string();
        assert!(error.contains(named), "{error}");
    }
    let none = text.split("  \"waypoints\": [").next().unwrap().to_owned() + r#" "waypoints": [], "images": [], "metrics": {}}"#;
    assert!(plan_read::read("x", none.as_bytes()).is_err());
}
