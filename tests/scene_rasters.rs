//! Scenes from heights: flights over terrain keep their altitudes above it along the whole curve, the terrain hides what is behind it and what is in it, and
//! real surface models and point clouds become towns that can be flown.

mod program;
mod scene_files;
mod support;

use std::sync::{Arc, LazyLock};

use geo::{BoundingRect, Contains, Coord, LineString, MultiPolygon, Point, Polygon};
use nalgebra::Point3;
use overfly::planner::{StopToken, plan};
use overfly::scene::edit::{Edit, EditError};
use overfly::scene::free_space::{FreeSpace, Obstruction};
use overfly::scene::{GroundFile, ImportReport, Scene, Shape, Structure, StructureId, TERRAIN_NAME, Terrain, ground_beside};
use overfly::settings::Settings;
use proptest::prelude::*;
use support::{check_updates, options, real_scene, rig_options, session, small_settings, snapshot};

/// A round hill of 40 m at the origin, on a plain.
fn hill() -> Terrain {
    let (cell_m, corners) = (10.0, 41);
    let at = |index: usize| index as f64 * cell_m - 200.0;
    let height = |k: usize| {
        let share = (at(k % corners).powi(2) + at(k / corners).powi(2)).sqrt() / 100.0;
        40.0 * (1.0 - share * share).max(0.0)
    };
    Terrain::new([-200.0; 2], cell_m, [corners; 2], (0..corners * corners).map(height).collect()).expect("it is a grid")
}

fn structure(name: &str, shape: Shape) -> Arc<Structure> {
    Arc::new(Structure { id: StructureId::of_name(name), name: name.into(), shape })
}

/// A house of 12 x 10 m whose roof is 8 m above the ground at its middle, and which reaches below it.
fn house(name: &str, [x, y]: [f64; 2], terrain: &Terrain) -> Arc<Structure> {
    let ring =
        [(0.0, 0.0), (12.0, 0.0), (12.0, 10.0), (0.0, 10.0), (0.0, 0.0)].map(|(a, b)| Coord { x: x + a - 6.0, y: y + b - 5.0 });
    let footprint = MultiPolygon(vec![Polygon::new(LineString::from(ring.to_vec()), Vec::new())]);
    structure(name, Shape::Prism { footprint, base_m: 0.0, top_m: terrain.height_m(x, y) + 8.0 })
}

/// Houses on the hill and on both sides of it.
fn town_on_a_hill() -> Scene {
    let terrain = hill();
    let places =
        [("top", [0.0, 0.0]), ("slope", [50.0, 10.0]), ("west", [-95.0, 0.0]), ("east", [95.0, 5.0]), ("south", [10.0, -70.0])];
    let mut structures: Vec<_> = places.iter().map(|(name, at)| house(name, *at, &terrain)).collect();
    structures.push(structure(TERRAIN_NAME, Shape::Terrain(terrain.into())));
    structures.sort_by_key(|structure| structure.id);
    Scene { name: "hill".into(), frame: Default::default(), structures, zones: vec![] }
}

fn terrain_of(scene: &Scene) -> &Terrain {
    scene.structures.iter().find_map(|structure| structure.terrain()).expect("it has a terrain")
}

/// The least and the greatest altitude above the terrain along the curve of a plan, and the least distance in a straight line, m.
fn altitudes(plan: &overfly::trajectory::plan::Plan, terrain: &Terrain) -> [f64; 2] {
    let profile = plan.profile().expect("a plan says how it was timed");
    let steps = (profile.duration_s() / 0.02).ceil() as usize;
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for k in 0..=steps {
        let p = profile.at(profile.duration_s() * k as f64 / steps as f64).expect("within the flight").position_m;
        let altitude_m = p.z - terrain.height_m(p.x, p.y);
        range = [range[0].min(altitude_m), range[1].max(altitude_m)];
    }
    range
}

