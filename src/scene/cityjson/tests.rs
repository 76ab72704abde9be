use serde_json::{Value, json};

use super::*;
use crate::settings::Settings;

pub(super) fn read_value(value: &Value) -> Result<(Scene, ImportReport), ImportError> {
    read("town.city.json", value.to_string().as_bytes(), &Settings::default().proxy, None)
}

/// Eight corners of a box, `first` its lowest index: the faces of its solid look outwards.
pub(super) fn shell(first: u32) -> Value {
    let faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    json!(faces.map(|face| [face.map(|index| index + first)]))
}

fn corners(x: f64, side: f64, z: f64, height: f64) -> Vec<[f64; 3]> {
    let ring = [[x, 0.0], [x + side, 0.0], [x + side, side], [x, side]];
    [z, z + height].iter().flat_map(|&z| ring.map(|[x, y]| [x, y, z])).collect()
}

pub(super) fn town() -> Value {
    json!({
        "type": "CityJSON", "version": "1.1",
        "transform": { "scale": [0.5, 0.5, 0.5], "translate": [90_000.0, 435_000.0, -1.0] },
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415" },
        "CityObjects": {
            "house": { "type": "Building", "children": ["house-0"], "geometry": [
                { "type": "Solid", "lod": "1.2", "boundaries": [shell(16)] },
                { "type": "MultiSurface", "lod": "0", "boundaries": [[[0, 1, 2, 3]]] },
            ] },
            "house-0": { "type": "BuildingPart", "parents": ["house"], "geometry": [
                { "type": "Solid", "lod": "1.3", "boundaries": [shell(16)] },
                { "type": "Solid", "lod": 2.2, "boundaries": [shell(0), shell(16)] },
            ] },
            "hall": { "type": "Building", "geometry": [{ "type": "CompositeSolid", "lod": 2, "boundaries": [[shell(8)]] }] },
            "road": { "type": "Road", "geometry": [{ "type": "MultiSurface", "lod": "1", "boundaries": [[[0, 1, 2, 3]]] }] },
        },
        "vertices": ([corners(0.0, 20.0, 0.0, 24.0), corners(60.0, 20.0, 0.0, 40.0), corners(0.0, 100.0, 0.0, 200.0)].concat()),
    })
}

#[test]
fn a_building_is_one_structure_at_its_highest_detail() {
    let (scene, report) = read_value(&town()).unwrap();
    let mut heights: Vec<_> = scene.structures.iter().map(|s| (s.name.as_str(), s.triangles().len(), s.bounds().max.z)).collect();
    heights.sort_by(|a, b| a.0.cmp(b.0));
    assert_eq!(heights, [("hall", 12, 20.0), ("house", 12, 12.0)]);
    assert_eq!(report.ignored["Road"], 1);
    assert_eq!(report.epsg, Some(7415));
    let origin = scene.frame.origin.unwrap();
    assert!((origin.lat_deg - 51.9).abs() < 0.02 && (origin.lon_deg - 4.43).abs() < 0.02, "{origin:?}");
    assert_eq!(origin.alt_m, -1.0);
    let bounds = scene.bounds().unwrap();
    assert_eq!(bounds.min.z, 0.0);
    assert!((bounds.min.x + bounds.max.x).abs() < 0.2, "the origin is the middle");
    assert!(scene.structures.iter().all(|s| s.contains(&nalgebra::center(&s.bounds().min, &s.bounds().max))));
}

#[test]
fn other_reference_systems_are_noted_or_refused() {
    let mut town = town();
    town["metadata"]["referenceSystem"] = json!("EPSG:99999");
    let (scene, report) = read_value(&town).unwrap();
    assert_eq!(scene.frame.origin, None);
    assert!(report.notes.iter().any(|note| note.contains("99999")), "{:?}", report.notes);
    town["metadata"] = json!({});
    assert_eq!(read_value(&town).unwrap().0.frame.origin, None);
    town["metadata"]["referenceSystem"] = json!("EPSG:4326");
    assert!(matches!(read_value(&town), Err(ImportError::Geographic { epsg: 4326, .. })));
}

#[test]
fn damaged_models_are_refused() {
    let mut broken = town();
    broken["CityObjects"]["hall"]["geometry"][0]["boundaries"] = json!([[[[[0, 1, 99]]]]]);
    let error = read_value(&broken).unwrap_err();
    assert!(error.to_string().contains("\"hall\"") && error.to_string().contains("99"), "{error}");
    broken["CityObjects"]["hall"]["geometry"][0]["boundaries"] = json!([[[[[0, 1, -1]]]]]);
    assert!(matches!(read_value(&broken), Err(ImportError::VertexIndex { .. })));
    broken["CityObjects"] = json!({});
    assert!(matches!(read_value(&broken), Err(ImportError::NoStructures { .. })));
    let mut absurd = town();
    absurd["transform"]["scale"] = json!([1e308, 1e308, 1e308]);
    absurd["transform"]["translate"] = json!([1e308, 1e308, 1e308]);
    assert!(read_value(&absurd).is_err());
}

#[test]
fn a_level_of_detail_can_be_chosen() {
    let tops = |lod: f64| {
        let proxy = ProxySettings { lod, ..Settings::default().proxy };
        let (scene, _) = read("town.city.json", town().to_string().as_bytes(), &proxy, None).unwrap();
        ["hall", "house"].map(|name| scene.structure(scene.find(name).unwrap()).unwrap().bounds().max.z)
    };
    assert_eq!(tops(0.0), [20.0, 12.0]);
    assert_eq!(tops(2.2), [20.0, 12.0]);
    // The hall has nothing coarser.
    assert_eq!(tops(1.3), [20.0, 100.0]);
}

#[test]
fn a_reference_system_can_be_given() {
    let mut town = town();
    town["metadata"] = json!({});
    let mut proxy = ProxySettings { epsg: 7415, ..Settings::default().proxy };
    let read_with = |proxy: &ProxySettings| read("town.city.json", town.to_string().as_bytes(), proxy, None);
    assert!(read_with(&proxy).unwrap().0.frame.origin.is_some());
    proxy.epsg = 99_999;
    assert!(matches!(read_with(&proxy), Err(ImportError::UnknownGrid { epsg: 99_999, .. })));
}

#[test]
fn parents_in_a_circle_end() {
    let mut town = town();
    town["CityObjects"]["house"]["parents"] = json!(["house-0", "nobody"]);
    assert_eq!(read_value(&town).unwrap().0.structures.len(), 2);
}

#[test]
fn a_part_far_away_and_flat_ground_are_left_out() {
    let mut town = town();
    let vertices = town["vertices"].as_array_mut().unwrap();
    vertices.extend(corners(1e6, 20.0, 0.0, 24.0).into_iter().map(|corner| json!(corner)));
    vertices.extend(corners(100.0, 20.0, 0.0, 0.4).into_iter().map(|corner| json!(corner)));
    town["CityObjects"]["far"] =
        json!({ "type": "Building", "geometry": [{ "type": "Solid", "lod": 1, "boundaries": [shell(24)] }] });
    town["CityObjects"]["slab"] =
        json!({ "type": "Bridge", "geometry": [{ "type": "Solid", "lod": 1, "boundaries": [shell(32)] }] });
    let (scene, report) = read_value(&town).unwrap();
    assert_eq!(scene.structures.len(), 2);
    assert_eq!((report.count(ItemKind::Outlier), report.count(ItemKind::NoGeometry)), (1, 1));
}
