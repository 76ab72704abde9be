//! Real scenes of every format are read, and each of the injected defects is survived and reported.

use std::path::PathBuf;
use std::time::Instant;

use geo::InteriorPoint;
use nalgebra::Point3;
use overfly::scene::report::Format;
use overfly::scene::{ImportReport, ItemKind, Place, ReportItem, Scene, Shape, read};
use overfly::settings::{MissingHeights, ProxySettings, Settings};

fn settings() -> ProxySettings {
    Settings::default().proxy
}

/// The bytes of a real scene, or `None` (said aloud) where the folder of scenes is not there.
fn scene_file(path: &str) -> Option<Vec<u8>> {
    let folder = std::env::var_os("OVERFLY_SCENES")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes"), PathBuf::from);
    let bytes = std::fs::read(folder.join(path)).ok();
    if bytes.is_none() {
        println!("skipped: no {path} in {} (set OVERFLY_SCENES)", folder.display());
    }
    bytes
}

fn import(path: &str) -> Option<(Scene, ImportReport)> {
    let bytes = scene_file(path)?;
    let started = Instant::now();
    let (scene, report) = read(path, &bytes, &settings()).unwrap_or_else(|error| panic!("{error}"));
    println!("{path} in {:.0} ms: {}\n", started.elapsed().as_secs_f64() * 1e3, report.summary());
    assert_sound(&scene);
    serde_json::to_string(&report).expect("the report is plain data");

    Some((scene, report))
}

fn assert_sound(scene: &Scene) {
    assert!(scene.structures.is_sorted_by(|a, b| a.id < b.id));
    for structure in &scene.structures {
        let bounds = structure.bounds();
        let numbers = bounds.min.iter().chain(bounds.max.iter());
        assert!(numbers.clone().all(|metres| metres.is_finite() && metres.abs() < 30_000.0), "{}: {bounds:?}", structure.name);
        assert!(bounds.max.z > 0.0, "{}: {bounds:?}", structure.name);
        assert!(!structure.outlines().0.is_empty(), "{}", structure.name);
        assert!(!structure.triangles().is_empty(), "{}", structure.name);
    }
}

fn assert_place(scene: &Scene, lat_deg: f64, lon_deg: f64) {
    let origin = scene.frame.origin.expect("a georeferenced scene");
    assert!((origin.lat_deg - lat_deg).abs() < 0.02 && (origin.lon_deg - lon_deg).abs() < 0.02, "{origin:?}");
}

/// The figures of the scenes' manifest: structures, tallest (m), extent (m, east and north, within 3 %).
fn assert_figures(report: &ImportReport, structures: usize, tallest_m: f64, extent_m: [f64; 2]) {
    assert_eq!(report.structures, structures);
    assert!((report.tallest_m - tallest_m).abs() < 0.1, "{} m", report.tallest_m);
    for (found, expected) in report.extent_m.iter().zip(extent_m) {
        assert!((found - expected).abs() < 0.03 * expected + 2.0, "{found} m instead of {expected} m");
    }
}

#[test]
fn manhattan() {
    let Some((scene, report)) = import("manhattan/buildings.geojson") else { return };
    // Two of the 151 features have shrunk to points and lines by rounding.
    assert_figures(&report, 149, 290.0, [356.0, 333.0]);
    assert_place(&scene, 40.706, -74.008);
    assert_eq!(report.count(ItemKind::NoGeometry), 2);
    assert!(report.overlapping_pairs > 50, "the parts overlap on purpose");
}

#[test]
fn nihonbashi() {
    let Some((scene, report)) = import("nihonbashi/buildings.geojson") else { return };
    assert_figures(&report, 130, 193.4, [323.0, 318.0]);
    assert_place(&scene, 35.686, 139.774);
}

#[test]
fn marunouchi() {
    let Some((_, report)) = import("marunouchi/buildings.geojson") else { return };
    assert_figures(&report, 164, 205.7, [776.0, 792.0]);
}

#[test]
fn tokyo() {
    let Some((_, report)) = import("tokyo-2km/buildings.geojson") else { return };
    assert_figures(&report, 3489, 235.2, [1848.0, 2021.0]);
}

