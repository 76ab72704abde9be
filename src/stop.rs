//! How computations are told to end, and how they tell how far they have come.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

/// Asks a running computation to stop; clones share one state.
///
/// It may carry a clock: computations read none of their own, and what they learn from this one only decides how much they do.
/// Work in equal steps counts them here, for whoever looks on; nothing depends on who does.
#[derive(Clone, Debug, Default)]
pub struct StopToken {
    state: Arc<State>,
    clock: Option<Clock>,
}

#[derive(Debug, Default)]
struct State {
    asked: AtomicU8,
    done: AtomicU64,
    of: AtomicU64,
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
        self.state.asked.fetch_max(STOPPED, Ordering::Relaxed);
    }

    /// Ends the computation as soon as possible: nobody wants its result any more.
    pub fn abandon(&self) {
        self.state.asked.store(ABANDONED, Ordering::Relaxed);
    }

    /// Whether either was asked for.
    pub fn is_stopped(&self) -> bool {
        self.state.asked.load(Ordering::Relaxed) >= STOPPED
    }

    pub fn is_abandoned(&self) -> bool {
        self.state.asked.load(Ordering::Relaxed) == ABANDONED
    }

    /// Work of so many equal steps begins.
    pub fn begin(&self, steps: usize) {
        self.state.done.store(0, Ordering::Relaxed);
        self.state.of.store(steps as u64, Ordering::Relaxed);
    }

    /// One step of it is done, by whichever thread.
    pub fn advance(&self) {
        self.state.done.fetch_add(1, Ordering::Relaxed);
    }

    /// How many steps of how many are done of the work that began last; `None` before any did.
    pub fn progress(&self) -> Option<[u64; 2]> {
        let (done, of) = (self.state.done.load(Ordering::Relaxed), self.state.of.load(Ordering::Relaxed));
        (of > 0).then_some([done.min(of), of])
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Clock({} s)", self.0())
    }
}
