//! A daemon of one's own: a process in a private domain that ends with its owner and leaves nothing behind.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use overfly_client::{Client, Domain};
use rustix::process::{Pid, Signal, kill_process};

use super::failure::Failure;

/// How long a daemon may take to start and to end.
const PATIENCE: Duration = Duration::from_secs(10);
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// Owns the process. Dropping it ends the daemon; should this process be killed, the daemon sees its standard input end.
pub struct PrivateDaemon {
    child: Child,
    domain: Domain,
    /// The directory of all domains did not exist before and shall not stay.
    made_parent: Option<PathBuf>,
}

impl PrivateDaemon {
    /// Starts a daemon with this program; its log goes to `log`, or nowhere. `purpose` and the process id make the domain's name.
    pub fn start(purpose: &str, config: Option<&Path>, log: Option<File>) -> Result<Self, Failure> {
        let domain = Domain::new(&format!("{purpose}-{}", std::process::id()))?;
        let start = |cause| Failure::Unexpected(format!("cannot start a daemon: {cause}"));
        let program = std::env::current_exe().map_err(start)?;
        let mut command = Command::new(program);
        command.args(["serve", "--until-stdin-ends", "--domain", domain.name()]);
        if let Some(path) = config {
            command.arg("--config").arg(path);
        }
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(log.map_or_else(Stdio::null, Stdio::from));
        let made_parent = domain.root().parent().filter(|parent| !parent.exists()).map(Path::to_path_buf);
        Ok(Self { child: command.spawn().map_err(start)?, domain, made_parent })
    }

    /// Connects to it, as soon as it answers.
    pub fn connect(&mut self) -> Result<Client, Failure> {
        let end = Instant::now() + PATIENCE;
        loop {
            match Client::connect(&self.domain, 20 * LOOK_AGAIN) {
                Ok(client) => return Ok(client),
                Err(error) if Instant::now() > end => return Err(error.into()),
                Err(error) => self.check_alive(&error)?,
            }
        }
    }

    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Stops it and waits until it has cleaned up.
    pub fn stop(mut self, client: Client) -> Result<(), Failure> {
        let stopped = client.stop();
        drop(client);
        self.end();
        Ok(stopped?)
    }

    fn check_alive(&mut self, error: &overfly_client::ClientError) -> Result<(), Failure> {
        match self.child.try_wait() {
            Ok(Some(status)) => Err(Failure::Daemon(format!("the daemon has ended with {status} ({error}); its log says why"))),
            _ => Ok(()),
        }
    }

    /// Ends the process: first politely, so that it removes its files, then by force.
    fn end(&mut self) {
        drop(self.child.stdin.take());
        if !matches!(self.child.try_wait(), Ok(Some(_))) {
            let _ = kill_process(Pid::from_child(&self.child), Signal::TERM);
        }
        let end = Instant::now() + PATIENCE;
        while matches!(self.child.try_wait(), Ok(None)) {
            if Instant::now() > end {
                let _ = self.child.kill();
                let _ = self.child.wait();
                break;
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        self.domain.sweep_if_deserted();
        // Fails when another domain lives there by now, and then it must stay.
        self.made_parent.take().into_iter().for_each(|parent| drop(std::fs::remove_dir(parent)));
    }
}

impl Drop for PrivateDaemon {
    fn drop(&mut self) {
        self.end();
    }
}
