//! Plans as they are published.

use std::sync::Arc;
use std::time::{Duration, Instant};

use overfly_table::{Block, PlanTable};
use overfly_wire::frame::FrameError;
use overfly_wire::service::{self, Bell, BlockSample, BlockSubscriber, Channel, EventListener, LOOK_AGAIN};
use overfly_wire::{Domain, Header, Kind, SCHEMA, WireBlock};

use crate::error::ClientError;
use crate::link::{Presence, Watchman};

/// A plan that was received: a copy, so that it may be kept as long as you like.
#[derive(Clone, Debug)]
pub struct PlanMessage {
    header: Header,
    blocks: Vec<Block>,
}

impl PlanMessage {
    /// Copies a published plan and checks every bound of the copy.
    pub(crate) fn copy(sample: &BlockSample) -> Result<Self, ClientError> {
        let header = *sample.user_header();
        if !header.is(Kind::Plan) {
            return Err(FrameError::Schema { found: if header.schema == SCHEMA { header.kind } else { header.schema } }.into());
        }
        let blocks = WireBlock::blocks(sample.payload()).to_vec();
        PlanTable::open(&blocks)?;
        Ok(Self { header, blocks })
    }

    pub fn table(&self) -> PlanTable<'_> {
        PlanTable::open(&self.blocks).expect("checked when it was received")
    }

    /// The scene that the plan belongs to.
    pub fn scene(&self) -> &str {
        let text = std::str::from_utf8(self.table().text).unwrap_or_default();
        text.lines().next().unwrap_or_default()
    }

    /// Counts the tables that the daemon has published.
    pub fn epoch(&self) -> u64 {
        self.header.epoch
    }

    /// The client and the number of the request that asked for this plan.
    pub fn asked_by(&self) -> (u64, u64) {
        (self.header.client, self.header.correlation)
    }

    /// The epoch of the scene's plan before this one and the first waypoint that differs from it, so that an aircraft that is not there yet can go
    /// over from one to the other; `None` for a scene's first plan.
    pub fn differs_from(&self) -> Option<(u64, usize)> {
        (self.header.follows != 0).then_some((self.header.follows, self.header.first_changed as usize))
    }

    /// Why there is no flight in the scene as it is now, if there is none: then no plan of it from before is to be flown.
    pub fn infeasible(&self) -> Option<&str> {
        self.table().infeasible()
    }

    /// The daemon that made it: another one after a restart.
    pub fn instance(&self) -> u64 {
        self.header.instance
    }
}

/// Every new plan of one scene, whoever asked for it.
pub struct PlanWatch {
    plans: BlockSubscriber,
    news: EventListener,
    scene: String,
    watchman: Watchman,
    _presence: Arc<Presence>,
}

impl PlanWatch {
    pub(crate) fn open(domain: &Domain, scene: &str) -> Result<Self, ClientError> {
        let presence = Presence::enter(domain)?;
        let node = presence.node();
        let plans = service::subscriber(&service::open(node, Channel::Plans)?)?;
        let news = service::listener(&service::open_bell(node, Bell::Clients)?)?;
        Ok(Self { plans, news, scene: scene.into(), watchman: Watchman::new(domain), _presence: presence })
    }

    /// The next plan; `None` when none comes within `timeout`. Plans that cannot be read are errors and are skipped by the next call.
    pub fn next(&self, timeout: Duration) -> Result<Option<PlanMessage>, ClientError> {
        let end = Instant::now() + timeout;
        loop {
            let is_gone = self.watchman.finds_daemon_gone();
            while let Some(sample) = self.plans.receive().map_err(|error| ClientError::Receive(format!("{error:?}")))? {
                let plan = PlanMessage::copy(&sample)?;
                if plan.scene() == self.scene {
                    return Ok(Some(plan));
                }
            }
            if is_gone {
                return Err(self.watchman.lost());
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let wait = left.min(10 * LOOK_AGAIN);
            self.news.timed_wait(|_| {}, wait).map_err(|error| ClientError::Receive(format!("{error:?}")))?;
        }
    }
}
