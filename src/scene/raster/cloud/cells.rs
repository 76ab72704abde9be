//! Points that come in one by one, as heights in cells.

use super::{Cloud, Header};
use crate::scene::raster::geo_keys::Reference;
use crate::scene::raster::grid::{Affine, Grid};

/// A point so much above every other one of its cell is a bird or a wrong echo, in units of the file.
const ALONE: f32 = 10.0;

/// Classes count when at least this share of the points has them.
const LEAST_SHARE: f64 = 0.005;

/// A building's point this near to the highest one of a cell makes it a cell of the building, in units of the file.
const ROOF_DEPTH: f32 = 1.0;

const GROUND: u8 = 2;
const BUILDING: u8 = 6;
const NOISE: [u8; 2] = [7, 18];

/// The cells while points come in.
pub struct Cells {
    size: [usize; 2],
    cell: f64,
    format: u8,
    scale: [f64; 3],
    offset: [f64; 3],
    corner: [f64; 2],
    highest: Vec<f32>,
    second: Vec<f32>,
    building: Vec<f32>,
    ground: Vec<f32>,
    ground_counts: Vec<u32>,
    ground_points: u64,
    building_points: u64,
    noise: u64,
    outside: u64,
}

impl Cells {
    pub fn new([columns, rows]: [usize; 2], cell: f64, header: &Header) -> Self {
        let unknown = || vec![f32::NAN; columns * rows];
        Self {
            size: [columns, rows],
            cell,
            format: header.format,
            scale: header.scale,
            offset: header.offset,
            corner: [header.min[0], header.max[1]],
            highest: unknown(),
            second: unknown(),
            building: unknown(),
            ground: unknown(),
            ground_counts: vec![0; columns * rows],
            ground_points: 0,
            building_points: 0,
            noise: 0,
            outside: 0,
        }
    }

    /// Takes a point as it stands in a LAS file, at least 20 bytes, 30 from format 6 on.
    pub fn take(&mut self, point: &[u8]) {
        let number = |axis: usize| {
            let b = &point[4 * axis..4 * axis + 4];
            f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])) * self.scale[axis] + self.offset[axis]
        };
        let (class, is_withheld) =
            if self.format < 6 { (point[15] & 0x1f, point[15] & 0x80 != 0) } else { (point[16], point[15] & 0x04 != 0) };
        if is_withheld || NOISE.contains(&class) {
            self.noise += 1;
            return;
        }
        let [x, y, z] = [number(0), number(1), number(2)];
        let (column, row) = ((x - self.corner[0]) / self.cell, (self.corner[1] - y) / self.cell);
        // The file's box is rounded to its digits.
        let within = |place: f64, count: usize| (-0.5..count as f64 + 0.5).contains(&place);
        if !(within(column, self.size[0]) && within(row, self.size[1]) && z.abs() < 1e5) {
            self.outside += 1;
            return;
        }
        let at = (row as usize).min(self.size[1] - 1) * self.size[0] + (column as usize).min(self.size[0] - 1);
        let z = z as f32;
        if self.highest[at] >= z {
            self.second[at] = self.second[at].max(z);
        } else {
            (self.second[at], self.highest[at]) = (self.highest[at], z);
        }
        if class == GROUND {
            (self.ground_points, self.ground_counts[at]) = (self.ground_points + 1, self.ground_counts[at] + 1);
            let before = self.ground[at];
            self.ground[at] = if before.is_nan() { z } else { before + (z - before) / self.ground_counts[at] as f32 };
        }
        if class == BUILDING {
            self.building_points += 1;
            self.building[at] = self.building[at].max(z);
        }
    }

    pub fn finished(mut self, place: Affine, reference: Reference, points: u64) -> Cloud {
        let mut alone = 0;
        for (highest, second) in self.highest.iter_mut().zip(&self.second) {
            if *highest - *second > ALONE {
                (*highest, alone) = (*second, alone + 1);
            }
        }
        let is_classified = |marked: u64| marked as f64 >= LEAST_SHARE * points as f64 && marked > 0;
        let is_roof = |(building, highest): (&f32, &f32)| *building >= *highest - ROOF_DEPTH;
        let is_building = || self.building.iter().zip(&self.highest).map(is_roof).collect();
        Cloud {
            is_building: is_classified(self.building_points).then(is_building),
            ground: is_classified(self.ground_points).then_some(self.ground),
            surface: Grid { columns: self.size[0], rows: self.size[1], place, heights: self.highest },
            reference,
            points,
            noise: self.noise,
            outside: self.outside,
            alone,
        }
    }
}
