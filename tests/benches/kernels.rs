//! The kernels that the field, the search and the replan spend their time in, on a generated block of NY-1's size.
//!
//! `cargo bench` runs them all side by side; compare rows of one run only, the machine may be shared.

use std::sync::{Arc, LazyLock};

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use nalgebra::{Point3, Vector3};
use overfly::camera::{Pose, Rig};
use overfly::coverage::{DiskModel, SampleFrame};
use overfly::planner::{Method, PlanOptions, StopToken, plan};
use overfly::scene::edit::Edit;
use overfly::scene::{generate_block, ny1_size};
use overfly::search::Problem;
use overfly::session::{Session, Snapshot};
use overfly::settings::Settings;
use overfly::trajectory::limits::Limits;
use overfly::trajectory::profile::Corner;

fn main() {
    divan::main();
}

static SETTINGS: LazyLock<Settings> = LazyLock::new(|| {
    let mut settings = Settings::default();
    settings.surface.samples = 1600;
    settings.field.viewpoints = 2000;
    settings
});
static SESSION: LazyLock<Session> = LazyLock::new(|| {
    let scene = generate_block(&ny1_size());
    Session::new(scene, Arc::new(SETTINGS.clone()), &StopToken::default()).expect("a generated block can be surveyed")
});
static SNAPSHOT: LazyLock<Snapshot> = LazyLock::new(|| {
    let stop = StopToken::default();
    SESSION.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops it")
});

/// Pairs of a viewpoint and a sample that it faces within range, grouped by viewpoint.
fn sight_lines() -> Vec<(Point3<f64>, Point3<f64>)> {
    let (field, disks) = (SNAPSHOT.field(), DiskModel::new(&SETTINGS.coverage));
    let mut lines = Vec::new();
    for viewpoint in field.viewpoints.iter().step_by(97) {
        let view = Point3::from(viewpoint.position_m);
        for row in field.samples.iter().filter(|row| row.exposed == 1) {
            let (position, normal) = (Point3::from(row.position_m), Vector3::from(row.normal));
            if disks.faces(&SampleFrame::new(position, normal), &view) {
                lines.push((view, position + normal * SETTINGS.surface.exposure_offset_m));
            }
        }
    }
    lines
}

/// Legs of 20 to 45 m between viewpoints.
fn legs() -> Vec<(Pose, Pose)> {
    let poses: Vec<Pose> =
        SNAPSHOT.field().viewpoints.iter().map(|row| Pose { position: row.position_m.into(), direction: None }).collect();
    let near = |a: &Pose, b: &Pose| (20.0..45.0).contains(&(a.position - b.position).norm());
    let pairs = poses.iter().step_by(41).filter_map(|a| poses.iter().find(|b| near(a, b)).map(|b| (*a, *b)));
    pairs.collect()
}

#[divan::bench]
fn occlusion_rays(bencher: Bencher) {
    let lines = sight_lines();
    let clearance = &SNAPSHOT.free.clearance;
    bencher
        .counter(ItemsCount::new(lines.len()))
        .bench_local(|| lines.iter().filter(|(a, b)| clearance.occluded(black_box(a), black_box(b))).count());
}

#[divan::bench]
fn leg_safety(bencher: Bencher) {
    let legs = legs();
    bencher
        .counter(ItemsCount::new(legs.len()))
        .bench_local(|| legs.iter().filter(|(a, b)| SNAPSHOT.free.is_leg_safe(&a.position, &b.position)).count());
}

#[divan::bench]
fn nearest_viewpoint_in_sight(bencher: Bencher) {
    let queries: Vec<_> = legs().iter().map(|(a, b)| nalgebra::center(&a.position, &b.position)).collect();
    bencher
        .counter(ItemsCount::new(queries.len()))
        .bench_local(|| queries.iter().filter_map(|p| SNAPSHOT.lookup.nearest_in_sight(p, &SNAPSHOT.free.clearance)).count());
}

#[divan::bench]
fn coverage_masks_of_a_leg(bencher: Bencher) {
    let problem = Problem::new(&SNAPSHOT, &SETTINGS, Rig::preset("panoramic").expect("a preset"));
    let legs = legs();
    let mut scratch = problem.scratch();
    bencher
        .counter(ItemsCount::new(legs.len()))
        .bench_local(|| legs.iter().map(|(a, b)| problem.observe_leg(a, b, &mut scratch).iter().count()).sum::<usize>());
}

#[divan::bench]
fn information_gain_of_a_leg(bencher: Bencher) {
    let problem = Problem::new(&SNAPSHOT, &SETTINGS, Rig::preset("panoramic").expect("a preset"));
    let mut scratch = problem.scratch();
    let seen: Vec<_> = legs().iter().map(|(a, b)| problem.observe_leg(a, b, &mut scratch)).collect();
    let mut covered = vec![0; problem.field.samples.len()];
    seen.iter().step_by(2).for_each(|seen| {
        problem.cover(&mut covered, seen);
    });
    bencher
        .counter(ItemsCount::new(seen.len()))
        .bench_local(|| seen.iter().map(|seen| problem.gain(black_box(&covered), seen)).sum::<u64>());
}

