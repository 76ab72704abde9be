//! A flight that was changed step by step against one that is made anew, and against brute force.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;

use super::annealing::{Aim, Annealing};
use super::choice::Choice;
use super::counts::Worth;
use super::draft::Splice;
use super::flight::{Demand, Flight, Prices, Pursuit};
use super::ground::{Counting, Ground, Look};
use super::moves;
use super::sectors::Sector;
use crate::camera::{Pose, Rig};
use crate::coverage::Mask;
use crate::field::Snapshot;
use crate::scene::{BlockSettings, generate_block};
use crate::search::Problem;
use crate::search::leg::image_poses;
use crate::search::objective::PathSums;
use crate::session::Session;
use crate::settings::Settings;
use crate::stop::StopToken;
use crate::trajectory::profile::Profile;

pub(super) fn small_block() -> (Snapshot, Settings) {
    let mut settings = Settings::default();
    settings.surface.samples = 150;
    settings.field.viewpoints = 200;
    let block = BlockSettings { seed: 5, extent_m: [120.0, 120.0], buildings: 9, ..Default::default() };
    let stop = StopToken::default();
    let session = Session::new(generate_block(&block), Arc::new(settings.clone()), &stop).expect("a generated block has a field");
    let snapshot = session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops it");
    (snapshot, settings)
}

/// Calls `check` for every preset with its ground and a path of two waypoints.
fn for_every_rig(check: impl Fn(&Ground, &[Pose], &Settings, &Snapshot)) {
    let (snapshot, settings) = small_block();
    for name in Rig::PRESETS {
        let problem = Problem::new(&snapshot, &settings, Rig::preset(name).expect("a preset"));
        let ground = Ground::new(&problem, &settings, false, Counting::Matched, &StopToken::default());
        let positions: Vec<_> = problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect();
        let start = positions[0];
        let next = *positions.iter().find(|next| problem.can_fly(&start, next)).expect("some leg is free");
        let direction = problem.rig.pose_directions()[0];
        check(&ground, &[start, next].map(|position| Pose { position, direction }), &settings, &snapshot);
    }
}

/// A demand under which changes of all kinds are made.
fn demand(ground: &Ground) -> Demand {
    let prices_ns = Prices { captured: 2e9, matched: 1e9 };
    Demand { required: required(ground), prices_ns, surplus_share: 0.3, parts_share: 1.0 }
}

fn required(ground: &Ground) -> Worth {
    Worth { captured: ground.problem.sufficient, matched: ground.problem.enough_matched(95.0) }
}

/// What both flights say of themselves.
fn figures(flight: &Flight, ground: &Ground) -> (u64, Worth, Vec<u32>, Vec<bool>) {
    let cells = ground.wanted.iter().map(|&i| flight.counts.cells.cells(i as usize)).collect();
    let is_missing = |i: usize| flight.counts.cells.is_missing(i) || flight.counts.matches.is_missing(i);
    let missing = ground.wanted.iter().map(|&i| is_missing(i as usize)).collect();
    (flight.duration_ns(), flight.counts.worth(), cells, missing)
}

#[test]
fn a_flight_changed_step_by_step_is_the_one_made_anew() {
    for_every_rig(|ground, path, settings, _| {
        let choice = Choice::new();
        let mut random = ChaCha8Rng::seed_from_u64(9);
        let mut flight = Flight::new(ground, path);
        let (mut splice, mut made) = (Splice::default(), 0);
        let mut earlier = flight.waypoints.clone();
        for step in 0..3000 {
            let sector = Sector { head: 0, tail: 0, focus: None };
            let kind = choice.draw(&mut random);
            if !moves::propose(ground, &flight, required(ground), sector, kind, &mut random, &mut splice) {
                continue;
            }
            let before = (step % 100 == 0).then(|| figures(&flight, ground));
            if flight.attempt(ground, &splice, &Pursuit::Time(demand(ground)), 1e9).gained.is_some() {
                made += 1;
            } else if let Some(before) = before {
                assert_eq!(figures(&flight, ground), before, "a change that is not made leaves no trace");
            }
            if step % 250 == 249 {
                assert_eq!(figures(&flight, ground), figures(&Flight::new(ground, &flight.path()), ground));
            }
            if step % 500 == 499 {
                let now = flight.waypoints.clone();
                flight.go_back(ground, std::mem::replace(&mut earlier, now.clone()));
                assert_eq!(figures(&flight, ground), figures(&Flight::new(ground, &flight.path()), ground), "gone back");
                flight.go_back(ground, now);
            }
        }
        assert!(made > 100 && flight.waypoints.len() > 3, "{made} changes, {} waypoints", flight.waypoints.len());
        let rig = &ground.problem.rig;
        let profile_s = Profile::new(&flight.path(), rig, &settings.flight, &settings.dynamics).duration_s();
        assert!((flight.duration_ns() as f64 * 1e-9 - profile_s).abs() < 1e-6 * profile_s);
    });
}

