//! Messages as they are, without the client library.

use std::mem::MaybeUninit;

use iceoryx2::prelude::EventId;
use overfly_client::RefusalCode;
use overfly_table::Block;
use overfly_wire::codec;
use overfly_wire::frame::{self, Limits};
use overfly_wire::service::{
    self, Bell, BlockPublisher, BlockSubscriber, Channel, EVENT_REQUEST, EventNotifier, IpcNode, Memory,
};
use overfly_wire::{Domain, Header, Kind, Reply, Request, WireBlock};

use super::wait_for;

/// A client that keeps to no rule.
pub struct Vandal {
    requests: BlockPublisher,
    pub replies: BlockSubscriber,
    ring: EventNotifier,
    _node: IpcNode,
}

impl Vandal {
    pub fn enter(domain: &Domain) -> Self {
        let node = service::node(domain, "vandal").unwrap();
        let requests = service::publisher(&service::open(&node, Channel::Requests).unwrap(), Memory::Growing).unwrap();
        let replies = service::subscriber(&service::open(&node, Channel::Replies).unwrap()).unwrap();
        let ring = service::notifier(&service::open_bell(&node, Bell::Daemon).unwrap()).unwrap();
        Self { requests, replies, ring, _node: node }
    }

    pub fn send(&self, header: Header, payload: &[Block]) {
        let mut sample = wait_for("a place for the message", || self.requests.loan_slice_uninit(payload.len()).ok());
        *sample.user_header_mut() = header;
        for (place, block) in sample.payload_mut().iter_mut().zip(payload) {
            *place = MaybeUninit::new(WireBlock(*block));
        }
        // SAFETY: every block was written just now.
        unsafe { sample.assume_init() }.send().unwrap();
        self.ring.notify_with_custom_event_id(EventId::new(EVENT_REQUEST)).unwrap();
    }

    pub fn answer(&self, correlation: u64) -> Reply {
        wait_for("an answer", || {
            let sample = self.replies.receive().unwrap()?;
            let header = *sample.user_header();
            let limits = Limits { body_bytes: codec::MAX_REPLY_BYTES, bulk_bytes: 0 };
            let frame = frame::copy(&header, WireBlock::blocks(sample.payload()), Kind::Reply, limits).unwrap();
            (header.correlation == correlation).then(|| codec::decode_reply(&frame.body).unwrap())
        })
    }

    pub fn refusal(&self, correlation: u64) -> (RefusalCode, String) {
        match self.answer(correlation) {
            Reply::Refused(refusal) => (refusal.code, refusal.message),
            other => panic!("expected a refusal, got {other:?}"),
        }
    }
}

/// A well-formed message of client 7.
pub fn honest(request: &Request, correlation: u64) -> (Header, Vec<Block>) {
    let body = codec::encode(request, codec::MAX_REQUEST_BYTES).unwrap();
    let mut payload = vec![Block::ZERO; frame::blocks(body.len(), 0)];
    frame::fill(&mut payload, &body, &[]);
    (Header { client: 7, correlation, body_bytes: body.len() as u64, ..Header::new(Kind::Request) }, payload)
}
