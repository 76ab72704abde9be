//! Edits that were accepted and wait for their field. An edit is made when the field of the edited scene stands, and only then is
//! it answered; one whose field cannot be built has changed nothing.
//!
//! Edits that come while a field is being built are collected, and the next field is built of all of them. When that fails, they
//! are tried one by one, so that nobody's edit fails because of somebody else's.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::time::Instant;

use overfly_wire::{EditOrder, Refusal, RefusalCode, Reply, SceneChanges, Updated};

use super::convert;
use super::jobs::Assignment;
use super::ledger::Ticket;
use crate::scene::Scene;
use crate::session::Session;

/// Most edits of a scene that may wait, and the most that they may take together, bytes: whoever sends still more is told to wait.
const MOST_WAITING: usize = 10_000;
const MOST_WAITING_BYTES: usize = 64 << 20;

/// The edits of one scene that are not made yet.
#[derive(Default)]
pub struct Edits {
    pub building: Option<Batch>,
    /// In the order in which they came.
    waiting: VecDeque<PendingEdit>,
    /// The scene after all of them.
    latest: Option<Session>,
    /// So many of the first ones that wait are built one by one.
    alone: usize,
}

/// Edits whose field is being built together.
pub struct Batch {
    pub assignment: Assignment,
    pub edits: Vec<PendingEdit>,
    /// The scene after the last of them.
    pub session: Session,
}

/// An edit on its way.
pub struct PendingEdit {
    pub ticket: Ticket,
    pub change: Change,
    /// The revision that it makes.
    pub revision: u64,
    /// What a new version of the file has changed.
    pub changes: Option<SceneChanges>,
    pub taken_up: Instant,
    /// About how much memory it takes, bytes.
    pub bytes: usize,
}

/// What one request changes, as one revision.
pub enum Change {
    Edits(Vec<EditOrder>),
    /// The scene becomes what a new version of its file says.
    Update(NewVersion),
}

/// A new version of a scene's file, read in the frame of the scene.
pub struct NewVersion {
    pub scene: Scene,
    pub report_lines: Vec<String>,
}

impl Edits {
    pub fn are_under_way(&self) -> bool {
        self.building.is_some() || !self.waiting.is_empty()
    }

    /// The scene as it is going to be, when an edit is on its way.
    pub fn latest(&self) -> Option<&Session> {
        self.latest.as_ref().or_else(|| self.building.as_ref().map(|batch| &batch.session))
    }

    /// Whether so many more bytes of edits may wait; one may whatever its size.
    pub fn has_room(&self, bytes: usize) -> bool {
        let taken: usize = self.waiting.iter().map(|edit| edit.bytes).sum();
        self.waiting.is_empty() || (self.waiting.len() < MOST_WAITING && taken + bytes <= MOST_WAITING_BYTES)
    }

    /// Puts an edit behind the others; `session` is the scene after it.
    pub fn push(&mut self, edit: PendingEdit, session: Session) {
        self.waiting.push_back(edit);
        self.latest = Some(session);
    }

    /// The edits of the next field and the scene after them, which is `current` before; `None` when none waits.
    pub fn next_batch(&mut self, current: &Session) -> Option<(Vec<PendingEdit>, Session)> {
        if self.alone == 0 {
            let session = self.latest.take()?;
            return Some((self.waiting.drain(..).collect(), session));
        }
        self.alone -= 1;
        let first = self.waiting.pop_front()?;
        let made = apply(current, &first.change).map_err(|refusal| refusal.message);
        let session = made.expect("it was made on this very scene when the edits were put in order").0;
        if self.waiting.is_empty() {
            self.latest = None;
        }
        Some((vec![first], session))
    }

    /// Takes edits back whose common field cannot be built. A single one, and those that failed for want of memory, are refused; others
    /// will be tried one by one. Returns who is refused for what.
    pub fn take_back(&mut self, failed: Vec<PendingEdit>, current: &Session, refusal: &Refusal) -> Vec<(Ticket, Refusal)> {
        let mut refused = Vec::new();
        if failed.len() > 1 && refusal.code == RefusalCode::Field {
            self.alone += failed.len();
            failed.into_iter().rev().for_each(|edit| self.waiting.push_front(edit));
        } else {
            let revision = current.revision();
            let message = format!("the edit was not made and the scene stays at revision {revision}: {refusal}");
            refused.extend(failed.iter().map(|edit| (edit.ticket, Refusal::new(refusal.code, message.clone()))));
        }
        self.rebase(current, &mut refused);
        refused
    }