#[test]
fn no_image_is_counted_for_more_than_it_really_sees() {
    for_every_rig(|ground, path, _, snapshot| {
        let problem = ground.problem;
        let mut annealing = Annealing::new(ground, path, Aim::LeastTime { required: required(ground) }, 3);
        (0..12).for_each(|_| annealing.round(1e9));
        let path = annealing.best().path.clone();
        let flight = Flight::new(ground, &path);
        let poses: Vec<Pose> = (path.iter().take(1).copied())
            .chain(path.windows(2).flat_map(|ends| image_poses(&problem.rig, &ends[0], &ends[1], problem.spacing)))
            .collect();
        for &i in &ground.wanted {
            let frame = &problem.frames[i as usize];
            let end = frame.position + frame.normal * snapshot.offset_m;
            let sees = |pose: &&Pose| {
                let frames =
                    |pose: &Pose| problem.rig.frusta(pose).is_none_or(|views| views.iter().any(|v| v.frames(&frame.position)));
                frames(pose) && !snapshot.free.clearance.occluded(&pose.position, &end)
            };
            let really: Mask =
                poses.iter().filter(sees).fold(0, |mask, pose| mask | problem.disks.exact_mask(frame, &pose.position));
            assert!(flight.counts.cells.cells(i as usize) <= really.count_ones(), "sample {i} with {}", problem.rig.name);
            // Every pair anew, by the angle itself.
            let views: Vec<_> = poses.iter().filter(sees).filter(|pose| problem.disks.faces(frame, &pose.position)).collect();
            let angle_deg = |a: &Pose, b: &Pose| (a.position - frame.position).angle(&(b.position - frame.position)).to_degrees();
            let is_matched = |a: &&&Pose| views.iter().any(|b| (4.99..=45.01).contains(&angle_deg(a, b)));
            let matched = views.iter().filter(is_matched).count() as u32;
            let is_counted = problem.matchable[i as usize] && !flight.counts.matches.is_missing(i as usize);
            assert!(!is_counted || matched >= problem.matching.least_views, "sample {i} with {}: {matched}", problem.rig.name);
        }
        let worth = annealing.best().worth;
        assert!(worth.captured > 0 && worth.matched > 0 && path.len() > 2, "{worth:?} with {}", problem.rig.name);
    });
}

