//! LAS and LAZ point clouds, point by point, as heights on a grid: the highest point of each cell, and the ground where points are marked as that.

use std::io::{Cursor, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::laszip::{LasZipDecompressor, LazItemType, LazVlr};

use super::geo_keys::{self, Reference};
use super::grid::{Affine, Grid, LEAST_CELL_M, MOST_CELLS};
use crate::scene::read::ImportError;

/// Points that are unpacked at once.
const POINTS_AT_ONCE: u64 = 10_000;

/// So many points are wanted in a cell, so that few cells stay empty.
const POINTS_PER_CELL: f64 = 2.0;

/// A point so much above every other one of its cell is a bird or a wrong echo, in units of the file.
const ALONE: f32 = 10.0;

/// Classes count when at least this share of the points has them.
const LEAST_SHARE: f64 = 0.005;

/// A building's point this near to the highest one of a cell makes it a cell of the building, in units of the file.
const ROOF_DEPTH: f32 = 1.0;

/// More records before the points are no file that anybody has written.
const MOST_RECORDS: u32 = 10_000;

const GROUND: u8 = 2;
const BUILDING: u8 = 6;
const NOISE: [u8; 2] = [7, 18];

/// A cloud as it was gridded.
pub(super) struct Cloud {
    pub surface: Grid,
    /// Mean height of the ground's points by cells, where the points are classified.
    pub ground: Option<Vec<f32>>,
    /// Whether the highest points of a cell are a building's, where the points are classified.
    pub is_building: Option<Vec<bool>>,
    pub reference: Reference,
    /// Points of the file, and among them those that are marked as noise, that lie outside of the file's own box, and that stand alone high above their
    /// cell.
    pub points: u64,
    pub noise: u64,
    pub outside: u64,
    pub alone: usize,
}

/// What stands at fixed places at the beginning of the file (LAS 1.0 to 1.4).
struct Header {
    start: usize,
    format: u8,
    is_packed: bool,
    record_bytes: usize,
    points: u64,
    scale: [f64; 3],
    offset: [f64; 3],
    min: [f64; 2],
    max: [f64; 2],
}

pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Cloud, ImportError> {
    let refuse = |what: String, remedy| ImportError::Structure { file: file.into(), what, remedy };
    const DAMAGED: &str = "fetch or export it again";
    let header = Header::read(bytes).map_err(|what| refuse(what, DAMAGED))?;
    let (reference, packing) = records(bytes, &header).map_err(|what| refuse(what, DAMAGED))?;
    let extent = [0, 1].map(|axis| header.max[axis] - header.min[axis]);
    // Written so that NaN is refused too.
    if !(extent.iter().all(|side| *side > 0.0 && side.is_finite()) && header.points > 0) {
        let what = format!("its {} points lie in a box of {} x {} units", header.points, extent[0], extent[1]);
        return Err(refuse(
            what,
            "export the cloud with a correct header, for example with `lasinfo -repair` or `pdal translate`",
        ));
    }
    let unit_m = reference.unit_m.unwrap_or(1.0);
    let by_points = (POINTS_PER_CELL * extent[0] * extent[1] / header.points as f64).sqrt();
    let by_memory = (extent[0] * extent[1] / MOST_CELLS as f64).sqrt();
    // Whole tenths, so that a few points more do not move all cells.
    let cell = (by_points.max(by_memory).max(LEAST_CELL_M / unit_m) * 10.0).ceil() / 10.0;
    let [columns, rows] = extent.map(|side| (side / cell).floor() + 1.0);
    if columns * rows > 2.0 * MOST_CELLS as f64 {
        return Err(refuse(
            format!("its box of {} x {} units is absurd", extent[0], extent[1]),
            "check the export's units and outliers",
        ));
    }
    let (columns, rows) = (columns as usize, rows as usize);
    let mut cells = Cells::new([columns, rows], cell, &header);
    if header.is_packed {
        let packing =
            packing.ok_or_else(|| refuse("it is a LAZ file without a record that says how it is packed".into(), DAMAGED))?;
        // The unpacking library has been written for files that are whole.
        let unpacked = catch_unwind(AssertUnwindSafe(|| unpack(bytes, &header, packing, &mut cells)));
        let told = unpacked.unwrap_or_else(|_| Err("the packed points make no sense".into()));
        told.map_err(|what| refuse(what, DAMAGED))?;
    } else {
        let end = header.points.checked_mul(header.record_bytes as u64).and_then(|size| size.checked_add(header.start as u64));
        if end.is_none_or(|end| end > bytes.len() as u64) {
            let there = bytes.len().saturating_sub(header.start) / header.record_bytes;
            return Err(refuse(format!("it is cut off: it has {there} of {} points", header.points), DAMAGED));
        }
        bytes[header.start..].chunks_exact(header.record_bytes).take(header.points as usize).for_each(|point| cells.take(point));
    }
    let place = Affine { origin: [header.min[0], header.max[1]], column: [cell, 0.0], row: [0.0, -cell] };
    Ok(cells.finished(place, reference, header.points))
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, String> {
        let short = || "the header is cut off".to_owned();
        let part = |at: usize, count: usize| bytes.get(at..at + count).ok_or_else(short);
        let half = |at| part(at, 2).map(|b| u16::from_le_bytes([b[0], b[1]]));
        let whole = |at| part(at, 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let long = |at| part(at, 8).map(|b| u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]));
        let number = |at| long(at).map(f64::from_bits);
        let version = [part(24, 1)?[0], part(25, 1)?[0]];
        let header_bytes = half(94)?;
        let start = whole(96)? as usize;
        let kind = part(104, 1)?[0];
        let record_bytes = usize::from(half(105)?);
        let format = kind & 0x3f;
        if version[0] != 1 || version[1] > 4 || format > 10 {
            return Err(format!(
                "its version is {}.{} with points of format {format}, and LAS 1.0 to 1.4 are read",
                version[0], version[1]
            ));
        }
        if record_bytes < least_bytes(format) || start > bytes.len() || usize::from(header_bytes) > start {
            return Err("the header is damaged: its points have no place".into());
        }
        let points = match (version[1], header_bytes >= 255) {
            (4, true) => long(247)?.max(u64::from(whole(107)?)),
            _ => u64::from(whole(107)?),
        };
        let three = |at| -> Result<[f64; 3], String> { Ok([number(at)?, number(at + 8)?, number(at + 16)?]) };
        let (scale, offset) = (three(131)?, three(155)?);
        let ([max_x, min_x, max_y], min_y) = (three(179)?, number(203)?);
        if !scale.iter().chain(&offset).all(|number| number.is_finite()) || scale.contains(&0.0) {
            return Err("the header is damaged: its scale or offset is no number".into());
        }
        let is_packed = kind & 0xc0 != 0;
        Ok(Self { start, format, is_packed, record_bytes, points, scale, offset, min: [min_x, min_y], max: [max_x, max_y] })
    }
}

