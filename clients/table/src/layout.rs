//! Sections in a slice of blocks: where they lie, and the checks before anyone reads them.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

/// The unit of allocation: tables start on a cache line wherever they lie.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Block(pub [u64; 8]);

impl Block {
    pub const BYTES: usize = size_of::<Block>();
    pub const ZERO: Block = Block([0; 8]);
}

/// A run of equal rows: `offset_bytes` from the start of the table (a multiple of 64), `count` rows.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Section {
    pub offset_bytes: u64,
    pub count: u64,
}

/// Why a slice of blocks is not a table of the expected kind.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    #[error("the table holds {bytes} bytes, too few for its header of {needed}")]
    Truncated { bytes: usize, needed: usize },
    #[error("the table starts with {found:#018x}, not with {expected:#018x}: it is not a {kind} table")]
    Magic { kind: &'static str, found: u64, expected: u64 },
    #[error(
        "the {kind} table has schema version {found}; this program reads version {expected}: use client and daemon of one release"
    )]
    Schema { kind: &'static str, found: u32, expected: u32 },
    #[error("the section `{section}` of the table lies outside of it or is misplaced")]
    Section { section: &'static str },
    #[error("the table has {wanted} segments, but {found} were given")]
    Segments { found: usize, wanted: usize },
    #[error("segment {index} is not that of the table: it has {found} rows instead of {wanted}")]
    Rows { index: usize, found: usize, wanted: usize },
}

/// The number of blocks that hold `bytes` bytes.
pub fn blocks_for(bytes: u64) -> usize {
    usize::try_from(bytes.div_ceil(Block::BYTES as u64)).expect("a table is smaller than the address space")
}

/// Lays sections of `(rows, bytes per row)` one after another behind a header of `header_bytes`; returns them with the total size.
pub(crate) fn lay_out<const S: usize>(header_bytes: usize, rows: [(usize, usize); S]) -> ([Section; S], u64) {
    let mut end = align_up(header_bytes as u64);
    let sections = rows.map(|(count, bytes)| {
        let section = Section { offset_bytes: end, count: count as u64 };
        end = align_up(end + (count as u64) * (bytes as u64));
        section
    });
    (sections, end)
}

/// The rows of `section`, or an error that names it when it does not lie wholly inside the table on a block boundary.
pub(crate) fn rows<'a, T: Pod>(blocks: &'a [Block], section: Section, name: &'static str) -> Result<&'a [T], LayoutError> {
    let bytes: &[u8] = bytemuck::cast_slice(blocks);
    let range = byte_range(bytes.len(), section, size_of::<T>(), name)?;
    bytemuck::try_cast_slice(&bytes[range]).map_err(|_| LayoutError::Section { section: name })
}

/// Splits a table into its mutable sections, in their order, and makes all zero that lies between them. `sections` must have been made by [`lay_out`].
pub(crate) fn split_mut<const S: usize>(
    blocks: &mut [Block],
    header_bytes: usize,
    sections: [Section; S],
    bytes_per_row: [usize; S],
) -> [&mut [u8]; S] {
    let (mut position, mut index) = (header_bytes, 0);
    let mut rest: &mut [u8] = &mut bytemuck::cast_slice_mut(blocks)[header_bytes..];
    let split = sections.map(|section| {
        let start = section.offset_bytes as usize - position;
        let length = section.count as usize * bytes_per_row[index];
        index += 1;
        let (gap, tail) = std::mem::take(&mut rest).split_at_mut(start);
        gap.fill(0);
        let (rows, tail) = tail.split_at_mut(length);
        position += start + length;
        rest = tail;
        rows
    });
    rest.fill(0);
    split
}

/// Reads the header `H` of a table and checks magic number and schema; `identity` takes them out of the header.
pub(crate) fn header<'a, H: Pod>(
    blocks: &'a [Block],
    kind: &'static str,
    magic: u64,
    schema: u32,
    identity: impl Fn(&H) -> (u64, u32, u64),
) -> Result<&'a H, LayoutError> {
    let bytes: &[u8] = bytemuck::cast_slice(blocks);
    let needed = size_of::<H>();
    let head = bytes.get(..needed).ok_or(LayoutError::Truncated { bytes: bytes.len(), needed })?;
    let header: &H = bytemuck::from_bytes(head);
    let (found_magic, found_schema, total_bytes) = identity(header);
    if found_magic != magic {
        return Err(LayoutError::Magic { kind, found: found_magic, expected: magic });
    }
    if found_schema != schema {
        return Err(LayoutError::Schema { kind, found: found_schema, expected: schema });
    }
    if total_bytes > bytes.len() as u64 {
        return Err(LayoutError::Truncated { bytes: bytes.len(), needed: total_bytes as usize });
    }
    Ok(header)
}

/// Where a section of rows of `row_bytes` lies in a table of so many bytes.
pub(crate) fn byte_range(
    table_bytes: usize,
    section: Section,
    row_bytes: usize,
    name: &'static str,
) -> Result<Range<usize>, LayoutError> {
    let range = || {
        let start = usize::try_from(section.offset_bytes).ok()?;
        let length = usize::try_from(section.count).ok()?.checked_mul(row_bytes)?;
        let end = start.checked_add(length)?;
        (start % Block::BYTES == 0 && end <= table_bytes).then_some(start..end)
    };
    range().ok_or(LayoutError::Section { section: name })
}

/// Every table begins so, whatever its kind.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Start {
    magic: u64,
    schema: u32,
    header_bytes: u32,
    total_bytes: u64,
}

/// How many blocks the table at the start of `blocks` says to have; `None` when there are fewer.
pub fn first_table(blocks: &[Block]) -> Option<usize> {
    let start: &Start = bytemuck::from_bytes(bytemuck::cast_slice::<Block, u8>(blocks).get(..size_of::<Start>())?);
    let count = usize::try_from(start.total_bytes.div_ceil(Block::BYTES as u64)).ok()?;
    (count <= blocks.len()).then_some(count)
}

fn align_up(bytes: u64) -> u64 {
    bytes.next_multiple_of(Block::BYTES as u64)
}
