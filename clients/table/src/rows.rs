//! The visibility rows of a field, in segments: each holds the rows of the viewpoints of one tile.
//!
//! A row names what it sees by patches, up to 32 consecutive samples of one structure. Patches are numbered in their segment, and where they lie among the
//! samples of a field only the field's table says. So a segment stays what it is when samples come and go out of its reach.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use crate::layout::{self, Block, LayoutError, Section};

/// "OVFLYROW" in memory order on a little-endian machine.
pub const MAGIC: u64 = u64::from_le_bytes(*b"OVFLYROW");
pub const SCHEMA: u32 = 1;

/// Samples of a patch.
pub const PATCH: usize = 32;

/// What a viewpoint sees of a patch.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SeenRow {
    /// Number of the patch in its segment; ascending in a row.
    pub patch: u32,
    /// Bit `b` says that the sample `b` places after the patch's first one can be seen. Never zero.
    pub bits: u32,
}

/// Memory that holds a finished table or segment. What it holds never changes.
pub trait TableMemory: Send + Sync {
    fn blocks(&self) -> &[Block];

    /// What other processes find it by; 0 for memory of this process alone.
    fn number(&self) -> u64 {
        0
    }
}

impl TableMemory for Vec<Block> {
    fn blocks(&self) -> &[Block] {
        self
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct SegmentHeader {
    magic: u64,
    schema: u32,
    header_bytes: u32,
    total_bytes: u64,
    sections: [Section; SECTIONS],
}

const SECTIONS: usize = 2;
const NAMES: [&str; SECTIONS] = ["starts", "seen"];
const ROW_BYTES: [usize; SECTIONS] = [size_of::<u32>(), size_of::<SeenRow>()];

fn sections(rows: usize, seen: usize) -> ([Section; SECTIONS], u64) {
    layout::lay_out(size_of::<SegmentHeader>(), [(rows + 1, ROW_BYTES[0]), (seen, ROW_BYTES[1])])
}

/// Rows that are to be written, one after another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SegmentRows {
    /// Where in `seen` each row starts, and where the last one ends.
    starts: Vec<u32>,
    seen: Vec<SeenRow>,
}

impl Default for SegmentRows {
    fn default() -> Self {
        Self { starts: vec![0], seen: Vec::new() }
    }
}

impl SegmentRows {
    /// Adds what the current row sees of the next patch.
    #[inline]
    pub fn see(&mut self, patch: u32, bits: u32) {
        if bits != 0 {
            self.seen.push(SeenRow { patch, bits });
        }
    }

    /// Ends the current row and begins the next one.
    pub fn end_row(&mut self) {
        self.starts.push(u32::try_from(self.seen.len()).expect("a tile's rows see fewer than four milliard patches"));
    }

    /// Numbers patches anew: `number` gives each its new number.
    pub fn renumber(&mut self, number: impl Fn(u32) -> u32) {
        self.seen.iter_mut().for_each(|seen| seen.patch = number(seen.patch));
    }

    pub fn is_in(&self, segment: &Segment) -> bool {
        segment.starts() == self.starts && segment.seen() == self.seen
    }

    pub fn seen(&self) -> &[SeenRow] {
        &self.seen
    }

    /// Size of the segment in blocks.
    pub fn blocks(&self) -> usize {
        layout::blocks_for(sections(self.starts.len() - 1, self.seen.len()).1)
    }

    /// Writes the segment into `blocks`, which are exactly [`SegmentRows::blocks`] long; all of them are written.
    pub fn write(&self, blocks: &mut [Block]) {
        assert_eq!(blocks.len(), self.blocks(), "the caller sizes the segment with SegmentRows::blocks");
        let (sections, total_bytes) = sections(self.starts.len() - 1, self.seen.len());
        let header_bytes = size_of::<SegmentHeader>();
        let header = SegmentHeader { magic: MAGIC, schema: SCHEMA, header_bytes: header_bytes as u32, total_bytes, sections };
        bytemuck::cast_slice_mut::<Block, u8>(blocks)[..header_bytes].copy_from_slice(bytemuck::bytes_of(&header));
        let [starts, seen] = layout::split_mut(blocks, header_bytes, sections, ROW_BYTES);
        starts.copy_from_slice(bytemuck::cast_slice(&self.starts));
        seen.copy_from_slice(bytemuck::cast_slice(&self.seen));
    }
}

/// A segment that can be read, with the memory that it lies in. Cheap to clone.
#[derive(Clone)]
pub struct Segment {
    memory: Arc<dyn TableMemory>,
    /// Where the sections lie, bytes.
    sections: [Range<usize>; SECTIONS],
}

impl std::fmt::Debug for Segment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Segment of {} rows", self.rows())
    }
}

