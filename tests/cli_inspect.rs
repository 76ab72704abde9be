//! `overfly inspect`, and what the command line says of how a file is read: in the process itself, and through a daemon.

mod program;

use program::{Place, stdout};
use serde_json::{Value, json};

/// A town of houses of 9, 12 and 15 m, and seven that have no height; the outline of the last one is not closed.
fn town(place: &Place) -> &'static str {
    let house = |k: usize, height: Option<f64>| {
        let (x, y) = (4.47 + 0.0004 * k as f64, 51.91);
        let mut ring = vec![[x, y], [x + 0.0002, y], [x + 0.0002, y + 0.0001], [x, y + 0.0001], [x, y]];
        if k == 9 {
            ring.pop();
        }
        json!({ "type": "Feature", "id": format!("house-{k}"), "properties": { "height": height },
            "geometry": { "type": "Polygon", "coordinates": [ring] } })
    };
    let height = |k: usize| match k {
        0 => Some(9.0),
        4 => Some(12.0),
        9 => Some(15.0),
        _ => None,
    };
    let features: Vec<Value> = (0..10).map(|k| house(k, height(k))).collect();
    let town = json!({ "type": "FeatureCollection", "features": features });
    std::fs::write(place.path("town.geojson"), town.to_string()).unwrap();
    "town.geojson"
}

/// A building whose first level of detail is 12 m high, and whose second one has a spire of 20 m.
fn levels(place: &Place) -> &'static str {
    let pyramid = |lod: &str, top: usize| json!({ "type": "Solid", "lod": lod, "boundaries": [[[[0, 2, 1]], [[0, 1, top]], [[1, 2, top]], [[2, 0, top]]]] });
    let city = json!({ "type": "CityJSON", "version": "2.0",
        "CityObjects": { "church": { "type": "Building", "geometry": [pyramid("1.2", 3), pyramid("2.2", 4)] } },
        "vertices": [[0, 0, 0], [2000, 0, 0], [0, 2000, 0], [300, 300, 1200], [300, 300, 2000]],
        "transform": { "scale": [0.01, 0.01, 0.01], "translate": [90000, 435000, 0] },
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/28992" } });
    std::fs::write(place.path("church.city.json"), city.to_string()).unwrap();
    "church.city.json"
}

fn tops(inspected: &Value) -> Vec<(String, f64)> {
    let top = |structure: &Value| {
        (structure["name"].as_str().unwrap().to_owned(), (structure["top_m"].as_f64().unwrap() * 10.0).round() / 10.0)
    };
    let mut tops: Vec<_> = inspected["structures"].as_array().unwrap().iter().map(top).collect();
    tops.sort_by(|a, b| a.0.cmp(&b.0));
    tops
}

#[test]
fn the_report_for_people_says_what_is_there_and_what_was_guessed_and_repaired() {
    let place = Place::new();
    let file = town(&place);
    let text = stdout(&place.run(&["inspect", file]));
    let words: Vec<Vec<&str>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
    let row = |label: &[&str]| words.iter().find(|words| words.starts_with(label)).map(|words| words[label.len()..].join(" "));
    assert_eq!(row(&["scene"]).as_deref(), Some("town"), "{text}");
    assert_eq!(row(&["format"]).as_deref(), Some("GeoJSON"), "{text}");
    assert_eq!(row(&["structures"]).as_deref(), Some("10 (10 prism)"), "{text}");
    assert_eq!(row(&["triangles"]).as_deref(), Some("100"), "four walls and a roof each: {text}");
    assert!(row(&["origin", "on", "Earth"]).unwrap().starts_with("51.9"), "{text}");
    // Seven were guessed: five are printed, and how to see the rest is said.
    assert!(text.contains("(may be taller than taken: give the height, or raise the structure)"), "{text}");
    assert_eq!(
        text.lines().filter(|line| line.starts_with("  ") && line.contains("house-") && !line.contains("house-9")).count(),
        5
    );
    assert!(text.contains("  and 2 more (--all prints them)"), "{text}");
    assert!(text.lines().any(|line| line.starts_with("  ") && line.contains("house-9")), "its outline was closed: {text}");
    let all = stdout(&place.run(&["inspect", file, "--all"]));
    assert!(
        !all.contains("--all prints them") && (1..9).filter(|k| *k != 4).all(|k| all.contains(&format!("house-{k}"))),
        "{all}"
    );
    let written = stdout(&place.run(&["inspect", file, "--out", "report"]));
    assert!(written.contains("wrote report/inspect.json") && written.contains("wrote report/inspect.svg"), "{written}");
    assert_eq!(place.files("report"), ["inspect.json", "inspect.svg"]);
}

#[test]
fn missing_heights_are_filled_as_the_command_line_says() {
    let place = Place::new();
    let file = town(&place);
    let inspect = |words: &[&str]| place.json(&[&["inspect", file], words].concat());
    let of = |inspected: &Value, name: &str| tops(inspected).into_iter().find(|(known, _)| known == name).map(|(_, top_m)| top_m);
    // The median of those that have one.
    assert_eq!(of(&inspect(&[]), "house-5"), Some(12.0));
    let constant = inspect(&["--missing-heights", "constant", "--default-height", "7.5"]);
    assert_eq!((of(&constant, "house-5"), of(&constant, "house-0")), (Some(7.5), Some(9.0)));
    let dropped = inspect(&["--missing-heights", "drop"]);
    assert_eq!(
        tops(&dropped),
        [("house-0", 9.0), ("house-4", 12.0), ("house-9", 15.0)].map(|(name, top_m)| (name.to_owned(), top_m))
    );
    let message = place.fails(2, "usage", &["inspect", file, "--missing-heights", "guess"]);
    assert!(message.contains("neighbours"), "{message}");
}

#[test]
fn a_level_of_detail_is_chosen_on_the_command_line() {
    let place = Place::new();
    let file = levels(&place);
    let top_m = |words: &[&str]| tops(&place.json(&[&["inspect", file], words].concat()))[0].1;
    assert_eq!((top_m(&[]), top_m(&["--lod", "1.2"]), top_m(&["--lod", "2.2"])), (20.0, 12.0, 20.0));
}

#[test]
fn a_daemon_reads_a_file_as_it_is_asked_to() {
    let place = Place::new();
    let (file, church) = (town(&place), levels(&place));
    let _daemon = place.serve(&[]);
    let structures = |words: &[&str]| place.json(&[&["load", file], words].concat())["structures"].as_u64();
    assert_eq!(structures(&["--name", "whole"]), Some(10));
    assert_eq!(structures(&["--name", "known", "--missing-heights", "drop"]), Some(3));
    let top_m = |name: &str, words: &[&str]| {
        place.json(&[&["load", church, "--name", name], words].concat());
        let listed = place.json(&["status", name]);
        let listed = listed["structures"].as_array().unwrap_or_else(|| panic!("{listed}"));
        (listed[0]["top_m"].as_f64().unwrap() * 10.0).round() / 10.0
    };
    assert_eq!((top_m("plain", &["--lod", "1.2"]), top_m("spire", &[])), (12.0, 20.0));
}
