//! The ports of one client, and the way of one request: sent, acknowledged, answered, sent again when nothing comes.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use iceoryx2::port::LoanError;
use iceoryx2::prelude::EventId;
use overfly_wire::codec;
use overfly_wire::frame::{self, Limits};
use overfly_wire::memory;
use overfly_wire::service::{
    self, Bell, BlockPublisher, BlockService, BlockSubscriber, Channel, EVENT_ATTACH, EVENT_REQUEST, EventListener,
    EventNotifier, IpcNode, LOOK_AGAIN, Memory,
};
use overfly_wire::{Domain, Header, Kind, ProgressNote, RefusalCode, Reply, Request, WireBlock};

use crate::error::ClientError;
use crate::field::Segments;

/// How often a scene file may be on its way at the same time: once, and once again when nothing was heard.
const BULK_SAMPLES: usize = 2;
/// A request that nobody has acknowledged for so long is sent again.
const RESEND: Duration = Duration::from_millis(100);
/// While the daemon works on a request it is reminded so often, so that a lost reply is repeated.
const REMIND: Duration = Duration::from_millis(500);
/// A daemon that does not even acknowledge reminders for so long is gone or stuck.
const SILENCE: Duration = Duration::from_secs(20);

/// Room in /dev/shm for the node and the ports of one client, bytes.
const PORTS_BYTES: usize = 1 << 20;

/// How often somebody who waits looks whether the daemon is still there.
const LOOK_FOR_DAEMON: Duration = Duration::from_millis(500);

/// Looks whether the daemon that was there is still there.
pub(crate) struct Watchman {
    domain: Domain,
    /// The domain's lock was held once. It never is where only a network tunnel serves the domain.
    was_locked: Cell<bool>,
    looked: Cell<Instant>,
}

impl Watchman {
    pub(crate) fn new(domain: &Domain) -> Self {
        Self { domain: domain.clone(), was_locked: Cell::new(domain.is_locked()), looked: Cell::new(Instant::now()) }
    }

    /// Whether nobody holds the lock any more. Looks only every so often, so that it may be asked at every turn of a loop. What the
    /// daemon has sent before it ended can still be received.
    pub(crate) fn finds_daemon_gone(&self) -> bool {
        if self.looked.get().elapsed() < LOOK_FOR_DAEMON {
            return false;
        }
        self.looked.set(Instant::now());
        if self.domain.is_locked() {
            self.was_locked.set(true);
            return false;
        }
        self.was_locked.get()
    }

    pub(crate) fn lost(&self) -> ClientError {
        ClientError::Lost { domain: self.domain.name().into() }
    }
}

/// A node in the domain. The last one to leave a domain without a daemon tidies up.
pub(crate) struct Presence {
    domain: Domain,
    node: Option<IpcNode>,
}

/// How many nodes this process has in each domain, by the domain's directory. Whoever tidies up does not look at those of its own process, so that only
/// the last of them may: others would find their files gone, or remove those of the next daemon when they leave.
static PRESENT: Mutex<BTreeMap<PathBuf, usize>> = Mutex::new(BTreeMap::new());

impl Presence {
    pub(crate) fn enter(domain: &Domain) -> Result<Arc<Self>, ClientError> {
        // iceoryx2 writes to the memory of new nodes and ports by itself, which would kill the process where there is none.
        memory::check_room(PORTS_BYTES)?;
        // Nobody may tidy up while a node is being made.
        let mut present = PRESENT.lock().unwrap_or_else(PoisonError::into_inner);
        let node = Some(service::node(domain, "overfly-client")?);
        *present.entry(domain.root().to_owned()).or_default() += 1;
        Ok(Arc::new(Self { domain: domain.clone(), node }))
    }

    pub(crate) fn node(&self) -> &IpcNode {
        self.node.as_ref().expect("only `drop` takes it")
    }
}

impl Drop for Presence {
    fn drop(&mut self) {
        let mut present = PRESENT.lock().unwrap_or_else(PoisonError::into_inner);
        self.node = None;
        let left = present.get_mut(self.domain.root()).map_or(0, |count| {
            *count -= 1;
            *count
        });
        if left == 0 {
            present.remove(self.domain.root());
            if !self.domain.is_locked() {
                self.domain.sweep_if_deserted();
            }
        }
    }
}

