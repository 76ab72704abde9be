//! Edits that were accepted and wait for their field. An edit is made when the field of the edited scene stands, and only then is
//! it answered; one whose field cannot be built has changed nothing.
//!
//! Edits that come while a field is being built are collected, and the next field is built of all of them. When that fails, they
//! are tried one by one, so that nobody's edit fails because of somebody else's.

use std::collections::VecDeque;
use std::time::Instant;

use overfly_wire::{EditOrder, Refusal, RefusalCode};

use super::convert;
use super::jobs::Assignment;
use super::ledger::Ticket;
use crate::session::Session;

/// The edits of one scene that are not made yet.
#[derive(Default)]
pub struct Edits {
    pub building: Option<Batch>,
    /// In the order in which they came.
    waiting: VecDeque<PendingEdit>,
    /// So many of the first ones that wait are built one by one.
    alone: usize,
}

/// Edits whose field is being built together.
pub struct Batch {
    pub assignment: Assignment,
    pub edits: Vec<PendingEdit>,
}

/// An edit on its way.
pub struct PendingEdit {
    pub ticket: Ticket,
    pub order: EditOrder,
    /// The scene after this edit and all before it.
    pub session: Session,
    pub taken_up: Instant,
}

impl Edits {
    pub fn are_under_way(&self) -> bool {
        self.building.is_some() || !self.waiting.is_empty()
    }

    /// The scene as it is going to be, when an edit is on its way.
    pub fn latest(&self) -> Option<&Session> {
        let built = || self.building.as_ref().and_then(|batch| batch.edits.last());
        self.waiting.back().or_else(built).map(|edit| &edit.session)
    }

    pub fn push(&mut self, edit: PendingEdit) {
        self.waiting.push_back(edit);
    }

    /// The edits of the next field.
    pub fn next_batch(&mut self) -> Vec<PendingEdit> {
        let count = if self.alone > 0 { 1 } else { self.waiting.len() };
        self.alone = self.alone.saturating_sub(1);
        self.waiting.drain(..count.min(self.waiting.len())).collect()
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
            match apply(&latest, &edit.order) {
                Ok(session) => {
                    latest = session.clone();
                    edit.session = session;
                    self.waiting.push_back(edit);
                }
                Err(refusal) => {
                    alone -= usize::from(index < self.alone);
                    refused.push((edit.ticket, refusal));
                }
            }
        }
        self.alone = alone;
    }

    /// Gives all edits up, and returns who asked for them.
    pub fn give_up(&mut self) -> Vec<Ticket> {
        let batch = self.building.take();
        batch.iter().for_each(|batch| batch.assignment.stop.abandon());
        self.alone = 0;
        let built = batch.into_iter().flat_map(|batch| batch.edits);
        built.chain(self.waiting.drain(..)).map(|edit| edit.ticket).collect()
    }

    /// Gives up those that nothing has been done for yet.
    pub fn give_up_waiting(&mut self) -> Vec<Ticket> {
        self.alone = 0;
        self.waiting.drain(..).map(|edit| edit.ticket).collect()
    }
}

/// The scene of `session` after an edit, with the next revision number.
pub fn apply(session: &Session, order: &EditOrder) -> Result<Session, Refusal> {
    let mut edited = session.clone();
    let change = convert::edit(edited.scene(), order)?;
    edited.apply(&change).map_err(|error| convert::edit_refusal(&error))?;
    Ok(edited)
}
