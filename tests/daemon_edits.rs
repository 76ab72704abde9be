//! Edits by the daemon: of every kind, together, from new versions of a file, and thousands as fast as they can be sent. Each is answered, none runs
//! twice, and what comes of them is the scene after those that were accepted, in their order.

mod served;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use geo::{Coord, LineString, Polygon};
use nalgebra::Point3;
use overfly::scene::edit::Edit;
use overfly::scene::{NoFlyZone, Scene, Shape, ZoneSource, read};
use overfly::session::{Session, Snapshot};
use overfly::stop::StopToken;
use overfly_client::{Client, ClientError, EditOrder, FieldMap, RefusalCode, SceneSource, ShapeOrder, StructureKind};
use overfly_table::FieldTable;
use overfly_wire::codec;
use overfly_wire::frame::{self, Limits};
use overfly_wire::{Kind, Reply, Request, WireBlock};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use served::vandal::{Vandal, honest};
use served::{PATIENCE, Served, block, load, quick, refusal, wait_for};

/// The scene of [`served::load`] as the daemon reads it, with the daemon's settings.
fn local(served: &Served) -> Session {
    let SceneSource::Bytes { file_name, bytes } = block(1, 9) else { panic!("a block is sent as bytes") };
    let settings = overfly::daemon::read_configuration(&served.config).unwrap();
    let (mut scene, _) = read(&file_name, &bytes, &settings.proxy).unwrap();
    scene.name = "block".into();
    Session::new(scene, Arc::new(settings), &StopToken::default()).unwrap()
}

fn rebuilt(session: &Session) -> Snapshot {
    let stop = StopToken::default();
    session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).unwrap()
}

/// What an order means, said once more.
fn meant(scene: &Scene, order: &EditOrder) -> Option<Edit> {
    let outline = |corners: &[[f64; 2]]| {
        let ring: LineString = corners.iter().map(|[x, y]| Coord { x: *x, y: *y }).collect();
        geo::MultiPolygon(vec![Polygon::new(ring, vec![])])
    };
    let shape = |shape: &ShapeOrder| match shape {
        ShapeOrder::Prism { outline_m, base_m, top_m } => {
            Shape::Prism { footprint: outline(outline_m), base_m: *base_m, top_m: *top_m }
        }
        ShapeOrder::Mesh { vertices_m, triangles } => Shape::Mesh {
            triangles: triangles.iter().map(|corners| corners.map(|k| Point3::from(vertices_m[k as usize]))).collect(),
        },
        ShapeOrder::Obstacle { centre_m, size_m, yaw_deg } => {
            Shape::obstacle_box(Point3::from(*centre_m), *size_m, yaw_deg.to_radians())
        }
    };
    Some(match order {
        EditOrder::Raise { structure, by_m } => Edit::Raise { id: scene.find(structure)?, by_m: *by_m },
        EditOrder::Lower { structure, by_m } => Edit::Lower { id: scene.find(structure)?, by_m: *by_m },
        EditOrder::Move { structure, by_m } => Edit::Move { id: scene.find(structure)?, by_m: *by_m },
        EditOrder::Remove { structure } => Edit::Remove { id: scene.find(structure)? },
        EditOrder::Replace { structure, shape: to } => Edit::Replace { id: scene.find(structure)?, shape: shape(to) },
        EditOrder::Add { name, shape: new } => Edit::Add { name: name.clone(), shape: shape(new) },
        EditOrder::RemoveZone { name } => Edit::RemoveZone { name: name.clone() },
        EditOrder::AddZone { name, outline_m, floor_m, ceiling_m } => Edit::AddZone {
            zone: NoFlyZone {
                name: name.clone(),
                outline: outline(outline_m),
                floor_m: *floor_m,
                ceiling_m: ceiling_m.unwrap_or(f64::MAX),
                source: ZoneSource::Edit,
            },
        },
    })
}

/// The session after edits that were accepted: together they are one revision.
fn after(session: &Session, edits: &[EditOrder]) -> Session {
    let limits = &session.settings().proxy;
    let make = |scene: Scene, order: &EditOrder| scene.edited(&meant(&scene, order).expect("it was accepted"), limits).unwrap().0;
    session.with_scene(edits.iter().fold(Scene::clone(session.scene()), make), session.revision() + 1)
}

