//! After an edit there is a safe flight before there is a field: safe against the scene as it is, the flight before as far as it can be flown, and the one
//! that is told of again with what it captures.

mod support;

use geo::polygon;
use nalgebra::Vector3;
use overfly::camera::{Pose, Rig};
use overfly::mission::plan_table;
use overfly::planner::{self, Conduct, EnRoute, Made, Method, PlanError, PlanOptions, StopToken, replan};
use overfly::scene::edit::Edit;
use overfly::session::{Cleared, Session, Snapshot};
use overfly::settings::Settings;
use overfly::trajectory::known::Scope;
use overfly::trajectory::plan::{Metrics, Plan, RunTimes, StopReason};
use overfly::trajectory::safety;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;
use support::{pillar_on, random_edit, repaired, rigs, session, small_block, small_settings, snapshot};

fn options(rig: &Rig, rounds: u32) -> PlanOptions {
    PlanOptions { iterations: Some(rounds), ..PlanOptions::new(rig.clone(), Method::Refined, 5) }
}

fn first_flight(snapshot: &Snapshot, settings: &Settings, rig: &Rig, rounds: u32) -> Made {
    replan(snapshot, settings, &options(rig, rounds), None, Conduct::unheard(&StopToken::default())).expect("it can be flown")
}

fn cleared(edited: &Session, before: &Snapshot) -> Cleared {
    edited.cleared_after(before, &StopToken::default()).expect("nobody stops it")
}

fn field_of(edited: &Session, cleared: Cleared, before: &Snapshot) -> Snapshot {
    let stop = StopToken::default();
    let survey = edited.survey_of(cleared, before, &stop).expect("nobody stops it");
    survey.into_snapshot(&stop).expect("nobody stops it")
}

/// To the last bit, NaN included.
fn bytes(plan: &Plan) -> Vec<overfly_table::Block> {
    plan_table::to_blocks(plan, &RunTimes::default())
}

fn is_safe(plan: &Plan, cleared: &Cleared) -> bool {
    let profile = plan.profile().expect("a plan says how it was timed");
    safety::check_behind(profile.curve(), plan.egress.legs(), Scope::everywhere(&cleared.free)).is_ok()
}

