//! Whatever a program writes into the request service, the daemon lives, says what is wrong, and has changed nothing.

mod served;

use std::collections::BTreeMap;
use std::time::Duration;

use overfly_client::{EditOrder, RefusalCode};
use overfly_table::Block;
use overfly_wire::codec;
use overfly_wire::frame::{self, Limits};
use overfly_wire::{Header, Kind, Reply, Request, SCHEMA, WireBlock};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use served::vandal::{Vandal, honest};
use served::{Served, load, quick, refusal, wait_for};

#[test]
fn every_malformed_message_is_refused_with_its_reason() {
    let served = Served::with_settings("max_scene_mb = 1");
    let client = served.client();
    let vandal = Vandal::enter(&served.domain);
    let (header, payload) = honest(&Request::Status, 0);
    let nan = EditOrder::Raise { structure: "a".into(), by_m: f64::NAN };
    let (not_finite, edit) = honest(&Request::Edit { scene: "block".into(), edits: vec![nan] }, 0);
    let cases = [
        (Header { schema: SCHEMA + 9, ..header }, &payload, RefusalCode::Malformed, "one release"),
        (Header { magic: 3, ..header }, &payload, RefusalCode::Malformed, "not written by overfly"),
        (Header { kind: 3, ..header }, &payload, RefusalCode::Malformed, "kind"),
        (Header { body_bytes: 10_000, ..header }, &payload, RefusalCode::Malformed, "truncated"),
        (Header { body_bytes: u64::MAX, ..header }, &payload, RefusalCode::Malformed, "split the request"),
        (Header { bulk_bytes: 1_000_001, ..header }, &payload, RefusalCode::Malformed, "max_scene_mb"),
        (Header { bulk_bytes: 64, ..header }, &payload, RefusalCode::Malformed, "truncated"),
        (Header { body_bytes: 0, ..header }, &payload, RefusalCode::Malformed, "decoded"),
        (Header { body_bytes: 60, ..header }, &payload, RefusalCode::Malformed, "follow the end"),
        (Header { instance: 1, ..header }, &payload, RefusalCode::Restarted, "load them again"),
        (not_finite, &edit, RefusalCode::Invalid, "finite"),
    ];
    for (index, (header, payload, code, text)) in cases.into_iter().enumerate() {
        let correlation = index as u64 + 1;
        vandal.send(Header { correlation, ..header }, payload);
        let (found, message) = vandal.refusal(correlation);
        assert_eq!(found, code, "{message}");
        assert!(message.contains(text), "{message:?} should contain {text:?}");
    }
    client.ping().unwrap();
}

#[test]
fn random_messages_neither_stop_the_daemon_nor_change_a_plan() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let before = client.plan("block", &quick(), &mut |_| {}).unwrap();
    let vandal = Vandal::enter(&served.domain);
    let words = prop::collection::vec(any::<[u64; 8]>(), 1..6);
    let header = (any::<[u64; 7]>(), any::<bool>());
    let mut runner = TestRunner::new(Config { cases: 300, failure_persistence: None, ..Config::default() });
    runner
        .run(&(words, header), |(words, ([magic, codes, instance, epoch, correlation, body_bytes, bulk_bytes], honest))| {
            let random = Header {
                magic,
                schema: codes as u32,
                kind: (codes >> 32) as u32,
                instance,
                epoch,
                client: 7,
                correlation,
                body_bytes,
                bulk_bytes,
                follows: epoch,
                first_changed: magic,
            };
            let room = words.len() as u64 * 64;
            let plausible = Header { client: 7, correlation, body_bytes: body_bytes % (room + 1), ..Header::new(Kind::Request) };
            let payload: Vec<Block> = words.into_iter().map(Block).collect();
            let body = &bytemuck::cast_slice::<Block, u8>(&payload)[..plausible.body_bytes as usize];
            // A well-formed order to stop is to be obeyed.
            prop_assume!(!honest || codec::decode_request::<Request>(body).ok() != Some(Request::Stop));
            vandal.send(if honest { plausible } else { random }, &payload);
            Ok(())
        })
        .unwrap();
    client.ping().unwrap();
    let scenes = client.status().unwrap().scenes;
    assert_eq!(scenes.len(), 1);
    assert_eq!(scenes[0].plan.map(|plan| plan.revision), Some(before.table().facts.revision));
}

