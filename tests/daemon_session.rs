//! A daemon process serves two clients: load, plan, edit, replan, watch, and the field without a copy.

mod served;

use std::time::Duration;

use overfly::mission::plan_table;
use overfly::scene::{BlockSettings, generate_block, write};
use overfly_client::{EditOrder, PlanMessage, PlanOrder, RefusalCode, SceneState, Stage};
use overfly_table::plan::SAFE;
use served::{PATIENCE, Served, block, endless, load, quick, refusal, wait_for};

#[test]
fn one_client_plans_and_edits_while_another_watches() {
    let served = Served::start();
    let (pilot, observer) = (served.client(), served.client());
    let mut stages = Vec::new();
    let loaded = pilot.load(block(1, 9), Some("block"), &mut |note| stages.push(note.stage)).unwrap();
    assert_eq!((loaded.scene.as_str(), loaded.revision), ("block", 1));
    assert!(loaded.viewpoints > 50 && loaded.exposed > 50 && loaded.capturable_percent > 10.0, "{loaded:?}");
    assert!(stages.contains(&Stage::Field), "{stages:?}");

    let watch = observer.watch("block").unwrap();
    let mut iterations = Vec::new();
    let plan = pilot.plan("block", &quick(), &mut |note| iterations.push(note.done)).unwrap();
    assert!(iterations.is_sorted() && !iterations.is_empty(), "{iterations:?}");
    assert_eq!(plan.asked_by().0, pilot.id());
    let seen = watch.next(PATIENCE).unwrap().expect("the plan is published to everybody");
    assert_eq!((seen.epoch(), seen.asked_by()), (plan.epoch(), plan.asked_by()));

    let tallest = observer.structures("block").unwrap().into_iter().max_by(|a, b| a.top_m.total_cmp(&b.top_m)).unwrap();
    let raise = EditOrder::Raise { structure: tallest.name.clone(), by_m: 15.0 };
    let edited = observer.edit("block", &raise).unwrap();
    assert_eq!((edited.revision, edited.replan_follows), (2, true));
    let replan = observer.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
    assert_eq!(replan.table().facts.revision, 2);
    assert_eq!(replan.asked_by(), (observer.id(), edited.correlation));
    // What can still be flown comes first, before anybody knows what it captures, then the same with that; both answer nobody.
    let safe = watch.next(PATIENCE).unwrap().expect("the flight of before is made safe");
    assert_eq!((safe.table().facts.revision, safe.table().facts.stop, safe.asked_by()), (2, SAFE, (0, 0)));
    assert!(safe.table().facts.metrics.coverage_percent.is_nan() && safe.table().cells.is_empty());
    let repaired = watch.next(PATIENCE).unwrap().expect("the flight of before is repaired");
    assert_eq!((repaired.table().facts.revision, repaired.table().facts.stop, repaired.asked_by()), (2, 6, (0, 0)));
    assert!(repaired.table().waypoints == safe.table().waypoints && repaired.table().images == safe.table().images);
    assert_eq!(repaired.differs_from(), Some((safe.epoch(), safe.table().waypoints.len())), "nothing of it differs");
    assert!(repaired.table().facts.metrics.coverage_percent > 0.0 && !repaired.table().cells.is_empty());
    assert!(plan.epoch() < safe.epoch() && safe.epoch() < repaired.epoch() && repaired.epoch() < replan.epoch());
    // Each says where it leaves the one before.
    assert_eq!(plan.differs_from(), None);
    for (earlier, later) in [(&plan, &safe), (&safe, &repaired), (&repaired, &replan)] {
        let (epoch, first) = later.differs_from().expect("it follows another one");
        let [before, now] = [earlier, later].map(|plan| plan.table().waypoints.to_vec());
        assert!(epoch == earlier.epoch() && before[..first] == now[..first]);
        assert!(before == now || before.get(first) != now.get(first));
    }
    let seen = watch.next(PATIENCE).unwrap().expect("the replan is published to everybody");
    assert_eq!(seen.epoch(), replan.epoch());

    let raised = observer.structures("block").unwrap().into_iter().find(|known| known.id == tallest.id).unwrap();
    assert!((raised.top_m - tallest.top_m - 15.0).abs() < 1e-9, "{raised:?} after {tallest:?}");
}