impl Segment {
    /// Opens a segment that somebody else may have written. The bounds of its sections are checked here, what they hold when it is read.
    pub fn open(memory: Arc<dyn TableMemory>) -> Result<Self, LayoutError> {
        let blocks = memory.blocks();
        let header: &SegmentHeader = layout::header(blocks, "segment", MAGIC, SCHEMA, |header: &SegmentHeader| {
            (header.magic, header.schema, header.total_bytes)
        })?;
        let bytes = size_of_val(blocks);
        let range = |index: usize| layout::byte_range(bytes, header.sections[index], ROW_BYTES[index], NAMES[index]);
        let sections = [range(0)?, range(1)?];
        if sections[0].is_empty() {
            return Err(LayoutError::Section { section: NAMES[0] });
        }
        Ok(Self { sections, memory })
    }

    pub fn memory(&self) -> &Arc<dyn TableMemory> {
        &self.memory
    }

    /// How many rows it has.
    pub fn rows(&self) -> usize {
        self.starts().len() - 1
    }

    /// What row `row` sees; nothing where there is no such row.
    #[inline]
    pub fn row(&self, row: usize) -> &[SeenRow] {
        let starts = self.starts();
        let (Some(&start), Some(&end)) = (starts.get(row), starts.get(row + 1)) else { return &[] };
        self.seen().get(start as usize..end as usize).unwrap_or(&[])
    }

    /// What all rows see, one after another.
    #[inline]
    pub fn seen(&self) -> &[SeenRow] {
        self.section(1)
    }

    #[inline]
    fn starts(&self) -> &[u32] {
        self.section(0)
    }

    fn section<T: Pod>(&self, index: usize) -> &[T] {
        bytemuck::cast_slice(&bytemuck::cast_slice::<Block, u8>(self.memory.blocks())[self.sections[index].clone()])
    }
}

/// The visibility row of one viewpoint of a field.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    pub(crate) seen: &'a [SeenRow],
    /// By patch of the segment: its first sample in the field.
    pub(crate) patches: &'a [u32],
    /// Samples of the field.
    pub(crate) samples: usize,
}

impl<'a> Row<'a> {
    /// A row that sees nothing.
    pub const NOTHING: Row<'static> = Row { seen: &[], patches: &[], samples: 0 };

    /// The samples that can be seen, in ascending order.
    #[inline]
    pub fn samples(self) -> impl Iterator<Item = usize> + use<'a> {
        self.samples_where(|_| u32::MAX)
    }

    /// Those of them that are in a set, in ascending order. Whoever looks for a few samples in many rows passes over whole patches.
    #[inline]
    pub fn samples_in<'s>(self, set: &'s SampleSet) -> impl Iterator<Item = usize> + use<'a, 's> {
        self.samples_where(|first| set.bits_from(first))
    }

    /// `wanted` gives the samples that count of the 32 from a first one on.
    #[inline]
    fn samples_where<W: Fn(usize) -> u32>(self, wanted: W) -> impl Iterator<Item = usize> + use<'a, W> {
        let Row { seen, patches, samples } = self;
        // What a damaged table may say beyond the samples is passed over.
        seen.iter().flat_map(move |seen| {
            let first = patches.get(seen.patch as usize).map_or(samples, |first| *first as usize);
            let bits = if first < samples { seen.bits & wanted(first) } else { 0 };
            ones(bits).map(move |b| first + b).take_while(move |sample| *sample < samples)
        })
    }

    /// Whether sample `i` can be seen.
    pub fn sees(self, i: usize) -> bool {
        self.samples().any(|sample| sample == i)
    }
}

/// A set of samples, read as rows are: 32 that follow each other at a time. All of its methods panic for samples beyond its size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleSet {
    /// One word more than the samples need, so that 32 bits can be read from the last one on.
    words: Vec<u64>,
}

impl SampleSet {
    /// None of so many samples.
    pub fn none_of(samples: usize) -> Self {
        Self { words: vec![0; samples / 64 + 2] }
    }

    pub fn insert(&mut self, i: usize) {
        self.words[i / 64] |= 1 << (i % 64);
    }