#[test]
fn a_request_that_is_sent_twice_runs_once() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let structure = client.structures("block").unwrap()[0].name.clone();
    let raise = EditOrder::Raise { structure, by_m: 1.0 };
    let (header, payload) = honest(&Request::Edit { scene: "block".into(), edits: vec![raise] }, 1);
    let vandal = Vandal::enter(&served.domain);
    for _ in 0..4 {
        vandal.send(header, &payload);
    }
    let edited = wait_for("the edit's answer", || match vandal.answer(1) {
        Reply::Acknowledged | Reply::Progress(_) => None,
        other => Some(other),
    });
    assert_eq!(edited, Reply::Edited { revision: 2, replan_follows: false });
    client.ping().unwrap();
    assert_eq!(client.status().unwrap().scenes[0].revision, 2);
}

/// The final answers to the requests of these correlations.
fn finals(vandal: &Vandal, correlations: std::ops::RangeInclusive<u64>) -> Vec<Reply> {
    let mut answers = BTreeMap::new();
    wait_for("all answers", || {
        while let Some(sample) = vandal.replies.receive().unwrap() {
            let limits = Limits { body_bytes: codec::MAX_REPLY_BYTES, bulk_bytes: 0 };
            let frame = frame::copy(sample.user_header(), WireBlock::blocks(sample.payload()), Kind::Reply, limits).unwrap();
            let reply: Reply = codec::decode_reply(&frame.body).unwrap();
            let is_final = !matches!(reply, Reply::Acknowledged | Reply::Progress(_));
            if is_final && correlations.contains(&frame.header.correlation) {
                answers.entry(frame.header.correlation).or_insert(reply);
            }
        }
        (answers.len() as u64 == correlations.end() - correlations.start() + 1).then_some(())
    });
    answers.into_values().collect()
}

#[test]
fn edits_that_come_at_once_are_each_answered_and_a_plan_before_them_is_made_again() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let structure = client.structures("block").unwrap()[0].name.clone();
    let vandal = Vandal::enter(&served.domain);
    let send = |request: Request, correlation| {
        let (header, payload) = honest(&request, correlation);
        vandal.send(header, &payload);
    };
    let raise =
        || Request::Edit { scene: "block".into(), edits: vec![EditOrder::Raise { structure: structure.clone(), by_m: 1.0 }] };
    let plan = |order| Request::Plan { scene: "block".into(), order: Box::new(order) };

    // An order that cannot be flown is not followed up.
    let high = overfly_client::PlanOrder { start_m: Some([0.0, 0.0, 5000.0]), ..quick() };
    send(plan(high), 1);
    assert!(matches!(&finals(&vandal, 1..=1)[0], Reply::Refused(refusal) if refusal.code == RefusalCode::Plan));
    send(raise(), 2);
    assert_eq!(finals(&vandal, 2..=2), [Reply::Edited { revision: 2, replan_follows: false }]);

    // One that was accepted is, even if the edit comes before its search has begun.
    send(plan(served::endless()), 3);
    (4..=8).for_each(|correlation| send(raise(), correlation));
    let answers = finals(&vandal, 3..=8);
    assert!(matches!(&answers[0], Reply::Refused(refusal) if refusal.code == RefusalCode::Superseded));
    let edited: Vec<Reply> = (3..=7).map(|revision| Reply::Edited { revision, replan_follows: true }).collect();
    assert_eq!(answers[1..], edited);
    wait_for("the replan", || {
        client.status().unwrap().scenes.iter().find(|s| s.state == overfly_client::SceneState::Planning).map(drop)
    });
    client.cancel("block").unwrap();
    wait_for("its plan", || client.status().unwrap().scenes[0].plan.filter(|plan| plan.revision == 7));
}

