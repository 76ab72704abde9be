//! `overfly serve`: the daemon in the foreground.

use std::io::{self, IsTerminal, Read};
use std::path::Path;
use std::time::Duration;

use overfly_client::Domain;
use rustix::process::{Signal, getpid, kill_process};
use tracing_subscriber::EnvFilter;

use super::arguments::ServeArgs;
use super::failure::Failure;
use super::{rig_file, settings_file};
use crate::daemon;

/// How often and how long the end of the last client is waited for.
const LOOKS: u32 = 50;
const LOOK_AGAIN: Duration = Duration::from_millis(5);

pub fn run(arguments: &ServeArgs) -> Result<(), Failure> {
    let mut settings = settings_file::settings(arguments.config.as_ref(), None)?;
    if let Some(rig) = &arguments.rig {
        settings = settings.with_sight(rig_file::read(rig)?.rig.sight_scale());
        settings.check()?;
    }
    let name = arguments.reach.domain.clone().unwrap_or_else(|| settings.daemon.domain.clone());
    let domain = Domain::new(&name)?;
    start_log();
    if arguments.until_stdin_ends {
        std::thread::spawn(end_with_stdin);
    }
    // The folder of all domains did not exist before: it goes with this one, unless another domain lives there by now.
    let made_parent = domain.root().parent().filter(|parent| !parent.exists()).map(Path::to_path_buf);
    let served = daemon::serve(settings, arguments.config.clone(), &domain);
    if let Some(parent) = made_parent {
        leave(&domain, &parent);
    }
    Ok(served?)
}

/// Removes what is left of the domain and its parent. The client that asked for the end may still be on its way out.
fn leave(domain: &Domain, parent: &Path) {
    for _ in 0..LOOKS {
        domain.sweep_if_deserted();
        if std::fs::remove_dir(parent).is_ok() {
            return;
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

fn start_log() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let has_colours = io::stderr().is_terminal();
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(io::stderr).with_ansi(has_colours).with_target(false).init();
}

/// Ends this process the way SIGTERM does as soon as standard input ends: it ends with the program at its other end, however that
/// dies.
fn end_with_stdin() {
    let mut ignored = [0; 64];
    while io::stdin().read(&mut ignored).is_ok_and(|bytes| bytes > 0) {}
    let _ = kill_process(getpid(), Signal::TERM);
}
