//! After an edit a flight goes on with the one before: what can still be flown comes first, safe and with most of what it captured.

mod support;

use std::sync::atomic::{AtomicU32, Ordering};

use overfly::camera::{Pose, Rig};
use overfly::planner::{Conduct, Made, Method, PlanOptions, Progress, StopToken, look, plan, replan};
use overfly::session::{Session, Snapshot};
use overfly::settings::Settings;
use overfly::trajectory::plan::{Plan, StopReason};
use overfly::trajectory::safety;
use proptest::prelude::*;
use support::{pillar_on, repaired, rigs, session, small_block, small_settings, snapshot, snapshot_after};

fn options(rig: &Rig, rounds: u32) -> PlanOptions {
    PlanOptions { iterations: Some(rounds), ..PlanOptions::new(rig.clone(), Method::Refined, 5) }
}

fn poses(plan: &Plan) -> Vec<Pose> {
    plan.waypoints.iter().map(|waypoint| Pose { position: waypoint.position_m, direction: waypoint.direction }).collect()
}

/// The plans that came before the last one, the repaired one first, and the last one.
fn planned(snapshot: &Snapshot, settings: &Settings, options: &PlanOptions) -> (Vec<Plan>, Plan) {
    let mut interim = Vec::new();
    let on_interim = &mut |made: Made| interim.push(made.plan);
    let stop = &StopToken::default();
    let conduct = Conduct { on_interim, ..Conduct::unheard(stop) };
    let made = replan(snapshot, settings, options, None, conduct).expect("it can be flown");
    let expected = |k: usize| if k == 0 { StopReason::Repaired } else { StopReason::Improved };
    assert!(interim.iter().enumerate().all(|(k, plan)| plan.stop == expected(k)));
    (interim, made.plan)
}

fn is_safe(plan: &Plan, snapshot: &Snapshot) -> bool {
    let profile = plan.profile().expect("a plan says how it was timed");
    safety::check(profile.curve(), &snapshot.free).is_ok()
}

#[test]
fn a_flight_that_an_edit_blocks_is_flown_around_it_and_then_improved() {
    let settings = small_settings();
    for rig in rigs() {
        let mut edited: Session = session(small_block(2), &settings);
        let before = snapshot(&edited);
        let first = plan(&before, &settings, &options(&rig, 60), &StopToken::default(), &mut |_| {}).unwrap();
        edited.apply(&pillar_on(&first, 0)).expect("there is room for a pillar");
        let after = snapshot_after(&edited, &before);
        assert!(!is_safe(&first, &after), "{}: the pillar stands on the flight", rig.name);

        let again = PlanOptions { earlier: Some(poses(&first)), ..options(&rig, 10) };
        let (interim, second) = planned(&after, &settings, &again);
        let repaired = interim.first().expect("most of the flight is left");
        for plan in interim.iter().chain([&second]) {
            assert!(is_safe(plan, &after) && plan.scene.revision == 2, "{}", rig.name);
        }
        let (old, new) = (first.metrics.coverage_percent, repaired.metrics.coverage_percent);
        assert!(new > 0.9 * old, "{}: {new} % of {old} % are left", rig.name);
        // Most waypoints are those that were there before.
        let kept = repaired.waypoints.iter().filter(|w| first.waypoints.iter().any(|old| old.position_m == w.position_m)).count();
        assert!(kept * 10 >= first.waypoints.len() * 8, "{}: {kept} of {}", rig.name, first.waypoints.len());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn whatever_is_edited_the_repaired_flight_is_safe_and_the_same_on_any_number_of_threads(
        seed in 0u64..1000, rig in proptest::sample::select(rigs()), edits in 1usize..4,
    ) {
        use rand_core::SeedableRng;
        let settings = small_settings();
        let mut edited = session(small_block(seed % 5), &settings);
        let before = snapshot(&edited);
        let first = plan(&before, &settings, &options(&rig, 20), &StopToken::default(), &mut |_| {}).unwrap();
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        for _ in 0..edits {
            let edit = support::random_edit(edited.scene(), &mut random);
            let _ = edited.apply(&edit);
        }
        let after = snapshot_after(&edited, &before);
        let again = PlanOptions { earlier: Some(poses(&first)), ..options(&rig, 4) };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| planned(&after, &settings, &again))
        };
        let (interim, second) = on(1);
        prop_assert!(interim.iter().chain([&second]).all(|plan| is_safe(plan, &after)));
        prop_assert_eq!(on(3), (interim, second));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn what_the_images_saw_before_an_edit_changes_nothing_but_the_time(seed in 0u64..1000, rig in proptest::sample::select(rigs()), edits in 3usize..9) {
        use rand_core::SeedableRng;
        let settings = small_settings();
        let mut edited = session(small_block(seed % 5), &settings);
        let mut latest = snapshot(&edited);
        let first = options(&rig, 12);
        let mut made = replan(&latest, &settings, &first, None, Conduct::unheard(&StopToken::default())).unwrap();
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        for number in 0..edits {
            let edit = if number % 3 == 0 { pillar_on(&made.plan, number) } else { support::random_edit(edited.scene(), &mut random) };
            if edited.apply(&edit).is_err() {
                continue;
            }
            let after = snapshot_after(&edited, &latest);
            let again = PlanOptions { earlier: Some(poses(&made.plan)), ..options(&rig, 1) };
            let anew = repaired(&after, &settings, &again, None);
            let followed = repaired(&after, &settings, &again, Some(made.record));
            prop_assert_eq!(anew.as_ref().map(|made| &made.plan), followed.as_ref().map(|made| &made.plan));
            match followed {
                Some(repaired) => (latest, made) = (after, repaired),
                None => break,
            }
        }
    }
}