fn assert_same(field: &FieldTable, session: &Session) {
    let snapshot = rebuilt(session);
    let expected = snapshot.field();
    assert_eq!(field.facts.revision, expected.facts.revision);
    let revision = expected.facts.revision;
    let names = |table: &FieldTable| table.structures.iter().map(|row| table.name(row).into_owned()).collect::<Vec<_>>();
    assert_eq!(names(field), names(&expected), "revision {revision}");
    let places = |table: &FieldTable| table.samples.iter().map(|row| (row.position_m, row.exposed)).collect::<Vec<_>>();
    assert!(places(field) == places(&expected), "samples of revision {revision}");
    let views = |table: &FieldTable| table.viewpoints.iter().map(|row| row.position_m).collect::<Vec<_>>();
    assert!(views(field) == views(&expected), "viewpoints of revision {revision}");
    assert!(
        (0..expected.viewpoints.len()).all(|j| field.row(j).samples().eq(expected.row(j).samples())),
        "visibility of revision {revision}"
    );
}

/// Edits by chance on few names, so that many of them conflict, repeat one another or name what is gone; one to three together.
fn orders(names: &[String], random: &mut ChaCha8Rng) -> Vec<EditOrder> {
    let count = if random.next_u64().is_multiple_of(5) { 2 + random.next_u64() % 2 } else { 1 };
    (0..count).map(|_| order(names, random)).collect()
}

fn order(names: &[String], random: &mut ChaCha8Rng) -> EditOrder {
    let mut below = |count: u64| random.next_u64() % count;
    let any = match below(2) {
        0 => names[below(names.len() as u64) as usize].clone(),
        _ => format!("new-{}", below(6)),
    };
    let [x, y] = [below(120) as f64 - 60.0, below(120) as f64 - 60.0];
    let side = 3.0 + below(8) as f64;
    let outline_m = vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
    let top_m = 4.0 + below(20) as f64;
    let shape = match below(3) {
        0 => ShapeOrder::Prism { outline_m: outline_m.clone(), base_m: 0.0, top_m },
        1 => {
            let ridge = [x + side / 2.0, y + side / 2.0, top_m];
            let vertices_m = outline_m.iter().map(|[x, y]| [*x, *y, 0.0]).chain([ridge]).collect();
            ShapeOrder::Mesh { vertices_m, triangles: vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]] }
        }
        _ => ShapeOrder::Obstacle { centre_m: [x, y, top_m], size_m: [side, 2.0, 3.0], yaw_deg: below(90) as f64 },
    };
    match below(10) {
        0 | 1 => EditOrder::Raise { structure: any, by_m: 1.0 + below(3) as f64 },
        2 | 3 => EditOrder::Lower { structure: any, by_m: 1.0 + below(3) as f64 },
        4 => EditOrder::Move { structure: any, by_m: [below(9) as f64 - 4.0, below(9) as f64 - 4.0] },
        5 => EditOrder::Remove { structure: format!("new-{}", below(6)) },
        6 => EditOrder::Add { name: format!("new-{}", below(6)), shape },
        7 => EditOrder::Replace { structure: any, shape },
        8 => EditOrder::AddZone { name: format!("zone-{}", below(4)), outline_m, floor_m: 0.0, ceiling_m: Some(top_m) },
        _ => EditOrder::RemoveZone { name: format!("zone-{}", below(4)) },
    }
}

