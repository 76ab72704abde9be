//! Measurements of the way between a client and its daemon, as samples in nanoseconds.

use std::time::Duration;

use crate::client::Client;
use crate::error::ClientError;

/// Times of `count` requests from sending to the acknowledgement. `gap` lies between them; zero sends them back to back.
pub fn ping(client: &Client, count: usize, gap: Duration) -> Result<Vec<u64>, ClientError> {
    (0..count)
        .map(|_| {
            std::thread::sleep(gap);
            client.ping().map(|time| time.as_nanos() as u64)
        })
        .collect()
}
