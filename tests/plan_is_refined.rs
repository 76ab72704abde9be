//! Local search: better than the tree at equal coverage, within its budget, and the same again from the number of its rounds.

mod support;

use std::sync::atomic::{AtomicU32, Ordering};

use overfly::camera::{Rig, View};
use overfly::coverage::SampleFrame;
use overfly::planner::{Method, Objective, PlanError, PlanOptions, StopToken, plan};
use overfly::search::Problem;
use overfly::session::Snapshot;
use overfly::settings::Settings;
use overfly::trajectory::plan::{Plan, StopReason};
use support::{session, small_block, small_settings, snapshot};

fn refined(rig: &str, rounds: u32) -> PlanOptions {
    PlanOptions { iterations: Some(rounds), ..PlanOptions::new(Rig::preset(rig).expect("a preset"), Method::Refined, 2) }
}

fn flown(snapshot: &Snapshot, settings: &Settings, options: &PlanOptions, stop: &StopToken) -> Plan {
    plan(snapshot, settings, options, stop, &mut |_| {}).expect("the block can be flown")
}

#[test]
fn at_the_coverage_of_the_tree_the_refined_flight_takes_a_fraction_of_its_time() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    for rig in ["panoramic", "phantom4-rtk", "m300-oblique"] {
        let tree = PlanOptions { method: Method::Paper, ..refined(rig, 400) };
        let tree = flown(&snapshot, &settings, &tree, &StopToken::default());
        // A little less, as the goal has to be exceeded.
        let goal_percent = tree.metrics.coverage_percent - 0.5;
        let refined = flown(
            &snapshot,
            &settings,
            &PlanOptions { goal_percent: Some(goal_percent), ..refined(rig, 240) },
            &StopToken::default(),
        );
        assert_eq!(refined.stop, StopReason::GoalReached, "{rig}");
        assert!(refined.metrics.coverage_percent >= goal_percent, "{rig}: {:?}", refined.metrics);
        let ratio = refined.metrics.profile_s / tree.metrics.profile_s;
        assert!(ratio < 0.7, "{rig}: {ratio} of {:?}", tree.metrics);
        assert_eq!(refined.convergence.len(), 240);
    }
}

/// What share of the surface that can be matched at all is in at least three views with a partner 5 to 45 degrees apart, by every pair of images.
fn matched_percent(snapshot: &Snapshot, settings: &Settings, plan: &Plan, rig: &Rig) -> f64 {
    let problem = Problem::new(snapshot, settings, rig.clone());
    let views: Vec<_> = plan.images.iter().map(|image| (image.position_m, image.view())).collect();
    let is_matched = |frame: &SampleFrame| {
        let end = frame.position + frame.normal * snapshot.offset_m;
        let sees = |(position, view): &&(_, Option<View>)| {
            problem.disks.exact_mask(frame, position) != 0
                && view.as_ref().is_none_or(|view| view.frames(&frame.position))
                && !snapshot.free.clearance.occluded(position, &end)
        };
        let seen: Vec<_> = views.iter().filter(sees).map(|(position, _)| position - frame.position).collect();
        let has_partner = |a: &&nalgebra::Vector3<f64>| seen.iter().any(|b| (5.0..=45.0).contains(&a.angle(b).to_degrees()));
        seen.iter().filter(has_partner).count() >= 3
    };
    let matchable: Vec<_> = (problem.frames.iter().zip(&problem.matchable)).filter(|(_, matchable)| **matchable).collect();
    let matched = matchable.iter().filter(|(frame, _)| is_matched(frame)).count();
    100.0 * matched as f64 / matchable.len() as f64
}

#[test]
fn the_wanted_share_of_the_surface_is_seen_in_three_views_that_match() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    for (rig, goals) in [("phantom4-rtk", [30.0, 80.0]), ("m300-oblique", [60.0, 95.0])] {
        let mut times_s = Vec::new();
        for goal_percent in goals {
            let options = PlanOptions { goal_percent: Some(0.0), matched_percent: Some(goal_percent), ..refined(rig, 160) };
            let plan = flown(&snapshot, &settings, &options, &StopToken::default());
            let metrics = &plan.metrics;
            assert_eq!((plan.stop, plan.matched_goal_percent), (StopReason::GoalReached, goal_percent), "{rig}: {metrics:?}");
            assert!(metrics.matched_percent > goal_percent, "{rig}: {metrics:?}");
            // Angles are rounded to a hundredth of a degree: a sample or two may differ.
            let really = matched_percent(&snapshot, &settings, &plan, &options.rig);
            assert!((metrics.matched_percent - really).abs() < 0.5, "{rig}: {} and {really}", metrics.matched_percent);
            times_s.push(metrics.profile_s);
        }
        assert!(times_s[0] < times_s[1], "{rig}: more takes longer: {times_s:?}");
    }
    let of_tree = PlanOptions { method: Method::Paper, matched_percent: Some(50.0), ..refined("panoramic", 10) };
    assert_eq!(of_tree.check(), Err(PlanError::NoMatches { method: "paper" }));
    for wrong in [-1.0, 100.5, f64::NAN] {
        let options = PlanOptions { matched_percent: Some(wrong), ..refined("panoramic", 10) };
        assert!(matches!(options.check(), Err(PlanError::Goal { .. })), "{wrong}");
    }
}

