//! Shared memory that others hold, lose or use up does not stop the daemon.

mod served;

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use overfly::scene::{BlockSettings, generate_block, write};
use overfly_client::{Client, Domain, EditOrder, FieldMap, RefusalCode, SceneSource};
use overfly_wire::service::FIELD_SAMPLES;
use served::{PATIENCE, Served, block, load, refusal, wait_for};

const HOLDER: &str = "OVERFLY_TEST_HOLDER";
const CRAMPED: &str = "OVERFLY_TEST_CRAMPED";

#[test]
fn a_client_that_is_killed_while_it_holds_a_field_starves_nobody() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let mut holders: Vec<Child> = (0..4).map(|_| holder(&served.domain)).collect();
    for holder in &mut holders {
        holder.kill().unwrap();
        holder.wait().unwrap();
    }
    for revision in 2..2 + 2 * FIELD_SAMPLES as u64 {
        rebuild(&client, revision);
    }
}

#[test]
fn a_client_that_keeps_every_old_field_starves_nobody() {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    let mut kept: Vec<FieldMap> = Vec::new();
    // More than twice as many as one publisher has room for; each takes a subscriber of its own.
    for revision in 2..2 + 2 * FIELD_SAMPLES as u64 + 3 {
        kept.push(client.field("block").unwrap());
        rebuild(&client, revision);
    }
    for (index, field) in kept.iter().enumerate() {
        assert_eq!(field.table().facts.revision, index as u64 + 1, "a field that is held never changes");
    }
}

#[test]
fn fields_before_and_after_an_edit_share_what_it_leaves_alone() {
    let served = Served::start();
    let client = served.client();
    let loaded = client.load(town(), Some("town"), &mut |_| {}).unwrap();
    let before = client.field("town").unwrap();
    let files = segment_files(&served);
    assert_eq!(files.len(), before.table().tiles.len());
    let used = || client.status().unwrap().field_bytes;
    assert_eq!(used(), loaded.field_bytes);

    // Whoever holds the older field keeps it.
    let structure = client.structures("town").unwrap()[0].name.clone();
    client.edit("town", &EditOrder::Raise { structure, by_m: 0.1 }).unwrap();
    let newer = || client.field("town").ok().filter(|field| field.table().facts.revision == 2);
    let after = wait_for("the new field", newer);
    let numbers = |field: &FieldMap| field.table().tiles.iter().map(|tile| tile.number).collect::<BTreeSet<_>>();
    let (old, new) = (numbers(&before), numbers(&after));
    let common = old.intersection(&new).count();
    assert!(common > new.len() / 2 && common < new.len(), "{common} of {} segments are shared", new.len());
    let mapped = |field: &FieldMap, number: u64| {
        let table = field.table();
        let place = table.tiles.iter().position(|tile| tile.number == number).unwrap();
        table.segments[place].memory().blocks().as_ptr()
    };
    assert!(old.intersection(&new).all(|&number| mapped(&before, number) == mapped(&after, number)), "mapped once");
    assert_eq!(before.table().facts.revision, 1);

    // The daemon's files are those of its current field, and only they count.
    assert!(wait_for("the files of the older field to go", || (segment_files(&served).len() == new.len()).then_some(true)));
    assert_eq!(used(), after.bytes());
    assert!((0..before.table().viewpoints.len()).any(|j| before.table().row(j).samples().next().is_some()));
    client.unload("town").unwrap();
    assert!(wait_for("all files to go", || segment_files(&served).is_empty().then_some(true)));
}

/// A town of many tiles.
fn town() -> SceneSource {
    let scene = generate_block(&BlockSettings { seed: 5, extent_m: [600.0, 600.0], buildings: 60, ..Default::default() });
    SceneSource::Bytes { file_name: "town.geojson".into(), bytes: write::to_geojson(&scene).into_bytes() }
}

fn segment_files(served: &Served) -> Vec<PathBuf> {
    let files = served.domain.shared_memory_files().into_iter();
    files.filter(|path| path.as_os_str().as_encoded_bytes().ends_with(overfly_wire::segment::SUFFIX.as_bytes())).collect()
}

#[test]
fn a_full_dev_shm_is_a_refusal() {
    if std::env::var_os(CRAMPED).is_some() {
        return in_a_cramped_dev_shm();
    }
    // A mount namespace of its own needs the right to make one; where there is none only the error path's unit test remains.
    let inner = std::env::current_exe().unwrap();
    let script = "mount -t tmpfs -o size=12m tmpfs /dev/shm && exec \"$0\" --exact a_full_dev_shm_is_a_refusal --nocapture";
    let unshare = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script]).arg(&inner).env(CRAMPED, "1");
        command
    };
    let possible = unshare("mount -t tmpfs tmpfs /dev/shm").stderr(Stdio::null()).status();
    if !possible.is_ok_and(|status| status.success()) {
        println!("skipped: no mount namespace can be made here");
        return;
    }
    let output = unshare(script).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
}

fn in_a_cramped_dev_shm() {
    let served = Served::start();
    let client = served.client();
    load(&client, "first");
    let free = || {
        let state = rustix::fs::statvfs("/dev/shm").unwrap();
        state.f_bavail * state.f_frsize
    };
    let filler = std::path::Path::new("/dev/shm/filler");
    let room = free() - (1 << 20) - 8192;
    std::fs::write(filler, vec![1u8; room as usize]).unwrap();
    let (code, message) = refusal(client.load(block(2, 9), Some("second"), &mut |_| {}));
    assert_eq!(code, RefusalCode::Memory);
    assert!(message.contains("/dev/shm"), "{message}");
    assert_eq!(client.status().unwrap().scenes.len(), 1);
    std::fs::remove_file(filler).unwrap();
    load(&client, "second");
}

/// Not a test: holds a field until it is killed, in a process of its own.
#[test]
fn hold_a_field() {
    let Ok(name) = std::env::var(HOLDER) else { return };
    let client = Client::connect(&Domain::new(&name).unwrap(), PATIENCE).unwrap();
    let _field = client.field("block").unwrap();
    println!("\nholding");
    loop {
        std::thread::sleep(Duration::from_secs(3600));
    }
}

fn holder(domain: &Domain) -> Child {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "hold_a_field", "--nocapture"])
        .env(HOLDER, domain.name())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(lines.any(|line| line.unwrap() == "holding"), "the holder ended early");
    child
}

/// Makes an edit and waits until its field is published.
fn rebuild(client: &Client, revision: u64) {
    let structure = client.structures("block").unwrap()[0].name.clone();
    client.edit("block", &EditOrder::Raise { structure, by_m: 0.1 }).unwrap();
    let published = || client.field("block").ok().filter(|field| field.table().facts.revision == revision);
    wait_for("the new field", published);
}
