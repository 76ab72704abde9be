//! Where the plans of a flight come from: a file, or a daemon, which is asked by a thread of its own, so that the link never waits for it.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use overfly_client::{Client, ClientError, Domain, FlightReport, PlanMessage, PlanWatch, RefusalCode};

use crate::autopilot::mission::NewPlan;
use crate::cli::arguments::FlyArgs;
use crate::cli::daemon;
use crate::cli::failure::Failure;

/// How long a command waits for a daemon that may be starting, and how often it is looked for again.
const CONNECT: Duration = Duration::from_millis(500);
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// How long one look for a plan takes: a report waits no longer.
const TURN: Duration = Duration::from_millis(100);
/// How long the daemon may take for its first word, and the thread for its end.
const FIRST: Duration = Duration::from_secs(10);
const LAST: Duration = Duration::from_secs(2);
/// Plans of a daemon whose flights can be reported to it.
const KNOWN: usize = 64;

/// What a daemon has to say.
#[derive(Debug)]
pub enum Word {
    Plan(NewPlan),
    /// The scene as it is leaves no flight.
    Infeasible {
        revision: u64,
        reason: String,
    },
    /// The first contact failed: there is nothing to fly.
    Failed(ClientError),
    Lost(String),
    Back,
    /// It did not take a report.
    Refused(String),
}

pub enum PlanSource {
    File(NewPlan),
    Daemon(Watcher),
}

/// The thread that speaks with the daemon.
pub struct Watcher {
    words: Receiver<Word>,
    /// The first word, which was waited for.
    first: VecDeque<Word>,
    report: Arc<Mutex<Option<FlightReport>>>,
    stop: Arc<AtomicBool>,
}

impl PlanSource {
    /// Connects to the daemon and receives the scene's last plan.
    pub fn open(arguments: &FlyArgs) -> Result<Self, Failure> {
        let domain = daemon::domain(arguments.reach.domain.as_deref())?;
        let (sender, words) = channel();
        let report = Arc::new(Mutex::new(None));
        let stop = Arc::new(AtomicBool::new(false));
        let mut thread = Thread {
            domain,
            scene: arguments.plan.clone(),
            words: sender,
            report: Arc::clone(&report),
            stop: Arc::clone(&stop),
            instance: 0,
            known: VecDeque::new(),
            refused: String::new(),
        };
        std::thread::spawn(move || thread.run());
        let first = match words.recv_timeout(FIRST) {
            Ok(Word::Failed(error)) => return Err(error.into()),
            Ok(word) => VecDeque::from([word]),
            Err(_) => return Err(Failure::Daemon(format!("the daemon gave no plan within {} s; see its log", FIRST.as_secs()))),
        };
        Ok(Self::Daemon(Watcher { words, first, report, stop }))
    }

    /// The plan that is flown first, where it is known.
    pub fn first(&self) -> Option<&NewPlan> {
        match self {
            Self::File(new) => Some(new),
            Self::Daemon(watcher) => match watcher.first.front() {
                Some(Word::Plan(new)) => Some(new),
                _ => None,
            },
        }
    }

    /// The next word of the daemon, if there is one.
    pub fn word(&mut self) -> Option<Word> {
        match self {
            Self::File(_) => None,
            Self::Daemon(watcher) => watcher.first.pop_front().or_else(|| watcher.words.try_recv().ok()),
        }
    }

    /// Tells the daemon where the aircraft is; a later report takes the place of one that was not sent yet.
    pub fn report(&self, report: FlightReport) {
        if let Self::Daemon(watcher) = self {
            *watcher.report.lock().unwrap_or_else(PoisonError::into_inner) = Some(report);
        }
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        // The thread gives back what it has of the daemon's shared memory; one that waits for the daemon is not waited for.
        self.stop.store(true, Ordering::Relaxed);
        let end = Instant::now() + LAST;
        while let Some(left) = end.checked_duration_since(Instant::now()) {
            if matches!(self.words.recv_timeout(left), Err(RecvTimeoutError::Disconnected)) {
                break;
            }
        }
    }
}

