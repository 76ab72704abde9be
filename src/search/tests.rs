//! The tree against brute force.

use std::sync::Arc;

use nalgebra::{Unit, Vector3};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;

use super::cover::Cover;
use super::leg::{heading, image_poses};
use super::objective::PathSums;
use super::outcome::StopReason;
use super::problem::Problem;
use super::rrt_star::{expand, rewire_tree, search};
use super::tree::Tree;
use crate::camera::{Cameras, Pose, Rig, direction_of};
use crate::coverage::Mask;
use crate::field::Snapshot;
use crate::scene::{BlockSettings, generate_block};
use crate::session::Session;
use crate::settings::Settings;
use crate::stop::StopToken;

fn small_block(seed: u64) -> (Snapshot, Settings) {
    let mut settings = Settings::default();
    settings.surface.samples = 150;
    settings.field.viewpoints = 200;
    let block = BlockSettings { seed, extent_m: [120.0, 120.0], buildings: 9, ..Default::default() };
    let stop = StopToken::default();
    let session = Session::new(generate_block(&block), Arc::new(settings.clone()), &stop).expect("a generated block has a field");
    let snapshot = session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops it");
    (snapshot, settings)
}

fn panoramic() -> Rig {
    Rig::preset("panoramic").expect("a preset")
}

/// The presets, and a gimbal whose range great circles between admissible directions easily leave.
fn rigs() -> Vec<Rig> {
    let phantom = include_str!("../../config/rigs/phantom4-rtk.toml");
    let narrow = Rig::parse(&phantom.replace("[-90.0, 30.0]", "[-52.0, -12.0]")).expect("a rig");
    Rig::PRESETS.into_iter().map(|name| Rig::preset(name).expect("a preset")).chain([narrow]).collect()
}

fn root(problem: &Problem) -> Pose {
    // A direction that is none of the discretised ones, as a user may give it: the next waypoints may keep it.
    let given = problem.rig.has_gimbal().then(|| direction_of(10.0, -30.0));
    let direction = given.or(problem.rig.pose_directions()[0]);
    Pose { position: problem.field.viewpoints[0].position_m.into(), direction }
}

fn grown<'p, 'a>(problem: &'p Problem<'a>, seed: u64, iterations: usize) -> Tree<'p, 'a> {
    let mut tree = Tree::new(problem, root(problem));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..iterations {
        expand(problem, &mut tree, &mut random, &StopToken::default()).expect("the block is open to the sky");
    }
    tree
}

/// Sums, captured samples and coverage of a path computed from nothing, image by image.
fn brute_force(problem: &Problem, path: &[Pose]) -> (PathSums, u32, Vec<u128>) {
    let mut covered = vec![0; problem.field.samples.len()];
    let mut scratch = problem.scratch();
    let mut sums = PathSums::default();
    let mut see = |covered: &mut Vec<u128>, pose: &Pose| {
        problem.observe_pose(pose, &mut scratch).iter().for_each(|(i, mask)| covered[i] |= mask);
    };
    see(&mut covered, &path[0]);
    for (k, leg) in path.windows(2).enumerate() {
        image_poses(&problem.rig, &leg[0], &leg[1], problem.spacing).for_each(|pose| see(&mut covered, &pose));
        let flown = leg[1].position - leg[0].position;
        sums.length_m += flown.norm();
        if k > 0 {
            sums.turning_s += problem.objective.turn_s(&(leg[0].position - path[k - 1].position), &flown);
        }
    }
    let cells = |i: usize| covered[i].count_ones();
    let mut at_root = vec![0; covered.len()];
    let root_information = problem.cover(&mut at_root, &problem.observe_pose(&path[0], &mut problem.scratch())).information;
    sums.information =
        (0..covered.len()).map(|i| u64::from(cells(i)) * problem.field.samples[i].area_mm2).sum::<u64>() - root_information;
    let threshold = problem.field.facts.threshold_cells;
    let captured = (0..covered.len()).filter(|&i| cells(i) > threshold && u32::from(problem.ceilings[i]) > threshold);
    (sums, captured.count() as u32, covered)
}

