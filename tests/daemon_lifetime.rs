//! Starts and ends of a daemon process: what signals do, what is left behind, and how a killed daemon is followed by another.

mod served;

use std::time::Duration;

use overfly_client::{Client, ClientError, FieldMap, RefusalCode, SceneState};
use served::{PATIENCE, Served, endless, fresh_domain, load, quick, refusal, wait_for};

fn sees_something(field: &FieldMap) -> bool {
    let table = field.table();
    (0..table.viewpoints.len()).any(|j| table.row(j).samples().next().is_some())
}

#[test]
fn sigterm_and_sigint_leave_nothing_behind() {
    for signal in ["-TERM", "-INT"] {
        let mut served = Served::start();
        let client = served.client();
        load(&client, "block");
        client.plan("block", &quick(), &mut |_| {}).unwrap();
        drop(client);
        assert!(!served.leftovers().is_empty());
        served.signal(signal);
        assert!(served.ended().success());
        assert_eq!(served.leftovers(), Vec::<std::path::PathBuf>::new());
    }
}

#[test]
fn the_last_client_tidies_up_when_the_daemon_ended_before_it() {
    let mut served = Served::start();
    let client = served.client();
    load(&client, "block");
    let field = client.field("block").unwrap();
    served.signal("-TERM");
    assert!(served.ended().success());
    // What was mapped stays readable.
    assert!(sees_something(&field));
    drop(client);
    drop(field);
    assert_eq!(served.leftovers(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn a_stop_request_ends_the_daemon_and_a_running_search_gives_its_plan() {
    let mut served = Served::start();
    let loaded = load(&served.client(), "block");
    let (pilot, other) = (served.client(), served.client());
    std::thread::scope(|threads| {
        let search = threads.spawn(move || {
            let mut under_way = false;
            let plan = pilot.plan(&loaded.scene, &endless(), &mut |note| under_way |= note.done > 0);
            (plan, pilot)
        });
        wait_for("the search", || {
            other.status().unwrap().scenes.iter().find(|s| s.state == overfly_client::SceneState::Planning).map(drop)
        });
        other.stop().unwrap();
        let (plan, _pilot) = search.join().unwrap();
        assert_eq!(plan.expect("the best plan so far").table().facts.stop, 2);
    });
    assert!(served.ended().success());
    drop(other);
    assert_eq!(served.leftovers(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn whoever_waits_is_told_when_the_daemon_is_killed() {
    let mut served = Served::start();
    let client = served.client();
    load(&client, "block");
    let watch = client.watch("block").unwrap();
    std::thread::scope(|threads| {
        let search = threads.spawn(|| served.client().plan("block", &endless(), &mut |_| {}));
        wait_for("the search", || client.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
        served.signal("-KILL");
        let lost = search.join().unwrap().err();
        assert!(matches!(lost, Some(ClientError::Lost { .. })), "{lost:?}");
    });
    let lost = watch.next(PATIENCE).err();
    assert!(matches!(lost, Some(ClientError::Lost { .. })), "{lost:?}");
    drop((watch, client));
    served.ended();
}

#[test]
fn the_search_of_a_killed_client_is_stopped_and_its_plan_published() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let watch = client.watch("block").unwrap();
    let arguments = ["plan", "block", "--method", "paper", "--iterations", "1000000", "--domain", served.domain.name()];
    let mut pilot = std::process::Command::new(env!("CARGO_BIN_EXE_overfly"))
        .args(arguments)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    wait_for("the search", || client.status().unwrap().scenes.iter().find(|s| s.state == SceneState::Planning).map(drop));
    pilot.kill().unwrap();
    pilot.wait().unwrap();
    let plan = watch.next(PATIENCE).unwrap().expect("the best plan so far");
    assert_eq!(plan.table().facts.stop, 2);
}

#[test]
fn a_killed_daemon_is_followed_by_another_that_serves_anew() {
    let mut served = Served::start();
    let survivor = served.client();
    load(&survivor, "block");
    let watch = survivor.watch("block").unwrap();
    let old_field = survivor.field("block").unwrap();
    served.signal("-KILL");
    served.restart();

    let client = served.client();
    let old_instance = old_field.instance();
    load(&client, "block");
    let field = client.field("block").unwrap();
    assert_ne!(field.instance(), old_instance, "the killed daemon's field must not be taken for the new one");
    assert!(sees_something(&old_field), "what was mapped stays readable");

    assert!(matches!(survivor.status(), Err(ClientError::Restarted { .. })));
    assert_eq!(survivor.status().unwrap().scenes.len(), 1, "a client that was told goes on with the new daemon");
    assert_eq!(survivor.field("block").unwrap().instance(), field.instance());
    let plan = client.plan("block", &quick(), &mut |_| {}).unwrap();
    assert_eq!(watch.next(PATIENCE).unwrap().map(|seen| seen.instance()), Some(plan.instance()));
}

#[test]
fn clients_of_one_process_may_leave_a_killed_daemon_one_by_one() {
    let mut served = Served::start();
    let (one, other) = (served.client(), served.client());
    served.signal("-KILL");
    served.ended();
    // The first one leaves while nobody serves, the other one when somebody does again.
    drop(one);
    served.restart();
    let client = served.client();
    assert!(matches!(other.status(), Err(ClientError::Restarted { .. })));
    drop(other);
    load(&client, "block");
    assert_eq!(served.client().status().unwrap().scenes.len(), 1);
}

#[test]
fn a_killed_daemon_without_clients_leaves_nothing_after_the_next_one() {
    let mut served = Served::start();
    load(&served.client(), "block");
    served.signal("-KILL");
    served.ended();
    assert!(!served.leftovers().is_empty());
    let gone = Client::connect(&served.domain, Duration::ZERO).err();
    assert!(matches!(gone, Some(ClientError::NoDaemon { .. })), "{gone:?}");
    served.restart();
    load(&served.client(), "block");
    served.signal("-TERM");
    assert!(served.ended().success());
    assert_eq!(served.leftovers(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn a_second_daemon_in_the_same_domain_says_who_serves_it() {
    let served = Served::start();
    let client = served.client();
    let (status, said) = served.rival();
    assert!(!status.success());
    assert!(said.contains(served.domain.name()) && said.contains(&served.pid().to_string()), "{said}");
    client.ping().unwrap();
}

#[test]
fn without_a_daemon_a_client_says_how_to_start_one_and_leaves_nothing() {
    let domain = fresh_domain();
    let error = Client::connect(&domain, Duration::ZERO).err().expect("nobody serves the domain");
    assert!(matches!(error, ClientError::NoDaemon { .. }));
    assert!(error.to_string().contains("overfly serve"), "{error}");
    assert!(domain.shared_memory_files().is_empty() && !domain.root().exists());
}

#[test]
fn a_client_may_come_before_its_daemon() {
    let mut served = Served::start();
    served.signal("-TERM");
    served.ended();
    std::thread::scope(|threads| {
        let domain = served.domain.clone();
        let early = threads.spawn(move || Client::connect(&domain, PATIENCE).map(|client| client.ping().map(drop)));
        served.restart();
        early.join().unwrap().unwrap().unwrap();
    });
}

#[test]
fn sighup_and_reload_take_a_good_configuration_and_keep_the_old_one_for_a_bad_one() {
    let served = Served::with_settings("memory_budget_mb = 500");
    let client = served.client();
    let budget = || client.status().unwrap().budget_bytes / 1_000_000;
    assert_eq!(budget(), 500);
    std::fs::write(&served.config, "[daemon]\nmemory_budget_mb = 600\n").unwrap();
    served.signal("-HUP");
    wait_for("the new budget", || (budget() == 600).then_some(()));
    std::fs::write(&served.config, "[daemon]\nmemory_budget = 700\n").unwrap();
    let (code, message) = refusal(client.reload());
    assert_eq!(code, RefusalCode::Configuration);
    assert!(message.contains("memory_budget"), "{message}");
    assert_eq!(budget(), 600);
    std::fs::write(&served.config, "[daemon]\nmemory_budget_mb = 700\n").unwrap();
    client.reload().unwrap();
    assert_eq!(budget(), 700);
}