#[test]
fn flights_keep_their_altitudes_above_a_hill_along_the_whole_curve() {
    let mut settings = small_settings();
    settings.flight.altitude_min_m = 18.0;
    settings.flight.legal_ceiling_m = 45.0;
    let snapshot = snapshot(&session(town_on_a_hill(), &settings));
    let terrain = terrain_of(&snapshot.scene);
    for (rig, seed) in [("panoramic", 1), ("phantom4-rtk", 2), ("m300-oblique", 3)] {
        let plan = plan(&snapshot, &settings, &rig_options(rig, seed, 250), &StopToken::default(), &mut |_| {})
            .expect("it can be flown");
        let [least_m, most_m] = altitudes(&plan, terrain);
        println!("{rig}: {} waypoints, {least_m:.2} to {most_m:.2} m above the ground", plan.waypoints.len());
        assert!(plan.waypoints.len() > 3);
        // Arcs keep within two centimetres of chords that keep the altitudes.
        assert!(least_m >= 18.0 - 0.02 && most_m <= 45.0 + 0.02, "{rig}: {least_m} to {most_m} m above the ground");
    }
    // The houses on top and in the valleys are all within reach: a ceiling above z = 0 would leave out the ones on the hill.
    let top = snapshot.scene.structures.iter().position(|structure| structure.name == "top").expect("it is there");
    assert!(snapshot.field().viewpoints.iter().any(|viewpoint| viewpoint.position_m[2] > 45.0 + 10.0));
    assert!(snapshot.field().samples.iter().any(|sample| sample.structure as usize == top && sample.exposed == 1));
}

static FREE: LazyLock<(Scene, FreeSpace)> = LazyLock::new(|| {
    let scene = town_on_a_hill();
    let free = FreeSpace::new(&scene, &Settings::default().flight).expect("there are no zones");
    (scene, free)
});

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, max_global_rejects: 100_000, ..ProptestConfig::default() })]
    #[test]
    fn a_safe_leg_is_safe_at_each_of_its_points(
        a in [-140.0..140.0f64, -110.0..110.0, 0.0..110.0], b in [-140.0..140.0f64, -110.0..110.0, 0.0..110.0],
    ) {
        let ((scene, free), a, b) = (&*FREE, Point3::from(a), Point3::from(b));
        let terrain = terrain_of(scene);
        for p in [a, b] {
            let altitude_m = p.z - terrain.height_m(p.x, p.y);
            prop_assert_eq!(free.is_safe(&p), free.obstruction_at(&p).is_none());
            prop_assert!(!free.is_safe(&p) || (5.0..=120.0).contains(&altitude_m), "{} m", altitude_m);
        }
        prop_assume!(free.is_safe(&a) && free.is_safe(&b));
        prop_assert_eq!(free.is_leg_safe(&a, &b), free.obstruction_between(&a, &b).is_none());
        if free.is_leg_safe(&a, &b) {
            for k in 0..=200 {
                let p = a + (b - a) * (f64::from(k) / 200.0);
                prop_assert!(p.z - terrain.height_m(p.x, p.y) >= 5.0 - 1e-6, "{}", p);
            }
        } else if free.clearance.keeps_distance(&a, &b, 5.0) {
            let is_too_low = matches!(free.obstruction_between(&a, &b), Some(Obstruction::Altitude { .. }));
            prop_assert!(is_too_low, "{:?}", free.obstruction_between(&a, &b));
        }
    }
}

#[test]
fn a_hill_hides_what_is_behind_it_and_what_is_in_it_is_not_demanded() {
    let scene = town_on_a_hill();
    let settings = small_settings();
    let snapshot = snapshot(&session(scene, &settings));
    let clearance = &snapshot.free.clearance;
    let (west, east) = (Point3::new(-130.0, 30.0, 15.0), Point3::new(130.0, 30.0, 15.0));
    assert!(clearance.occluded(&west, &east), "the hill stands between them");
    let up = |p: Point3<f64>| p + nalgebra::Vector3::new(0.0, 0.0, 60.0);
    assert!(!clearance.occluded(&up(west), &up(east)));
    let terrain = terrain_of(&snapshot.scene);
    let (mut buried, mut exposed) = (0, 0);
    for sample in snapshot.field().samples.iter() {
        let [x, y, z] = sample.position_m;
        let depth_m = terrain.height_m(x, y) - z;
        if sample.exposed == 1 {
            exposed += 1;
            assert!(depth_m < 0.2, "a sample {depth_m} m below the ground is demanded");
        } else {
            buried += usize::from(depth_m > 0.0);
        }
    }
    assert!(exposed > 50 && buried > 20, "{exposed} {buried}");
    let row = snapshot.scene.structures.iter().position(|structure| structure.name == TERRAIN_NAME).expect("it is there");
    assert!(snapshot.field().samples.iter().all(|sample| sample.structure as usize != row), "the ground is not captured");
    // Viewpoints stand around the houses and not all over the ground.
    let field = snapshot.field();
    let far = field.viewpoints.iter().filter(|viewpoint| {
        let position = Point3::from(viewpoint.position_m);
        snapshot.scene.structures.iter().filter(|s| s.is_captured()).all(|s| s.bounds().distance_squared(&position) > 26.0 * 26.0)
    });
    assert_eq!(far.count(), 0);
}

