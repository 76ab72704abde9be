//! The field against brute force, and after edits against a field built from the edited scene.

mod support;

use std::sync::Arc;

use geo::polygon;
use nalgebra::{Point3, Vector3};
use overfly::coverage::{DiskModel, SampleFrame};
use overfly::planner::StopToken;
use overfly::scene::edit::Edit;
use overfly::scene::{
    BlockSettings, NoFlyZone, Scene, Shape, Structure, StructureId, TERRAIN_NAME, Terrain, Triangle, ZoneSource, generate_block,
};
use overfly::session::FieldError;
use overfly::settings::Settings;
use overfly_table::{Block, FieldTable, Segment, TableMemory};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;
use support::{check_updates, crosses, forgotten, random_edit, session, small_block, small_settings, snapshot, snapshot_after};

fn triangles(scene: &Scene) -> Vec<Triangle> {
    scene.structures.iter().flat_map(|structure| structure.triangles()).collect()
}

fn bit(field: &FieldTable, viewpoint: usize, sample: usize) -> bool {
    field.row(viewpoint).sees(sample)
}

#[test]
fn visibility_bits_and_ceilings_agree_with_every_ray_against_every_triangle() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(3), &settings));
    let (field, triangles) = (snapshot.field(), triangles(&snapshot.scene));
    let disks = DiskModel::new(&settings.coverage);
    let mut seen = 0;
    for (i, row) in field.samples.iter().enumerate() {
        let sample = SampleFrame::new(row.position_m.into(), row.normal.into());
        let end = sample.position + sample.normal * settings.surface.exposure_offset_m;
        let mut union = 0u128;
        for (j, viewpoint) in field.viewpoints.iter().enumerate() {
            let view = Point3::from(viewpoint.position_m);
            let visible = row.exposed == 1 && disks.faces(&sample, &view) && !triangles.iter().any(|t| crosses(&view, &end, t));
            assert_eq!(bit(&field, j, i), visible, "viewpoint {j} and sample {i}");
            if visible {
                union |= disks.mask(&sample, &view);
                seen += 1;
            }
        }
        assert_eq!(u32::from(field.ceilings[i]), union.count_ones(), "ceiling of sample {i}");
    }
    assert!(seen > 1000, "the test compares something: {seen} visible pairs");
}

#[test]
fn tables_and_segments_are_written_whole_whatever_the_memory_held() {
    let mut scene = small_block(6);
    let terrain = Terrain::new([-80.0, -80.0], 20.0, [9, 9], (0..81).map(|k| f64::from(k % 5)).collect()).unwrap();
    let id = scene.structures.iter().map(|structure| structure.id).max().unwrap();
    let shape = Shape::Terrain(terrain.into());
    scene.structures.push(Arc::new(Structure { id: StructureId(id.0 + 1), name: TERRAIN_NAME.into(), shape }));
    let outline = polygon![(x: 70.0, y: 70.0), (x: 90.0, y: 70.0), (x: 90.0, y: 90.0)].into();
    scene.zones.push(NoFlyZone { name: "pad".into(), outline, floor_m: 0.0, ceiling_m: 60.0, source: ZoneSource::File });
    let session = session(scene, &small_settings());
    let written_over = |word: u64| {
        let held = |count: usize| vec![Block([word; 8]); count];
        let place = |count: usize, write: &dyn Fn(&mut [Block])| {
            let mut blocks = held(count);
            write(&mut blocks);
            Ok::<Arc<dyn TableMemory>, FieldError>(Arc::new(blocks))
        };
        let stop = StopToken::default();
        let findings = session.survey(&stop).unwrap().build(&place, &stop).unwrap();
        let mut table = held(findings.blocks());
        findings.write(&mut table);
        let segments: Vec<Vec<Block>> = findings.segments().iter().map(|segment| segment.memory().blocks().to_vec()).collect();
        (table, segments)
    };
    let (table, segments) = written_over(u64::MAX);
    assert!(table.len() > 100 && segments.len() > 1);
    assert!((table, segments) == written_over(0x0123_4567_89ab_cdef), "something is left of what the memory held");
}

#[test]
fn samples_lie_on_their_structures_and_their_areas_add_up() {
    let settings = small_settings();
    let snapshot = snapshot(&session(small_block(4), &settings));
    let field = snapshot.field();
    for (structure, row) in snapshot.scene.structures.iter().zip(field.structures) {
        let own = &field.samples[row.first_sample as usize..(row.first_sample + row.samples) as usize];
        let area: f64 = structure.triangles().iter().map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0).sum();
        let sampled: f64 = own.iter().map(|sample| sample.area_mm2 as f64 / 1e6).sum();
        assert!((sampled / area - 1.0).abs() < 1e-3, "{}: {sampled} of {area} m^2", structure.name);
        for sample in own {
            let (p, n) = (Point3::from(sample.position_m), Vector3::from(sample.normal));
            assert!(!structure.contains(&(p + n * 0.05)) && structure.contains(&(p - n * 0.05)), "{}: {p} {n}", structure.name);
        }
    }
    let exposed = field.samples.iter().filter(|sample| sample.exposed == 1).count() as f64;
    // The target, or more where they would be too far apart.
    let spacing_m = field.facts.sample_spacing_m;
    let target = f64::from(settings.surface.samples).max(exposed * (spacing_m / settings.surface.max_spacing_m).powi(2));
    assert!(
        spacing_m <= settings.surface.max_spacing_m && (exposed / target - 1.0).abs() < 0.1,
        "{exposed} of {target} exposed samples"
    );
}

