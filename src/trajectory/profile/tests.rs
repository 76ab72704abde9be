//! The profile against times worked out by hand, its limits, and the local rules that it is made of.

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::camera::direction_of;
use crate::settings::Settings;

fn limits() -> (FlightSettings, DynamicsSettings) {
    let Settings { flight, .. } = Settings::default();
    let dynamics = DynamicsSettings {
        acceleration_mps2: 2.0,
        // As good as boundless, so that the times can be worked out by hand; what the jerk costs is the affair of straight parts.
        jerk_mps3: 1e12,
        lateral_mps2: 2.0,
        corner_deviation_m: 1.0,
        yaw_rate_dps: 90.0,
        gimbal_rate_dps: 45.0,
    };
    (FlightSettings { cruise_speed_mps: 8.0, ..flight }, dynamics)
}

fn path(corners: &[[f64; 3]]) -> Vec<Pose> {
    corners.iter().map(|&corner| Pose { position: Point3::from(corner), direction: None }).collect()
}

fn profile(rig: &str, path: &[Pose]) -> Profile {
    let (flight, dynamics) = limits();
    Profile::new(path, &Rig::preset(rig).unwrap(), &flight, &dynamics)
}

#[test]
fn a_straight_leg_is_flown_with_one_rise_and_one_fall() {
    // From rest to 8 m/s at 2 m/s^2: 4 s on 16 m, the same at the end; 68 m at 8 m/s between.
    let long = profile("panoramic", &path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0]]));
    assert!((long.duration_s() - (4.0 + 68.0 / 8.0 + 4.0)).abs() < 1e-9);
    for (flown_m, time_s) in [(0.0, 0.0), (4.0, 2.0), (16.0, 4.0), (50.0, 8.25), (84.0, 12.5), (96.0, 14.5), (100.0, 16.5)] {
        assert!((long.time_at_s(0, flown_m) - time_s).abs() < 1e-9, "{flown_m} m");
    }
    // Too short for the cruise speed: half of it speeding up.
    let short = profile("panoramic", &path(&[[0.0, 0.0, 30.0], [8.0, 0.0, 30.0]]));
    assert!((short.duration_s() - 2.0 * (2.0f64 * 4.0 / 2.0).sqrt()).abs() < 1e-9);
}

#[test]
fn a_right_angle_is_rounded_as_wide_as_its_deviation_allows() {
    let turn = profile("panoramic", &path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0], [100.0, 100.0, 30.0]]));
    // r (1/cos 45 - 1) = 1 m, so r = cut = 2.414 m and v = sqrt(2 r) = 2.197 m/s.
    let radius_m = 1.0 / (2f64.sqrt() - 1.0);
    let speed_mps = (2.0 * radius_m).sqrt();
    let fall_s = (8.0 - speed_mps) / 2.0;
    let fall_m = (64.0 - speed_mps * speed_mps) / 4.0;
    let leg_s = 4.0 + (100.0 - radius_m - 16.0 - fall_m) / 8.0 + fall_s;
    let arc_s = radius_m * std::f64::consts::FRAC_PI_2 / speed_mps;
    assert!((turn.duration_s() - (2.0 * leg_s + arc_s)).abs() < 1e-9);
    assert!((turn.time_at_s(0, 100.0) - turn.time_at_s(1, 0.0)).abs() < 1e-9, "the corner is passed once");
    assert!((turn.time_at_s(0, 100.0) - turn.duration_s() / 2.0).abs() < 1e-9);
}

#[test]
fn a_hairpin_is_a_stop_and_a_nose_first_drone_turns_round_in_it() {
    let there_and_back = path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0], [0.0, 0.0, 30.0]]);
    assert!((profile("panoramic", &there_and_back).duration_s() - 33.0).abs() < 1e-6);
    assert!((profile("m300-oblique", &there_and_back).duration_s() - 35.0).abs() < 1e-6);
}

