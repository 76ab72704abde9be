//! The view information field as a table (paper, section 4.3 and Algorithm 1), with the outlines of the structures beside it.

use bytemuck::{Pod, Zeroable};

use crate::layout::{self, Block, LayoutError, Section};

/// "OVFLYVIF" in memory order on a little-endian machine.
pub const MAGIC: u64 = u64::from_le_bytes(*b"OVFLYVIF");
pub const SCHEMA: u32 = 1;

/// Size and pinned settings of a field. Everything that an update after an edit must not change stands here.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FieldFacts {
    /// Revision of the scene that the field was built from; 1 for a scene as loaded, one more with every edit.
    pub revision: u64,
    /// Fingerprint of the settings that the field depends on.
    pub settings_hash: u64,
    /// Edge of a cell of the viewpoint lattice, m.
    pub lattice_spacing_m: f64,
    /// Mean distance of neighbouring surface samples, m.
    pub sample_spacing_m: f64,
    /// Exposed surface when the field was first built, m^2: the A of the objective's units.
    pub reference_area_m2: f64,
    /// Neighbour radius of the tree search, m.
    pub neighbour_radius_m: f64,
    /// Range beyond which a sample is not captured, m.
    pub range_m: f64,
    /// Cells K of the hemisphere over each sample.
    pub hemisphere_cells: u32,
    /// A sample counts as captured when more than this many of its cells are covered.
    pub threshold_cells: u32,
    /// Box that holds all structures, m.
    pub min_m: [f64; 3],
    pub max_m: [f64; 3],
    /// Geodetic origin of the local frame, degrees and metres; meaningless unless `georeferenced` is 1.
    pub origin_lat_deg: f64,
    pub origin_lon_deg: f64,
    pub origin_alt_m: f64,
    pub georeferenced: u64,
}

/// A surface sample.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SampleRow {
    pub position_m: [f64; 3],
    /// Unit normal, outwards.
    pub normal: [f64; 3],
    /// Area that the sample stands for, in square millimetres: whole numbers make sums independent of their order.
    pub area_mm2: u64,
    /// Index into the structures section.
    pub structure: u32,
    /// 1 when the sample lies on the outside of the scene, 0 when it is buried in a neighbour or in the ground.
    pub exposed: u32,
}

/// A viewpoint of the field.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ViewpointRow {
    pub position_m: [f64; 3],
    /// Distance to the nearest surface, m, cut off at the outer edge of the shell.
    pub clearance_m: f64,
}

/// A structure: its heights, its name in the names section, its outline in the rings section, its samples in the samples section.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct StructureRow {
    pub id: u64,
    pub base_m: f64,
    pub top_m: f64,
    pub first_sample: u32,
    pub samples: u32,
    pub first_ring: u32,
    pub rings: u32,
    pub first_name_byte: u32,
    pub name_bytes: u32,
}

/// A closed ring of an outline seen from above (exteriors counter-clockwise, holes clockwise; the first point is not repeated).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RingRow {
    pub first_point: u32,
    pub points: u32,
}

/// A corner of an outline, m east and north.
pub type PointRow = [f64; 2];

/// How many rows each section of a field holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldCounts {
    pub samples: usize,
    pub viewpoints: usize,
    pub structures: usize,
    pub rings: usize,
    pub points: usize,
    pub name_bytes: usize,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct FieldHeader {
    magic: u64,
    schema: u32,
    header_bytes: u32,
    total_bytes: u64,
    facts: FieldFacts,
    sections: [Section; SECTIONS],
}

const SECTIONS: usize = 8;
const NAMES: [&str; SECTIONS] = ["samples", "ceilings", "viewpoints", "visibility", "structures", "rings", "points", "names"];
const ROW_BYTES: [usize; SECTIONS] = [
    size_of::<SampleRow>(),
    size_of::<u16>(),
    size_of::<ViewpointRow>(),
    size_of::<u64>(),
    size_of::<StructureRow>(),
    size_of::<RingRow>(),
    size_of::<PointRow>(),
    1,
];

impl FieldCounts {
    /// Words of one visibility row: a multiple of eight, so that each row starts on a cache line.
    pub fn words_per_row(&self) -> usize {
        self.samples.div_ceil(64).next_multiple_of(8)
    }

    /// Size of the whole table in blocks.
    pub fn blocks(&self) -> usize {
        layout::blocks_for(self.sections().1)
    }

    fn sections(&self) -> ([Section; SECTIONS], u64) {
        let counts = [
            self.samples,
            self.samples,
            self.viewpoints,
            self.viewpoints * self.words_per_row(),
            self.structures,
            self.rings,
            self.points,
            self.name_bytes,
        ];
        let mut rows = [(0, 0); SECTIONS];
        for (row, (count, bytes)) in rows.iter_mut().zip(counts.into_iter().zip(ROW_BYTES)) {
            *row = (count, bytes);
        }
        layout::lay_out(size_of::<FieldHeader>(), rows)
    }
}

/// A field that can be read. Bit `i` of row `j` of `visibility` says that sample `i` can be seen from viewpoint `j`, whatever
/// the direction of the camera: a view direction is a further test on the same bits.
#[derive(Clone, Copy, Debug)]
pub struct FieldTable<'a> {
    pub facts: &'a FieldFacts,
    pub samples: &'a [SampleRow],
    /// Cells of each sample that all viewpoints together cover: what a sample can reach at all.
    pub ceilings: &'a [u16],
    pub viewpoints: &'a [ViewpointRow],
    pub visibility: &'a [u64],
    pub words_per_row: usize,
    pub structures: &'a [StructureRow],
    pub rings: &'a [RingRow],
    pub points: &'a [PointRow],
    names: &'a [u8],
}

