//! The tree against brute force.

use std::sync::Arc;

use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;

use super::leg::image_poses;
use super::objective::PathSums;
use super::outcome::StopReason;
use super::problem::Problem;
use super::rrt_star::{expand, rewire_tree, search};
use super::tree::Tree;
use crate::camera::{Pose, Rig};
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

fn root(problem: &Problem) -> Pose {
    Pose { position: problem.field.viewpoints[0].position_m.into(), direction: None }
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
        image_poses(&problem.rig, &leg[0], &leg[1], problem.image_spacing_m).for_each(|pose| see(&mut covered, &pose));
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
    let captured = (0..covered.len()).filter(|&i| cells(i) > threshold && u32::from(problem.field.ceilings[i]) > threshold);
    (sums, captured.count() as u32, covered)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn every_node_agrees_with_its_path_recomputed_from_nothing(seed in 0u64..1000) {
        let (snapshot, settings) = small_block(seed % 3);
        let problem = Problem::new(&snapshot, &settings, panoramic());
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
            prop_assert_eq!(&node.covered, &covered);
            prop_assert!((node.sums.length_m - sums.length_m).abs() < 1e-6);
            prop_assert!((node.sums.turning_s - sums.turning_s).abs() < 1e-6);
            prop_assert!((node.objective - problem.objective.value(&sums)).abs() < 1e-6);
            prop_assert!(path.windows(2).all(|leg| problem.can_fly(&leg[0].position, &leg[1].position)));
        }
    }

    #[test]
    fn no_leg_gains_more_than_its_upper_bound(seed in 0u64..1000) {
        let (snapshot, settings) = small_block(seed % 3);
        let problem = Problem::new(&snapshot, &settings, panoramic());
        let tree = grown(&problem, seed, 30);
        let (nothing, mut scratch) = (vec![0; problem.field.samples.len()], problem.scratch());
        for (a, b) in tree.nodes.iter().flat_map(|a| tree.nodes.iter().map(move |b| (&a.pose, &b.pose))) {
            let seen = problem.observe_leg(a, b, &mut scratch);
            prop_assert!(problem.gain(&nothing, &seen) <= problem.most_of_leg(&a.position, &b.position));
        }
    }
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
