//! The sizes that packed points give for tables and layers, checked before the unpacking library takes memory for them: by the numbers that it goes by.

use laz::laszip::{ChunkTable, LazItem, LazItemType};

use super::{Bytes, Header, Packing, least_bytes};

/// No packing brings so many points into a byte of the file.
const MOST_POINTS_A_BYTE: u64 = 64;

/// The size of a point, of packed points whose sizes can be those of this file.
pub(super) fn check(bytes: &mut Bytes, header: &Header, packing: &Packing) -> Result<usize, String> {
    let items = packing.laz.items();
    if items.iter().any(|item| item.size() == 0 || item.size() != bytes_of(item)) {
        return Err("the packed points have parts without a size, or of another one than such parts have".into());
    }
    let size: usize = items.iter().map(|item| usize::from(item.size())).sum();
    if size < least_bytes(header.format) || size > header.record_bytes {
        return Err("the packed points have another size than the header says".into());
    }
    if items.iter().any(|item| (item.version() >= 3) != packing.is_layered) {
        return Err("the packed points are marked as packed in another way than their parts".into());
    }
    if header.points > MOST_POINTS_A_BYTE.saturating_mul(bytes.length) {
        return Err(format!("it is cut off: {} points do not fit into {} bytes", header.points, bytes.length));
    }
    if packing.is_chunked {
        let table = table(bytes, header, packing, size)?;
        if packing.is_layered {
            check_layers(bytes, header, packing, &table, size)?;
        }
    }
    Ok(size)
}

/// What a part of a point takes in each point.
fn bytes_of(item: &LazItem) -> u16 {
    match item.item_type() {
        LazItemType::Byte(count) | LazItemType::Byte14(count) => count,
        LazItemType::Point10 => 20,
        LazItemType::GpsTime | LazItemType::RGBNIR14 => 8,
        LazItemType::RGB12 | LazItemType::RGB14 => 6,
        LazItemType::WavePacket13 | LazItemType::WavePacket14 => 29,
        LazItemType::Point14 => 30,
    }
}

fn absurd() -> String {
    "the packed points are damaged or cut off: a part is larger than the file".to_owned()
}

/// The table of the chunks. Without one that can be read nothing is unpacked.
fn table(bytes: &mut Bytes, header: &Header, packing: &Packing, size: usize) -> Result<ChunkTable, String> {
    let none = || "its points cannot be unpacked: there is no table of where they are".to_owned();
    let start = header.start as i64;
    // A writer that could not go back to the beginning has written at the end where it is.
    let places = [Some(header.start), bytes.length.checked_sub(8)];
    let place = places.into_iter().flatten().filter_map(|at| bytes.offset(at)).find(|&place| place > start);
    let place = place.ok_or_else(none)? as u64;
    let chunks = bytes.whole(place.saturating_add(4)).ok_or_else(none)?;
    // Each chunk begins with a point as it is.
    if u64::from(chunks).saturating_mul(size as u64) > bytes.length {
        return Err(absurd());
    }
    let source = bytes.from(header.start).map_err(|error| error.to_string())?;
    ChunkTable::read_from(source, &packing.laz).map_err(|error| format!("its points cannot be unpacked ({error})"))
}

fn check_layers(bytes: &mut Bytes, header: &Header, packing: &Packing, table: &ChunkTable, size: usize) -> Result<(), String> {
    let layers = |item: &LazItem| match item.item_type() {
        LazItemType::Point14 => 9,
        LazItemType::RGB14 | LazItemType::WavePacket14 => 1,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => usize::from(count),
        _ => 0,
    };
    let layers: usize = packing.laz.items().iter().map(layers).sum();
    let fixed = (!packing.laz.uses_variable_size_chunks()).then(|| u64::from(packing.laz.chunk_size()));
    let mut counts = table.as_ref().iter().map(|chunk| chunk.point_count);
    let (mut at, mut left) = (header.start + 8, header.points);
    while left > 0 {
        // The first point as it is, a number of points that nobody goes by, the sizes of the layers, the layers.
        let sizes = at + size as u64 + 4;
        let of_layers = bytes.at(sizes, 4 * layers).ok_or_else(absurd)?;
        let of_layers = of_layers.chunks_exact(4).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        let end = sizes + 4 * layers as u64 + of_layers.sum::<u64>();
        let count = fixed.or_else(|| counts.next()).filter(|&count| count > 0);
        let count = count.filter(|_| end <= bytes.length).ok_or_else(absurd)?;
        (at, left) = (end, left.saturating_sub(count));
    }
    Ok(())
}