/// Whether a leg may be flown with these view directions: written anew, with angles where the planner has sines.
fn is_admissible(problem: &Problem, settings: &Settings, from: &Pose, to: &Pose) -> bool {
    let Cameras::Gimbal { sin_pitch, .. } = &problem.rig.cameras else { return true };
    let (first, last) = (from.direction.expect("a direction"), to.direction.expect("a direction"));
    let slowest_rad_s = [
        settings.dynamics.yaw_rate_dps.to_radians(),
        settings.dynamics.gimbal_rate_dps.to_radians(),
        problem.rig.blur_limit_rad_s,
    ]
    .into_iter()
    .fold(f64::INFINITY, f64::min);
    let leg_m = (to.position - from.position).norm();
    let most_rad = (slowest_rad_s * leg_m / settings.flight.cruise_speed_mps).min(settings.search.view_turn_deg.to_radians());
    let images = (leg_m / problem.spacing.least_leg_m).floor().max(1.0) as usize;
    let pitch_of = |share: f64| first.slerp(&last, share).z.clamp(-1.0, 1.0).asin();
    let [low, high] = sin_pitch.map(f64::asin);
    first.angle(&last) <= most_rad + 1e-9
        && (1..=images).map(|k| pitch_of(k as f64 / images as f64)).all(|pitch| (low - 1e-6..=high + 1e-6).contains(&pitch))
}

fn dense(problem: &Problem, covered: &Cover) -> Vec<Mask> {
    (0..problem.frames.len()).map(|i| covered.cells(problem.places(), i)).collect()
}

/// What a leg gains beyond `covered`, image by image.
fn gain_of_leg(problem: &Problem, covered: &[Mask], from: &Pose, to: &Pose) -> u64 {
    let (mut covered, mut scratch) = (covered.to_vec(), problem.scratch());
    let images = image_poses(&problem.rig, from, to, problem.spacing);
    images.map(|pose| problem.cover(&mut covered, &problem.observe_pose(&pose, &mut scratch)).information).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn every_node_agrees_with_its_path_recomputed_from_nothing(seed in 0u64..1000) {
        let (snapshot, settings) = small_block(seed % 3);
        for rig in rigs() {
            let problem = Problem::new(&snapshot, &settings, rig);
            let mut tree = grown(&problem, seed, 60);
            rewire_tree(&problem, &mut tree, 0, &StopToken::default());
            for n in 0..tree.nodes.len() {
                let mut path: Vec<Pose> = tree.path_up(n).map(|m| tree.nodes[m].pose).collect();
                path.reverse();
                prop_assert_eq!(path[0], root(&problem), "every node hangs from the root");
                let (sums, captured, covered) = brute_force(&problem, &path);
                let node = &tree.nodes[n];
                prop_assert_eq!(node.sums.information, sums.information);
                prop_assert_eq!(node.captured, captured);
                prop_assert_eq!(&dense(&problem, &node.covered), &covered);
                prop_assert!((node.sums.length_m - sums.length_m).abs() < 1e-6);
                prop_assert!((node.sums.turning_s - sums.turning_s).abs() < 1e-6);
                prop_assert!((node.objective - problem.objective.value(&sums)).abs() < 1e-6);
                for leg in path.windows(2) {
                    prop_assert!(problem.can_fly(&leg[0].position, &leg[1].position));
                    prop_assert!(is_admissible(&problem, &settings, &leg[0], &leg[1]), "{:?}", leg);
                    if matches!(problem.rig.cameras, Cameras::Rigid(_)) {
                        prop_assert_eq!(leg[1].direction, Some(heading(&leg[0].position, &leg[1].position)));
                    }
                }
            }
        }
    }

    #[test]
    fn an_offer_has_the_best_of_the_admissible_directions(seed in 0u64..1000) {
        let (snapshot, settings) = small_block(seed % 3);
        let mut refused = 0;
        for rig in rigs().into_iter().filter(Rig::has_gimbal) {
            let problem = Problem::new(&snapshot, &settings, rig);
            let mut tree = grown(&problem, seed, 25);
            for (parent, child) in (0..26).flat_map(|parent| (1..26).map(move |child| (parent, child))) {
                if parent == child || tree.ancestors(parent)[child] || !tree.can_fly(parent, child) {
                    continue;
                }
                let from = tree.nodes[parent].pose;
                let expected = best_end(&problem, &settings, &tree, parent, child);
                let offer = tree.offer(parent, child, f64::NEG_INFINITY);
                prop_assert_eq!(offer.map(|offer| offer.end), expected.map(|(end, _)| end), "{:?} to {}", from, child);
                let Some((_, gained)) = expected else {
                    refused += 1;
                    continue;
                };
                let leg = tree.nodes[child].pose.position - from.position;
                let mut sums = tree.nodes[parent].sums;
                (sums.information, sums.length_m) = (sums.information + gained, sums.length_m + leg.norm());
                if let Some(before) = tree.nodes[parent].parent {
                    sums.turning_s += problem.objective.turn_s(&(from.position - tree.nodes[before].pose.position), &leg);
                }
                let value = problem.objective.value(&sums);
                prop_assert!((offer.unwrap().objective - value).abs() < 1e-6);
                prop_assert!(tree.offer(parent, child, value + 1e-6).is_none(), "a leg that is not worth it is no offer");
                prop_assert_eq!(tree.offer(parent, child, value - 1e-6), offer, "the bound does not change the choice");
            }
        }
        prop_assert!(refused > 0, "children never forbade a leg");
    }

    #[test]
    fn no_leg_gains_more_than_its_upper_bound(seed in 0u64..1000) {
        let (snapshot, settings) = small_block(seed % 3);
        for rig in rigs() {
            let problem = Problem::new(&snapshot, &settings, rig);
            let tree = grown(&problem, seed, 30);
            let (nothing, mut scratch) = (vec![0; problem.field.samples.len()], problem.scratch());
            for (a, b) in tree.nodes.iter().flat_map(|a| tree.nodes.iter().map(move |b| (&a.pose, &b.pose))) {
                let seen = problem.observe_leg(a, b, &mut scratch);
                prop_assert!(problem.gain(&nothing, &seen) <= problem.most_of_leg(&a.position, &b.position));
            }
        }
    }
}

