//! A publisher for measurements: one large field, served as the daemon serves them, without a scene behind it.

use std::time::Duration;

use iceoryx2::prelude::*;
use overfly_table::field::{FieldCounts, FieldFacts};
use overfly_table::{Block, FieldTableMut};
use overfly_wire::service::Ipc;
use overfly_wire::{Domain, Header, Kind};

use super::DaemonError;
use super::budget::Budget;
use super::field_channel::{FieldChannel, FieldChannelError};
use super::ports::Ports;
use super::wake::Signals;

/// The scene name under which [`serve_table`] publishes.
pub const TABLE_SCENE: &str = "bench";

/// Samples of the measured field; the viewpoints follow from its size.
const SAMPLES: usize = 16_384;

/// Publishes an empty field of about `megabytes` in `domain` and hands it to every subscriber that comes, until SIGTERM or SIGINT.
/// `ready` is called when the first may come.
pub fn serve_table(domain: &Domain, megabytes: usize, ready: impl FnOnce()) -> Result<(), DaemonError> {
    let lock = domain.lock()?;
    let served = serve(domain, megabytes, ready);
    lock.release();
    served
}

fn serve(domain: &Domain, megabytes: usize, ready: impl FnOnce()) -> Result<(), DaemonError> {
    let system = |what: &'static str| move |cause: String| DaemonError::System { what, cause };
    let signals = Signals::install().map_err(|error| system("signal handling")(error.to_string()))?;
    let ports = Ports::open(domain)?;
    let channel = FieldChannel::create(&ports.node, TABLE_SCENE).map_err(|error| system("the table")(error.to_string()))?;
    let counts = FieldCounts { samples: SAMPLES, viewpoints: megabytes * 1_000_000 * 8 / SAMPLES, ..Default::default() };
    let _held = publish(&channel, &counts, ports.instance).map_err(|error| system("the table")(error.to_string()))?;

    let waiting = system("waiting for events");
    let waitset = WaitSetBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .map_err(|error| waiting(error.to_string()))?;
    let on_end = waitset.attach_notification(&signals.end).map_err(|error| waiting(error.to_string()))?;
    let _on_bell = waitset.attach_notification(&ports.bell).map_err(|error| waiting(error.to_string()))?;
    ready();
    let mut ended = false;
    while !ended {
        let on_event = |id: WaitSetAttachmentId<Ipc>| {
            ended |= id.has_event_from(&on_end);
            CallbackProgression::Continue
        };
        waitset
            .wait_and_process_once_with_timeout(on_event, Duration::from_secs(1))
            .map_err(|error| waiting(error.to_string()))?;
        if ports.drain_bell().attach {
            channel.update();
            ports.ring();
        }
    }
    Ok(())
}

fn publish(channel: &FieldChannel, counts: &FieldCounts, instance: u64) -> Result<impl Sized + use<>, FieldChannelError> {
    // Every sample must belong to a structure.
    let counts = FieldCounts { structures: 1, ..*counts };
    let blocks = counts.blocks();
    let megabytes = (blocks * Block::BYTES).div_ceil(1_000_000) as u64;
    let reservation = Budget::new(megabytes).reserve((blocks * Block::BYTES) as u64).expect("the budget was made for it");
    let filled = channel.fill::<FieldChannelError>(blocks, reservation, |blocks| {
        FieldTableMut::create(blocks, &counts, FieldFacts::default());
        Ok(())
    })?;
    channel.publish(filled, Header { instance, epoch: 1, ..Header::new(Kind::Field) })
}
