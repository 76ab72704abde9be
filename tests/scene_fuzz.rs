//! Each reader is given damaged files for a while: it neither panics nor takes memory without end, and what it accepts is sound.
//!
//! `OVERFLY_FUZZ_S` says for how many seconds each reader is given some; without it for one. Files come from a fixed seed, so that longer runs go on where
//! shorter ones end.

mod scene_files;

use std::time::{Duration, Instant};

use overfly::scene::{BlockSettings, generate_block, read, to_geojson};
use overfly::settings::Settings;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Numbers that are often wrong.
const WORDS: [&[u8]; 8] = [b"4294967295", b"-1", b"1e308", b"NaN", &[0xff; 4], &[0; 8], &[0xff, 0xff, 0xff, 0x7f], b"[[[[[[[["];

fn seconds() -> f64 {
    std::env::var("OVERFLY_FUZZ_S").ok().and_then(|text| text.parse().ok()).unwrap_or(1.0)
}

/// Damages a sound file again and again and reads it.
fn fuzz(name: &str, sound: &[u8]) {
    let proxy = &Settings::default().proxy;
    read(name, sound, proxy).unwrap_or_else(|error| panic!("{error}"));
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let end = Instant::now() + Duration::from_secs_f64(seconds());
    let (mut files, mut scenes) = (0u64, 0u64);
    while Instant::now() < end {
        let mut bytes = sound.to_vec();
        for _ in 0..=random.next_u32() % 4 {
            damage(&mut bytes, &mut random);
        }
        files += 1;
        if let Ok((scene, report)) = read(name, &bytes, proxy) {
            scenes += 1;
            assert!(!scene.structures.is_empty() && !report.summary().is_empty());
            let corners = scene.structures.iter().flat_map(|structure| structure.triangles()).flatten();
            assert!(corners.flat_map(|corner| [corner.x, corner.y, corner.z]).all(f64::is_finite));
        }
    }
    println!("{name}: {files} files, {scenes} of them scenes");
    assert!(files > 0);
}

fn damage(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let mut below = |most: usize| random.next_u64() as usize % most.max(1);
    let at = below(bytes.len());
    match below(6) {
        0 => bytes.truncate(at),
        1 if !bytes.is_empty() => bytes[at] ^= 1 << below(8),
        2 if !bytes.is_empty() => bytes[at] = below(256) as u8,
        3 => {
            let word = WORDS[below(WORDS.len())];
            let end = (at + word.len()).min(bytes.len());
            bytes.splice(at..end, word.iter().copied());
        }
        4 => {
            let end = (at + below(64)).min(bytes.len());
            bytes.drain(at..end);
        }
        _ => {
            let end = (at + below(64)).min(bytes.len());
            let again = bytes[at..end].to_vec();
            let to = below(bytes.len() + 1);
            bytes.splice(to..to, again);
        }
    }
}

#[test]
fn geojson() {
    let settings = BlockSettings { buildings: 4, extent_m: [90.0, 90.0], ..Default::default() };
    fuzz("a.geojson", to_geojson(&generate_block(&settings)).as_bytes());
}

#[test]
fn cityjson() {
    let sequence = scene_files::sequence();
    let whole = String::from_utf8(sequence).unwrap();
    let feature = whole.lines().nth(1).unwrap();
    let head = whole.lines().next().unwrap();
    // The same building in a file of its own.
    let mut city: serde_json::Value = serde_json::from_str(head).unwrap();
    let feature: serde_json::Value = serde_json::from_str(feature).unwrap();
    (city["CityObjects"], city["vertices"]) = (feature["CityObjects"].clone(), feature["vertices"].clone());
    fuzz("a.city.json", city.to_string().as_bytes());
}

#[test]
fn cityjson_sequence() {
    fuzz("a.city.jsonl", &scene_files::sequence());
}

#[test]
fn obj() {
    fuzz("a.obj", b"o a\nv 0 0 0\nv 10 0 0\nv 0 10 0\nv 3 3 9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\ng b\nf -1/2/3 -2//1 -3\n");
}

#[test]
fn ply() {
    fuzz("a.ply", &scene_files::ply());
}

#[test]
fn stl() {
    fuzz("a.stl", &scene_files::stl());
}

