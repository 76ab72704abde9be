use geo::polygon;
use proptest::prelude::*;

use super::*;
use crate::scene::{BlockSettings, Triangle, generate_block};
use crate::settings::Settings;

/// A generated block in which every third structure is a mesh.
fn block() -> Scene {
    let mut scene = generate_block(&BlockSettings { buildings: 12, extent_m: [120.0, 120.0], ..Default::default() });
    for structure in scene.structures.iter_mut().step_by(3) {
        let shape = Shape::Mesh { triangles: structure.triangles() };
        *structure = Arc::new(Structure { shape, ..Structure::clone(structure) });
    }
    scene
}

fn limits() -> ProxySettings {
    Settings::default().proxy
}

fn corners(structure: &Structure) -> Vec<Point3<f64>> {
    structure.triangles().into_iter().flatten().collect()
}

fn assert_near(a: &Structure, b: &Structure) {
    let (a, b) = (corners(a), corners(b));
    assert_eq!(a.len(), b.len());
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).norm() < 1e-9));
}

fn holds(region: &DirtyRegion, structure: &Structure) -> bool {
    corners(structure).iter().all(|corner| Bounds { min: region.min, max: region.max }.contains(corner))
}

fn tetrahedron([x, y]: [f64; 2], height_m: f64) -> Shape {
    let top_m = height_m.max(2.0);
    let [a, b, c, d] = [[x, y, 0.0], [x + 8.0, y, 0.0], [x, y + 8.0, 0.0], [x, y, top_m]].map(Point3::from);
    // One face looks inwards.
    Shape::Mesh { triangles: vec![[a, b, d], [b, c, d], [a, c, d]] }
}

fn obstacle([x, y]: [f64; 2], height_m: f64) -> Shape {
    Shape::obstacle_box(Point3::new(x, y, height_m / 2.0), [2.0, 3.0, height_m / 2.0], x)
}

fn zone(name: &str, outline: &Polygon<f64>, [floor_m, ceiling_m]: [f64; 2]) -> Edit {
    let outline = outline.clone().into();
    Edit::AddZone { zone: NoFlyZone { name: name.into(), outline, floor_m, ceiling_m, source: ZoneSource::File } }
}

fn edits() -> impl Strategy<Value = (usize, f64, [f64; 2])> {
    (0usize..12, 0.5..80.0f64, prop::array::uniform2(-50.0..50.0f64))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn raise_then_lower_gives_the_scene_back((index, by_m, _) in edits()) {
        let scene = block();
        let id = scene.structures[index].id;
        let (raised, _) = scene.edited(&Edit::Raise { id, by_m }, &limits()).unwrap();
        let top_m = |scene: &Scene| scene.structure(id).unwrap().bounds().max.z;
        prop_assert!((top_m(&raised) - top_m(&scene) - by_m).abs() < 1e-9);
        let (back, _) = raised.edited(&Edit::Lower { id, by_m }, &limits()).unwrap();
        assert_near(scene.structure(id).unwrap(), back.structure(id).unwrap());
    }

    #[test]
    fn an_edit_touches_its_structure_alone((index, by_m, way) in edits()) {
        let scene = block();
        let id = scene.structures[index].id;
        let square = polygon![(x: way[0], y: way[1]), (x: way[0] + 9.0, y: way[1]), (x: way[0], y: way[1] + 9.0)];
        let added = StructureId::of_name("new");
        for (touched, edit) in [
            (id, Edit::Raise { id, by_m }),
            (id, Edit::Remove { id }),
            (id, Edit::Move { id, by_m: way }),
            (added, Edit::add_prism("new", square.clone(), 0.0, 20.0)),
            (added, Edit::Add { name: "new".into(), shape: tetrahedron(way, by_m) }),
            (added, Edit::Add { name: "new".into(), shape: obstacle(way, by_m) }),
            (id, Edit::Replace { id, shape: Shape::Prism { footprint: square.into(), base_m: 1.0, top_m: 20.0 } }),
            (id, Edit::Replace { id, shape: tetrahedron(way, by_m) }),
            (id, Edit::Replace { id, shape: obstacle(way, by_m) }),
        ] {
            let (edited, region) = scene.edited(&edit, &limits()).unwrap();
            prop_assert!(edited.structures.is_sorted_by(|a, b| a.id < b.id));
            for structure in scene.structures.iter().filter(|structure| structure.id != touched) {
                prop_assert!(Arc::ptr_eq(structure, edited.structure(structure.id).unwrap()));
            }
            for state in [&scene, &edited] {
                prop_assert!(state.structure(touched).is_none_or(|structure| holds(&region, structure)));
            }
        }
    }

    #[test]
    fn a_move_there_and_back_gives_the_scene_back((index, _, way) in edits()) {
        let scene = block();
        let id = scene.structures[index].id;
        let (moved, _) = scene.edited(&Edit::Move { id, by_m: way }, &limits()).unwrap();
        let (back, _) = moved.edited(&Edit::Move { id, by_m: way.map(|way| -way) }, &limits()).unwrap();
        assert_near(scene.structure(id).unwrap(), back.structure(id).unwrap());
    }
}

