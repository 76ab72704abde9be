//! With an overlap each image shows of the one before what was asked for, and what it costs is said.

mod support;

use nalgebra::{Point3, Vector3};
use overfly::camera::{Cameras, Pose, Rig, View};
use overfly::planner::{Method, PlanError, PlanOptions, StopToken, plan};
use overfly::search::spacing::ImageSpacing;
use overfly::session::Snapshot;
use overfly::settings::Settings;
use overfly::trajectory::images::{Exposed, expose};
use overfly::trajectory::plan::{Image, Plan, Waypoint};
use overfly::trajectory::profile::Profile;
use overfly::trajectory::route::Route;
use proptest::prelude::*;
use support::{session, small_block, small_settings, snapshot};

fn ordered(rig: &str, method: Method, overlap_percent: f64) -> PlanOptions {
    let iterations = Some(if method == Method::Refined { 8 } else { 60 });
    let rig = Rig::preset(rig).expect("a preset");
    PlanOptions { iterations, overlap_percent: Some(overlap_percent), ..PlanOptions::new(rig, method, 4) }
}

fn outcome(snapshot: &Snapshot, settings: &Settings, options: &PlanOptions) -> Result<Plan, PlanError> {
    plan(snapshot, settings, options, &StopToken::default(), &mut |_| {})
}

/// Lengths of the flown curve between images that follow each other, by many short chords; one image of each exposure stands for all.
fn gaps_m(profile: &Profile, images: &[Image]) -> Vec<f64> {
    let place = |time_s: f64| profile.at(time_s).expect("the flight has waypoints").position_m;
    let own: Vec<&Image> = images.iter().filter(|image| image.camera == 0).collect();
    let gap_m = |pair: &[&Image]| {
        let at = |k: u32| place(pair[0].time_s + (pair[1].time_s - pair[0].time_s) * f64::from(k) / 400.0);
        (0..400).map(|k| (at(k + 1) - at(k)).norm()).sum()
    };
    own.windows(2).map(gap_m).collect()
}

fn most_of(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// What is to come of an order, worked out by hand.
struct Expected {
    most_m: f64,
    cruise_mps: f64,
}

/// The block sees 80 m far and keeps 5 m away: without a sampling distance surfaces are 20 m away.
fn orders() -> Vec<(PlanOptions, Expected)> {
    let phantom = |percent| ordered("phantom4-rtk", Method::Paper, percent);
    let oblique = |percent| ordered("m300-oblique", Method::Paper, percent);
    // 1 cm behind 8.8 mm and pixels of 13.2 mm / 5472.
    let centimetre_m = 0.01 * 8.8 * 5472.0 / 13.2;
    let paper = [
        // The Phantom's shorter side is as long as its focal length; one image a second.
        (phantom(80.0), Expected { most_m: 4.0, cruise_mps: 2.0 / 3.0 * 4.0 }),
        (phantom(30.0), Expected { most_m: 14.0, cruise_mps: 8.0 }),
        (
            PlanOptions { gsd_m: Some(0.01), ..phantom(80.0) },
            Expected { most_m: 0.2 * centimetre_m, cruise_mps: 2.0 / 3.0 * 0.2 * centimetre_m },
        ),
        // Nothing is seen from farther away than 80 m, however coarse an image may be.
        (PlanOptions { gsd_m: Some(10.0), ..phantom(90.0) }, Expected { most_m: 8.0, cruise_mps: 2.0 / 3.0 * 8.0 }),
        // 15.6 mm behind 35 mm; one image in 0.8 s.
        (oblique(80.0), Expected { most_m: 4.0 * 15.6 / 35.0, cruise_mps: 2.0 / 3.0 * 4.0 * 15.6 / 35.0 / 0.8 }),
    ];
    let refined =
        [phantom(80.0), oblique(80.0)].map(|options| PlanOptions { method: Method::Refined, iterations: Some(8), ..options });
    let [of_phantom, of_oblique] = [0, 4].map(|k: usize| Expected { ..paper[k].1 });
    let [phantom, oblique] = refined;
    paper.into_iter().chain([(phantom, of_phantom), (oblique, of_oblique)]).collect()
}

#[test]
fn no_image_is_farther_along_the_curve_from_the_one_before_than_the_overlap_allows() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    for (options, Expected { most_m, cruise_mps }) in orders() {
        let plan = outcome(&snapshot, &settings, &options).expect("the block can be flown");
        let name = format!("{} of {} at {:?} %", options.method.name(), plan.rig, options.overlap_percent);
        let profile = plan.profile().expect("a plan says how it was timed");
        let gaps_m = gaps_m(&profile, &plan.images);
        // Nothing is added by arcs and delays.
        assert!(most_of(&gaps_m) <= most_m + 1e-6, "{name}: {} m of {most_m} m", most_of(&gaps_m));
        // Not by far more images than are needed.
        let mean_m = gaps_m.iter().sum::<f64>() / gaps_m.len() as f64;
        assert!(mean_m > 2.0 / 3.0 * most_m * 0.95, "{name}: {mean_m} m on average");
        assert!((plan.limits.unwrap().cruise_mps - cruise_mps).abs() < 1e-9, "{name}: {:?}", plan.limits);
        assert!((plan.metrics.movement_s - plan.metrics.length_m / cruise_mps).abs() < 1e-6, "{name}: {:?}", plan.metrics);
        let least_m = (2.0 * most_m).max(8.0) - 1e-9;
        let is_long_enough = |ends: &[Waypoint]| (ends[1].position_m - ends[0].position_m).norm() >= least_m;
        assert!(plan.waypoints.len() > 3 && plan.waypoints.windows(2).all(is_long_enough), "{name}");
        let own: Vec<f64> = plan.images.iter().filter(|image| image.camera == 0).map(|image| image.time_s).collect();
        assert!(own.windows(2).all(|pair| pair[1] - pair[0] >= options.rig.shutter_interval_s - 2e-9), "{name}");
    }
}