/// Holds the accepted edits, by revision, against the scene that the daemon has, and fields that were seen on the way against their revisions.
fn assert_in_order(served: &Served, client: &Client, accepted: &BTreeMap<u64, Vec<EditOrder>>, seen: &[FieldMap]) {
    let revisions: Vec<u64> = accepted.keys().copied().collect();
    assert_eq!(revisions, (2..2 + accepted.len() as u64).collect::<Vec<_>>(), "each revision belongs to one request");
    let mut session = local(served);
    let check = |session: &Session| {
        seen.iter().map(FieldMap::table).filter(|table| table.facts.revision == session.revision()).for_each(|table| {
            assert_same(&table, session);
        });
    };
    check(&session);
    for edits in accepted.values() {
        session = after(&session, edits);
        check(&session);
    }
    let field = wait_for("the last field", || {
        client.field("block").ok().filter(|field| field.table().facts.revision == session.revision())
    });
    assert_same(&field.table(), &session);
    let zones: Vec<String> = client.zones("block").unwrap().into_iter().map(|zone| zone.name).collect();
    assert_eq!(zones, session.scene().zones.iter().map(|zone| zone.name.clone()).collect::<Vec<_>>());
}

#[test]
fn edits_of_many_clients_are_each_answered_and_none_is_lost() {
    const CLIENTS: u64 = 8;
    const EACH: usize = 130;
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let names: Vec<String> = client.structures("block").unwrap().into_iter().map(|structure| structure.name).collect();
    let done = AtomicBool::new(false);
    let (answers, seen) = std::thread::scope(|threads| {
        let (served, names, done) = (&served, &names, &done);
        let edit = |seed: u64| {
            move || {
                let client = served.client();
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                let mut make = || {
                    let edits = orders(names, &mut random);
                    (client.edit_all("block", &edits), edits)
                };
                (0..EACH).map(|_| make()).collect::<Vec<_>>()
            }
        };
        let watch = threads.spawn(move || {
            let client = served.client();
            let mut seen: Vec<FieldMap> = Vec::new();
            while !done.load(Ordering::Relaxed) {
                let field = client.field("block").unwrap();
                let revision = field.table().facts.revision;
                let last = seen.last().map_or(0, |field| field.table().facts.revision);
                assert!(revision >= last, "revision {revision} after {last}");
                // One in a while is kept: each takes a place in shared memory.
                if seen.len() < 12 && revision > last + 15 {
                    seen.push(field);
                }
            }
            seen
        });
        let running: Vec<_> = (0..CLIENTS).map(|seed| threads.spawn(edit(seed))).collect();
        let answers: Vec<_> = running.into_iter().flat_map(|client| client.join().unwrap()).collect();
        done.store(true, Ordering::Relaxed);
        (answers, watch.join().unwrap())
    });
    let mut accepted = BTreeMap::new();
    let mut refused = BTreeSet::new();
    for (answer, edits) in answers {
        match answer {
            Ok(edited) => assert!(accepted.insert(edited.revision, edits).is_none(), "one revision for two requests"),
            Err(ClientError::Refused { code, message }) => {
                assert!(matches!(code, RefusalCode::Edit | RefusalCode::UnknownStructure), "{code:?}: {message}");
                assert!(edits.len() == 1 || message.contains("none of them was made"), "{message}");
                refused.insert(format!("{code:?}"));
            }
            Err(other) => panic!("{other}"),
        }
    }
    println!("{} of {} made, {} fields looked at", accepted.len(), CLIENTS as usize * EACH, seen.len());
    assert!(accepted.len() > 100 && refused.len() == 2 && !seen.is_empty());
    assert_in_order(&served, &client, &accepted, &seen);
}

