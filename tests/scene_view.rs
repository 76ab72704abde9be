//! The README's picture of an inspected scene is what the program draws.

use overfly::mission::svg::scene_view;
use overfly::scene::{ItemKind, generate_block, ny1_size, read, to_geojson};
use overfly::settings::Settings;
use serde_json::{Value, json};

/// A generated block as towns really come: every fourth building without a height, every seventh ring open, one without a shape.
fn town() -> Value {
    let mut town: Value = serde_json::from_str(&to_geojson(&generate_block(&ny1_size()))).unwrap();
    for (index, feature) in town["features"].as_array_mut().unwrap().iter_mut().enumerate() {
        if index % 4 == 1 {
            feature["properties"].as_object_mut().unwrap().remove("height");
        }
        if index % 7 == 3 {
            let rings = if feature["geometry"]["type"] == "MultiPolygon" {
                "/geometry/coordinates/0/0"
            } else {
                "/geometry/coordinates/0"
            };
            feature.pointer_mut(rings).unwrap().as_array_mut().unwrap().pop();
        }
    }
    town["features"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "type": "Feature", "id": "ghost", "properties": { "height": 9 }, "geometry": null }));
    town
}

#[test]
fn the_readme_s_picture_is_what_is_drawn() {
    let (scene, report) = read("town.geojson", town().to_string().as_bytes(), &Settings::default().proxy).unwrap();
    assert!(report.count(ItemKind::HeightGuessed) > 2 && report.count(ItemKind::OpenRing) > 1);
    let drawn = scene_view::to_bytes(&scene, &report);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/pictures/inspect.svg");
    if std::env::var_os("OVERFLY_DRAW").is_some() {
        std::fs::write(path, &drawn).unwrap();
    }
    let pictured = std::fs::read(path).unwrap();
    assert!(drawn == pictured, "draw it anew with OVERFLY_DRAW=1");
}