#[test]
fn at_a_stop_the_drone_waits_at_the_waypoint_and_turns_its_nose() {
    let there_and_back = path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0], [0.0, 0.0, 30.0]]);
    let profile = profile("m300-oblique", &there_and_back);
    // 16.5 s there, 180 degrees at 90 degrees a second, 16.5 s back.
    let arriving = profile.passing(0, 100.0).unwrap();
    assert!((arriving.time_s - 16.5).abs() < 1e-6 && arriving.heading == Vector3::x_axis());
    for (time_s, azimuth_deg) in [(16.6, 81.0), (17.5, 0.0), (18.4, -81.0)] {
        let passage = profile.at(time_s).unwrap();
        assert_eq!((passage.position_m, passage.velocity_mps), (there_and_back[1].position, Vector3::zeros()), "{time_s} s");
        let turned_deg = libm::atan2(passage.heading.x, passage.heading.y.abs()).to_degrees();
        assert!((turned_deg - azimuth_deg).abs() < 1e-3, "{turned_deg} after {time_s} s");
    }
    assert_eq!(arriving.position_m, there_and_back[1].position);
    assert!(profile.at(18.6).unwrap().velocity_mps.x < 0.0);
}

#[test]
fn a_camera_that_turns_far_slows_its_leg_down() {
    let mut leg = path(&[[0.0, 0.0, 30.0], [100.0, 0.0, 30.0]]);
    leg[0].direction = Some(direction_of(0.0, 0.0));
    leg[1].direction = Some(direction_of(0.0, -80.0));
    let slow = profile("phantom4-rtk", &leg).duration_s();
    leg[1].direction = Some(direction_of(0.0, -60.0));
    let pitching = profile("phantom4-rtk", &leg).duration_s();
    assert!((pitching - 16.5).abs() < 1e-9, "60 degrees at 45 degrees a second fit into 100 m: {pitching}");
    assert!((slow - 16.5).abs() < 1e-9, "80 degrees as well: {slow}");
    leg[1].position.x = 8.0;
    let turning = profile("phantom4-rtk", &leg).duration_s();
    // 60 degrees at 45 degrees a second: 8 m in 4/3 s would need 6 m/s, which is never reached on 8 m.
    assert!((turning - 4.0).abs() < 1e-9, "{turning}");
    leg[1].direction = Some(direction_of(170.0, -30.0));
    assert!(profile("phantom4-rtk", &leg).duration_s() > 4.0);
}

proptest! {
    #[test]
    fn time_runs_forward_and_never_beats_the_limits(
        corners in prop::collection::vec([-100.0..100.0f64, -100.0..100.0, 5.0..100.0], 2..9), rig in 0usize..3,
    ) {
        prop_assume!(corners.windows(2).all(|pair| (Point3::from(pair[1]) - Point3::from(pair[0])).norm() > 8.0));
        let path = path(&corners);
        let profile = profile(["panoramic", "m300-oblique", "phantom4-rtk"][rig], &path);
        let mut length_m = 0.0;
        let (mut before_s, mut cut_m) = (-1e-9, 0.0);
        for (leg, ends) in path.windows(2).enumerate() {
            let leg_m = (ends[1].position - ends[0].position).norm();
            length_m += leg_m;
            cut_m += profile.legs[leg].cut_m.iter().sum::<f64>();
            prop_assert!(profile.legs[leg].cut_m.iter().sum::<f64>() <= leg_m + 1e-9);
            for step in 0..=40 {
                let time_s = profile.time_at_s(leg, leg_m * f64::from(step) / 40.0);
                prop_assert!(time_s >= before_s - 1e-9, "leg {} step {}: {} after {}", leg, step, time_s, before_s);
                before_s = time_s;
            }
        }
        prop_assert!((profile.duration_s() - before_s).abs() < 1e-6);
        prop_assert!(profile.duration_s() >= (length_m - cut_m) / 8.0);
        // Not slower than stopping at every corner and turning round there.
        let stops: f64 = path.windows(2).map(|ends| {
            let leg_m = (ends[1].position - ends[0].position).norm();
            if leg_m > 32.0 { 8.0 + (leg_m - 32.0) / 8.0 } else { 2.0 * (leg_m / 2.0).sqrt() * 2f64.sqrt() / 1.0 }
        }).sum();
        prop_assert!(profile.duration_s() <= stops + 2.0 * (path.len() - 2) as f64 + 1e-6);
    }
}

