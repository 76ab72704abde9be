//! The units of the objective rest on the generated scene of NY-1's published size.

mod support;

use std::collections::BinaryHeap;

use overfly::camera::{Pose, Rig};
use overfly::coverage::{Mask, Observations};
use overfly::scene::{generate_block, ny1_size};
use overfly::search::Problem;
use overfly::session::Snapshot;
use overfly::settings::Settings;

fn reference(settings: &Settings) -> Snapshot {
    support::snapshot(&support::session(generate_block(&ny1_size()), settings))
}

#[test]
fn the_reference_area_of_the_settings_is_that_of_the_generated_scene() {
    let settings = Settings::default();
    let measured = reference(&settings).field().facts.reference_area_m2;
    let assumed = settings.objective.reference_area_m2;
    // The units bear a few percent; they must be those of this scene and of no other.
    assert!((measured / assumed - 1.0).abs() < 0.04, "the scene has {measured} m^2 exposed, the settings say {assumed}");
}

#[test]
fn the_generated_scene_takes_as_many_views_as_the_paper_s() {
    let settings = Settings::default();
    let snapshot = reference(&settings);
    let problem = Problem::new(&snapshot, &settings, Rig::preset("phantom4-rtk").expect("a preset"));
    let views = greedy_cover(&problem);
    // Table 3: 248 after Zhou 2020, 252 with the paper's own method.
    assert!((220..=280).contains(&views), "{views} free views reach the goal");
}

/// How many views, anywhere and in any direction, a greedy choice takes to reach the goal: always the view that brings the capturable
/// samples nearest to their thresholds.
fn greedy_cover(problem: &Problem) -> usize {
    let mut scratch = problem.scratch();
    let mut see = |position_m: [f64; 3]| -> Vec<Observations> {
        let poses = problem.rig.pose_directions().into_iter().map(|direction| Pose { position: position_m.into(), direction });
        poses.map(|pose| problem.observe_pose(&pose, &mut scratch)).collect()
    };
    let views: Vec<Observations> = problem.field.viewpoints.iter().flat_map(|row| see(row.position_m)).collect();
    let enough = problem.field.facts.threshold_cells + 1;
    let short_of = |mask: Mask| enough.saturating_sub(mask.count_ones());
    let mut covered: Vec<Mask> = vec![0; problem.field.samples.len()];
    let brings = |covered: &[Mask], seen: &Observations| -> u32 {
        let capturable = seen.iter().filter(|&(i, _)| problem.is_capturable(i));
        capturable.map(|(i, mask)| short_of(covered[i]) - short_of(covered[i] | mask)).sum()
    };
    let mut queue: BinaryHeap<(u32, usize)> = (0..views.len()).map(|view| (u32::MAX, view)).collect();
    let (mut captured, mut chosen) = (0, 0);
    while captured < problem.sufficient {
        let (promised, view) = queue.pop().expect("all views together reach the goal");
        let fresh = brings(&covered, &views[view]);
        if fresh < promised && queue.peek().is_some_and(|next| next.0 > fresh) {
            queue.push((fresh, view));
            continue;
        }
        captured += problem.cover(&mut covered, &views[view]).captured;
        chosen += 1;
    }
    chosen
}
