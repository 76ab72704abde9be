//! Names and capacities of the services. The daemon creates them; clients only open them, so that a client without a daemon
//! leaves nothing behind.
//!
//! Only publish/subscribe and events are used, and no service is limited to one publisher or subscriber, because that is what a
//! network tunnel can carry.

use std::mem::MaybeUninit;
use std::time::Duration;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError};
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::domain::Domain;
use crate::header::{Header, WireBlock};

/// Ports of this variant may be used from several threads and work together with those of the plain one.
pub type Ipc = ipc_threadsafe::Service;
pub type IpcNode = Node<Ipc>;
pub type BlockService = publish_subscribe::PortFactory<Ipc, [WireBlock], Header>;
pub type EventService = event::PortFactory<Ipc>;
pub type BlockPublisher = Publisher<Ipc, [WireBlock], Header>;
pub type BlockSubscriber = Subscriber<Ipc, [WireBlock], Header>;
pub type BlockSample = Sample<Ipc, [WireBlock], Header>;
pub type BlockLoan = SampleMut<Ipc, [WireBlock], Header>;
pub type BlockLoanUninit = SampleMutUninit<Ipc, [MaybeUninit<WireBlock>], Header>;
pub type EventListener = Listener<Ipc>;
pub type EventNotifier = Notifier<Ipc>;

/// Clients that may be connected to one domain at the same time, the daemon included.
pub const MAX_CLIENTS: usize = 32;

/// Fields of one scene that may be mapped at the same time, by all clients together.
pub const MAX_FIELD_MAPS: usize = 256;

/// Events by which clients wake the daemon.
pub const EVENT_REQUEST: usize = 1;
/// A client has subscribed to a table and waits for the current one.
pub const EVENT_ATTACH: usize = 2;
/// Event by which the daemon wakes its clients.
pub const EVENT_NEWS: usize = 3;

/// Field tables that exist at the same time for one scene: one being built, the current one, and old ones still being read.
pub const FIELD_SAMPLES: usize = 12;

const EVENT_MAX: usize = 15;

/// Why a service, port or node could not be had.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    #[error("the service {0:?} does not exist")]
    Missing(String),
    #[error("{name}: {cause}; at most {MAX_CLIENTS} programs may use one domain: end one of them and try again")]
    Crowded { name: String, cause: String },
    #[error(
        "{name}: {cause}; at most {MAX_FIELD_MAPS} maps of a scene's field may be held at the same time: drop those that are not read any more"
    )]
    CrowdedField { name: String, cause: String },
    #[error("the service {name:?} was made by another release ({cause}): use client and daemon of one release")]
    Incompatible { name: String, cause: String },
    #[error("{name}: {cause}")]
    Failed { name: String, cause: String },
}

/// The services that every domain has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// From clients to the daemon.
    Requests,
    /// From the daemon to clients: acknowledgements, progress, results.
    Replies,
    /// Every new plan of every scene.
    Plans,
    /// The daemon's status whenever it changes; a late joiner receives the last one.
    Status,
}

/// The two event services.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bell {
    /// Clients ring, the daemon listens.
    Daemon,
    /// The daemon rings, clients listen.
    Clients,
}

/// Capacity of a publish/subscribe service.
struct Capacity {
    publishers: usize,
    subscribers: usize,
    buffer: usize,
    borrowed: usize,
    history: usize,
    /// When a receiver's buffer is full, drop its oldest message instead of the new one.
    overflow: bool,
}

impl Channel {
    pub fn name(self) -> &'static str {
        match self {
            Channel::Requests => "overfly/requests",
            Channel::Replies => "overfly/replies",
            Channel::Plans => "overfly/plans",
            Channel::Status => "overfly/status",
        }
    }

    fn capacity(self) -> Capacity {
        let capacity = |publishers, buffer, borrowed, overflow| Capacity {
            publishers,
            subscribers: MAX_CLIENTS,
            buffer,
            borrowed,
            history: 0,
            overflow,
        };
        match self {
            Channel::Requests => capacity(MAX_CLIENTS, 8, 2, false),
            Channel::Replies => capacity(4, 32, 2, true),
            Channel::Plans => capacity(4, 8, 8, true),
            Channel::Status => Capacity { history: 1, ..capacity(4, 2, 2, true) },
        }
    }
}

