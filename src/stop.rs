//! How long computations are told to end.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Asks a running computation to stop; clones share one state.
#[derive(Clone, Debug, Default)]
pub struct StopToken(Arc<AtomicU8>);

const STOPPED: u8 = 1;
const ABANDONED: u8 = 2;

impl StopToken {
    /// Ends a search with the best plan so far, which is still evaluated and checked.
    pub fn stop(&self) {
        self.0.fetch_max(STOPPED, Ordering::Relaxed);
    }

    /// Ends the computation as soon as possible: nobody wants its result any more.
    pub fn abandon(&self) {
        self.0.store(ABANDONED, Ordering::Relaxed);
    }

    /// Whether either was asked for.
    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= STOPPED
    }

    pub fn is_abandoned(&self) -> bool {
        self.0.load(Ordering::Relaxed) == ABANDONED
    }
}
