//! Point clouds.

use std::io::Cursor;

use laz::{LazVlr, LazVlrBuilder};

/// GeoKeys of EPSG:25830.
const UTM: [u16; 16] = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25830];

/// Points of format 1 over 60 x 60 m: ground, a house of 20 x 20 m and 8 m, a tree of 4 x 4 m beside it, a bird and noise. `classes` are those of ground,
/// house and tree.
pub fn points([of_ground, of_house, of_tree]: [u8; 3]) -> Vec<[u8; 28]> {
    let mut points = Vec::new();
    let mut add = |x: f64, y: f64, z: f64, class: u8| {
        let mut point = [0u8; 28];
        for (axis, value) in [x, y, z].into_iter().enumerate() {
            point[4 * axis..4 * axis + 4].copy_from_slice(&((value * 1000.0).round() as i32).to_le_bytes());
        }
        (point[14], point[15]) = (0x11, class);
        points.push(point);
    };
    for k in 0..14_400 {
        let (x, y) = (f64::from(k % 120) * 0.5 + 0.2, f64::from(k / 120) * 0.5 + 0.2);
        let is_house = (10.0..30.0).contains(&x) && (20.0..40.0).contains(&y);
        let is_tree = (45.0..49.0).contains(&x) && (20.0..24.0).contains(&y);
        let (z, class) = if is_house {
            (13.0, of_house)
        } else if is_tree {
            (12.0, of_tree)
        } else {
            (5.0, of_ground)
        };
        add(x, y, z, class);
    }
    add(55.0, 55.0, 90.0, 1);
    add(20.0, 5.0, -400.0, 7);
    add(59.9, 59.9, 200.0, 18);
    points
}

pub fn las(points: &[[u8; 28]], is_packed: bool) -> Vec<u8> {
    let vlr = is_packed.then(|| LazVlrBuilder::default().with_point_format(1, 0).unwrap().build());
    file(1, points, vlr)
}

/// The same points in format 6, packed in layers, so many in each chunk.
pub fn layered(points: &[[u8; 28]], in_chunk: u32) -> Vec<u8> {
    let vlr = LazVlrBuilder::default().with_point_format(6, 0).unwrap().with_fixed_chunk_size(in_chunk).build();
    let wide = |point: &[u8; 28]| {
        let mut wide = [0u8; 30];
        wide[..14].copy_from_slice(&point[..14]);
        (wide[14], wide[16]) = (0x11, point[15]);
        wide
    };
    file(6, &points.iter().map(wide).collect::<Vec<_>>(), Some(vlr))
}

fn file<const SIZE: usize>(format: u8, points: &[[u8; SIZE]], vlr: Option<LazVlr>) -> Vec<u8> {
    let keys: Vec<u8> = UTM.iter().flat_map(|key| key.to_le_bytes()).collect();
    let record = |user: &[u8], id: u16, data: &[u8]| {
        let mut record = vec![0; 54];
        record[2..2 + user.len()].copy_from_slice(user);
        record[18..20].copy_from_slice(&id.to_le_bytes());
        record[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        record.extend_from_slice(data);
        record
    };
    let mut records = record(b"LASF_Projection", 34735, &keys);
    if let Some(vlr) = &vlr {
        let mut data = Cursor::new(Vec::new());
        vlr.write_to(&mut data).unwrap();
        records.extend(record(b"laszip encoded", 22204, data.get_ref()));
    }
    let (minor, header_bytes) = if format < 6 { (2, 227) } else { (4, 375) };
    let mut bytes = vec![0; header_bytes];
    bytes[..4].copy_from_slice(b"LASF");
    (bytes[24], bytes[25], bytes[104]) = (1, minor, format | if vlr.is_some() { 0x80 } else { 0 });
    bytes[94..96].copy_from_slice(&(header_bytes as u16).to_le_bytes());
    bytes[96..100].copy_from_slice(&((header_bytes + records.len()) as u32).to_le_bytes());
    bytes[100..104].copy_from_slice(&(1 + u32::from(vlr.is_some())).to_le_bytes());
    bytes[105..107].copy_from_slice(&(SIZE as u16).to_le_bytes());
    if format < 6 {
        bytes[107..111].copy_from_slice(&(points.len() as u32).to_le_bytes());
    } else {
        bytes[247..255].copy_from_slice(&(points.len() as u64).to_le_bytes());
    }
    let numbers =
        [0.001, 0.001, 0.001, 499_400.0, 4_797_200.0, 0.0, 499_460.0, 499_400.0, 4_797_260.0, 4_797_200.0, 90.0, -400.0];
    for (index, number) in numbers.into_iter().enumerate() {
        bytes[131 + 8 * index..139 + 8 * index].copy_from_slice(&f64::to_le_bytes(number));
    }
    bytes.extend(records);
    match vlr {
        Some(vlr) => {
            let mut packed = Cursor::new(Vec::new());
            let mut compressor = laz::LasZipCompressor::new(&mut packed, vlr).unwrap();
            compressor.compress_many(&points.concat()).unwrap();
            compressor.done().unwrap();
            drop(compressor);
            // The packer counts from where the points begin.
            let mut packed = packed.into_inner();
            let table = i64::from_le_bytes(packed[..8].try_into().unwrap()) + bytes.len() as i64;
            packed[..8].copy_from_slice(&table.to_le_bytes());
            bytes.extend(packed);
        }
        None => bytes.extend(points.concat()),
    }
    bytes
}
