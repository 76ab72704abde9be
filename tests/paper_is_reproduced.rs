//! `overfly reproduce` gives all tables with the paper's rows beside ours, the same on every run, and says what it lacks.

mod program;
mod support;

use std::collections::BTreeMap;

use overfly::camera::Rig;
use overfly::planner::{Method, PlanOptions, StopToken, plan};
use overfly::quality::{self, Truth, Which};
use overfly::reproduction::{Grid, Rival, completeness_percent, match_completeness, match_goal};
use overfly::search::Problem;
use overfly::trajectory::evaluate::sightings;
use overfly::trajectory::plan::Plan;
use overfly::trajectory::select::ranking;
use program::{Place, stderr, stdout};
use serde_json::Value;
use support::{session, small_block, small_settings, snapshot};

/// Rows of the paper and of ours in each table, where the folder of scenes lacks delfshaven.
const ROWS: [(&str, usize, usize); 11] = [
    ("table1", 4, 5),
    ("table2-heights", 3, 3),
    ("table2-boundaries", 4, 4),
    ("table3", 12, 8),
    ("table4", 4, 2),
    ("table5", 4, 2),
    ("equal", 4, 6),
    ("fig9", 0, 9),
    ("fig10", 1, 8),
    ("convergence", 0, 8),
    ("pareto", 0, 11),
];

/// A place with a folder of scenes that holds small towns instead of two of the real ones.
fn place_with_scenes() -> Place {
    let place = Place::new();
    let town = place.scene();
    for name in ["nihonbashi", "manhattan"] {
        std::fs::create_dir_all(place.path("scenes").join(name)).unwrap();
        std::fs::copy(place.path(&town), place.path("scenes").join(name).join("buildings.geojson")).unwrap();
    }
    place
}

fn reproduce(place: &Place, threads: &str, words: &[&str]) -> std::process::Output {
    let words = [&["reproduce", "--quick", "--scenes", "scenes"], words].concat();
    let output = place.command(&words).env("RAYON_NUM_THREADS", threads).output().unwrap();
    assert!(output.status.success(), "{}{}", stdout(&output), stderr(&output));
    output
}

fn json(place: &Place, folder: &str) -> Value {
    serde_json::from_slice(&place.read(&format!("{folder}/reproduction.json"))).unwrap()
}

/// What stands in a column of the first row of a table by the given hand.
fn first<'a>(table: &'a Value, by: &str, column: &str) -> &'a Value {
    let row = table["rows"].as_array().unwrap().iter().find(|row| row["by"] == by).unwrap();
    &row["cells"][column]
}

