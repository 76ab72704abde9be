//! Body and bulk in a run of blocks, and the one copy out of shared memory.

use overfly_table::{Block, blocks_for};

use crate::codec::CodecError;
use crate::header::{Header, Kind, MAGIC, SCHEMA};

/// The longest message that a receiver accepts, bytes.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub body_bytes: usize,
    pub bulk_bytes: usize,
}

/// A message that was copied out of shared memory: nobody else can change it any more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    pub header: Header,
    pub body: Vec<u8>,
    pub bulk: Vec<u8>,
}

/// Why a message was not taken.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    #[error("the message starts with {found:#018x}, not with {MAGIC:#018x}: it was not written by overfly")]
    Magic { found: u64 },
    #[error("the message has schema version {found}; this program speaks version {SCHEMA}: use client and daemon of one release")]
    Schema { found: u32 },
    #[error("the message is of kind {found}, but {expected:?} was expected here")]
    Kind { found: u32, expected: Kind },
    #[error("the body is {bytes} bytes long; at most {limit} are allowed: split the request")]
    BodyTooLong { bytes: u64, limit: usize },
    #[error(
        "the data is {bytes} bytes long; at most {limit} are allowed: send a smaller file, or raise `daemon.max_scene_mb` of the daemon"
    )]
    BulkTooLong { bytes: u64, limit: usize },
    #[error("the message announces {announced} bytes but holds {held}: it is truncated; send it again")]
    Truncated { announced: u64, held: usize },
    #[error(transparent)]
    Codec(#[from] CodecError),
}

/// Blocks that hold a body and bulk of these lengths.
pub fn blocks(body_bytes: usize, bulk_bytes: usize) -> usize {
    blocks_for(body_bytes as u64) + blocks_for(bulk_bytes as u64)
}

/// Writes body and bulk into `payload`, which must be exactly as long as [`blocks`] says.
pub fn fill(payload: &mut [Block], body: &[u8], bulk: &[u8]) {
    assert_eq!(payload.len(), blocks(body.len(), bulk.len()), "the caller sizes the payload");
    let (head, tail) = payload.split_at_mut(blocks_for(body.len() as u64));
    write(head, body);
    write(tail, bulk);
}

/// Checks `header` against `kind`, the payload's true length and `limits`, and copies the message.
pub fn copy(header: &Header, payload: &[Block], kind: Kind, limits: Limits) -> Result<Frame, FrameError> {
    // The header lies in shared memory too: judge and keep one copy of it.
    let header = *header;
    if header.magic != MAGIC {
        return Err(FrameError::Magic { found: header.magic });
    }
    if header.schema != SCHEMA {
        return Err(FrameError::Schema { found: header.schema });
    }
    if header.kind != kind.code() {
        return Err(FrameError::Kind { found: header.kind, expected: kind });
    }
    if header.body_bytes > limits.body_bytes as u64 {
        return Err(FrameError::BodyTooLong { bytes: header.body_bytes, limit: limits.body_bytes });
    }
    if header.bulk_bytes > limits.bulk_bytes as u64 {
        return Err(FrameError::BulkTooLong { bytes: header.bulk_bytes, limit: limits.bulk_bytes });
    }
    let held: &[u8] = bytemuck::cast_slice(payload);
    let body_end = header.body_bytes as usize;
    let bulk_start = blocks_for(header.body_bytes) * Block::BYTES;
    let bulk_end = bulk_start + header.bulk_bytes as usize;
    if body_end > held.len() || (header.bulk_bytes > 0 && bulk_end > held.len()) {
        return Err(FrameError::Truncated { announced: header.body_bytes + header.bulk_bytes, held: held.len() });
    }
    let bulk = if header.bulk_bytes > 0 { held[bulk_start..bulk_end].to_vec() } else { Vec::new() };
    Ok(Frame { header, body: held[..body_end].to_vec(), bulk })
}

fn write(blocks: &mut [Block], bytes: &[u8]) {
    if let Some(last) = blocks.last_mut() {
        *last = Block::ZERO;
    }
    bytemuck::cast_slice_mut::<Block, u8>(blocks)[..bytes.len()].copy_from_slice(bytes);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LIMITS: Limits = Limits { body_bytes: 4096, bulk_bytes: 4096 };

    fn header(body: usize, bulk: usize) -> Header {
        Header { body_bytes: body as u64, bulk_bytes: bulk as u64, ..Header::new(Kind::Request) }
    }

    proptest! {
        #[test]
        fn a_copy_holds_what_was_filled_in(
            body in prop::collection::vec(any::<u8>(), 0..300),
            bulk in prop::collection::vec(any::<u8>(), 0..300),
        ) {
            let mut payload = vec![Block([u64::MAX; 8]); blocks(body.len(), bulk.len())];
            fill(&mut payload, &body, &bulk);
            let frame = copy(&header(body.len(), bulk.len()), &payload, Kind::Request, LIMITS).unwrap();
            prop_assert_eq!(frame.body, body);
            prop_assert_eq!(frame.bulk, bulk);
        }

        #[test]
        fn no_header_reads_beyond_the_payload(words in any::<[u64; 7]>(), honest: bool, blocks in 0usize..4) {
            let [magic, kinds, instance, epoch, client, body_bytes, bulk_bytes] = words;
            let mut header = Header { magic, schema: kinds as u32, kind: (kinds >> 32) as u32, instance, epoch, client,
                body_bytes, bulk_bytes, ..Header::default() };
            if honest {
                header = Header { body_bytes: body_bytes % 400, bulk_bytes: bulk_bytes % 400, ..Header::new(Kind::Request) };
            }
            let payload = vec![Block::ZERO; blocks];
            if let Ok(frame) = copy(&header, &payload, Kind::Request, LIMITS) {
                prop_assert!(frame.body.len() + frame.bulk.len() <= blocks * Block::BYTES);
            }
        }
    }

    #[test]
    fn every_fault_is_named() {
        let payload = [Block::ZERO; 2];
        let faults: [(Header, &str); 6] = [
            (Header { magic: 1, ..header(1, 0) }, "not written by overfly"),
            (Header { schema: SCHEMA + 1, ..header(1, 0) }, "schema version"),
            (Header { kind: Kind::Plan.code(), ..header(1, 0) }, "of kind 3"),
            (header(5000, 0), "body is 5000 bytes"),
            (header(1, 5000), "max_scene_mb"),
            (header(64, 65), "truncated"),
        ];
        for (header, text) in faults {
            let message = copy(&header, &payload, Kind::Request, LIMITS).unwrap_err().to_string();
            assert!(message.contains(text), "{message:?} should contain {text:?}");
        }
    }
}
