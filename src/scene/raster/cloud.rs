//! LAS and LAZ point clouds, point by point, as heights on a grid: the highest point of each cell, and the ground where points are marked as that. Clouds are as large
//! as memory or larger, so that they are read from where they lie, a part at a time.

mod cells;
mod sizes;

use std::io::{BufReader, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::laszip::{LasZipDecompressor, LazVlr};

use self::cells::Cells;
use super::geo_keys::{self, Reference};
use super::grid::{Affine, Grid, LEAST_CELL_M, MOST_CELLS};
use crate::scene::read::ImportError;
use crate::stop::{Part, StopToken};

/// Where the bytes of a cloud lie.
pub trait Source: Read + Seek + Send + Sync {}

impl<T: Read + Seek + Send + Sync> Source for T {}

/// A source that counts the bytes that are read of it.
pub struct Watched<'w, S> {
    source: S,
    stop: &'w StopToken,
}

impl<'w, S> Watched<'w, S> {
    /// Of a source of so many bytes.
    pub fn new(source: S, length: u64, stop: &'w StopToken) -> Self {
        stop.begin(Part::Reading, length);
        Self { source, stop }
    }
}

impl<S: Read> Read for Watched<'_, S> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(bytes)?;
        self.stop.advance(count as u64);
        Ok(count)
    }
}

impl<S: Seek> Seek for Watched<'_, S> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.source.seek(to)
    }
}

/// Bytes that are read at once.
const BUFFER: usize = 1 << 20;

/// The header of a file has no more bytes than this that are looked at.
const HEADER: usize = 375;

/// So many points are wanted in a cell, so that few cells stay empty.
const POINTS_PER_CELL: f64 = 2.0;

/// More records before the points are no file that anybody has written.
const MOST_RECORDS: u32 = 10_000;

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
    start: u64,
    /// The bytes of the header, behind which the records begin, and how many of them there are.
    bytes: u64,
    records: u32,
    format: u8,
    is_packed: bool,
    record_bytes: usize,
    points: u64,
    scale: [f64; 3],
    offset: [f64; 3],
    min: [f64; 2],
    max: [f64; 2],
}

pub(super) fn read(file: &str, source: &mut dyn Source) -> Result<Cloud, ImportError> {
    let refuse = |what: String, remedy| ImportError::Structure { file: file.into(), what, remedy };
    const DAMAGED: &str = "fetch or export it again";
    let unreadable = |error: std::io::Error| refuse(format!("it cannot be read ({error})"), DAMAGED);
    let length = source.seek(SeekFrom::End(0)).map_err(unreadable)?;
    let mut bytes = Bytes { source, length };
    let head = bytes.at(0, HEADER.min(length as usize)).unwrap_or_default();
    let header = Header::read(&head, length).map_err(|what| refuse(what, DAMAGED))?;
    let (reference, packing) = records(&mut bytes, &header).map_err(|what| refuse(what, DAMAGED))?;
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
        let unpacked = catch_unwind(AssertUnwindSafe(|| unpack(&mut bytes, &header, packing, &mut cells)));
        let told = unpacked.unwrap_or_else(|_| Err("the packed points make no sense".into()));
        told.map_err(|what| refuse(what, DAMAGED))?;
    } else {
        let end = header.points.checked_mul(header.record_bytes as u64).and_then(|size| size.checked_add(header.start));
        if end.is_none_or(|end| end > length) {
            let there = length.saturating_sub(header.start) / header.record_bytes as u64;
            return Err(refuse(format!("it is cut off: it has {there} of {} points", header.points), DAMAGED));
        }
        let mut source = bytes.from(header.start).map_err(unreadable)?;
        let mut point = vec![0; header.record_bytes];
        for _ in 0..header.points {
            source.read_exact(&mut point).map_err(unreadable)?;
            cells.take(&point);
        }
    }
    let place = Affine { origin: [header.min[0], header.max[1]], column: [cell, 0.0], row: [0.0, -cell] };
    Ok(cells.finished(place, reference, header.points))
}

/// The bytes of a file that stays where it lies.
struct Bytes<'s> {
    source: &'s mut dyn Source,
    length: u64,
}