#[test]
fn a_tree_over_a_town_holds_what_its_legs_touch() {
    let mut settings = Settings::default();
    (settings.surface.samples, settings.field.viewpoints) = (3000, 3000);
    let block = BlockSettings { seed: 5, extent_m: [700.0, 700.0], buildings: 150, ..Default::default() };
    let stop = StopToken::default();
    let session = Session::new(generate_block(&block), Arc::new(settings.clone()), &stop).expect("a generated block has a field");
    let snapshot = session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops it");
    let problem = Problem::new(&snapshot, &settings, panoramic());
    let tree = grown(&problem, 1, 120);
    let rows = tree.nodes.len() * problem.frames.len() * size_of::<Mask>();
    let pages = tree.nodes[0].covered.page_bytes();
    assert!(0 < pages && pages < rows / 4, "{pages} bytes of pages, {rows} of whole rows");
    assert!(tree.bytes() > pages + tree.nodes.len() * tree.nodes[0].covered.own_bytes());
}

/// Of the discretised directions and the parent's own, the first with the largest gain over the leg that child and grandchildren allow.
fn best_end(problem: &Problem, settings: &Settings, tree: &Tree, parent: usize, child: usize) -> Option<(Pose, u64)> {
    let (from, position) = (&tree.nodes[parent].pose, tree.nodes[child].pose.position);
    let candidates = problem.rig.view_directions().into_iter().chain(from.direction);
    let mut best: Option<(Pose, u64)> = None;
    for end in candidates.map(|direction| Pose { position, direction: Some(direction) }) {
        let children = &tree.nodes[child].children;
        let fits = is_admissible(problem, settings, from, &end)
            && children.iter().all(|&next| is_admissible(problem, settings, &end, &tree.nodes[next].pose));
        let gained = gain_of_leg(problem, &dense(problem, &tree.nodes[parent].covered), from, &end);
        if fits && best.is_none_or(|(_, most)| gained > most) {
            best = Some((end, gained));
        }
    }
    best
}