#[test]
fn a_flight_refined_for_the_paper_s_objective_has_more_of_it_than_the_tree_s() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    for rig in ["panoramic", "phantom4-rtk"] {
        let tree = PlanOptions { method: Method::Paper, ..refined(rig, 400) };
        // A goal that ends no search: the tree goes on for its objective.
        let tree = PlanOptions { goal_percent: Some(100.0), ..tree };
        let tree = flown(&snapshot, &settings, &tree, &StopToken::default());
        let eq6 = PlanOptions { objective: Objective::Eq6, ..refined(rig, 160) };
        let eq6 = flown(&snapshot, &settings, &eq6, &StopToken::default());
        assert!(eq6.metrics.objective > tree.metrics.objective, "{rig}: {:?} against {:?}", eq6.metrics, tree.metrics);
        assert_eq!((eq6.stop, eq6.matched_goal_percent), (StopReason::IterationsUsed, 0.0));
    }
    for wrong in [
        PlanOptions { method: Method::Paper, ..refined("panoramic", 10) },
        PlanOptions { goal_percent: Some(50.0), ..refined("panoramic", 10) },
        PlanOptions { within_s: Some(50.0), ..refined("panoramic", 10) },
    ] {
        assert_eq!(PlanOptions { objective: Objective::Eq6, ..wrong }.check(), Err(PlanError::Eq6));
    }
}

#[test]
fn a_budget_of_seconds_decides_on_the_number_of_rounds_and_on_nothing_else() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    // The least number of hot rounds, and more of them.
    for (seconds, expected) in [(3.0, 20..40), (15.0, 120..200)] {
        // A clock that runs by a tenth of a second whenever somebody looks.
        let looks = AtomicU32::new(0);
        let stop = StopToken::timed(move || f64::from(looks.fetch_add(1, Ordering::Relaxed)) * 0.1);
        let timed = PlanOptions { iterations: None, budget_s: Some(seconds), ..refined("phantom4-rtk", 0) };
        let timed = flown(&snapshot, &settings, &timed, &stop);
        let rounds = timed.convergence.len() as u32;
        assert!(expected.contains(&rounds), "{rounds} in {seconds} s");
        assert_eq!(timed, flown(&snapshot, &settings, &refined("phantom4-rtk", rounds), &StopToken::default()));
    }
    let untimed = PlanOptions { iterations: None, budget_s: Some(0.55), ..refined("phantom4-rtk", 0) };
    assert_eq!(plan(&snapshot, &settings, &untimed, &StopToken::default(), &mut |_| {}), Err(PlanError::NoClock));
}

#[test]
fn a_stopped_refinement_is_the_best_flight_so_far() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    let stop = StopToken::default();
    let stopped = plan(&snapshot, &settings, &refined("phantom4-rtk", 100_000), &stop, &mut |progress| {
        if progress.iteration == 5 {
            stop.stop();
        }
    })
    .expect("a stopped search has a plan");
    assert_eq!((stopped.stop, stopped.convergence.len()), (StopReason::Cancelled, 5));
    assert!(stopped.metrics.coverage_percent > 10.0);
}

#[test]
fn only_what_lies_in_the_region_counts() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    let region_m = Some(vec![[-200.0, -200.0], [0.0, -200.0], [0.0, 200.0], [-200.0, 200.0]]);
    let west = flown(&snapshot, &settings, &PlanOptions { region_m, ..refined("panoramic", 160) }, &StopToken::default());
    let field = snapshot.field();
    let threshold = field.facts.threshold_cells;
    for (i, row) in field.samples.iter().enumerate() {
        assert!(!west.is_capturable(i, threshold) || row.position_m[0] <= 0.0, "sample {i} at {:?}", row.position_m);
    }
    let capturable = (0..field.samples.len()).filter(|&i| west.is_capturable(i, threshold)).count();
    assert!(capturable > 20);
    let captured = (0..field.samples.len()).filter(|&i| west.is_capturable(i, threshold) && u32::from(west.cells[i]) > threshold);
    assert_eq!(west.metrics.coverage_percent, 100.0 * captured.count() as f64 / capturable as f64);
}

#[test]
fn a_sampling_distance_brings_the_images_near() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(6), &settings));
    let rig = Rig::preset("phantom4-rtk").expect("a preset");
    let gsd_m = 0.006;
    let near_m = gsd_m / rig.pixel_rad(0);
    assert!(near_m < 0.5 * settings.coverage.range_m);
    let near =
        flown(&snapshot, &settings, &PlanOptions { gsd_m: Some(gsd_m), ..refined("phantom4-rtk", 160) }, &StopToken::default());
    let far = flown(&snapshot, &settings, &refined("phantom4-rtk", 160), &StopToken::default());
    assert!(near.metrics.capturable_percent < far.metrics.capturable_percent && near.metrics.coverage_percent > 50.0);
    // What is covered is covered from near by.
    let field = snapshot.field();
    let captured: Vec<usize> = (0..field.samples.len()).filter(|&i| near.cells[i] > 0).collect();
    assert!(captured.len() > 20);
    for i in captured {
        let sample = nalgebra::Point3::from(field.samples[i].position_m);
        let nearest_m = near.images.iter().map(|image| (image.position_m - sample).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest_m <= near_m, "sample {i} is {nearest_m} m from the nearest image");
    }
}
