//! The resident daemon: one main loop that owns all scenes, worker threads that compute, and shared-memory services towards clients.
//!
//! - [`main_loop`] waits for one closed set of events and hands each to [`state`], the only code that changes anything;
//! - [`requests`] takes up what clients ask for, [`results`] what workers have found;
//! - [`edits`] collects the edits that are not made yet, [`flown`] keeps what an aircraft has reported of its flight;
//! - [`jobs`] is the work that takes longer than the loop may pause, [`crew`] the threads it runs on;
//! - [`field_channel`] lets a field be built where clients read it, [`ports`] are the services, [`ledger`] keeps a request that
//!   is sent twice from running twice.
//!
//! Nothing that a client sends can stop the daemon. A request that is refused has changed nothing.

mod budget;
mod configuration;
mod convert;
mod crew;
mod edits;
mod field_channel;
mod flown;
mod jobs;
mod ledger;
mod main_loop;
mod plans;
mod ports;
mod requests;
mod results;
mod scene_file;
mod scenes;
mod state;
mod threads;
mod wake;

use std::path::PathBuf;

use overfly_wire::memory::MemoryError;
use overfly_wire::service::ServiceError;
use overfly_wire::{Domain, LockError};

pub use configuration::{ConfigurationError, read as read_configuration};
pub use convert::read_as;

use crate::settings::Settings;

/// Why a daemon could not start or had to end.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    #[error(transparent)]
    Lock(#[from] LockError),
    #[error("shared memory cannot be used: {0}; check that /dev/shm is mounted, writable and not full")]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Memory(#[from] MemoryError),
    #[error("{what} cannot be set up: {cause}")]
    System { what: &'static str, cause: String },
}

/// Serves `domain` in the foreground until SIGTERM, SIGINT or a client's stop request. `config_path` is the file that SIGHUP reads
/// again.
pub fn serve(settings: Settings, config_path: Option<PathBuf>, domain: &Domain) -> Result<(), DaemonError> {
    let lock = domain.lock()?;
    let served = main_loop::run(settings, config_path, domain);
    // Everything of this process in the domain is closed by now; clients that are still there keep their part.
    lock.release();
    served
}