/// The last plan of a loaded scene.
pub fn last_plan(arguments: &FlyArgs) -> Result<NewPlan, Failure> {
    let mut source = PlanSource::open(arguments)?;
    match source.word() {
        Some(Word::Plan(new)) => Ok(new),
        Some(Word::Infeasible { reason, .. }) => Err(Failure::Daemon(format!("the scene leaves no flight: {reason}"))),
        _ => Err(Failure::Daemon("the daemon gave no plan; see its log".to_owned())),
    }
}

struct Thread {
    domain: Domain,
    scene: String,
    words: Sender<Word>,
    report: Arc<Mutex<Option<FlightReport>>>,
    stop: Arc<AtomicBool>,
    /// The daemon that the known plans are of.
    instance: u64,
    known: VecDeque<u64>,
    refused: String,
}

impl Thread {
    fn run(&mut self) {
        let mut is_first = true;
        while !self.is_stopped() {
            let error = match self.connect() {
                Ok((client, watch)) => {
                    if !is_first && self.words.send(Word::Back).is_err() {
                        return;
                    }
                    is_first = false;
                    match self.watch(&client, &watch) {
                        Ok(()) => return,
                        Err(error) => error,
                    }
                }
                Err(error) if is_first => {
                    let _ = self.words.send(Word::Failed(error));
                    return;
                }
                // It is looked for again; that it is lost was said.
                Err(_) => {
                    self.pause();
                    continue;
                }
            };
            if self.words.send(Word::Lost(error.to_string())).is_err() {
                return;
            }
            self.pause();
        }
    }

    fn connect(&self) -> Result<(Client, PlanWatch), ClientError> {
        let client = Client::connect(&self.domain, CONNECT)?;
        let watch = client.watch(&self.scene)?;
        client.publish_again(&self.scene)?;
        Ok((client, watch))
    }

    /// Passes plans and reports on until the end, or until the daemon is lost.
    fn watch(&mut self, client: &Client, watch: &PlanWatch) -> Result<(), ClientError> {
        let mut heard = Instant::now();
        while !self.is_stopped() {
            match watch.next(TURN) {
                Ok(Some(message)) => {
                    heard = Instant::now();
                    if let Some(word) = self.word(&message)
                        && self.words.send(word).is_err()
                    {
                        return Ok(());
                    }
                }
                Ok(None) if heard.elapsed() > 5 * LOOK_AGAIN => {
                    client.ping()?;
                    heard = Instant::now();
                }
                Ok(None) => {}
                // One plan that cannot be read; the next one may be.
                Err(error @ (ClientError::Message(_) | ClientError::Table(_))) => {
                    drop(self.words.send(Word::Refused(error.to_string())))
                }
                Err(error) => return Err(error),
            }
            let report = self.report.lock().unwrap_or_else(PoisonError::into_inner).take();
            // A daemon that was started anew counts its plans anew: it cannot know those of the one before.
            if let Some(report) = report.filter(|report| self.known.contains(&report.epoch)) {
                match client.report(&self.scene, &report) {
                    Ok(()) => self.refused.clear(),
                    Err(ClientError::Refused { code, message }) if code != RefusalCode::UnknownScene => {
                        if message != self.refused {
                            let _ = self.words.send(Word::Refused(message.clone()));
                            self.refused = message;
                        }
                    }
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(())
    }

    /// What a published plan says; nothing where it is one that came before.
    fn word(&mut self, message: &PlanMessage) -> Option<Word> {
        if let Some(reason) = message.infeasible() {
            return Some(Word::Infeasible { revision: message.table().facts.revision, reason: reason.to_owned() });
        }
        if message.instance() != self.instance {
            self.instance = message.instance();
            self.known.clear();
        }
        if self.known.contains(&message.epoch()) {
            return None;
        }
        match daemon::plan_of(message) {
            Ok((plan, _)) => {
                self.known.push_back(message.epoch());
                if self.known.len() > KNOWN {
                    self.known.pop_front();
                }
                let differs_from = message.differs_from().filter(|(epoch, _)| self.known.contains(epoch));
                Some(Word::Plan(NewPlan { epoch: message.epoch(), plan: Arc::new(plan), differs_from }))
            }
            Err(failure) => Some(Word::Refused(failure.to_string())),
        }
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn pause(&self) {
        let end = Instant::now() + LOOK_AGAIN;
        while !self.is_stopped() && Instant::now() < end {
            std::thread::sleep(TURN);
        }
    }
}
