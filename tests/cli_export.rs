//! `overfly export` from end to end, with good and bad inputs. What the files hold is read back by other programs' clients in `tests/readback`.

mod program;

use program::{Place, stderr, stdout};
use serde_json::{Value, json};

/// A place with `town.geojson` and its plan in `out`, and a configuration with few samples and a no-fly zone aside.
fn planned(rig: &str) -> Place {
    let place = Place::new();
    let scene = place.scene();
    place.json(&["plan", &scene, "--rig", rig, "--method", "paper", "--iterations", "60", "--seed", "2", "--out", "out"]);
    let settings = "[quality]\nsamples = 200\n[[flight.no_fly]]\nname = \"aside\"\noutline_m = [[400.0, 0.0], [440.0, 0.0], [440.0, 40.0]]\n\
                    floor_m = 0.0\nceiling_m = 500.0\n";
    std::fs::write(place.path("few.toml"), settings).unwrap();
    place
}

/// Changes the plan in `out` and writes it into a folder of its own, with its run.json.
fn changed(place: &Place, folder: &str, change: impl FnOnce(&mut Value)) -> String {
    let mut plan: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    change(&mut plan);
    std::fs::create_dir_all(place.path(folder)).unwrap();
    std::fs::write(place.path(&format!("{folder}/plan.json")), plan.to_string()).unwrap();
    std::fs::write(place.path(&format!("{folder}/run.json")), place.read("out/run.json")).unwrap();
    format!("{folder}/plan.json")
}

#[test]
fn all_formats_of_a_plan_stand_in_the_folder_one_mission_for_each_sortie() {
    let place = planned("phantom4-rtk");
    let whole = place.json(&["export", "out/plan.json", "--to", "qgc", "--out", "whole", "--config", "few.toml"]);
    let duration_s = whole["sorties"][0]["duration_s"].as_f64().unwrap();
    assert_eq!((whole["sorties"].as_array().map(Vec::len), &whole["fences"]), (Some(1), &json!(["aside"])));
    let time = format!("{}", 0.8 * duration_s);
    let answer =
        place.json(&["export", "out/plan.json", "--to", "all", "--sortie-time", &time, "--out", "all", "--config", "few.toml"]);
    let sorties = answer["sorties"].as_array().unwrap();
    assert!(sorties.len() >= 2 && sorties[0]["last_waypoint"] == sorties[1]["first_waypoint"], "{answer}");
    let mut expected: Vec<String> = (1..=sorties.len())
        .flat_map(|k| ["-litchi.csv", ".kmz", ".plan", ".waypoints"].map(|ending| format!("town-{k}{ending}")))
        .collect();
    let others = [
        "town-colmap",
        "town-coverage.glb",
        "town-coverage.ply",
        "town-footprints.geojson",
        "town-images.csv",
        "town-metashape.csv",
        "town-realitycapture.csv",
        "town-waypoints.csv",
        "town.geojson",
        "town.kml",
    ];
    expected.extend(others.map(str::to_owned));
    expected.sort();
    assert_eq!(place.files("all"), expected);
    assert_eq!(place.files("all/town-colmap"), ["cameras.txt", "images.txt", "points3D.txt"]);
    // What is exported again is the same, byte for byte.
    place.json(&["export", "out/plan.json", "--to", "all", "--sortie-time", &time, "--out", "again", "--config", "few.toml"]);
    for file in place.files("all").iter().filter(|file| *file != "town-colmap") {
        assert!(place.read(&format!("all/{file}")) == place.read(&format!("again/{file}")), "{file}");
    }
    let output =
        place.run(&["export", "out/plan.json", "--to", "litchi", "--to", "csv", "--out", "two", "--altitude", "absolute"]);
    assert!(stdout(&output).contains("sortie") && stdout(&output).contains("wrote two/town-1-litchi.csv"), "{}", stdout(&output));
    assert!(stderr(&output).contains("above the take-off place always"), "{}", stderr(&output));
}

#[test]
fn images_are_chosen_and_keep_their_names() {
    let place = planned("m300-oblique");
    let names = |images: &str| -> Vec<String> {
        place.json(&["export", "out/plan.json", "--to", "csv", "--images", images, "--out", images]);
        let table = String::from_utf8(place.read(&format!("{images}/town-images.csv"))).unwrap();
        table.lines().skip(1).filter_map(|row| row.split(',').next().map(str::to_owned)).collect()
    };
    let (all, selected) = (names("all"), names("selected"));
    assert_eq!(&all[..2], ["nadir_000001.jpg", "forward_000001.jpg"]);
    assert!(!selected.is_empty() && selected.len() < all.len() && selected.iter().all(|name| all.contains(name)));
}

