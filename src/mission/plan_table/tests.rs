use nalgebra::{Point3, Unit, Vector3};
use proptest::prelude::*;

use super::*;
use crate::camera::Intrinsics;
use crate::settings::DynamicsSettings;
use crate::trajectory::egress::Egress;
use crate::trajectory::limits::{Limits, Turning};
use crate::trajectory::plan::{Image, Iteration, Metrics, StopReason, Waypoint};

fn number() -> impl Strategy<Value = f64> {
    -1e6..1e6f64
}

fn unit() -> impl Strategy<Value = Option<Unit<Vector3<f64>>>> {
    let vector = prop::array::uniform3(-1.0..1.0f64).prop_filter("not zero", |v| v.iter().any(|x| x.abs() > 1e-3));
    prop::option::of(vector.prop_map(|v| Unit::new_normalize(Vector3::from(v))))
}

fn point() -> impl Strategy<Value = Point3<f64>> {
    prop::array::uniform3(number()).prop_map(Point3::from)
}

prop_compose! {
    fn an_image()(position_m in point(), direction in unit(), up in prop::array::uniform3(number()), selected: bool,
        fov_deg in prop::option::of(prop::array::uniform2(1.0..170.0f64)), camera in 0u32..2, time_s in number(),
    ) -> Image {
        Image { position_m, direction, up: Vector3::from(up), fov_deg, camera, time_s, selected }
    }
}

prop_compose! {
    fn the_limits()(
        turning in prop::sample::select(vec![Turning::Nothing, Turning::View, Turning::Nose]), [cruise_mps, entry_mps] in prop::array::uniform2(0.1..100.0f64),
        [acceleration_mps2, jerk_mps3, lateral_mps2, corner_deviation_m, yaw_rate_dps, gimbal_rate_dps] in prop::array::uniform6(0.1..100.0f64),
    ) -> Limits {
        let dynamics =
            DynamicsSettings { acceleration_mps2, jerk_mps3, lateral_mps2, corner_deviation_m, yaw_rate_dps, gimbal_rate_dps };
        Limits { turning, cruise_mps, dynamics, entry_mps }
    }
}

prop_compose! {
    fn a_plan()(
        names in prop::array::uniform5(any::<String>()), seed: u64, revision: u64,
        origin in prop::option::of(prop::array::uniform3(number())),
        waypoints in prop::collection::vec((point(), unit()), 0..20),
        images in prop::collection::vec(an_image(), 0..20),
        deviation_m in 0.0..=100.0f64, limits in prop::option::of(the_limits()), exposures in any::<[u32; 2]>(), blur_px in number(),
        figures in prop::array::uniform10(number()), battery_percent in prop::option::of(0.0..1e4f64),
        lens in prop::option::of((1.0..100.0f64, prop::array::uniform2(1.0..50.0f64), prop::array::uniform2(16u32..9000))),
        pixel_rad in number(), clearance_m in number(),
        [goal_percent, matched_goal_percent, matched_percent] in prop::array::uniform3(number()),
        all_cells in prop::collection::vec((any::<u16>(), any::<u16>()), 0..50),
        convergence in prop::collection::vec(prop::array::uniform4(number()), 0..20),
        stop in prop::sample::select(vec![
            StopReason::GoalReached, StopReason::IterationsUsed, StopReason::Cancelled, StopReason::MemoryUsed, StopReason::SpaceExhausted,
            StopReason::Complete, StopReason::Safe, StopReason::Repaired, StopReason::Improved,
        ]),
    ) -> Plan {
        let [scene, rig, method, one, two] = names;
        let (cells, ceilings): (Vec<u16>, Vec<u16>) = all_cells.into_iter().unzip();
        let intrinsics = lens.map(|(focal_mm, sensor_mm, pixels)| Intrinsics { focal_mm, sensor_mm, pixels });
        let [length_m, movement_s, turning_s, flight_s, profile_s, coverage_percent, coverage_exposed_percent, capturable_percent,
            information, objective] = figures;
        let flown = Metrics { length_m, movement_s, turning_s, flight_s, profile_s, battery_percent, delayed_exposures: exposures[0],
            dropped_exposures: exposures[1], blur_px, ..Metrics::uncounted() };
        let metrics = match stop {
            StopReason::Safe => flown,
            _ => Metrics { coverage_percent, coverage_exposed_percent, capturable_percent, matched_percent, information, objective, ..flown },
        };
        let (cells, ceilings) = if stop == StopReason::Safe { (Vec::new(), Vec::new()) } else { (cells, ceilings) };
        Plan {
            scene: SceneStamp {
                name: scene, origin: origin.map(|[lat_deg, lon_deg, alt_m]| Geodetic { lat_deg, lon_deg, alt_m }), revision },
            seed, rig, method,
            cameras: vec![Camera { name: one, intrinsics, pixel_rad }, Camera { name: two, intrinsics: None, pixel_rad: 1e-3 }],
            waypoints: waypoints.into_iter().map(|(position_m, direction)| Waypoint { position_m, direction, deviation_m }).collect(),
            images, cells, ceilings, goal_percent, matched_goal_percent, clearance_m, stop, limits, egress: Egress::default(),
            metrics,
            convergence: convergence.into_iter().map(|[objective, coverage_percent, length_m, turning_s]|
                Iteration { objective, coverage_percent, length_m, turning_s }).collect(),
        }
    }
}

