//! The daemon's status as it is published.

use std::sync::Arc;
use std::time::{Duration, Instant};

use overfly_wire::codec;
use overfly_wire::frame::{self, FrameError, Limits};
use overfly_wire::service::{self, Bell, BlockSubscriber, Channel, EventListener, LOOK_AGAIN};
use overfly_wire::{Domain, Kind, Status, WireBlock};

use crate::error::ClientError;
use crate::link::{Presence, Watchman};

/// The status whenever a scene comes, goes, or has another revision, state or plan; at first the last one that was published.
pub struct StatusFeed {
    statuses: BlockSubscriber,
    news: EventListener,
    watchman: Watchman,
    _presence: Arc<Presence>,
}

impl StatusFeed {
    pub(crate) fn open(domain: &Domain) -> Result<Self, ClientError> {
        let presence = Presence::enter(domain)?;
        let node = presence.node();
        let statuses = service::subscriber(&service::open(node, Channel::Status)?)?;
        let news = service::listener(&service::open_bell(node, Bell::Clients)?)?;
        Ok(Self { statuses, news, watchman: Watchman::new(domain), _presence: presence })
    }

    /// The next status; `None` when none comes within `timeout`. Who is slow misses some, but never the last.
    pub fn next(&self, timeout: Duration) -> Result<Option<Status>, ClientError> {
        let end = Instant::now() + timeout;
        loop {
            let is_gone = self.watchman.finds_daemon_gone();
            let received = self.statuses.receive().map_err(|error| ClientError::Receive(format!("{error:?}")))?;
            if let Some(sample) = received {
                let limits = Limits { body_bytes: codec::MAX_STATUS_BYTES, bulk_bytes: 0 };
                let frame = frame::copy(sample.user_header(), WireBlock::blocks(sample.payload()), Kind::Status, limits)?;
                return Ok(Some(codec::decode_reply(&frame.body).map_err(FrameError::from)?));
            }
            if is_gone {
                return Err(self.watchman.lost());
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let wait = left.min(10 * LOOK_AGAIN);
            self.news.timed_wait(|_| {}, wait).map_err(|error| ClientError::Receive(format!("{error:?}")))?;
        }
    }
}
