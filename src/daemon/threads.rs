//! The threads of parallel work: those of the process for what somebody waits for, and others for searches after an edit, which stand back behind it.

use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

use super::DaemonError;
use crate::settings::DaemonSettings;

/// Starts the compute pool of this process, which takes all parallel work of all jobs but searches after an edit.
pub fn start_pool(settings: &DaemonSettings) -> Result<(), DaemonError> {
    let failed =
        |error: rayon::ThreadPoolBuildError| DaemonError::System { what: "the worker threads", cause: error.to_string() };
    builder("core", settings.threads).build_global().map_err(failed)
}

fn builder(name: &'static str, threads: u32) -> ThreadPoolBuilder {
    ThreadPoolBuilder::new().num_threads(threads as usize).thread_name(move |index| format!("{name}-{index}"))
}

/// Threads for searches after an edit. The next edit that comes meanwhile is dealt with before them, and whatever else runs on the computer comes first too: a search is
/// over when its time is, however much it got done. Each search has a pool for itself: in a common one a thread that waits for a part of its search would
/// take up all of another one meanwhile.
#[derive(Debug)]
pub struct SearchPools {
    threads: u32,
    nice: i32,
    idle: Mutex<Vec<ThreadPool>>,
}

impl SearchPools {
    pub fn new(settings: &DaemonSettings) -> Arc<Self> {
        Arc::new(Self { threads: settings.threads, nice: settings.search_nice, idle: Mutex::default() })
    }

    /// A pool for one search; `None` where no threads can be started for it.
    pub fn take(&self) -> Option<SearchPool<'_>> {
        let idle = self.idle().pop();
        let start = || {
            let nice = self.nice;
            let pool = builder("search", self.threads).start_handler(move |_| stand_back(nice)).build();
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
