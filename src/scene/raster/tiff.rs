//! Heights from a GeoTIFF, strip by strip or tile by tile, gridded down while it is read where it is large.

use std::io::Cursor;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use super::geo_keys::{self, Reference};
use super::grid::{Affine, Grid, LEAST_CELL_M, MOST_CELLS};
use crate::scene::read::ImportError;

/// A raster with more pixels is refused before anything is read.
const MOST_PIXELS: u64 = 1_000_000_000;

/// Strips and tiles that need more are refused, bytes.
const MOST_CHUNK_BYTES: usize = 256 << 20;

/// A table of the file that needs more is refused, bytes: where a million strips or tiles lie.
const MOST_TABLE_BYTES: usize = 16 << 20;

/// No ground on Earth lies so low or, with a building on it, so high, in metres or feet: such heights stand for "unknown".
const HEIGHTS: std::ops::Range<f32> = -1500.0..35_000.0;

/// What becomes of the pixels of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fold {
    /// The highest counts: of a surface, which flights keep clear of.
    Highest,
    /// The mean counts: of the ground.
    Mean,
}

/// A raster as it was read.
#[derive(Debug)]
pub(super) struct Raster {
    pub grid: Grid,
    pub reference: Reference,
    /// Pixels across a cell.
    pub factor: usize,
    /// Pixels whose height is no number, or none that can be; those that the file marks as unknown are not among them.
    pub absurd: u64,
}