proptest! {
    #[test]
    fn a_plan_comes_back_from_its_table_bit_for_bit(plan in a_plan(), seconds in prop::array::uniform4(number()), threads: u32) {
        let [field_s, search_s, check_s, total_s] = seconds;
        let times = RunTimes { field_s, search_s, check_s, total_s, threads };
        let blocks = to_blocks(&plan, &times);
        let mut over = vec![Block([u64::MAX; 8]); blocks.len()];
        write(&plan, &times, &mut over);
        prop_assert!(over == blocks, "something is left of what the memory held");
        let back = from_table(&PlanTable::open(&blocks).unwrap()).unwrap();
        // NaN is not equal to itself, but to the last bit.
        prop_assert_eq!(to_blocks(&back.0, &back.1), blocks);
        prop_assert!(plan.stop == StopReason::Safe || back == (plan, times));
    }

    #[test]
    fn a_damaged_table_is_an_error_or_another_plan(plan in a_plan(), place: prop::sample::Index, word: u64) {
        let mut blocks = to_blocks(&plan, &RunTimes::default());
        let words: &mut [u64] = bytemuck::cast_slice_mut(&mut blocks);
        let place = place.index(words.len());
        words[place] = word;
        if let Ok(table) = PlanTable::open(&blocks) && let Ok((plan, _)) = from_table(&table) {
            prop_assert!(plan.waypoints.iter().all(|waypoint| waypoint.position_m.iter().all(|value| value.is_finite())));
        }
    }
}

#[test]
fn what_is_captured_is_counted_or_it_is_not() {
    let plan = crate::mission::fixture::plan("panoramic", &[[0.0, 0.0, 30.0], [40.0, 0.0, 30.0]]);
    let back = |plan: &Plan| from_table(&PlanTable::open(&to_blocks(plan, &RunTimes::default())).unwrap()).map(drop);
    let safe =
        Plan { stop: StopReason::Safe, metrics: Metrics::uncounted(), cells: Vec::new(), ceilings: Vec::new(), ..plan.clone() };
    assert_eq!([back(&plan), back(&safe)], [Ok(()), Ok(())]);
    let counted = Metrics { coverage_percent: 90.0, ..Metrics::uncounted() };
    assert_eq!(back(&Plan { metrics: counted, ..safe.clone() }), Err(PlanTableError::Counted));
    assert_eq!(back(&Plan { cells: vec![3], ceilings: vec![9], ..safe.clone() }), Err(PlanTableError::Counted));
    assert_eq!(back(&Plan { stop: StopReason::Repaired, ..safe }), Err(PlanTableError::NotFinite { what: "metrics" }));
}
