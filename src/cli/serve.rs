//! `overfly serve`: the daemon in the foreground.

use std::io::{self, IsTerminal, Read};

use rustix::process::{Signal, getpid, kill_process};
use tracing_subscriber::EnvFilter;

use super::arguments::ServeArgs;
use super::failure::Failure;
use super::settings_file;
use crate::daemon;

pub fn run(arguments: &ServeArgs) -> Result<(), Failure> {
    let settings = settings_file::settings(arguments.config.as_ref(), None)?;
    let name = arguments.reach.domain.clone().unwrap_or_else(|| settings.daemon.domain.clone());
    let domain = overfly_client::Domain::new(&name)?;
    start_log();
    if arguments.until_stdin_ends {
        std::thread::spawn(end_with_stdin);
    }
    Ok(daemon::serve(settings, arguments.config.clone(), &domain)?)
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