/// How the points of a LAZ file are packed.
struct Packing {
    laz: LazVlr,
    is_layered: bool,
}

/// The mark of points that are packed in chunks of layers, which say their sizes themselves.
const LAYERED: [u8; 2] = [3, 0];

/// The least size of a point of a format.
fn least_bytes(format: u8) -> usize {
    if format < 6 { 20 } else { 30 }
}

/// The reference system and how the points are packed, from the records between header and points.
fn records(bytes: &[u8], header: &Header) -> Result<(Reference, Option<Packing>), String> {
    let (mut reference, mut text, mut packing) = (Reference::default(), None, None);
    let count = u32::from_le_bytes([bytes[100], bytes[101], bytes[102], bytes[103]]).min(MOST_RECORDS);
    let mut at = usize::from(u16::from_le_bytes([bytes[94], bytes[95]]));
    for _ in 0..count {
        let Some(head) = bytes.get(at..at + 54).filter(|_| at + 54 <= header.start) else { break };
        let (id, length) = (u16::from_le_bytes([head[18], head[19]]), usize::from(u16::from_le_bytes([head[20], head[21]])));
        let Some(data) = bytes.get(at + 54..at + 54 + length) else { break };
        let user = head[2..18].split(|byte| *byte == 0).next().unwrap_or_default();
        match (user, id) {
            (b"LASF_Projection", 34735) => {
                let keys: Vec<u16> = data.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
                reference = geo_keys::of_keys(&keys);
            }
            (b"LASF_Projection", 2112) => text = Some(geo_keys::of_text(&String::from_utf8_lossy(data))),
            (b"laszip encoded", 22204) => {
                let read =
                    LazVlr::from_buffer(data).map_err(|error| format!("how its points are packed is not known ({error})"))?;
                packing = Some(Packing { laz: read, is_layered: data.starts_with(&LAYERED) });
            }
            _ => {}
        }
        at += 54 + length;
    }
    Ok((text.unwrap_or(reference), packing))
}