#[test]
fn without_a_georeference_what_needs_none_still_works() {
    let place = planned("phantom4-rtk");
    let plan = changed(&place, "local", |plan| plan["scene"]["origin"] = Value::Null);
    for format in ["qgc", "ardupilot", "dji", "litchi", "kml", "geojson", "footprints"] {
        let message = place.fails(3, "input_file", &["export", &plan, "--to", format, "--out", "none"]);
        assert!(message.contains(&plan) && message.contains("georeference") && message.contains("csv, colmap"), "{message}");
    }
    assert!(!place.path("none").exists(), "what is refused leaves nothing");
    let answer = place.json(&["export", &plan, "--to", "csv", "--to", "colmap", "--to", "metashape", "--out", "some"]);
    assert_eq!(answer["files"].as_array().map(Vec::len), Some(6));
    let table = String::from_utf8(place.read("some/town-metashape.csv")).unwrap();
    assert!(table.starts_with("label,x,y,z,yaw,pitch,roll\n"), "{table}");
}

#[test]
fn without_its_scene_a_mission_says_what_it_does_not_know() {
    let place = planned("panoramic");
    std::fs::rename(place.path("town.geojson"), place.path("moved.geojson")).unwrap();
    let notes = |words: &[&str]| {
        place.json(&[&["export", "out/plan.json", "--to", "qgc", "--out", "missions"], words].concat())["notes"].to_string()
    };
    assert!(notes(&[]).contains("the scene is not known"), "{}", notes(&[]));
    assert!(!notes(&["--scene", "moved.geojson"]).contains("the scene is not known"));
    let message = place.fails(3, "input_file", &["export", "out/plan.json", "--to", "coverage-ply", "--out", "model"]);
    assert!(message.contains("--scene") && message.contains("town.geojson"), "{message}");
    let message = place.fails(3, "input_file", &["export", "out/plan.json", "--to", "colmap", "--out", "model"]);
    assert!(message.contains("panoramas"), "{message}");
    let answer = place.json(&["export", "out/plan.json", "--to", "all", "--out", "all", "--config", "few.toml"]);
    let notes = answer["notes"].to_string();
    for format in ["colmap", "footprints", "coverage-ply", "coverage-glb"] {
        assert!(notes.contains(&format!("{format} is left out")), "{notes}");
    }
}

#[test]
fn what_cannot_be_flown_is_refused_with_the_remedy() {
    let place = planned("phantom4-rtk");
    let refused = |code: i32, kind: &str, words: &[&str], named: &[&str]| {
        let line = [&["export"], words, &["--out", "none"]].concat();
        let message = place.fails(code, kind, &line);
        named.iter().for_each(|word| assert!(message.contains(word), "{word} is not in {message}"));
        assert!(!place.path("none").exists(), "what is refused leaves nothing");
    };
    let plan = ["out/plan.json", "--to", "qgc"];
    refused(2, "usage", &["out/plan.json"], &["--to"]);
    refused(2, "usage", &["out/plan.json", "--to", "word"], &["word", "qgc"]);
    refused(2, "usage", &[&plan[..], &["--home", "north"]].concat(), &["LAT,LON", "52.0116,4.3571"]);
    refused(2, "usage", &[&plan[..], &["--home", "4.47,51.91"]].concat(), &["m from the first waypoint", "latitude first"]);
    refused(2, "usage", &[&plan[..], &["--reserve", "101"]].concat(), &["percent"]);
    refused(6, "no_plan", &[&plan[..], &["--sortie-time", "20"]].concat(), &["sortie", "--sortie-time"]);
    refused(6, "no_plan", &[&plan[..], &["--reserve", "100"]].concat(), &["reserve"]);
    refused(3, "input_file", &["town.geojson", "--to", "qgc"], &["a scene and no plan"]);
    refused(3, "input_file", &["nowhere.json", "--to", "qgc"], &["nowhere.json"]);
    refused(3, "input_file", &[&plan[..], &["--scene", "nowhere.geojson"]].concat(), &["nowhere.geojson"]);
    let none = changed(&place, "none-left", |plan| plan["waypoints"] = json!([]));
    refused(3, "input_file", &[&none, "--to", "qgc"], &["waypoints", "0 entries"]);
    let one = changed(&place, "one-left", |plan| plan["waypoints"].as_array_mut().unwrap().truncate(1));
    refused(3, "input_file", &[&one, "--to", "qgc"], &["two"]);
    let untimed = changed(&place, "untimed", |plan| drop(plan.as_object_mut().unwrap().remove("limits")));
    refused(3, "input_file", &[&untimed, "--to", "dji"], &["limits"]);
    // The tower of the scene stands at (40, 0) to (60, 15) from the hall, around the middle of which the frame lies.
    let through = changed(&place, "through", |plan| {
        let waypoints = plan["waypoints"].as_array_mut().unwrap();
        waypoints[1]["position_m"][2] = json!(3.0);
        waypoints[2]["position_m"][2] = json!(3.0);
        waypoints[1]["position_m"][0] = json!(-80.0);
        waypoints[2]["position_m"][0] = json!(80.0);
        waypoints[1]["position_m"][1] = json!(-18.0);
        waypoints[2]["position_m"][1] = json!(-18.0);
    });
    refused(6, "no_plan", &[&through, "--to", "qgc"], &["the leg from waypoint 1", "--scene"]);
    std::fs::write(
        place.path("barred.toml"),
        "[[flight.no_fly]]\nname = \"dome\"\noutline_m = [[-200.0, -200.0], [200.0, -200.0], [200.0, 200.0], [-200.0, 200.0]]\nfloor_m = 0.0\nceiling_m = 500.0\n",
    )
    .unwrap();
    refused(6, "no_plan", &[&plan[..], &["--config", "barred.toml"]].concat(), &["no-fly zone", "dome"]);
}