#[test]
fn edits_on_a_hill_give_the_field_of_a_rebuild_and_leave_the_ground_alone() {
    let scene = town_on_a_hill();
    let id = StructureId::of_name(TERRAIN_NAME);
    let limits = Settings::default().proxy;
    for edit in [Edit::Raise { id, by_m: 1.0 }, Edit::Remove { id }, Edit::Move { id, by_m: [1.0, 0.0] }] {
        assert!(matches!(scene.edited(&edit, &limits), Err(EditError::Terrain { .. })), "{edit:?}");
    }
    let made = check_updates(scene, &small_settings(), 24, 3);
    assert!(made >= 8, "{made}");
}

#[test]
fn the_model_of_the_ground_is_looked_for_beside_the_surface() {
    for (surface, ground) in [
        ("/a/dsm/town_dsm_0.5m.tif", Some("/a/dsm/town_dtm_0.5m.tif")),
        ("DSM.TIF", Some("DTM.TIF")),
        ("/dsm/town.tif", None),
        ("town_dsm.laz", None),
        ("ändsm.tiff", Some("ändtm.tiff")),
    ] {
        assert_eq!(ground_beside(surface).as_deref(), ground, "{surface}");
    }
}

fn read(file: &str) -> Option<(Scene, ImportReport)> {
    let path = real_scene(file)?;
    let settings = Settings::default();
    let name = path.to_string_lossy().into_owned();
    let bytes = std::fs::read(&path).expect("the scene can be read");
    let ground = ground_beside(&name).and_then(|ground| Some((std::fs::read(&ground).ok()?, ground)));
    let read = match &ground {
        Some((bytes_of_ground, file_name)) => {
            let ground = GroundFile { file_name, bytes: bytes_of_ground, is_found: true };
            overfly::scene::read_over_ground(&name, &bytes, &ground, &settings.proxy, None)
        }
        None => overfly::scene::read(&name, &bytes, &settings.proxy),
    };
    let (scene, report) = read.expect("a real scene can be imported");
    println!("{}", report.summary());
    Some((scene, report))
}

/// How a scene from heights compares with the town's LoD1 model: which share of the model's footprints roofs cover, which share of the roofs lies on
/// them, and the median difference of height over the buildings that are covered, m.
fn compare(scene: &Scene, model: &Scene) -> [f64; 3] {
    let roofs: Vec<(MultiPolygon<f64>, f64)> = scene
        .structures
        .iter()
        .filter(|structure| structure.is_captured())
        .map(|structure| (structure.outlines(), structure.bounds().max.z))
        .collect();
    let altitude_m = |scene: &Scene| scene.frame.origin.expect("it is placed").alt_m;
    let extent = scene.bounds().expect("it has roofs");
    let in_scene = |x: f64, y: f64| {
        let place = model.frame.geodetic_from_local(&Point3::new(x, y, 0.0)).expect("it is placed");
        let p = scene.frame.local_from_geodetic(&place).expect("it is placed");
        Point::new(p.x, p.y)
    };
    let boxes: Vec<_> = roofs.iter().map(|(outline, _)| outline.bounding_rect().expect("it has corners")).collect();
    let roof_at = |p: &Point<f64>| {
        let near = roofs.iter().zip(&boxes).filter(|(_, rect)| rect.contains(p));
        near.filter(|((outline, _), _)| outline.contains(p)).map(|((_, top_m), _)| *top_m).reduce(f64::max)
    };
    let (mut covered, mut all, mut differences) = (0usize, 0usize, Vec::new());
    for building in &model.structures {
        let (outline, bounds) = (building.outlines(), building.bounds());
        let (mut tops, mut own) = (Vec::new(), 0);
        let steps = |from: f64, to: f64| (0..((to - from) / 1.0) as usize + 1).map(move |k| from + k as f64 + 0.5);
        for x in steps(bounds.min.x, bounds.max.x) {
            for y in steps(bounds.min.y, bounds.max.y).filter(|y| outline.contains(&Point::new(x, *y))) {
                let p = in_scene(x, y);
                // The surface model ends before the model of the town does.
                if extent.min.x < p.x() && p.x() < extent.max.x && extent.min.y < p.y() && p.y() < extent.max.y {
                    own += 1;
                    tops.extend(roof_at(&p));
                }
            }
        }
        (covered, all) = (covered + tops.len(), all + own);
        if own > 20 && tops.len() * 2 > own {
            tops.sort_by(f64::total_cmp);
            differences.push((tops[tops.len() / 2] + altitude_m(scene) - bounds.max.z - altitude_m(model)).abs());
        }
    }
    differences.sort_by(f64::total_cmp);
    [covered as f64 / all as f64, differences.len() as f64, differences[differences.len() / 2]]
}

