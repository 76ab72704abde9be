//! The fixed part of every message.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;
use overfly_table::Block;

/// "OVFLYMSG" in memory order on a little-endian machine.
pub const MAGIC: u64 = u64::from_le_bytes(*b"OVFLYMSG");

/// Version of the header, the bodies and the services. Both sides must agree. Version 2 has orders with rig files and view directions, 3 those with goals, seconds and
/// regions, 4 those with goals for matched views and objectives, 5 those with an overlap. Version 6 says how a plan differs from the one before it. Version 7 has
/// edits that are made together, shapes, zones and updates. In version 8 aircraft report their flights.
pub const SCHEMA: u32 = 9;

/// Who sent what, and how long it is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Header {
    pub magic: u64,
    pub schema: u32,
    /// A [`Kind`] as a number.
    pub kind: u32,
    /// The daemon that sent this, or that the sender of a request believes to talk to (0: any). A new process has a new one.
    pub instance: u64,
    /// Counts the tables that a daemon has published; 0 in requests and replies.
    pub epoch: u64,
    /// The client that a request comes from, and that a reply or a plan is meant for.
    pub client: u64,
    /// Number of the request in its client.
    pub correlation: u64,
    /// Length of the encoded body at the start of the payload, bytes.
    pub body_bytes: u64,
    /// Length of the bulk data, which starts at the next block after the body, bytes.
    pub bulk_bytes: u64,
    /// Of a plan: the epoch of the scene's plan before it; 0 without one, and in other messages.
    pub follows: u64,
    /// Of a plan that follows another one: the first waypoint that is not as it was there. The flight may be spliced in before it.
    pub first_changed: u64,
}

/// What a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Request,
    Reply,
    Plan,
    Field,
    Status,
}

impl Kind {
    pub const fn code(self) -> u32 {
        match self {
            Kind::Request => 1,
            Kind::Reply => 2,
            Kind::Plan => 3,
            Kind::Field => 4,
            Kind::Status => 5,
        }
    }
}

impl Header {
    /// A header of this release for `kind`; the caller fills in the rest.
    pub fn new(kind: Kind) -> Self {
        Self { magic: MAGIC, schema: SCHEMA, kind: kind.code(), ..Self::default() }
    }

    /// Says that this message was written by the same schema version and is of the expected kind.
    pub fn is(&self, kind: Kind) -> bool {
        self.magic == MAGIC && self.schema == SCHEMA && self.kind == kind.code()
    }
}

// SAFETY: integers only, `repr(C)`, no padding (`Pod`), no pointers.
unsafe impl ZeroCopySend for Header {
    unsafe fn type_name() -> &'static str {
        "OverflyHeader"
    }
}

/// A [`Block`] that may be sent.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct WireBlock(pub Block);

// SAFETY: a block is 64 plain bytes, and any content is valid.
unsafe impl ZeroCopySend for WireBlock {
    unsafe fn type_name() -> &'static str {
        "OverflyBlock"
    }
}

impl WireBlock {
    /// The payload of a sample as blocks of a table.
    pub fn blocks(payload: &[WireBlock]) -> &[Block] {
        bytemuck::cast_slice(payload)
    }

    pub fn blocks_mut(payload: &mut [WireBlock]) -> &mut [Block] {
        bytemuck::cast_slice_mut(payload)
    }
}
