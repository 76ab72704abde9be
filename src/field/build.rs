//! Writing the field's table.

use std::sync::Arc;

use geo::orient::Direction;
use geo::{Coord, LineString, MultiPolygon, Orient};
use overfly_table::field::{FieldCounts, FieldFacts, RingRow, SampleRow, StructureRow, TileRow, ViewpointRow, ZoneRow};
use overfly_table::{Block, FieldTableMut};
use rayon::prelude::*;

use super::rows::Visibility;
use super::tiles::Tile;
use super::viewpoints::Viewpoint;
use crate::coverage::DiskModel;
use crate::scene::differences::Differences;
use crate::scene::free_space::FreeSpace;
use crate::scene::{Bounds, NoFlyZone, Scene, Structure};
use crate::surface::Samples;

/// What the field of one revision is built from.
#[derive(Clone, Copy, Debug)]
pub struct FieldInputs<'a> {
    pub scene: &'a Scene,
    pub outlines: &'a Outlines,
    pub free: &'a FreeSpace,
    pub samples: &'a Samples,
    pub disks: &'a DiskModel,
    pub facts: FieldFacts,
    /// How far in front of a sample a line of sight ends, m, so that it does not end in the sample's own surface.
    pub offset_m: f64,
}

impl FieldInputs<'_> {
    /// How far a viewpoint may be from the end of a line of sight, m; a little more, so that rounding cuts off nothing at the very end of the range.
    pub fn reach_m(&self) -> f64 {
        self.disks.range_m() + self.offset_m + SLACK_M
    }
}

/// Distances are taken for so much larger, m, that rounding decides nothing.
pub const SLACK_M: f64 = 1e-3;

/// The rings of every structure and of every no-fly zone seen from above, without the repeated last corner.
#[derive(Debug)]
pub struct Outlines {
    structures: Vec<Arc<Vec<Vec<Coord>>>>,
    zones: Vec<Vec<Vec<Coord>>>,
}

impl Outlines {
    /// Casts the shadows of all structures, in parallel: that of a mesh is a union of its triangles.
    pub fn new(scene: &Scene, zones: &[NoFlyZone]) -> Self {
        let structures = scene.structures.par_iter().map(|structure| Arc::new(rings(structure))).collect();
        Self { structures, zones: zones.iter().map(zone_rings).collect() }
    }

    /// The same of a scene that differs from an earlier one with the outlines `before`.
    pub fn after(before: &Self, scene: &Scene, zones: &[NoFlyZone], differences: &Differences) -> Self {
        let of_structure = |(structure, kept): (&Arc<Structure>, &Option<usize>)| match kept {
            Some(old) => Arc::clone(&before.structures[*old]),
            None => Arc::new(rings(structure)),
        };
        let structures = scene.structures.iter().zip(&differences.kept).map(of_structure).collect();
        Self { structures, zones: zones.iter().map(zone_rings).collect() }
    }

    /// The rings of structure `index` of the scene, m.
    pub fn rings(&self, index: usize) -> &[Vec<Coord>] {
        &self.structures[index]
    }
}

/// The size of the field's table, without tiles and patches.
pub fn counts(scene: &Scene, outlines: &Outlines, free: &FreeSpace, samples: usize, viewpoints: usize) -> FieldCounts {
    let rings = || outlines.structures.iter().flat_map(|rings| rings.iter()).chain(outlines.zones.iter().flatten());
    let names = scene.structures.iter().map(|structure| &structure.name).chain(free.zones().iter().map(|zone| &zone.name));
    FieldCounts {
        samples,
        viewpoints,
        tiles: 0,
        patches: 0,
        structures: scene.structures.len(),
        rings: rings().count(),
        points: rings().map(Vec::len).sum(),
        name_bytes: names.map(String::len).sum(),
        zones: outlines.zones.len(),
        ground: free.terrain().map_or(0, |terrain| terrain.heights_m().len()),
    }
}

/// Writes the field's table into `blocks`, which are as many as `counts` says; the segments are written already.
pub fn write_table(inputs: &FieldInputs, counts: &FieldCounts, tiles: &[Tile], visibility: &Visibility, blocks: &mut [Block]) {
    let mut table = FieldTableMut::create(blocks, counts, inputs.facts);
    let viewpoints = std::mem::take(&mut table.viewpoints);
    // Most of a city's table are viewpoints.
    rayon::join(
        || write_viewpoints(tiles, viewpoints),
        || {
            write_scene(inputs, &mut table);
            write_samples(inputs, visibility, &mut table);
            write_tiles(tiles, visibility, &mut table);
        },
    );
}

fn write_samples(inputs: &FieldInputs, visibility: &Visibility, table: &mut FieldTableMut) {
    for (row, sample) in table.samples.iter_mut().zip(&inputs.samples.samples) {
        *row = SampleRow {
            position_m: sample.position.coords.into(),
            normal: sample.normal.into(),
            area_mm2: sample.area_mm2,
            structure: sample.structure,
            exposed: u32::from(sample.exposed),
        };
    }
    for (cells, union) in table.ceilings.iter_mut().zip(&visibility.unions) {
        *cells = union.count_ones() as u16;
    }
}

