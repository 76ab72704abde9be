//! Fields on disk: a header, then the bytes of the table and of its segments as they lie in memory.
//!
//! A field that was built once need not be built again after a restart, as long as scene and settings are the same. The header
//! says what the field belongs to and carries a checksum, so that a file that is damaged, cut off, or of another release is an
//! error and never a wrong field.

use std::io::{self, Read, Write};
use std::ops::Range;
use std::sync::Arc;

use overfly_table::{Block, FieldTable, LayoutError, Segment, TableMemory, first_table};
use serde::{Deserialize, Serialize};

use crate::session::FieldStorage;

/// The first bytes of every snapshot.
const MAGIC: [u8; 8] = *b"OVFLYSNP";

/// Version of the header and of the table's layout. Version 2 has the visibility rows in segments.
pub const SCHEMA: u32 = 2;

/// Longest header, bytes.
const MAX_HEADER_BYTES: usize = 4096;

/// What a field belongs to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FieldStamp {
    pub scene: String,
    pub revision: u64,
    /// Fingerprint of the settings that the field depends on.
    pub settings_hash: u64,
}

/// Everything in front of the blocks.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct SnapshotHeader {
    schema: u32,
    stamp: FieldStamp,
    bytes: u64,
    checksum: u64,
}

/// Why a snapshot could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum SnapshotError {
    #[error("the snapshot cannot be read or written: {0}")]
    Io(#[from] io::Error),
    #[error("the file is not a snapshot of overfly; delete it, and the field is built again")]
    NotASnapshot,
    #[error("the snapshot has version {found}, this release reads version {SCHEMA}; delete it, and the field is built again")]
    Schema { found: u32 },
    #[error("the snapshot's header is damaged ({0}); delete it, and the field is built again")]
    Header(String),
    #[error("the snapshot announces {announced} bytes, more than the {limit} that are allowed; delete it, or allow more")]
    TooLong { announced: u64, limit: u64 },
    #[error("the snapshot is damaged or cut off; delete it, and the field is built again")]
    Damaged,
    #[error("the snapshot holds no field: {0}; delete it, and the field is built again")]
    Layout(#[from] LayoutError),
    #[error("the snapshot belongs to {found:?}, not to {wanted:?}")]
    Foreign { found: Box<FieldStamp>, wanted: Box<FieldStamp> },
}

/// A field that was read: its table, and its segments.
pub struct StoredField {
    table: Part,
    segments: Vec<Segment>,
}

/// A table in the blocks of a file.
struct Part {
    file: Arc<Vec<Block>>,
    range: Range<usize>,
}

impl TableMemory for Part {
    fn blocks(&self) -> &[Block] {
        &self.file[self.range.clone()]
    }
}

impl FieldStorage for StoredField {
    fn blocks(&self) -> &[Block] {
        self.table.blocks()
    }

    fn segments(&self) -> &[Segment] {
        &self.segments
    }
}

/// Writes a field.
pub fn write(to: &mut impl Write, stamp: &FieldStamp, field: &dyn FieldStorage) -> Result<(), SnapshotError> {
    let segments = field.segments().iter().map(|segment| segment.memory().blocks());
    let tables: Vec<&[Block]> = std::iter::once(field.blocks()).chain(segments).collect();
    let bytes = tables.iter().map(|table| size_of_val(*table) as u64).sum();
    let checksum = tables.iter().fold(SEED, |hash, table| checksum(hash, table));
    let header = SnapshotHeader { schema: SCHEMA, stamp: stamp.clone(), bytes, checksum };
    let header = bincode::serde::encode_to_vec(&header, bincode::config::standard())
        .map_err(|error| SnapshotError::Header(error.to_string()))?;
    if header.len() > MAX_HEADER_BYTES {
        return Err(SnapshotError::Header(format!("the scene's name makes it {} bytes long", header.len())));
    }
    to.write_all(&MAGIC)?;
    to.write_all(&(header.len() as u32).to_le_bytes())?;
    to.write_all(&header)?;
    for table in tables {
        to.write_all(bytemuck::cast_slice(table))?;
    }
    Ok(())
}

/// Reads the field that belongs to `wanted`; a longer one than `limit_bytes` is refused before memory is taken for it.
pub fn read(from: &mut impl Read, wanted: &FieldStamp, limit_bytes: u64) -> Result<StoredField, SnapshotError> {
    let header = read_header(from)?;
    if header.stamp != *wanted {
        return Err(SnapshotError::Foreign { found: Box::new(header.stamp), wanted: Box::new(wanted.clone()) });
    }
    if header.bytes > limit_bytes {
        return Err(SnapshotError::TooLong { announced: header.bytes, limit: limit_bytes });
    }
    if !header.bytes.is_multiple_of(Block::BYTES as u64) {
        return Err(SnapshotError::Damaged);
    }
    let mut blocks = vec![Block::ZERO; (header.bytes / Block::BYTES as u64) as usize];
    from.read_exact(bytemuck::cast_slice_mut(&mut blocks)).map_err(cut_off)?;
    if checksum(SEED, &blocks) != header.checksum {
        return Err(SnapshotError::Damaged);
    }
    let mut parts = parts(blocks)?.into_iter();
    let table = parts.next().ok_or(SnapshotError::Damaged)?;
    let segments = parts.map(|part| Segment::open(Arc::new(part))).collect::<Result<Vec<_>, _>>()?;
    FieldTable::open(table.blocks(), &segments)?;
    Ok(StoredField { table, segments })
}

/// The tables that follow one another in a file.
fn parts(blocks: Vec<Block>) -> Result<Vec<Part>, SnapshotError> {
    let file = Arc::new(blocks);
    let (mut parts, mut start) = (Vec::new(), 0);
    while start < file.len() {
        let count = first_table(&file[start..]).filter(|count| *count > 0).ok_or(SnapshotError::Damaged)?;
        parts.push(Part { file: Arc::clone(&file), range: start..start + count });
        start += count;
    }
    Ok(parts)
}

fn read_header(from: &mut impl Read) -> Result<SnapshotHeader, SnapshotError> {
    let mut start = [0; 12];
    from.read_exact(&mut start).map_err(cut_off)?;
    let (magic, length) = start.split_at(MAGIC.len());
    if magic != MAGIC {
        return Err(SnapshotError::NotASnapshot);
    }
    let length = length.try_into().map_or(usize::MAX, |bytes| u32::from_le_bytes(bytes) as usize);
    if length > MAX_HEADER_BYTES {
        return Err(SnapshotError::Header(format!("it is {length} bytes long")));
    }
    let mut bytes = vec![0; length];
    from.read_exact(&mut bytes).map_err(cut_off)?;
    let config = bincode::config::standard().with_limit::<MAX_HEADER_BYTES>();
    // The version stands first, so that it can be read whatever follows in another release.
    let (schema, _): (u32, usize) =
        bincode::serde::decode_from_slice(&bytes, config).map_err(|error| SnapshotError::Header(error.to_string()))?;
    if schema != SCHEMA {
        return Err(SnapshotError::Schema { found: schema });
    }
    let (header, used): (SnapshotHeader, usize) =
        bincode::serde::decode_from_slice(&bytes, config).map_err(|error| SnapshotError::Header(error.to_string()))?;
    if used == bytes.len() { Ok(header) } else { Err(SnapshotError::Header("bytes follow its end".into())) }
}

fn cut_off(error: io::Error) -> SnapshotError {
    if error.kind() == io::ErrorKind::UnexpectedEof { SnapshotError::Damaged } else { SnapshotError::Io(error) }
}

/// What a checksum begins with.
const SEED: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a over 64-bit words, going on from that of the blocks before: finds damage, not malice.
fn checksum(before: u64, blocks: &[Block]) -> u64 {
    let words = blocks.iter().flat_map(|block| block.0);
    words.fold(before, |hash, word| {
        let mixed = (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3);
        mixed ^ (mixed >> 32)
    })
}

#[cfg(test)]
mod tests {
    use overfly_table::field::{FieldCounts, FieldFacts, TileRow};
    use overfly_table::{FieldTableMut, SegmentRows};
    use proptest::prelude::*;

    use super::*;
    use crate::session::HeapField;

    const LIMIT: u64 = 1 << 20;

    fn stamp() -> FieldStamp {
        FieldStamp { scene: "town".into(), revision: 3, settings_hash: 7 }
    }

    /// A field of two tiles with so many rows.
    fn field(samples: usize, rows: usize, bits: u32) -> HeapField {
        let counts = FieldCounts { samples, tiles: 2, patches: 2, structures: 1, ..Default::default() };
        let mut blocks = vec![Block::ZERO; counts.blocks()];
        let tile = |first_patch| TileRow { first_patch, patches: 1, rows: rows as u32, ..Default::default() };
        FieldTableMut::create(&mut blocks, &counts, FieldFacts::default()).tiles.copy_from_slice(&[tile(0), tile(1)]);
        let segment = |bits: u32| {
            let mut written = SegmentRows::default();
            (0..rows).for_each(|_| {
                written.see(0, bits);
                written.end_row();
            });
            let mut blocks = vec![Block::ZERO; written.blocks()];
            written.write(&mut blocks);
            Segment::open(Arc::new(blocks)).unwrap()
        };
        HeapField { blocks, segments: vec![segment(bits), segment(!bits)] }
    }

    fn written(field: &HeapField) -> Vec<u8> {
        let mut file = Vec::new();
        write(&mut file, &stamp(), field).unwrap();
        file
    }

    proptest! {
        #[test]
        fn a_field_comes_back_as_it_was(samples in 1usize..200, rows in 1usize..50, bits: u32) {
            let field = field(samples, rows, bits);
            let read = read(&mut written(&field).as_slice(), &stamp(), LIMIT).unwrap();
            prop_assert!(read.is_same(&field));
        }

        #[test]
        fn any_changed_byte_is_found(place: prop::sample::Index, change in 1u8..=255) {
            let mut file = written(&field(100, 10, 5));
            let place = place.index(file.len());
            file[place] ^= change;
            prop_assert!(read(&mut file.as_slice(), &stamp(), LIMIT).is_err());
        }

        #[test]
        fn any_missing_end_is_found(place: prop::sample::Index) {
            let file = written(&field(100, 10, 5));
            let end = place.index(file.len());
            prop_assert!(read(&mut &file[..end], &stamp(), LIMIT).is_err());
        }
    }

    #[test]
    fn a_snapshot_of_another_scene_or_release_is_told_apart() {
        let file = written(&field(10, 10, 1));
        let other = FieldStamp { revision: 4, ..stamp() };
        assert!(matches!(read(&mut file.as_slice(), &other, LIMIT), Err(SnapshotError::Foreign { .. })));
        let mut newer = file.clone();
        newer[12] = SCHEMA as u8 + 1;
        assert!(matches!(read(&mut newer.as_slice(), &stamp(), LIMIT), Err(SnapshotError::Schema { found: 3 })));
        assert!(matches!(read(&mut file.as_slice(), &stamp(), 100), Err(SnapshotError::TooLong { .. })));
        assert!(matches!(read(&mut &b"not a snapshot"[..], &stamp(), LIMIT), Err(SnapshotError::NotASnapshot)));
    }
}