impl<'a> FieldTable<'a> {
    /// Opens a table that somebody else may have written; every bound and every index between sections is checked.
    pub fn open(blocks: &'a [Block]) -> Result<Self, LayoutError> {
        let header: &FieldHeader = layout::header(blocks, "field", MAGIC, SCHEMA, |header: &FieldHeader| {
            (header.magic, header.schema, header.total_bytes)
        })?;
        let [samples, ceilings, viewpoints, visibility, structures, rings, points, names] = header.sections;
        let table = Self {
            facts: &header.facts,
            samples: layout::rows(blocks, samples, NAMES[0])?,
            ceilings: layout::rows(blocks, ceilings, NAMES[1])?,
            viewpoints: layout::rows(blocks, viewpoints, NAMES[2])?,
            visibility: layout::rows(blocks, visibility, NAMES[3])?,
            words_per_row: FieldCounts { samples: samples.count as usize, ..Default::default() }.words_per_row(),
            structures: layout::rows(blocks, structures, NAMES[4])?,
            rings: layout::rows(blocks, rings, NAMES[5])?,
            points: layout::rows(blocks, points, NAMES[6])?,
            names: layout::rows(blocks, names, NAMES[7])?,
        };
        table.check_references()?;
        Ok(table)
    }

    /// Whether sample `i` can be captured at all: all viewpoints together cover more than the threshold.
    pub fn is_capturable(&self, i: usize) -> bool {
        u32::from(self.ceilings[i]) > self.facts.threshold_cells
    }

    /// The visibility row of viewpoint `j`.
    pub fn row(&self, j: usize) -> &'a [u64] {
        &self.visibility[j * self.words_per_row..(j + 1) * self.words_per_row]
    }

    /// The name of a structure; bytes that are not UTF-8 are replaced.
    pub fn name(&self, structure: &StructureRow) -> std::borrow::Cow<'a, str> {
        let start = structure.first_name_byte as usize;
        String::from_utf8_lossy(&self.names[start..start + structure.name_bytes as usize])
    }

    /// The rings of a structure's outline.
    pub fn outline(&self, structure: &StructureRow) -> impl Iterator<Item = &'a [PointRow]> + use<'a> {
        let (rings, points) = (self.rings, self.points);
        let start = structure.first_ring as usize;
        rings[start..start + structure.rings as usize]
            .iter()
            .map(move |ring| &points[ring.first_point as usize..(ring.first_point + ring.points) as usize])
    }

    fn check_references(&self) -> Result<(), LayoutError> {
        let fits = |first: u32, count: u32, length: usize| u64::from(first) + u64::from(count) <= length as u64;
        let fault = |index: usize| Err(LayoutError::Section { section: NAMES[index] });
        if self.ceilings.len() != self.samples.len() {
            return fault(1);
        }
        if self.visibility.len() != self.viewpoints.len() * self.words_per_row {
            return fault(3);
        }
        if !self.samples.iter().all(|sample| (sample.structure as usize) < self.structures.len()) {
            return fault(0);
        }
        if !self.rings.iter().all(|ring| fits(ring.first_point, ring.points, self.points.len())) {
            return fault(5);
        }
        let sound = self.structures.iter().all(|row| {
            fits(row.first_sample, row.samples, self.samples.len())
                && fits(row.first_ring, row.rings, self.rings.len())
                && fits(row.first_name_byte, row.name_bytes, self.names.len())
        });
        if sound { Ok(()) } else { fault(4) }
    }
}

/// A field that is being built in place.
#[derive(Debug)]
pub struct FieldTableMut<'a> {
    pub samples: &'a mut [SampleRow],
    pub ceilings: &'a mut [u16],
    pub viewpoints: &'a mut [ViewpointRow],
    pub visibility: &'a mut [u64],
    pub words_per_row: usize,
    pub structures: &'a mut [StructureRow],
    pub rings: &'a mut [RingRow],
    pub points: &'a mut [PointRow],
    pub names: &'a mut [u8],
}

impl<'a> FieldTableMut<'a> {
    /// Zeroes `blocks`, writes the header and returns the sections. `blocks` must be exactly `counts.blocks()` long.
    pub fn create(blocks: &'a mut [Block], counts: &FieldCounts, facts: FieldFacts) -> Self {
        assert_eq!(blocks.len(), counts.blocks(), "the caller sizes the table with FieldCounts::blocks");
        blocks.fill(Block::ZERO);
        let (sections, total_bytes) = counts.sections();
        let header_bytes = size_of::<FieldHeader>();
        let header =
            FieldHeader { magic: MAGIC, schema: SCHEMA, header_bytes: header_bytes as u32, total_bytes, facts, sections };
        bytemuck::cast_slice_mut::<Block, u8>(blocks)[..header_bytes].copy_from_slice(bytemuck::bytes_of(&header));
        let [samples, ceilings, viewpoints, visibility, structures, rings, points, names] =
            layout::split_mut(blocks, sections, ROW_BYTES);
        Self {
            samples: bytemuck::cast_slice_mut(samples),
            ceilings: bytemuck::cast_slice_mut(ceilings),
            viewpoints: bytemuck::cast_slice_mut(viewpoints),
            visibility: bytemuck::cast_slice_mut(visibility),
            words_per_row: counts.words_per_row(),
            structures: bytemuck::cast_slice_mut(structures),
            rings: bytemuck::cast_slice_mut(rings),
            points: bytemuck::cast_slice_mut(points),
            names,
        }
    }
}
