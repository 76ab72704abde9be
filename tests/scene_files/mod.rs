//! Small scene files of the formats that are not text to be typed: a tetrahedron 20 m high, or a building of 20 m by 20 m.
#![allow(dead_code, reason = "each test uses what it needs")]

pub mod las;

use std::io::Cursor;

use serde_json::json;
use tiff::encoder::{TiffEncoder, colortype::Gray32Float};
use tiff::tags::Tag;

const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 20.0]];
const FACES: [[u8; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

fn corner_bytes() -> impl Iterator<Item = u8> {
    CORNERS.into_iter().flatten().flat_map(f32::to_le_bytes)
}

pub fn ply() -> Vec<u8> {
    let mut bytes =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 4\nproperty list uchar uchar vertex_indices\nend_header\n"
            .to_vec();
    bytes.extend(corner_bytes());
    FACES.iter().for_each(|face| bytes.extend([3, face[0], face[1], face[2]]));
    bytes
}

pub fn stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((FACES.len() as u32).to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        face.iter().flat_map(|&corner| CORNERS[usize::from(corner)]).for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

pub fn glb() -> Vec<u8> {
    let mut binary: Vec<u8> = corner_bytes().chain(FACES.into_iter().flatten()).collect();
    let head = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "tower", "mesh": 0, "children": [1] }, { "name": "hall", "mesh": 0, "translation": [100, 0, 0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4, "min": [0, 0, 0], "max": [20, 20, 20] },
            { "bufferView": 1, "componentType": 5121, "type": "SCALAR", "count": 12 },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 12 }],
        "buffers": [{ "byteLength": binary.len() }],
    });
    let mut head = head.to_string().into_bytes();
    head.resize(head.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut bytes = b"glTF".to_vec();
    let word = |bytes: &mut Vec<u8>, value: usize| bytes.extend((value as u32).to_le_bytes());
    word(&mut bytes, 2);
    word(&mut bytes, 12 + 8 + head.len() + 8 + binary.len());
    for (kind, chunk) in [(b"JSON", &head), (b"BIN\0", &binary)] {
        word(&mut bytes, chunk.len());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

pub fn sequence() -> Vec<u8> {
    let feature = |id: &str, x: i32| {
        json!({ "type": "CityJSONFeature", "id": id, "CityObjects": { id: { "type": "Building", "geometry": [
            { "type": "Solid", "lod": "2.2", "boundaries": [[[[0, 2, 1]], [[0, 1, 3]], [[1, 2, 3]], [[2, 0, 3]]]] }] } },
            "vertices": [[x, 0, 0], [x + 2000, 0, 0], [x, 2000, 0], [x + 300, 300, 2000]] })
    };
    let head = json!({ "type": "CityJSON", "version": "2.0", "CityObjects": {}, "vertices": [],
        "transform": { "scale": [0.01, 0.01, 0.01], "translate": [90000, 435000, 0] },
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/28992" } });
    [head, feature("a", 0), feature("b", 5000)].iter().map(|line| format!("{line}\n")).collect::<String>().into_bytes()
}

/// A raster of `side` cells of 1 m each way, with heights by column and row, in EPSG:28992.
pub fn raster(side: u32, height: impl Fn(u32, u32) -> f32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = TiffEncoder::new(Cursor::new(&mut bytes)).expect("it can be written");
    let mut image = encoder.new_image::<Gray32Float>(side, side).expect("it can be written");
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[1.0, 1.0, 0.0][..]).expect("it can be written");
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, 84_800.0, 447_600.0, 0.0][..]).expect("it can be written");
    tags.write_tag(Tag::GeoKeyDirectoryTag, &[1u16, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 28992][..]).expect("it can be written");
    let values: Vec<f32> = (0..side * side).map(|k| height(k % side, k / side)).collect();
    image.write_data(&values).expect("it can be written");
    bytes
}

/// An OpenStreetMap extract with two buildings: a way of 20 m height, and a multipolygon of two ways around a court.
pub fn extract() -> Vec<u8> {
    const STRINGS: [&str; 9] = ["", "building", "yes", "height", "20", "type", "multipolygon", "outer", "inner"];
    // In units of 100 nanodegrees, as the format has them by itself.
    let d = 3000;
    let square = |x: i64, side: i64, y: i64| [[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
    let places: Vec<[i64; 2]> = [square(0, d, 0), square(2 * d, d, 0), square(2 * d + d / 3, d / 3, d / 3)].concat();
    let [lons, lats] =
        [0, 1].map(|axis| places.iter().map(|place| place[axis] + [44_000_000, 519_000_000][axis]).collect::<Vec<i64>>());
    let ids: Vec<i64> = (1..=12).collect();
    let dense = [field(1, &deltas(&ids)), field(8, &deltas(&lats)), field(9, &deltas(&lons))].concat();
    let way = |id: u64, tags: &[[u64; 2]], nodes: &[i64]| {
        let [keys, values] = [0, 1].map(|k| tags.iter().flat_map(|tag| varint(tag[k])).collect::<Vec<u8>>());
        field(3, &[number(1, id), field(2, &keys), field(3, &values), field(8, &deltas(nodes))].concat())
    };
    let ways = [
        way(1, &[[1, 2], [3, 4]], &[1, 2, 3, 4, 1]),
        way(2, &[], &[5, 6, 7]),
        way(3, &[], &[5, 8, 7]),
        way(4, &[], &[9, 10, 11, 12, 9]),
    ]
    .concat();
    let tags: [Vec<u8>; 2] = [[1, 3, 5], [2, 4, 6]].map(|strings| strings.into_iter().flat_map(varint).collect());
    let roles: Vec<u8> = [7, 7, 8].into_iter().flat_map(varint).collect();
    let relation = [
        number(1, 1),
        field(2, &tags[0]),
        field(3, &tags[1]),
        field(8, &roles),
        field(9, &deltas(&[2, 3, 4])),
        field(10, &[1, 1, 1]),
    ];
    let strings: Vec<u8> = STRINGS.iter().flat_map(|string| field(1, string.as_bytes())).collect();
    let groups = [field(2, &field(2, &dense)), field(2, &ways), field(2, &field(4, &relation.concat()))].concat();
    let header = [field(4, b"OsmSchema-V0.6"), field(4, b"DenseNodes")].concat();
    [block("OSMHeader", &header), block("OSMData", &[field(1, &strings), groups].concat())].concat()
}

fn block(kind: &str, content: &[u8]) -> Vec<u8> {
    let blob = field(1, content);
    let header = [field(1, kind.as_bytes()), number(3, blob.len() as u64)].concat();
    [&(header.len() as u32).to_be_bytes()[..], &header, &blob].concat()
}

/// A field of Protocol Buffers that has a length.
fn field(key: u64, content: &[u8]) -> Vec<u8> {
    [varint(key << 3 | 2), varint(content.len() as u64), content.to_vec()].concat()
}

fn number(key: u64, value: u64) -> Vec<u8> {
    [varint(key << 3), varint(value)].concat()
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value > 0x7f {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

/// Each number less the one before, the sign in the lowest bit.
fn deltas(numbers: &[i64]) -> Vec<u8> {
    let before = std::iter::once(&0).chain(numbers);
    numbers
        .iter()
        .zip(before)
        .map(|(number, before)| number - before)
        .flat_map(|delta| varint(((delta << 1) ^ (delta >> 63)) as u64))
        .collect()
}