#[test]
fn a_quick_run_gives_all_tables_with_the_paper_s_rows_and_is_the_same_again() {
    let place = place_with_scenes();
    let output = reproduce(&place, "1", &["--out", "first"]);
    reproduce(&place, "3", &["--out", "second"]);
    let [mut first_run, mut second_run] = ["first", "second"].map(|folder| json(&place, folder));

    let tables: BTreeMap<String, Value> = first_run["tables"]
        .as_array()
        .unwrap()
        .iter()
        .map(|table| (table["key"].as_str().unwrap().to_owned(), table.clone()))
        .collect();
    assert_eq!(tables.len(), ROWS.len());
    for (key, of_the_paper, ours) in ROWS {
        let count = |by: &str| tables[key]["rows"].as_array().unwrap().iter().filter(|row| row["by"] == by).count();
        assert_eq!((count("paper"), count("overfly")), (of_the_paper, ours), "{key}: {}", tables[key]["notes"]);
    }
    assert_eq!(first(&tables["table1"], "paper", "Length ↓ [m]"), 3274.0);
    assert_eq!(first(&tables["table3"], "paper", "Completeness 0.075 m ↑ [%]"), 49.47);
    assert!(first(&tables["table1"], "overfly", "Length ↓ [m]")["median"].as_f64().unwrap() > 0.0);
    assert_eq!(first(&tables["table2-heights"], "overfly", "Flights that collide"), "0 of 1");
    let skipped = "Skipped delfshaven: there is no delfshaven/delfshaven.city.json in the folder of scenes.";
    for key in ["table3", "table4", "table5", "equal", "fig10", "pareto"] {
        assert!(tables[key]["notes"].as_array().unwrap().contains(&skipped.into()), "{key}");
    }
    assert_times_are_compared(&tables["equal"], &tables["fig10"]);
    // Beyond the paper, and alone: nobody else waits for it.
    reproduce(&place, "2", &["--out", "refined", "--only", "equal-refined"]);
    let refined = json(&place, "refined")["tables"][0].clone();
    assert_eq!((refined["key"].as_str(), refined["rows"].as_array().map(Vec::len)), (Some("equal-refined"), Some(4)));
    assert_times_are_compared(&refined, &tables["fig10"]);
    assert_eq!(
        first_run["missing_scenes"],
        serde_json::json!(["delfshaven/delfshaven.city.json", "marunouchi/buildings.geojson"])
    );
    let times = &first_run["times"]["tables"][0];
    assert_eq!((times["key"].as_str(), times["rows"].as_array().map(Vec::len)), (Some("planning-time"), Some(5)));
    assert_refined_flights_keep_their_coverage(&first_run["times"]["tables"][1]);
    assert!(stdout(&output).contains("| paper | full Eq. (6) | 2151 | 84 | 384 | 115 |"), "{}", stdout(&output));
    assert!(stderr(&output).contains("table2") && stderr(&output).contains("sampling the truth"), "{}", stderr(&output));

    for run in [&mut first_run, &mut second_run] {
        let members = run.as_object_mut().unwrap();
        assert!(members.remove("machine").is_some() && members.remove("times").is_some());
    }
    assert_eq!(first_run.to_string(), second_run.to_string());
    let figures = |folder: &str| {
        let text = String::from_utf8(place.read(&format!("{folder}/reproduction.md"))).unwrap();
        text.split_once("## Machine and times").unwrap().0.to_owned()
    };
    assert_eq!(figures("first"), figures("second"));
    for name in ["convergence.svg", "fig10.svg", "fig9.svg", "pareto.svg"] {
        let drawing = place.read(&format!("first/{name}"));
        assert!(roxmltree::Document::parse(std::str::from_utf8(&drawing).unwrap()).is_ok(), "{name}");
        assert_eq!(drawing, place.read(&format!("second/{name}")));
    }
    let files = ["convergence.svg", "fig10.svg", "fig9.svg", "pareto.svg", "reproduction.json", "reproduction.md"];
    assert_eq!(place.files("first"), files);
}

/// A refined flight counts only with at least the coverage that the paper's search has reached, and the ratio is that of both times.
fn assert_refined_flights_keep_their_coverage(refined: &Value) {
    assert_eq!(refined["key"], "refined");
    let rows = refined["rows"].as_array().unwrap();
    // Three rigs on three sites, in two times.
    assert_eq!(rows.len(), 2 * 9);
    let mut reached = 0;
    for cells in rows.iter().map(|row| &row["cells"]) {
        let figure = |column: &str| cells[column]["median"].as_f64();
        let Some(ours_s) = figure("Profile time, refined ↓ [s]") else {
            assert_eq!(cells["Seeds that reach both"], "0 of 1", "{cells}");
            continue;
        };
        reached += 1;
        assert_eq!(figure("Refined over paper ↓"), figure("Profile time, paper [s]").map(|paper_s| ours_s / paper_s), "{cells}");
        let coverage = |by: &str| figure(&format!("Coverage of capturable, {by} [%]")).unwrap();
        assert!(coverage("refined") >= coverage("paper"), "{cells}");
    }
    assert!(reached > 0);
}