#[test]
fn the_ceilings_of_a_rig_are_those_of_all_its_views_from_all_viewpoints() {
    let (snapshot, settings) = small_block(1);
    for rig in rigs() {
        let problem = Problem::new(&snapshot, &settings, rig);
        let rig = &problem.rig;
        for (i, sample) in problem.frames.iter().enumerate() {
            let mut union: Mask = 0;
            for (j, viewpoint) in problem.field.viewpoints.iter().enumerate() {
                if !problem.field.row(j).sees(i) {
                    continue;
                }
                let position = viewpoint.position_m.into();
                let is_framed = rig.pose_directions().into_iter().any(|direction| {
                    let pose = Pose { position, direction };
                    (0..rig.camera_count()).any(|camera| frames(rig, camera, &pose, &(sample.position - position)))
                });
                if is_framed {
                    union |= problem.disks.mask(sample, &position);
                }
            }
            assert_eq!(u32::from(problem.ceilings[i]), union.count_ones(), "sample {i} by {}", rig.name);
        }
        let threshold = problem.field.facts.threshold_cells;
        let is_above = |i: usize| u32::from(problem.ceilings[i]) > threshold;
        assert!((0..problem.frames.len()).all(|i| problem.is_capturable(i) == is_above(i)));
        let capturable = problem.ceilings.iter().filter(|&&cells| u32::from(cells) > threshold).count();
        assert_eq!(problem.capturable as usize, capturable);
    }
    let capturable = |rig: Rig| Problem::new(&snapshot, &settings, rig).capturable;
    let counts: Vec<u32> = rigs().into_iter().map(capturable).collect();
    assert!(counts[0] > counts[2] && counts[1..].iter().all(|count| *count <= counts[0]), "{counts:?}");
}

#[test]
fn a_sample_can_be_matched_when_enough_of_the_rig_s_views_from_all_viewpoints_have_a_partner() {
    let (snapshot, mut settings) = small_block(1);
    for (least_views, window_deg) in [(3, [5.0, 45.0]), (3, [60.0, 70.0]), (80, [5.0, 45.0])] {
        settings.quality.least_views = least_views;
        [settings.quality.min_parallax_deg, settings.quality.max_parallax_deg] = window_deg;
        let (mut matchable, mut others) = (0, 0);
        for rig in rigs() {
            let problem = Problem::new(&snapshot, &settings, rig.clone());
            for (i, sample) in problem.frames.iter().enumerate() {
                let mut views = Vec::new();
                for j in (0..problem.field.viewpoints.len()).filter(|&j| problem.field.row(j).sees(i)) {
                    let position = problem.field.viewpoints[j].position_m.into();
                    let is_framed = rig.pose_directions().into_iter().any(|direction| {
                        let pose = Pose { position, direction };
                        (0..rig.camera_count()).any(|camera| frames(&rig, camera, &pose, &(sample.position - position)))
                    });
                    if is_framed && problem.disks.faces(sample, &position) {
                        views.push(position - sample.position);
                    }
                }
                // Angles are rounded: what is matched by a trace more is, what is not by a trace less is not.
                let matched = |slack_deg: f64| {
                    let range = window_deg[0] - slack_deg..=window_deg[1] + slack_deg;
                    let has_partner = |a: &&Vector3<f64>| views.iter().any(|b| range.contains(&a.angle(b).to_degrees()));
                    views.iter().filter(has_partner).count() as u32 >= least_views
                };
                assert!(!problem.matchable[i] || matched(0.02), "sample {i} by {} with {least_views}", rig.name);
                // Many views without a partner are given up.
                assert!(problem.matchable[i] || !matched(-0.02) || views.len() > 64, "sample {i} by {}", rig.name);
                *(if problem.matchable[i] { &mut matchable } else { &mut others }) += 1;
            }
            let enough = problem.enough_matched(50.0) as usize;
            let all = problem.matchable.iter().filter(|matchable| **matchable).count();
            assert_eq!((enough, problem.enough_matched(0.0)), ((all / 2 + 1).min(all), 0));
        }
        assert!(matchable > 0 && others > 0, "{matchable} and {others} with {least_views} views within {window_deg:?}");
    }
}

