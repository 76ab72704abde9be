//! No bytes whatever make the reader panic; what it accepts is sound.

mod scene_files;

use overfly::scene::{BlockSettings, ImportError, generate_block, read, to_geojson};
use overfly::settings::{ProxySettings, Settings};
use proptest::prelude::*;

fn settings() -> ProxySettings {
    Settings::default().proxy
}

fn small_block() -> Vec<u8> {
    let settings = BlockSettings { buildings: 4, extent_m: [90.0, 90.0], ..Default::default() };
    to_geojson(&generate_block(&settings)).into_bytes()
}

const CITY: &str = r#"{"type":"CityJSON","version":"2.0","transform":{"scale":[0.01,0.01,0.01],"translate":[90000,435000,0]},
"metadata":{"referenceSystem":"https://www.opengis.net/def/crs/EPSG/0/28992"},"CityObjects":{
"a":{"type":"Building","children":["b"],"geometry":[]},
"b":{"type":"BuildingPart","parents":["a"],"geometry":[{"type":"Solid","lod":"2.2","boundaries":[[[[0,2,1]],[[0,1,3]],[[1,2,3]],[[2,0,3]]]]}]}},
"vertices":[[0,0,0],[1000,0,0],[0,1000,0],[300,300,900]]}"#;

const OBJ: &str = "o a\nv 0 0 0\nv 10 0 0\nv 0 10 0\nv 3 3 9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\ng b\nf -1/2/3 -2//1 -3\n";

/// The first ones are text.
const SEEDS: usize = 8;
const TEXTS: usize = 4;

fn seeds() -> [(&'static str, Vec<u8>); SEEDS] {
    [
        ("a.geojson", small_block()),
        ("a.city.json", CITY.into()),
        ("a.obj", OBJ.into()),
        ("a.city.jsonl", scene_files::sequence()),
        ("a.ply", scene_files::ply()),
        ("a.stl", scene_files::stl()),
        ("a.glb", scene_files::glb()),
        ("a.osm.pbf", scene_files::extract()),
    ]
}

/// Reads and, when there is a scene, uses all of it.
fn digest(name: &str, bytes: &[u8]) -> Result<(), TestCaseError> {
    match read(name, bytes, &settings()) {
        Err(error) => prop_assert!(error.to_string().starts_with(name)),
        Ok((scene, report)) => {
            prop_assert!(!scene.structures.is_empty());
            prop_assert!(scene.structures.is_sorted_by(|a, b| a.id < b.id));
            for structure in &scene.structures {
                let bounds = structure.bounds();
                prop_assert!(structure.triangles().iter().flatten().all(|corner| corner.iter().all(|metres| metres.is_finite())));
                prop_assert!(bounds.min.x <= bounds.max.x && bounds.max.z > 0.0);
                prop_assert!(!structure.outlines().0.is_empty());
                structure.contains(&nalgebra::center(&bounds.min, &bounds.max));
            }
            prop_assert!(!report.summary().is_empty());
            prop_assert!(serde_json::to_string(&report).is_ok());
            to_geojson(&scene);
        }
    }
    Ok(())
}

#[test]
fn the_seeds_themselves_are_scenes() {
    for (name, bytes) in seeds() {
        read(name, &bytes, &settings()).unwrap_or_else(|error| panic!("{error}"));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn random_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400), ending in "geojson|json|obj|tif|stl|ply|glb|pbf|") {
        digest(&format!("a.{ending}"), &bytes)?;
    }

    #[test]
    fn flipped_bytes(seed in 0..SEEDS, flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let (name, mut bytes) = seeds()[seed].clone();
        for (at, byte) in flips {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        digest(name, &bytes)?;
    }

    /// Digits are where the meaning is: indices, coordinates, heights, levels.
    #[test]
    fn changed_numbers(seed in 0..TEXTS, changes in prop::collection::vec((any::<prop::sample::Index>(), "[-0-9.e,]{1,4}"), 1..6)) {
        let (name, bytes) = seeds()[seed].clone();
        let mut text = String::from_utf8(bytes).unwrap();
        for (at, number) in changes {
            let digits: Vec<usize> = text.char_indices().filter(|(_, c)| c.is_ascii_digit()).map(|(index, _)| index).collect();
            let at = digits[at.index(digits.len())];
            text.replace_range(at..at + 1, &number);
        }
        digest(name, text.as_bytes())?;
    }

    #[test]
    fn truncated(seed in 0..SEEDS, at in any::<prop::sample::Index>()) {
        let (name, bytes) = seeds()[seed].clone();
        digest(name, &bytes[..at.index(bytes.len())])?;
    }

    #[test]
    fn any_coordinates(rings in prop::collection::vec(prop::collection::vec((-180.5..180.5f64, -90.5..90.5f64), 0..7), 1..4), height in any::<f64>()) {
        let near: Vec<Vec<[f64; 2]>> = rings.iter().map(|ring| ring.iter().map(|(lon, lat)| [4.0 + lon * 1e-5, 52.0 + lat * 1e-5]).collect()).collect();
        for coordinates in [serde_json::json!(rings), serde_json::json!(near)] {
            let text = serde_json::json!({ "type": "Feature", "properties": { "height": height }, "geometry": { "type": "Polygon", "coordinates": coordinates } });
            digest("a.geojson", text.to_string().as_bytes())?;
        }
    }
}

#[test]
fn a_truncated_file_says_where() {
    let bytes = small_block();
    let error = read("block.geojson", &bytes[..bytes.len() / 2], &settings()).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, ImportError::Json { .. }) && text.contains("line 1, column"), "{text}");
}

#[test]
fn deep_nesting_is_an_error() {
    for open in ["[", "{\"a\":", "{\"type\":\"FeatureCollection\",\"features\":[{\"geometry\":"] {
        let text = open.repeat(100_000);
        assert!(matches!(read("deep.json", text.as_bytes(), &settings()), Err(ImportError::Json { .. })));
    }
    let nested = "{\"type\":\"GeometryCollection\",\"geometries\":[".repeat(5_000);
    assert!(read("deep.json", nested.as_bytes(), &settings()).is_err());
}

/// A file whose ending and content disagree is what its content says.
#[test]
fn the_content_tells_the_format() {
    for (_, bytes) in seeds() {
        for name in ["a.geojson", "a.obj", "a.stl", "a"] {
            read(name, &bytes, &settings()).unwrap_or_else(|error| panic!("{error}"));
        }
    }
}

#[test]
fn foreign_formats_are_called_by_their_name() {
    for (bytes, name) in [
        (&b"<?xml version='1.0'?>"[..], "XML"),
        (b"PK\x03\x04....", "zip"),
        (b"hello", "no format that is known"),
        (b"[1, 2]", "JSON list"),
        (b"{\"type\":\"CityJSONFeature\"}\n{\"type\":\"CityJSONFeature\"}", "sequence"),
        (b"{\"type\":\"Feature\"}\n{\"type\":\"Feature\"}", "sequence"),
    ] {
        let error = read("thing", bytes, &settings()).unwrap_err();
        assert!(matches!(error, ImportError::UnknownFormat { .. }) && error.to_string().contains(name), "{error}");
    }
    for bytes in [&b""[..], b" \n\t", b"\xef\xbb\xbf"] {
        assert!(matches!(read("thing.json", bytes, &settings()), Err(ImportError::EmptyFile { .. })));
    }
}
