//! Fields, read where the daemon has built them.

use std::sync::Arc;
use std::time::Instant;

use overfly_table::FieldTable;
use overfly_wire::memory;
use overfly_wire::service::{self, BlockSample, BlockSubscriber, LOOK_AGAIN};
use overfly_wire::{Header, Kind, WireBlock};

use crate::error::ClientError;
use crate::link::{Link, Presence};

/// A field in shared memory, mapped read-only. While it lives the daemon keeps this table, so do not keep more than you read.
pub struct FieldMap {
    sample: BlockSample,
    header: Header,
    _subscriber: BlockSubscriber,
    _presence: Arc<Presence>,
}

impl FieldMap {
    /// Waits for a table of the daemon `link` talks to (any, before it has answered) that is at least as new as `epoch`.
    pub(crate) fn open(link: &Link, scene: &str, epoch: u64, end: Instant) -> Result<Self, ClientError> {
        let started = Instant::now();
        memory::check_room(0)?;
        let subscriber = service::field_subscriber(&service::open_field(link.presence.node(), scene)?)?;
        link.attach();
        let mut attached = started;
        loop {
            while let Some(sample) = subscriber.receive().map_err(|error| ClientError::Receive(format!("{error:?}")))? {
                let header = *sample.user_header();
                // The table of a daemon that was killed may still wait here and arrives first.
                let instance = link.instance.get();
                let current = instance == 0 || header.instance == instance;
                if header.is(Kind::Field) && current && header.epoch >= epoch {
                    FieldTable::open(WireBlock::blocks(sample.payload()))?;
                    return Ok(Self { sample, header, _subscriber: subscriber, _presence: link.presence.clone() });
                }
            }
            if Instant::now() > end {
                let what = format!("the field of {scene:?}");
                return Err(ClientError::Timeout { what, seconds: started.elapsed().as_secs_f64() });
            }
            link.wait_for_news(LOOK_AGAIN)?;
            // The daemon rings for every attachment, so that asking at each ring would keep both awake.
            if attached.elapsed() >= LOOK_AGAIN {
                link.attach();
                attached = Instant::now();
            }
        }
    }

    pub fn table(&self) -> FieldTable<'_> {
        FieldTable::open(WireBlock::blocks(self.sample.payload())).expect("checked when it was mapped, and nobody writes to it")
    }

    /// Counts the tables that the daemon has published.
    pub fn epoch(&self) -> u64 {
        self.header.epoch
    }

    /// The daemon that built it.
    pub fn instance(&self) -> u64 {
        self.header.instance
    }

    /// Size of the table, bytes.
    pub fn bytes(&self) -> u64 {
        std::mem::size_of_val(self.sample.payload()) as u64
    }
}
