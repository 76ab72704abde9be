//! How computations are told to end, and how they tell how far they have come.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

/// A part of the work whose steps are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Part {
    /// Reading a file, in bytes.
    #[default]
    Reading,
    /// Sampling surfaces and placing viewpoints, in structures and in columns of the lattice: each of several passes by itself.
    Survey,
    /// Casting the rays of a field, in viewpoints.
    Rays,
}

impl Part {
    const ALL: [Self; 3] = [Self::Reading, Self::Survey, Self::Rays];
}

/// How far a part of the work has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counted {
    pub part: Part,
    pub done: u64,
    /// 0 while it is not known how many steps there are.
    pub of: u64,
}

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
    part: AtomicU8,
    done: AtomicU64,
    of: AtomicU64,
}

#[derive(Clone)]
struct Clock(Arc<dyn Fn() -> f64 + Send + Sync>);

const STOPPED: u8 = 1;
const ABANDONED: u8 = 2;

/// Frees what lies in very many pieces of memory behind whoever waits for the end of a computation: that takes milliseconds in a city.
pub fn free_behind(pieces: impl Send + 'static) {
    rayon::spawn(move || drop(pieces));
}

impl Counted {
    /// How many steps of how many are done, as they are told: bytes in thousands.
    pub fn told(self) -> [u64; 2] {
        let unit = if self.part == Part::Reading { 1000 } else { 1 };
        [self.done / unit, self.of.div_ceil(unit)]
    }
}

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

    /// Work of so many equal steps begins, of 0 if that is not known yet.
    pub fn begin(&self, part: Part, steps: u64) {
        self.state.part.store(part as u8, Ordering::Relaxed);
        self.state.done.store(0, Ordering::Relaxed);
        self.state.of.store(steps, Ordering::Relaxed);
    }

    /// So many steps of it are done, by whichever thread.
    pub fn advance(&self, steps: u64) {
        self.state.done.fetch_add(steps, Ordering::Relaxed);
    }

    /// How far the work has come that began last.
    pub fn progress(&self) -> Counted {
        let [done, of] = [&self.state.done, &self.state.of].map(|steps| steps.load(Ordering::Relaxed));
        Counted { part: Part::ALL[usize::from(self.state.part.load(Ordering::Relaxed))], done: done.min(of), of }
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Clock({} s)", self.0())
    }
}