#[test]
fn better_flights_are_published_while_the_search_goes_on() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let order = PlanOrder { iterations: Some(60), goal_percent: Some(90.0), ..Default::default() };
    client.plan("block", &order, &mut |_| {}).unwrap();
    let watch = client.watch("block").unwrap();
    let structure = client.structures("block").unwrap()[0].name.clone();
    let edited = client.edit("block", &EditOrder::Raise { structure, by_m: 6.0 }).unwrap();
    let mut plans = Vec::new();
    while plans.last().is_none_or(|plan: &PlanMessage| plan.asked_by().0 == 0) {
        plans.push(watch.next(PATIENCE).unwrap().expect("a last plan"));
    }
    let stops: Vec<u64> = plans.iter().map(|plan| plan.table().facts.stop).collect();
    assert!(stops.len() > 3 && stops[..2] == [SAFE, 6] && stops[2..stops.len() - 1].iter().all(|stop| *stop == 7), "{stops:?}");
    assert!(plans.iter().all(|plan| plan.table().facts.revision == edited.revision));
    let figures = |plan: &PlanMessage| plan.table().facts.metrics;
    for pair in plans[1..plans.len() - 1].windows(2) {
        let [before, now] = [figures(&pair[0]), figures(&pair[1])];
        assert!(
            now.profile_s < before.profile_s
                || now.coverage_percent > before.coverage_percent
                || now.matched_percent > before.matched_percent
        );
    }
}

#[test]
fn an_edit_after_which_nothing_can_be_flown_for_is_told_to_everybody() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    // Only one structure counts, and then it is gone.
    let map = client.field("block").unwrap();
    let table = map.table();
    let alone = table.structures.iter().find_map(|row| {
        let own = row.first_sample as usize..(row.first_sample + row.samples) as usize;
        let along = |axis: usize| table.samples[own.clone()].iter().map(move |sample| sample.position_m[axis]);
        let ends = |axis: usize| along(axis).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        let ends = [ends(0), ends(1)].map(|[low, high]| [low - 0.01, high + 0.01]);
        let is_in = |i: usize| (0..2).all(|axis| (ends[axis][0]..=ends[axis][1]).contains(&table.samples[i].position_m[axis]));
        let is_alone = !own.is_empty() && (0..table.samples.len()).filter(|i| !own.contains(i)).all(|i| !is_in(i));
        is_alone.then(|| (table.name(row).into_owned(), ends))
    });
    let (structure, [[west, east], [south, north]]) = alone.expect("some structure stands apart");
    let region_m = vec![[west, south], [east, south], [east, north], [west, north]];
    let plan = client.plan("block", &PlanOrder { region_m, ..quick() }, &mut |_| {}).unwrap();
    let watch = client.watch("block").unwrap();
    let edited = client.edit("block", &EditOrder::Remove { structure }).unwrap();
    // The flight before can be flown, but there is nothing that it is for.
    let safe = watch.next(PATIENCE).unwrap().expect("a flight that is safe");
    assert!(safe.table().facts.stop == SAFE && safe.differs_from().is_some_and(|(follows, _)| follows == plan.epoch()));
    let told = watch.next(PATIENCE).unwrap().expect("everybody is told");
    assert!(told.infeasible().is_some_and(|reason| reason.contains("captured")), "{:?}", told.infeasible());
    assert_eq!((told.table().facts.revision, told.table().waypoints.len()), (edited.revision, 0));
    assert_eq!(told.differs_from(), Some((safe.epoch(), 0)));
    assert_eq!(refusal(client.await_replan(&edited, PATIENCE, &mut |_| {})).0, RefusalCode::Plan);
}

#[test]
fn the_same_request_gives_the_same_plan() {
    let served = Served::start();
    let client = served.client();
    load(&client, "one");
    load(&client, "two");
    let plans = ["one", "two"].map(|scene| client.plan(scene, &quick(), &mut |_| {}).unwrap());
    let [one, two] = plans.map(|plan| plan_table::from_table(&plan.table()).unwrap().0);
    assert_eq!(one.waypoints, two.waypoints);
    assert_eq!(one.metrics, two.metrics);
    assert_eq!(one.cells, two.cells);
}

