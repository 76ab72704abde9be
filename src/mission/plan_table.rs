//! Plans as tables: what the daemon publishes, and the way back.

use nalgebra::{Point3, Unit, Vector3};
use overfly_table::plan::{
    CameraRow, CellsRow, INFEASIBLE, ImageRow, IterationRow, LimitsRow, MetricsRow, PlanCounts, PlanFacts, WaypointRow,
};
use overfly_table::{Block, PlanTable, PlanTableMut};

use crate::camera::Intrinsics;
use crate::frame::Geodetic;
use crate::settings::DynamicsSettings;
use crate::trajectory::egress::Egress;
use crate::trajectory::limits::{Limits, MOST_DEVIATION_M, Turning};
use crate::trajectory::plan::{Camera, Image, Iteration, Metrics, Plan, RunTimes, SceneStamp, StopReason, Waypoint};

/// Why a table is not a plan.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlanTableError {
    #[error("the plan's {what} holds a value that is not finite")]
    NotFinite { what: &'static str },
    #[error("the plan's {what} holds the code {code}, which this release does not know: use client and daemon of one release")]
    Code { what: &'static str, code: u64 },
    #[error("the plan's {what} is not a unit vector")]
    Direction { what: &'static str },
    #[error("the plan's text is not UTF-8 or lacks the line of its {missing}")]
    Text { missing: &'static str },
    #[error("an image names camera {camera}, but the rig has {cameras}")]
    Camera { camera: u32, cameras: usize },
    #[error("the plan's {what} lie beyond what a drone can fly by")]
    Limits { what: &'static str },
    #[error("there is no flight in the scene {scene:?}: {reason}")]
    Infeasible { scene: String, reason: String },
    #[error("the plan counts {counted} waypoints but holds {held}")]
    Count { counted: u64, held: usize },
}

/// Size of the table of a plan, blocks.
pub fn blocks(plan: &Plan) -> usize {
    counts(plan).blocks()
}

/// Writes a plan where it will be read: `into` is as long as [`blocks`] says.
pub fn write(plan: &Plan, times: &RunTimes, into: &mut [Block]) {
    let table = PlanTableMut::create(into, &counts(plan), &facts(plan, times));
    fill(table.waypoints, plan.waypoints.iter().map(waypoint_row));
    fill(table.images, plan.images.iter().map(image_row));
    fill(table.cameras, plan.cameras.iter().map(camera_row));
    fill(table.iterations, plan.convergence.iter().map(iteration_row));
    let cells = plan.cells.iter().zip(&plan.ceilings);
    fill(table.cells, cells.map(|(&covered, &ceiling)| CellsRow { covered, ceiling }));
    fill(table.text, text(plan).bytes());
}

/// The plan as a table in memory of its own.
pub fn to_blocks(plan: &Plan, times: &RunTimes) -> Vec<Block> {
    let mut table = vec![Block::ZERO; blocks(plan)];
    write(plan, times, &mut table);
    table
}

/// A table that says why there is no flight in a scene of this revision.
pub fn infeasible(scene: &str, revision: u64, reason: &str) -> Vec<Block> {
    let facts = PlanFacts { revision, stop: INFEASIBLE, ..PlanFacts::default() };
    let text = format!("{}\n{}\n", escape(scene), escape(reason));
    let counts = PlanCounts { text_bytes: text.len(), ..PlanCounts::default() };
    let mut blocks = vec![Block::ZERO; counts.blocks()];
    PlanTableMut::create(&mut blocks, &counts, &facts).text.copy_from_slice(text.as_bytes());
    blocks
}

fn counts(plan: &Plan) -> PlanCounts {
    PlanCounts {
        waypoints: plan.waypoints.len(),
        images: plan.images.len(),
        cameras: plan.cameras.len(),
        samples: plan.cells.len().min(plan.ceilings.len()),
        iterations: plan.convergence.len(),
        text_bytes: text(plan).len(),
    }
}

fn fill<T>(rows: &mut [T], values: impl Iterator<Item = T>) {
    rows.iter_mut().zip(values).for_each(|(row, value)| *row = value);
}

/// The plan in a table that somebody else may have written.
pub fn from_table(table: &PlanTable<'_>) -> Result<(Plan, RunTimes), PlanTableError> {
    let facts = table.facts;
    if facts.metrics.waypoints != table.waypoints.len() as u64 {
        return Err(PlanTableError::Count { counted: facts.metrics.waypoints, held: table.waypoints.len() });
    }
    if let Some(reason) = table.infeasible() {
        let scene = std::str::from_utf8(table.text).unwrap_or_default().lines().next().unwrap_or_default();
        return Err(PlanTableError::Infeasible { scene: unescape(scene), reason: unescape(reason) });
    }
    let mut lines =
        std::str::from_utf8(table.text).map_err(|_| PlanTableError::Text { missing: "scene" })?.split_terminator('\n');
    let mut line = |missing| lines.next().map(unescape).ok_or(PlanTableError::Text { missing });
    let (name, rig, method) = (line("scene")?, line("rig")?, line("method")?);
    let names: Vec<String> = lines.map(unescape).collect();
    if names.len() != table.cameras.len() {
        return Err(PlanTableError::Text { missing: "cameras" });
    }
    let cameras: Vec<Camera> =
        names.into_iter().zip(table.cameras).map(|(name, row)| camera(name, row)).collect::<Result<_, _>>()?;
    let plan = Plan {
        scene: SceneStamp { name, origin: origin(facts)?, revision: facts.revision },
        seed: facts.seed,
        rig,
        method,
        waypoints: table.waypoints.iter().map(waypoint).collect::<Result<_, _>>()?,
        images: table.images.iter().map(|row| image(row, cameras.len())).collect::<Result<_, _>>()?,
        cameras,
        metrics: metrics(&facts.metrics)?,
        limits: limits(&facts.limits)?,
        cells: table.cells.iter().map(|row| row.covered).collect(),
        ceilings: table.cells.iter().map(|row| row.ceiling).collect(),
        goal_percent: finite("goal", facts.goal_percent)?,
        matched_goal_percent: finite("goal of matches", facts.matched_goal_percent)?,
        egress: egress(facts.egress, table.waypoints.len())?,
        clearance_m: finite("clearance", facts.clearance_m)?,
        convergence: table.iterations.iter().map(iteration).collect::<Result<_, _>>()?,
        stop: stop_reason(facts.stop)?,
    };
    Ok((plan, run_times(facts)?))
}

fn facts(plan: &Plan, times: &RunTimes) -> PlanFacts {
    let origin = plan.scene.origin;
    let of_origin = |value: fn(&Geodetic) -> f64| origin.as_ref().map_or(0.0, value);
    PlanFacts {
        metrics: metrics_row(&plan.metrics, plan.waypoints.len()),
        limits: plan.limits.as_ref().map_or_else(LimitsRow::default, limits_row),
        revision: plan.scene.revision,
        seed: plan.seed,
        iterations: plan.convergence.len() as u64,
        stop: stop_code(plan.stop),
        origin_lat_deg: of_origin(|origin| origin.lat_deg),
        origin_lon_deg: of_origin(|origin| origin.lon_deg),
        origin_alt_m: of_origin(|origin| origin.alt_m),
        georeferenced: origin.is_some().into(),
        goal_percent: plan.goal_percent,
        matched_goal_percent: plan.matched_goal_percent,
        field_s: times.field_s,
        search_s: times.search_s,
        check_s: times.check_s,
        total_s: times.total_s,
        egress: u64::from(plan.egress.brakes) | u64::from(plan.egress.escapes) << 1,
        clearance_m: plan.clearance_m,
        threads: times.threads.into(),
    }
}

fn metrics_row(metrics: &Metrics, waypoints: usize) -> MetricsRow {
    MetricsRow {
        length_m: metrics.length_m,
        waypoints: waypoints as u64,
        movement_s: metrics.movement_s,
        turning_s: metrics.turning_s,
        flight_s: metrics.flight_s,
        profile_s: metrics.profile_s,
        battery_percent: metrics.battery_percent.unwrap_or(-1.0),
        coverage_percent: metrics.coverage_percent,
        coverage_exposed_percent: metrics.coverage_exposed_percent,
        capturable_percent: metrics.capturable_percent,
        matched_percent: metrics.matched_percent,
        information: metrics.information,
        objective: metrics.objective,
        delayed_exposures: metrics.delayed_exposures.into(),
        dropped_exposures: metrics.dropped_exposures.into(),
        blur_px: metrics.blur_px,
    }
}

fn metrics(row: &MetricsRow) -> Result<Metrics, PlanTableError> {
    let figure = |value| finite("metrics", value);
    let count = |code| u32::try_from(code).map_err(|_| PlanTableError::Code { what: "metrics", code });
    Ok(Metrics {
        length_m: figure(row.length_m)?,
        movement_s: figure(row.movement_s)?,
        turning_s: figure(row.turning_s)?,
        flight_s: figure(row.flight_s)?,
        profile_s: figure(row.profile_s)?,
        battery_percent: Some(figure(row.battery_percent)?).filter(|&percent| percent >= 0.0),
        coverage_percent: figure(row.coverage_percent)?,
        coverage_exposed_percent: figure(row.coverage_exposed_percent)?,
        capturable_percent: figure(row.capturable_percent)?,
        matched_percent: figure(row.matched_percent)?,
        information: figure(row.information)?,
        objective: figure(row.objective)?,
        delayed_exposures: count(row.delayed_exposures)?,
        dropped_exposures: count(row.dropped_exposures)?,
        blur_px: figure(row.blur_px)?,
    })
}

fn limits_row(limits: &Limits) -> LimitsRow {
    let dynamics = &limits.dynamics;
    LimitsRow {
        turning: match limits.turning {
            Turning::Nothing => 1,
            Turning::View => 2,
            Turning::Nose => 3,
        },
        cruise_mps: limits.cruise_mps,
        acceleration_mps2: dynamics.acceleration_mps2,
        jerk_mps3: dynamics.jerk_mps3,
        lateral_mps2: dynamics.lateral_mps2,
        corner_deviation_m: dynamics.corner_deviation_m,
        yaw_rate_dps: dynamics.yaw_rate_dps,
        gimbal_rate_dps: dynamics.gimbal_rate_dps,
        entry_mps: limits.entry_mps,
    }
}

fn limits(row: &LimitsRow) -> Result<Option<Limits>, PlanTableError> {
    let turning = match row.turning {
        0 => return Ok(None),
        1 => Turning::Nothing,
        2 => Turning::View,
        3 => Turning::Nose,
        code => return Err(PlanTableError::Code { what: "limits", code }),
    };
    let dynamics = DynamicsSettings {
        acceleration_mps2: row.acceleration_mps2,
        jerk_mps3: row.jerk_mps3,
        lateral_mps2: row.lateral_mps2,
        corner_deviation_m: row.corner_deviation_m,
        yaw_rate_dps: row.yaw_rate_dps,
        gimbal_rate_dps: row.gimbal_rate_dps,
    };
    let limits = Limits { turning, cruise_mps: row.cruise_mps, dynamics, entry_mps: row.entry_mps };
    if limits.are_sound() { Ok(Some(limits)) } else { Err(PlanTableError::Limits { what: "limits" }) }
}

fn egress(code: u64, waypoints: usize) -> Result<Egress, PlanTableError> {
    let egress = Egress { brakes: code & 1 != 0, escapes: code & 2 != 0 };
    if code > 3 || egress.legs() >= waypoints.max(1) {
        return Err(PlanTableError::Code { what: "egress", code });
    }
    Ok(egress)
}

fn run_times(facts: &PlanFacts) -> Result<RunTimes, PlanTableError> {
    Ok(RunTimes {
        field_s: finite("times", facts.field_s)?,
        search_s: finite("times", facts.search_s)?,
        check_s: finite("times", facts.check_s)?,
        total_s: finite("times", facts.total_s)?,
        threads: u32::try_from(facts.threads).map_err(|_| PlanTableError::Code { what: "threads", code: facts.threads })?,
    })
}

fn origin(facts: &PlanFacts) -> Result<Option<Geodetic>, PlanTableError> {
    let (lat, lon, alt) = (facts.origin_lat_deg, facts.origin_lon_deg, facts.origin_alt_m);
    Ok(flag("origin", facts.georeferenced)?.then_some(Geodetic {
        lat_deg: finite("origin", lat)?,
        lon_deg: finite("origin", lon)?,
        alt_m: finite("origin", alt)?,
    }))
}

fn waypoint_row(waypoint: &Waypoint) -> WaypointRow {
    WaypointRow {
        position_m: waypoint.position_m.into(),
        direction: waypoint.direction.map_or([0.0; 3], |direction| direction.into_inner().into()),
        has_direction: waypoint.direction.is_some().into(),
        deviation_m: waypoint.deviation_m,
    }
}

fn waypoint(row: &WaypointRow) -> Result<Waypoint, PlanTableError> {
    Ok(Waypoint {
        position_m: Point3::from(finite3("waypoints", row.position_m)?),
        direction: direction("waypoints", row.has_direction, row.direction)?,
        deviation_m: Some(row.deviation_m)
            .filter(|deviation_m| (0.0..=MOST_DEVIATION_M).contains(deviation_m))
            .ok_or(PlanTableError::Limits { what: "arcs" })?,
    })
}

fn image_row(image: &Image) -> ImageRow {
    ImageRow {
        position_m: image.position_m.into(),
        direction: image.direction.map_or([0.0; 3], |direction| direction.into_inner().into()),
        up: image.up.into(),
        fov_deg: image.fov_deg.unwrap_or([0.0; 2]),
        time_s: image.time_s,
        camera: image.camera,
        has_direction: image.direction.is_some().into(),
        selected: image.selected.into(),
    }
}

fn image(row: &ImageRow, cameras: usize) -> Result<Image, PlanTableError> {
    if row.camera as usize >= cameras {
        return Err(PlanTableError::Camera { camera: row.camera, cameras });
    }
    let [width, height] = [finite("images", row.fov_deg[0])?, finite("images", row.fov_deg[1])?];
    Ok(Image {
        position_m: Point3::from(finite3("images", row.position_m)?),
        direction: direction("images", row.has_direction.into(), row.direction)?,
        up: Vector3::from(finite3("images", row.up)?),
        fov_deg: (width != 0.0 || height != 0.0).then_some([width, height]),
        camera: row.camera,
        time_s: finite("images", row.time_s)?,
        selected: flag("images", row.selected.into())?,
    })
}

fn camera_row(camera: &Camera) -> CameraRow {
    let intrinsics = camera.intrinsics.unwrap_or(Intrinsics { focal_mm: 0.0, sensor_mm: [0.0; 2], pixels: [0; 2] });
    let Intrinsics { focal_mm, sensor_mm, pixels } = intrinsics;
    CameraRow { pixel_rad: camera.pixel_rad, focal_mm, sensor_mm, pixels }
}

fn camera(name: String, row: &CameraRow) -> Result<Camera, PlanTableError> {
    let [width, height] = row.sensor_mm;
    let focal_mm = finite("cameras", row.focal_mm)?;
    let sensor_mm = [finite("cameras", width)?, finite("cameras", height)?];
    let intrinsics = (focal_mm != 0.0).then_some(Intrinsics { focal_mm, sensor_mm, pixels: row.pixels });
    Ok(Camera { name, intrinsics, pixel_rad: finite("cameras", row.pixel_rad)? })
}

fn iteration_row(iteration: &Iteration) -> IterationRow {
    IterationRow {
        objective: iteration.objective,
        coverage_percent: iteration.coverage_percent,
        length_m: iteration.length_m,
        turning_s: iteration.turning_s,
    }
}

fn iteration(row: &IterationRow) -> Result<Iteration, PlanTableError> {
    let figure = |value| finite("iterations", value);
    Ok(Iteration {
        objective: figure(row.objective)?,
        coverage_percent: figure(row.coverage_percent)?,
        length_m: figure(row.length_m)?,
        turning_s: figure(row.turning_s)?,
    })
}

fn stop_code(stop: StopReason) -> u64 {
    match stop {
        StopReason::GoalReached => 0,
        StopReason::IterationsUsed => 1,
        StopReason::Cancelled => 2,
        StopReason::MemoryUsed => 3,
        StopReason::SpaceExhausted => 4,
        StopReason::Complete => 5,
        StopReason::Repaired => 6,
        StopReason::Improved => 7,
    }
}

fn stop_reason(code: u64) -> Result<StopReason, PlanTableError> {
    match code {
        0 => Ok(StopReason::GoalReached),
        1 => Ok(StopReason::IterationsUsed),
        2 => Ok(StopReason::Cancelled),
        3 => Ok(StopReason::MemoryUsed),
        4 => Ok(StopReason::SpaceExhausted),
        5 => Ok(StopReason::Complete),
        6 => Ok(StopReason::Repaired),
        7 => Ok(StopReason::Improved),
        code => Err(PlanTableError::Code { what: "stop reason", code }),
    }
}

/// Scene, rig, method and cameras, one line each; a line break in a name is written as `\n`.
fn text(plan: &Plan) -> String {
    let names = [&plan.scene.name, &plan.rig, &plan.method].into_iter().chain(plan.cameras.iter().map(|camera| &camera.name));
    names.map(|name| escape(name) + "\n").collect()
}

fn escape(line: &str) -> String {
    line.replace('\\', "\\\\").replace('\n', "\\n")
}

fn unescape(line: &str) -> String {
    let mut name = String::with_capacity(line.len());
    let mut letters = line.chars();
    while let Some(letter) = letters.next() {
        match (letter, letter == '\\') {
            (_, true) => name.push(if letters.next() == Some('n') { '\n' } else { '\\' }),
            (plain, false) => name.push(plain),
        }
    }
    name
}

fn direction(what: &'static str, has: u64, vector: [f64; 3]) -> Result<Option<Unit<Vector3<f64>>>, PlanTableError> {
    if !flag(what, has)? {
        return Ok(None);
    }
    let vector = Vector3::from(finite3(what, vector)?);
    // Taken as it is, so that the way there and back changes no bit.
    if (vector.norm() - 1.0).abs() > 1e-9 {
        return Err(PlanTableError::Direction { what });
    }
    Ok(Some(Unit::new_unchecked(vector)))
}

fn flag(what: &'static str, code: u64) -> Result<bool, PlanTableError> {
    match code {
        0 => Ok(false),
        1 => Ok(true),
        code => Err(PlanTableError::Code { what, code }),
    }
}

fn finite3(what: &'static str, values: [f64; 3]) -> Result<[f64; 3], PlanTableError> {
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(PlanTableError::NotFinite { what }) }
}

fn finite(what: &'static str, value: f64) -> Result<f64, PlanTableError> {
    if value.is_finite() { Ok(value) } else { Err(PlanTableError::NotFinite { what }) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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
            lens in prop::option::of((1.0..100.0f64, prop::array::uniform2(1.0..50.0f64), prop::array::uniform2(16u32..9000))), pixel_rad in number(), [goal_percent, matched_goal_percent, matched_percent] in prop::array::uniform3(number()), clearance_m in number(),
            all_cells in prop::collection::vec((any::<u16>(), any::<u16>()), 0..50),
            convergence in prop::collection::vec(prop::array::uniform4(number()), 0..20),
            stop in prop::sample::select(vec![
                StopReason::GoalReached, StopReason::IterationsUsed, StopReason::Cancelled, StopReason::MemoryUsed, StopReason::SpaceExhausted,
                StopReason::Complete, StopReason::Repaired, StopReason::Improved,
            ]),
        ) -> Plan {
            let [scene, rig, method, one, two] = names;
            let (cells, ceilings) = all_cells.into_iter().unzip();
            let intrinsics = lens.map(|(focal_mm, sensor_mm, pixels)| Intrinsics { focal_mm, sensor_mm, pixels });
            let [length_m, movement_s, turning_s, flight_s, profile_s, coverage_percent, coverage_exposed_percent, capturable_percent,
                information, objective] = figures;
            Plan {
                scene: SceneStamp {
                    name: scene, origin: origin.map(|[lat_deg, lon_deg, alt_m]| Geodetic { lat_deg, lon_deg, alt_m }), revision },
                seed, rig, method,
                cameras: vec![Camera { name: one, intrinsics, pixel_rad }, Camera { name: two, intrinsics: None, pixel_rad: 1e-3 }],
                waypoints: waypoints.into_iter().map(|(position_m, direction)| Waypoint { position_m, direction, deviation_m }).collect(),
                images, cells, ceilings, goal_percent, matched_goal_percent, clearance_m, stop, limits, egress: Egress::default(),
                metrics: Metrics { length_m, movement_s, turning_s, flight_s, profile_s, battery_percent, coverage_percent, coverage_exposed_percent,
                    capturable_percent, matched_percent, information, objective, delayed_exposures: exposures[0], dropped_exposures: exposures[1], blur_px },
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
            let back = from_table(&PlanTable::open(&blocks).unwrap()).unwrap();
            prop_assert_eq!(back, (plan, times));
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
}