/// Whether a camera frames what lies in the direction `towards`, by the angles of its field of view.
fn frames(rig: &Rig, camera: usize, pose: &Pose, towards: &Vector3<f64>) -> bool {
    let Some((axis, up)) = rig.optical_axis(camera, pose) else { return true };
    let [half_width, half_height] = rig.camera(camera).1.expect("a frustum").fov_deg().map(|fov_deg| fov_deg.to_radians() / 2.0);
    let depth = towards.dot(&axis);
    let right: Unit<Vector3<f64>> = Unit::new_normalize(axis.cross(&up));
    let (across, above) = (towards.dot(&right).atan2(depth).abs(), towards.dot(&up).atan2(depth).abs());
    across <= half_width && above <= half_height
}

#[test]
fn a_reconnection_raises_the_objective_of_its_node() {
    let mut reconnections = 0;
    for seed in 0..8 {
        let (snapshot, settings) = small_block(seed % 3);
        let with_budget = |rewirings| {
            let mut problem = Problem::new(&snapshot, &settings, panoramic());
            problem.settings.rewirings = rewirings;
            problem
        };
        // Grown without rewiring, the tree has something left to improve; then one reconnection at a time is looked at.
        let (idle, frugal) = (with_budget(0), with_budget(1));
        let mut tree = grown(&idle, seed, 40);
        for start in 0..tree.nodes.len() {
            let before: Vec<_> = tree.nodes.iter().map(|node| (node.parent, node.objective)).collect();
            rewire_tree(&frugal, &mut tree, start, &StopToken::default());
            let moved: Vec<_> = (0..before.len()).filter(|&n| tree.nodes[n].parent != before[n].0).collect();
            assert!(moved.len() <= 1, "the budget is one reconnection");
            assert!(moved.iter().all(|&n| tree.nodes[n].objective > before[n].1));
            reconnections += moved.len();
        }
    }
    assert!(reconnections > 10, "the trees had something to improve: {reconnections} reconnections");
}

#[test]
fn a_stopped_search_returns_the_best_path_so_far() {
    let (snapshot, settings) = small_block(1);
    let problem = Problem::new(&snapshot, &settings, panoramic());
    let stop = StopToken::default();
    let mut reported_m = 0.0;
    let outcome = search(&problem, root(&problem), 400, 7, &stop, &|_| 0, &mut |progress| {
        reported_m = progress.length_m;
        if progress.iteration == 25 {
            stop.stop();
        }
    })
    .expect("a stop is no error");
    assert_eq!(outcome.stop, StopReason::Cancelled);
    assert_eq!(outcome.convergence.len(), 25);
    let length_m: f64 = outcome.path.windows(2).map(|leg| (leg[1].position - leg[0].position).norm()).sum();
    assert!(length_m > 0.0 && (length_m - reported_m).abs() < 1e-6);
}

#[test]
fn a_sufficient_path_ends_the_search_and_reaches_the_goal() {
    let (snapshot, mut settings) = small_block(2);
    settings.coverage.goal_percent = 40.0;
    let problem = Problem::new(&snapshot, &settings, panoramic());
    let captured = |path: &[Pose]| brute_force(&problem, path).1;
    let never = StopToken::default();
    let outcome = search(&problem, root(&problem), 2000, 3, &never, &captured, &mut |_| {}).expect("the block can be flown");
    assert_eq!(outcome.stop, StopReason::GoalReached);
    let by_field = captured(&outcome.path);
    assert!(by_field >= problem.sufficient && problem.coverage_percent(by_field) > 40.0);
    assert!(outcome.convergence.len() < 2000);

    // Where every path falls three samples short of the field's promise, the tree has to promise three more.
    let sceptic = |path: &[Pose]| captured(path).saturating_sub(3);
    let outcome = search(&problem, root(&problem), 2000, 3, &never, &sceptic, &mut |_| {}).expect("the block can be flown");
    assert_eq!(outcome.stop, StopReason::GoalReached);
    assert!(captured(&outcome.path) >= problem.sufficient + 3);
}
