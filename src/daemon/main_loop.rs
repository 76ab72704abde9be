//! The loop: one wait for everything that can happen, one closed event type, one place that reacts.

use std::path::PathBuf;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use iceoryx2::prelude::*;
use overfly_wire::service::{BlockSample, Ipc};
use overfly_wire::{Domain, WireBlock};

use super::DaemonError;
use super::jobs::News;
use super::ports::{Ports, Rung};
use super::state::Daemon;
use super::wake::{self, Signal, Signals, WakeStream};
use crate::settings::Settings;

/// How often dead clients are cleaned up after, and new ones looked for.
const TICK: Duration = Duration::from_secs(1);

/// Requests that are taken up before the loop looks at signals and results again.
const REQUESTS_AT_ONCE: usize = 64;

/// Everything that can happen to the daemon.
enum Event {
    Request(BlockSample),
    /// A client has subscribed and waits for what was published before.
    Attach,
    WorkerResult(Box<News>),
    Tick,
    Signal(Signal),
}

/// What a wait has reported.
#[derive(Default)]
struct Woken {
    bell: bool,
    results: bool,
    end: bool,
    reload: bool,
    tick: bool,
    /// The last turn has left requests behind.
    backlog: bool,
}

/// Runs until the daemon is asked to end and its work has ended.
pub fn run(settings: Settings, config_path: Option<PathBuf>, domain: &Domain) -> Result<(), DaemonError> {
    let system = |what: &'static str| move |error: std::io::Error| DaemonError::System { what, cause: error.to_string() };
    // Signals are caught before anything exists that they would have to remove.
    let signals = Signals::install().map_err(system("signal handling"))?;
    let (mail, results, result_wake) = wake::mailbox().map_err(system("the workers' mailbox"))?;
    let ports = Ports::open(domain)?;
    let mut daemon = Daemon::new(settings, config_path, domain, mail, ports.instance)?;

    let waiting = |cause: String| DaemonError::System { what: "waiting for events", cause };
    let waitset = WaitSetBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .map_err(|error| waiting(error.to_string()))?;
    let attach = |stream| waitset.attach_notification(stream).map_err(|error| waiting(error.to_string()));
    let (on_results, on_end, on_reload): (_, _, _) = (attach(&result_wake)?, attach(&signals.end)?, attach(&signals.reload)?);
    let on_bell = waitset.attach_notification(&ports.bell).map_err(|error| waiting(error.to_string()))?;
    let on_tick = waitset.attach_interval(TICK).map_err(|error| waiting(error.to_string()))?;

    tracing::info!(domain = domain.name(), root = %domain.root().display(), pid = std::process::id(), "serving");
    let mut backlog = false;
    while !daemon.has_ended() {
        let mut woken = Woken { backlog, ..Woken::default() };
        let waited = waitset.wait_and_process_once_with_timeout(
            |id| {
                woken.bell |= id.has_event_from(&on_bell);
                woken.results |= id.has_event_from(&on_results);
                woken.end |= id.has_event_from(&on_end);
                woken.reload |= id.has_event_from(&on_reload);
                woken.tick |= id.has_event_from(&on_tick);
                CallbackProgression::Continue
            },
            if backlog { Duration::ZERO } else { daemon.patience() },
        );
        waited.map_err(|error| waiting(error.to_string()))?;
        backlog = for_each_event(&woken, &ports, &signals, &results, &result_wake, |event| react(&mut daemon, &ports, event));
        daemon.tell_status(&ports);
    }
    tracing::info!(domain = domain.name(), "ended");
    Ok(())
}

/// Drains whatever has woken the loop, but of requests only so many that signals and results have their turn in a flood of them.
/// Returns whether requests may be left.
fn for_each_event(
    woken: &Woken,
    ports: &Ports,
    signals: &Signals,
    results: &Receiver<News>,
    result_wake: &WakeStream,
    mut react: impl FnMut(Event),
) -> bool {
    if woken.end && signals.end.drain() {
        react(Event::Signal(Signal::End));
    }
    if woken.reload && signals.reload.drain() {
        react(Event::Signal(Signal::Reload));
    }
    if woken.bell {
        let rung: Rung = ports.drain_bell();
        if rung.attach {
            react(Event::Attach);
        }
    }
    // Requests are looked for at every tick too: a network may deliver a notification before its message.
    let mut taken = 0;
    if woken.bell || woken.tick || woken.backlog {
        let requests = std::iter::from_fn(|| ports.receive()).take(REQUESTS_AT_ONCE);
        requests.for_each(|sample| {
            taken += 1;
            react(Event::Request(sample));
        });
    }
    if woken.results {
        result_wake.drain();
        while let Ok(news) = results.try_recv() {
            react(Event::WorkerResult(Box::new(news)));
        }
    }
    if woken.tick {
        react(Event::Tick);
    }
    taken == REQUESTS_AT_ONCE
}

fn react(daemon: &mut Daemon, ports: &Ports, event: Event) {
    match event {
        Event::Request(sample) => {
            daemon.on_request(ports, sample.user_header(), WireBlock::blocks(sample.payload()));
        }
        Event::Attach => daemon.on_attach(ports),
        Event::WorkerResult(news) => daemon.on_news(ports, *news),
        Event::Tick => daemon.on_tick(ports),
        Event::Signal(Signal::End) => daemon.on_end(ports),
        Event::Signal(Signal::Reload) => daemon.on_reload_signal(),
    }
}