#[test]
fn without_an_overlap_images_are_farther_apart_and_the_cruise_is_that_of_the_settings() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    let options = PlanOptions { overlap_percent: None, ..ordered("phantom4-rtk", Method::Paper, 80.0) };
    let plan = outcome(&snapshot, &settings, &options).expect("the block can be flown");
    assert_eq!(plan.limits.unwrap().cruise_mps, settings.flight.cruise_speed_mps);
    let of_leg = |ends: &[Waypoint]| ((ends[1].position_m - ends[0].position_m).norm() / 8.0).floor() as usize;
    assert_eq!(
        plan.images.len() as u32 + plan.metrics.dropped_exposures,
        1 + plan.waypoints.windows(2).map(of_leg).sum::<usize>() as u32
    );
    assert!(most_of(&gaps_m(&plan.profile().unwrap(), &plan.images)) > 8.0);
}

/// The ground as squares of 5 cm: which share of those that the first image frames the second one frames too.
fn shared_percent(rig: &Rig, distance_m: f64, apart_m: f64) -> f64 {
    let Cameras::Gimbal { intrinsics, .. } = &rig.cameras else { panic!("one camera") };
    // North is the top of an image that looks straight down, and the Phantom's images are wider than high.
    let view = |north_m: f64| {
        let down = nalgebra::Unit::new_unchecked(-Vector3::z());
        View::new(Point3::new(0.0, north_m, distance_m), &down, &Vector3::y(), intrinsics.half_tangents())
    };
    let (first, second) = (view(0.0), view(apart_m));
    let square = |x: i32, y: i32| Point3::new(0.05 * (f64::from(x) + 0.5), 0.05 * (f64::from(y) + 0.5), 0.0);
    let squares = (-600..600).flat_map(|x| (-600..600).map(move |y| square(x, y)));
    let framed: Vec<Point3<f64>> = squares.filter(|square| first.frames(square)).collect();
    100.0 * framed.iter().filter(|square| second.frames(square)).count() as f64 / framed.len() as f64
}

#[test]
fn images_that_far_apart_show_the_share_of_each_other_that_was_asked_for() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    for overlap_percent in [80.0, 60.0] {
        let options = ordered("phantom4-rtk", Method::Paper, overlap_percent);
        let plan = outcome(&snapshot, &settings, &options).expect("the block can be flown");
        // The cruise leaves the shutter its interval for two thirds of the most.
        let most_m = plan.limits.unwrap().cruise_mps * options.rig.shutter_interval_s * 1.5;
        let shared = shared_percent(&options.rig, 20.0, most_m);
        assert!((shared - overlap_percent).abs() < 0.5, "{shared} % at {most_m} m");
    }
}

/// Legs of equal length, each turned against the one before.
fn bent(leg_m: f64, turn_deg: f64, legs: u32) -> Vec<Pose> {
    let mut place = Point3::new(0.0, 0.0, 50.0);
    let mut path = vec![Pose { position: place, direction: None }];
    for leg in 0..legs {
        let (sin, cos) = (turn_deg * f64::from(leg)).to_radians().sin_cos();
        place += Vector3::new(cos, sin, 0.0) * leg_m;
        path.push(Pose { position: place, direction: None });
    }
    path
}

/// A flight at the fastest cruise that an overlap leaves: exposures and the curve's lengths between them.
fn exposed(rig: &str, path: &[Pose], most_m: f64, deviation_m: f64, keeps_overlap: bool) -> (Exposed, Vec<f64>) {
    let rig = Rig { shutter_interval_s: 0.8, ..Rig::preset(rig).unwrap() };
    let Settings { mut flight, mut dynamics, .. } = Settings::default();
    flight.cruise_speed_mps = 2.0 / 3.0 * most_m / rig.shutter_interval_s;
    dynamics.corner_deviation_m = deviation_m;
    let profile = Profile::new(path, &rig, &flight, &dynamics);
    let mut route = Route::continuous(path, &rig, ImageSpacing::overlapping(1.0, most_m));
    if !keeps_overlap {
        route.most_apart_m = None;
    }
    let exposed = expose(&route, &rig, &profile);
    let gaps_m = gaps_m(&profile, &exposed.images);
    (exposed, gaps_m)
}