#[test]
fn heights_above_the_terrain_need_the_scene_and_an_autopilot_that_has_them() {
    let place = planned("phantom4-rtk");
    let words = ["export", "out/plan.json", "--altitude", "terrain", "--out", "missions"];
    let message = place.fails(2, "usage", &[&words[..], &["--to", "qgc"]].concat());
    assert!(message.contains("PX4") && message.contains("--autopilot ardupilot"), "{message}");
    let answer = place.json(&[&words[..], &["--to", "qgc", "--to", "kml", "--autopilot", "ardupilot"]].concat());
    assert!(answer["notes"].to_string().contains("terrain data"), "{answer}");
    let mission: Value = serde_json::from_slice(&place.read("missions/town-1.plan")).unwrap();
    let frames: Vec<u64> =
        mission["mission"]["items"].as_array().unwrap().iter().filter_map(|item| item["frame"].as_u64()).collect();
    let plan: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    // On flat ground no leg is divided.
    assert_eq!(frames.iter().filter(|frame| **frame == 10).count(), plan["waypoints"].as_array().unwrap().len());
    let all = place.json(&[&words[..], &["--to", "all"]].concat());
    assert!(all["notes"].to_string().contains("qgc is left out: PX4"), "{}", all["notes"]);
    let flown = ["fly", "out/plan.json", "--dry-run", "--altitude", "terrain"];
    let message = place.fails(2, "usage", &flown);
    assert!(message.contains("--altitude relative"), "{message}");
    let items = place.json(&[&flown[..], &["--autopilot", "ardupilot"]].concat())["items"].clone();
    assert!(items.as_array().unwrap().iter().any(|item| item["frame"] == 10), "{items}");
    std::fs::rename(place.path("town.geojson"), place.path("moved.geojson")).unwrap();
    let message = place.fails(2, "usage", &[&words[..], &["--to", "ardupilot"]].concat());
    assert!(message.contains("--scene"), "{message}");
}

