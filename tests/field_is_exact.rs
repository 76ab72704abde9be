//! The field against brute force, and after edits against a field built from the edited scene.

mod support;

use std::sync::Arc;

use geo::polygon;
use nalgebra::{Point3, Vector3};
use overfly::coverage::{DiskModel, SampleFrame};
use overfly::scene::edit::Edit;
use overfly::scene::{Scene, Shape, Structure, StructureId, Triangle};
use overfly_table::FieldTable;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;
use support::{check_updates, crosses, forgotten, random_edit, session, small_block, small_settings, snapshot, snapshot_after};

fn triangles(scene: &Scene) -> Vec<Triangle> {
    scene.structures.iter().flat_map(|structure| structure.triangles()).collect()
}

fn bit(field: &FieldTable, viewpoint: usize, sample: usize) -> bool {
    field.row(viewpoint)[sample / 64] >> (sample % 64) & 1 == 1
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
        prop_assert_eq!(latest.storage().blocks(), rebuilt.storage().blocks());
        // All edits at once.
        let at_once = snapshot_after(&edited, &snapshot(&pristine));
        prop_assert_eq!(at_once.storage().blocks(), rebuilt.storage().blocks());
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
