//! The service that publishes the field of one scene, and the field where it lies.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use iceoryx2::port::LoanError;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc_threadsafe;
use iceoryx2::sample_mut::SampleMut;
use overfly_table::Block;
use overfly_wire::memory::{self, MemoryError};
use overfly_wire::service::{
    self, BlockPublisher, BlockSample, BlockService, BlockSubscriber, FIELD_SAMPLES, IpcNode, ServiceError,
};
use overfly_wire::{Header, WireBlock};

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

/// Publisher of one scene's fields. The daemon is the first subscriber of its own tables, so that its searches read the same
/// memory as everybody else.
#[derive(Debug)]
pub struct FieldChannel {
    scene: String,
    publisher: Mutex<Arc<BlockPublisher>>,
    own: BlockSubscriber,
    service: BlockService,
}

/// Shared memory that holds a finished field nobody has seen yet.
#[derive(Debug)]
pub struct FilledField {
    sample: SampleMut<ipc_threadsafe::Service, [WireBlock], Header>,
    reservation: Reservation,
}

/// A published field, held for as long as this lives.
#[derive(Debug)]
pub struct HeldField {
    blocks: Range<*const Block>,
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
}

impl FieldChannel {
    pub fn create(node: &IpcNode, scene: &str) -> Result<Arc<Self>, FieldChannelError> {
        memory::check_room(0)?;
        let service = service::provide_field(node, scene)?;
        let publisher = Arc::new(service::publisher(&service, Some(FIELD_SAMPLES))?);
        let own = service::subscriber(&service)?;
        Ok(Arc::new(Self { scene: scene.into(), publisher: Mutex::new(publisher), own, service }))
    }

    /// Lends `count` zeroed blocks, each of them backed by memory, and lets `build` fill them. May be called from a worker thread.
    pub fn fill<E: From<FieldChannelError>>(
        &self,
        count: usize,
        reservation: Reservation,
        build: impl FnOnce(&mut [Block]) -> Result<(), E>,
    ) -> Result<FilledField, E> {
        let mut sample = self.loan(count)?;
        build(WireBlock::blocks_mut(sample.payload_mut()))?;
        sample.user_header_mut().bulk_bytes = (count * Block::BYTES) as u64;
        Ok(FilledField { sample, reservation })
    }

    /// Publishes a field under `header` and takes the daemon's own hold on it.
    pub fn publish(&self, filled: FilledField, header: Header) -> Result<HeldField, FieldChannelError> {
        let lost = |cause: String| FieldChannelError::Lost { scene: self.scene.clone(), cause };
        let FilledField { mut sample, reservation } = filled;
        let bulk_bytes = sample.user_header().bulk_bytes;
        *sample.user_header_mut() = Header { bulk_bytes, ..header };
        sample.send().map_err(|error| lost(error.to_string()))?;
        while let Some(sample) = self.own.receive().map_err(|error| lost(error.to_string()))? {
            let found = sample.user_header();
            if (found.instance, found.epoch) == (header.instance, header.epoch) {
                let blocks = WireBlock::blocks(sample.payload()).as_ptr_range();
                return Ok(HeldField { blocks, _sample: Mutex::new(sample), _reservation: reservation });
            }
        }
        Err(lost("nothing was received".into()))
    }

    /// Hands the current field to subscribers that have come since.
    pub fn update(&self) {
        if let Err(error) = self.publisher().update_connections() {
            tracing::warn!(scene = self.scene, %error, "a subscriber of the field cannot be connected");
        }
    }

    fn loan(&self, count: usize) -> Result<SampleMut<ipc_threadsafe::Service, [WireBlock], Header>, FieldChannelError> {
        let refused = |cause: String| FieldChannelError::Loan { scene: self.scene.clone(), cause };
        memory::check_room(count * Block::BYTES)?;
        let publisher = self.publisher();
        let mut sample = match publisher.loan_slice_uninit(count) {
            // Clients hold so many old fields that no place is free. A second publisher of the same service has places of its own; the
            // old one's memory goes when its last reader lets go.
            Err(LoanError::OutOfMemory) => {
                tracing::warn!(scene = self.scene, "clients hold {FIELD_SAMPLES} old fields; a new segment is made");
                self.renew()?.loan_slice_uninit(count).map_err(|error| refused(error.to_string()))?
            }
            other => other.map_err(|error| refused(error.to_string()))?,
        };
        memory::populate(sample.payload_mut())?;
        sample.payload_mut().fill(std::mem::MaybeUninit::new(WireBlock(Block::ZERO)));
        // SAFETY: every block was written just now.
        Ok(unsafe { sample.assume_init() })
    }

    fn renew(&self) -> Result<Arc<BlockPublisher>, FieldChannelError> {
        let fresh = Arc::new(service::publisher(&self.service, Some(FIELD_SAMPLES))?);
        *self.publisher.lock().unwrap_or_else(PoisonError::into_inner) = fresh.clone();
        Ok(fresh)
    }

    fn publisher(&self) -> Arc<BlockPublisher> {
        self.publisher.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
