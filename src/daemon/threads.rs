//! The threads of parallel work: those of the process for what somebody waits for, and others for searches after an edit, which stand back behind it.

use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};
#[cfg(target_os = "linux")]
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use super::DaemonError;
use crate::settings::DaemonSettings;

/// Starts the compute pool of this process, which takes all parallel work of all jobs but searches after an edit.
pub fn start_pool(settings: &DaemonSettings) -> Result<(), DaemonError> {
    let failed =
        |error: rayon::ThreadPoolBuildError| DaemonError::System { what: "the worker threads", cause: error.to_string() };
    Placing::new(settings, 0).builder("core").build_global().map_err(failed)
}

/// How the threads of a pool are placed on the processors of the computer.
#[derive(Clone, Debug)]
struct Placing {
    threads: u32,
    /// The processors that the daemon may use, where each thread is to stay on one of its own.
    processors: Vec<usize>,
    /// Added to the niceness of the process.
    nice: i32,
}

impl Placing {
    /// To be called on a thread that may use all processors that the daemon may.
    fn new(settings: &DaemonSettings, nice: i32) -> Self {
        Self { threads: settings.threads, processors: if settings.pin_threads { processors() } else { Vec::new() }, nice }
    }

    fn builder(&self, name: &'static str) -> ThreadPoolBuilder {
        let Self { threads, processors, nice } = self.clone();
        let start = move |index: usize| {
            // With processors to spare no thread has to wait for another, and whatever else is busy on one of them is left alone.
            if processors.len() == rayon::current_num_threads() {
                stay_on(processors[index]);
            }
            if nice > 0 {
                stand_back(nice);
            }
        };
        let name = move |index| format!("{name}-{index}");
        ThreadPoolBuilder::new().num_threads(threads as usize).thread_name(name).start_handler(start)
    }
}

/// Threads for searches after an edit. The next edit that comes meanwhile is dealt with before them, and whatever else runs on the computer comes first too: a search is
/// over when its time is, however much it got done. Each search has a pool for itself: in a common one a thread that waits for a part of its search would
/// take up all of another one meanwhile.
#[derive(Debug)]
pub struct SearchPools {
    placing: Placing,
    idle: Mutex<Vec<ThreadPool>>,
}

impl SearchPools {
    pub fn new(settings: &DaemonSettings) -> Arc<Self> {
        Arc::new(Self { placing: Placing::new(settings, settings.search_nice), idle: Mutex::default() })
    }

    /// A pool for one search; `None` where no threads can be started for it.
    pub fn take(&self) -> Option<SearchPool<'_>> {
        let idle = self.idle().pop();
        let start = || {
            let pool = self.placing.builder("search").build();
            pool.inspect_err(|error| tracing::warn!(%error, "a search has no threads of its own")).ok()
        };
        idle.or_else(start).map(|pool| SearchPool { pools: self, pool: Some(pool) })
    }

    fn idle(&self) -> MutexGuard<'_, Vec<ThreadPool>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The threads of one search. The next one has them when this is dropped.
#[derive(Debug)]
pub struct SearchPool<'p> {
    pools: &'p SearchPools,
    pool: Option<ThreadPool>,
}

impl Deref for SearchPool<'_> {
    type Target = ThreadPool;

    fn deref(&self) -> &ThreadPool {
        self.pool.as_ref().expect("it is taken only when this is dropped")
    }
}

impl Drop for SearchPool<'_> {
    fn drop(&mut self) {
        self.pools.idle().extend(self.pool.take());
    }
}

/// The processors that this thread may use.
#[cfg(target_os = "linux")]
fn processors() -> Vec<usize> {
    let allowed = sched_getaffinity(None).inspect_err(|error| tracing::debug!(%error, "worker threads are not placed"));
    allowed.map_or(Vec::new(), |allowed| (0..CpuSet::MAX_CPU).filter(|&processor| allowed.is_set(processor)).collect())
}

#[cfg(not(target_os = "linux"))]
fn processors() -> Vec<usize> {
    Vec::new()
}

/// Lets this thread stay on a processor. Left to itself, Linux starts a thread where the one runs that wakes it, and where the other processor is busy just
/// then, it lets one wait behind the other for its whole turn, several milliseconds: as long as an update takes.
#[cfg(target_os = "linux")]
fn stay_on(processor: usize) {
    let mut only = CpuSet::new();
    only.set(processor);
    if let Err(error) = sched_setaffinity(None, &only) {
        tracing::debug!(%error, processor, "a worker thread has no processor of its own");
    }
}

#[cfg(not(target_os = "linux"))]
fn stay_on(_processor: usize) {}

/// Lets this thread stand back behind others of the computer.
#[cfg(target_os = "linux")]
fn stand_back(nice: i32) {
    // On Linux each thread has a niceness of its own. Where it may not be changed, searches run as everything else does.
    if let Err(error) = rustix::process::nice(nice) {
        tracing::debug!(%error, nice, "searches do not stand back behind other work");
    }
}

/// Elsewhere the whole process would stand back, first plans too.
#[cfg(not(target_os = "linux"))]
fn stand_back(_nice: i32) {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    fn pools(search_nice: i32) -> Arc<SearchPools> {
        SearchPools::new(&DaemonSettings { threads: 2, search_nice, ..Settings::default().daemon })
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn threads_have_a_processor_each_where_there_are_as_many() {
        let allowed = sched_getaffinity(None).unwrap();
        let processors = allowed.count();
        let of_threads = |threads: u32, pin_threads: bool| {
            let placing = Placing::new(&DaemonSettings { threads, pin_threads, ..Settings::default().daemon }, 0);
            placing.builder("placed").build().unwrap().broadcast(|_| sched_getaffinity(None).unwrap())
        };
        let pinned = of_threads(processors, true);
        assert!(pinned.iter().all(|own| own.count() == 1));
        let is_on = |processor: &usize| pinned.iter().any(|own| own.is_set(*processor));
        assert_eq!((0..CpuSet::MAX_CPU).filter(is_on).count() as u32, processors, "each has another one");
        // Those that a pinned thread starts are not left with its processor alone.
        let from_pinned = Placing::new(&DaemonSettings { threads: processors, ..Settings::default().daemon }, 0);
        let of_its = std::thread::spawn(move || {
            stay_on(from_pinned.processors[0]);
            from_pinned.builder("placed").build().unwrap().broadcast(|_| sched_getaffinity(None).unwrap())
        });
        assert_eq!(of_its.join().unwrap(), pinned);
        assert!(of_threads(processors + 1, true).iter().chain(&of_threads(processors, false)).all(|own| *own == allowed));
    }

    #[test]
    fn searches_do_not_share_threads_and_leave_them_to_those_that_come_after() {
        let pools = pools(0);
        let name = |pool: &ThreadPool| pool.install(|| std::thread::current().id());
        let [first, second] = [pools.take().unwrap(), pools.take().unwrap()];
        assert_ne!(name(&first), name(&second));
        assert_eq!((first.current_num_threads(), pools.idle().len()), (2, 0));
        drop(first);
        assert_eq!(pools.idle().len(), 1);
        let third = pools.take().unwrap();
        drop((second, third));
        assert_eq!(pools.idle().len(), 2);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn threads_of_searches_alone_stand_back() {
        let niceness = || rustix::process::getpriority_process(None).unwrap();
        let before = niceness();
        let pool = pools(3);
        let found = pool.take().unwrap().broadcast(|_| niceness());
        assert_eq!((found, niceness()), (vec![(before + 3).min(19); 2], before));
    }
}