proptest! {
    #[test]
    fn the_flown_curve_has_no_gaps_and_keeps_every_limit(
        corners in prop::collection::vec([-60.0..60.0f64, -60.0..60.0, 5.0..60.0], 2..7), rig in 0usize..3, deviation_m in 0.0..3.0f64,
    ) {
        let Settings { flight, dynamics, .. } = Settings::default();
        let path = path(&corners);
        let limits = Limits::new(&Rig::preset(["panoramic", "m300-oblique", "phantom4-rtk"][rig]).unwrap(), &flight, &dynamics);
        let profile = Profile::rounded(&path, &limits, &vec![deviation_m; path.len()]);
        let steps = 4000;
        let step_s = profile.duration_s() / f64::from(steps);
        let at = |k: u32| profile.at(step_s * f64::from(k)).unwrap();
        let most_mps2 = dynamics.acceleration_mps2.max(dynamics.lateral_mps2);
        let (mut flown_m, mut before_mps2) = (0.0, 0.0);
        for k in 0..steps {
            let (now, next) = (at(k), at(k + 1));
            let (speed_mps, next_mps) = (now.velocity_mps.norm(), next.velocity_mps.norm());
            prop_assert!(speed_mps <= limits.cruise_mps + 1e-9);
            let change = next.velocity_mps - now.velocity_mps;
            prop_assert!(change.norm() <= most_mps2 * step_s * (1.0 + 1e-6) + 1e-7, "{} m/s^2", change.norm() / step_s);
            let mean = (now.velocity_mps + next.velocity_mps) / 2.0;
            let off_m = (next.position_m - now.position_m - mean * step_s).norm();
            prop_assert!(off_m <= most_mps2 * step_s * step_s + 1e-7, "a gap of {} m at {} s", off_m, now.time_s);
            let mps2 = (next_mps - speed_mps) / step_s;
            prop_assert!(mps2.abs() <= dynamics.acceleration_mps2 * (1.0 + 1e-6) + 1e-7 / step_s);
            let jerk = (mps2 - before_mps2) / step_s;
            prop_assert!(jerk.abs() <= dynamics.jerk_mps3 * (1.0 + 1e-6) + 1e-7 / step_s / step_s, "{} m/s^3", jerk);
            before_mps2 = mps2;
            flown_m += (next.position_m - now.position_m).norm();
        }
        let length_m: f64 = path.windows(2).map(|ends| (ends[1].position - ends[0].position).norm()).sum();
        prop_assert!(flown_m <= length_m + 1e-6);
        for (leg, ends) in path.windows(2).enumerate() {
            let leg_m = (ends[1].position - ends[0].position).norm();
            for step in 0..=10 {
                let passed = profile.passing(leg, leg_m * f64::from(step) / 10.0).unwrap();
                let there = profile.at(passed.time_s).unwrap();
                prop_assert!((passed.position_m - there.position_m).norm() < 1e-6 && (passed.time_s - there.time_s).abs() < 1e-12);
                // On the leg, or beside it on an arc.
                let on_leg = ends[0].position + (ends[1].position - ends[0].position) * (f64::from(step) / 10.0);
                prop_assert!((passed.position_m - on_leg).norm() <= 2.0 * deviation_m + 1e-6);
            }
        }
    }

    #[test]
    fn local_rules_add_up_to_the_profile(
        corners in prop::collection::vec([-60.0..60.0f64, -60.0..60.0, 5.0..60.0], 2..7), rig in 0usize..3,
    ) {
        let Settings { flight, dynamics, .. } = Settings::default();
        let rig = Rig::preset(["panoramic", "m300-oblique", "phantom4-rtk"][rig]).unwrap();
        let path = path(&corners);
        let limits = Limits::new(&rig, &flight, &dynamics);
        let legs_m: Vec<f64> = path.windows(2).map(|ends| (ends[1].position - ends[0].position).norm()).collect();
        let leg_mps: Vec<f64> = path.windows(2).map(|ends| limits.leg_mps(&ends[0], &ends[1])).collect();
        let mut turns = vec![Corner::default(); path.len()];
        for k in 1..path.len() - 1 {
            turns[k] = limits.corner(&path[k - 1], &path[k], &path[k + 1], leg_mps[k - 1].min(leg_mps[k]));
        }
        bound_speeds(&limits, &mut turns, &legs_m);
        let sum_s: f64 = (0..legs_m.len()).map(|k| limits.leg_s(legs_m[k], &[turns[k], turns[k + 1]], leg_mps[k])).sum();
        let profile = Profile::new(&path, &rig, &flight, &dynamics);
        prop_assert!((sum_s - profile.duration_s()).abs() < 1e-9, "{} s, but {} s", sum_s, profile.duration_s());
        // Every speed can be reached from the one before and left for the one behind.
        for (k, ends) in turns.windows(2).enumerate() {
            for [from, to] in [[&ends[0], &ends[1]], [&ends[1], &ends[0]]] {
                prop_assert!(to.speed_mps <= limits.reachable_mps(from.speed_mps, legs_m[k], [&ends[0], &ends[1]]) + 1e-9);
            }
        }
    }
}
