//! A made-up block with a made-up plan, for tests of writers: no planner is needed to check a file.

use nalgebra::{Point3, Vector3};
use overfly::frame::Geodetic;
use overfly::trajectory::plan::{Camera, Image, Iteration, Metrics, Plan, SceneStamp, StopReason, Waypoint};
use overfly_table::field::{FieldCounts, FieldFacts, RingRow, SampleRow, StructureRow};
use overfly_table::{Block, FieldTable, FieldTableMut};

/// A structure of the block: rings in metres (exterior counter-clockwise, holes clockwise) and its height.
pub struct Building {
    pub name: String,
    pub rings: Vec<Vec<[f64; 2]>>,
    pub top_m: f64,
}

/// A box from corner to corner.
pub fn box_building(name: &str, min: [f64; 2], max: [f64; 2], top_m: f64) -> Building {
    let ring = vec![min, [max[0], min[1]], max, [min[0], max[1]]];
    Building { name: name.to_owned(), rings: vec![ring], top_m }
}

/// `rows` by `columns` buildings between streets of 14 m; some are perimeter blocks with a courtyard.
pub fn city(rows: usize, columns: usize) -> Vec<Building> {
    let mut buildings = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let (x, y) = (column as f64 * 46.0 - columns as f64 * 23.0, row as f64 * 42.0 - rows as f64 * 21.0);
            let noise = chance((row * 31 + column) as u64);
            let top_m = 8.0 + 60.0 * noise * noise;
            let mut building = box_building(&format!("b{row}-{column}"), [x, y], [x + 32.0 - 8.0 * noise, y + 28.0], top_m);
            if (row + column) % 4 == 0 {
                building.rings.push(vec![[x + 8.0, y + 8.0], [x + 8.0, y + 20.0], [x + 18.0, y + 20.0], [x + 18.0, y + 8.0]]);
            }
            buildings.push(building);
        }
    }
    buildings
}

