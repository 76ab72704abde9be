use proptest::prelude::*;

use super::*;
use crate::codec;

fn order() -> PlanOrder {
    PlanOrder::default()
}

proptest! {
    #[test]
    fn every_name_becomes_one_that_a_scene_can_have(name in "\\PC{0,200}", controls: String) {
        for name in [name, controls] {
            let plain = plain_scene_name(&name);
            prop_assert_eq!(check_scene_name(&plain), Ok(()), "{:?}", plain);
            prop_assert_eq!(plain_scene_name(&plain), plain);
        }
    }

    #[test]
    fn random_bytes_are_refused_or_make_a_request_that_can_be_judged(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(request) = codec::decode_request::<Request>(&bytes) {
            let _ = request.check();
        }
    }

    #[test]
    fn an_edit_survives_the_way_over_the_wire(
        name in "[a-z]{1,20}", outline_m in prop::collection::vec(prop::array::uniform2(-1e5..1e5f64), 3..50), base_m in -10.0..0.0f64,
    ) {
        let edits = vec![EditOrder::add_prism(name, outline_m, base_m, 5.0)];
        let request = Request::Edit { scene: "town".into(), edits };
        let bytes = codec::encode(&request, codec::MAX_REQUEST_BYTES).unwrap();
        let back: Request = codec::decode_request(&bytes).unwrap();
        prop_assert!(back.check().is_ok());
        prop_assert_eq!(back, request);
    }
}

#[test]
fn a_list_that_claims_to_be_huge_is_refused_before_it_is_allocated() {
    let edit = EditOrder::add_prism("a", vec![[0.0; 2]; 3], 0.0, 1.0);
    let request = Request::Edit { scene: "t".into(), edits: vec![edit] };
    let mut bytes = codec::encode(&request, codec::MAX_REQUEST_BYTES).unwrap();
    let length = bytes.iter().position(|byte| *byte == 3).expect("variant 3 or the length 3");
    let place = bytes.iter().skip(length + 1).position(|byte| *byte == 3).expect("the length") + length + 1;
    bytes.splice(place..=place, [253, 255, 255, 255, 255, 255, 255, 255, 127]);
    let message = codec::decode_request::<Request>(&bytes).unwrap_err().to_string();
    assert!(message.contains("cannot be decoded"), "{message}");
}

