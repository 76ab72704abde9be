//! The first safe plan after an edit comes before the edit is made: what becomes of it then.

mod served;

use std::time::Duration;

use overfly_client::{EditOrder, PlanOrder, RefusalCode};
use overfly_table::plan::SAFE;
use served::{PATIENCE, Served, block, load, quick, refusal, wait_for};

#[test]
fn a_plan_for_an_edit_that_is_not_made_is_taken_back() {
    let mut served = Served::start();
    let client = served.client();
    let scenes = (0..40).map(|seed| client.load(block(seed, 9), Some(&format!("block-{seed}")), &mut |_| {}).unwrap());
    let taken = scenes.scan(0, |bytes, loaded| {
        *bytes += loaded.field_bytes;
        Some(*bytes)
    });
    assert!(taken.take_while(|bytes| *bytes < 1_000_000).count() < 40, "one megabyte is less than these fields take");
    let plan = client.plan("block-0", &quick(), &mut |_| {}).unwrap();
    // The budget is reached, so that the next field is refused.
    std::fs::write(&served.config, "[daemon]\nmemory_budget_mb = 1\n").unwrap();
    served.signal("-HUP");
    wait_for("the smaller budget", || (client.status().unwrap().budget_bytes == 1_000_000).then_some(()));
    let watch = client.watch("block-0").unwrap();
    let structure = client.structures("block-0").unwrap()[0].name.clone();
    let raise = EditOrder::Raise { structure, by_m: 1.0 };
    assert_eq!(refusal(client.edit("block-0", &raise)).0, RefusalCode::Memory);
    let [safe, back] = [(); 2].map(|()| watch.next(PATIENCE).unwrap().expect("a plan"));
    assert_eq!((safe.table().facts.stop, safe.table().facts.revision), (SAFE, 2));
    assert_eq!(back.table().facts.revision, 1);
    assert!(back.table().waypoints == plan.table().waypoints && back.table().cells == plan.table().cells);
    assert!(plan.epoch() < safe.epoch() && safe.epoch() < back.epoch() && back.asked_by() == (0, 0));
    let summary = client.status().unwrap().scenes.into_iter().find(|scene| scene.name == "block-0").and_then(|scene| scene.plan);
    assert!(summary.is_some_and(|plan| plan.revision == 1 && !plan.is_stale && plan.coverage_percent > 0.0));
    // With room for it the edit is made, and followed by plans of the revision that was taken back.
    std::fs::write(&served.config, "[daemon]\nmemory_budget_mb = 500\n").unwrap();
    served.signal("-HUP");
    wait_for("the larger budget", || (client.status().unwrap().budget_bytes == 500_000_000).then_some(()));
    let edited = client.edit("block-0", &raise).unwrap();
    assert_eq!((edited.revision, client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap().table().facts.revision), (2, 2));
    client.stop().unwrap();
    assert!(served.ended().success());
}

#[test]
fn a_search_in_the_scene_before_publishes_nothing_behind_the_first_safe_plan() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let order = PlanOrder { iterations: Some(60), goal_percent: Some(90.0), ..Default::default() };
    client.plan("block", &order, &mut |_| {}).unwrap();
    let watch = client.watch("block").unwrap();
    let structure = client.structures("block").unwrap()[0].name.clone();
    let mut revisions = Vec::new();
    // Each edit comes while the search after the one before hands out one plan after the other.
    for number in 0..80u64 {
        let raise = EditOrder::Raise { structure: structure.clone(), by_m: 0.25 };
        let lower = EditOrder::Lower { structure: structure.clone(), by_m: 0.25 };
        client.edit("block", if number % 2 == 0 { &raise } else { &lower }).unwrap();
        std::thread::sleep(Duration::from_millis(number * 7 % 40));
        while let Some(plan) = watch.next(Duration::ZERO).unwrap() {
            revisions.push(plan.table().facts.revision);
        }
    }
    assert!(revisions.len() > 80 && revisions.is_sorted(), "{revisions:?}");
}
