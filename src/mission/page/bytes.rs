//! Numbers as base64 of little-endian arrays: half as long as their digits, and read without parsing.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// An array of numbers of one kind.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Packed(String);

impl Packed {
    pub fn f32(values: impl IntoIterator<Item = f64>) -> Self {
        Self::of(values.into_iter().flat_map(|value| (value as f32).to_le_bytes()))
    }

    pub fn u32(values: impl IntoIterator<Item = u32>) -> Self {
        Self::of(values.into_iter().flat_map(u32::to_le_bytes))
    }

    pub fn u8(values: impl IntoIterator<Item = u8>) -> Self {
        Self::of(values)
    }

    /// Components of unit vectors in steps of 1/127.
    pub fn unit_i8(values: impl IntoIterator<Item = f64>) -> Self {
        Self::of(values.into_iter().map(|value| (value * 127.0).round() as i8 as u8))
    }

    fn of(bytes: impl IntoIterator<Item = u8>) -> Self {
        Self(STANDARD.encode(bytes.into_iter().collect::<Vec<u8>>()))
    }
}