#[test]
fn a_late_joiner_reads_the_field_where_it_lies() {
    let served = Served::start();
    let loaded = load(&served.client(), "block");
    let joiner = served.client();
    let field = joiner.field("block").unwrap();
    let table = field.table();
    assert_eq!(table.viewpoints.len() as u64, loaded.viewpoints);
    assert_eq!(field.bytes(), loaded.field_bytes);
    assert!((0..table.viewpoints.len()).any(|j| table.row(j).samples().next().is_some()));

    let plan = joiner.plan("block", &quick(), &mut |_| {}).unwrap();
    assert_eq!(plan.table().cells.len(), table.samples.len());
    let name = table.name(&table.structures[0]).into_owned();
    let edited = joiner.edit("block", &EditOrder::Remove { structure: name }).unwrap();
    joiner.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
    let newer = joiner.field("block").unwrap();
    assert!(newer.epoch() > field.epoch());
    assert_eq!((field.table().facts.revision, newer.table().facts.revision), (1, 2));
    assert_eq!(newer.table().structures.len() + 1, field.table().structures.len());
}

#[test]
fn a_newer_request_takes_the_place_of_an_older_one() {
    let served = Served::start();
    let loaded = load(&served.client(), "block");
    let rival = served.client();
    std::thread::scope(|threads| {
        let patient = threads.spawn(|| refusal(served.client().plan(&loaded.scene, &endless(), &mut |_| {})));
        wait_for("the search", || rival.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
        rival.plan(&loaded.scene, &quick(), &mut |_| {}).unwrap();
        assert_eq!(patient.join().unwrap().0, RefusalCode::Superseded);
    });
}

#[test]
fn a_request_that_is_refused_leaves_a_running_search_alone() {
    let served = Served::start();
    let loaded = load(&served.client(), "block");
    let rival = served.client();
    std::thread::scope(|threads| {
        let patient = threads.spawn(|| served.client().plan(&loaded.scene, &endless(), &mut |_| {}));
        wait_for("the search", || rival.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
        let unknown = overfly_client::PlanOrder { rig: "kite".into(), ..quick() };
        assert_eq!(refusal(rival.plan(&loaded.scene, &unknown, &mut |_| {})).0, RefusalCode::Plan);
        let shed = EditOrder::Remove { structure: "no such shed".into() };
        assert_eq!(refusal(rival.edit(&loaded.scene, &shed)).0, RefusalCode::UnknownStructure);
        let broken = overfly_client::SceneSource::Bytes { file_name: "block.geojson".into(), bytes: b"{".to_vec() };
        assert_eq!(refusal(rival.load(broken, Some(&loaded.scene), &mut |_| {})).0, RefusalCode::Import);
        assert_eq!(rival.status().unwrap().scenes[0].state, SceneState::Planning);

        rival.cancel(&loaded.scene).unwrap();
        let plan = patient.join().unwrap().expect("a cancelled search gives its best plan so far");
        assert_eq!(plan.table().facts.stop, 2);
    });
}

#[test]
fn of_several_edits_only_the_newest_is_planned() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    std::thread::scope(|threads| {
        let search = threads.spawn(|| served.client().plan("block", &endless(), &mut |_| {}).map(drop));
        wait_for("the search", || client.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
        client.cancel("block").unwrap();
        search.join().unwrap().unwrap();
    });
    let structure = client.structures("block").unwrap()[0].name.clone();
    let edits: Vec<_> =
        (0..5).map(|_| client.edit("block", &EditOrder::Raise { structure: structure.clone(), by_m: 1.0 }).unwrap()).collect();
    client.cancel("block").unwrap();
    let last = client.await_replan(&edits[4], PATIENCE, &mut |_| {}).unwrap();
    assert_eq!(last.table().facts.revision, 6);
    let superseded = edits[..4]
        .iter()
        .map(|edited| client.await_replan(edited, PATIENCE, &mut |_| {}))
        .filter(|outcome| outcome.as_ref().is_err())
        .map(|outcome| refusal(outcome).0)
        .collect::<Vec<_>>();
    assert_eq!(superseded, [RefusalCode::Superseded; 4]);
}

/// A daemon whose flights end at 120 m and must stay above the scene, so that a slab over everything leaves nowhere to fly.
fn served_below_a_low_ceiling() -> Served {
    Served::with_settings("[flight]\nlateral_margin_m = 0.0\nlegal_ceiling_m = 120.0")
}

fn slab() -> EditOrder {
    let outline_m = vec![[-200.0, -200.0], [200.0, -200.0], [200.0, 200.0], [-200.0, 200.0]];
    EditOrder::add_prism("slab", outline_m, 0.0, 119.0)
}

#[test]
fn an_edit_that_leaves_nothing_to_plan_on_is_refused_and_changes_nothing() {
    let served = served_below_a_low_ceiling();
    let client = served.client();
    load(&client, "block");
    for revision in 1..=2 {
        let (code, message) = refusal(client.edit("block", &slab()));
        assert_eq!(code, RefusalCode::Field, "{message}");
        assert!(message.contains(&format!("revision {revision}")), "{message}");
        assert_eq!(client.field("block").unwrap().table().facts.revision, revision);
        let structures = client.structures("block").unwrap();
        assert!(structures.iter().all(|structure| structure.name != "slab"));
        assert_eq!(client.status().unwrap().scenes[0].revision, revision);
        // The second time on a scene that has been planned.
        client.plan("block", &quick(), &mut |_| {}).unwrap();
        let raise = EditOrder::Raise { structure: structures[0].name.clone(), by_m: 1.0 };
        assert_eq!(client.edit("block", &raise).unwrap().revision, revision + 1);
    }
}

#[test]
fn an_edit_that_is_refused_leaves_a_running_search_alone() {
    let served = served_below_a_low_ceiling();
    let client = served.client();
    load(&client, "block");
    std::thread::scope(|threads| {
        let search = threads.spawn(|| served.client().plan("block", &endless(), &mut |_| {}));
        wait_for("the search", || client.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
        assert_eq!(refusal(client.edit("block", &slab())).0, RefusalCode::Field);
        client.cancel("block").unwrap();
        assert_eq!(search.join().unwrap().expect("the best plan so far").table().facts.revision, 1);
    });
}

#[test]
fn of_edits_that_come_together_a_bad_one_takes_no_good_one_along() {
    let served = served_below_a_low_ceiling();
    let client = served.client();
    load(&client, "block");
    let names: Vec<String> = client.structures("block").unwrap().into_iter().map(|structure| structure.name).collect();
    let edits: Vec<EditOrder> = (0..6)
        .map(|index| if index == 2 { slab() } else { EditOrder::Raise { structure: names[index].clone(), by_m: 1.0 } })
        .collect();
    let start = std::sync::Barrier::new(edits.len());
    let answers: Vec<_> = std::thread::scope(|threads| {
        let (served, start) = (&served, &start);
        let make = |edit| {
            move || {
                let client = served.client();
                start.wait();
                client.edit("block", edit)
            }
        };
        let running: Vec<_> = edits.iter().map(|edit| threads.spawn(make(edit))).collect();
        running.into_iter().map(|edit| edit.join().unwrap()).collect()
    });
    let mut revisions = Vec::new();
    for (index, answer) in answers.into_iter().enumerate() {
        match index {
            2 => assert_eq!(refusal(answer).0, RefusalCode::Field),
            _ => revisions.push(answer.unwrap().revision),
        }
    }
    revisions.sort_unstable();
    assert_eq!(revisions, [2, 3, 4, 5, 6]);
    assert_eq!(client.status().unwrap().scenes[0].revision, 6);
}

#[test]
fn a_load_that_fails_leaves_the_edits_of_the_scene_alone() {
    let served = served_below_a_low_ceiling();
    let client = served.client();
    load(&client, "block");
    client.plan("block", &quick(), &mut |_| {}).unwrap();
    let structure = client.structures("block").unwrap()[0].name.clone();
    let corners = [[4.46, 51.90], [4.47, 51.90], [4.47, 51.91], [4.46, 51.91], [4.46, 51.90]];
    let geojson = serde_json::json!({ "type": "FeatureCollection", "features": [{
        "type": "Feature", "properties": { "height": 119.0 }, "geometry": { "type": "Polygon", "coordinates": [corners] } }] });
    for revision in 2..8 {
        std::thread::scope(|threads| {
            let load = threads.spawn(|| {
                let bytes = geojson.to_string().into_bytes();
                let slab = overfly_client::SceneSource::Bytes { file_name: "slab.geojson".into(), bytes };
                refusal(served.client().load(slab, Some("block"), &mut |_| {}))
            });
            let raise = EditOrder::Raise { structure: structure.clone(), by_m: 1.0 };
            // While the scene is being loaded its edits are refused as busy.
            let edited = wait_for("the edit", || client.edit("block", &raise).ok());
            assert_eq!((edited.revision, edited.replan_follows), (revision, true));
            let replan = client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
            assert_eq!(replan.table().facts.revision, revision);
            assert_eq!(load.join().unwrap().0, RefusalCode::Field);
        });
        let scene = client.status().unwrap().scenes.remove(0);
        assert_eq!((scene.revision, scene.plan.map(|plan| plan.revision)), (revision, Some(revision)));
    }
}

#[test]
fn of_two_loads_of_one_name_the_later_request_wins() {
    let served = Served::start();
    let client = served.client();
    std::thread::scope(|threads| {
        let (reading, is_reading) = std::sync::mpsc::channel();
        let served = &served;
        let slow = threads.spawn(move || {
            let large = generate_block(&BlockSettings { extent_m: [900.0, 900.0], buildings: 400, ..Default::default() });
            let bytes = write::to_geojson(&large).into_bytes();
            let source = overfly_client::SceneSource::Bytes { file_name: "large.geojson".into(), bytes };
            served.client().load(source, Some("town"), &mut |_| reading.send(()).unwrap_or(()))
        });
        is_reading.recv().unwrap();
        let loaded = load(&client, "town");
        // The earlier one may have been quicker all the same; it is never the one that stays.
        match slow.join().unwrap() {
            Ok(earlier) => assert_eq!(earlier.scene, "town"),
            earlier => assert_eq!(refusal(earlier).0, RefusalCode::Superseded),
        }
        let scenes = client.status().unwrap().scenes;
        assert_eq!((scenes.len(), scenes[0].structures), (1, loaded.structures));
    });
}

#[test]
fn the_status_is_published_when_it_changes_and_to_whoever_comes_later() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let feed = served.client().status_feed().unwrap();
    let first = feed.next(PATIENCE).unwrap().expect("the last status is kept for late joiners");
    assert_eq!((first.pid, first.scenes[0].name.as_str(), first.scenes[0].revision), (served.pid(), "block", 1));
    let follow = |what: &str, wanted: &dyn Fn(&overfly_client::SceneStatus) -> bool| {
        while !feed.next(PATIENCE).unwrap().expect(what).scenes.iter().any(wanted) {}
    };
    let structure = client.structures("block").unwrap()[0].name.clone();
    client.edit("block", &EditOrder::Raise { structure, by_m: 1.0 }).unwrap();
    follow("the edit", &|scene| scene.revision == 2);
    client.plan("block", &quick(), &mut |_| {}).unwrap();
    follow("the plan", &|scene| scene.state == SceneState::Idle && scene.plan.is_some_and(|plan| plan.revision == 2));
    client.unload("block").unwrap();
    while !feed.next(PATIENCE).unwrap().expect("the end of the scene").scenes.is_empty() {}
}

#[test]
fn a_replan_whose_start_was_built_over_takes_another_start_and_says_so() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let plan = client.plan("block", &quick(), &mut |_| {}).unwrap();
    let start = plan_table::from_table(&plan.table()).unwrap().0.waypoints[0].position_m;
    let order = overfly_client::PlanOrder { start_m: Some([start.x, start.y, start.z]), ..quick() };
    client.plan("block", &order, &mut |_| {}).unwrap();
    let outline_m = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]].map(|[x, y]| [start.x + x, start.y + y]).to_vec();
    let tower = EditOrder::add_prism("tower", outline_m, 0.0, start.z + 2.0);
    let edited = client.edit("block", &tower).unwrap();
    let replan = client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
    assert_eq!(replan.table().facts.revision, 2);
    let scene = client.status().unwrap().scenes.remove(0);
    assert!(scene.remark.is_some_and(|remark| remark.contains("another start")));
    assert!(scene.plan.is_some_and(|plan| !plan.is_stale));
    // Whoever asks for that start himself is told that it does not serve.
    assert_eq!(refusal(client.plan("block", &order, &mut |_| {})).0, RefusalCode::Plan);
}