/// Two prisms that overlap, and a mesh of the first one's form that stands 6 m deep in the ground.
fn overlapping() -> Scene {
    let prism = |name: &str, x: f64, top_m: f64| {
        let ring = polygon![(x: x, y: 0.0), (x: x + 20.0, y: 0.0), (x: x + 20.0, y: 20.0), (x: x, y: 20.0)];
        let shape = Shape::Prism { footprint: ring.into(), base_m: 0.0, top_m };
        Structure { id: StructureId::of_name(name), name: name.into(), shape }
    };
    let mut sunken = prism("sunken", 70.0, 20.0);
    let down = Vector3::new(0.0, 0.0, -6.0);
    sunken.shape = Shape::Mesh { triangles: sunken.triangles().into_iter().map(|t| t.map(|p| p + down)).collect() };
    let mut structures: Vec<_> = [prism("low", 0.0, 12.0), prism("high", 12.0, 30.0), sunken].map(Arc::new).into();
    structures.sort_by_key(|structure| structure.id);
    Scene { name: "overlapping".into(), frame: Default::default(), structures, zones: vec![] }
}

#[test]
fn samples_in_a_neighbour_or_in_the_ground_are_not_exposed_and_nobody_sees_them() {
    let settings = small_settings();
    let snapshot = snapshot(&session(overlapping(), &settings));
    let field = snapshot.field();
    let mut buried = [0, 0];
    for (i, row) in field.samples.iter().enumerate() {
        let in_front = Point3::from(row.position_m) + Vector3::from(row.normal) * settings.surface.exposure_offset_m;
        let others = snapshot.scene.structures.iter().enumerate().filter(|(index, _)| *index != row.structure as usize);
        let in_neighbour = others.into_iter().any(|(_, other)| other.contains(&in_front));
        let in_ground = in_front.z <= 0.0;
        assert_eq!(row.exposed == 1, !in_neighbour && !in_ground, "sample {i} at {:?}", row.position_m);
        if row.exposed == 0 {
            assert!((0..field.viewpoints.len()).all(|j| !bit(&field, j, i)) && field.ceilings[i] == 0, "sample {i} is seen");
            buried[usize::from(in_ground)] += 1;
        }
    }
    assert!(buried.iter().all(|&count| count > 2), "both kinds occur: {buried:?}");
}

#[test]
fn after_hundreds_of_edits_the_field_is_still_that_of_the_scene() {
    let made: usize = (0..5).map(|seed| check_updates(small_block(10 + seed), &small_settings(), 150, seed)).sum();
    assert!(made >= 500, "{made} edits");
}

/// Seeds of edits by chance.
fn seeds() -> impl Strategy<Value = Vec<u64>> {
    proptest::collection::vec(any::<u64>(), 1..5)
}