impl Bell {
    pub fn name(self) -> &'static str {
        match self {
            Bell::Daemon => "overfly/wake-daemon",
            Bell::Clients => "overfly/wake-clients",
        }
    }
}

/// Name of the service that holds the field of `scene`. Services have ASCII names, so that other letters are replaced, and a hash keeps
/// such names apart; no scene's name holds the `~` before it.
pub fn field_name(scene: &str) -> String {
    if scene.is_ascii() {
        return format!("overfly/field/{scene}");
    }
    let ascii: String = scene.chars().map(|c| if c.is_ascii() { c } else { '_' }).collect();
    format!("overfly/field/{ascii}~{:016x}", crate::domain::fnv(scene.as_bytes()))
}

/// A node in `domain`. Signals stay with the program, and dead nodes of others are swept by the daemon alone.
pub fn node(domain: &Domain, name: &str) -> Result<IpcNode, ServiceError> {
    let failed = |cause: String| ServiceError::Failed { name: format!("node {name:?}"), cause };
    let node_name = NodeName::new(name).map_err(|error| failed(format!("{error:?}")))?;
    let config = domain.config().map_err(|error| failed(error.to_string()))?;
    NodeBuilder::new()
        .name(&node_name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&config)
        .create::<Ipc>()
        .map_err(|error: NodeCreationFailure| failed(error.to_string()))
}

/// How messages name the client or daemon whose node this is; never 0.
pub fn short_id(node: u128) -> u64 {
    ((node >> 64) as u64 ^ node as u64).max(1)
}

/// Creates `channel`, or opens it when an earlier daemon of the domain left it to clients that are still there.
pub fn provide(node: &IpcNode, channel: Channel) -> Result<BlockService, ServiceError> {
    provide_blocks(node, channel.name(), &channel.capacity())
}

/// Opens `channel`, which the daemon provides.
pub fn open(node: &IpcNode, channel: Channel) -> Result<BlockService, ServiceError> {
    open_blocks(node, channel.name())
}

/// Creates the service for the field of `scene`.
pub fn provide_field(node: &IpcNode, scene: &str) -> Result<BlockService, ServiceError> {
    let capacity = Capacity { publishers: 8, subscribers: MAX_FIELD_MAPS, buffer: 1, borrowed: 8, history: 1, overflow: true };
    provide_blocks(node, &field_name(scene), &capacity)
}

/// Opens the service for the field of `scene`.
pub fn open_field(node: &IpcNode, scene: &str) -> Result<BlockService, ServiceError> {
    open_blocks(node, &field_name(scene))
}

/// Creates an event service, or opens it.
pub fn provide_bell(node: &IpcNode, bell: Bell) -> Result<EventService, ServiceError> {
    bell_builder(node, bell)?.open_or_create().map_err(|error| event_failed(bell.name(), error))
}

/// Opens an event service that the daemon provides.
pub fn open_bell(node: &IpcNode, bell: Bell) -> Result<EventService, ServiceError> {
    let builder = node.service_builder(&service_name(bell.name())?).event();
    builder.open().map_err(|error| event_failed(bell.name(), EventOpenOrCreateError::EventOpenError(error)))
}

/// The memory of a publisher. It is sparse: what was never written to takes none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Grows with the longest message to the next power of two, and has room for all messages that receivers can ever hold. A
    /// smaller number must not be combined with growth: a grown segment may count more messages than the publisher keeps books for.
    Growing,
    /// Messages of at most `blocks` blocks, `samples` of them at the same time.
    Fixed { blocks: usize, samples: usize },
}

pub fn publisher(service: &BlockService, memory: Memory) -> Result<BlockPublisher, ServiceError> {
    let builder = service.publisher_builder().max_loaned_samples(2).backpressure_strategy(BackpressureStrategy::DiscardData);
    let builder = match memory {
        Memory::Growing => builder.initial_max_slice_len(64).allocation_strategy(AllocationStrategy::PowerOfTwo),
        Memory::Fixed { blocks, samples } => builder
            .initial_max_slice_len(blocks)
            .allocation_strategy(AllocationStrategy::Static)
            .override_sample_preallocation(move |_| samples),
    };
    builder.create().map_err(|error| match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => crowded(service.name(), error),
        other => failed(service.name(), other),
    })
}