#[test]
fn monaco_s_guessed_heights_are_listed() {
    let Some((_, report)) = import("monaco-osm/buildings.geojson") else { return };
    assert!((1200..=1220).contains(&report.structures), "{}", report.structures);
    assert_eq!(report.tallest_m, 170.0);
    let guessed = report.items.iter().filter(|item| item.kind == ItemKind::HeightGuessed);
    let from_nothing = guessed.clone().filter(|item| item.done.contains("taken to be")).count();
    assert!((1080..=1102).contains(&from_nothing), "{from_nothing}");
    assert!(guessed.count() > from_nothing, "some from storeys");
}

#[test]
fn delfshaven_as_cityjson() {
    let Some((scene, report)) = import("delfshaven/delfshaven.city.json") else { return };
    assert_figures(&report, 321, 25.8, [349.0, 344.0]);
    assert_place(&scene, 51.906, 4.448);
    assert_eq!(report.epsg, Some(28992));
    assert!(report.count(ItemKind::DegenerateFaces) > 0);
    assert!(scene.structures.iter().all(|structure| matches!(structure.shape, Shape::Mesh { .. })));
}

#[test]
fn delfshaven_as_obj_has_the_same_size() {
    let Some((_, report)) = import("delfshaven/delfshaven_mesh.obj") else { return };
    assert!(report.structures > 20, "{}", report.structures);
    assert!((report.tallest_m - 25.8).abs() < 0.1);
    assert!((report.extent_m[0] - 349.0).abs() < 3.0 && (report.extent_m[1] - 344.0).abs() < 3.0);
}

/// The same triangles in three formats, of which glTF has another axis up.
#[test]
fn delfshaven_s_mesh_is_the_same_in_every_format() {
    let Some((obj, _)) = import("delfshaven/delfshaven_mesh.obj") else { return };
    for path in ["delfshaven/delfshaven_mesh.ply", "delfshaven/delfshaven_mesh.glb"] {
        let Some((scene, report)) = import(path) else { continue };
        assert!(matches!(report.format, Format::Ply | Format::Gltf));
        assert_eq!(scene.structures.len(), obj.structures.len(), "{path}");
        for (one, other) in scene.structures.iter().zip(&obj.structures) {
            let apart = |a: Point3<f64>, b: Point3<f64>| (a - b).norm();
            let (one, other) = (one.bounds(), other.bounds());
            // PLY and glTF hold single precision.
            assert!(apart(one.min, other.min) < 1e-3 && apart(one.max, other.max) < 1e-3, "{path}: {one:?} and {other:?}");
        }
    }
}

/// With its grid and the offset that was taken away the mesh lies where the city model does.
#[test]
fn a_mesh_finds_its_place_by_its_grid() {
    let (Some((city, _)), Some(bytes)) =
        (import("delfshaven/delfshaven.city.json"), scene_file("delfshaven/delfshaven_mesh.glb"))
    else {
        return;
    };
    let proxy = ProxySettings { epsg: 28992, offset_m: [90_759.0, 435_665.0, 0.0], ..settings() };
    let (mesh, report) = read("delfshaven_mesh.glb", &bytes, &proxy).unwrap();
    assert_eq!(report.epsg, Some(28992));
    let [a, b] = [&city, &mesh].map(|scene| scene.frame.origin.unwrap());
    assert!((a.lat_deg - b.lat_deg).abs() < 2e-5 && (a.lon_deg - b.lon_deg).abs() < 2e-5, "{a:?} and {b:?}");
    let [a, b] = [&city, &mesh].map(|scene| scene.bounds().unwrap());
    assert!((a.max - b.max).norm() < 2.0 && (a.min.xy() - b.min.xy()).norm() < 2.0, "{a:?} and {b:?}");
}

#[test]
fn powerplant_and_bridge_are_the_same_in_every_format() {
    for (name, other) in
        [("powerplant/powerplant", "ply"), ("truss-bridge/truss_bridge_240m", "ply"), ("truss-bridge/truss_bridge_240m", "glb")]
    {
        let [Some((_, one)), Some((_, other))] = ["obj", other].map(|ending| import(&format!("{name}.{ending}"))) else { return };
        assert!((one.tallest_m - other.tallest_m).abs() < 0.01 && (one.extent_m[0] - other.extent_m[0]).abs() < 0.01, "{name}");
    }
}

