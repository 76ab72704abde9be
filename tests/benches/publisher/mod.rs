//! One large field, published the way the daemon publishes them, without a scene behind it.

use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::EventId;
use overfly_table::field::{FieldCounts, FieldFacts, TileRow};
use overfly_table::{Block, FieldTableMut, SegmentRows, TableMemory};
use overfly_wire::segment::SegmentFile;
use overfly_wire::service::{self, Bell, BlockPublisher, Channel, EVENT_ATTACH, EVENT_NEWS, Memory};
use overfly_wire::{Domain, Header, Kind, WireBlock, memory};

/// The scene name under which [`serve_table`] publishes.
pub const TABLE_SCENE: &str = "bench";

/// What one row of a segment of the measured field sees; each segment has this one row, of a megabyte.
const SEEN_IN_ROW: u32 = 1_000_000 / 8;

/// Number of this process in the names of its segments.
const INSTANCE: u64 = 1;

/// Publishes a field of about `megabytes` in `domain` and hands it to every subscriber that comes, until standard input ends.
/// `ready` is called when the first may come.
pub fn serve_table(domain: &Domain, megabytes: usize, ready: impl FnOnce()) {
    let lock = domain.lock().expect("nobody else serves the domain");
    serve(domain, megabytes, ready);
    lock.release();
}

fn serve(domain: &Domain, megabytes: usize, ready: impl FnOnce()) {
    let node = service::node(domain, "overfly-bench").expect("a node");
    // Clients open all services of a daemon.
    let channels = [Channel::Requests, Channel::Replies, Channel::Plans, Channel::Status];
    let services = channels.map(|channel| service::provide(&node, channel).expect("a service"));
    let _requests = service::subscriber(&services[0]).expect("a subscriber");
    let news = service::notifier(&service::provide_bell(&node, Bell::Clients).expect("a bell")).expect("a notifier");
    let bell = service::listener(&service::provide_bell(&node, Bell::Daemon).expect("a bell")).expect("a listener");
    let fields = service::provide_field(&node, TABLE_SCENE).expect("a service");
    let segments: Vec<SegmentFile> = (0..megabytes).map(|_| segment(domain)).collect();
    let counts = FieldCounts { structures: 1, samples: 1, tiles: segments.len(), patches: 1, ..Default::default() };
    let memory = Memory::Fixed { blocks: counts.blocks(), samples: 2 };
    let publisher = service::publisher(&fields, memory).expect("memory for the table");
    publish(&publisher, &counts, &segments);

    let ended = Arc::new(AtomicBool::new(false));
    let input_ended = Arc::clone(&ended);
    std::thread::spawn(move || {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        input_ended.store(true, Ordering::Relaxed);
    });
    ready();
    while !ended.load(Ordering::Relaxed) {
        let mut attached = false;
        let heard = bell.timed_wait(|event| attached |= event.id.as_value() == EVENT_ATTACH, Duration::from_millis(100));
        heard.expect("the bell can be heard");
        if attached {
            publisher.update_connections().expect("subscribers can be connected");
            let _ = news.notify_with_custom_event_id(EventId::new(EVENT_NEWS));
        }
    }
}

fn segment(domain: &Domain) -> SegmentFile {
    let mut rows = SegmentRows::default();
    (0..SEEN_IN_ROW).for_each(|_| rows.see(0, 1));
    rows.end_row();
    SegmentFile::create(domain, INSTANCE, rows.blocks(), |blocks| rows.write(blocks)).expect("memory for a segment")
}

fn publish(publisher: &BlockPublisher, counts: &FieldCounts, segments: &[SegmentFile]) {
    let lent = publisher.loan_slice_uninit(counts.blocks()).expect("room for the table");
    let mut sample = memory::provide(lent).expect("memory for the table");
    let bulk_bytes = (counts.blocks() * Block::BYTES) as u64;
    *sample.user_header_mut() = Header { instance: INSTANCE, epoch: 1, bulk_bytes, ..Header::new(Kind::Field) };
    let blocks = WireBlock::blocks_mut(sample.payload_mut());
    blocks.fill(Block::ZERO);
    let table = FieldTableMut::create(blocks, counts, FieldFacts::default());
    for (tile, segment) in table.tiles.iter_mut().zip(segments) {
        *tile = TileRow { number: segment.number(), patches: 1, rows: 1, ..Default::default() };
    }
    sample.send().expect("the table is sent");
}