#[test]
fn the_paper_s_objective_only_falls_by_what_a_change_may_cost_and_rises_with_the_rounds() {
    for_every_rig(|matching, path, _, _| {
        let problem = matching.problem;
        let mut settings = Settings::default();
        settings.refine.sectors = 1;
        let ground = Ground::new(problem, &settings, false, Counting::Everything, &StopToken::default());
        let objective = &problem.objective;
        // Eq. 6 from the cells of each sample, without the sum that is kept.
        let value = |flight: &Flight| {
            let cells = |i: usize| u64::from(flight.counts.cells.cells(i)) * problem.areas_mm2[i];
            let information: u64 = (0..problem.frames.len()).map(cells).sum();
            // The view at the start belongs to no leg.
            let start = flight.path()[0];
            let alone = ground.at_waypoint(&start, Look::Rays);
            let at_start: u64 = alone.masks().map(|(i, mask)| u64::from(mask.count_ones()) * problem.areas_mm2[i]).sum();
            objective.value(&PathSums { information: information - at_start, ..objective.travel(&flight.path()) })
        };
        let choice = Choice::new();
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let (mut flight, mut splice, mut made) = (Flight::new(&ground, path), Splice::default(), 0);
        let allowed = objective.worth_of_s(0.2);
        for _ in 0..600 {
            let before = value(&flight);
            let sector = Sector { head: 0, tail: 0, focus: None };
            let kind = choice.draw(&mut random);
            if moves::propose(&ground, &flight, Worth::default(), sector, kind, &mut random, &mut splice)
                && flight.attempt(&ground, &splice, &Pursuit::Objective(objective), 0.2e9).gained.is_some()
            {
                made += 1;
                let after = value(&flight);
                assert!(after >= before - allowed - 1e-6 * before.abs(), "{before} became {after} with {}", problem.rig.name);
            }
        }
        assert!(made > 30, "{made} changes with {}", problem.rig.name);

        let mut annealing = Annealing::new(&ground, path, Aim::MostObjective, 3);
        let first = annealing.record().objective;
        (0..12).for_each(|_| annealing.round(0.1e9));
        let last = annealing.record().objective;
        assert!(last > first && last == value(&Flight::new(&ground, &annealing.best().path)), "{first} to {last}");
    });
}

#[test]
fn every_waypoint_and_leg_keeps_the_limits_and_a_fixed_start_stays() {
    for_every_rig(|free_ground, path, settings, _| {
        let problem = free_ground.problem;
        let ground = Ground::new(problem, settings, true, Counting::Matched, &StopToken::default());
        let mut annealing = Annealing::new(&ground, path, Aim::LeastTime { required: required(&ground) }, 4);
        (0..12).for_each(|_| annealing.round(1e9));
        let refined = &annealing.best().path;
        assert_eq!(refined[0].position, path[0].position);
        for ends in refined.windows(2) {
            assert!(problem.can_fly(&ends[0].position, &ends[1].position));
            assert!(!problem.rig.has_gimbal() || problem.can_turn(&ends[0], &ends[1]));
        }
        let reaches = |pose: &Pose| pose.direction.is_none_or(|direction| problem.rig.reaches(&direction));
        assert!(refined.iter().all(|pose| problem.free.is_safe(&pose.position) && reaches(pose)));
    });
}

#[test]
fn the_samples_of_a_thinned_ground_are_counted_as_on_the_whole_one() {
    for_every_rig(|ground, path, _, _| {
        let thinned = ground.thinned(3);
        let is_in = |i: &&u32| i.is_multiple_of(3);
        assert_eq!(thinned.wanted, ground.wanted.iter().filter(is_in).copied().collect::<Vec<_>>());
        let [whole, part] = [ground, &thinned].map(|ground| Flight::new(ground, path));
        let mut worth = Worth::default();
        for &i in &thinned.wanted {
            let i = i as usize;
            assert_eq!(part.counts.cells.cells(i), whole.counts.cells.cells(i), "sample {i}");
            assert_eq!(part.counts.cells.is_missing(i), whole.counts.cells.is_missing(i), "sample {i}");
            assert_eq!(part.counts.matches.is_missing(i), whole.counts.matches.is_missing(i), "sample {i}");
            worth.captured += u32::from(ground.problem.is_capturable(i) && !whole.counts.cells.is_missing(i));
            worth.matched += u32::from(ground.problem.matchable[i] && !whole.counts.matches.is_missing(i));
        }
        assert_eq!(part.counts.worth(), worth);
        assert_eq!(thinned.share_of(ground.most), thinned.most);
        assert_eq!(ground.share_of(required(ground)), required(ground));
    });
}