    pub fn remove(&mut self, i: usize) {
        self.words[i / 64] &= !(1 << (i % 64));
    }

    #[inline]
    pub fn contains(&self, i: usize) -> bool {
        self.words[i / 64] >> (i % 64) & 1 == 1
    }

    /// Bit `b` says whether the sample `b` places after `first` is in the set; beyond the last one none is.
    #[inline]
    pub fn bits_from(&self, first: usize) -> u32 {
        let (word, shift) = (first / 64, first % 64);
        ((u128::from(self.words[word + 1]) << 64 | u128::from(self.words[word])) >> shift) as u32
    }
}

/// The places of the bits that are set.
#[inline]
pub fn ones(bits: u32) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(bits), |rest| Some(rest & rest.wrapping_sub(1)))
        .take_while(|rest| *rest != 0)
        .map(|rest| rest.trailing_zeros() as usize)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn segment(rows: &[Vec<(u32, u32)>]) -> (SegmentRows, Segment) {
        let mut written = SegmentRows::default();
        for row in rows {
            row.iter().for_each(|&(patch, bits)| written.see(patch, bits));
            written.end_row();
        }
        let mut blocks = vec![Block::ZERO; written.blocks()];
        written.write(&mut blocks);
        (written, Segment::open(Arc::new(blocks)).unwrap())
    }

    fn rows() -> impl Strategy<Value = Vec<Vec<(u32, u32)>>> {
        let row = proptest::collection::btree_map(0u32..9, 1u32.., 0..6);
        proptest::collection::vec(row.prop_map(|row| row.into_iter().collect()), 0..9)
    }

    proptest! {
        #[test]
        fn rows_come_back_as_they_were(rows in rows()) {
            let (written, segment) = segment(&rows);
            prop_assert!(written.is_in(&segment));
            prop_assert_eq!(segment.rows(), rows.len());
            for (number, row) in rows.iter().enumerate() {
                let found: Vec<_> = segment.row(number).iter().map(|seen| (seen.patch, seen.bits)).collect();
                prop_assert_eq!(&found, row);
            }
            prop_assert!(segment.row(rows.len()).is_empty());
        }

        #[test]
        fn a_row_sees_the_samples_whose_bits_are_set(row in proptest::collection::btree_map(0u32..9, 1u32.., 0..6)) {
            let row: Vec<(u32, u32)> = row.into_iter().collect();
            let (_, segment) = segment(std::slice::from_ref(&row));
            let patches: Vec<u32> = (0..9).map(|patch| 40 * patch).collect();
            let row_of = Row { seen: segment.row(0), patches: &patches, samples: 340 };
            let is_set = |i: usize| row.iter().any(|&(patch, bits)| {
                (0..PATCH).any(|b| 40 * patch as usize + b == i && bits >> b & 1 == 1)
            });
            let expected: Vec<usize> = (0..340).filter(|&i| is_set(i)).collect();
            prop_assert_eq!(row_of.samples().collect::<Vec<_>>(), expected.clone());
            prop_assert!((0..400).all(|i| row_of.sees(i) == expected.contains(&i)));
            let mut set = SampleSet::none_of(340);
            (0..340).filter(|i| i % 3 != 1).for_each(|i| set.insert(i));
            (0..340).filter(|i| i % 5 == 2).for_each(|i| set.remove(i));
            let is_in = |i: &usize| i % 3 != 1 && i % 5 != 2;
            prop_assert!((0..340).all(|i| set.contains(i) == is_in(&i)));
            prop_assert_eq!(row_of.samples_in(&set).collect::<Vec<_>>(), expected.into_iter().filter(is_in).collect::<Vec<_>>());
        }

        #[test]
        fn a_damaged_segment_is_refused_or_read_without_a_fault(rows in rows(), damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20), end: prop::sample::Index) {
            let (_, good) = segment(&rows);
            let mut blocks = good.memory().blocks().to_vec();
            for (place, value) in &damage {
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut blocks);
                let place = place.index(bytes.len());
                bytes[place] = *value;
            }
            blocks.truncate(end.index(blocks.len()) + 1);
            if let Ok(segment) = Segment::open(Arc::new(blocks)) {
                for number in 0..segment.rows().min(100) + 1 {
                    let row = Row { seen: segment.row(number), patches: &[0, 7, 300], samples: 310 };
                    prop_assert!(row.samples().all(|i| i < 310));
                }
            }
        }
    }
}