#[test]
fn gltf() {
    fuzz("a.glb", &scene_files::glb());
}

#[test]
fn osm_pbf() {
    fuzz("a.osm.pbf", &scene_files::extract());
}

/// A house of 10 by 10 m on level ground.
#[test]
fn geotiff() {
    let is_house = |k: u32| (12..22).contains(&k);
    fuzz("a.tif", &scene_files::raster(32, |column, row| if is_house(column) && is_house(row) { 14.0 } else { 4.0 }));
}

#[test]
fn las() {
    fuzz("a.las", &scene_files::las::las(&scene_files::las::points([2, 6, 5]), false));
}

#[test]
fn laz() {
    fuzz("a.laz", &scene_files::las::las(&scene_files::las::points([2, 6, 5]), true));
}

#[test]
fn layered_laz() {
    fuzz("a.laz", &scene_files::las::layered(&scene_files::las::points([2, 6, 5]), 5000));
}

/// A packed cloud that can be given wrong sizes.
struct Packed(Vec<u8>);

impl Packed {
    fn set(&mut self, at: usize, value: &[u8]) {
        self.0[at..at + value.len()].copy_from_slice(value);
    }

    fn start(&self) -> usize {
        u32::from_le_bytes(self.0[96..100].try_into().unwrap()) as usize
    }

    fn table(&self) -> usize {
        u64::from_le_bytes(self.0[self.start()..][..8].try_into().unwrap()) as usize
    }

    /// Where it stands how the points are packed.
    fn packing(&self) -> usize {
        let user = b"laszip encoded";
        self.0.windows(user.len()).position(|part| part == user).unwrap() + 52
    }

    /// A second chunk with layers of 4 GiB where the first one ends.
    fn with_huge_layers(mut self) -> Self {
        let (start, table) = (self.start(), self.table());
        self.0.splice(table..table, [[0; 34].as_slice(), &[0xff; 36]].concat());
        self.set(start, &(table as u64 + 70).to_le_bytes());
        self
    }
}

#[test]
fn sizes_that_no_packed_cloud_can_have_take_no_memory() {
    let points = scene_files::las::points([2, 6, 5]);
    let plain = || Packed(scene_files::las::las(&points, true));
    let layered = || Packed(scene_files::las::layered(&points, 50_000));
    let larger = "a part is larger than the file";
    let many_chunks = |chunks: u32| {
        let mut cloud = plain();
        let table = cloud.table();
        cloud.set(table + 4, &chunks.to_le_bytes());
        cloud
    };
    // The table's place stands at the end.
    let mut at_the_end = many_chunks(u32::MAX - 15);
    let (start, table) = (at_the_end.start(), at_the_end.table());
    at_the_end.0.extend((table as u64).to_le_bytes());
    at_the_end.set(start, &(-1i64).to_le_bytes());
    let length = plain().0.len() as u32;
    // The number that a chunk gives of its points is not the one that counts.
    let mut chunks_of_one = layered().with_huge_layers();
    let packing = chunks_of_one.packing();
    chunks_of_one.set(packing + 12, &1u32.to_le_bytes());
    let mut marked_as_plain = layered().with_huge_layers();
    marked_as_plain.set(packing, &2u16.to_le_bytes());
    let mut of_another_size = layered();
    of_another_size.set(packing + 36, &29u16.to_le_bytes());
    let mut without_end = layered();
    without_end.set(247, &(1u64 << 40).to_le_bytes());
    let mut without_table = plain();
    without_table.set(start, &0u64.to_le_bytes());
    without_table.0.extend([0; 8]);
    for (case, cloud, expected) in [
        ("table at the end", at_the_end, larger),
        ("as many chunks as bytes", many_chunks(length), larger),
        ("chunks of one point", chunks_of_one, larger),
        ("layers that are not marked", marked_as_plain, "in another way than their parts"),
        ("parts of another size", of_another_size, "of another one than such parts have"),
        ("more points than fit", without_end, "do not fit into"),
        ("no table", without_table, "there is no table"),
    ] {
        let refused = read("a.laz", &cloud.0, &Settings::default().proxy).map(|_| ());
        let told = refused.expect_err(case).to_string();
        assert!(told.contains(expected), "{case}: {told}");
    }
}