#[test]
fn a_plan_of_an_earlier_revision_is_marked_as_stale() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    std::thread::scope(|threads| {
        let search = threads.spawn(|| served.client().plan("block", &endless(), &mut |_| {}).map(drop));
        wait_for("the search", || client.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
        client.cancel("block").unwrap();
        search.join().unwrap().unwrap();
    });
    let is_stale = || client.status().unwrap().scenes[0].plan.is_some_and(|plan| plan.is_stale);
    assert!(!is_stale());
    let structure = client.structures("block").unwrap()[0].name.clone();
    let edited = client.edit("block", &EditOrder::Raise { structure, by_m: 1.0 }).unwrap();
    wait_for("the mark", || is_stale().then_some(()));
    client.cancel("block").unwrap();
    client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
    assert!(!is_stale());
}

#[test]
fn scenes_are_listed_and_unloaded() {
    let served = Served::with_settings("memory_budget_mb = 1");
    let client = served.client();
    assert_eq!(client.watch("a").err().map(|error| refusal::<()>(Err(error)).0), Some(RefusalCode::UnknownScene));
    let loaded = load(&client, "a");
    let status = client.status().unwrap();
    assert_eq!((status.pid, status.field_bytes), (served.pid(), loaded.field_bytes));
    assert!(status.resident_mb > 0.0 && status.uptime_s > 0.0);
    let fit = status.budget_bytes / loaded.field_bytes;
    let names: Vec<String> = (0..=fit).map(|index| format!("b{index}")).collect();
    let over =
        names.iter().find_map(|name| client.load(block(1, 9), Some(name), &mut |_| {}).err()).expect("the budget is small");
    let (code, message) = refusal::<()>(Err(over));
    assert_eq!(code, RefusalCode::Memory);
    assert!(message.contains("memory_budget_mb"), "{message}");
    client.unload("a").unwrap();
    load(&client, "c");
    assert!(client.status().unwrap().scenes.iter().all(|scene| scene.name != "a"));
}