/// The GeoJSON was made from the extract by other software.
#[test]
fn monaco_s_extract_holds_what_its_geojson_does() {
    let (Some((pbf, report)), Some((json, _))) =
        (import("monaco-osm/monaco-latest.osm.pbf"), import("monaco-osm/buildings.geojson"))
    else {
        return;
    };
    assert_eq!(report.format, Format::OsmPbf);
    assert_place(&pbf, 43.737, 7.424);
    let same = |name: &str| Some((pbf.structure(pbf.find(name)?)?.bounds(), json.structure(json.find(name)?)?.bounds()));
    let found: Vec<_> = json.structures.iter().filter_map(|structure| same(&structure.name)).collect();
    let alike = found.iter().filter(|(a, b)| (a.min - b.min).norm() < 0.05 && (a.max - b.max).norm() < 0.05).count();
    println!("{} structures in both, {alike} alike, of {} and {}", found.len(), pbf.structures.len(), json.structures.len());
    assert!(pbf.structures.len().abs_diff(json.structures.len()) <= 5 && alike * 100 >= json.structures.len() * 98);
}

#[test]
fn heights_that_are_missing_can_be_left_out_or_be_one() {
    let Some(bytes) = scene_file("monaco-osm/monaco-latest.osm.pbf") else { return };
    let read_with = |missing_heights| read("monaco.osm.pbf", &bytes, &ProxySettings { missing_heights, ..settings() }).unwrap();
    let (dropped, report) = read_with(MissingHeights::Drop);
    assert!(
        (100..=140).contains(&dropped.structures.len()) && report.count(ItemKind::HeightMissing) > 1000,
        "{}",
        report.summary()
    );
    let (constant, report) = read_with(MissingHeights::Constant);
    assert!(constant.structures.len() > 1200 && report.items.iter().any(|item| item.done.ends_with("taken to be 10 m")));
}

#[test]
fn a_file_of_one_level_of_detail_is_read_whatever_is_wanted() {
    let Some(bytes) = scene_file("delfshaven/delfshaven.city.json") else { return };
    let triangles = |lod: f64| {
        let (scene, _) = read("delfshaven.city.json", &bytes, &ProxySettings { lod, ..settings() }).unwrap();
        scene.structures.iter().map(|structure| structure.triangles().len()).sum::<usize>()
    };
    // There is only one level in this file, which is read whatever is wanted.
    assert_eq!(triangles(0.0), triangles(1.0));
}

#[test]
fn the_parts_of_delft_campus_belong_to_their_buildings() {
    let Some((scene, report)) = import("delft-campus/3dbag_5910_lod22.city.json") else { return };
    // Three of the 432 buildings have no geometry.
    assert!((426..=430).contains(&report.structures), "{}", report.structures);
    assert!((50.0..55.0).contains(&report.tallest_m), "{}", report.tallest_m);
    assert_eq!(report.epsg, Some(7415));
    assert_place(&scene, 52.0, 4.37);
    assert!(report.count(ItemKind::NoGeometry) >= 2);
}

#[test]
fn delft_ahn3_without_its_roads_and_water() {
    let Some((_, report)) = import("delft-ahn3/delft_lod1_terrain.city.json") else { return };
    assert!((160..=163).contains(&report.structures), "{}", report.structures);
    assert_eq!(report.ignored["Road"], 143);
    assert_eq!(report.ignored["WaterBody"], 3);
}

#[test]
fn single_objects_in_local_metres() {
    if let Some((scene, report)) = import("powerplant/powerplant.obj") {
        assert!((report.tallest_m - 48.0).abs() < 0.5, "{}", report.tallest_m);
        assert!((1..=40).contains(&report.structures), "{}", report.structures);
        assert_eq!(scene.frame.origin, None);
    }
    if let Some((_, report)) = import("truss-bridge/truss_bridge_240m.obj") {
        assert!((report.tallest_m - 21.0).abs() < 0.5, "{}", report.tallest_m);
        assert!((report.extent_m[0] - 244.0).abs() < 5.0, "{:?}", report.extent_m);
    }
}

