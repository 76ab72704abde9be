//! A flight goes on from an aircraft in the air: with its speed, without ordering again what was captured, and back in time.

mod support;

use std::sync::Arc;

use geo::polygon;
use nalgebra::{Point3, Vector3};
use overfly::camera::{Pose, Rig};
use overfly::planner::en_route::{add_images, waypoints_left};
use overfly::planner::{Conduct, EnRoute, Made, Method, PlanError, PlanOptions, StopToken, plan, replan};
use overfly::scene::edit::Edit;
use overfly::search::captured::Captured;
use overfly::search::{Problem, Wanted};
use overfly::session::{Session, Snapshot};
use overfly::settings::Settings;
use overfly::trajectory::known::Scope;
use overfly::trajectory::plan::{Image, Plan, StopReason};
use overfly::trajectory::profile::Passage;
use overfly::trajectory::record::Record;
use overfly::trajectory::safety;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;
use support::{random_edit, rigs, session, small_block, small_settings, snapshot, snapshot_after};

fn options(rig: &Rig, rounds: u32) -> PlanOptions {
    PlanOptions { iterations: Some(rounds), ..PlanOptions::new(rig.clone(), Method::Refined, 5) }
}

fn planned(snapshot: &Snapshot, settings: &Settings, options: &PlanOptions) -> Result<Plan, PlanError> {
    plan(snapshot, settings, options, &StopToken::default(), &mut |_| {})
}

fn captured_by(snapshot: &Snapshot, images: &[Image]) -> Captured {
    let mut captured = Captured::default();
    add_images(&mut captured, snapshot, images, &StopToken::default()).expect("nobody abandons it");
    captured
}

/// An aircraft at the place where a plan's flight takes its image number `taken`, as it moves and looks there.
fn aloft(plan: &Plan, taken: usize, captured: Captured) -> (EnRoute, Passage) {
    let passage = plan.profile().unwrap().at(plan.images[taken - 1].time_s).unwrap();
    let en_route = EnRoute {
        position_m: passage.position_m,
        velocity_mps: passage.velocity_mps,
        view: plan.images[taken - 1].direction.filter(|_| plan.cameras.len() == 1),
        captured: Arc::new(captured),
        time_left_s: None,
        landing_m: None,
    };
    (en_route, passage)
}

