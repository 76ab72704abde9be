//! The service that publishes the field of one scene, and the field where it lies: its table is a message, its segments are files in shared memory that
//! the fields before and after an edit share.

use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use iceoryx2::port::update_connections::UpdateConnections;
use overfly_table::{Block, Segment, TableMemory};
use overfly_wire::memory::{self, MemoryError};
use overfly_wire::segment::SegmentFile;
use overfly_wire::service::{
    self, BlockLoan, BlockPublisher, BlockSample, BlockService, BlockSubscriber, FIELD_SAMPLES, IpcNode, Memory, ServiceError,
};
use overfly_wire::{Domain, Header, WireBlock};

use super::budget::Reservation;
use crate::session::FieldStorage;

/// Why a field could not be published.
#[derive(Debug, thiserror::Error)]
pub enum FieldChannelError {
    #[error(
        "the field of {scene:?} cannot be placed in shared memory: {cause}; end clients that keep old fields, or load the scene again"
    )]
    Loan { scene: String, cause: String },
    #[error(transparent)]
    Memory(#[from] MemoryError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error("the field of {scene:?} was sent but did not come back to the daemon: {cause}; load the scene again")]
    Lost { scene: String, cause: String },
}

/// Publishers of one scene's fields. The daemon is the first subscriber of its own tables, so that its searches read the same
/// memory as everybody else.
#[derive(Debug)]
pub struct FieldChannel {
    scene: String,
    domain: Domain,
    /// The daemon in the names of segments.
    instance: u64,
    publishers: Mutex<Publishers>,
    own: BlockSubscriber,
    service: BlockService,
}

/// A publisher's memory cannot grow, so that a field that does not fit takes a new one.
#[derive(Debug, Default)]
struct Publishers {
    /// Has published the current field and hands it to late joiners.
    serving: Option<Arc<BlockPublisher>>,
    /// Lends memory for the next field, mostly the same one.
    lending: Option<Arc<BlockPublisher>>,
}

/// A segment that was published, or will be; it counts against the budget for as long as any field has it.
struct CountedSegment {
    file: SegmentFile,
    _reservation: Reservation,
}

impl TableMemory for CountedSegment {
    fn blocks(&self) -> &[Block] {
        self.file.blocks()
    }

    fn number(&self) -> u64 {
        self.file.number()
    }
}

/// Shared memory that holds a finished table nobody has seen yet.
#[derive(Debug)]
pub struct FilledField {
    sample: BlockLoan,
    publisher: Arc<BlockPublisher>,
    reservation: Reservation,
}

/// A published field, held for as long as this lives.
#[derive(Debug)]
pub struct HeldField {
    blocks: Range<*const Block>,
    segments: Vec<Segment>,
    _sample: Mutex<BlockSample>,
    _reservation: Reservation,
}

// SAFETY: `blocks` lies in a read-only mapping that `_sample` keeps alive; the sample itself may be dropped on any thread, because it
// belongs to the thread-safe service variant.
unsafe impl Send for HeldField {}
// SAFETY: as above; all shared access is reading.
unsafe impl Sync for HeldField {}

impl FieldStorage for HeldField {
    fn blocks(&self) -> &[Block] {
        let count = (self.blocks.end as usize - self.blocks.start as usize) / Block::BYTES;
        // SAFETY: the range was taken from the sample's payload, which lives as long as `self`.
        unsafe { std::slice::from_raw_parts(self.blocks.start, count) }
    }

    fn segments(&self) -> &[Segment] {
        &self.segments
    }
}

impl FieldChannel {
    /// For the daemon `instance` that serves `domain` and has `node`.
    pub fn create(node: &IpcNode, domain: &Domain, instance: u64, scene: &str) -> Result<Arc<Self>, FieldChannelError> {
        memory::check_room(0)?;
        let service = service::provide_field(node, scene)?;
        let own = service::subscriber(&service)?;
        let domain = domain.clone();
        Ok(Arc::new(Self { scene: scene.into(), domain, instance, publishers: Mutex::default(), own, service }))
    }

