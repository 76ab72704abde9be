//! A mission arrives as it was sent, or the upload says why not: over links that lose, repeat, delay and reorder messages, with autopilots of several manners.

mod autopilot;

use std::collections::BTreeMap;
use std::time::Duration;

use autopilot::{AIRCRAFT, Manner, Model, ack, request};
use overfly::autopilot::dialect::*;
use overfly::autopilot::upload::{RETRIES, Upload, UploadError, WAIT};
use overfly::autopilot::{Address, MavMessage};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

const US: Address = Address { system: 1, component: 191 };
const OTHER: Address = Address { system: 255, component: 190 };
const STEP: Duration = Duration::from_millis(10);

fn mission(count: usize, mark: f32) -> Vec<MISSION_ITEM_INT_DATA> {
    let item = |k: usize| MISSION_ITEM_INT_DATA {
        param1: mark,
        param4: f32::NAN,
        x: 520_000_000 + k as i32,
        y: 40_000_000 - k as i32,
        z: 30.0 + k as f32,
        autocontinue: 1,
        ..MISSION_ITEM_INT_DATA::DEFAULT
    };
    (0..count).map(item).collect()
}

/// What of an item was meant to arrive; parameters that are no number are equal to themselves.
fn content(items: &[MISSION_ITEM_INT_DATA]) -> Vec<String> {
    items
        .iter()
        .map(|item| format!("{:?}", (item.param1, item.param4, item.x, item.y, item.z, item.command, item.frame)))
        .collect()
}

/// A link with its faults.
struct Net {
    random: ChaCha8Rng,
    /// Shares of 1000.
    loss: u64,
    repeats: u64,
    delay_ms: [u64; 2],
    /// By the time of arrival: to the aircraft, or from it.
    flying: BTreeMap<(Duration, u64), (bool, MavMessage)>,
    sent: u64,
    lost: u64,
}

impl Net {
    fn new(seed: u64, loss: u64, repeats: u64, delay_ms: [u64; 2]) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), loss, repeats, delay_ms, flying: BTreeMap::new(), sent: 0, lost: 0 }
    }

    fn send(&mut self, to_aircraft: bool, messages: Vec<MavMessage>, now: Duration) {
        for message in messages {
            let copies = 1 + u64::from(self.random.next_u64() % 1000 < self.repeats);
            for _ in 0..copies {
                self.sent += 1;
                if self.random.next_u64() % 1000 < self.loss {
                    self.lost += 1;
                    continue;
                }
                let [least, most] = self.delay_ms;
                let delay = Duration::from_millis(least + self.random.next_u64() % (most - least + 1));
                self.flying.insert((now + delay, self.sent), (to_aircraft, message.clone()));
            }
        }
    }

    fn arrived(&mut self, now: Duration) -> Vec<(bool, MavMessage)> {
        let later = self.flying.split_off(&(now + Duration::from_nanos(1), 0));
        std::mem::replace(&mut self.flying, later).into_values().collect()
    }

    /// Lets both sides speak until the upload has its outcome, or until a moment.
    fn run(&mut self, upload: &mut Upload, model: &mut Model, first: Vec<MavMessage>, now: &mut Duration, until: Duration) {
        self.send(true, first, *now);
        while upload.outcome().is_none() && *now < until {
            *now += STEP;
            for (to_aircraft, message) in self.arrived(*now) {
                if to_aircraft {
                    let answer = model.hear(US, &message, *now);
                    self.send(false, answer, *now);
                } else {
                    let answer = upload.hear(AIRCRAFT, &message, *now);
                    self.send(true, answer, *now);
                }
            }
            let asked = model.tick(*now);
            self.send(false, asked, *now);
            let repeated = upload.tick(*now);
            self.send(true, repeated, *now);
        }
    }
}

/// Longer than any upload of these tests may take.
const EVER: Duration = Duration::from_secs(400);

fn begin(items: &[MISSION_ITEM_INT_DATA], clears: bool, now: Duration) -> (Upload, Vec<MavMessage>) {
    Upload::begin(items, US, AIRCRAFT, clears, now).unwrap()
}