/// A number between 0 and 1 that looks random and is the same for the same `key`.
pub fn chance(key: u64) -> f64 {
    let mut bits = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

pub const THRESHOLD_CELLS: u32 = 38;

/// The field's table: samples about every 5 m on walls and roofs; one wall in five is a party wall, buried.
pub fn field(buildings: &[Building]) -> Vec<Block> {
    let samples: Vec<Vec<SampleRow>> =
        buildings.iter().enumerate().map(|(index, building)| samples_of(index, building)).collect();
    let all_rings = || buildings.iter().flat_map(|building| &building.rings);
    let counts = FieldCounts {
        samples: samples.iter().map(Vec::len).sum(),
        structures: buildings.len(),
        rings: all_rings().count(),
        points: all_rings().map(Vec::len).sum(),
        name_bytes: buildings.iter().map(|building| building.name.len()).sum(),
        ..Default::default()
    };
    let mut facts = FieldFacts { revision: 1, hemisphere_cells: 128, threshold_cells: THRESHOLD_CELLS, ..Default::default() };
    facts.min_m = [f64::INFINITY, f64::INFINITY, 0.0];
    facts.max_m = [f64::NEG_INFINITY, f64::NEG_INFINITY, 0.0];
    for building in buildings {
        for point in building.rings.iter().flatten() {
            for (axis, value) in point.iter().enumerate() {
                facts.min_m[axis] = facts.min_m[axis].min(*value);
                facts.max_m[axis] = facts.max_m[axis].max(*value);
            }
        }
        facts.max_m[2] = facts.max_m[2].max(building.top_m);
    }
    let mut blocks = vec![Block::ZERO; counts.blocks()];
    let table = FieldTableMut::create(&mut blocks, &counts, facts);
    fill(table, buildings, &samples);
    blocks
}

fn fill(table: FieldTableMut, buildings: &[Building], samples: &[Vec<SampleRow>]) {
    let (mut sample, mut ring, mut point, mut byte) = (0, 0, 0, 0);
    for (index, building) in buildings.iter().enumerate() {
        table.structures[index] = StructureRow {
            id: index as u64 + 1,
            base_m: 0.0,
            top_m: building.top_m,
            first_sample: sample as u32,
            samples: samples[index].len() as u32,
            first_ring: ring as u32,
            rings: building.rings.len() as u32,
            first_name_byte: byte as u32,
            name_bytes: building.name.len() as u32,
        };
        for points in &building.rings {
            table.rings[ring] = RingRow { first_point: point as u32, points: points.len() as u32 };
            table.points[point..point + points.len()].copy_from_slice(points);
            (ring, point) = (ring + 1, point + points.len());
        }
        for row in &samples[index] {
            table.samples[sample] = *row;
            table.ceilings[sample] = if chance(sample as u64 * 7 + 5) < 0.9 { 90 } else { 20 };
            sample += 1;
        }
        table.names[byte..byte + building.name.len()].copy_from_slice(building.name.as_bytes());
        byte += building.name.len();
    }
}

fn samples_of(index: usize, building: &Building) -> Vec<SampleRow> {
    let mut rows = Vec::new();
    let row =
        |position_m, normal, exposed| SampleRow { position_m, normal, area_mm2: 25_000_000, structure: index as u32, exposed };
    for (ring_index, ring) in building.rings.iter().enumerate() {
        for edge in 0..ring.len() {
            let (from, to) = (ring[edge], ring[(edge + 1) % ring.len()]);
            let along = [to[0] - from[0], to[1] - from[1]];
            let length = along[0].hypot(along[1]);
            let normal = [along[1] / length, -along[0] / length, 0.0];
            let exposed = u32::from(chance((index * 97 + ring_index * 13 + edge) as u64) > 0.2);
            let (across, up) = ((length / 5.0).ceil() as usize, (building.top_m / 5.0).ceil() as usize);
            for step in 0..across * up {
                let (s, z) = ((step % across) as f64 + 0.5, (step / across) as f64 + 0.5);
                let share = s / across as f64;
                let position = [from[0] + along[0] * share, from[1] + along[1] * share, z * building.top_m / up as f64];
                rows.push(row(position, normal, exposed));
            }
        }
    }
    let outer = &building.rings[0];
    for step in 0..20 {
        let share = [f64::from(step % 5) / 5.0 + 0.1, f64::from(step / 5) / 4.0 + 0.125];
        let x = outer[0][0] + (outer[2][0] - outer[0][0]) * share[0];
        let y = outer[0][1] + (outer[2][1] - outer[0][1]) * share[1];
        rows.push(row([x, y, building.top_m], [0.0, 0.0, 1.0], 1));
    }
    rows
}

/// A flight up and down the streets, with an image about every 9 m, that captures more of some walls than of others.
pub fn plan(field: &FieldTable) -> Plan {
    let (min, max) = (field.facts.min_m, field.facts.max_m);
    let mut corners = Vec::new();
    let columns = ((max[0] - min[0]) / 46.0).ceil() as i32 + 1;
    for column in 0..columns {
        let x = min[0] - 7.0 + f64::from(column) * 46.0;
        for step in 0..6 {
            let share = f64::from(if column % 2 == 0 { step } else { 5 - step }) / 5.0;
            let key = (column * 10 + step) as u64;
            let z = 12.0 + 70.0 * chance(key);
            corners.push(Point3::new(x + 6.0 * chance(key + 900), min[1] - 15.0 + (max[1] - min[1] + 30.0) * share, z));
        }
    }
    let mut images = Vec::new();
    let mut flown_m = 0.0;
    for leg in corners.windows(2) {
        let along = leg[1] - leg[0];
        let count = (along.norm() / 9.0).ceil();
        for step in 0..count as usize {
            let share = step as f64 / count;
            images.push(image(leg[0] + along * share, (flown_m + along.norm() * share) / 8.0 * 1.2));
        }
        flown_m += along.norm();
    }
    let covered =
        |index: usize| if chance(u64::from(field.samples[index].structure) * 3 + index as u64 / 12) < 0.75 { 60 } else { 12 };
    let cells: Vec<u16> = (0..field.samples.len()).map(|index| field.ceilings[index].min(covered(index))).collect();
    let movement_s = flown_m / 8.0;
    let coverage = |index: usize| 95.8 * (1.0 - (-(index as f64) / 70.0).exp());
    Plan {
        scene: SceneStamp {
            name: "fixture".to_owned(),
            origin: Some(Geodetic { lat_deg: 51.9, lon_deg: 4.4, alt_m: 0.0 }),
            revision: field.facts.revision,
        },
        seed: 1,
        rig: "panoramic".to_owned(),
        method: "paper".to_owned(),
        cameras: vec![Camera { name: "panorama".to_owned(), intrinsics: None, pixel_rad: 6e-4 }],
        waypoints: corners
            .iter()
            .map(|position_m| Waypoint { position_m: *position_m, direction: None, deviation_m: 1.0 })
            .collect(),
        images,
        metrics: Metrics {
            length_m: flown_m,
            movement_s,
            turning_s: movement_s * 0.2,
            flight_s: movement_s * 1.2,
            profile_s: movement_s * 1.3,
            battery_percent: None,
            coverage_percent: 95.3,
            coverage_exposed_percent: 84.1,
            capturable_percent: 88.2,
            matched_percent: 93.7,
            information: 5123.25,
            objective: 4211.5,
            delayed_exposures: 3,
            dropped_exposures: 0,
            blur_px: 0.6,
        },
        limits: None,
        cells,
        ceilings: field.ceilings.to_vec(),
        goal_percent: 95.0,
        matched_goal_percent: 95.0,
        egress: Default::default(),
        clearance_m: 5.2,
        convergence: (0..400)
            .map(|index| Iteration {
                objective: index as f64 * 10.0,
                coverage_percent: coverage(index - index % 7),
                length_m: index as f64 * 5.0,
                turning_s: index as f64 * 0.3,
            })
            .collect(),
        stop: StopReason::GoalReached,
    }
}

fn image(position_m: Point3<f64>, time_s: f64) -> Image {
    Image { position_m, direction: None, up: Vector3::z(), fov_deg: None, camera: 0, time_s, selected: true }
}