#[test]
fn delft_s_surface_model_and_point_cloud_agree_with_its_lod1_model() {
    let Some((model, _)) = read("delft-ahn3/delft_lod1_terrain.city.json") else { return };
    // The share of the buildings' area that roofs have to cover, and the most that the median of their heights may differ, m. The model's tops are the 90th
    // percentile of their heights, a roof's top the 95th of its own.
    for (file, least_share, most_m) in
        [("delft-ahn3/delft_ahn3_dsm_0.5m.tif", 0.9, 1.0), ("delft-ahn3/delft_ahn3_thinned_0.6m.laz", 0.8, 1.0)]
    {
        let Some((scene, report)) = read(file) else { return };
        let [share, buildings, difference_m] = compare(&scene, &model);
        println!("{file}: {:.1} % of the area, {buildings} buildings, median difference {difference_m:.2} m", 100.0 * share);
        assert!(share >= least_share && difference_m <= most_m && buildings > 80.0, "{share} {buildings} {difference_m}");
        assert_eq!(report.epsg, Some(28992));
        assert!(terrain_of(&scene).range_m()[0].abs() < 1e-9, "the lowest ground is z = 0");
    }
}

#[test]
fn bilbao_s_relief_stays_and_its_roofs_stand_on_it() {
    let Some((scene, report)) = read("bilbao-west/bilbao_west_dsm_2.5m.tif") else { return };
    let terrain = terrain_of(&scene);
    let [low_m, high_m] = terrain.range_m();
    assert!(low_m.abs() < 1e-9 && (70.0..95.0).contains(&high_m), "{low_m} {high_m}");
    assert_eq!(report.epsg, Some(25830));
    let origin = scene.frame.origin.expect("it is placed");
    assert!((origin.lat_deg - 43.31).abs() < 0.1 && (origin.lon_deg + 3.0).abs() < 0.1, "{origin:?}");
    assert!(report.structures > 500 && scene.structures.len() < 18_000, "{}", report.structures);
    let mut above = Vec::new();
    for roof in scene.structures.iter().filter(|structure| structure.is_captured()) {
        let bounds = roof.bounds();
        let ground_m = terrain.range_within_m(&bounds);
        assert!(
            bounds.min.z <= ground_m[0].max(0.0),
            "{} floats at {} m over ground from {} m",
            roof.name,
            bounds.min.z,
            ground_m[0]
        );
        above.push(bounds.max.z - ground_m[0]);
    }
    above.sort_by(f64::total_cmp);
    let median_m = above[above.len() / 2];
    assert!((4.0..25.0).contains(&median_m), "{median_m}");
}