/// The rules of the speed profile that a local search asks for at every change.
#[divan::bench(args = ["panoramic", "m300-oblique", "phantom4-rtk"])]
fn time_of_a_leg(bencher: Bencher, rig: &str) {
    let (limits, stops) = timed_legs(rig);
    bencher
        .counter(ItemsCount::new(stops.len()))
        .bench_local(|| stops.iter().map(|(leg_m, ends)| limits.leg_s(*leg_m, black_box(ends), 8.0)).sum::<f64>());
}

#[divan::bench]
fn speed_reached_on_a_leg(bencher: Bencher) {
    let (limits, stops) = timed_legs("panoramic");
    bencher.counter(ItemsCount::new(stops.len())).bench_local(|| {
        stops.iter().map(|(leg_m, ends)| limits.reachable_mps(ends[0].speed_mps, *leg_m, [&ends[0], &ends[1]])).sum::<f64>()
    });
}

#[divan::bench(args = ["panoramic", "m300-oblique", "phantom4-rtk"])]
fn corner_between_two_legs(bencher: Bencher, rig: &str) {
    let limits = Limits::new(&Rig::preset(rig).expect("a preset"), &SETTINGS.flight, &SETTINGS.dynamics);
    let poses: Vec<Pose> = legs().into_iter().flat_map(|(a, b)| [a, b]).collect();
    bencher
        .counter(ItemsCount::new(poses.len() - 2))
        .bench_local(|| poses.windows(3).map(|at| limits.corner(&at[0], &at[1], &at[2], 8.0).speed_mps).sum::<f64>());
}

#[divan::bench]
fn speed_of_a_turning_view(bencher: Bencher) {
    let rig = Rig::preset("phantom4-rtk").expect("a preset");
    let limits = Limits::new(&rig, &SETTINGS.flight, &SETTINGS.dynamics);
    let directions = rig.view_directions();
    let turning = |(k, (a, b)): (usize, (Pose, Pose))| {
        let look = |k: usize| Some(directions[k % directions.len()]);
        (Pose { direction: look(5 * k), ..a }, Pose { direction: look(7 * k), ..b })
    };
    let legs: Vec<_> = legs().into_iter().enumerate().map(turning).collect();
    bencher
        .counter(ItemsCount::new(legs.len()))
        .bench_local(|| legs.iter().map(|(a, b)| limits.leg_mps(black_box(a), b)).sum::<f64>());
}

/// Legs of 6 to 45 m between corners of a path through viewpoints, at the speeds that these allow.
fn timed_legs(rig: &str) -> (Limits, Vec<(f64, [Corner; 2])>) {
    let limits = Limits::new(&Rig::preset(rig).expect("a preset"), &SETTINGS.flight, &SETTINGS.dynamics);
    let poses: Vec<Pose> = legs().into_iter().flat_map(|(a, b)| [a, b]).collect();
    let turns: Vec<Corner> = poses.windows(3).map(|at| limits.corner(&at[0], &at[1], &at[2], 8.0)).collect();
    let leg = |(k, pair): (usize, &[Corner])| {
        let leg_m = 6.0 + 3.0 * (k % 14) as f64;
        let [mut first, mut last] = [pair[0], pair[1]];
        last.speed_mps = last.speed_mps.min(limits.reachable_mps(first.speed_mps, leg_m, [&first, &last]));
        first.speed_mps = first.speed_mps.min(limits.reachable_mps(last.speed_mps, leg_m, [&first, &last]));
        (leg_m, [first, last])
    };
    (limits, turns.windows(2).enumerate().map(leg).collect())
}

#[divan::bench(sample_count = 20)]
fn survey() -> usize {
    SESSION.survey(&StopToken::default()).expect("nobody stops it").counts().viewpoints
}

#[divan::bench(sample_count = 20)]
fn field_build(bencher: Bencher) {
    let survey = || SESSION.survey(&StopToken::default()).expect("nobody stops it");
    bencher.with_inputs(survey).bench_local_values(|survey| survey.into_snapshot(&StopToken::default()));
}

/// A structure is raised; the ratio to [`survey`] and [`field_build`] together is what the field before saves.
#[divan::bench(sample_count = 20)]
fn field_update_after_an_edit(bencher: Bencher) {
    let mut edited = SESSION.clone();
    let id = edited.scene().structures[3].id;
    edited.apply(&Edit::Raise { id, by_m: 3.0 }).expect("it can be raised");
    let stop = StopToken::default();
    bencher.bench_local(|| edited.survey_after(&SNAPSHOT, &stop).and_then(|survey| survey.into_snapshot(&stop)).is_ok());
}

#[divan::bench(sample_count = 10, args = [100, 400, 1000])]
fn plan_by_tree_search(iterations: u32) -> usize {
    let options = PlanOptions {
        iterations: Some(iterations),
        ..PlanOptions::new(Rig::preset("panoramic").expect("a preset"), Method::Paper, 1)
    };
    plan(&SNAPSHOT, &SETTINGS, &options, &StopToken::default(), &mut |_| {}).expect("the block can be flown").images.len()
}
