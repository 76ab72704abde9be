//! The view information field as a table (paper, section 4.3 and Algorithm 1), with the outlines of the structures beside it. What can be seen
//! from where lies in the segments that it names.

use std::borrow::Cow;

use bytemuck::{Pod, Zeroable};

use crate::layout::{self, Block, LayoutError, Section};
use crate::rows::{Row, Segment};

/// "OVFLYVIF" in memory order on a little-endian machine.
pub const MAGIC: u64 = u64::from_le_bytes(*b"OVFLYVIF");
pub const SCHEMA: u32 = 3;

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
    /// Flights stay this near above the ground by law, m.
    pub legal_ceiling_m: f64,
    /// South-west corner of the grid of the ground, and the edge of its cells, m; meaningless where the ground is flat.
    pub ground_origin_m: [f64; 2],
    pub ground_cell_m: f64,
    /// Corners of that grid from west to east and from south to north; none where the ground is the plane z = 0.
    pub ground_corners: [u32; 2],
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
    /// Its tile, and its row in the segment of that.
    pub tile: u32,
    pub row: u32,
}

/// A tile: the viewpoints of neighbouring columns of the lattice, with the segment that holds their rows.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct TileRow {
    /// What other processes find the segment by; 0 for one in the memory of one process.
    pub number: u64,
    /// The patches of the segment in the patches section.
    pub first_patch: u32,
    pub patches: u32,
    /// Rows of the segment.
    pub rows: u32,
    pub reserved: u32,
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

/// A no-fly zone: its name in the names section, its outline in the rings section. Over that no flight is between its heights above the ground.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ZoneRow {
    pub floor_m: f64,
    /// `f64::MAX` without an upper end.
    pub ceiling_m: f64,
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
    pub tiles: usize,
    pub patches: usize,
    pub structures: usize,
    pub rings: usize,
    pub points: usize,
    pub name_bytes: usize,
    pub zones: usize,
    /// Corners of the ground's grid.
    pub ground: usize,
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

const SECTIONS: usize = 11;
const NAMES: [&str; SECTIONS] =
    ["samples", "ceilings", "viewpoints", "tiles", "patches", "structures", "rings", "points", "names", "zones", "ground"];
const ROW_BYTES: [usize; SECTIONS] = [
    size_of::<SampleRow>(),
    size_of::<u16>(),
    size_of::<ViewpointRow>(),
    size_of::<TileRow>(),
    size_of::<u32>(),
    size_of::<StructureRow>(),
    size_of::<RingRow>(),
    size_of::<PointRow>(),
    1,
    size_of::<ZoneRow>(),
    size_of::<f64>(),
];

impl FieldCounts {
    /// Size of the table in blocks, without the segments.
    pub fn blocks(&self) -> usize {
        layout::blocks_for(self.sections().1)
    }

    fn sections(&self) -> ([Section; SECTIONS], u64) {
        let counts = [
            self.samples,
            self.samples,
            self.viewpoints,
            self.tiles,
            self.patches,
            self.structures,
            self.rings,
            self.points,
            self.name_bytes,
            self.zones,
            self.ground,
        ];
        let mut rows = [(0, 0); SECTIONS];
        for (row, (count, bytes)) in rows.iter_mut().zip(counts.into_iter().zip(ROW_BYTES)) {
            *row = (count, bytes);
        }
        layout::lay_out(size_of::<FieldHeader>(), rows)
    }
}

/// A field that can be read: its table, and the segments with the visibility rows.
#[derive(Clone, Copy, Debug)]
pub struct FieldTable<'a> {
    pub facts: &'a FieldFacts,
    pub samples: &'a [SampleRow],
    /// Cells of each sample that all viewpoints together cover: what a sample can reach at all.
    pub ceilings: &'a [u16],
    pub viewpoints: &'a [ViewpointRow],
    pub tiles: &'a [TileRow],
    /// First sample of each patch.
    pub patches: &'a [u32],
    /// By tile.
    pub segments: &'a [Segment],
    pub structures: &'a [StructureRow],
    pub rings: &'a [RingRow],
    pub points: &'a [PointRow],
    pub zones: &'a [ZoneRow],
    /// Heights of the ground above the plane z = 0 at the corners of its grid, m: rows from the south, in each from the west. Each cell is halved from its
    /// south-west to its north-east corner.
    pub ground_m: &'a [f64],
    names: &'a [u8],
    table_bytes: u64,
}

/// The tiles of a field's table, with the numbers of the segments that it is opened with.
pub fn tiles(blocks: &[Block]) -> Result<&[TileRow], LayoutError> {
    layout::rows(blocks, header(blocks)?.sections[3], NAMES[3])
}