fn write_tiles(tiles: &[Tile], visibility: &Visibility, table: &mut FieldTableMut) {
    let mut first_patch = 0;
    let segments = visibility.segments.iter().zip(&visibility.patches);
    for ((row, tile), (segment, patches)) in table.tiles.iter_mut().zip(tiles).zip(segments) {
        table.patches[first_patch..][..patches.len()].copy_from_slice(patches);
        *row = TileRow {
            number: segment.memory().number(),
            first_patch: first_patch as u32,
            patches: patches.len() as u32,
            rows: tile.viewpoints() as u32,
            reserved: 0,
        };
        first_patch += patches.len();
    }
}

/// Strips of tiles side by side, in parallel: each has viewpoints that follow one another.
fn write_viewpoints(tiles: &[Tile], rows: &mut [ViewpointRow]) {
    let (mut strips, mut rest) = (Vec::new(), (0, rows));
    let mut number = 0;
    for tiles in tiles.chunk_by(|a, b| a.key[0] == b.key[0]) {
        let (first, rows) = rest;
        let count: usize = tiles.iter().map(Tile::viewpoints).sum();
        let (rows, after) = rows.split_at_mut(count);
        strips.push((number, tiles, first, rows));
        (number, rest) = (number + tiles.len() as u32, (first + count, after));
    }
    strips.into_par_iter().for_each(|(number, tiles, first, rows)| {
        for (number, tile) in (number..).zip(tiles) {
            for (row, (j, site)) in (0..).zip(tile.numbered()) {
                let Viewpoint { position, clearance_m } = site.viewpoint;
                rows[j as usize - first] = ViewpointRow { position_m: position.coords.into(), clearance_m, tile: number, row };
            }
        }
    });
}

/// Writes structures, zones and ground, with their outlines and names.
fn write_scene(inputs: &FieldInputs, table: &mut FieldTableMut) {
    let FieldTableMut { structures, zones, rings, points, names, ground_m, .. } = table;
    let mut drawn = Drawn { rings, points, names, ring: 0, point: 0, name_byte: 0 };
    let bounds = inputs.free.structure_bounds();
    for (index, (row, structure)) in structures.iter_mut().zip(&inputs.scene.structures).enumerate() {
        let samples = inputs.samples.range(index);
        let (rings, name) = drawn.add(&inputs.outlines.structures[index], &structure.name);
        *row = structure_row(structure, &bounds[index], [samples.start as u32, samples.len() as u32], rings, name);
    }
    for ((row, zone), outline) in zones.iter_mut().zip(inputs.free.zones()).zip(&inputs.outlines.zones) {
        let ([first_ring, rings], [first_name_byte, name_bytes]) = drawn.add(outline, &zone.name);
        let NoFlyZone { floor_m, ceiling_m, .. } = *zone;
        *row = ZoneRow { floor_m, ceiling_m, first_ring, rings, first_name_byte, name_bytes };
    }
    if let Some(terrain) = inputs.free.terrain() {
        ground_m.copy_from_slice(terrain.heights_m());
    }
}

/// The sections for outlines and names, with how far they are written.
struct Drawn<'t> {
    rings: &'t mut [RingRow],
    points: &'t mut [[f64; 2]],
    names: &'t mut [u8],
    ring: usize,
    point: usize,
    name_byte: usize,
}

impl Drawn<'_> {
    /// Writes an outline and a name; where both begin and how long they are.
    fn add(&mut self, outline: &[Vec<Coord>], name: &str) -> ([u32; 2], [u32; 2]) {
        let places = ([self.ring as u32, outline.len() as u32], [self.name_byte as u32, name.len() as u32]);
        for ring in outline {
            self.rings[self.ring] = RingRow { first_point: self.point as u32, points: ring.len() as u32 };
            for (point, &Coord { x, y }) in self.points[self.point..].iter_mut().zip(ring) {
                *point = [x, y];
            }
            (self.ring, self.point) = (self.ring + 1, self.point + ring.len());
        }
        self.names[self.name_byte..][..name.len()].copy_from_slice(name.as_bytes());
        self.name_byte += name.len();
        places
    }
}

fn rings(structure: &Structure) -> Vec<Vec<Coord>> {
    open_rings(&structure.outlines())
}

fn zone_rings(zone: &NoFlyZone) -> Vec<Vec<Coord>> {
    open_rings(&zone.outline.orient(Direction::Default))
}

/// Exteriors, each before its holes, without the repeated last corner.
fn open_rings(outlines: &MultiPolygon) -> Vec<Vec<Coord>> {
    let open = |ring: &LineString| ring.0[..ring.0.len().saturating_sub(1)].to_vec();
    outlines.iter().flat_map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()).map(open)).collect()
}

fn structure_row(
    structure: &Structure,
    bounds: &Bounds,
    [first_sample, samples]: [u32; 2],
    [first_ring, rings]: [u32; 2],
    [first_name_byte, name_bytes]: [u32; 2],
) -> StructureRow {
    StructureRow {
        id: structure.id.0,
        base_m: bounds.min.z,
        top_m: bounds.max.z,
        first_sample,
        samples,
        first_ring,
        rings,
        first_name_byte,
        name_bytes,
    }
}