#[test]
fn a_refined_flight_of_equal_completeness_is_enough_wherever_it_says_so() {
    let mut settings = small_settings();
    settings.quality.samples = 600;
    (settings.baseline.zhou_rounds, settings.baseline.tour_kicks) = (1, 5);
    let (rig, stop) = (Rig::preset("phantom4-rtk").unwrap(), StopToken::default());
    let mut reached = 0;
    for seed in 1..=3 {
        let scene = small_block(seed);
        let snapshot = snapshot(&session(scene.clone(), &settings));
        let truth = Truth::new(scene, &settings, &stop).unwrap();
        let assess = |plan: &Plan| quality::assess(&truth, &quality::shots(plan, Which::All), &settings, &stop).unwrap();
        let zhou = PlanOptions::new(rig.clone(), Method::Zhou, seed);
        let theirs = assess(&plan(&snapshot, &settings, &zhou, &stop, &mut |_| {}).unwrap());
        let rival = Rival { snapshot: &snapshot, settings: &settings, rig: &rig, truth: &truth, assessing: &settings };
        let found = match_goal(&rival, 12, seed, &theirs, &stop).unwrap();
        // The plan is the one that its goal gives, and its Completeness its own.
        let options = PlanOptions {
            iterations: Some(12),
            goal_percent: Some(0.0),
            matched_percent: Some(found.plan.matched_goal_percent),
            ..PlanOptions::new(rig.clone(), Method::Refined, seed)
        };
        assert_eq!(plan(&snapshot, &settings, &options, &stop, &mut |_| {}).unwrap(), found.plan);
        assert_eq!(assess(&found.plan), found.quality);
        assert_eq!(completeness_percent(&found.quality) >= completeness_percent(&theirs), found.is_reached);
        reached += u32::from(found.is_reached);
    }
    assert!(reached > 0);
}

/// Ratios are those of our time and theirs of the same row, and theirs is that of the flight in Fig. 10.
fn assert_times_are_compared(equal: &Value, fig10: &Value) {
    let rows = |table: &Value| -> Vec<Value> {
        let rows = table["rows"].as_array().unwrap().iter();
        rows.filter(|row| row["by"] == "overfly").map(|row| row["cells"].clone()).collect()
    };
    let mut reached = 0;
    for cells in rows(equal) {
        let figure = |column: &str| cells[column]["median"].as_f64();
        let theirs_s = figure("Their profile time [s]").unwrap();
        let is_same = |other: &&Value| (&other["Scene"], &other["Method"]) == (&cells["Scene"], &cells["Against"]);
        let drawn = rows(fig10).iter().find(is_same).unwrap()["Profile time [s]"]["median"].as_f64();
        assert_eq!(Some(theirs_s), drawn, "{cells}");
        let ours_s = figure("Our profile time ↓ [s]");
        assert_eq!(figure("Our time over theirs ↓"), ours_s.map(|ours_s| ours_s / theirs_s), "{cells}");
        // Four times sixteen steps of one iteration, in a quick run.
        let tried = if cells["Ours by"] == "paper" { " by K = 64" } else { "" };
        let reaching = format!("{} of 1{tried}", u8::from(ours_s.is_some()));
        assert_eq!(cells["Seeds that reach it"], reaching.as_str());
        if let Some(ours_percent) = figure("Our Completeness 0.050 m [%]") {
            assert!(ours_percent >= figure("Their Completeness 0.050 m [%]").unwrap(), "{cells}");
            reached += 1;
        }
    }
    assert!(reached > 0);
}