#[test]
fn a_short_plan_is_made_while_long_ones_run_on_other_scenes() {
    let served = Served::with_settings("threads = 2");
    let client = served.client();
    let busy = ["a", "b", "c"];
    busy.iter().chain(&["short"]).for_each(|name| drop(load(&client, name)));
    std::thread::scope(|threads| {
        let long = busy.map(|name| {
            let pilot = served.client();
            threads.spawn(move || pilot.plan(name, &endless(), &mut |_| {}).map(drop))
        });
        let planning = || client.status().unwrap().scenes.iter().filter(|s| s.state == SceneState::Planning).count();
        wait_for("three searches", || (planning() == 3).then_some(()));
        client.plan("short", &quick(), &mut |_| {}).unwrap();
        let name = client.structures("short").unwrap()[0].name.clone();
        let edited = client.edit("short", &EditOrder::Raise { structure: name, by_m: 1.0 }).unwrap();
        client.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
        assert_eq!(planning(), 3, "the long searches are still running");
        busy.iter().for_each(|name| client.cancel(name).unwrap());
        long.into_iter().for_each(|search| search.join().unwrap().unwrap());
    });
}

#[test]
fn a_ping_is_acknowledged_while_a_search_runs() {
    let served = Served::start();
    let loaded = load(&served.client(), "block");
    let client = served.client();
    std::thread::scope(|threads| {
        let search = threads.spawn(|| served.client().plan(&loaded.scene, &endless(), &mut |_| {}));
        wait_for("the search", || client.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
        let samples = overfly_client::bench::ping(&client, 50, Duration::ZERO).unwrap();
        assert_eq!(samples.len(), 50);
        client.cancel(&loaded.scene).unwrap();
        search.join().unwrap().unwrap();
    });
}
