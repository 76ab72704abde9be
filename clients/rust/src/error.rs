//! What can go wrong between a client and its daemon.

use overfly_table::LayoutError;
use overfly_wire::frame::FrameError;
use overfly_wire::memory::MemoryError;
use overfly_wire::service::ServiceError;
use overfly_wire::{DomainError, Refusal, RefusalCode};

/// Why a call gave no result. [`ClientError::Refused`] is the daemon's answer; everything else is transport.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    #[error("no daemon serves the domain {domain:?}; start one with `overfly serve --domain {domain}`")]
    NoDaemon { domain: String },
    #[error("{message}")]
    Refused { code: RefusalCode, message: String },
    #[error("the daemon of the domain {domain:?} gave no answer for {seconds:.1} s while {what}; its log says more")]
    NoAnswer { domain: String, what: &'static str, seconds: f64 },
    #[error("the daemon of the domain {domain:?} has ended; start it again with `overfly serve --domain {domain}`")]
    Lost { domain: String },
    #[error("{what} did not come within {seconds:.1} s; wait longer, or see `overfly status`")]
    Timeout { what: String, seconds: f64 },
    #[error("the daemon of the domain {domain:?} was restarted and has lost its scenes; load them again")]
    Restarted { domain: String },
    #[error("a message of the daemon cannot be read: {0}")]
    Message(#[from] FrameError),
    #[error("a table of the daemon cannot be read: {0}")]
    Table(#[from] LayoutError),
    #[error("the daemon answered {0}, which does not belong to the request: use client and daemon of one release")]
    Unexpected(String),
    #[error(transparent)]
    Domain(#[from] DomainError),
    #[error(transparent)]
    Memory(#[from] MemoryError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(
        "a segment of a field cannot be mapped ({cause}); only programs on the host of the daemon of {domain:?} that see its /dev/shm can"
    )]
    Segment {
        domain: String,
        #[source]
        cause: std::io::Error,
    },
    #[error("the request cannot be sent: {0}")]
    Send(String),
    #[error("messages cannot be received: {0}")]
    Receive(String),
    #[error("the path {path:?} cannot be made absolute: {cause}")]
    Path {
        path: std::path::PathBuf,
        #[source]
        cause: std::io::Error,
    },
}

impl From<Refusal> for ClientError {
    fn from(refusal: Refusal) -> Self {
        ClientError::Refused { code: refusal.code, message: refusal.message }
    }
}