#[test]
fn our_flight_of_equal_completeness_is_enough_and_the_step_before_it_is_not() {
    let mut settings = small_settings();
    settings.quality.samples = 600;
    (settings.baseline.zhou_rounds, settings.baseline.tour_kicks) = (1, 5);
    let (rig, stop) = (Rig::preset("phantom4-rtk").unwrap(), StopToken::default());
    let grid = Grid { step: 4, points: 40 };
    let mut beyond_the_first_step = 0;
    for seed in 1..=3 {
        let scene = small_block(seed);
        let snapshot = snapshot(&session(scene.clone(), &settings));
        let truth = Truth::new(scene, &settings, &stop).unwrap();
        let completeness = |plan: &Plan| {
            let quality = quality::assess(&truth, &quality::shots(plan, Which::All), &settings, &stop).unwrap();
            (completeness_percent(&quality), quality)
        };
        let zhou = PlanOptions::new(rig.clone(), Method::Zhou, seed);
        let (wanted, theirs) = completeness(&plan(&snapshot, &settings, &zhou, &stop, &mut |_| {}).unwrap());
        let rival = Rival { snapshot: &snapshot, settings: &settings, rig: &rig, truth: &truth, assessing: &settings };
        let found = match_completeness(&rival, grid, seed, &theirs, &stop).unwrap();

        let mut endless = settings.clone();
        endless.coverage.goal_percent = 100.0;
        let ours = |iterations: u32| {
            let options = PlanOptions { iterations: Some(iterations), ..PlanOptions::new(rig.clone(), Method::Paper, seed) };
            plan(&snapshot, &endless, &options, &stop, &mut |_| {}).unwrap()
        };
        let at_k = ours(found.iterations);
        assert_eq!((&at_k, at_k.convergence.len()), (&found.plan, found.iterations as usize), "the goal ends no search");
        assert_eq!((completeness(&at_k).0 >= wanted, found.iterations % grid.step), (found.is_reached, 0));
        if found.is_reached && found.iterations > grid.step {
            assert!(completeness(&ours(found.iterations - grid.step)).0 < wanted, "seed {seed}");
            beyond_the_first_step += 1;
        }
        // A grid that ends before: what is found there is the flight after its most iterations.
        if found.iterations > grid.step {
            let short = match_completeness(&rival, Grid { points: 1, ..grid }, seed, &theirs, &stop).unwrap();
            assert_eq!((short.is_reached, short.iterations), (false, grid.step));
        }
    }
    assert!(beyond_the_first_step > 0);
}

#[test]
fn only_what_is_asked_for_is_made() {
    let place = place_with_scenes();
    reproduce(&place, "2", &["--only", "sweep,table1", "--out", "out"]);
    let found = json(&place, "out");
    let keys: Vec<&str> = found["tables"].as_array().unwrap().iter().map(|table| table["key"].as_str().unwrap()).collect();
    assert_eq!(keys, ["table1", "sweep"]);
    // Twelve values on two scenes of three.
    assert_eq!(found["tables"][1]["rows"].as_array().map(Vec::len), Some(24));
    assert_eq!(found["command"], "overfly reproduce --only sweep,table1 --quick --scenes SCENES --out DIR");
    assert_eq!(place.files("out"), ["reproduction.json", "reproduction.md"]);
}

#[test]
fn a_field_of_a_larger_city_is_larger_and_is_drawn() {
    let place = Place::new();
    reproduce(&place, "2", &["--only", "growth", "--out", "out"]);
    let found = json(&place, "out");
    let table = &found["times"]["tables"][0];
    let rows: Vec<&Value> = table["rows"].as_array().unwrap().iter().map(|row| &row["cells"]).collect();
    assert_eq!((table["key"].as_str(), rows.len()), (Some("growth"), 2));
    let figure = |cells: &Value, column: &str| cells[column].as_f64().unwrap();
    for column in ["Structures", "Samples", "Viewpoints", "Field [MB]"] {
        let [small, large] = [rows[0], rows[1]].map(|cells| figure(cells, column));
        assert!(0.0 < small && small < large, "{column}: {small}, {large}");
    }
    assert!(rows.iter().all(|cells| figure(cells, "Build [s]") > 0.0 && figure(cells, "Update after an edit [ms]") > 0.0));
    assert_eq!(place.files("out"), ["growth.svg", "reproduction.json", "reproduction.md"]);
}