fn unpack(bytes: &[u8], header: &Header, packing: Packing, cells: &mut Cells) -> Result<(), String> {
    let cut = |error: std::io::Error| format!("its packed points are damaged or cut off ({error})");
    let size = packing.laz.items_size() as usize;
    if size < least_bytes(header.format) || size > header.record_bytes {
        return Err("the packed points have another size than the header says".into());
    }
    check_sizes(bytes, header, &packing)?;
    let mut source = Cursor::new(bytes);
    source.seek(SeekFrom::Start(header.start as u64)).map_err(cut)?;
    let mut points =
        LasZipDecompressor::new(source, packing.laz).map_err(|error| format!("its points cannot be unpacked ({error})"))?;
    let mut buffer = vec![0; size * POINTS_AT_ONCE.min(header.points) as usize];
    let mut left = header.points;
    while left > 0 {
        let count = left.min(POINTS_AT_ONCE);
        let part = &mut buffer[..size * count as usize];
        points.decompress_many(part).map_err(cut)?;
        part.chunks_exact(size).for_each(|point| cells.take(point));
        left -= count;
    }
    Ok(())
}

/// Checks the sizes that the packed points give for tables and layers, before the unpacking library takes memory for them.
fn check_sizes(bytes: &[u8], header: &Header, Packing { laz, is_layered }: &Packing) -> Result<(), String> {
    let whole = |at: usize| bytes.get(at..at.checked_add(4)?).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let absurd = || "the packed points are damaged or cut off: a part is larger than the file".to_owned();
    if let Some(table) = bytes.get(header.start..header.start + 8) {
        let table = i64::from_le_bytes([table[0], table[1], table[2], table[3], table[4], table[5], table[6], table[7]]);
        let chunks = usize::try_from(table).ok().and_then(|table| whole(table.checked_add(4)?));
        if chunks.is_some_and(|chunks| chunks > bytes.len()) {
            return Err(absurd());
        }
    }
    if laz.items().iter().any(|item| item.size() == 0) {
        return Err("the packed points have parts without a size".into());
    }
    if !*is_layered {
        return Ok(());
    }
    let layers = |item: &LazItemType| match item {
        LazItemType::Point14 => 9,
        LazItemType::RGB14 | LazItemType::WavePacket14 => 1,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => usize::from(*count),
        _ => 0,
    };
    let layers: usize = laz.items().iter().map(|item| layers(&item.item_type())).sum();
    let (mut at, mut left) = (header.start + 8, header.points);
    while left > 0 {
        // The first point as it is, the number of points, the sizes of the layers, the layers.
        let sizes = at + laz.items_size() as usize + 4;
        let count = whole(sizes - 4).ok_or_else(absurd)?;
        let mut end = sizes + 4 * layers;
        for layer in 0..layers {
            end = end.checked_add(whole(sizes + 4 * layer).ok_or_else(absurd)?).ok_or_else(absurd)?;
        }
        if end > bytes.len() || count == 0 {
            return Err(absurd());
        }
        (at, left) = (end, left.saturating_sub(count as u64));
    }
    Ok(())
}

/// The cells while points come in.
struct Cells {
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
    fn new([columns, rows]: [usize; 2], cell: f64, header: &Header) -> Self {
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
    fn take(&mut self, point: &[u8]) {
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

    fn finished(mut self, place: Affine, reference: Reference, points: u64) -> Cloud {
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