fn manner() -> impl Strategy<Value = Manner> {
    let stray = prop_oneof![
        Just(None),
        Just(Some(MavMissionResult::MAV_MISSION_ACCEPTED)),
        Just(Some(MavMissionResult::MAV_MISSION_ERROR))
    ];
    (any::<bool>(), any::<bool>(), any::<bool>(), stray, 200u64..1100).prop_map(
        |(asks_by_request, naks_disorder, is_busy, on_stray, reask_ms)| Manner {
            asks_by_request,
            naks_disorder,
            is_busy,
            on_stray,
            reask: Duration::from_millis(reask_ms),
            ..Manner::default()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn what_arrives_is_what_was_sent_or_the_error_says_why(
        count in 1usize..60, manner in manner(), seed: u64, loss in 0u64..350, repeats in 0u64..200, delay_ms in 0u64..400,
    ) {
        let items = mission(count, 1.0);
        let mut model = Model::new(manner);
        model.mission = mission(7, 9.0);
        let mut net = Net::new(seed, loss, repeats, [0, delay_ms]);
        let mut now = Duration::ZERO;
        let (mut upload, first) = begin(&items, false, now);
        net.run(&mut upload, &mut model, first, &mut now, EVER);
        match upload.outcome() {
            Some(Ok(())) => prop_assert_eq!(content(&model.mission), content(&items)),
            Some(Err(error)) => {
                let text = error.to_string();
                prop_assert!(text.contains(';') || text.contains(':'), "no remedy: {}", text);
                prop_assert!(loss > 0 || delay_ms > 100, "a link without losses: {}", text);
            }
            None => prop_assert!(false, "it never ends"),
        }
    }

    /// A newer plan takes the place of one that is on its way up: the two are never mixed.
    #[test]
    fn of_two_missions_the_newer_one_is_flown_whole(
        counts in (1usize..40, 1usize..40), manner in manner(), seed: u64, loss in 0u64..200, repeats in 0u64..200, delay_ms in 0u64..120,
        after_ms in 0u64..3000, cancels: bool,
    ) {
        let (older, newer) = (mission(counts.0, 1.0), mission(counts.1, 2.0));
        let mut model = Model::new(manner);
        let mut net = Net::new(seed, loss, repeats, [0, delay_ms]);
        let mut now = Duration::ZERO;
        let (mut upload, first) = begin(&older, false, now);
        net.run(&mut upload, &mut model, first, &mut now, Duration::from_millis(after_ms));
        if cancels {
            net.send(true, vec![upload.cancel()], now);
        }
        let (mut upload, first) = begin(&newer, true, now);
        net.run(&mut upload, &mut model, first, &mut now, EVER);
        prop_assert!(upload.outcome().is_some(), "it never ends");
        if upload.outcome() == Some(&Ok(())) {
            prop_assert_eq!(content(&model.mission), content(&newer));
        } else {
            prop_assert!(loss > 0, "{:?}", upload.outcome());
        }
    }
}

#[test]
fn two_hundred_items_over_a_link_that_loses_one_message_in_twenty() {
    let items = mission(200, 1.0);
    let (mut lost, mut longest) = (0, Duration::ZERO);
    for seed in 0..100 {
        let mut model = Model::default();
        let mut net = Net::new(seed, 50, 20, [5, 60]);
        let mut now = Duration::ZERO;
        let (mut upload, first) = begin(&items, false, now);
        net.run(&mut upload, &mut model, first, &mut now, EVER);
        assert_eq!(upload.outcome(), Some(&Ok(())), "seed {seed}");
        assert_eq!(content(&model.mission), content(&items), "seed {seed}");
        assert!(net.lost > 0);
        lost += net.lost;
        longest = longest.max(now);
    }
    println!(
        "100 uploads of 200 items: {lost} messages lost, none of the items; the longest took {:.1} s",
        longest.as_secs_f64()
    );
}

/// Passes until the upload has something to say of itself.
fn silent(upload: &mut Upload, mut now: Duration) -> (Duration, Vec<MavMessage>) {
    let mut said = Vec::new();
    while upload.outcome().is_none() && now < EVER {
        now += STEP;
        said.extend(upload.tick(now));
    }
    (now, said)
}

#[test]
fn an_autopilot_that_does_not_answer_is_asked_six_times() {
    let (mut upload, first) = begin(&mission(3, 1.0), false, Duration::ZERO);
    assert!(matches!(first[..], [MavMessage::MISSION_COUNT(_)]));
    let (now, said) = silent(&mut upload, Duration::ZERO);
    let counts = said.iter().filter(|message| matches!(message, MavMessage::MISSION_COUNT(_))).count();
    assert_eq!(counts, RETRIES as usize);
    assert_eq!(now, WAIT * (RETRIES + 1));
    let error = upload.outcome().unwrap().clone().unwrap_err();
    assert!(matches!(error, UploadError::Silent { .. }) && error.may_pass(), "{error}");
}

fn seqs(messages: &[MavMessage]) -> Vec<u16> {
    let seq = |message: &MavMessage| match message {
        MavMessage::MISSION_ITEM_INT(item) => Some(item.seq),
        _ => None,
    };
    messages.iter().filter_map(seq).collect()
}

#[test]
fn what_is_asked_twice_is_answered_twice_and_strangers_are_not() {
    let now = Duration::ZERO;
    let (mut upload, _) = begin(&mission(3, 1.0), false, now);
    let ask = |upload: &mut Upload, from, to, seq| seqs(&upload.hear(from, &request(to, seq, seq == 1), now));
    assert_eq!(ask(&mut upload, Address { system: 2, component: 1 }, US, 0), Vec::<u16>::new(), "another aircraft");
    assert_eq!(ask(&mut upload, AIRCRAFT, OTHER, 0), Vec::<u16>::new(), "another station's item");
    assert_eq!(ask(&mut upload, AIRCRAFT, US, 0), [0]);
    assert_eq!(ask(&mut upload, AIRCRAFT, US, 0), [0]);
    assert_eq!(ask(&mut upload, AIRCRAFT, US, 1), [1], "by the old message");
    assert_eq!(ask(&mut upload, AIRCRAFT, US, 0), [0]);
    upload.hear(AIRCRAFT, &ack(US, MavMissionResult::MAV_MISSION_ACCEPTED), now);
    assert_eq!(upload.outcome(), None, "a confirmation before its time is of another mission");
    let fence = MISSION_REQUEST_INT_DATA {
        target_system: US.system,
        target_component: US.component,
        mission_type: MavMissionType::MAV_MISSION_TYPE_FENCE,
        ..MISSION_REQUEST_INT_DATA::DEFAULT
    };
    assert!(upload.hear(AIRCRAFT, &MavMessage::MISSION_REQUEST_INT(fence), now).is_empty(), "another kind of mission");
    assert_eq!(ask(&mut upload, AIRCRAFT, US, 2), [2]);
    upload.hear(AIRCRAFT, &ack(OTHER, MavMissionResult::MAV_MISSION_ACCEPTED), now);
    assert_eq!(upload.outcome(), None, "another station's confirmation");
    upload.hear(AIRCRAFT, &ack(US, MavMissionResult::MAV_MISSION_ACCEPTED), now);
    assert_eq!(upload.outcome(), Some(&Ok(())));
}

#[test]
fn another_partner_is_named_when_the_autopilot_does_not_answer_us() {
    let (mut upload, _) = begin(&mission(3, 1.0), false, Duration::ZERO);
    upload.hear(AIRCRAFT, &request(OTHER, 4, false), Duration::ZERO);
    silent(&mut upload, Duration::ZERO);
    let error = upload.outcome().unwrap().clone().unwrap_err().to_string();
    assert!(error.contains("system 255, component 190"), "{error}");
}

#[test]
fn every_refusal_names_the_item_and_a_remedy() {
    use MavMissionResult::*;
    let results = [
        MAV_MISSION_ERROR,
        MAV_MISSION_UNSUPPORTED_FRAME,
        MAV_MISSION_UNSUPPORTED,
        MAV_MISSION_INVALID,
        MAV_MISSION_INVALID_PARAM1,
        MAV_MISSION_INVALID_PARAM5_X,
        MAV_MISSION_INVALID_PARAM7,
        MAV_MISSION_DENIED,
        MAV_MISSION_OPERATION_CANCELLED,
    ];
    for result in results {
        let mut model = Model::new(Manner { rejects: Some((2, result)), ..Manner::default() });
        let mut net = Net::new(1, 0, 0, [1, 2]);
        let (mut upload, first) = begin(&mission(5, 1.0), false, Duration::ZERO);
        net.run(&mut upload, &mut model, first, &mut Duration::ZERO.clone(), EVER);
        let error = upload.outcome().unwrap().clone().unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("at item 2 (MAV_CMD_NAV_WAYPOINT)") && (text.contains(';') || text.contains("try again")),
            "{text}"
        );
        assert!(model.mission.is_empty());
    }
    let mut model = Model::new(Manner { capacity: 4, ..Manner::default() });
    let mut net = Net::new(1, 0, 0, [1, 2]);
    let (mut upload, first) = begin(&mission(5, 1.0), false, Duration::ZERO);
    net.run(&mut upload, &mut model, first, &mut Duration::ZERO.clone(), EVER);
    let error = upload.outcome().unwrap().clone().unwrap_err();
    assert!(error.to_string().contains("no room for 5 items") && !error.may_pass(), "{error}");
}

#[test]
fn an_autopilot_that_asks_for_ever_or_out_of_order_comes_to_an_end() {
    let items = mission(4, 1.0);
    let (mut upload, _) = begin(&items, false, Duration::ZERO);
    let mut now = Duration::ZERO;
    while upload.outcome().is_none() && now < EVER {
        now += 25 * STEP;
        upload.hear(AIRCRAFT, &request(US, 0, false), now);
        upload.tick(now);
    }
    // Every answer was heard, so that no time-out ever came: the limit for the whole is what ends it.
    assert!(matches!(upload.outcome(), Some(Err(UploadError::TooLong { .. }))), "{:?}", upload.outcome());

    let (mut upload, _) = begin(&items, false, Duration::ZERO);
    let mut now = Duration::ZERO;
    for seq in [0, 3, 3, 0, 2, 0, 3].into_iter().cycle() {
        now += STEP;
        upload.hear(AIRCRAFT, &request(US, seq, false), now);
        upload.tick(now);
        if upload.outcome().is_some() || now > EVER {
            break;
        }
    }
    let error = upload.outcome().expect("it ends").clone().unwrap_err();
    assert!(matches!(error, UploadError::Disorder { .. }), "{error}");
}

#[test]
fn a_mission_without_items_or_with_too_many_is_none() {
    for count in [0, 65_536] {
        let refused = Upload::begin(&mission(count, 1.0), US, AIRCRAFT, false, Duration::ZERO).err();
        assert_eq!(refused, Some(UploadError::Length { count }));
    }
}

#[test]
fn an_autopilot_that_is_busy_with_an_older_mission_is_told_to_give_it_up_and_gets_no_item_of_the_newer_one() {
    let is_cancel = |messages: &[MavMessage]| {
        let [MavMessage::MISSION_ACK(ack)] = messages else { return false };
        ack.mavtype == MavMissionResult::MAV_MISSION_OPERATION_CANCELLED
    };
    let now = Duration::ZERO;
    // It has not heard of the newer one, and asks for what was next.
    for (seq, clears) in [(2, false), (2, true), (0, true)] {
        let (mut upload, first) = begin(&mission(3, 1.0), clears, now);
        assert_eq!(is_cancel(&first), clears);
        assert!(is_cancel(&upload.hear(AIRCRAFT, &request(US, seq, false), now)), "item {seq}, {clears}");
        // When it is quiet, it is told of the newer one.
        let said = upload.tick(now + Duration::from_millis(250));
        assert!(matches!(said[..], [MavMessage::MISSION_COUNT(_)]), "{said:?}");
        assert_eq!(seqs(&upload.hear(AIRCRAFT, &request(US, 0, false), now)), [0]);
    }
}
