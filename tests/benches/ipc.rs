//! Messages and tables between two processes: a real daemon, and a publisher of a field of 100 MB.
//!
//! `cargo bench --bench ipc` prints median, p99 and spread beside the goal. `overfly bench ipc FILE` measures the same on a scene.

mod publisher;

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use overfly_client::{Client, Domain, bench};
use publisher::{TABLE_SCENE, serve_table};

const TABLE: &str = "OVERFLY_BENCH_TABLE";
const TABLE_MEGABYTES: usize = 100;
const PATIENCE: Duration = Duration::from_secs(10);

fn main() {
    if let Ok(name) = std::env::var(TABLE) {
        let domain = Domain::new(&name).expect("the parent chose the name");
        serve_table(&domain, TABLE_MEGABYTES, || println!("ready"));
        return;
    }
    println!("{:<34} {:>10} {:>10} {:>10}   goal", "", "median", "p99", "spread");
    pings();
    joins();
}

fn pings() {
    let domain = domain("ping");
    let mut daemon = Command::new(env!("CARGO_BIN_EXE_overfly"));
    daemon.args(["serve", "--domain", domain.name()]).stdin(Stdio::null()).stderr(Stdio::null());
    let mut daemon = daemon.spawn().expect("the daemon starts");
    let client = Client::connect(&domain, PATIENCE).expect("the daemon answers");
    row("acknowledged, back to back, us", 1e3, bench::ping(&client, 10_000, Duration::ZERO).unwrap(), "p50 50, p99 200");
    row("acknowledged, 1 ms apart, us", 1e3, bench::ping(&client, 2_000, Duration::from_millis(1)).unwrap(), "p50 50, p99 200");
    client.stop().expect("the daemon ends");
    daemon.wait().expect("the daemon has ended");
}

fn joins() {
    let domain = domain("join");
    let mut publisher = table_publisher(&domain);
    row("late joiner has 100 MB, ms", 1e6, bench::join(&domain, TABLE_SCENE, 300).unwrap(), "2");
    // It ends with its input.
    drop(publisher.stdin.take());
    publisher.wait().expect("the publisher has ended");
}

fn table_publisher(domain: &Domain) -> Child {
    let mut command = Command::new(std::env::current_exe().expect("this program has a path"));
    command.env(TABLE, domain.name()).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().expect("the publisher starts");
    let mut lines = BufReader::new(child.stdout.take().expect("it was piped")).lines();
    assert!(lines.any(|line| line.is_ok_and(|line| line == "ready")), "the publisher ended early");
    child
}

fn domain(what: &str) -> Domain {
    Domain::new(&format!("{what}-{}", std::process::id())).expect("a short name")
}

fn row(what: &str, unit: f64, mut samples: Vec<u64>, goal: &str) {
    samples.sort_unstable();
    let at = |share: f64| samples[((samples.len() - 1) as f64 * share) as usize] as f64 / unit;
    println!("{what:<34} {:>10.2} {:>10.2} {:>10.2}   {goal}", at(0.5), at(0.99), at(0.9) - at(0.1));
}