fn views(
    snapshot: &Snapshot,
    settings: &Settings,
    rig: &Rig,
    captured: &Captured,
) -> Vec<Vec<(u128, overfly::coverage::Bearing)>> {
    let wanted = Wanted { captured: Arc::new(captured.clone()), ..Wanted::default() };
    let problem = Problem::wanted(snapshot, settings, rig.clone(), &wanted);
    (0..snapshot.field().samples.len()).map(|i| problem.captured_views(i).to_vec()).collect()
}

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5))]
    #[test]
    fn what_is_captured_stays_so_until_its_structure_is_edited(seed in 0u64..1000, rig in prop::sample::select(rigs())) {
        let settings = small_settings();
        let mut edited = session(small_block(seed % 7), &settings);
        let mut now = snapshot(&edited);
        let flown = planned(&now, &settings, &options(&rig, 4)).unwrap();
        let half = flown.images.len() / 2;
        let mut captured = captured_by(&now, &flown.images[..half]);
        let at_once = captured_by(&now, &flown.images);
        let mut in_parts = captured.clone();
        add_images(&mut in_parts, &now, &flown.images[half..], &StopToken::default()).unwrap();
        prop_assert!(in_parts == at_once, "images add up however they are reported");

        let mut random = rng(seed);
        for _ in 0..6 {
            let edit = random_edit(edited.scene(), &mut random);
            let before = now.clone();
            if edited.apply(&edit).is_err() {
                continue;
            }
            now = snapshot_after(&edited, &before);
            let [was, is] = [&before, &now].map(|state| views(state, &settings, &rig, &captured));
            let (old, new) = (before.field(), now.field());
            for (row, structure) in new.structures.iter().zip(&now.scene.structures) {
                let index = before.scene.structures.iter().position(|known| Arc::ptr_eq(known, structure));
                for k in 0..row.samples as usize {
                    let i = row.first_sample as usize + k;
                    let Some(index) = index else {
                        prop_assert!(is.is_empty() || is[i].is_empty(), "{edit:?}: sample {k} of {} is to be captured again", structure.name);
                        continue;
                    };
                    let j = old.structures[index].first_sample as usize + k;
                    if new.samples[i].exposed == 1 && old.samples[j].exposed == 1 {
                        prop_assert_eq!(&is[i], &was[j], "sample {} of {} after {:?}", k, &structure.name, &edit);
                    }
                }
            }
            // Images that are taken from now on add to what was there.
            let few = &flown.images[half..(half + 4).min(flown.images.len())];
            add_images(&mut captured, &now, few, &StopToken::default()).unwrap();
            let more = views(&now, &settings, &rig, &captured);
            prop_assert!(is.iter().zip(&more).all(|(before, after)| after.starts_with(before)));
        }
    }

    #[test]
    fn a_flight_goes_on_without_a_jerk_and_orders_nothing_again(
        block in 0u64..7, rig in prop::sample::select(rigs()), share in 0.1..0.9f64, ends in any::<[bool; 2]>(),
    ) {
        let settings = small_settings();
        let now = snapshot(&session(small_block(block), &settings));
        let whole = planned(&now, &settings, &options(&rig, 12)).unwrap();
        let taken = ((whole.images.len() as f64 * share) as usize).max(1);
        let (mut en_route, passage) = aloft(&whole, taken, captured_by(&now, &whole.images[..taken]));
        if ends[0] {
            en_route.landing_m = Some(whole.waypoints[0].position_m);
        }
        let anywhere = PlanOptions { earlier: Some(waypoints_left(&whole, taken)), en_route: Some(en_route.clone()), ..options(&rig, 6) };
        let mut interim = Vec::new();
        let on_interim = &mut |made: Made| interim.push(made.plan);
        let stop = &StopToken::default();
        let conduct = Conduct { on_interim, ..Conduct::unheard(stop) };
        let first = replan(&now, &settings, &anywhere, None, conduct).unwrap().plan;
        if ends[1] {
            en_route.time_left_s = Some(0.6 * first.metrics.profile_s);
        }
        let ordered = PlanOptions { en_route: Some(en_route.clone()), ..anywhere };
        let threads = |count: usize| rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
        let on = threads(1).install(|| planned(&now, &settings, &ordered));
        let Ok(on) = on else {
            // There is always a way on where nobody sets a time.
            prop_assert!(matches!(on, Err(PlanError::LandNow { .. })) && ends == [true, true], "{:?}", on);
            return Ok(());
        };
        prop_assert_eq!(&threads(3).install(|| planned(&now, &settings, &ordered)).unwrap(), &on);

        for on in interim.iter().chain([&first, &on]) {
            let profile = on.profile().unwrap();
            let start = profile.at(0.0).unwrap();
            prop_assert_eq!(start.position_m, passage.position_m);
            let jerk_mps = (start.velocity_mps - passage.velocity_mps).norm();
            prop_assert!(jerk_mps < 1e-6 || passage.velocity_mps.norm() < 0.1, "{} m/s", jerk_mps);
            // On an arc the way straight on may lead too near to something: then it brakes.
            prop_assert!(!on.egress.escapes);
            prop_assert!(safety::check_behind(profile.curve(), on.egress.legs(), Scope::everywhere(&now.free)).is_ok());
            if let Some(view) = en_route.view {
                prop_assert_eq!(on.waypoints[0].direction, Some(view));
            }
            if let Some(landing_m) = en_route.landing_m {
                prop_assert_eq!(on.waypoints.last().unwrap().position_m, landing_m);
            }
            prop_assert!(on.images.iter().all(|image| whole.images[..taken].iter().all(|old|
                old.position_m != image.position_m || old.direction != image.direction)), "no image is taken twice");
        }
        if let Some(left_s) = en_route.time_left_s {
            prop_assert!(on.metrics.profile_s <= left_s, "{} s of {}", on.metrics.profile_s, left_s);
        }
        // With as much as was captured to begin with, the flight is not planned as if it were nothing.
        let before = Problem::wanted(&now, &settings, rig.clone(), &Wanted { captured: en_route.captured.clone(), ..Wanted::default() });
        let captured = before.captured_cells().1;
        prop_assert!(on.metrics.coverage_percent + 1e-9 >= before.coverage_percent(captured));
        if !ends[1] && whole.stop == StopReason::GoalReached && on.stop == StopReason::GoalReached {
            prop_assert!(on.metrics.profile_s <= whole.metrics.profile_s, "{} s after {}", on.metrics.profile_s, whole.metrics.profile_s);
        }
    }
}

