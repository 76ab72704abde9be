//! Fields, read where the daemon has built them.

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::{Arc, Weak};
use std::time::Instant;

use overfly_table::{FieldTable, Segment, field};
use overfly_wire::memory;
use overfly_wire::segment::SegmentMap;
use overfly_wire::service::{self, BlockSample, BlockSubscriber, LOOK_AGAIN};
use overfly_wire::{Domain, Header, Kind, WireBlock};

use crate::error::ClientError;
use crate::link::{Link, Presence};

/// A field in shared memory, mapped read-only. While it lives the daemon keeps its table, so do not keep more than you read. Segments that fields before
/// and after an edit have in common are mapped once.
pub struct FieldMap {
    sample: BlockSample,
    segments: Vec<Segment>,
    header: Header,
    _subscriber: BlockSubscriber,
    _presence: Arc<Presence>,
}

/// The segments that a client has mapped, by daemon and number.
#[derive(Default)]
pub(crate) struct Segments(RefCell<HashMap<(u64, u64), Weak<SegmentMap>>>);

impl FieldMap {
    /// Waits for a table of the daemon `link` talks to (any, before it has answered) that is at least as new as `epoch`.
    pub(crate) fn open(link: &Link, scene: &str, epoch: u64, end: Instant) -> Result<Self, ClientError> {
        let started = Instant::now();
        memory::check_room(0)?;
        let subscriber = service::field_subscriber(&service::open_field(link.presence.node(), scene)?)?;
        link.attach();
        let (mut attached, mut missing) = (started, None);
        loop {
            while let Some(sample) = subscriber.receive().map_err(|error| ClientError::Receive(format!("{error:?}")))? {
                let header = *sample.user_header();
                // The table of a daemon that was killed may still wait here and arrives first.
                let instance = link.instance.get();
                let current = instance == 0 || header.instance == instance;
                if header.is(Kind::Field) && current && header.epoch >= epoch {
                    match link.segments.map(&link.domain, header.instance, &sample) {
                        Ok(segments) => {
                            FieldTable::open(WireBlock::blocks(sample.payload()), &segments)?;
                            let presence = link.presence.clone();
                            return Ok(Self { sample, segments, header, _subscriber: subscriber, _presence: presence });
                        }
                        // An edit was faster: the field that it led to is on its way.
                        Err(ClientError::Segment { cause, .. }) if cause.kind() == std::io::ErrorKind::NotFound => {
                            missing = Some(cause);
                        }
                        Err(error) => return Err(error),
                    }
                }
            }
            if Instant::now() > end {
                let what = format!("the field of {scene:?}");
                return Err(match missing {
                    Some(cause) => ClientError::Segment { domain: link.domain.name().into(), cause },
                    None => ClientError::Timeout { what, seconds: started.elapsed().as_secs_f64() },
                });
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
        let table = FieldTable::open(WireBlock::blocks(self.sample.payload()), &self.segments);
        table.expect("checked when it was mapped, and nobody writes to it")
    }

    /// Counts the tables that the daemon has published.
    pub fn epoch(&self) -> u64 {
        self.header.epoch
    }

    /// The daemon that built it.
    pub fn instance(&self) -> u64 {
        self.header.instance
    }

    /// Size of the table and its segments, bytes.
    pub fn bytes(&self) -> u64 {
        self.table().bytes()
    }
}

impl Segments {
    /// The segments of the table in `sample`; what is mapped already is not mapped again.
    fn map(&self, domain: &Domain, instance: u64, sample: &BlockSample) -> Result<Vec<Segment>, ClientError> {
        let mut known = self.0.borrow_mut();
        known.retain(|_, segment| segment.strong_count() > 0);
        let segment = |tile: &field::TileRow| {
            let key = (instance, tile.number);
            let mapped = match known.get(&key).and_then(Weak::upgrade) {
                Some(mapped) => mapped,
                None => {
                    let failed = |cause| ClientError::Segment { domain: domain.name().into(), cause };
                    let mapped = Arc::new(SegmentMap::open(domain, instance, tile.number).map_err(failed)?);
                    known.insert(key, Arc::downgrade(&mapped));
                    mapped
                }
            };
            Ok(Segment::open(mapped)?)
        };
        field::tiles(WireBlock::blocks(sample.payload()))?.iter().map(segment).collect()
    }
}