#[test]
fn values_that_make_no_sense_are_refused_with_a_remedy() {
    let edit = |edit| Request::Edit { scene: "town".into(), edits: vec![edit] };
    let mesh = |vertices_m: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>| {
        edit(EditOrder::Add { name: "n".into(), shape: ShapeOrder::Mesh { vertices_m, triangles } })
    };
    let obstacle = |centre_m, size_m, yaw_deg| {
        edit(EditOrder::Add { name: "n".into(), shape: ShapeOrder::Obstacle { centre_m, size_m, yaw_deg } })
    };
    let zone = |outline_m, floor_m, ceiling_m| edit(EditOrder::AddZone { name: "z".into(), outline_m, floor_m, ceiling_m });
    let remove = EditOrder::Remove { structure: "a".into() };
    let plan = |order| Request::Plan { scene: "town".into(), order: Box::new(order) };
    let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, f64::NAN]];
    let faults = [
        edit(EditOrder::Raise { structure: "a".into(), by_m: f64::INFINITY }),
        edit(EditOrder::Raise { structure: "a".into(), by_m: -3.0 }),
        edit(EditOrder::Move { structure: "a".into(), by_m: [0.0, 1e9] }),
        edit(EditOrder::Remove { structure: String::new() }),
        edit(EditOrder::add_prism("n", square, 0.0, 1.0)),
        edit(EditOrder::add_prism("n", vec![[0.0; 2]; 2], 0.0, 1.0)),
        edit(EditOrder::add_prism("n", vec![[0.0; 2]; 3], 1.0, 1.0)),
        mesh(vec![[0.0; 3]; 3], vec![]),
        mesh(vec![[0.0; 3]; 3], vec![[0, 1, 3]]),
        mesh(vec![[0.0, f64::NAN, 0.0]; 3], vec![[0, 1, 2]]),
        mesh(vec![[0.0; 3]; 3], vec![[0, 1, 2]; MAX_MESH_TRIANGLES + 1]),
        mesh(vec![[0.0; 3]; MAX_MESH_VERTICES + 1], vec![[0, 1, 2]]),
        obstacle([0.0; 3], [1.0, 0.0, 1.0], 0.0),
        obstacle([0.0; 3], [1.0, f64::NAN, 1.0], 0.0),
        obstacle([f64::INFINITY; 3], [1.0; 3], 0.0),
        obstacle([0.0; 3], [1.0; 3], f64::NAN),
        zone(vec![[0.0; 2]; 2], 0.0, None),
        zone(vec![[0.0; 2]; 3], f64::NAN, None),
        zone(vec![[0.0; 2]; 3], 10.0, Some(10.0)),
        edit(EditOrder::RemoveZone { name: "\n".into() }),
        Request::Edit { scene: "town".into(), edits: vec![] },
        Request::Edit { scene: "town".into(), edits: vec![remove; MAX_EDITS + 1] },
        Request::UpdatePath { scene: "town".into(), path: b"relative".to_vec(), ground: None, dry_run: true },
        plan(PlanOrder { start_m: Some([0.0, f64::NAN, 0.0]), ..order() }),
        plan(PlanOrder { iterations: Some(0), ..order() }),
        plan(PlanOrder { budget_s: Some(0.0), ..order() }),
        plan(PlanOrder { within_s: Some(f64::NAN), ..order() }),
        plan(PlanOrder { goal_percent: Some(100.1), ..order() }),
        plan(PlanOrder { matched_percent: Some(f64::NAN), ..order() }),
        plan(PlanOrder { gsd_m: Some(-0.01), ..order() }),
        plan(PlanOrder { overlap_percent: Some(0.0), ..order() }),
        plan(PlanOrder { overlap_percent: Some(100.0), ..order() }),
        plan(PlanOrder { overlap_percent: Some(f64::NAN), ..order() }),
        plan(PlanOrder { region_m: vec![[0.0; 2]; 2], ..order() }),
        plan(PlanOrder { region_m: vec![[0.0, 1.0], [1.0, 2.0], [1e9, 0.0]], ..order() }),
        plan(PlanOrder { rig: "x".repeat(1000), ..order() }),
        plan(PlanOrder { rig_file: Some("#".repeat(MAX_RIG_FILE_BYTES + 1)), ..order() }),
        plan(PlanOrder { start_view_deg: Some([0.0, f64::NAN]), ..order() }),
        plan(PlanOrder { start_view_deg: Some([0.0, 91.0]), ..order() }),
        Request::Locate { scene: "a/b".into() },
        Request::LoadPath { path: b"relative".to_vec(), ground: None, name: None, order: Box::default() },
        Request::LoadPath { path: b"/a".to_vec(), ground: Some(b"relative".to_vec()), name: None, order: Box::default() },
        Request::LoadPath {
            path: b"/a".to_vec(),
            ground: None,
            name: None,
            order: Box::new(ReadOrder { unit_m: Some(f64::NAN), ..Default::default() }),
        },
    ];
    for request in faults {
        let refusal = request.check().unwrap_err();
        assert_eq!(refusal.code, RefusalCode::Invalid, "{request:?}");
    }
    assert_eq!(plan(order()).check(), Ok(()));
}

#[test]
fn a_refusal_says_which_of_several_edits_it_means() {
    let good = EditOrder::Remove { structure: "a".into() };
    let bad = EditOrder::Raise { structure: "b".into(), by_m: -1.0 };
    let refusal = Request::Edit { scene: "town".into(), edits: vec![good, bad] }.check().unwrap_err();
    assert!(refusal.message.starts_with("edit 2 of 2: the change of height"), "{refusal}");
}