#[test]
fn a_flood_of_edits_without_waiting_runs_each_once() {
    const EDITS: u64 = 1000;
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let names: Vec<String> = client.structures("block").unwrap().into_iter().map(|structure| structure.name).collect();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let sent: BTreeMap<u64, Vec<EditOrder>> = (1..=EDITS).map(|number| (number, orders(&names, &mut random))).collect();
    let vandal = Vandal::enter(&served.domain);
    let send = |number: u64| {
        let (header, payload) = honest(&Request::Edit { scene: "block".into(), edits: sent[&number].clone() }, number);
        vandal.send(header, &payload);
    };
    let mut answers: BTreeMap<u64, Reply> = BTreeMap::new();
    let receive = |answers: &mut BTreeMap<u64, Reply>| {
        while let Some(sample) = vandal.replies.receive().unwrap() {
            let limits = Limits { body_bytes: codec::MAX_REPLY_BYTES, bulk_bytes: 0 };
            let frame = frame::copy(sample.user_header(), WireBlock::blocks(sample.payload()), Kind::Reply, limits).unwrap();
            let reply: Reply = codec::decode_reply(&frame.body).unwrap();
            if !matches!(reply, Reply::Acknowledged | Reply::Progress(_)) && sent.contains_key(&frame.header.correlation) {
                let known = answers.entry(frame.header.correlation).or_insert_with(|| reply.clone());
                assert_eq!(*known, reply, "an answer that is repeated is the same");
            }
        }
    };
    (1..=EDITS).for_each(send);
    // Whoever has lost an answer, or whose request was lost, asks again.
    wait_for("all answers", || {
        for number in 1..=EDITS {
            receive(&mut answers);
            if !answers.contains_key(&number) {
                send(number);
            }
        }
        receive(&mut answers);
        (answers.len() as u64 == EDITS).then_some(())
    });
    // All of them once more: nothing runs again.
    (1..=EDITS).for_each(|number| {
        send(number);
        receive(&mut answers);
    });
    client.ping().unwrap();
    let mut accepted = BTreeMap::new();
    for (number, answer) in answers {
        match answer {
            Reply::Edited { revision, .. } => assert!(accepted.insert(revision, sent[&number].clone()).is_none()),
            Reply::Refused(refusal) => {
                assert!(matches!(refusal.code, RefusalCode::Edit | RefusalCode::UnknownStructure), "{refusal}");
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(accepted.len() > 100);
    assert_in_order(&served, &client, &accepted, &[]);
}

#[test]
fn edits_are_made_together_or_not_at_all() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let structures = client.structures("block").unwrap();
    let square = |x: f64| vec![[x, -90.0], [x + 6.0, -90.0], [x + 6.0, -84.0], [x, -84.0]];
    let crane = EditOrder::add_prism("crane", square(0.0), 0.0, 30.0);
    let raise = EditOrder::Raise { structure: "crane".into(), by_m: 5.0 };
    let pad = EditOrder::AddZone { name: "pad".into(), outline_m: square(20.0), floor_m: 0.0, ceiling_m: None };
    let gone = EditOrder::Remove { structure: "nowhere".into() };

    let (code, message) = refusal(client.edit_all("block", &[crane.clone(), raise.clone(), gone, pad.clone()]));
    assert_eq!(code, RefusalCode::UnknownStructure);
    assert!(message.starts_with("edit 3 of 4: ") && message.contains("nowhere"), "{message}");
    assert_eq!(client.structures("block").unwrap(), structures, "nothing was changed");
    assert_eq!((client.zones("block").unwrap().len(), client.status().unwrap().scenes[0].revision), (0, 1));
    assert_eq!(refusal(client.edit_all("block", &[])).0, RefusalCode::Invalid);

    client.plan("block", &quick(), &mut |_| {}).unwrap();
    let edits = [crane, raise, pad];
    let edited = client.edit_all("block", &edits).unwrap();
    assert_eq!((edited.revision, edited.replan_follows), (2, true), "one revision");
    let plan = client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
    assert_eq!(plan.table().facts.revision, 2);
    assert_same(&client.field("block").unwrap().table(), &after(&local(&served), &edits));
    let crane = client.structures("block").unwrap().into_iter().find(|structure| structure.name == "crane").unwrap();
    assert_eq!((crane.top_m, crane.kind), (35.0, StructureKind::Prism));
}

#[test]
fn flights_keep_clear_of_zones_and_obstacles_that_edits_add() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let plan = client.plan("block", &quick(), &mut |_| {}).unwrap();
    let at = Point3::from(plan.table().waypoints[plan.table().waypoints.len() / 2].position_m);
    let obstacle = ShapeOrder::Obstacle { centre_m: at.coords.into(), size_m: [6.0, 4.0, 5.0], yaw_deg: 20.0 };
    let hook = EditOrder::Add { name: "hook".into(), shape: obstacle };
    let start = Point3::from(plan.table().waypoints[1].position_m);
    let outline_m = vec![[start.x - 5.0, start.y - 5.0], [start.x + 5.0, start.y - 5.0], [start.x, start.y + 5.0]];
    let zone = EditOrder::AddZone { name: "pad".into(), outline_m, floor_m: 0.0, ceiling_m: None };
    let edits = [hook, zone];
    let edited = client.edit_all("block", &edits).unwrap();
    let replan = client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
    let free = rebuilt(&after(&local(&served), &edits)).free;
    let waypoints: Vec<Point3<f64>> = replan.table().waypoints.iter().map(|row| row.position_m.into()).collect();
    for leg in waypoints.windows(2) {
        assert_eq!(free.obstruction_between(&leg[0], &leg[1]), None);
    }
    let hook = client.structures("block").unwrap().into_iter().find(|structure| structure.name == "hook").unwrap();
    assert_eq!((hook.samples, hook.kind), (0, StructureKind::Obstacle));
    let zones = client.zones("block").unwrap();
    assert_eq!((zones[0].name.as_str(), zones[0].ceiling_m, zones[0].by_edit), ("pad", None, true));
}

fn file(folder: &tempfile::TempDir, name: &str, content: &str) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    path
}

