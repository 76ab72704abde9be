//! How long computations are told to end.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Asks a running computation to stop; clones share one state.
///
/// It may carry a clock: computations read none of their own, and what they learn from this one only decides how much they do.
#[derive(Clone, Debug, Default)]
pub struct StopToken {
    state: Arc<AtomicU8>,
    clock: Option<Clock>,
}

#[derive(Clone)]
struct Clock(Arc<dyn Fn() -> f64 + Send + Sync>);

const STOPPED: u8 = 1;
const ABANDONED: u8 = 2;

impl StopToken {
    /// A token with a clock that tells the seconds since the work began.
    pub fn timed(elapsed_s: impl Fn() -> f64 + Send + Sync + 'static) -> Self {
        Self { clock: Some(Clock(Arc::new(elapsed_s))), ..Self::default() }
    }

    /// Seconds since the work began; `None` without a clock.
    pub fn elapsed_s(&self) -> Option<f64> {
        self.clock.as_ref().map(|clock| clock.0())
    }

    /// Ends a search with the best plan so far, which is still evaluated and checked.
    pub fn stop(&self) {
        self.state.fetch_max(STOPPED, Ordering::Relaxed);
    }

    /// Ends the computation as soon as possible: nobody wants its result any more.
    pub fn abandon(&self) {
        self.state.store(ABANDONED, Ordering::Relaxed);
    }

    /// Whether either was asked for.
    pub fn is_stopped(&self) -> bool {
        self.state.load(Ordering::Relaxed) >= STOPPED
    }

    pub fn is_abandoned(&self) -> bool {
        self.state.load(Ordering::Relaxed) == ABANDONED
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Clock({} s)", self.0())
    }
}
