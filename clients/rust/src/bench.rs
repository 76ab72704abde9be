//! Measurements of the way between a client and its daemon, as samples in nanoseconds.

use std::time::{Duration, Instant};

use overfly_wire::Domain;

use crate::client::Client;
use crate::error::ClientError;
use crate::field::FieldMap;
use crate::link::Link;

/// How long one joiner may wait for its table.
const PATIENCE: Duration = Duration::from_secs(5);

/// Times of `count` requests from sending to the acknowledgement. `gap` lies between them; zero sends them back to back.
pub fn ping(client: &Client, count: usize, gap: Duration) -> Result<Vec<u64>, ClientError> {
    (0..count)
        .map(|_| {
            if !gap.is_zero() {
                std::thread::sleep(gap);
            }
            client.ping().map(|time| time.as_nanos() as u64)
        })
        .collect()
}

/// Times until a subscriber that comes after the field of `scene` was published has it mapped, opened and checked; `count`
/// subscribers, one after another.
pub fn join(domain: &Domain, scene: &str, count: usize) -> Result<Vec<u64>, ClientError> {
    let link = Link::open(domain)?;
    (0..count)
        .map(|_| {
            let started = Instant::now();
            let field = FieldMap::open(&link, scene, 0, started + PATIENCE)?;
            let taken = started.elapsed();
            drop(field);
            Ok(taken.as_nanos() as u64)
        })
        .collect()
}