    /// Makes a segment of `count` blocks, which `write` writes. May be called from any thread.
    pub fn segment(
        &self,
        count: usize,
        reservation: Reservation,
        write: &dyn Fn(&mut [Block]),
    ) -> Result<Arc<dyn TableMemory>, FieldChannelError> {
        let file = SegmentFile::create(&self.domain, self.instance, count, write)?;
        Ok(Arc::new(CountedSegment { file, _reservation: reservation }))
    }

    /// Lends `count` blocks for a field's table, each of them backed by memory, and lets `write` write all of them: they hold what an earlier field left
    /// there. May be called from a worker thread.
    pub fn fill(
        &self,
        count: usize,
        reservation: Reservation,
        write: impl FnOnce(&mut [Block]),
    ) -> Result<FilledField, FieldChannelError> {
        let (publisher, mut sample) = self.loan(count)?;
        write(WireBlock::blocks_mut(sample.payload_mut()));
        sample.user_header_mut().bulk_bytes = (count * Block::BYTES) as u64;
        Ok(FilledField { sample, publisher, reservation })
    }

    /// Publishes a field with these segments under `header` and takes the daemon's own hold on it.
    pub fn publish(&self, filled: FilledField, segments: &[Segment], header: Header) -> Result<HeldField, FieldChannelError> {
        let lost = |cause: String| FieldChannelError::Lost { scene: self.scene.clone(), cause };
        let FilledField { mut sample, publisher, reservation } = filled;
        let bulk_bytes = sample.user_header().bulk_bytes;
        *sample.user_header_mut() = Header { bulk_bytes, ..header };
        sample.send().map_err(|error| lost(error.to_string()))?;
        // The publisher of the field before may go now; whoever reads its fields keeps their memory.
        self.lock().serving = Some(publisher);
        while let Some(sample) = self.own.receive().map_err(|error| lost(error.to_string()))? {
            let found = sample.user_header();
            if (found.instance, found.epoch) == (header.instance, header.epoch) {
                let blocks = WireBlock::blocks(sample.payload()).as_ptr_range();
                let segments = segments.to_vec();
                return Ok(HeldField { blocks, segments, _sample: Mutex::new(sample), _reservation: reservation });
            }
        }
        Err(lost("nothing was received".into()))
    }

    /// Hands the current field to subscribers that have come since.
    pub fn update(&self) {
        let serving = self.lock().serving.clone();
        if let Some(Err(error)) = serving.map(|publisher| publisher.update_connections()) {
            tracing::warn!(scene = self.scene, %error, "a subscriber of the field cannot be connected");
        }
    }

    fn loan(&self, count: usize) -> Result<(Arc<BlockPublisher>, BlockLoan), FieldChannelError> {
        memory::check_room(count * Block::BYTES)?;
        let lending = self.lock().lending.clone();
        let lent = lending.and_then(|publisher| publisher.loan_slice_uninit(count).ok().map(|sample| (publisher, sample)));
        let (publisher, lent) = match lent {
            Some(lent) => lent,
            // The field has outgrown the publisher's memory, or clients hold as many old fields as there is room for. A second
            // publisher of the same service has memory of its own; that of the first goes with its last reader.
            None => {
                let publisher = self.renew(count)?;
                let lent = publisher
                    .loan_slice_uninit(count)
                    .map_err(|error| FieldChannelError::Loan { scene: self.scene.clone(), cause: error.to_string() })?;
                (publisher, lent)
            }
        };
        Ok((publisher, memory::provide(lent)?))
    }

    fn renew(&self, count: usize) -> Result<Arc<BlockPublisher>, FieldChannelError> {
        // Edits make a field a little longer or shorter: leave room, which takes no memory before it is used.
        let memory = Memory::Fixed { blocks: count + count / 4, samples: FIELD_SAMPLES };
        let fresh = Arc::new(service::publisher(&self.service, memory)?);
        self.lock().lending = Some(fresh.clone());
        tracing::debug!(scene = self.scene, count, "new memory for fields");
        Ok(fresh)
    }

    fn lock(&self) -> MutexGuard<'_, Publishers> {
        self.publishers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
