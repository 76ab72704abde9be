//! One seed and budget give one plan, bit for bit, on any number of threads.

mod support;

use overfly::camera::Rig;
use overfly::planner::{Method, Objective, PlanOptions, StopToken, plan};
use overfly::trajectory::plan::Plan;
use support::{options, rigs, session, small_block, small_settings, snapshot};

fn plan_on(threads: usize, options: &PlanOptions) -> (Vec<overfly_table::Block>, Plan) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
    pool.install(|| {
        let settings = small_settings();
        let snapshot = snapshot(&session(small_block(8), &settings));
        let plan = plan(&snapshot, &settings, options, &StopToken::default(), &mut |_| {}).expect("the block can be flown");
        (snapshot.storage().blocks().to_vec(), plan)
    })
}

fn with_rig(rig: Rig) -> PlanOptions {
    PlanOptions { iterations: Some(80), ..PlanOptions::new(rig, Method::Paper, 11) }
}

#[test]
fn field_and_plan_are_the_same_on_one_two_and_five_threads() {
    for options in rigs().into_iter().map(with_rig) {
        let reference = plan_on(1, &options);
        assert!(reference.1.waypoints.len() > 3 && reference.1.metrics.coverage_percent > 1.0, "{:?}", reference.1.metrics);
        assert_eq!(plan_on(2, &options), reference, "{}", options.rig.name);
        assert_eq!(plan_on(5, &options), reference, "{}", options.rig.name);
    }
}

#[test]
fn every_aim_of_the_refinement_gives_the_same_plan_on_one_two_and_five_threads() {
    for rig in ["phantom4-rtk", "m300-oblique"] {
        let rig = Rig::preset(rig).expect("a preset");
        let default = PlanOptions { iterations: Some(12), ..PlanOptions::new(rig, Method::Refined, 11) };
        let aims = [
            default.clone(),
            PlanOptions { goal_percent: Some(60.0), matched_percent: Some(80.0), ..default.clone() },
            PlanOptions { objective: Objective::Eq6, ..default.clone() },
            PlanOptions { overlap_percent: Some(80.0), ..default.clone() },
        ];
        let plans: Vec<Plan> = aims.iter().map(|options| plan_on(1, options).1).collect();
        for (options, reference) in aims.iter().zip(&plans) {
            assert!(reference.waypoints.len() > 3 && reference.metrics.coverage_percent > 1.0, "{:?}", reference.metrics);
            for threads in [2, 5] {
                assert_eq!(&plan_on(threads, options).1, reference, "{threads} threads: {options:?}");
            }
        }
        // Each aim is one of its own.
        assert!((1..plans.len()).all(|k| plans[..k].iter().all(|other| other.waypoints != plans[k].waypoints)));
    }
}

#[test]
fn all_rigs_plan_on_one_and_the_same_field() {
    let fields: Vec<_> = rigs().into_iter().map(|rig| plan_on(2, &with_rig(rig)).0).collect();
    assert!(fields.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn another_seed_gives_another_plan_on_the_same_field() {
    let (field, first) = plan_on(2, &options(11, 120));
    let (same_field, second) = plan_on(2, &options(12, 120));
    assert_eq!(field, same_field);
    assert_ne!(first.waypoints, second.waypoints);
}