#[test]
fn sights_are_compared_by_one_measure_and_are_the_same_again() {
    let place = place_with_scenes();
    reproduce(&place, "1", &["--only", "sight", "--out", "first"]);
    reproduce(&place, "3", &["--only", "sight", "--out", "second"]);
    let [first_run, second_run] = ["first", "second"].map(|folder| json(&place, folder)["tables"].clone());
    assert_eq!(first_run, second_run);
    let table = &first_run[0];
    assert_eq!((table["key"].as_str(), first_run.as_array().map(Vec::len)), (Some("sight"), Some(1)));
    let rows: Vec<&Value> = table["rows"].as_array().unwrap().iter().map(|row| &row["cells"]).collect();
    // The paper's, then three sights, two half-angles and two methods on the block: delfshaven is missing.
    assert_eq!(rows.len(), 1 + 3 * 2 * 2);
    assert_eq!((table["rows"][0]["by"].as_str(), &rows[0]["Length ↓ [m]"]), (Some("paper"), &Value::from(2151.0)));
    let pixel_rad = Rig::preset("phantom4-rtk").unwrap().coarsest_pixel_rad();
    for (place, cells) in rows[1..].iter().enumerate() {
        let range_m = [80.0, 120.0, 160.0][place / 4];
        assert_eq!((&cells["Range [m]"], &cells["Full disk up to [m]"]), (&range_m.into(), &(range_m / 2.0).into()), "{cells}");
        let gsd_cm = cells["Ground sampling distance at the range [cm]"].as_f64().unwrap();
        assert!((gsd_cm - range_m * pixel_rad * 100.0).abs() < 1e-9, "{cells}");
        assert_eq!(cells["theta0 [deg]"], [25.0, 28.0][place / 2 % 2]);
        assert_eq!(cells["Method"], ["Ours", "Refined"][place % 2]);
        let is_at_goal = cells["Coverage of capturable [%]"]["median"].as_f64().unwrap() >= 95.0;
        assert_eq!(cells["Flights at the goal"], format!("{} of 1", u8::from(is_at_goal)));
    }
    assert_capturable_grows_with_sight(&rows[1..]);
    let notes = table["notes"].as_array().unwrap();
    let skipped = "Skipped delfshaven: there is no delfshaven/delfshaven.city.json in the folder of scenes.";
    assert!(notes.contains(&skipped.into()));
    let of_searches = |note: &&Value| note.as_str().unwrap().starts_with("Searches of the paper's method over block");
    assert_eq!(notes.iter().filter(of_searches).count(), 2, "one for each half-angle");
}

/// Each sight keeps the viewpoints of the one before, because the lattice stays, and its disks contain the smaller ones.
fn assert_capturable_grows_with_sight(rows: &[&Value]) {
    let capturable = |cells: &Value| cells["Capturable [%]"]["median"].as_f64().unwrap();
    for (nearer, farther) in rows.iter().zip(&rows[4..]) {
        assert!(capturable(farther) >= capturable(nearer), "{farther} after {nearer}");
    }
    assert!(capturable(rows[11]) > capturable(rows[0]));
}

#[test]
fn unknown_parts_and_numbers_of_seeds_are_refused_before_anything_is_made() {
    let place = Place::new();
    let message = place.fails(2, "usage", &["reproduce", "--only", "table1,table7", "--out", "out"]);
    assert!(message.contains("\"table7\"") && message.contains("table5, equal, equal-refined, fig9"), "{message}");
    let message = place.fails(2, "usage", &["reproduce", "--seeds", "0", "--out", "out"]);
    assert!(message.contains("from 1 to 100"), "{message}");
    assert!(!place.path("out").exists());
}

#[test]
fn a_ranking_holds_every_image_once_and_begins_with_the_selected_ones() {
    let settings = small_settings();
    for (rig, seed) in [("m300-oblique", 3), ("phantom4-rtk", 4)] {
        let rig = Rig::preset(rig).unwrap();
        let snapshot = snapshot(&session(small_block(seed), &settings));
        let options = PlanOptions { iterations: Some(60), ..PlanOptions::new(rig.clone(), Method::Paper, seed) };
        let plan = plan(&snapshot, &settings, &options, &StopToken::default(), &mut |_| {}).unwrap();
        let problem = Problem::new(&snapshot, &settings, rig);
        let seen = sightings(&snapshot, &snapshot.disks, &plan.images, &StopToken::default()).unwrap();
        let order = ranking(&problem, &seen, plan.images.len());
        let selected = plan.selected_images();
        assert!(0 < selected && selected < plan.images.len());
        assert!(order[..selected].iter().all(|&image| plan.images[image].selected));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..plan.images.len()).collect::<Vec<_>>());
        // Each image gains at least as much as any later one would have at its place.
        let information = |images: &[usize]| seen.capture(&problem, |image| images.contains(&(image as usize))).information;
        for place in 0..selected.min(12) {
            let with = |image: usize| information(&[&order[..place], &[image]].concat());
            assert!((0..plan.images.len()).all(|other| with(other) <= with(order[place])), "place {place}");
        }
    }
}
