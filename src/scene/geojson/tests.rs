use geo::Contains;
use serde_json::json;

use super::*;
use crate::frame::Geodetic;
use crate::scene::ItemKind;
use crate::settings::{MissingHeights, Settings};

fn read_value(value: &Value) -> Result<(Scene, ImportReport), ImportError> {
    read("town.geojson", value.to_string().as_bytes(), &Settings::default().proxy, None)
}

fn square(lon: f64, lat: f64) -> Value {
    let d = 1e-4;
    json!([[[lon, lat], [lon + d, lat], [lon + d, lat + d], [lon, lat + d], [lon, lat]]])
}

fn building(lon: f64, lat: f64, properties: Value) -> Value {
    json!({ "type": "Feature", "properties": properties, "geometry": { "type": "Polygon", "coordinates": square(lon, lat) } })
}

fn town(features: Vec<Value>) -> Value {
    json!({ "type": "FeatureCollection", "features": features })
}

#[test]
fn no_fly_features_become_zones() {
    let zone = |properties: Value| building(4.002, 52.0, properties);
    let (scene, report) = read_value(&town(vec![
        building(4.0, 52.0, json!({ "id": "a", "height": 10 })),
        zone(json!({ "id": "school", "overfly": "no-fly" })),
        zone(json!({ "id": "mast", "overfly": "no-fly", "min_height": 20, "height": "60 m" })),
        zone(json!({ "id": "cellar", "overfly": "no-fly", "min_height": -10, "height": null })),
    ]))
    .unwrap();
    let zones: Vec<_> = scene.zones.iter().map(|zone| (zone.name.as_str(), zone.floor_m, zone.ceiling_m)).collect();
    assert_eq!(zones, [("school", 0.0, f64::MAX), ("mast", 20.0, 60.0), ("cellar", 0.0, f64::MAX)]);
    assert_eq!(scene.structures.len(), 1);
    assert_eq!((report.zones, report.count(ItemKind::BaseIgnored), report.count(ItemKind::HeightText)), (3, 1, 1));
}

#[test]
fn a_zone_that_cannot_be_barred_as_given_stops_the_import() {
    let marked = |geometry: Value, properties: Value| {
        let mut properties = properties;
        properties["id"] = json!("field");
        json!({ "type": "Feature", "properties": properties, "geometry": geometry })
    };
    let outline = || json!({ "type": "Polygon", "coordinates": square(4.002, 52.0) });
    let zone = |properties: Value| {
        let mut properties = properties;
        properties["overfly"] = json!("no-fly");
        marked(outline(), properties)
    };
    let shaped = |geometry: Value| marked(geometry, json!({ "overfly": "no-fly" }));
    let point = || json!({ "type": "Point", "coordinates": [4.002, 52.0] });
    let cases = [
        zone(json!({ "min_height": 70, "height": 60 })),
        zone(json!({ "height": 0 })),
        zone(json!({ "height": "high" })),
        zone(json!({ "height": 60, "upperVerticalReference": "AMSL" })),
        zone(json!({ "height": 200, "uom": "FT" })),
        zone(json!({ "height": -5 })),
        zone(json!({ "height": [60] })),
        zone(json!({ "height": "high", "building:height": 60 })),
        zone(json!({ "min_height": "10;25", "height": 60 })),
        zone(json!({ "min_height": "low" })),
        shaped(Value::Null),
        shaped(point()),
        shaped(json!({ "type": "GeometryCollection", "geometries": [outline(), point()] })),
        shaped(json!({ "type": "Polygon", "coordinates": [[[4.002], [4.003, 52.0], [4.003, 52.1]]] })),
        shaped(json!({ "type": "Circle", "coordinates": square(4.002, 52.0) })),
        shaped(json!({ "type": "MultiPolygon", "coordinates": [square(4.002, 52.0), 7] })),
        marked(outline(), json!({ "overfly": "no_fly" })),
        marked(outline(), json!({ "overfly": true })),
    ];
    for case in cases {
        let error =
            read_value(&town(vec![building(4.0, 52.0, json!({ "height": 10 })), case.clone()])).expect_err(&case.to_string());
        let text = error.to_string();
        assert!(text.contains("feature 1 ") || text.contains("(feature 1)"), "{text}");
        assert!(text.contains("\"field\"") && (text.contains("; ") || text.contains("\"no-fly\"")), "{text}");
    }
}