#[test]
fn what_was_known_of_the_flight_before_changes_nothing() {
    let settings = small_settings();
    let mut edited = session(small_block(2), &settings);
    let mut now = snapshot(&edited);
    let made = |now: &Snapshot, options: &PlanOptions, record: Option<Record>| {
        let mut interim = Vec::new();
        let on_interim = &mut |made: Made| interim.push(made.plan);
        let stop = &StopToken::default();
        let conduct = Conduct { on_interim, ..Conduct::unheard(stop) };
        let last = replan(now, &settings, options, record, conduct).unwrap();
        (interim, last)
    };
    let mut flown = made(&now, &options(&panoramic(), 8), None).1;
    let mut captured = Captured::default();
    let mut random = rng(4);
    let mut replans = 0;
    while replans < 4 {
        let taken = flown.plan.images.len() / 4;
        let mut more = captured.clone();
        add_images(&mut more, &now, &flown.plan.images[..taken], &StopToken::default()).unwrap();
        let edit = random_edit(edited.scene(), &mut random);
        let mut next = edited.clone();
        if next.apply(&edit).is_err() {
            continue;
        }
        let after = snapshot_after(&next, &now);
        let (en_route, _) = aloft(&flown.plan, taken, more.clone());
        let ordered = PlanOptions {
            earlier: Some(waypoints_left(&flown.plan, taken)),
            en_route: Some(en_route),
            ..options(&panoramic(), 3)
        };
        let (anew, last) = made(&after, &ordered, None);
        let (followed, same) = made(&after, &ordered, Some(flown.record));
        assert!(!anew.is_empty() && anew == followed && last.plan == same.plan, "after {edit:?}");
        (edited, now, captured, flown) = (next, after, more, same);
        replans += 1;
    }
}

/// A flight over a block, and an aircraft a third of it on its way.
fn under_way() -> (Settings, Session, Snapshot, Plan, EnRoute) {
    let settings = small_settings();
    let session = session(small_block(2), &settings);
    let now = snapshot(&session);
    let whole = planned(&now, &settings, &options(&panoramic(), 12)).unwrap();
    let taken = whole.images.len() / 3;
    let (en_route, _) = aloft(&whole, taken, captured_by(&now, &whole.images[..taken]));
    (settings, session, now, whole, en_route)
}

fn panoramic() -> Rig {
    Rig::preset("panoramic").unwrap()
}

#[test]
fn with_everything_captured_nothing_is_ordered() {
    let (settings, _, now, whole, en_route) = under_way();
    let captured = Arc::new(captured_by(&now, &whole.images));
    let goal_percent = Some(whole.metrics.coverage_percent - 1.0);
    let landing_m = Some(whole.waypoints[0].position_m);
    let en_route = EnRoute { captured, landing_m, ..en_route };
    let ordered = PlanOptions { goal_percent, matched_percent: Some(0.0), en_route: Some(en_route), ..options(&panoramic(), 6) };
    let home = planned(&now, &settings, &ordered).unwrap();
    assert!((home.metrics.coverage_percent - whole.metrics.coverage_percent) >= -1e-9);
    assert!(home.metrics.profile_s < 0.3 * whole.metrics.profile_s, "{} s", home.metrics.profile_s);
    assert_eq!(home.selected_images(), 0, "the reconstruction needs none of the images on the way home");
}

#[test]
fn without_the_time_to_land_the_error_says_how_long_it_takes() {
    let (settings, _, now, whole, en_route) = under_way();
    let landing_m = Some(whole.waypoints[0].position_m);
    let with = |time_left_s: f64| {
        let en_route = EnRoute { landing_m, time_left_s: Some(time_left_s), ..en_route.clone() };
        planned(&now, &settings, &PlanOptions { en_route: Some(en_route), ..options(&panoramic(), 6) })
    };
    let Err(error @ PlanError::LandNow { way_s, .. }) = with(1.0) else { panic!("a second is enough") };
    assert!(error.to_string().starts_with("land now"), "{error}");
    let just = with(way_s + 0.01).unwrap();
    assert!(just.metrics.profile_s <= way_s + 0.01);
    let unsafe_place = EnRoute { landing_m: Some(Point3::new(0.0, 0.0, 1.0)), ..en_route.clone() };
    let refused = planned(&now, &settings, &PlanOptions { en_route: Some(unsafe_place), ..options(&panoramic(), 6) });
    assert!(matches!(refused, Err(PlanError::Landing { .. })), "{refused:?}");
}

/// Distance to surfaces and the ground, negative inside of a structure.
fn margin_m(snapshot: &Snapshot, p: &Point3<f64>) -> f64 {
    let distance_m = snapshot.free.clearance.point_distance_m(p, 1e4);
    if snapshot.free.structure_around(p).is_some() { -distance_m } else { distance_m.min(p.z) }
}

