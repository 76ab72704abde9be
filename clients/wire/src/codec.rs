//! The encoding of control bodies. This is the only place that knows which one it is.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Longest body of a request, bytes: two added meshes are about the largest thing in one.
pub const MAX_REQUEST_BYTES: usize = 4 << 20;

/// Longest body of a reply, bytes: the list of all structures of a large town is the largest thing in one.
pub const MAX_REPLY_BYTES: usize = 64 << 20;

/// Longest published status, bytes: a thousand scenes and more.
pub const MAX_STATUS_BYTES: usize = 1 << 20;

/// Why a body could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CodecError {
    #[error("the body cannot be encoded: {0}")]
    Encode(#[source] bincode::error::EncodeError),
    #[error("the body is {bytes} bytes long; at most {limit} are allowed: split the request")]
    TooLong { bytes: usize, limit: usize },
    #[error("the body cannot be decoded: {0}; use client and daemon of one release")]
    Decode(#[source] bincode::error::DecodeError),
    #[error("{0} bytes follow the end of the body; use client and daemon of one release")]
    Trailing(usize),
}

/// Encodes `body`, which must not become longer than `limit` bytes.
pub fn encode<T: Serialize>(body: &T, limit: usize) -> Result<Vec<u8>, CodecError> {
    let bytes = bincode::serde::encode_to_vec(body, bincode::config::standard()).map_err(CodecError::Encode)?;
    if bytes.len() > limit { Err(CodecError::TooLong { bytes: bytes.len(), limit }) } else { Ok(bytes) }
}

/// Decodes the body of a request.
pub fn decode_request<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CodecError> {
    decode::<T, MAX_REQUEST_BYTES>(bytes)
}

/// Decodes the body of a reply.
pub fn decode_reply<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CodecError> {
    decode::<T, MAX_REPLY_BYTES>(bytes)
}

/// Decodes at most `LIMIT` bytes; a length inside the body cannot make this allocate more.
pub fn decode<T: DeserializeOwned, const LIMIT: usize>(bytes: &[u8]) -> Result<T, CodecError> {
    if bytes.len() > LIMIT {
        return Err(CodecError::TooLong { bytes: bytes.len(), limit: LIMIT });
    }
    let config = bincode::config::standard().with_limit::<LIMIT>();
    let (value, used) = bincode::serde::decode_from_slice(bytes, config).map_err(CodecError::Decode)?;
    if used == bytes.len() { Ok(value) } else { Err(CodecError::Trailing(bytes.len() - used)) }
}