#[test]
fn edits_that_make_no_sense_are_refused() {
    let scene = block();
    let structure = &scene.structures[0];
    let id = structure.id;
    let height_m = structure.bounds().max.z - structure.bounds().min.z;
    let triangle = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 0.0, y: 9.0)];
    let crossing = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 9.0), (x: 9.0, y: 0.0), (x: 0.0, y: 9.0)];
    let line = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 9.0)];
    let infinite = polygon![(x: 0.0, y: 0.0), (x: f64::INFINITY, y: 9.0), (x: 9.0, y: 0.0)];
    let add =
        |name: &str, footprint: &Polygon<f64>, base_m: f64, top_m: f64| Edit::add_prism(name, footprint.clone(), base_m, top_m);
    let mesh = |triangles: Vec<Triangle>| Edit::Add { name: "a".into(), shape: Shape::Mesh { triangles } };
    let corner = Point3::new;
    let box_at = |x: f64, z: f64| Edit::Add { name: "a".into(), shape: Shape::obstacle_box(corner(x, 0.0, z), [2.0; 3], 0.3) };
    let tall = Shape::Prism { footprint: triangle.clone().into(), base_m: 0.0, top_m: 2000.0 };
    let refused = [
        Edit::Remove { id: StructureId(1) },
        Edit::Raise { id, by_m: f64::NAN },
        Edit::Raise { id, by_m: 0.0 },
        Edit::Raise { id, by_m: -1.0 },
        Edit::Raise { id, by_m: 1e4 },
        Edit::Lower { id, by_m: height_m - 0.9 },
        Edit::Lower { id, by_m: f64::INFINITY },
        Edit::Move { id, by_m: [f64::NAN, 0.0] },
        Edit::Move { id, by_m: [1e9, 0.0] },
        add(" ", &triangle, 0.0, 10.0),
        add(&structure.name, &triangle, 0.0, 10.0),
        add("a", &triangle, -1.0, 10.0),
        add("a", &triangle, 5.0, 5.5),
        add("a", &triangle, 0.0, 2000.0),
        add("a", &triangle, f64::NAN, 10.0),
        add("a", &crossing, 0.0, 10.0),
        add("a", &line, 0.0, 10.0),
        add("a", &infinite, 0.0, 10.0),
        add("a", &Polygon::empty(), 0.0, 10.0),
        mesh(vec![]),
        mesh(vec![[corner(0.0, 0.0, 9.0), corner(5.0, 0.0, 9.0), corner(9.0, 0.0, 9.0)]]),
        mesh(vec![[corner(0.0, 0.0, 0.5), corner(5.0, 0.0, 0.5), corner(0.0, 5.0, 0.5)]]),
        mesh(vec![[corner(0.0, 0.0, 9.0), corner(5.0, f64::NAN, 9.0), corner(0.0, 5.0, 9.0)]]),
        mesh(vec![[corner(0.0, 0.0, 9.0), corner(1e6, 0.0, 9.0), corner(0.0, 5.0, 9.0)]]),
        mesh(vec![[corner(0.0, 0.0, 9.0), corner(5.0, 0.0, 2000.0), corner(0.0, 5.0, 9.0)]]),
        box_at(f64::NAN, 9.0),
        box_at(1e6, 9.0),
        box_at(0.0, -1.0),
        box_at(0.0, 2000.0),
        Edit::Add { name: "a".into(), shape: Shape::obstacle_box(corner(0.0, 0.0, 9.0), [2.0, 0.0, 2.0], 0.0) },
        Edit::Replace { id, shape: tall },
        Edit::Replace { id: StructureId(1), shape: tetrahedron([0.0, 0.0], 9.0) },
        zone(" ", &triangle, [0.0, 9.0]),
        zone("z", &triangle, [9.0, 9.0]),
        zone("z", &triangle, [-9.0, 0.0]),
        zone("z", &triangle, [f64::NAN, 9.0]),
        zone("z", &triangle, [0.0, f64::INFINITY]),
        zone("z", &crossing, [0.0, 9.0]),
        zone("z", &line, [0.0, 9.0]),
        zone("z", &infinite, [0.0, 9.0]),
        zone("z", &Polygon::empty(), [0.0, 9.0]),
        Edit::RemoveZone { name: "nowhere".into() },
    ];
    for edit in refused {
        let error = scene.edited(&edit, &limits()).expect_err(&format!("{edit:?}"));
        assert!(error.to_string().len() > 30, "{error}");
    }
    let alone = Scene { structures: scene.structures[..1].to_vec(), ..scene.clone() };
    let (beside, _) = alone.edited(&box_at(0.0, 9.0), &limits()).unwrap();
    for scene in [alone, beside] {
        for edit in [Edit::Remove { id }, Edit::Replace { id, shape: obstacle([0.0, 0.0], 3.0) }] {
            assert!(matches!(scene.edited(&edit, &limits()), Err(EditError::LastStructure { .. })), "obstacles do not count");
        }
    }
    assert!(scene.edited(&Edit::Lower { id, by_m: height_m - 1.0 }, &limits()).is_ok());
}