#[test]
fn an_exposure_that_the_overlap_needs_waits_and_is_not_left_out() {
    // Legs just longer than two times 3 m have three parts of two thirds of that, and wide arcs on all of them are flown at full cruise: images come
    // sooner and sooner before the shutter is ready.
    let path = bent(6.01, 30.0, 11);
    let (_, careless_m) = exposed("panoramic", &path, 3.0, 20.0, false);
    assert!(most_of(&careless_m) > 3.3, "{careless_m:?}");
    let (careful, gaps_m) = exposed("panoramic", &path, 3.0, 20.0, true);
    assert!(most_of(&gaps_m) <= 3.0 + 1e-6, "{gaps_m:?}");
    assert!(careful.delayed > 3, "{} delayed, {} dropped", careful.delayed, careful.dropped);
}

proptest! {
    #[test]
    fn on_any_path_images_keep_the_overlap_and_the_shutter_its_interval(
        rig in prop::sample::select(&["panoramic", "m300-oblique", "phantom4-rtk"][..]), most_m in 0.6..8.0f64, longer in 1.0..4.0f64, turn_deg in -175.0..175.0f64, deviation_m in 0.0..30.0f64, legs in 1u32..20,
    ) {
        let path = bent(2.0 * most_m * longer, turn_deg, legs);
        let (exposed, gaps_m) = exposed(rig, &path, most_m, deviation_m, true);
        prop_assert!(exposed.images.len() > 1);
        prop_assert!(most_of(&gaps_m) <= most_m + 1e-6, "{} m of {} m", most_of(&gaps_m), most_m);
        let own: Vec<&Image> = exposed.images.iter().filter(|image| image.camera == 0).collect();
        for pair in own.windows(2) {
            prop_assert!(pair[1].time_s - pair[0].time_s >= 0.8 - 2e-9);
        }
    }
}

#[test]
fn an_overlap_that_cannot_be_flown_is_refused_with_its_figures_and_a_remedy() {
    for percent in [0.0, -5.0, 100.0, 130.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(ordered("phantom4-rtk", Method::Paper, percent).check(), Err(PlanError::Overlap { .. })), "{percent}");
    }
    for method in [Method::Oblique, Method::Smith, Method::Zhou] {
        let error = ordered("phantom4-rtk", method, 80.0).check().expect_err("baselines keep no overlap");
        assert_eq!(error, PlanError::NoOverlap { method: method.name() });
        assert!(error.to_string().contains("refined") && error.to_string().contains(method.name()), "{error}");
    }
    let panoramic = ordered("panoramic", Method::Refined, 80.0).check().expect_err("a panorama has no frame");
    assert!(panoramic == PlanError::NoFrame { rig: "panoramic".into() } && panoramic.to_string().contains("phantom4-rtk"));

    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    let refusal = |percent, rig: &str, gsd_m| {
        let options = PlanOptions { gsd_m, ..ordered(rig, Method::Paper, percent) };
        outcome(&snapshot, &settings, &options).expect_err("it cannot be flown")
    };
    // 4 % of 20 m in a second: two thirds of 0.8 m are 0.53 m/s, of 0.7 m only 0.47.
    assert!(outcome(&snapshot, &settings, &ordered("phantom4-rtk", Method::Paper, 96.0)).is_ok());
    let slow = refusal(96.5, "phantom4-rtk", None);
    assert!(matches!(slow, PlanError::OverlapSpeed { .. }), "{slow}");
    for figure in ["96.5 %", "0.70 m", "1 s", "0.47 m/s", "0.5 m/s", "less overlap", "larger ground sampling distance"] {
        assert!(slow.to_string().contains(figure), "{figure} is not in {slow}");
    }
    // 2 % of 20 m.
    let dense = refusal(98.0, "phantom4-rtk", None).to_string();
    for figure in ["98 %", "0.40 m", "20.0 m", "0.5 m", "less overlap"] {
        assert!(dense.contains(figure), "{figure} is not in {dense}");
    }
    // A flight that is slow by itself is no slower for its overlap.
    let mut creeping = settings.clone();
    creeping.flight.cruise_speed_mps = 0.3;
    let plan = outcome(&snapshot, &creeping, &ordered("phantom4-rtk", Method::Paper, 96.5)).expect("0.3 m/s are slow enough");
    assert_eq!(plan.limits.unwrap().cruise_mps, 0.3);
}