/// The ports of a client. Fields are dropped in their order: the presence must be last.
pub(crate) struct Link {
    requests: BlockPublisher,
    request_service: BlockService,
    replies: BlockSubscriber,
    pub(crate) plans: BlockSubscriber,
    news: EventListener,
    ring: EventNotifier,
    pub(crate) id: u64,
    pub(crate) instance: Cell<u64>,
    next_correlation: Cell<u64>,
    pub(crate) domain: Domain,
    pub(crate) segments: Segments,
    watchman: Watchman,
    pub(crate) presence: Arc<Presence>,
}

/// A request that was sent and waits for its replies.
pub(crate) struct Exchange<'a> {
    pub(crate) correlation: u64,
    /// The earlier request that this one asks about: replies to it are heard too.
    about: Option<u64>,
    request: &'a Request,
    bulk: &'a [u8],
    /// Sends the bulk and is gone with its memory when the request is answered.
    carrier: Option<BlockPublisher>,
    acknowledged: bool,
    sent: Instant,
    heard: Instant,
    patience: Duration,
}

impl Link {
    /// Opens the ports; [`ServiceError::Missing`] says that there is no daemon.
    pub(crate) fn open(domain: &Domain) -> Result<Self, ClientError> {
        let presence = Presence::enter(domain)?;
        let node = presence.node();
        let request_service = service::open(node, Channel::Requests)?;
        let requests = service::publisher(&request_service, Memory::Growing)?;
        let replies = service::subscriber(&service::open(node, Channel::Replies)?)?;
        let plans = service::subscriber(&service::open(node, Channel::Plans)?)?;
        let news = service::listener(&service::open_bell(node, Bell::Clients)?)?;
        let ring = service::notifier(&service::open_bell(node, Bell::Daemon)?)?;
        let id = service::short_id(node.id().value());
        let (domain, watchman) = (domain.clone(), Watchman::new(domain));
        Ok(Self {
            requests,
            request_service,
            replies,
            plans,
            news,
            ring,
            id,
            instance: Cell::new(0),
            next_correlation: Cell::new(1),
            domain,
            segments: Segments::default(),
            watchman,
            presence,
        })
    }

    /// Asks the daemon to hand over what it has published before this client subscribed.
    pub(crate) fn attach(&self) {
        let _ = self.ring.notify_with_custom_event_id(EventId::new(EVENT_ATTACH));
    }

    /// Sends `request`, passes progress on, and returns the final reply. A refusal is an error.
    pub(crate) fn call(
        &self,
        request: &Request,
        bulk: &[u8],
        patience: Duration,
        on_progress: &mut dyn FnMut(&ProgressNote),
    ) -> Result<(u64, Reply), ClientError> {
        let mut exchange = self.begin(request, bulk, patience)?;
        loop {
            match self.step(&mut exchange, LOOK_AGAIN)? {
                Some(Reply::Acknowledged) if matches!(request, Request::Ping) => {
                    return Ok((exchange.correlation, Reply::Acknowledged));
                }
                Some(Reply::Acknowledged) | None => {}
                Some(Reply::Progress(note)) => on_progress(&note),
                Some(reply) => return Ok((exchange.correlation, reply)),
            }
        }
    }