fn header(blocks: &[Block]) -> Result<&FieldHeader, LayoutError> {
    layout::header(blocks, "field", MAGIC, SCHEMA, |header: &FieldHeader| (header.magic, header.schema, header.total_bytes))
}

impl<'a> FieldTable<'a> {
    /// Opens a table that somebody else may have written, with its segments, one for each tile; every bound and every index between sections is checked.
    pub fn open(blocks: &'a [Block], segments: &'a [Segment]) -> Result<Self, LayoutError> {
        let table = Self::open_again(blocks, segments)?;
        table.check_references()?;
        table.check_segments()?;
        Ok(table)
    }

    /// The same of a table that was opened before and that nobody writes to: only the bounds of its sections are looked at again. Of another one an index
    /// may lead nowhere, and looking it up panics.
    pub fn open_again(blocks: &'a [Block], segments: &'a [Segment]) -> Result<Self, LayoutError> {
        let header = header(blocks)?;
        let [samples, ceilings, viewpoints, tiles, patches, structures, rings, points, names, zones, ground] = header.sections;
        Ok(Self {
            facts: &header.facts,
            samples: layout::rows(blocks, samples, NAMES[0])?,
            ceilings: layout::rows(blocks, ceilings, NAMES[1])?,
            viewpoints: layout::rows(blocks, viewpoints, NAMES[2])?,
            tiles: layout::rows(blocks, tiles, NAMES[3])?,
            patches: layout::rows(blocks, patches, NAMES[4])?,
            segments,
            structures: layout::rows(blocks, structures, NAMES[5])?,
            rings: layout::rows(blocks, rings, NAMES[6])?,
            points: layout::rows(blocks, points, NAMES[7])?,
            names: layout::rows(blocks, names, NAMES[8])?,
            zones: layout::rows(blocks, zones, NAMES[9])?,
            ground_m: layout::rows(blocks, ground, NAMES[10])?,
            table_bytes: header.total_bytes,
        })
    }

    /// Whether sample `i` can be captured at all: all viewpoints together cover more than the threshold.
    pub fn is_capturable(&self, i: usize) -> bool {
        u32::from(self.ceilings[i]) > self.facts.threshold_cells
    }

    /// The visibility row of viewpoint `j`: what can be seen from it, whatever the direction of the camera. A view direction is a further test on the
    /// same samples.
    #[inline]
    pub fn row(&self, j: usize) -> Row<'a> {
        let viewpoint = &self.viewpoints[j];
        let tile = viewpoint.tile as usize;
        let seen = self.segments[tile].row(viewpoint.row as usize);
        Row { seen, patches: self.patches_of(&self.tiles[tile]), samples: self.samples.len() }
    }

    /// First sample of each patch of a tile.
    pub fn patches_of(&self, tile: &TileRow) -> &'a [u32] {
        &self.patches[tile.first_patch as usize..][..tile.patches as usize]
    }

    /// Size of the table and its segments, bytes.
    pub fn bytes(&self) -> u64 {
        self.table_bytes + self.segments.iter().map(|segment| size_of_val(segment.memory().blocks()) as u64).sum::<u64>()
    }

    /// The name of a structure; bytes that are not UTF-8 are replaced.
    pub fn name(&self, structure: &StructureRow) -> Cow<'a, str> {
        self.text(structure.first_name_byte, structure.name_bytes)
    }

    /// The rings of a structure's outline.
    pub fn outline(&self, structure: &StructureRow) -> impl Iterator<Item = &'a [PointRow]> + use<'a> {
        self.rings_of(structure.first_ring, structure.rings)
    }

    /// The name of a zone; bytes that are not UTF-8 are replaced.
    pub fn zone_name(&self, zone: &ZoneRow) -> Cow<'a, str> {
        self.text(zone.first_name_byte, zone.name_bytes)
    }

    /// The rings of a zone's outline.
    pub fn zone_outline(&self, zone: &ZoneRow) -> impl Iterator<Item = &'a [PointRow]> + use<'a> {
        self.rings_of(zone.first_ring, zone.rings)
    }

    fn text(&self, first_byte: u32, bytes: u32) -> Cow<'a, str> {
        String::from_utf8_lossy(&self.names[first_byte as usize..][..bytes as usize])
    }

    fn rings_of(&self, first: u32, count: u32) -> impl Iterator<Item = &'a [PointRow]> + use<'a> {
        let points = self.points;
        let rings = &self.rings[first as usize..][..count as usize];
        rings.iter().map(move |ring| &points[ring.first_point as usize..][..ring.points as usize])
    }

    fn check_references(&self) -> Result<(), LayoutError> {
        let fits = |first: u32, count: u32, length: usize| u64::from(first) + u64::from(count) <= length as u64;
        let fault = |index: usize| Err(LayoutError::Section { section: NAMES[index] });
        if self.ceilings.len() != self.samples.len() {
            return fault(1);
        }
        let is_placed = |row: &ViewpointRow| self.tiles.get(row.tile as usize).is_some_and(|tile| row.row < tile.rows);
        if !self.viewpoints.iter().all(is_placed) {
            return fault(2);
        }
        if !self.tiles.iter().all(|tile| fits(tile.first_patch, tile.patches, self.patches.len())) {
            return fault(3);
        }
        if !self.samples.iter().all(|sample| (sample.structure as usize) < self.structures.len()) {
            return fault(0);
        }
        if !self.rings.iter().all(|ring| fits(ring.first_point, ring.points, self.points.len())) {
            return fault(6);
        }
        let is_drawn = |rings: [u32; 2], name: [u32; 2]| {
            fits(rings[0], rings[1], self.rings.len()) && fits(name[0], name[1], self.names.len())
        };
        let sound = self.structures.iter().all(|row| {
            fits(row.first_sample, row.samples, self.samples.len())
                && is_drawn([row.first_ring, row.rings], [row.first_name_byte, row.name_bytes])
        });
        if !sound {
            return fault(5);
        }
        if !self.zones.iter().all(|row| is_drawn([row.first_ring, row.rings], [row.first_name_byte, row.name_bytes])) {
            return fault(9);
        }
        let [across, up] = self.facts.ground_corners.map(u64::from);
        if across * up == self.ground_m.len() as u64 { Ok(()) } else { fault(10) }
    }

    fn check_segments(&self) -> Result<(), LayoutError> {
        let (found, wanted) = (self.segments.len(), self.tiles.len());
        if found != wanted {
            return Err(LayoutError::Segments { found, wanted });
        }
        for (index, (segment, tile)) in self.segments.iter().zip(self.tiles).enumerate() {
            let (found, wanted) = (segment.rows(), tile.rows as usize);
            if found != wanted {
                return Err(LayoutError::Rows { index, found, wanted });
            }
        }
        Ok(())
    }
}