#[test]
fn where_none_has_to_be_captured_captured_samples_are_worth_nothing() {
    for_every_rig(|both, path, settings, _| {
        let problem = both.problem;
        let alone = Ground::new(problem, settings, false, Counting::MatchedAlone, &StopToken::default());
        assert!(alone.wanted.iter().all(|&i| problem.matchable[i as usize]));
        let required = Worth { captured: 0, ..required(both) };
        let mut annealing = Annealing::new(&alone, path, Aim::LeastTime { required }, 5);
        (0..12).for_each(|_| annealing.round(1e9));
        let flight = Flight::new(&alone, &annealing.best().path);
        let priced = |captured: f64| Demand { required, prices_ns: Prices { captured, matched: 1e9 }, ..demand(both) };
        assert_eq!(priced(5e9).shortfall_ns(&flight.counts), priced(0.0).shortfall_ns(&flight.counts));
        assert!(alone.wanted.iter().all(|&i| !flight.counts.cells.is_missing(i as usize)), "none of them is gone to see");
        // What is said of the flight is its coverage all the same.
        let capturable: Vec<usize> = alone.wanted.iter().map(|&i| i as usize).filter(|&i| problem.is_capturable(i)).collect();
        let captured = capturable.iter().filter(|&&i| flight.counts.cells.cells(i) > problem.thresholds[i]).count();
        let percent = annealing.record().coverage_percent;
        assert!(captured > 0 && percent == 100.0 * captured as f64 / capturable.len() as f64, "{captured} and {percent} %");
    });
}

#[test]
fn after_a_change_of_samples_a_flight_is_as_good_as_one_counted_anew() {
    for_every_rig(|ground, path, _, _| {
        let thinned = ground.thinned(2);
        let mut annealing = Annealing::new(&thinned, path, Aim::LeastTime { required: required(ground) }, 6);
        (0..8).for_each(|_| annealing.round(1e9));
        annealing.move_to(ground);
        (0..4).for_each(|_| annealing.round(1e9));
        // By all samples, whatever the first rounds looked at.
        let best = annealing.best();
        let anew = Flight::new(ground, &best.path);
        assert_eq!((best.worth, best.duration_ns), (anew.counts.worth(), anew.duration_ns()));
    });
}

#[test]
fn prices_follow_as_much_as_a_round_can_have_changed() {
    for_every_rig(|ground, path, settings, _| {
        let aim = Aim::LeastTime { required: Worth { captured: ground.most.captured, matched: 0 } };
        let mut grown = Annealing::new(ground, path, aim, 7);
        (0..12).for_each(|_| grown.round(1e9));
        let mut few = settings.clone();
        (few.refine.round_moves, few.refine.sectors) = (1, 1);
        let few = Ground::new(ground.problem, &few, false, Counting::Matched, &StopToken::default());
        // What a price became, each time that it changed, as a share of what it was; with the number of waypoints.
        let followed = |ground: &Ground, rounds: u32, round: fn(&mut Annealing, f64)| {
            let mut annealing = Annealing::new(ground, &grown.best().path, aim, 8);
            let price_ns = |annealing: &Annealing| annealing.demand.prices_ns.captured;
            let mut changes = Vec::new();
            for _ in 0..rounds {
                let before_ns = price_ns(&annealing);
                round(&mut annealing, 1e7);
                let share = price_ns(&annealing) / before_ns;
                changes.extend((share != 1.0).then_some((share, annealing.flight.waypoints.len() as f64)));
            }
            changes
        };
        let rise = settings.refine.price_rise;
        let parts = followed(&few, 40, |annealing, ns| annealing.round(ns));
        for whole in [
            followed(ground, 8, |annealing, ns| annealing.round(ns)),
            followed(&few, 8, |annealing, ns| annealing.round_mending(ns)),
        ] {
            assert!(!whole.is_empty() && whole.iter().all(|&(share, _)| (share - rise).abs() < 1e-9), "{whole:?}");
        }
        let is_part = |&(share, waypoints): &(f64, f64)| waypoints > 2.0 && (share - rise.powf(1.0 / waypoints)).abs() < 1e-9;
        assert!(!parts.is_empty() && parts.iter().all(is_part), "{parts:?}");
    });
}