#[test]
fn a_real_surface_model_is_planned_from_the_command_line() {
    let Some(path) = real_scene("delft-ahn3/delft_ahn3_dsm_0.5m.tif") else { return };
    let place = program::Place::new();
    let (scene, ground) =
        (path.to_string_lossy().into_owned(), ground_beside(&path.to_string_lossy()).expect("it is a surface model"));
    let order = ["--method", "paper", "--iterations", "20", "--samples", "300", "--viewpoints", "400"];
    let found = place.run(&[&["plan", &scene, "--out", "found"][..], &order].concat());
    assert!(found.status.success(), "{}", program::stderr(&found));
    let told = program::stderr(&found);
    assert!(told.contains("stands beside the surface model") && told.contains("nothing tells trees from roofs"), "{told}");
    let given = place.run(&[&["plan", &scene, "--dtm", &ground, "--out", "given"][..], &order].concat());
    assert!(given.status.success() && !program::stderr(&given).contains("beside"), "{}", program::stderr(&given));
    assert_eq!(place.read("found/plan.json"), place.read("given/plan.json"));
    let refused = place.run(&["plan", "no-such-scene", "--dtm", &ground]);
    assert!(program::stderr(&refused).contains("--dtm"), "{}", program::stderr(&refused));
}

#[test]
fn a_flight_over_a_real_surface_model_keeps_its_altitudes() {
    let Some((scene, _)) = read("delft-ahn3/delft_ahn3_thinned_0.6m.laz") else { return };
    let mut settings = Settings::default();
    (settings.surface.samples, settings.field.viewpoints, settings.surface.max_spacing_m) = (400, 400, 40.0);
    settings.flight.altitude_min_m = 22.0;
    let snapshot = snapshot(&session(scene, &settings));
    let plan = plan(&snapshot, &settings, &options(1, 100), &StopToken::default(), &mut |_| {}).expect("it can be flown");
    let [least_m, most_m] = altitudes(&plan, terrain_of(&snapshot.scene));
    assert!(plan.waypoints.len() > 5 && least_m >= 22.0 - 0.02 && most_m <= 120.02, "{least_m} {most_m}");
}

/// A raster of 80 x 80 m with heights by column and row.
fn raster(height: impl Fn(u32, u32) -> f32) -> Vec<u8> {
    scene_files::raster(80, height)
}

#[test]
fn the_daemon_reads_a_surface_model_over_its_ground_and_updates_it() {
    let place = program::Place::new();
    let slope = |column: u32| 3.0 + 0.15 * column as f32;
    let town = |house_m: f32| {
        raster(move |column, row| {
            slope(column) + if (20..40).contains(&column) && (30..50).contains(&row) { house_m } else { 0.0 }
        })
    };
    let ground = raster(|column, _| slope(column));
    std::fs::write(place.path("surface.tif"), town(9.0)).expect("it can be written");
    std::fs::write(place.path("taller_dsm.tif"), town(12.0)).expect("it can be written");
    std::fs::write(place.path("ground.tif"), &ground).expect("it can be written");
    std::fs::write(place.path("taller_dtm.tif"), &ground).expect("it can be written");
    let _daemon = place.serve(&[]);
    let loaded = place.json(&["load", "surface.tif", "--dtm", "ground.tif", "--name", "town"]);
    let told = loaded["import"]["notes"].to_string();
    assert!(told.contains("ground.tif") && !told.contains("guessed") && !told.contains("beside"), "{told}");
    let structures = place.json(&["status", "town"])["structures"].to_string();
    assert!(structures.contains("roof-001") && structures.contains("\"terrain\""), "{structures}");
    let refused = place.run(&["edit", "town", "remove", "terrain", "--no-wait"]);
    assert!(program::stderr(&refused).contains("ground of the scene"), "{}", program::stderr(&refused));
    let updated = place.json(&["update", "town", "taller_dsm.tif", "--no-wait"]);
    let changes = updated["changes"].to_string();
    assert!(changes.contains("roof-001") && !changes.contains("terrain"), "{updated}");
    let missing = place.run(&["load", "surface.tif", "--dtm", "no-ground.tif"]);
    assert!(!missing.status.success() && program::stderr(&missing).contains("no-ground.tif"), "{}", program::stderr(&missing));
    let wrong = place.run(&["load", &place.scene(), "--dtm", "ground.tif"]);
    assert!(program::stderr(&wrong).contains("no surface model"), "{}", program::stderr(&wrong));
    let flat = place.run(&["degrade", "surface.tif", "--out", "flat.geojson"]);
    assert!(program::stderr(&flat).contains("flat ground"), "{}", program::stderr(&flat));
}