/// A field that is being built in place.
#[derive(Debug)]
pub struct FieldTableMut<'a> {
    pub samples: &'a mut [SampleRow],
    pub ceilings: &'a mut [u16],
    pub viewpoints: &'a mut [ViewpointRow],
    pub tiles: &'a mut [TileRow],
    pub patches: &'a mut [u32],
    pub structures: &'a mut [StructureRow],
    pub rings: &'a mut [RingRow],
    pub points: &'a mut [PointRow],
    pub names: &'a mut [u8],
    pub zones: &'a mut [ZoneRow],
    pub ground_m: &'a mut [f64],
}

impl<'a> FieldTableMut<'a> {
    /// Writes the header and returns the sections, whose rows hold what `blocks` held: these are exactly `counts.blocks()` long, and may be anything.
    pub fn create(blocks: &'a mut [Block], counts: &FieldCounts, facts: FieldFacts) -> Self {
        assert_eq!(blocks.len(), counts.blocks(), "the caller sizes the table with FieldCounts::blocks");
        let (sections, total_bytes) = counts.sections();
        let header_bytes = size_of::<FieldHeader>();
        let header =
            FieldHeader { magic: MAGIC, schema: SCHEMA, header_bytes: header_bytes as u32, total_bytes, facts, sections };
        bytemuck::cast_slice_mut::<Block, u8>(blocks)[..header_bytes].copy_from_slice(bytemuck::bytes_of(&header));
        let [samples, ceilings, viewpoints, tiles, patches, structures, rings, points, names, zones, ground] =
            layout::split_mut(blocks, header_bytes, sections, ROW_BYTES);
        Self {
            samples: bytemuck::cast_slice_mut(samples),
            ceilings: bytemuck::cast_slice_mut(ceilings),
            viewpoints: bytemuck::cast_slice_mut(viewpoints),
            tiles: bytemuck::cast_slice_mut(tiles),
            patches: bytemuck::cast_slice_mut(patches),
            structures: bytemuck::cast_slice_mut(structures),
            rings: bytemuck::cast_slice_mut(rings),
            points: bytemuck::cast_slice_mut(points),
            names,
            zones: bytemuck::cast_slice_mut(zones),
            ground_m: bytemuck::cast_slice_mut(ground),
        }
    }
}

#[cfg(test)]
mod tests;