#[test]
fn the_limits_are_those_of_the_settings() {
    let scene = block();
    let id = scene.structures[0].id;
    let high = ProxySettings { max_height_m: 2000.0, max_extent_m: 60_000.0, ..limits() };
    for edit in [Edit::Raise { id, by_m: 1500.0 }, Edit::Move { id, by_m: [50_000.0, 0.0] }] {
        let error = scene.edited(&edit, &limits()).unwrap_err();
        assert!(error.to_string().contains("`proxy.max_"), "{error}");
        assert!(scene.edited(&edit, &high).is_ok());
    }
}

#[test]
fn structures_are_found_by_name_and_by_id() {
    let scene = block();
    let structure = &scene.structures[3];
    assert_eq!(scene.find(&structure.name), Some(structure.id));
    assert_eq!(scene.find(&structure.id.to_string()), Some(structure.id));
    assert_eq!(scene.find("nowhere"), None);
    assert_eq!(scene.find("00000000000000ff"), None);
    assert_eq!(scene.find("+123456789abcdef"), None);
}

#[test]
fn a_mesh_is_put_in_order_as_that_of_a_file() {
    let scene = block();
    let (edited, _) = scene.edited(&Edit::Add { name: "a".into(), shape: tetrahedron([50.0, 50.0], 9.0) }, &limits()).unwrap();
    let structure = edited.structure(edited.find("a").unwrap()).unwrap();
    assert!(structure.contains(&Point3::new(52.0, 52.0, 1.0)), "all its faces look outwards");
}

#[test]
fn an_obstacle_is_a_turned_box_above_the_ground() {
    let shape = Shape::obstacle_box(Point3::new(10.0, 20.0, 1.0), [8.0, 2.0, 6.0], std::f64::consts::FRAC_PI_2);
    let structure = Structure { id: StructureId(1), name: "a".into(), shape };
    let bounds = structure.bounds();
    assert!(
        (bounds.min - Point3::new(9.0, 16.0, 0.0)).norm() < 1e-9 && (bounds.max - Point3::new(11.0, 24.0, 4.0)).norm() < 1e-9
    );
    assert!(structure.contains(&Point3::new(10.0, 23.0, 3.0)) && !structure.is_captured());
}

#[test]
fn a_zone_comes_and_goes_and_leaves_the_structures_alone() {
    let scene = block();
    // Clockwise and closed: neither matters.
    let outline = polygon![(x: 0.0, y: 0.0), (x: 0.0, y: 9.0), (x: 9.0, y: 0.0), (x: 0.0, y: 0.0)];
    let (barred, region) = scene.edited(&zone("pad", &outline, [5.0, f64::MAX]), &limits()).unwrap();
    assert_eq!((barred.zones[0].source, barred.structures == scene.structures), (ZoneSource::Edit, true));
    assert_eq!((region.min, region.max.z), (Point3::new(0.0, 0.0, 5.0), f64::MAX));
    assert!(matches!(barred.edited(&zone("pad", &outline, [0.0, 9.0]), &limits()), Err(EditError::ZoneTaken { .. })));
    let error = barred.edited(&Edit::RemoveZone { name: "bad".into() }, &limits()).unwrap_err().to_string();
    assert!(error.contains("\"pad\""), "{error}");
    assert_eq!(barred.edited(&Edit::RemoveZone { name: "pad".into() }, &limits()).unwrap().0, scene);
}