/// Points well under the roofs are inside, points well over them are not, although the meshes are not watertight.
#[test]
fn real_meshes_tell_inside_from_outside() {
    for path in
        ["delfshaven/delfshaven.city.json", "delft-campus/3dbag_5910_lod22.city.json", "delft-ahn3/delft_lod1_terrain.city.json"]
    {
        let Some((scene, _)) = import(path) else { continue };
        let mut inside = 0;
        for structure in &scene.structures {
            let bounds = structure.bounds();
            let middle = structure.outlines().0[0].interior_point().expect("an outline has an inside");
            let at = |share: f64| Point3::new(middle.x(), middle.y(), bounds.min.z + share * (bounds.max.z - bounds.min.z));
            inside += usize::from(structure.contains(&at(0.2)));
            assert!(!structure.contains(&at(1.01)), "{}", structure.name);
        }
        let share = inside as f64 / scene.structures.len() as f64;
        println!("{path}: {:.1} % of the middles are inside", 100.0 * share);
        assert!(share > 0.95);
    }
}

/// The item kinds that answer to each defect of the corrupted scene, by words of its description.
fn expected_kinds(defect: &str) -> &'static [ItemKind] {
    use ItemKind::*;
    const KINDS: [(&str, &[ItemKind]); 30] = [
        ("bow-tie", &[SelfIntersection, SuspectOrder]),
        ("every vertex duplicated", &[DuplicateVertices]),
        ("ring not closed", &[OpenRing]),
        ("clockwise", &[WrongWinding]),
        ("\"45 m\"", &[HeightText]),
        ("\"120 ft\"", &[HeightText]),
        ("\"12,5\"", &[HeightText]),
        ("\"~30\"", &[HeightText]),
        ("\"10;25\"", &[HeightText]),
        ("height is the string", &[HeightGuessed]),
        ("height = ", &[HeightGuessed]),
        ("height missing", &[HeightGuessed]),
        ("building:levels \"3;5\"", &[HeightGuessed]),
        ("disagree", &[HeightDisagreement]),
        ("min_height above height", &[BaseIgnored]),
        ("null geometry", &[NoGeometry]),
        ("Point", &[NoGeometry]),
        ("LineString", &[NoGeometry]),
        ("GeometryCollection", &[PartsDropped]),
        ("empty polygon", &[NoGeometry]),
        ("zero-area", &[NoGeometry]),
        ("long spike", &[Spike]),
        ("3D coordinates", &[ElevationIgnored]),
        ("hole larger", &[HoleDropped]),
        ("MultiPolygon", &[PartsUnited]),
        ("exact duplicate", &[DuplicateDropped]),
        ("lat/lon swapped", &[SwappedCoordinates]),
        ("null-island", &[Outlier]),
        ("properties null", &[HeightGuessed]),
        ("height is a", &[HeightGuessed]),
    ];
    KINDS.iter().find(|(words, _)| defect.contains(words)).map_or(&[], |(_, kinds)| kinds)
}

#[test]
fn every_injected_defect_is_reported_under_its_name() {
    let Some((scene, report)) = import("corrupted/buildings_corrupted.geojson") else { return };
    let defects: serde_json::Value = serde_json::from_slice(&scene_file("corrupted/defects.json").unwrap()).unwrap();
    let defects = defects.as_array().unwrap();
    assert_eq!(defects.len(), 53);
    for entry in defects {
        let (id, defect) = (entry["id"].as_str().unwrap(), entry["defect"].as_str().unwrap());
        let kinds = expected_kinds(defect);
        let is_it = |item: &&ReportItem| match id {
            "(properties null)" => item.place == Place::Feature(21),
            id => item.structure == id,
        };
        let items: Vec<_> = report.items.iter().filter(is_it).collect();
        assert!(items.iter().any(|item| kinds.contains(&item.kind)), "{id}: {defect}: {items:?}");
        assert!(items.iter().all(|item| item.done.len() > 10), "{id}: {items:?}");
    }
    // Six features have no footprint, one lies on null island, one is there twice.
    assert_eq!(scene.structures.len(), 131 - 8, "{}", report.summary());
    assert_eq!(report.tallest_m, 193.4);
    assert!(report.extent_m.iter().all(|side_m| (300.0..340.0).contains(side_m)), "{:?}", report.extent_m);
}

#[test]
fn sound_features_of_the_corrupted_scene_are_left_alone() {
    let Some((_, report)) = import("corrupted/buildings_corrupted.geojson") else { return };
    let file: serde_json::Value = serde_json::from_slice(&scene_file("corrupted/buildings_corrupted.geojson").unwrap()).unwrap();
    for item in &report.items {
        let Place::Feature(index) = item.place else { panic!("{item}") };
        let properties = &file["features"][index]["properties"];
        assert!(properties.is_null() || properties["injected_defect"].is_string(), "{item}");
    }
}
