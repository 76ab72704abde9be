//! Tables as they are written, damaged and mixed up.

use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::rows::SegmentRows;

/// Two tiles of two viewpoints each over forty samples of one structure.
fn field() -> (Vec<Block>, Vec<Segment>) {
    let mut counts = FieldCounts { samples: 40, viewpoints: 4, tiles: 2, patches: 3, structures: 1, ..Default::default() };
    (counts.rings, counts.points, counts.name_bytes, counts.zones, counts.ground) = (1, 3, 5, 1, 6);
    let mut blocks = vec![Block::ZERO; counts.blocks()];
    let facts = FieldFacts { ground_corners: [3, 2], ground_cell_m: 10.0, ..Default::default() };
    let table = FieldTableMut::create(&mut blocks, &counts, facts);
    table.zones[0] = ZoneRow { rings: 1, first_name_byte: 2, name_bytes: 3, ..Default::default() };
    table.structures[0] = StructureRow { samples: 40, rings: 1, name_bytes: 5, ..Default::default() };
    table.rings[0] = RingRow { first_point: 0, points: 3 };
    table.names.copy_from_slice(b"tower");
    table.patches.copy_from_slice(&[0, 32, 32]);
    let tile = |first_patch, patches| TileRow { first_patch, patches, rows: 2, ..Default::default() };
    table.tiles.copy_from_slice(&[tile(0, 2), tile(2, 1)]);
    for (j, viewpoint) in (0..).zip(table.viewpoints) {
        (viewpoint.tile, viewpoint.row) = (j % 2, j / 2);
    }
    let segment = |rows: [&[(u32, u32)]; 2]| {
        let mut written = SegmentRows::default();
        for row in rows {
            row.iter().for_each(|&(patch, bits)| written.see(patch, bits));
            written.end_row();
        }
        let mut blocks = vec![Block::ZERO; written.blocks()];
        written.write(&mut blocks);
        Segment::open(Arc::new(blocks)).unwrap()
    };
    (blocks, vec![segment([&[(0, 0b101), (1, 1)], &[]]), segment([&[], &[(0, 0x81)]])])
}

#[test]
fn rows_are_found_by_tile_and_samples_by_patch() {
    let (blocks, segments) = field();
    let table = FieldTable::open(&blocks, &segments).unwrap();
    let seen = |j: usize| table.row(j).samples().collect::<Vec<_>>();
    assert_eq!([seen(0), seen(1), seen(2), seen(3)], [vec![0, 2, 32], vec![], vec![], vec![32, 39]]);
    assert_eq!(tiles(&blocks).unwrap(), table.tiles);
    assert_eq!([table.name(&table.structures[0]), table.zone_name(&table.zones[0])], ["tower", "wer"]);
    assert_eq!((table.zone_outline(&table.zones[0]).map(<[PointRow]>::len).sum::<usize>(), table.ground_m.len()), (3, 6));
}

#[test]
fn foreign_segments_are_refused() {
    let (blocks, segments) = field();
    assert_eq!(FieldTable::open(&blocks, &segments[..1]).unwrap_err(), LayoutError::Segments { found: 1, wanted: 2 });
    let mut short = SegmentRows::default();
    short.end_row();
    let mut other = vec![Block::ZERO; short.blocks()];
    short.write(&mut other);
    let mixed = [segments[0].clone(), Segment::open(Arc::new(other)).unwrap()];
    assert_eq!(FieldTable::open(&blocks, &mixed).unwrap_err(), LayoutError::Rows { index: 1, found: 1, wanted: 2 });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn a_damaged_table_is_refused_or_read_without_a_fault(
        damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), end: prop::sample::Index, is_cut in 0..8,
    ) {
        let (mut blocks, segments) = field();
        for (place, value) in &damage {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut blocks);
            let place = place.index(bytes.len());
            bytes[place] = *value;
        }
        if is_cut == 0 {
            blocks.truncate(end.index(blocks.len()) + 1);
        }
        let _ = tiles(&blocks);
        if let Ok(table) = FieldTable::open(&blocks, &segments) {
            for j in 0..table.viewpoints.len() {
                prop_assert!(table.row(j).samples().all(|i| i < table.samples.len()));
            }
            for structure in table.structures {
                let _ = (table.name(structure), table.outline(structure).map(<[PointRow]>::len).sum::<usize>());
            }
            for zone in table.zones {
                let _ = (table.zone_name(zone), table.zone_outline(zone).map(<[PointRow]>::len).sum::<usize>());
            }
        }
    }
}
