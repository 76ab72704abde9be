//! Plans for the tests of the writers: flown and photographed as the planner's are, without a scene.

use std::ops::Range;

use nalgebra::Point3;
use proptest::prelude::*;

use crate::camera::{Pose, Rig, direction_of};
use crate::frame::Geodetic;
use crate::scene::terrain::tests::hill;
use crate::scene::{BlockSettings, Scene, Shape, Structure, StructureId, TERRAIN_NAME, generate_block};
use crate::search::leg::headed;
use crate::search::spacing::ImageSpacing;
use crate::settings::Settings;
use crate::trajectory::egress::Egress;
use crate::trajectory::images::expose;
use crate::trajectory::limits::Limits;
use crate::trajectory::plan::{Camera, Metrics, Plan, SceneStamp, StopReason, Waypoint};
use crate::trajectory::profile::Profile;
use crate::trajectory::route::Route;

/// Where the fixture's scene lies.
pub const ORIGIN: Geodetic = Geodetic { lat_deg: 52.0, lon_deg: 4.0, alt_m: 3.5 };

/// Corners of a path, some of them in the same place.
pub fn corners(count: Range<usize>) -> impl Strategy<Value = Vec<[f64; 3]>> {
    let corner = [-150.0..150.0f64, -150.0..150.0, 10.0..90.0];
    prop::collection::vec(corner, count).prop_filter("two places", |corners| corners[0] != corners[1])
}

/// Corners of a path with all that makes writers stumble: places twice, steps of millimetres and decimetres, straight lines, climbs, hairpins.
pub fn rough_corners(count: Range<usize>) -> impl Strategy<Value = Vec<[f64; 3]>> {
    let step = prop_oneof![
        Just([0.0, 0.0, 0.0]),
        Just([0.0004, 0.0, 0.0]),
        Just([0.3, 0.1, 0.0]),
        Just([20.0, 0.0, 0.0]),
        Just([-20.0, 0.0, 0.0]),
        Just([0.0, 0.0, 7.0]),
        [-60.0..60.0f64, -60.0..60.0, -5.0..9.0],
    ];
    prop::collection::vec(step, count).prop_map(|steps| {
        let mut at = [0.0, 0.0, 40.0];
        let follow = |step: [f64; 3]| {
            at = [at[0] + step[0], at[1] + step[1], (at[2] + step[2]).clamp(5.0, 110.0)];
            at
        };
        [[0.0, 0.0, 40.0], [15.0, 5.0, 40.0]].into_iter().chain(steps.into_iter().map(follow)).collect()
    })
}

/// The plan of a path with images all along it.
pub fn plan(rig: &str, corners: &[[f64; 3]]) -> Plan {
    let rig = Rig::preset(rig).expect("a preset");
    let Settings { flight, dynamics, .. } = Settings::default();
    let direction = |k: usize| rig.has_gimbal().then(|| direction_of(37.0 * k as f64, -20.0 - 17.0 * (k % 5) as f64));
    let pose = |(k, corner): (usize, &[f64; 3])| Pose { position: Point3::from(*corner), direction: direction(k) };
    let path = headed(&rig, &corners.iter().enumerate().map(pose).collect::<Vec<_>>());
    let limits = Limits::new(&rig, &flight, &dynamics);
    let deviations_m: Vec<f64> =
        (0..path.len()).map(|k| if k == 0 || k + 1 == path.len() { 0.0 } else { dynamics.corner_deviation_m }).collect();
    let profile = Profile::rounded(&path, &limits, &deviations_m);
    let route = Route::continuous(&path, &rig, ImageSpacing::at_least(8.5));
    let exposed = expose(&route, &rig, &profile);
    let waypoint =
        |(pose, &deviation_m): (&Pose, &f64)| Waypoint { position_m: pose.position, direction: pose.direction, deviation_m };
    let length_m: f64 = path.windows(2).map(|ends| (ends[1].position - ends[0].position).norm()).sum();
    Plan {
        scene: SceneStamp { name: "town".to_owned(), origin: Some(ORIGIN), revision: 1 },
        seed: 1,
        rig: rig.name.clone(),
        method: "refined".to_owned(),
        cameras: Camera::all_of(&rig),
        waypoints: path.iter().zip(&deviations_m).map(waypoint).collect(),
        images: exposed.images,
        metrics: Metrics {
            length_m,
            profile_s: profile.duration_s(),
            battery_percent: rig.battery.map(|battery| battery.percent(profile.duration_s(), 0.0)),
            ..Metrics::default()
        },
        limits: Some(limits),
        cells: Vec::new(),
        ceilings: Vec::new(),
        goal_percent: 95.0,
        matched_goal_percent: 0.0,
        egress: Egress::default(),
        clearance_m: 0.0,
        convergence: Vec::new(),
        stop: StopReason::Complete,
    }
}

/// A hill of 60 m with a hut beside it, and a plan over the hill.
pub fn over_a_hill() -> (Scene, Plan) {
    let mut scene = generate_block(&BlockSettings { extent_m: [130.0, 130.0], buildings: 9, ..Default::default() });
    scene.structures.truncate(1);
    let shape = Shape::Terrain(hill(60.0, 150.0, 600.0, 10.0).into());
    let name = TERRAIN_NAME.to_owned();
    scene.structures.push(Structure { id: StructureId::of_name(&name), name, shape }.into());
    scene.structures.sort_by_key(|structure| structure.id);
    let corners = [[-200.0, 60.0, 90.0], [200.0, 60.0, 90.0], [200.0, -60.0, 100.0], [-200.0, -60.0, 100.0]];
    let mut plan = plan("phantom4-rtk", &corners);
    plan.scene.origin = scene.frame.origin;
    (scene, plan)
}