#[test]
fn hostile_rig_files_are_refused_and_plans_go_on() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let phantom = include_str!("../config/rigs/phantom4-rtk.toml");
    let order = |text: String| overfly_client::PlanOrder { rig: "mine".into(), rig_file: Some(text), ..quick() };
    let garbage: String = (0..65_536u32).map(|k| char::from(b' ' + (k.wrapping_mul(2_654_435_761) >> 24) as u8 % 95)).collect();
    let hostile = [
        garbage,
        String::new(),
        "\0".repeat(1000),
        "[".repeat(65_536),
        format!("{} = 1", "k".repeat(60_000)),
        phantom.replace("\"main\"", &format!("\"{}\"", "m".repeat(60_000))),
        phantom.replace("\"phantom4-rtk\"", &format!("\"{}\"", "p".repeat(60_000))),
        format!("name = {}", "[".repeat(65_000)),
        format!("name = {}1{}", "{a=".repeat(15_000), "}".repeat(15_000)),
        format!("name = {}", "9".repeat(65_000)),
        format!("[{}]\n", vec!["a"; 30_000].join(".")),
        format!("{phantom}{}", "[[camera]]\n".repeat(4000)),
        phantom.replace("focal_mm = 8.8", "focal_mm = nan"),
        phantom.replace("focal_mm = 8.8", "focal_mm = -inf"),
        phantom.replace("focal_mm = 8.8", "focal_mm = 1e-320"),
        phantom.replace("exposure_s = 0.001", "exposure_s = 0.0"),
        phantom.replace("shutter_interval_s = 1.0", "shutter_interval_s = 1e300"),
        phantom.replace("pixels = [5472, 3648]", "pixels = [4294967295, 4294967295]"),
        phantom.replace("pixels = [5472, 3648]", "pixels = [-1, 3648]"),
        phantom.replace("[-90.0, 30.0]", "[nan, nan]"),
        phantom.replace("energy_wh = 89.2", "energy_wh = nan"),
    ];
    for text in hostile {
        let shown: String = text.chars().take(60).collect();
        let (code, message) = refusal(client.plan("block", &order(text), &mut |_| {}));
        assert_eq!(code, RefusalCode::Plan, "{shown}: {message}");
        assert!(message.contains("rig") && message.len() < 4000, "{shown}: {} bytes of message", message.len());
    }
    // A client refuses what is too long by itself, so this is sent by one that does not.
    let (header, payload) = honest(&Request::Plan { scene: "block".into(), order: Box::new(order("#".repeat(65_537))) }, 9);
    let vandal = Vandal::enter(&served.domain);
    vandal.send(header, &payload);
    assert_eq!(vandal.refusal(9).0, RefusalCode::Invalid);
    client.plan("block", &order(phantom.into()), &mut |_| {}).unwrap();
}

#[test]
fn pipes_that_nobody_writes_to_keep_no_thread_waiting() {
    let served = Served::start();
    let client = served.client();
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("town.geojson");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR).unwrap();
    for _ in 0..20 {
        let (code, message) = refusal(client.load(overfly_client::SceneSource::Path(pipe.clone()), None, &mut |_| {}));
        assert_eq!(code, RefusalCode::Unreadable);
        assert!(message.contains("regular file"), "{message}");
    }
    load(&client, "block");
    client.plan("block", &quick(), &mut |_| {}).unwrap();
}

#[test]
fn files_that_are_no_scenes_are_refused() {
    let served = Served::with_settings("max_scene_mb = 1");
    let client = served.client();
    let load = |file_name: &str, bytes: Vec<u8>| {
        let source = overfly_client::SceneSource::Bytes { file_name: file_name.into(), bytes };
        refusal(client.load(source, None, &mut |_| {}))
    };
    for bytes in [Vec::new(), vec![b'{'; 900_000], b"{".to_vec(), b"\xff\xfe\x00".to_vec(), b"[1,2,3]".to_vec()] {
        assert_eq!(load("broken.geojson", bytes).0, RefusalCode::Import);
    }
    assert_eq!(load("large.geojson", vec![b' '; 1_500_000]).0, RefusalCode::Malformed);
    let missing = overfly_client::SceneSource::Path("no/such/file.geojson".into());
    let (code, message) = refusal(client.load(missing, None, &mut |_| {}));
    assert_eq!(code, RefusalCode::Unreadable);
    assert!(message.contains("no/such/file.geojson"), "{message}");
    for no_file in ["/", "/dev/zero"] {
        let source = overfly_client::SceneSource::Path(no_file.into());
        assert_eq!(refusal(client.load(source, None, &mut |_| {})).0, RefusalCode::Unreadable);
    }
    assert!(client.status().unwrap().scenes.is_empty());
    assert!(client.ping().unwrap() > Duration::ZERO);
}