#[test]
fn a_flight_that_an_edit_blocks_is_led_around_it_at_once() {
    let settings = small_settings();
    for rig in rigs() {
        let mut edited = session(small_block(2), &settings);
        let before = snapshot(&edited);
        let Made { plan: first, record } = first_flight(&before, &settings, &rig, 40);
        edited.apply(&pillar_on(&first, 0)).expect("there is room for a pillar");
        let cleared = cleared(&edited, &before);
        assert!(!is_safe(&first, &cleared), "{}: the pillar stands on the flight", rig.name);
        let again = PlanOptions { earlier: Some(first.poses()), ..options(&rig, 1) };
        let known = record.flight.as_ref();
        let made = planner::safe(&before, &cleared, &settings, &again, known, &StopToken::default()).unwrap();
        let (plan, _) = made.expect("most of the flight is left");
        assert!(is_safe(&plan, &cleared) && plan.scene.revision == 2 && !plan.is_counted(), "{}", rig.name);
        let kept = plan.waypoints.iter().filter(|w| first.waypoints.iter().any(|old| old.position_m == w.position_m)).count();
        assert!(kept * 10 >= first.waypoints.len() * 8, "{}: {kept} of {}", rig.name, first.waypoints.len());
        assert!(plan.images.len() * 10 >= first.images.len() * 8 && plan.metrics.coverage_percent.is_nan());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_plan_on_the_field_is_the_safe_one_with_what_it_captures(seed in 0u64..1000, rig in proptest::sample::select(rigs()), edits in 2usize..7) {
        let settings = small_settings();
        let mut edited = session(small_block(seed % 5), &settings);
        let mut before = snapshot(&edited);
        let mut made = first_flight(&before, &settings, &rig, 12);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for number in 0..edits {
            let edit = if number % 3 == 0 { pillar_on(&made.plan, number) } else { random_edit(edited.scene(), &mut random) };
            if edited.apply(&edit).is_err() {
                continue;
            }
            let cleared = cleared(&edited, &before);
            let again = PlanOptions { earlier: Some(made.plan.poses()), ..options(&rig, 1) };
            let stop = StopToken::default();
            let safe = |known| planner::safe(&before, &cleared, &settings, &again, known, &stop).unwrap();
            let (anew, followed) = (safe(None), safe(made.record.flight.as_ref()));
            prop_assert_eq!(anew.as_ref().map(|safe| bytes(&safe.0)), followed.as_ref().map(|safe| bytes(&safe.0)), "{:?}", edit);
            let Some((plan, flight)) = followed else { break };
            prop_assert!(is_safe(&plan, &cleared), "{edit:?}");
            prop_assert!(plan.cells.is_empty() && plan.stop == StopReason::Safe && plan.scene.revision == edited.revision());

            let after = field_of(&edited, cleared, &before);
            prop_assert!(flight.is_safe_in(&after.free));
            let mut record = made.record;
            record.flight = Some(flight);
            let goes_on = PlanOptions { earlier: Some(plan.poses()), ..options(&rig, 1) };
            let told = repaired(&after, &settings, &goes_on, Some(record)).expect("it is safe");
            let looked_at = repaired(&after, &settings, &goes_on, None).expect("it is safe");
            prop_assert_eq!(&told.plan, &looked_at.plan, "what is known changes nothing but the time");
            // The same flight, to the last bit.
            let Plan { metrics, cells, ceilings, stop, .. } = &told.plan;
            let uncounted = Metrics::uncounted();
            let metrics = Metrics {
                coverage_percent: uncounted.coverage_percent, coverage_exposed_percent: uncounted.coverage_exposed_percent,
                capturable_percent: uncounted.capturable_percent, matched_percent: uncounted.matched_percent,
                information: uncounted.information, objective: uncounted.objective, ..*metrics
            };
            prop_assert!(*stop == StopReason::Repaired && cells.len() == after.field().samples.len() && ceilings.len() == cells.len());
            let bare = Plan { metrics, stop: StopReason::Safe, cells: Vec::new(), ceilings: Vec::new(), ..told.plan.clone() };
            prop_assert_eq!(bytes(&bare), bytes(&plan));
            (before, made) = (after, told);
        }
    }
}

/// An aircraft where a plan's flight takes one of its images.
fn aloft(plan: &Plan, taken: usize) -> EnRoute {
    let passage = plan.profile().unwrap().at(plan.images[taken - 1].time_s).unwrap();
    let (position_m, velocity_mps) = (passage.position_m, passage.velocity_mps);
    EnRoute { position_m, velocity_mps, view: None, captured: Default::default(), time_left_s: None, landing_m: None }
}

#[test]
fn an_aircraft_in_the_air_is_led_on_from_where_it_is() {
    let settings = small_settings();
    for rig in rigs() {
        let mut edited = session(small_block(3), &settings);
        let before = snapshot(&edited);
        let Made { plan: first, .. } = first_flight(&before, &settings, &rig, 40);
        let taken = first.images.len() / 3;
        let en_route = aloft(&first, taken);
        let left: Vec<Pose> = planner::en_route::waypoints_left(&first, taken);
        edited.apply(&pillar_on(&first, 0)).expect("there is room for a pillar");
        let cleared = cleared(&edited, &before);
        let safe = |en_route: EnRoute| {
            let again = PlanOptions { earlier: Some(left.clone()), en_route: Some(en_route), ..options(&rig, 1) };
            planner::safe(&before, &cleared, &settings, &again, None, &StopToken::default())
        };
        let (plan, _) = safe(en_route.clone()).unwrap().expect("there is a way on");
        let start = plan.profile().unwrap().at(0.0).unwrap();
        assert_eq!(start.position_m, en_route.position_m, "{}", rig.name);
        let jerk_mps = (start.velocity_mps - en_route.velocity_mps).norm();
        assert!(jerk_mps < 1e-6 || en_route.velocity_mps.norm() < 0.1, "{}: {jerk_mps} m/s", rig.name);
        assert!(is_safe(&plan, &cleared), "{}", rig.name);
        // Who has less time than it takes is told by the plan that follows what to do.
        let hurried = EnRoute { time_left_s: Some(0.9 * plan.metrics.profile_s), ..en_route.clone() };
        assert!(safe(hurried).unwrap().is_none(), "{}", rig.name);
        let patient = EnRoute { time_left_s: Some(1.1 * plan.metrics.profile_s), ..en_route.clone() };
        assert!(safe(patient).unwrap().is_some(), "{}", rig.name);
        // Hovering within a structure that nobody knew of.
        let within = EnRoute { velocity_mps: Vector3::zeros(), ..en_route };
        let [x, y, z] = within.position_m.into();
        let outline =
            polygon![(x: x - 1.0, y: y - 1.0), (x: x + 1.0, y: y - 1.0), (x: x + 1.0, y: y + 1.0), (x: x - 1.0, y: y + 1.0)];
        let mut edited = edited.clone();
        edited.apply(&Edit::add_prism("mast", outline, 0.0, z + 1.0)).expect("there is room for it");
        let cleared = self::cleared(&edited, &before);
        let again = PlanOptions { earlier: Some(left.clone()), en_route: Some(within), ..options(&rig, 1) };
        match planner::safe(&before, &cleared, &settings, &again, None, &StopToken::default()) {
            Ok(Some((plan, _))) => assert!(plan.egress.escapes && is_safe(&plan, &cleared), "{}", rig.name),
            Ok(None) | Err(PlanError::Hold { .. }) => {}
            Err(error) => panic!("{}: {error}", rig.name),
        }
    }
}

#[test]
fn nothing_is_handed_out_where_little_is_left_or_nobody_waits() {
    let settings = small_settings();
    let [panoramic, gimbal] = ["panoramic", "phantom4-rtk"].map(|name| Rig::preset(name).unwrap());
    let mut edited = session(small_block(2), &settings);
    let before = snapshot(&edited);
    let first = first_flight(&before, &settings, &panoramic, 12).plan;
    edited.apply(&pillar_on(&first, 0)).expect("there is room for a pillar");
    let cleared = cleared(&edited, &before);
    let safe = |rig: &Rig, earlier: Option<Vec<Pose>>, stop: &StopToken| {
        let again = PlanOptions { earlier, ..options(rig, 1) };
        planner::safe(&before, &cleared, &settings, &again, None, stop).map(|made| made.is_some())
    };
    let (free, abandoned) = (StopToken::default(), StopToken::default());
    abandoned.abandon();
    assert_eq!(safe(&panoramic, Some(first.poses()), &free), Ok(true));
    assert_eq!(safe(&panoramic, None, &free), Ok(false), "there is no flight to go on with");
    assert_eq!(safe(&gimbal, Some(first.poses()), &free), Ok(false), "the flight of another rig");
    assert_eq!(safe(&panoramic, Some(first.poses()), &abandoned), Err(PlanError::Abandoned));
}
