//! The images selected for the reconstruction capture what the plan needs, and none of them in vain (section 5.3).

mod support;

use overfly::field::Snapshot;
use overfly::planner::{Method, PlanOptions, StopToken, plan};
use overfly::search::Problem;
use overfly::settings::Settings;
use overfly::trajectory::evaluate::{Sighting, Sightings, sightings};
use overfly::trajectory::plan::Plan;
use overfly::trajectory::select::select;
use support::{rigs, session, small_block, small_settings, snapshot};

/// Plans by every rig; `judge` sees each with its exact lines of sight.
fn for_every_rig(settings: &Settings, iterations: u32, mut judge: impl FnMut(&Problem, &Plan, &Sightings)) {
    let snapshot: Snapshot = snapshot(&session(small_block(2), settings));
    for rig in rigs() {
        let options = PlanOptions { iterations: Some(iterations), ..PlanOptions::new(rig.clone(), Method::Paper, 4) };
        let plan = plan(&snapshot, settings, &options, &StopToken::default(), &mut |_| {}).expect("the block can be flown");
        let problem = Problem::new(&snapshot, settings, rig);
        let sightings = sightings(&snapshot, &snapshot.disks, &plan.images, &StopToken::default()).expect("nobody stops it");
        judge(&problem, &plan, &sightings);
    }
}

/// Covered cells of each sample after the images of `chosen`.
fn covered(sightings: &Sightings, chosen: &[usize]) -> Vec<u128> {
    let of = |seen: &Vec<Sighting>| {
        seen.iter().filter(|one| chosen.contains(&(one.image as usize))).fold(0, |union, one| union | one.mask)
    };
    sightings.0.iter().map(of).collect()
}

fn captured(problem: &Problem, covered: &[u128]) -> u32 {
    let threshold = problem.field.facts.threshold_cells;
    (0..covered.len()).filter(|&i| problem.is_capturable(i) && covered[i].count_ones() > threshold).count() as u32
}

/// Area-weighted cells (Eq. 2).
fn information(problem: &Problem, covered: &[u128]) -> u64 {
    covered.iter().zip(problem.field.samples).map(|(mask, row)| u64::from(mask.count_ones()) * row.area_mm2).sum()
}

/// Greedy selection that looks at every image in every round; in the order in which it selects.
fn naive(problem: &Problem, sightings: &Sightings, images: usize) -> Vec<usize> {
    let all: Vec<usize> = (0..images).collect();
    let goal = captured(problem, &covered(sightings, &all)).min(problem.sufficient);
    let mut chosen = Vec::new();
    let mut held = covered(sightings, &chosen);
    while captured(problem, &held) < goal {
        let before = information(problem, &held);
        let gain = |image: usize| information(problem, &covered(sightings, &[chosen.as_slice(), &[image]].concat())) - before;
        let (gain, image) = all.iter().map(|&image| (gain(image), image)).rev().max_by_key(|&(gain, _)| gain).expect("images");
        assert!(gain > 0, "the goal cannot be reached with images that gain nothing");
        chosen.push(image);
        held = covered(sightings, &chosen);
    }
    chosen
}

#[test]
fn the_selection_is_that_of_a_greedy_that_looks_at_every_image_every_time() {
    for_every_rig(&small_settings(), 20, |problem, plan, sightings| {
        let expected = naive(problem, sightings, plan.images.len());
        let selected = select(problem, sightings, plan.images.len(), 0);
        let found: Vec<usize> = (0..selected.len()).filter(|&image| selected[image]).collect();
        let mut sorted = expected.clone();
        sorted.sort_unstable();
        assert_eq!(found, sorted, "{}", plan.rig);
        // One image less, and something is missing.
        let goal = captured(problem, &covered(sightings, &expected));
        let without_last = &expected[..expected.len().saturating_sub(1)];
        assert!(expected.is_empty() || captured(problem, &covered(sightings, without_last)) < goal);
    });
}

#[test]
fn selected_images_reach_the_goal_where_all_images_reach_it_and_else_capture_as_much() {
    for goal_percent in [30.0, 100.0] {
        let mut settings = small_settings();
        settings.coverage.goal_percent = goal_percent;
        let mut reached = 0;
        for_every_rig(&settings, 150, |problem, plan, sightings| {
            let chosen: Vec<usize> = (0..plan.images.len()).filter(|&image| plan.images[image].selected).collect();
            let all: Vec<usize> = (0..plan.images.len()).collect();
            let (by_all, by_selected) =
                (captured(problem, &covered(sightings, &all)), captured(problem, &covered(sightings, &chosen)));
            assert!(by_selected >= by_all.min(problem.sufficient), "{by_selected} of {by_all} by {}", plan.rig);
            assert!(chosen.len() == plan.selected_images() && chosen.len() < all.len(), "{} of {}", chosen.len(), all.len());
            reached += usize::from(by_all >= problem.sufficient);
        });
        assert!(goal_percent > 50.0 || reached > 0, "no plan reached {goal_percent} %");
    }
}

/// Samples that the chosen images show in enough views that match.
fn matched(problem: &Problem, sightings: &Sightings, chosen: &[usize]) -> u32 {
    sightings.capture(problem, |image| chosen.contains(&(image as usize))).matched
}

#[test]
fn selected_images_match_as_much_as_is_wanted_and_none_of_those_kept_for_it_can_go() {
    let mut kept = 0;
    for_every_rig(&small_settings(), 60, |problem, plan, sightings| {
        let chosen = |selected: Vec<bool>| -> Vec<usize> { (0..selected.len()).filter(|&image| selected[image]).collect() };
        let all: Vec<usize> = (0..plan.images.len()).collect();
        let by_all = matched(problem, sightings, &all);
        let for_coverage = chosen(select(problem, sightings, plan.images.len(), 0));
        assert!(by_all > 0, "{}", plan.rig);
        for wanted in [by_all / 2, by_all, by_all + 1] {
            let found = chosen(select(problem, sightings, plan.images.len(), wanted));
            assert!(for_coverage.iter().all(|image| found.contains(image)), "{}", plan.rig);
            let goal = wanted.min(by_all);
            assert!(matched(problem, sightings, &found) >= goal, "{}: {wanted} of {by_all}", plan.rig);
            for extra in found.iter().filter(|image| !for_coverage.contains(image)) {
                let without: Vec<usize> = found.iter().copied().filter(|image| image != extra).collect();
                assert!(matched(problem, sightings, &without) < goal, "{}: image {extra} could go", plan.rig);
                kept += 1;
            }
        }
    });
    assert!(kept > 0, "what captures matched as much by itself with every rig");
}