pub fn subscriber(service: &BlockService) -> Result<BlockSubscriber, ServiceError> {
    service.subscriber_builder().create().map_err(|error| match error {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => crowded(service.name(), error),
        other => failed(service.name(), other),
    })
}

/// A subscriber of a scene's field.
pub fn field_subscriber(service: &BlockService) -> Result<BlockSubscriber, ServiceError> {
    subscriber(service).map_err(|error| match error {
        ServiceError::Crowded { name, cause } => ServiceError::CrowdedField { name, cause },
        other => other,
    })
}

pub fn listener(service: &EventService) -> Result<EventListener, ServiceError> {
    service.listener_builder().create().map_err(|error| match error {
        ListenerCreateError::ExceedsMaxSupportedListeners => crowded(service.name(), error),
        other => failed(service.name(), other),
    })
}

pub fn notifier(service: &EventService) -> Result<EventNotifier, ServiceError> {
    service.notifier_builder().create().map_err(|error| match error {
        NotifierCreateError::ExceedsMaxSupportedNotifiers => crowded(service.name(), error),
        other => failed(service.name(), other),
    })
}

/// How long a receiver may trust that a notification comes: over a network one may overtake its message, so look again by then.
pub const LOOK_AGAIN: Duration = Duration::from_millis(20);

fn provide_blocks(node: &IpcNode, name: &str, capacity: &Capacity) -> Result<BlockService, ServiceError> {
    let builder = node
        .service_builder(&service_name(name)?)
        .publish_subscribe::<[WireBlock]>()
        .user_header::<Header>()
        .max_nodes(MAX_CLIENTS)
        .max_publishers(capacity.publishers)
        .max_subscribers(capacity.subscribers)
        .subscriber_max_buffer_size(capacity.buffer)
        .subscriber_max_borrowed_samples(capacity.borrowed)
        .history_size(capacity.history)
        .enable_safe_overflow(capacity.overflow);
    builder.open_or_create().map_err(|error| match error {
        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(error) => open_failed(name, error),
        other => failed(name, other),
    })
}

fn open_blocks(node: &IpcNode, name: &str) -> Result<BlockService, ServiceError> {
    let builder = node.service_builder(&service_name(name)?).publish_subscribe::<[WireBlock]>().user_header::<Header>();
    builder.open().map_err(|error| open_failed(name, error))
}

fn bell_builder(node: &IpcNode, bell: Bell) -> Result<iceoryx2::service::builder::event::Builder<Ipc>, ServiceError> {
    let builder = node.service_builder(&service_name(bell.name())?).event();
    Ok(builder
        .max_nodes(MAX_CLIENTS)
        .max_notifiers(MAX_CLIENTS)
        .max_listeners(MAX_CLIENTS)
        .event_id_max_value(EVENT_MAX)
        .disable_notifier_created_event()
        .disable_notifier_dropped_event()
        .disable_notifier_dead_event())
}

fn service_name(name: &str) -> Result<ServiceName, ServiceError> {
    ServiceName::new(name).map_err(|error| failed(name, format!("{error:?}")))
}

fn open_failed(name: &str, error: PublishSubscribeOpenError) -> ServiceError {
    match error {
        PublishSubscribeOpenError::DoesNotExist => ServiceError::Missing(name.into()),
        PublishSubscribeOpenError::ExceedsMaxNumberOfNodes => crowded(name, error),
        PublishSubscribeOpenError::IncompatibleTypes | PublishSubscribeOpenError::VersionMismatch => {
            ServiceError::Incompatible { name: name.into(), cause: error.to_string() }
        }
        other => failed(name, other),
    }
}

fn event_failed(name: &str, error: EventOpenOrCreateError) -> ServiceError {
    match error {
        EventOpenOrCreateError::EventOpenError(EventOpenError::DoesNotExist) => ServiceError::Missing(name.into()),
        EventOpenOrCreateError::EventOpenError(EventOpenError::ExceedsMaxNumberOfNodes) => crowded(name, error),
        other => failed(name, other),
    }
}

fn crowded(name: impl ToString, cause: impl ToString) -> ServiceError {
    ServiceError::Crowded { name: name.to_string(), cause: cause.to_string() }
}

fn failed(name: impl ToString, cause: impl ToString) -> ServiceError {
    ServiceError::Failed { name: name.to_string(), cause: cause.to_string() }
}