#[test]
fn no_flight_is_worse_than_one_that_came_before() {
    let settings = small_settings();
    let mut were_enough = 0;
    for (seed, rig) in (0..2).flat_map(|seed| rigs().into_iter().map(move |rig| (seed, rig))) {
        let mut edited: Session = session(small_block(seed), &settings);
        let before = snapshot(&edited);
        let with_goals =
            |rounds: u32| PlanOptions { goal_percent: Some(60.0), matched_percent: Some(50.0), ..options(&rig, rounds) };
        let first = plan(&before, &settings, &with_goals(40), &StopToken::default(), &mut |_| {}).unwrap();
        edited.apply(&pillar_on(&first, 0)).expect("there is room for a pillar");
        let after = snapshot_after(&edited, &before);
        let (interim, last) = planned(&after, &settings, &PlanOptions { earlier: Some(poses(&first)), ..with_goals(24) });
        let is_enough = |plan: &Plan| plan.metrics.coverage_percent > 60.0 && plan.metrics.matched_percent > 50.0;
        let flights: Vec<&Plan> = interim.iter().chain([&last]).collect();
        for pair in flights.windows(2).filter(|pair| is_enough(pair[0])) {
            assert!(is_enough(pair[1]) && pair[1].metrics.profile_s <= pair[0].metrics.profile_s, "{} {seed}", rig.name);
            were_enough += 1;
        }
    }
    assert!(were_enough > 12, "{were_enough}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10))]
    #[test]
    fn a_flight_on_the_way_captures_what_it_does_when_all_its_images_are_looked_at_anew(seed in 0u64..1000, rig in proptest::sample::select(rigs())) {
        let settings = small_settings();
        let mut edited = session(small_block(seed % 5), &settings);
        let before = snapshot(&edited);
        let first = plan(&before, &settings, &options(&rig, 20), &StopToken::default(), &mut |_| {}).unwrap();
        edited.apply(&pillar_on(&first, 0)).expect("there is room for a pillar");
        let after = snapshot_after(&edited, &before);
        let with_goals = PlanOptions { goal_percent: Some(80.0), earlier: Some(poses(&first)), ..options(&rig, 30) };
        let (interim, _) = planned(&after, &settings, &with_goals);
        for plan in interim {
            let (looked_at, _) = look(&after, &settings, &with_goals, plan.clone(), &StopToken::default()).unwrap();
            prop_assert_eq!(looked_at.cells, plan.cells, "{:?}", plan.stop);
        }
    }
}

/// Rounds in which a flight is mended, at most, and in how many of the annealing nothing is handed out yet.
const MENDING_ROUNDS: u32 = 18;

#[test]
fn what_an_edit_takes_is_had_again_before_the_flight_is_annealed() {
    let settings = small_settings();
    let rig = Rig::preset("panoramic").unwrap();
    let (mut were_short, mut were_mended) = (0, 0);
    for seed in 0..8 {
        let mut edited: Session = session(small_block(seed), &settings);
        let before = snapshot(&edited);
        let with_goals =
            |rounds: u32| PlanOptions { goal_percent: Some(85.0), matched_percent: Some(80.0), ..options(&rig, rounds) };
        let first = plan(&before, &settings, &with_goals(40), &StopToken::default(), &mut |_| {}).unwrap();
        edited.apply(&pillar_on(&first, 0)).expect("there is room for a pillar");
        let after = snapshot_after(&edited, &before);
        let (stop, rounds) = (StopToken::default(), AtomicU32::new(0));
        let mut enough_after = Vec::new();
        let again = PlanOptions { earlier: Some(poses(&first)), ..with_goals(1000) };
        let on_progress = &mut |_: &Progress| {
            if rounds.fetch_add(1, Ordering::Relaxed) >= MENDING_ROUNDS {
                stop.stop();
            }
        };
        let on_interim = &mut |Made { plan, .. }: Made| {
            let is_enough = plan.metrics.coverage_percent > 85.0 && plan.metrics.matched_percent > 80.0;
            enough_after.push((rounds.load(Ordering::Relaxed), is_enough));
        };
        replan(&after, &settings, &again, None, Conduct { on_progress, on_interim, ..Conduct::unheard(&stop) }).unwrap();
        if enough_after.first().is_some_and(|&(_, is_enough)| !is_enough) {
            were_short += 1;
            were_mended += u32::from(enough_after.iter().any(|&(rounds, is_enough)| is_enough && rounds <= MENDING_ROUNDS));
        }
    }
    assert!(were_short >= 2 && were_mended * 3 >= were_short * 2, "{were_mended} of {were_short}");
}

#[test]
fn a_search_stands_back_only_while_its_first_safe_plan_is_flown() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(2), &settings));
    let cold = options(&Rig::preset("panoramic").unwrap(), 4);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "behind".into()).build().unwrap();
    let made = |options: &PlanOptions| {
        let (stop, mut threads) = (StopToken::default(), Vec::new());
        let on_progress = &mut |_: &Progress| threads.push(std::thread::current().name() == Some("behind"));
        let conduct = Conduct { on_progress, search_threads: Some(&pool), ..Conduct::unheard(&stop) };
        let plan = replan(&snapshot, &settings, options, None, conduct).unwrap().plan;
        assert!(!threads.is_empty());
        (plan, threads)
    };
    let (first, threads) = made(&cold);
    assert!(threads.iter().all(|is_behind| !is_behind), "somebody waits for it");
    let (_, threads) = made(&PlanOptions { earlier: Some(poses(&first)), ..cold });
    assert!(threads.iter().all(|is_behind| *is_behind), "there is a flight already");
}

#[test]
fn the_flight_of_another_rig_is_not_gone_on_with() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(2), &settings));
    let [panoramic, gimbal] = ["panoramic", "phantom4-rtk"].map(|name| Rig::preset(name).unwrap());
    let first = plan(&snapshot, &settings, &options(&panoramic, 10), &StopToken::default(), &mut |_| {}).unwrap();
    let cold = planned(&snapshot, &settings, &options(&gimbal, 10));
    let again = PlanOptions { earlier: Some(poses(&first)), ..options(&gimbal, 10) };
    assert_eq!(planned(&snapshot, &settings, &again), cold);
    assert!(cold.0.is_empty());
}