#[test]
fn great_zones_are_kept_and_do_not_move_the_scene() {
    let control_zone = json!({ "type": "Feature", "properties": { "overfly": "no-fly" }, "geometry": { "type": "Polygon",
        "coordinates": [[[3.0, 51.0], [5.0, 51.0], [5.0, 53.0], [3.0, 53.0], [3.0, 51.0]]] } });
    let far = building(-74.0, 40.7, json!({ "overfly": "no-fly", "id": "far" }));
    let alone = read_value(&town(vec![building(4.0, 52.0, json!({ "height": 10 }))])).unwrap().0;
    let (scene, report) = read_value(&town(vec![control_zone, building(4.0, 52.0, json!({ "height": 10 })), far])).unwrap();
    assert_eq!(scene.frame, alone.frame);
    assert_eq!((report.zones, report.count(ItemKind::Outlier)), (2, 1));
    assert!(scene.zones[0].outline.contains(&geo::Point::new(0.0, 0.0)));
    assert!(scene.zones[1].outline.0.is_empty());
    let again = read("town.geojson", super::super::to_geojson(&scene).as_bytes(), &Settings::default().proxy, None).unwrap().0;
    assert!(again.zones[0].outline.contains(&geo::Point::new(0.0, 0.0)));
}

#[test]
fn members_come_in_any_order_and_the_unknown_is_passed_over() {
    let ring = "[[4,52],[4.0001,52],[4.0001,52.0001],[4,52]]";
    let feature = format!(
        r#""geometry":{{"x":[[]],"coordinates":[{ring}],"bbox":[1,{{}}],"type":"Polygon"}},"properties":{{"y":{{"height":7}},"height":9}}"#
    );
    let collection = format!(r#"{{"z":[1,[2]],"features":[{{{feature},"type":"Feature"}}],"type":"FeatureCollection"}}"#);
    let alone = format!(r#"{{{feature},"type":"Feature"}}"#);
    let nested = collection.replace(r#""type":"Polygon"}"#, r#""type":"Polygon"}],"type":"GeometryCollection"}"#);
    let nested = nested.replace(r#""geometry":"#, r#""geometry":{"geometries":["#);
    for text in [collection, alone, nested] {
        let (scene, report) = read("town.geojson", text.as_bytes(), &Settings::default().proxy, None).expect(&text);
        assert_eq!((scene.structures.len(), report.tallest_m, report.items.len()), (1, 9.0, 0), "{text}");
    }
}

#[test]
fn too_many_features_are_refused_and_counted() {
    let text = |count: usize| format!("{{\"type\":\"FeatureCollection\",\"features\":[{}0]}}", "0,".repeat(count - 1));
    let read_text = |text: String| read("town.geojson", text.as_bytes(), &Settings::default().proxy, None).unwrap_err();
    assert!(matches!(read_text(text(MOST_FEATURES)), ImportError::NoStructures { objects: MOST_FEATURES, .. }));
    let error = read_text(text(MOST_FEATURES + 7));
    assert!(matches!(error, ImportError::TooManyFeatures { features, .. } if features == MOST_FEATURES + 7), "{error}");
}

#[test]
fn names_stay_unique_and_ids_sorted() {
    let (scene, report) = read_value(&town(vec![
        building(4.0, 52.0, json!({ "id": "a", "height": 10 })),
        building(4.001, 52.0, json!({ "id": "a", "height": 10 })),
        building(4.002, 52.0, json!({ "height": 10 })),
    ]))
    .unwrap();
    for name in ["a", "a-2", "feature-2"] {
        assert!(scene.find(name).is_some(), "{name}");
    }
    assert_eq!(report.count(ItemKind::Renamed), 1);
    assert!(scene.structures.is_sorted_by(|a, b| a.id < b.id));
}

#[test]
fn the_order_of_the_file_does_not_matter() {
    let mut features: Vec<Value> = (0..9)
        .map(|i| building(4.0 + 2e-4 * f64::from(i % 3), 52.0 + 2e-4 * f64::from(i), json!({ "id": i, "height": 5 + i })))
        .collect();
    let (first, _) = read_value(&town(features.clone())).unwrap();
    features.reverse();
    assert_eq!(read_value(&town(features)).unwrap().0, first);
}

#[test]
fn files_that_are_no_scene_are_refused() {
    let tokyo = |properties: Value| building(139.77, 35.68, properties);
    let swapped = json!({ "type": "Feature", "properties": { "height": 9 }, "geometry": { "type": "Polygon", "coordinates": square(35.68, 139.77) } });
    let projected = json!({ "type": "Feature", "properties": { "height": 9 }, "geometry": { "type": "Polygon", "coordinates": square(90_759.0, 435_665.0) } });
    let mut declared = town(vec![projected.clone()]);
    declared["crs"] = json!({ "type": "name", "properties": { "name": "urn:ogc:def:crs:EPSG::99999" } });
    type Check = fn(&ImportError) -> bool;
    let cases: [(Value, Check); 8] = [
        (town(vec![]), |error| matches!(error, ImportError::NoStructures { .. })),
        (town(vec![json!({ "type": "Feature", "properties": {}, "geometry": null })]), |error| {
            matches!(error, ImportError::NoStructures { .. })
        }),
        (town(vec![json!(7), json!([]), json!("x")]), |error| matches!(error, ImportError::NoStructures { .. })),
        (town(vec![tokyo(json!({})), tokyo(json!({ "height": "tall" }))]), |error| {
            matches!(error, ImportError::NoHeights { .. })
        }),
        (town(vec![swapped]), |error| matches!(error, ImportError::SwappedCoordinates { .. })),
        (town(vec![projected]), |error| matches!(error, ImportError::Projected { .. })),
        (declared, |error| error.to_string().contains("99999")),
        (json!({ "type": "FeatureCollection" }), |error| matches!(error, ImportError::Structure { .. })),
    ];
    for (value, check) in cases {
        let error = read_value(&value).expect_err(&value.to_string());
        assert!(check(&error) && error.to_string().starts_with("town.geojson: "), "{error}");
    }
}

/// Buildings along a street, 20 m high but for the one whose properties are given.
fn street(odd: Value) -> Value {
    town(
        (0..5)
            .map(|i| building(4.0 + 3e-4 * f64::from(i), 52.0, if i == 2 { odd.clone() } else { json!({ "height": 18 + i }) }))
            .collect(),
    )
}

#[test]
fn missing_heights_are_filled_as_it_is_wanted() {
    let tallest = |policy: MissingHeights, default_height_m: f64| {
        let proxy = ProxySettings { missing_heights: policy, default_height_m, ..Settings::default().proxy };
        let (scene, report) = read("town.geojson", street(json!({ "id": "odd" })).to_string().as_bytes(), &proxy, None).unwrap();
        let odd = scene.find("odd").map(|id| scene.structure(id).unwrap().bounds().max.z);
        (odd, report.count(ItemKind::HeightGuessed), report.count(ItemKind::HeightMissing))
    };
    assert_eq!(tallest(MissingHeights::Neighbours, 10.0), (Some(19.0), 1, 0), "the lower median of 18, 19, 21 and 22");
    assert_eq!(tallest(MissingHeights::Constant, 12.0), (Some(12.0), 1, 0));
    assert_eq!(tallest(MissingHeights::Drop, 10.0), (None, 0, 1));
    let bare = town(vec![building(4.0, 52.0, json!({}))]).to_string();
    let proxy = |missing_heights| ProxySettings { missing_heights, ..Settings::default().proxy };
    let read_bare = |policy| read("town.geojson", bare.as_bytes(), &proxy(policy), None);
    assert!(matches!(read_bare(MissingHeights::Neighbours), Err(ImportError::NoHeights { .. })));
    assert!(matches!(read_bare(MissingHeights::Drop), Err(ImportError::NoStructures { .. })));
    assert_eq!(read_bare(MissingHeights::Constant).unwrap().1.tallest_m, 10.0);
}

#[test]
fn parts_stand_in_the_place_of_their_outline() {
    let d = 1e-4;
    let part = |west: f64, east: f64, height: i32| {
        let ring = json!([[west, 52.0], [east, 52.0], [east, 52.0 + d], [west, 52.0 + d], [west, 52.0]]);
        json!({ "type": "Feature", "properties": { "building:part": "yes", "height": height },
            "geometry": { "type": "Polygon", "coordinates": [ring] } })
    };
    let outline = building(4.0, 52.0, json!({ "id": "outline", "height": 90, "building": "yes" }));
    let whole = town(vec![outline.clone(), part(4.0, 4.0 + 0.5 * d, 30), part(4.0 + 0.5 * d, 4.0 + d, 90)]);
    let (scene, report) = read_value(&whole).unwrap();
    assert_eq!((scene.find("outline"), scene.structures.len(), report.count(ItemKind::OutlineReplaced)), (None, 2, 1));
    // What the parts leave open still stands, and so do its neighbours.
    let half = town(vec![outline, part(4.0, 4.0 + 0.5 * d, 30), part(4.0 + d, 4.0 + 2.0 * d, 20)]);
    assert_eq!(read_value(&half).unwrap().0.structures.len(), 3);
}

#[test]
fn projected_coordinates_are_brought_to_degrees() {
    let corner = |x: f64, y: f64| json!([90_759.0 + x, 435_665.0 + y]);
    let ring = json!([corner(0.0, 0.0), corner(40.0, 0.0), corner(40.0, 20.0), corner(0.0, 20.0), corner(0.0, 0.0)]);
    let mut value = town(vec![
        json!({ "type": "Feature", "properties": { "height": 9 }, "geometry": { "type": "Polygon", "coordinates": [ring] } }),
    ]);
    value["crs"] = json!({ "type": "name", "properties": { "name": "urn:ogc:def:crs:EPSG::28992" } });
    let (scene, report) = read_value(&value).unwrap();
    let (bounds, origin) = (scene.bounds().unwrap(), scene.frame.origin.unwrap());
    assert!((origin.lat_deg - 51.905).abs() < 0.01 && (origin.lon_deg - 4.45).abs() < 0.03, "{origin:?}");
    // The grid is turned by half a degree there.
    assert!((bounds.max.x - bounds.min.x - 40.0).abs() < 0.8 && (bounds.max.y - bounds.min.y - 20.0).abs() < 0.8, "{bounds:?}");
    assert_eq!(report.epsg, Some(28992));
    value["crs"] = Value::Null;
    assert!(matches!(read_value(&value), Err(ImportError::Projected { .. })));
    let given = |epsg: u32| {
        let proxy = ProxySettings { epsg, ..Settings::default().proxy };
        read("town.geojson", value.to_string().as_bytes(), &proxy, None)
    };
    assert_eq!(given(28992).unwrap().0, scene);
    assert!(matches!(given(99_999), Err(ImportError::UnknownGrid { epsg: 99_999, .. })));
}

#[test]
fn a_given_origin_is_kept_when_it_is_near() {
    let mut value = town(vec![building(4.0, 52.0, json!({ "height": 10 }))]);
    value["overfly_origin"] = json!({ "lat_deg": 52.001, "lon_deg": 4.001, "alt_m": 3.0 });
    let origin = |value: &Value| read_value(value).unwrap().0.frame.origin.unwrap();
    assert_eq!(origin(&value), Geodetic { lat_deg: 52.001, lon_deg: 4.001, alt_m: 3.0 });
    value["overfly_origin"] = json!({ "lat_deg": 12.0, "lon_deg": 4.001, "alt_m": 3.0 });
    assert!((origin(&value).lat_deg - 52.000_05).abs() < 1e-9);
}
