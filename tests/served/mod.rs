//! A real daemon process in a domain of its own, for tests.
#![allow(dead_code, reason = "each test uses its own part of this module")]

pub mod vandal;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use overfly::scene::{BlockSettings, generate_block, write};
use overfly_client::{Client, ClientError, Domain, Loaded, PlanOrder, RefusalCode, SceneSource};

/// Long enough for the slowest machine; no test waits so long when all is well.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A daemon that is killed, and whose domain is swept, when the test ends.
pub struct Served {
    pub domain: Domain,
    pub config: PathBuf,
    child: Child,
    _directory: tempfile::TempDir,
}

impl Served {
    /// Starts a daemon with small fields.
    pub fn start() -> Self {
        Self::with_settings("")
    }

    /// Starts a daemon whose configuration ends with `daemon_settings`, lines of the section `[daemon]`.
    pub fn with_settings(daemon_settings: &str) -> Self {
        let directory = tempfile::tempdir().expect("a directory for the configuration");
        let config = directory.path().join("overfly.toml");
        std::fs::write(&config, configuration(daemon_settings)).expect("the configuration is written");
        let domain = fresh_domain();
        let child = spawn(&domain, &config);
        Self { domain, config, child, _directory: directory }
    }

    pub fn client(&self) -> Client {
        Client::connect(&self.domain, PATIENCE).expect("the daemon answers")
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    pub fn signal(&self, signal: &str) {
        let status = Command::new("kill").args([signal, &self.pid().to_string()]).status().expect("kill runs");
        assert!(status.success());
    }

    /// Waits for the daemon to end.
    pub fn ended(&mut self) -> ExitStatus {
        let started = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("the child can be waited for") {
                return status;
            }
            assert!(started.elapsed() < PATIENCE, "the daemon does not end");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Starts a daemon in the same domain, after the first has ended.
    pub fn restart(&mut self) {
        self.ended();
        self.child = spawn(&self.domain, &self.config);
    }

    /// Runs a second daemon in the same domain to its end, and gives what it said.
    pub fn rival(&self) -> (ExitStatus, String) {
        let output = command(&self.domain, &self.config).stderr(Stdio::piped()).output().expect("a second daemon starts");
        (output.status, String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// Everything that the domain has left in shared memory and on disk.
    pub fn leftovers(&self) -> Vec<PathBuf> {
        let mut left = self.domain.shared_memory_files();
        if self.domain.root().exists() {
            left.push(self.domain.root().to_path_buf());
        }
        left
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.domain.sweep_if_deserted();
    }
}

/// A domain that no other test uses.
pub fn fresh_domain() -> Domain {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let name = format!("t{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
    Domain::new(&name).expect("a domain for the test")
}

/// A block of `buildings` buildings as a scene file.
pub fn block(seed: u64, buildings: u32) -> SceneSource {
    let scene = generate_block(&BlockSettings { seed, extent_m: [130.0, 130.0], buildings, ..Default::default() });
    SceneSource::Bytes { file_name: "block.geojson".into(), bytes: write::to_geojson(&scene).into_bytes() }
}

pub fn load(client: &Client, name: &str) -> Loaded {
    client.load(block(1, 9), Some(name), &mut |_| {}).expect("a generated block can be loaded")
}

/// A search that takes well under a second.
pub fn quick() -> PlanOrder {
    PlanOrder { method: "paper".into(), iterations: Some(40), ..Default::default() }
}

/// A search that does not end by itself while a test runs.
pub fn endless() -> PlanOrder {
    PlanOrder { iterations: Some(10_000_000), ..quick() }
}

/// The code of a refusal; anything else fails the test.
pub fn refusal<T>(result: Result<T, ClientError>) -> (RefusalCode, String) {
    match result {
        Err(ClientError::Refused { code, message }) => (code, message),
        Err(other) => panic!("expected a refusal, got the error: {other}"),
        Ok(_) => panic!("expected a refusal, got a result"),
    }
}

/// Calls `ready` until it gives something.
pub fn wait_for<T>(what: &str, mut ready: impl FnMut() -> Option<T>) -> T {
    let started = Instant::now();
    loop {
        if let Some(value) = ready() {
            return value;
        }
        assert!(started.elapsed() < PATIENCE, "{what} does not come");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn configuration(daemon_settings: &str) -> String {
    format!(
        "[surface]\nsamples = 150\n[field]\nviewpoints = 200\n[coverage]\ngoal_percent = 100.0\n[daemon]\n{daemon_settings}\n"
    )
}

fn spawn(domain: &Domain, config: &Path) -> Child {
    command(domain, config).spawn().expect("the daemon starts")
}

fn command(domain: &Domain, config: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_overfly"));
    command.args(["serve", "--domain", domain.name(), "--config"]).arg(config).stdin(Stdio::null());
    if std::env::var_os("OVERFLY_TEST_LOG").is_none() {
        command.stderr(Stdio::null()).stdout(Stdio::null());
    }
    command
}