    /// Makes the edits that wait once more, on `current`: they were made on a scene that will not come.
    fn rebase(&mut self, current: &Session, refused: &mut Vec<(Ticket, Refusal)>) {
        let mut latest = current.clone();
        let (waiting, mut alone) = (std::mem::take(&mut self.waiting), self.alone);
        for (index, mut edit) in waiting.into_iter().enumerate() {
            match apply(&latest, &edit.change) {
                Ok((session, changes)) => {
                    (edit.revision, edit.changes) = (session.revision(), changes);
                    latest = session;
                    self.waiting.push_back(edit);
                }
                Err(refusal) => {
                    alone -= usize::from(index < self.alone);
                    refused.push((edit.ticket, refusal));
                }
            }
        }
        self.alone = alone;
        self.latest = (!self.waiting.is_empty()).then_some(latest);
    }

    /// Gives all edits up, and returns who asked for them.
    pub fn give_up(&mut self) -> Vec<Ticket> {
        let batch = self.building.take();
        batch.iter().for_each(|batch| batch.assignment.stop.abandon());
        (self.alone, self.latest) = (0, None);
        let built = batch.into_iter().flat_map(|batch| batch.edits);
        built.chain(self.waiting.drain(..)).map(|edit| edit.ticket).collect()
    }

    /// Gives up those that nothing has been done for yet.
    pub fn give_up_waiting(&mut self) -> Vec<Ticket> {
        (self.alone, self.latest) = (0, None);
        self.waiting.drain(..).map(|edit| edit.ticket).collect()
    }
}

impl Change {
    /// For the log: the names of large shapes are there, their corners are not.
    pub fn in_words(&self) -> String {
        match self {
            Self::Edits(orders) => {
                let of_order = |order: &EditOrder| format!("{order:?}").chars().take(120).collect::<String>();
                orders.iter().take(3).map(of_order).collect::<Vec<_>>().join(", ")
            }
            Self::Update(version) => format!("a new version of the file with {} structures", version.scene.structures.len()),
        }
    }
}

impl PendingEdit {
    /// The answer to an edit that is made now.
    pub fn reply(&self, replan_follows: bool) -> Reply {
        let revision = self.revision;
        match (&self.change, &self.changes) {
            (Change::Update(version), Some(changes)) => {
                let (changes, report_lines) = (changes.clone(), version.report_lines.clone());
                Reply::Updated(Updated { revision, replan_follows, changes, report_lines })
            }
            _ => Reply::Edited { revision, replan_follows },
        }
    }
}

/// The scene of `session` after a change, with the next revision number, and what a new version of the file has changed. Of several edits all are
/// made or none.
pub fn apply(session: &Session, change: &Change) -> Result<(Session, Option<SceneChanges>), Refusal> {
    let next = |scene: Scene| session.with_scene(scene, session.revision() + 1);
    match change {
        Change::Edits(orders) => {
            // A city's scene is not copied more often than it is edited.
            let mut scene = Cow::Borrowed(session.scene().as_ref());
            for (index, order) in orders.iter().enumerate() {
                let made = convert::edit(&scene, order).and_then(|edit| {
                    let edited = scene.edited(&edit, &session.settings().proxy);
                    edited.map_err(|error| convert::edit_refusal(&error))
                });
                scene = Cow::Owned(made.map_err(|refusal| refusal.of_edit(index, orders.len()))?.0);
            }
            Ok((next(scene.into_owned()), None))
        }
        Change::Update(version) => {
            let updated = session.scene().updated(&version.scene);
            let (scene, changes) = updated.map_err(|error| Refusal::new(RefusalCode::Edit, error.to_string()))?;
            Ok((next(scene), Some(convert::changes(changes))))
        }
    }
}