/// A box around or beside a place.
fn obstacle(at: &Point3<f64>, offset: Vector3<f64>, half_m: f64) -> Edit {
    let centre = at + offset;
    let [west, east, south, north] = [centre.x - half_m, centre.x + half_m, centre.y - half_m, centre.y + half_m];
    let footprint = polygon![(x: west, y: south), (x: east, y: south), (x: east, y: north), (x: west, y: north)];
    let base_m = (centre.z - half_m).max(0.0);
    Edit::add_prism("crane", footprint, base_m, centre.z + half_m)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn out_of_a_new_obstacle_the_aircraft_comes_nearer_to_nothing(
        offset in prop::array::uniform3(-7.0..7.0f64), half_m in 1.5..6.0f64, speed in prop::sample::select(vec![0.0, 1.0]), share in 0.1..0.9f64,
    ) {
        let settings = small_settings();
        let mut edited = session(small_block(2), &settings);
        let before = snapshot(&edited);
        let paper = PlanOptions { iterations: Some(40), ..PlanOptions::new(panoramic(), Method::Paper, 5) };
        let whole = planned(&before, &settings, &paper).unwrap();
        let taken = ((whole.images.len() as f64 * share) as usize).max(1);
        let (mut en_route, _) = aloft(&whole, taken, Captured::default());
        en_route.velocity_mps *= speed;
        let at = en_route.position_m;
        prop_assume!(edited.apply(&obstacle(&at, offset.into(), half_m)).is_ok());
        let now = snapshot_after(&edited, &before);
        let ordered = PlanOptions { en_route: Some(en_route.clone()), earlier: Some(waypoints_left(&whole, taken)), ..options(&panoramic(), 2) };
        let on = match planned(&now, &settings, &ordered) {
            Ok(on) => on,
            Err(error @ (PlanError::Hold { .. } | PlanError::CannotBrake { .. })) => {
                prop_assert!(error.to_string().starts_with("hold: "), "{}", error);
                return Ok(());
            }
            Err(other) => return Err(TestCaseError::fail(format!("{other}"))),
        };
        let legs = on.egress.legs();
        prop_assert!(legs > 0 || now.free.is_safe(&at));
        let profile = on.profile().unwrap();
        prop_assert!(safety::check_behind(profile.curve(), legs, Scope::everywhere(&now.free)).is_ok());
        let place = |k: usize| on.waypoints[k].position_m;
        if on.egress.brakes {
            let (ahead, way) = (en_route.velocity_mps, place(1) - place(0));
            prop_assert!(way.angle(&ahead) < 1e-6 && way.norm() <= ahead.norm() * 3.0 && on.waypoints[1].deviation_m == 0.0);
            prop_assert!(!now.free.clearance.occluded(&place(0), &place(1)));
        }
        if on.egress.escapes {
            let (from, to) = (place(legs - 1), place(legs));
            prop_assert!(now.free.is_safe(&to) && on.waypoints[legs].deviation_m == 0.0);
            let steps = 1500;
            let margins: Vec<f64> = (0..=steps).map(|k| margin_m(&now, &(from + (to - from) * (f64::from(k) / f64::from(steps))))).collect();
            let safety_m = now.free.safety_distance_m;
            for pair in margins.windows(2) {
                // A dip between two looks of the planner, 5 cm apart, is half of that at most.
                prop_assert!(pair[1].min(safety_m) >= pair[0].min(safety_m) - 0.026, "from {} to {} m", pair[0], pair[1]);
            }
            prop_assert!(margins.iter().fold(f64::INFINITY, |least, &margin_m| least.min(margin_m)) >= margins[0] - 0.026);
        }
        if legs > 0 {
            prop_assert!(overfly::planner::en_route::remark(&on).is_some());
            prop_assert!(on.images.iter().all(|image| now.free.is_safe(&image.position_m)), "none of the images is taken on the way out");
        }
    }
}

