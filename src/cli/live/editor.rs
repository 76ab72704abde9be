//! The edits of all pages, made one after another by a client of their own.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use hyper::StatusCode;
use overfly_client::{Client, ClientError, Domain, EditOrder, Edited, RefusalCode, ShapeOrder, StructureKind};
use overfly_table::FieldTable;
use serde_json::{Value, json};
use tokio::sync::oneshot;

use super::board::{Board, Removed};
use super::orders::Order;
use super::rules::Refusal;

/// Edits that wait at the same time.
const MOST_WAITING: usize = 16;
/// Structures that can be put back.
const MOST_REMOVED: usize = 1000;
const CONNECT: Duration = Duration::from_millis(500);

/// What became of an edit.
pub type Outcome = Result<Value, Refusal>;

struct Job {
    order: Order,
    answer: oneshot::Sender<Outcome>,
}

/// Hands edits to the thread that makes them.
#[derive(Clone)]
pub struct Editor(SyncSender<Job>);

impl Editor {
    /// Starts the thread, which ends with the last editor.
    pub fn start(domain: Domain, scene: String, board: Arc<Board>) -> std::io::Result<Self> {
        let (sender, jobs) = sync_channel(MOST_WAITING);
        let desk = Desk { domain, scene, board, client: None, removed: HashMap::new() };
        std::thread::Builder::new().name("edits".into()).spawn(move || desk.work(&jobs))?;
        Ok(Self(sender))
    }

    /// Has an edit made, and gives the daemon's word on it.
    pub async fn make(&self, order: Order) -> Outcome {
        let (answer, outcome) = oneshot::channel();
        self.0.try_send(Job { order, answer }).map_err(|error| match error {
            TrySendError::Full(_) => {
                Refusal::new(StatusCode::SERVICE_UNAVAILABLE, "too many edits wait already; try again in a moment")
            }
            TrySendError::Disconnected(_) => ended(),
        })?;
        outcome.await.unwrap_or_else(|_| Err(ended()))
    }
}

fn ended() -> Refusal {
    Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, "edits cannot be made any more; start `overfly watch` again")
}

struct Desk {
    domain: Domain,
    scene: String,
    board: Arc<Board>,
    client: Option<Client>,
    /// What stood there, by its id.
    removed: HashMap<String, (Removed, ShapeOrder)>,
}

impl Desk {
    fn work(mut self, jobs: &Receiver<Job>) {
        for Job { order, answer } in jobs {
            // Whoever has gone away does not hear it.
            let _ = answer.send(self.make(&order));
        }
    }

    fn make(&mut self, order: &Order) -> Outcome {
        let made = match self.make_once(order) {
            // What the daemon before has not answered has gone with it: the one that is there now may be asked.
            Err(ClientError::Restarted { .. } | ClientError::Lost { .. }) => self.make_once(order),
            made => made,
        };
        made.map_err(|error| refusal(&error))
    }

    fn make_once(&mut self, order: &Order) -> Result<Value, ClientError> {
        let client = self.client.take().map_or_else(|| Client::connect(&self.domain, CONNECT), Ok)?;
        let made = self.make_with(&client, order);
        // After anything but the daemon's own no the connection is not to be trusted.
        self.client = matches!(made, Ok(_) | Err(ClientError::Refused { .. })).then_some(client);
        made
    }

    fn make_with(&mut self, client: &Client, order: &Order) -> Result<Value, ClientError> {
        self.forget();
        let edit = match order.clone() {
            Order::Raise { structure, by_m } => EditOrder::Raise { structure, by_m },
            Order::Lower { structure, by_m } => EditOrder::Lower { structure, by_m },
            Order::Remove { structure } => return self.remove(client, structure),
            Order::Restore { structure } => return self.restore(client, &structure),
        };
        Ok(answer(&client.edit(&self.scene, &edit)?, false))
    }

    /// The board lists no longer what stood in a scene that is gone.
    fn forget(&mut self) {
        let listed = self.board.removed();
        self.removed.retain(|id, _| listed.iter().any(|removed| removed.id == *id));
    }

    fn remove(&mut self, client: &Client, structure: String) -> Result<Value, ClientError> {
        // Whoever cannot be told how to put it back may remove it all the same.
        let before = standing(client, &self.scene, &structure).ok().flatten();
        let edited = client.edit(&self.scene, &EditOrder::Remove { structure })?;
        let is_kept = before.is_some() && self.removed.len() < MOST_REMOVED;
        if let Some((structure, shape)) = before.filter(|_| is_kept) {
            self.removed.insert(structure.id.clone(), (structure, shape));
            self.tell_removed();
        }
        Ok(answer(&edited, is_kept))
    }

    fn restore(&mut self, client: &Client, structure: &str) -> Result<Value, ClientError> {
        let Some((Removed { name, .. }, shape)) = self.removed.get(structure).cloned() else {
            let message =
                format!("{structure:?} was not removed from here, or cannot be put back; `overfly edit {} add` can", self.scene);
            return Err(ClientError::Refused { code: RefusalCode::UnknownStructure, message });
        };
        let edited = client.edit(&self.scene, &EditOrder::Add { name, shape })?;
        self.removed.remove(structure);
        self.tell_removed();
        Ok(answer(&edited, false))
    }

    fn tell_removed(&self) {
        let mut removed: Vec<Removed> = self.removed.values().map(|(structure, _)| structure.clone()).collect();
        removed.sort_by(|a, b| (&a.name, &a.id).cmp(&(&b.name, &b.id)));
        self.board.tell(|status| status.removed = removed);
    }
}

fn answer(edited: &Edited, can_be_restored: bool) -> Value {
    json!({
        "scene": edited.scene,
        "revision": edited.revision,
        "replan_follows": edited.replan_follows,
        "can_be_restored": can_be_restored,
    })
}

/// A structure as it could be added again. `None` where its outline and heights are not all of it.
fn standing(client: &Client, scene: &str, structure: &str) -> Result<Option<(Removed, ShapeOrder)>, ClientError> {
    let structures = client.structures(scene)?;
    let is_id = |id: u64| u64::from_str_radix(structure, 16) == Ok(id);
    let named = structures.iter().find(|info| info.name == structure);
    let Some(info) = named.or_else(|| structures.iter().find(|info| is_id(info.id))) else { return Ok(None) };
    if info.kind != StructureKind::Prism {
        return Ok(None);
    }
    let map = client.field(scene)?;
    let removed = Removed { id: format!("{:016x}", info.id), name: info.name.clone(), instance: map.instance() };
    Ok(prism(&map.table(), info.id).map(|shape| (removed, shape)))
}

/// A prism over one ring.
fn prism(field: &FieldTable, id: u64) -> Option<ShapeOrder> {
    let row = field.structures.iter().find(|row| row.id == id)?;
    let mut rings = field.outline(row);
    let (ring, None) = (rings.next()?, rings.next()) else { return None };
    Some(ShapeOrder::Prism { outline_m: ring.to_vec(), base_m: row.base_m, top_m: row.top_m })
}

/// What the daemon, or the way to it, says no with.
fn refusal(error: &ClientError) -> Refusal {
    let status = match error {
        ClientError::Refused { code: RefusalCode::Invalid | RefusalCode::Malformed, .. } => StatusCode::BAD_REQUEST,
        ClientError::Refused { code: RefusalCode::UnknownScene | RefusalCode::UnknownStructure, .. } => StatusCode::NOT_FOUND,
        ClientError::Refused { .. } => StatusCode::CONFLICT,
        _ => StatusCode::SERVICE_UNAVAILABLE,
    };
    Refusal::new(status, error.to_string())
}