impl Bytes<'_> {
    /// A few of them; `None` beyond the end.
    fn at(&mut self, at: u64, count: usize) -> Option<Vec<u8>> {
        let end = at.checked_add(count as u64)?;
        if end > self.length {
            return None;
        }
        let mut part = vec![0; count];
        self.source.seek(SeekFrom::Start(at)).ok()?;
        self.source.read_exact(&mut part).ok()?;
        Some(part)
    }

    /// All from a place on.
    fn from(&mut self, at: u64) -> std::io::Result<BufReader<&mut dyn Source>> {
        self.source.seek(SeekFrom::Start(at))?;
        Ok(BufReader::with_capacity(BUFFER, &mut *self.source))
    }

    fn whole(&mut self, at: u64) -> Option<u32> {
        self.at(at, 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    }

    fn offset(&mut self, at: u64) -> Option<i64> {
        self.at(at, 8).map(|b| i64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
    }
}

impl Header {
    /// Of the first bytes of a file of a length.
    fn read(bytes: &[u8], length: u64) -> Result<Self, String> {
        let short = || "the header is cut off".to_owned();
        let part = |at: usize, count: usize| bytes.get(at..at + count).ok_or_else(short);
        let half = |at| part(at, 2).map(|b| u16::from_le_bytes([b[0], b[1]]));
        let whole = |at| part(at, 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let long = |at| part(at, 8).map(|b| u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]));
        let number = |at| long(at).map(f64::from_bits);
        let version = [part(24, 1)?[0], part(25, 1)?[0]];
        let header_bytes = half(94)?;
        let start = u64::from(whole(96)?);
        let kind = part(104, 1)?[0];
        let record_bytes = usize::from(half(105)?);
        let format = kind & 0x3f;
        if version[0] != 1 || version[1] > 4 || format > 10 {
            return Err(format!(
                "its version is {}.{} with points of format {format}, and LAS 1.0 to 1.4 are read",
                version[0], version[1]
            ));
        }
        if record_bytes < least_bytes(format) || start > length || u64::from(header_bytes) > start {
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
        Ok(Self {
            start,
            bytes: header_bytes.into(),
            records: whole(100)?.min(MOST_RECORDS),
            format,
            is_packed,
            record_bytes,
            points,
            scale,
            offset,
            min: [min_x, min_y],
            max: [max_x, max_y],
        })
    }
}

/// How the points of a LAZ file are packed.
struct Packing {
    laz: LazVlr,
    /// In chunks, of which there is a table; and those in layers, which say their sizes themselves.
    is_chunked: bool,
    is_layered: bool,
}

/// The marks of points that are packed in chunks, and in chunks of layers.
const CHUNKED: [u8; 2] = [2, 0];
const LAYERED: [u8; 2] = [3, 0];

/// The least size of a point of a format.
fn least_bytes(format: u8) -> usize {
    if format < 6 { 20 } else { 30 }
}

/// The reference system and how the points are packed, from the records between header and points.
fn records(bytes: &mut Bytes, header: &Header) -> Result<(Reference, Option<Packing>), String> {
    let (mut reference, mut text, mut packing) = (Reference::default(), None, None);
    let mut at = header.bytes;
    for _ in 0..header.records {
        let Some(head) = bytes.at(at, 54).filter(|_| at + 54 <= header.start) else { break };
        let (id, length) = (u16::from_le_bytes([head[18], head[19]]), u16::from_le_bytes([head[20], head[21]]));
        let Some(data) = bytes.at(at + 54, length.into()) else { break };
        let user = head[2..18].split(|byte| *byte == 0).next().unwrap_or_default();
        match (user, id) {
            (b"LASF_Projection", 34735) => {
                let keys: Vec<u16> = data.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
                reference = geo_keys::of_keys(&keys);
            }
            (b"LASF_Projection", 2112) => text = Some(geo_keys::of_text(&String::from_utf8_lossy(&data))),
            (b"laszip encoded", 22204) => {
                let read =
                    LazVlr::from_buffer(&data).map_err(|error| format!("how its points are packed is not known ({error})"))?;
                let is_layered = data.starts_with(&LAYERED);
                packing = Some(Packing { laz: read, is_chunked: is_layered || data.starts_with(&CHUNKED), is_layered });
            }
            _ => {}
        }
        at += 54 + u64::from(length);
    }
    Ok((text.unwrap_or(reference), packing))
}

fn unpack(bytes: &mut Bytes, header: &Header, packing: Packing, cells: &mut Cells) -> Result<(), String> {
    let cut = |error: std::io::Error| format!("its packed points are damaged or cut off ({error})");
    let size = sizes::check(bytes, header, &packing)?;
    let source = bytes.from(header.start).map_err(cut)?;
    let mut points =
        LasZipDecompressor::new(source, packing.laz).map_err(|error| format!("its points cannot be unpacked ({error})"))?;
    let at_once = ((BUFFER / size).max(1) as u64).min(header.points);
    let mut buffer = vec![0; size * at_once as usize];
    let mut left = header.points;
    while left > 0 {
        let count = left.min(at_once);
        let part = &mut buffer[..size * count as usize];
        points.decompress_many(part).map_err(cut)?;
        part.chunks_exact(size).for_each(|point| cells.take(point));
        left -= count;
    }
    Ok(())
}