#[test]
fn from_where_no_way_out_leads_the_aircraft_is_told_to_hold() {
    let (settings, mut edited, before, _, en_route) = under_way();
    let at = en_route.position_m;
    // Between two walls, a metre apart, that are closed above.
    for (name, x, width) in [("west", -8.0, 7.0), ("east", 1.0, 7.0)] {
        let [west, east] = [at.x + x, at.x + x + width];
        let footprint =
            polygon![(x: west, y: at.y - 30.0), (x: east, y: at.y - 30.0), (x: east, y: at.y + 30.0), (x: west, y: at.y + 30.0)];
        edited.apply(&Edit::add_prism(name, footprint, 0.0, at.z + 20.0)).unwrap();
    }
    let footprint = polygon![(x: at.x - 8.0, y: at.y - 30.0), (x: at.x + 8.0, y: at.y - 30.0), (x: at.x + 8.0, y: at.y + 30.0), (x: at.x - 8.0, y: at.y + 30.0)];
    edited.apply(&Edit::add_prism("roof", footprint, at.z + 19.0, at.z + 25.0)).unwrap();
    let now = snapshot_after(&edited, &before);
    let hovering = EnRoute { velocity_mps: Vector3::zeros(), ..en_route.clone() };
    let held = planned(&now, &settings, &PlanOptions { en_route: Some(hovering), ..options(&panoramic(), 2) });
    assert!(matches!(held, Err(PlanError::Hold { .. })), "{held:?}");
    let towards = EnRoute { velocity_mps: Vector3::new(8.0, 0.0, 0.0), ..en_route };
    let held = planned(&now, &settings, &PlanOptions { en_route: Some(towards), ..options(&panoramic(), 2) });
    assert!(matches!(held, Err(PlanError::CannotBrake { .. })), "{held:?}");
}

#[test]
fn poses_that_make_no_sense_are_refused() {
    let (settings, _, now, _, en_route) = under_way();
    let refused = |en_route: EnRoute, options: PlanOptions| {
        let error = planned(&now, &settings, &PlanOptions { en_route: Some(en_route), ..options }).unwrap_err();
        assert!(error.to_string().len() > 40, "{error}");
    };
    let usual = || options(&panoramic(), 2);
    refused(EnRoute { position_m: Point3::new(f64::NAN, 0.0, 0.0), ..en_route.clone() }, usual());
    refused(EnRoute { velocity_mps: Vector3::new(1e3, 0.0, 0.0), ..en_route.clone() }, usual());
    refused(EnRoute { time_left_s: Some(-1.0), ..en_route.clone() }, usual());
    refused(EnRoute { view: Some(Vector3::x_axis()), ..en_route.clone() }, usual());
    refused(en_route.clone(), PlanOptions { start_m: Some(en_route.position_m), ..usual() });
    refused(en_route, PlanOptions { method: Method::Paper, ..usual() });
}

#[test]
fn a_pose_is_no_waypoint_of_the_plan_before() {
    let (_, _, _, whole, _) = under_way();
    assert_eq!(waypoints_left(&whole, 0).len(), whole.waypoints.len());
    let left: Vec<Pose> = waypoints_left(&whole, whole.images.len());
    assert!(left.len() <= 1, "{} waypoints behind the last image", left.len());
}

#[test]
fn inside_of_a_new_obstacle_a_way_out_is_found_and_towards_one_the_aircraft_brakes() {
    let (settings, edited, before, whole, en_route) = under_way();
    let after = |edit: &Edit| {
        let mut edited = edited.clone();
        edited.apply(edit).unwrap();
        snapshot_after(&edited, &before)
    };
    // High above everything else, so that nothing but the box is near.
    let at = Point3::new(0.0, 0.0, before.scene.bounds().unwrap().max.z + 18.0);
    let earlier = Some(waypoints_left(&whole, whole.images.len() / 3));
    let pose = |velocity_mps: Vector3<f64>| EnRoute { position_m: at, velocity_mps, ..en_route.clone() };
    let on = |now: &Snapshot, pose: EnRoute| {
        let ordered = PlanOptions { earlier: earlier.clone(), en_route: Some(pose), ..options(&panoramic(), 2) };
        planned(now, &settings, &ordered).unwrap()
    };
    let around = after(&obstacle(&at, Vector3::zeros(), 3.0));
    let out = on(&around, pose(Vector3::zeros()));
    assert!(!out.egress.brakes && out.egress.escapes && out.clearance_m == 0.0, "{:?}", out.egress);
    assert!(overfly::planner::en_route::remark(&out).unwrap().contains("through a surface"));
    let ahead = after(&obstacle(&at, Vector3::new(14.0, 0.0, 0.0), 3.0));
    let braked = on(&ahead, pose(Vector3::new(4.0, 0.0, 0.0)));
    assert!(braked.egress.brakes, "{:?}", braked.egress);
    let beside = on(&ahead, pose(Vector3::new(0.0, 4.0, 0.0)));
    assert_eq!((beside.egress.legs(), beside.waypoints[0].position_m), (0, at));
}