#[test]
fn a_flight_goes_around_a_zone_as_its_export_does() {
    let place = planned("panoramic");
    let plan: Value = serde_json::from_slice(&place.read("out/plan.json")).unwrap();
    let origin = &plan["scene"]["origin"];
    let settings = "[[flight.no_fly]]\nname = \"between\"\noutline_m = [[-300.0, -200.0], [-250.0, -200.0], [-250.0, 200.0], [-300.0, 200.0]]\n\
                    floor_m = 0.0\nceiling_m = 500.0\n";
    std::fs::write(place.path("between.toml"), settings).unwrap();
    let degrees = |key: &str| origin[key].as_f64().unwrap();
    // 500 m to the west, behind the zone.
    let home =
        format!("{},{}", degrees("lat_deg"), degrees("lon_deg") - 500.0 / (111_320.0 * degrees("lat_deg").to_radians().cos()));
    let words = ["--home", &home, "--config", "between.toml"];
    let answer = place.json(&[&["export", "out/plan.json", "--to", "qgc", "--out", "missions"], &words[..]].concat());
    assert_eq!(answer["fences"], json!(["between"]), "the course keeps out of it");
    assert!(answer["notes"].to_string().contains("straight way home"), "{}", answer["notes"]);
    let mission: Value = serde_json::from_slice(&place.read("missions/town-1.plan")).unwrap();
    let exported: Vec<&Value> =
        mission["mission"]["items"].as_array().unwrap().iter().filter(|item| item["command"] == 16).collect();
    let flown = place.json(&[&["fly", "out/plan.json", "--dry-run"], &words[..]].concat());
    let flown: Vec<&Value> = flown["items"].as_array().unwrap().iter().filter(|item| item["command"] == 16).collect();
    assert_eq!(flown.len(), exported.len());
    assert!(flown.len() > plan["waypoints"].as_array().unwrap().len() + 4, "{} waypoints", flown.len());
    for (item, exported) in flown.iter().zip(&exported) {
        let near = |value: &Value, degrees: &Value| (value.as_f64().unwrap() * 1e-7 - degrees.as_f64().unwrap()).abs() < 1e-7;
        assert!(near(&item["x"], &exported["params"][4]) && near(&item["y"], &exported["params"][5]), "{item} and {exported}");
    }
    // Without the scene nothing is known of structures, and that is said.
    std::fs::rename(place.path("town.geojson"), place.path("moved.geojson")).unwrap();
    let unaware = place.json(&["fly", "out/plan.json", "--dry-run"]);
    assert!(unaware["notes"].to_string().contains("the scene is not known"), "{unaware}");
    let aware = place.json(&["fly", "out/plan.json", "--dry-run", "--scene", "moved.geojson"]);
    assert!(!aware["notes"].to_string().contains("the scene is not known"), "{}", aware["notes"]);
}

#[test]
fn a_plan_is_exported_and_flown_with_the_settings_that_it_was_made_with() {
    let place = Place::new();
    let scene = place.scene();
    let settings = "[flight]\nsafety_distance_m = 2.0\n[[flight.no_fly]]\nname = \"aside\"\n\
                    outline_m = [[400.0, 0.0], [440.0, 0.0], [440.0, 40.0]]\nfloor_m = 0.0\nceiling_m = 500.0\n";
    std::fs::write(place.path("own.toml"), settings).unwrap();
    let made = ["--rig", "phantom4-rtk", "--method", "paper", "--iterations", "60", "--seed", "2", "--config", "own.toml"];
    place.json(&[&["plan", &scene, "--out", "out"], &made[..]].concat());
    let export = ["export", "out/plan.json", "--to", "qgc", "--to", "kml"];
    let known = place.json(&[&export[..], &["--out", "known"]].concat());
    let told = place.json(&[&export[..], &["--out", "told", "--config", "own.toml"]].concat());
    assert_eq!(known["fences"], json!(["aside"]));
    assert_eq!((&known["transit_m"], &known["home"], &known["notes"]), (&told["transit_m"], &told["home"], &told["notes"]));
    assert!(place.read("known/town-1.plan") == place.read("told/town-1.plan"));
    let flown = place.json(&["fly", "out/plan.json", "--dry-run"]);
    assert_eq!(flown["items"], place.json(&["fly", "out/plan.json", "--dry-run", "--config", "own.toml"])["items"]);

    // A plan of a daemon does not say with what it was made.
    let guessed = changed(&place, "guessed", |_| {});
    let mut run: Value = serde_json::from_slice(&place.read("guessed/run.json")).unwrap();
    run["settings"] = Value::Null;
    std::fs::write(place.path("guessed/run.json"), run.to_string()).unwrap();
    let guesses = |answer: &Value| answer["notes"].to_string().contains("what settings the plan was made with is not known");
    assert!(!guesses(&known) && guesses(&place.json(&["export", &guessed, "--to", "qgc", "--out", "guessed"])));
    assert!(!guesses(&flown) && guesses(&place.json(&["fly", &guessed, "--dry-run"])));

    // Without the scene a map does not know the ground.
    std::fs::rename(place.path("town.geojson"), place.path("moved.geojson")).unwrap();
    let map = |words: &[&str]| {
        let answer = place.json(&[&["export", "out/plan.json", "--to", "kml", "--out", "map"], words].concat());
        answer["notes"].to_string().contains("the scene's zero")
    };
    assert!(map(&[]) && !map(&["--altitude", "absolute"]) && !map(&["--scene", "moved.geojson"]));
}
