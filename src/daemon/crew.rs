//! The threads on which jobs run. There are so many at the most; further jobs wait in line.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::planner::StopToken;

/// A thread that has nothing to do stays for so long: to start one takes a good part of the time in which an edit is to be followed by a flight.
const STAYS: Duration = Duration::from_secs(10);

/// Something to be done on a thread of its own.
pub struct Job {
    /// An abandoned job need not wait for its turn.
    pub stop: StopToken,
    /// Must not panic, and must end at once when the job was abandoned before it began.
    pub run: Box<dyn FnOnce() + Send>,
}

/// A bounded number of threads. They are not the compute pool's: a job that waits for parallel work must not be waited for by it.
#[derive(Debug)]
pub struct Crew {
    places: usize,
    line: Mutex<Line>,
    /// Tells threads that have nothing to do.
    work: Condvar,
}

#[derive(Default)]
struct Line {
    at_work: usize,
    /// Threads that have nothing to do, or have been told of a job that waits.
    idle: usize,
    waiting: VecDeque<Job>,
}

impl std::fmt::Debug for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Line")
            .field("at_work", &self.at_work)
            .field("idle", &self.idle)
            .field("waiting", &self.waiting.len())
            .finish()
    }
}

impl Crew {
    /// At most `places` jobs run at the same time.
    pub fn new(places: usize) -> Arc<Self> {
        Arc::new(Self { places, line: Mutex::default(), work: Condvar::new() })
    }

    /// Runs `job` now or when an earlier one has ended. Abandoned jobs that still wait are run here, because that takes no time.
    pub fn take_on(self: &Arc<Self>, job: Job) -> io::Result<()> {
        let mut line = self.lock();
        let (gone, waiting): (Vec<Job>, Vec<Job>) = line.waiting.drain(..).partition(|job| job.stop.is_abandoned());
        line.waiting = waiting.into();
        let started = if line.waiting.len() < line.idle {
            line.waiting.push_back(job);
            self.work.notify_one();
            Ok(())
        } else if line.at_work + line.idle < self.places {
            self.start(job).map(|()| line.at_work += 1)
        } else {
            line.waiting.push_back(job);
            Ok(())
        };
        drop(line);
        gone.into_iter().for_each(|job| (job.run)());
        started
    }

    fn start(self: &Arc<Self>, first: Job) -> io::Result<()> {
        let crew = Arc::clone(self);
        let work = move || {
            let mut next = Some(first);
            while let Some(job) = next {
                (job.run)();
                next = crew.next();
            }
        };
        std::thread::Builder::new().name("job".into()).spawn(work).map(drop)
    }

    /// The next job for a thread that has ended one; without any for a while the thread leaves.
    fn next(&self) -> Option<Job> {
        let mut line = self.lock();
        if let Some(job) = line.waiting.pop_front() {
            return Some(job);
        }
        (line.idle, line.at_work) = (line.idle + 1, line.at_work - 1);
        let until = Instant::now() + STAYS;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            line = self.work.wait_timeout(line, left).unwrap_or_else(PoisonError::into_inner).0;
            if let Some(job) = line.waiting.pop_front() {
                (line.idle, line.at_work) = (line.idle - 1, line.at_work + 1);
                return Some(job);
            }
            if left.is_zero() {
                line.idle -= 1;
                return None;
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn jobs_beyond_the_places_wait_and_abandoned_ones_do_not() {
        let crew = Crew::new(1);
        let (done, results) = channel();
        let (release, gate) = channel::<()>();
        let job = |name: &'static str, stop: &StopToken, gate: Option<std::sync::mpsc::Receiver<()>>| {
            let done = done.clone();
            let run = move || {
                gate.into_iter().for_each(|gate| gate.recv().unwrap());
                done.send(name).unwrap();
            };
            Job { stop: stop.clone(), run: Box::new(run) }
        };
        let (stop, unwanted) = (StopToken::default(), StopToken::default());
        crew.take_on(job("first", &stop, Some(gate))).unwrap();
        crew.take_on(job("unwanted", &unwanted, None)).unwrap();
        unwanted.abandon();
        crew.take_on(job("second", &stop, None)).unwrap();
        assert_eq!(results.recv().unwrap(), "unwanted");
        release.send(()).unwrap();
        assert_eq!([results.recv().unwrap(), results.recv().unwrap()], ["first", "second"]);
    }

    #[test]
    fn a_thread_with_nothing_to_do_takes_the_next_job() {
        let crew = Crew::new(2);
        let (done, results) = channel();
        let take_on = || {
            let done = done.clone();
            let run = move || done.send(std::thread::current().id()).unwrap();
            crew.take_on(Job { stop: StopToken::default(), run: Box::new(run) }).unwrap();
            let thread = results.recv().unwrap();
            while crew.lock().idle == 0 {
                std::thread::yield_now();
            }
            thread
        };
        let first = take_on();
        assert!((0..20).all(|_| take_on() == first));
        let line = crew.lock();
        assert_eq!((line.at_work, line.idle, line.waiting.len()), (0, 1, 0));
    }
}
