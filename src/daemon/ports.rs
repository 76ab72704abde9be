//! The daemon's own services and ports.

use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::EventId;
use overfly_table::Block;
use overfly_wire::codec;
use overfly_wire::frame;
use overfly_wire::memory;
use overfly_wire::service::{
    self, Bell, BlockPublisher, BlockSample, BlockSubscriber, Channel, EVENT_ATTACH, EVENT_NEWS, EVENT_REQUEST, EventListener,
    EventNotifier, IpcNode, Memory,
};
use overfly_wire::{Domain, Header, Kind, Reply, Status, WireBlock};

use super::DaemonError;
use super::ledger::Ticket;

/// Why a message could not be sent.
#[derive(Debug, thiserror::Error)]
#[error("{what} cannot be sent: {cause}")]
pub struct SendError {
    what: &'static str,
    cause: String,
}

/// What clients have rung for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rung {
    pub request: bool,
    pub attach: bool,
}

/// Ports that every daemon has. The node is dropped last.
#[derive(Debug)]
pub struct Ports {
    pub bell: EventListener,
    requests: BlockSubscriber,
    replies: BlockPublisher,
    plans: BlockPublisher,
    status: BlockPublisher,
    news: EventNotifier,
    /// Name of this daemon's life in headers.
    pub instance: u64,
    pub node: IpcNode,
}

impl Ports {
    pub fn open(domain: &Domain) -> Result<Self, DaemonError> {
        memory::check_room(0)?;
        let node = service::node(domain, "overfly-daemon")?;
        let requests = service::subscriber(&service::provide(&node, Channel::Requests)?)?;
        let replies = service::publisher(&service::provide(&node, Channel::Replies)?, Memory::Growing)?;
        let plans = service::publisher(&service::provide(&node, Channel::Plans)?, Memory::Growing)?;
        let status = service::publisher(&service::provide(&node, Channel::Status)?, Memory::Growing)?;
        let news = service::notifier(&service::provide_bell(&node, Bell::Clients)?)?;
        let bell = service::listener(&service::provide_bell(&node, Bell::Daemon)?)?;
        let instance = service::short_id(node.id().value());
        Ok(Self { bell, requests, replies, plans, status, news, instance, node })
    }

    /// Takes what clients have rung for. Must be called after every wake-up, or the loop spins.
    pub fn drain_bell(&self) -> Rung {
        let mut rung = Rung::default();
        let drained = self.bell.try_wait(|event| match event.id.as_value() {
            EVENT_REQUEST => rung.request = true,
            EVENT_ATTACH => rung.attach = true,
            _ => {}
        });
        if let Err(error) = drained {
            tracing::warn!(?error, "the wake-ups of clients cannot be read");
        }
        rung
    }

    /// The next request, if there is one.
    pub fn receive(&self) -> Option<BlockSample> {
        self.requests.receive().unwrap_or_else(|error| {
            tracing::warn!(%error, "requests cannot be received from every client");
            None
        })
    }

    pub fn reply(&self, ticket: Ticket, reply: &Reply) -> Result<(), SendError> {
        let failed = |cause: String| SendError { what: "a reply", cause };
        let body = codec::encode(reply, codec::MAX_REPLY_BYTES).map_err(|error| failed(error.to_string()))?;
        let header = Header {
            instance: self.instance,
            client: ticket.client,
            correlation: ticket.correlation,
            body_bytes: body.len() as u64,
            ..Header::new(Kind::Reply)
        };
        self.send(&self.replies, header, frame::blocks(body.len(), 0), |blocks| frame::fill(blocks, &body, &[])).map_err(failed)
    }

    /// Publishes a plan of so many blocks to everybody; `write` puts it where it will be read.
    pub fn publish_plan(&self, header: Header, blocks: usize, write: impl FnOnce(&mut [Block])) -> Result<(), SendError> {
        let header = Header { bulk_bytes: (blocks * Block::BYTES) as u64, ..header };
        self.send(&self.plans, header, blocks, write).map_err(|cause| SendError { what: "a plan", cause })
    }

    /// Publishes the status to everybody.
    pub fn publish_status(&self, status: &Status) -> Result<(), SendError> {
        let failed = |cause: String| SendError { what: "the status", cause };
        let body = codec::encode(status, codec::MAX_STATUS_BYTES).map_err(|error| failed(error.to_string()))?;
        let header = Header { instance: self.instance, body_bytes: body.len() as u64, ..Header::new(Kind::Status) };
        self.send(&self.status, header, frame::blocks(body.len(), 0), |blocks| frame::fill(blocks, &body, &[])).map_err(failed)
    }

    /// Connects subscribers that have come since.
    pub fn update(&self) {
        for (publisher, what) in [(&self.replies, "replies"), (&self.plans, "plans"), (&self.status, "status")] {
            if let Err(error) = publisher.update_connections() {
                tracing::warn!(%error, what, "a client cannot be connected");
            }
        }
    }

    /// Wakes all clients that wait for something.
    pub fn ring(&self) {
        if let Err(error) = self.news.notify_with_custom_event_id(EventId::new(EVENT_NEWS)) {
            tracing::debug!(?error, "clients cannot be woken");
        }
    }

    fn send(
        &self,
        publisher: &BlockPublisher,
        header: Header,
        blocks: usize,
        fill: impl FnOnce(&mut [Block]),
    ) -> Result<(), String> {
        let lent = publisher.loan_slice_uninit(blocks).map_err(|error| error.to_string())?;
        let mut sample = memory::provide(lent).map_err(|error| error.to_string())?;
        *sample.user_header_mut() = header;
        fill(WireBlock::blocks_mut(sample.payload_mut()));
        sample.send().map_err(|error| error.to_string())?;
        self.ring();
        Ok(())
    }
}