fn edit(scene: &Scene, seed: u64) -> Edit {
    random_edit(scene, &mut ChaCha8Rng::seed_from_u64(seed))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn a_field_after_edits_is_the_field_of_the_edited_scene_bit_for_bit(seeds in seeds()) {
        let settings = small_settings();
        let mut edited = session(small_block(5), &settings);
        let pristine = edited.clone();
        // Each revision follows from the one before, as in the daemon: nothing of them may leak into the last one.
        let mut latest = snapshot(&edited);
        for seed in seeds {
            if edited.apply(&edit(edited.scene(), seed)).is_ok() {
                latest = snapshot_after(&edited, &latest);
            }
        }
        let rebuilt = snapshot(&pristine.with_scene(forgotten(edited.scene()), edited.revision()));
        prop_assert!(latest.storage().is_same(&**rebuilt.storage()));
        // All edits at once.
        let at_once = snapshot_after(&edited, &snapshot(&pristine));
        prop_assert!(at_once.storage().is_same(&**rebuilt.storage()));
        let plan = |snapshot| overfly::planner::plan(snapshot, &settings, &support::options(1, 40), &Default::default(), &mut |_| {});
        prop_assert_eq!(plan(&latest), plan(&rebuilt), "a cold replan is a cold plan of the edited scene");
    }

    #[test]
    fn an_edit_moves_no_sample_of_another_structure_and_no_viewpoint_far_away(seed: u64) {
        let settings = small_settings();
        let mut session = session(small_block(6), &settings);
        let before = snapshot(&session);
        let Ok(dirty) = session.apply(&edit(session.scene(), seed)) else { return Ok(()) };
        let after = snapshot(&session);
        let key = |row: &overfly_table::field::SampleRow| (row.position_m, row.normal, row.area_mm2);
        let samples = |table: &FieldTable, id: u64| {
            let row = table.structures.iter().find(|row| row.id == id)?;
            Some(table.samples[row.first_sample as usize..][..row.samples as usize].iter().map(key).collect::<Vec<_>>())
        };
        for (old, new) in before.scene.structures.iter().filter_map(|old| {
            after.scene.structures.iter().find(|new| new.id == old.id).map(|new| (old, new))
        }) {
            if old == new {
                prop_assert_eq!(samples(&before.field(), old.id.0), samples(&after.field(), old.id.0));
            }
        }
        let reach = settings.field.shell_m + 1.0;
        let far = |p: &[f64; 3]| (0..3).any(|i| p[i] < dirty.min[i] - reach || p[i] > dirty.max[i] + reach);
        let limits = |p: &[f64; 3]| before.free.limits.contains(&Point3::from(*p)) && after.free.limits.contains(&Point3::from(*p));
        let distant = |table: &FieldTable| {
            table.viewpoints.iter().map(|row| row.position_m).filter(|p| far(p) && limits(p)).collect::<Vec<_>>()
        };
        prop_assert_eq!(distant(&before.field()), distant(&after.field()));
    }
}

/// A town of blocks as densely built as a small one, so wide.
fn town(width_m: f64) -> Scene {
    let buildings = (9.0 * (width_m / 130.0).powi(2)).round() as u32;
    generate_block(&BlockSettings { seed: 8, extent_m: [width_m; 2], buildings, ..Default::default() })
}

/// Settings under which a town of any width has as many samples and viewpoints for its area.
fn town_settings(width_m: f64) -> Settings {
    let mut settings = small_settings();
    settings.surface.samples = (150.0 * (width_m / 130.0).powi(2)) as u32;
    settings.surface.max_spacing_m = 1e3;
    settings
}

#[test]
fn after_an_edit_segments_out_of_its_reach_are_the_same_memory() {
    let width_m = 520.0;
    let settings = town_settings(width_m);
    let mut session = session(town(width_m), &settings);
    let mut latest = snapshot(&session);
    let corner = |scene: &Scene| {
        let key = |structure: &&Arc<Structure>| structure.bounds().min.coords.xy().sum();
        scene.structures.iter().min_by(|a, b| key(a).total_cmp(&key(b))).expect("there are structures").id
    };
    // A structure that comes or goes moves the samples of all that follow it: their rows stay where they are all the same.
    let raised = corner(&latest.scene);
    for edit in [Edit::Raise { id: raised, by_m: 4.0 }, Edit::Remove { id: raised }] {
        session.apply(&edit).expect("it can be made");
        let next = snapshot_after(&session, &latest);
        let tables = [latest.field(), next.field()];
        let memory = |table: &FieldTable, tile: u32| Arc::clone(table.segments[tile as usize].memory());
        let position = |table: &FieldTable, j: usize| Point3::from(table.viewpoints[j].position_m);
        let far_m = settings.coverage.range_m + 160.0;
        let edited = latest.scene.structure(raised).expect("it is there").bounds();
        let mut far = 0;
        for j in 0..tables[1].viewpoints.len() {
            if edited.distance_squared(&position(&tables[1], j)) < far_m * far_m {
                continue;
            }
            let before = (0..tables[0].viewpoints.len()).find(|&old| position(&tables[0], old) == position(&tables[1], j));
            let before = tables[0].viewpoints[before.expect("it is far from the edit")].tile;
            assert!(Arc::ptr_eq(&memory(&tables[0], before), &memory(&tables[1], tables[1].viewpoints[j].tile)), "viewpoint {j}");
            far += 1;
        }
        assert!(far > 100, "{far} viewpoints far from the edit");
        let held = |segment: &&Segment| tables[0].segments.iter().any(|old| Arc::ptr_eq(old.memory(), segment.memory()));
        assert!(tables[1].segments.iter().filter(held).count() < tables[1].segments.len(), "the edit changes something");
        latest = next;
    }
}

#[test]
fn a_field_grows_with_the_area_and_not_with_its_square() {
    let per_area = |width_m: f64| {
        let snapshot = snapshot(&session(town(width_m), &town_settings(width_m)));
        let field = snapshot.field();
        assert!(field.viewpoints.len() > 100);
        field.bytes() as f64 / (width_m * width_m)
    };
    let [small, large] = [400.0, 1200.0].map(per_area);
    // With a bit for each pair nine times the area would take up to nine times as much for each square metre. The edge of the smaller town sees less.
    assert!(large < 1.5 * small, "{large} bytes a square metre instead of {small}");
}