#[test]
fn a_new_version_of_the_file_is_one_edit() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let SceneSource::Bytes { bytes, .. } = block(1, 9) else { panic!("a block is sent as bytes") };
    let mut value: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
    let features = value["features"].as_array_mut().unwrap();
    let removed = features.pop().unwrap()["properties"]["id"].as_str().unwrap().to_owned();
    let changed = features[0]["properties"]["id"].as_str().unwrap().to_owned();
    features[0]["properties"]["height"] = 33.0.into();
    let folder = tempfile::tempdir().unwrap();
    let version = file(&folder, "block.geojson", &value.to_string());
    let source = || SceneSource::Path(version.clone());

    let (_, told) = client.update("block", source(), true, &mut |_| {}).unwrap();
    assert_eq!((&told.changes.removed, &told.changes.changed), (&vec![removed.clone()], &vec![changed.clone()]));
    assert_eq!((told.revision, client.status().unwrap().scenes[0].revision), (1, 1), "a dry run changes nothing");

    client.plan("block", &quick(), &mut |_| {}).unwrap();
    let bytes = SceneSource::Bytes { file_name: "block.geojson".into(), bytes: value.to_string().into_bytes() };
    let (edited, made) = client.update("block", bytes, false, &mut |_| {}).unwrap();
    assert_eq!((made.revision, made.replan_follows, &made.changes), (2, true, &told.changes));
    assert_eq!(client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap().table().facts.revision, 2);
    let structures = client.structures("block").unwrap();
    assert!(structures.iter().all(|structure| structure.name != removed));
    assert_eq!(structures.iter().find(|structure| structure.name == changed).unwrap().top_m, 33.0);

    let (same, nothing) = client.update("block", source(), false, &mut |_| {}).unwrap();
    assert!(nothing.changes.is_empty() && (same.revision, same.replan_follows) == (2, false), "nothing is left to change");

    let obj = file(&folder, "block.obj", "v 0 0 0\nv 9 0 0\nv 0 9 9\nf 1 2 3\n");
    let (code, message) = refusal(client.update("block", SceneSource::Path(obj), false, &mut |_| {}));
    assert!(code == RefusalCode::Import && message.contains("overfly load"), "{message}");
    assert_eq!(refusal(client.update("town", source(), true, &mut |_| {})).0, RefusalCode::UnknownScene);
    let missing = SceneSource::Path(version.with_file_name("missing.geojson"));
    assert_eq!(refusal(client.update("block", missing, true, &mut |_| {})).0, RefusalCode::Unreadable);
    assert_eq!(client.status().unwrap().scenes[0].revision, 2);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn edits_by_chance_are_well_formed(seed: u64) {
        let names = ["hall".to_owned()];
        let edits = orders(&names, &mut ChaCha8Rng::seed_from_u64(seed));
        prop_assert_eq!(Request::Edit { scene: "block".into(), edits }.check(), Ok(()));
    }
}
