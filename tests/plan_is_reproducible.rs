//! One seed and budget give one plan, bit for bit, on any number of threads.

mod support;

use overfly::planner::{StopToken, plan};
use overfly::trajectory::plan::Plan;
use support::{options, session, small_block, small_settings, snapshot};

fn plan_on(threads: usize, seed: u64) -> (Vec<overfly_table::Block>, Plan) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
    pool.install(|| {
        let settings = small_settings();
        let snapshot = snapshot(&session(small_block(8), &settings));
        let plan =
            plan(&snapshot, &settings, &options(seed, 120), &StopToken::default(), &mut |_| {}).expect("the block can be flown");
        (snapshot.storage().blocks().to_vec(), plan)
    })
}

#[test]
fn field_and_plan_are_the_same_on_one_two_and_five_threads() {
    let reference = plan_on(1, 11);
    assert_eq!(plan_on(2, 11), reference);
    assert_eq!(plan_on(5, 11), reference);
}

#[test]
fn another_seed_gives_another_plan_on_the_same_field() {
    let (field, first) = plan_on(2, 11);
    let (same_field, second) = plan_on(2, 12);
    assert_eq!(field, same_field);
    assert_ne!(first.waypoints, second.waypoints);
}