    pub(crate) fn begin<'a>(
        &self,
        request: &'a Request,
        bulk: &'a [u8],
        patience: Duration,
    ) -> Result<Exchange<'a>, ClientError> {
        let correlation = self.next_correlation.get();
        self.next_correlation.set(correlation + 1);
        let now = Instant::now();
        let carrier = match bulk.is_empty() {
            true => None,
            false => {
                let blocks = frame::blocks(codec::MAX_REQUEST_BYTES, bulk.len());
                Some(service::publisher(&self.request_service, Memory::Fixed { blocks, samples: BULK_SAMPLES })?)
            }
        };
        self.send(carrier.as_ref(), correlation, request, bulk)?;
        let about = if let Request::Outcome { correlation } = request { Some(*correlation) } else { None };
        Ok(Exchange { correlation, about, request, bulk, carrier, acknowledged: false, sent: now, heard: now, patience })
    }

    /// One reply to `exchange` when there is one within `wait`; sends the request again when the daemon is silent.
    pub(crate) fn step(&self, exchange: &mut Exchange<'_>, wait: Duration) -> Result<Option<Reply>, ClientError> {
        if let Some(reply) = self.reply_to(exchange)? {
            return self.hear(exchange, reply).map(Some);
        }
        let _ = self.wait_for_news(wait);
        let is_gone = self.watchman.finds_daemon_gone();
        if let Some(reply) = self.reply_to(exchange)? {
            return self.hear(exchange, reply).map(Some);
        }
        if is_gone {
            return Err(self.watchman.lost());
        }
        let now = Instant::now();
        let silent = now - exchange.heard;
        let limit = if exchange.acknowledged { SILENCE } else { exchange.patience };
        if silent > limit {
            let what = if exchange.acknowledged { "it worked on the request" } else { "it was asked" };
            return Err(ClientError::NoAnswer { domain: self.domain.name().into(), what, seconds: silent.as_secs_f64() });
        }
        let pause = if exchange.acknowledged { REMIND } else { RESEND + copy_time(exchange.bulk) };
        if now - exchange.sent > pause {
            // The daemon knows the request by its number and does not run it twice; an acknowledged one needs no bulk any more.
            let bulk = if exchange.acknowledged { &[][..] } else { exchange.bulk };
            self.send(exchange.carrier.as_ref().filter(|_| !bulk.is_empty()), exchange.correlation, exchange.request, bulk)?;
            exchange.sent = now;
        }
        Ok(None)
    }

    /// Blocks until the daemon rings or `wait` is over.
    pub(crate) fn wait_for_news(&self, wait: Duration) -> Result<(), ClientError> {
        self.news.timed_wait(|_| {}, wait).map(drop).map_err(|error| ClientError::Receive(format!("{error:?}")))
    }

    fn hear(&self, exchange: &mut Exchange<'_>, reply: Reply) -> Result<Reply, ClientError> {
        exchange.heard = Instant::now();
        exchange.acknowledged = true;
        match reply {
            Reply::Refused(refusal) if refusal.code == RefusalCode::Restarted => {
                Err(ClientError::Restarted { domain: self.domain.name().into() })
            }
            Reply::Refused(refusal) => Err(refusal.into()),
            other => Ok(other),
        }
    }

    /// The next reply to `exchange`; replies to earlier requests, which nobody waits for any more, are dropped.
    fn reply_to(&self, exchange: &Exchange<'_>) -> Result<Option<Reply>, ClientError> {
        loop {
            let received = self.replies.receive().map_err(|error| ClientError::Receive(format!("{error:?}")))?;
            let Some(sample) = received else { return Ok(None) };
            let header = *sample.user_header();
            let wanted = header.correlation == exchange.correlation || Some(header.correlation) == exchange.about;
            if header.client != self.id || !wanted {
                continue;
            }
            let limits = Limits { body_bytes: codec::MAX_REPLY_BYTES, bulk_bytes: 0 };
            let frame = frame::copy(&header, WireBlock::blocks(sample.payload()), Kind::Reply, limits)?;
            drop(sample);
            let reply = codec::decode_reply(&frame.body).map_err(overfly_wire::frame::FrameError::from)?;
            // A daemon that was restarted says so once; the next request is meant for it.
            self.instance.set(frame.header.instance);
            return Ok(Some(reply));
        }
    }

    fn send(
        &self,
        carrier: Option<&BlockPublisher>,
        correlation: u64,
        request: &Request,
        bulk: &[u8],
    ) -> Result<(), ClientError> {
        let body = codec::encode(request, codec::MAX_REQUEST_BYTES).map_err(overfly_wire::frame::FrameError::from)?;
        let header = Header {
            instance: self.instance.get(),
            client: self.id,
            correlation,
            body_bytes: body.len() as u64,
            bulk_bytes: bulk.len() as u64,
            ..Header::new(Kind::Request)
        };
        memory::check_message_room(std::mem::size_of::<WireBlock>() * frame::blocks(body.len(), bulk.len()))?;
        let lent = match carrier.unwrap_or(&self.requests).loan_slice_uninit(frame::blocks(body.len(), bulk.len())) {
            Ok(lent) => lent,
            // The daemon has not yet given earlier messages back: it will be reminded.
            Err(LoanError::OutOfMemory | LoanError::ExceedsMaxLoans) => return Ok(()),
            Err(error) => return Err(ClientError::Send(error.to_string())),
        };
        let mut sample = memory::provide(lent)?;
        *sample.user_header_mut() = header;
        frame::fill(WireBlock::blocks_mut(sample.payload_mut()), &body, bulk);
        sample.send().map_err(|error| ClientError::Send(error.to_string()))?;
        self.ring
            .notify_with_custom_event_id(EventId::new(EVENT_REQUEST))
            .map(drop)
            .map_err(|error| ClientError::Send(error.to_string()))
    }
}

/// Time in which the daemon has surely copied `bulk`, at 100 MB/s.
fn copy_time(bulk: &[u8]) -> Duration {
    Duration::from_nanos(bulk.len() as u64 * 10)
}