pub(super) fn read(file: &str, bytes: &[u8], fold: Fold) -> Result<Raster, ImportError> {
    let refuse = |what: String, remedy| ImportError::Structure { file: file.into(), what, remedy };
    let damaged = |error: TiffError| match error {
        TiffError::UnsupportedError(what) => refuse(
            format!("the TIFF is written in a way that is not read ({what})"),
            "write it anew, for example with `gdal_translate -ot Float32 -co COMPRESS=DEFLATE -co TILED=YES in.tif out.tif`",
        ),
        TiffError::LimitsExceeded => refuse(
            "its strips or tiles are too large to be read one by one".into(),
            "write it in tiles, for example with `gdal_translate -co TILED=YES in.tif out.tif`",
        ),
        error => refuse(format!("the TIFF is damaged or cut off ({error})"), "fetch or export it again"),
    };
    let mut limits = Limits::default();
    (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (MOST_CHUNK_BYTES, MOST_CHUNK_BYTES);
    limits.ifd_value_size = MOST_TABLE_BYTES;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(damaged)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    if width < 2 || height < 2 || u64::from(width) * u64::from(height) > MOST_PIXELS {
        return Err(refuse(
            format!("it has {width} x {height} pixels, and from 2 x 2 to {MOST_PIXELS} in all are read"),
            "cut out the part that is to be flown, for example with `gdal_translate -projwin west north east south in.tif out.tif`",
        ));
    }
    match decoder.colortype().map_err(damaged)? {
        ColorType::Gray(8 | 16 | 32 | 64) => {}
        other => {
            return Err(refuse(
                format!("it is no raster of heights: its pixels are {other:?}"),
                "give a surface model of one band, or take the band with `gdal_translate -b 1 in.tif out.tif`",
            ));
        }
    }
    let reference = match decoder.find_tag_unsigned_vec::<u16>(Tag::GeoKeyDirectoryTag) {
        Ok(keys) => geo_keys::of_keys(&keys.unwrap_or_default()),
        Err(_) => Reference::default(),
    };
    let place = place(&mut decoder, reference.is_point).ok_or_else(|| {
        refuse(
            "it does not say where its pixels lie, nor how large they are".into(),
            "give a GeoTIFF with a georeference, for example by `gdal_translate -a_srs EPSG:code -a_ullr west north east south in.tif out.tif`",
        )
    })?;
    let unknown = decoder.get_tag_ascii_string(Tag::GdalNodata).ok();
    let unknown = unknown.and_then(|text| text.trim_end_matches('\0').trim().parse::<f64>().ok());
    let (columns, rows) = (width as usize, height as usize);
    let factor = factor(columns, rows, place.cell() * reference.unit_m.unwrap_or(1.0));
    let mut cells = Cells::new(columns.div_ceil(factor), rows.div_ceil(factor), factor, fold, unknown);
    let (chunk_width, chunk_height) = decoder.chunk_dimensions();
    let across = columns.div_ceil((chunk_width as usize).max(1)).max(1);
    let chunks = across * rows.div_ceil((chunk_height as usize).max(1));
    for chunk in 0..chunks {
        let index = u32::try_from(chunk).unwrap_or(u32::MAX);
        let (data_width, _) = decoder.chunk_data_dimensions(index);
        let at = [chunk % across * chunk_width as usize, chunk / across * chunk_height as usize];
        let pixels = decoder.read_chunk(index).map_err(damaged)?;
        cells.take_chunk(at, data_width as usize, &pixels);
    }
    let grid = Grid { columns: cells.columns, rows: cells.rows, place: place.coarser(factor), heights: cells.heights };
    Ok(Raster { grid, reference, factor, absurd: cells.absurd })
}

/// How many pixels each way become one cell.
pub(super) fn factor(columns: usize, rows: usize, pixel_m: f64) -> usize {
    let too_many = (columns as f64 * rows as f64 / MOST_CELLS as f64).sqrt().ceil();
    let too_fine = if pixel_m > 0.0 { (LEAST_CELL_M / pixel_m * (1.0 + 1e-9)).floor() } else { 1.0 };
    // A raster need not be gridded down to less than two cells a side.
    (too_many.max(too_fine).max(1.0) as usize).min(columns.min(rows) / 2).max(1)
}

/// The place of the pixels: from a transformation, or from a tie point and the size of a pixel.
fn place(decoder: &mut Decoder<Cursor<&[u8]>>, is_point: bool) -> Option<Affine> {
    let mut numbers = |tag| decoder.get_tag_f64_vec(tag).ok();
    let place = match numbers(Tag::ModelTransformationTag) {
        Some(m) if m.len() == 16 => Affine { origin: [m[3], m[7]], column: [m[0], m[4]], row: [m[1], m[5]] },
        _ => {
            let (scale, tie) = (numbers(Tag::ModelPixelScaleTag)?, numbers(Tag::ModelTiepointTag)?);
            let ([across, down, ..], [column, row, _, x, y, ..]) = (&scale[..], &tie[..]) else { return None };
            Affine { origin: [x - column * across, y + row * down], column: [*across, 0.0], row: [0.0, -down] }
        }
    };
    let corner = if is_point { place.at(-0.5, -0.5) } else { place.origin };
    Some(Affine { origin: corner, ..place }).filter(Affine::is_sound)
}

/// The cells while pixels come in.
struct Cells {
    columns: usize,
    rows: usize,
    factor: usize,
    fold: Fold,
    unknown: Option<f64>,
    heights: Vec<f32>,
    /// Pixels in each cell, where their mean is wanted.
    counts: Vec<u32>,
    absurd: u64,
}

impl Cells {
    fn new(columns: usize, rows: usize, factor: usize, fold: Fold, unknown: Option<f64>) -> Self {
        let counts = if fold == Fold::Mean { vec![0; columns * rows] } else { Vec::new() };
        Self { columns, rows, factor, fold, unknown, heights: vec![f32::NAN; columns * rows], counts, absurd: 0 }
    }

    fn take_chunk(&mut self, at: [usize; 2], width: usize, pixels: &DecodingResult) {
        match pixels {
            DecodingResult::U8(values) => self.take(at, width, values, |v| f64::from(*v)),
            DecodingResult::U16(values) => self.take(at, width, values, |v| f64::from(*v)),
            DecodingResult::U32(values) => self.take(at, width, values, |v| f64::from(*v)),
            DecodingResult::U64(values) => self.take(at, width, values, |v| *v as f64),
            DecodingResult::I8(values) => self.take(at, width, values, |v| f64::from(*v)),
            DecodingResult::I16(values) => self.take(at, width, values, |v| f64::from(*v)),
            DecodingResult::I32(values) => self.take(at, width, values, |v| f64::from(*v)),
            DecodingResult::I64(values) => self.take(at, width, values, |v| *v as f64),
            DecodingResult::F16(values) => self.take(at, width, values, |v| f64::from(v.to_f32())),
            DecodingResult::F32(values) => self.take(at, width, values, |v| f64::from(*v)),
            DecodingResult::F64(values) => self.take(at, width, values, |v| *v),
        }
    }

    fn take<T>(&mut self, [left, top]: [usize; 2], width: usize, values: &[T], number: impl Fn(&T) -> f64) {
        for (index, value) in values.iter().enumerate() {
            let (column, row) = ((left + index % width.max(1)) / self.factor, (top + index / width.max(1)) / self.factor);
            if column >= self.columns || row >= self.rows {
                continue;
            }
            let value = number(value);
            if value.is_nan() || self.unknown.is_some_and(|unknown| value == unknown || value as f32 == unknown as f32) {
                continue;
            }
            let height = value as f32;
            if !HEIGHTS.contains(&height) {
                self.absurd += 1;
                continue;
            }
            let cell = row * self.columns + column;
            let before = self.heights[cell];
            self.heights[cell] = match self.fold {
                Fold::Highest => before.max(height),
                Fold::Mean => {
                    self.counts[cell] += 1;
                    if before.is_nan() { height } else { before + (height - before) / self.counts[cell] as f32 }
                }
            };
        }
    }
}
