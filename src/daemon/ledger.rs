//! What became of recent requests, so that one that is sent twice does not run twice.

use std::collections::{HashMap, VecDeque};

use overfly_wire::Reply;

/// Requests that are remembered after they were answered: seconds of a flood, so that a client that missed its answer and reminds does not run its
/// request again.
const REMEMBERED: usize = 16_384;
/// Bytes of replies that are remembered; the newest is remembered whatever its length.
const REMEMBERED_BYTES: usize = 16 << 20;

/// A request of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Ticket {
    pub client: u64,
    pub correlation: u64,
}

/// How a request was answered so far.
#[derive(Debug, Default)]
struct Entry {
    reply: Option<Reply>,
    /// A second result that follows the reply: the replan after an edit.
    follows: bool,
    outcome: Option<Reply>,
}

/// The requests that are being worked on and those that were answered lately.
#[derive(Debug, Default)]
pub struct Ledger {
    entries: HashMap<Ticket, Entry>,
    /// Those that are finished, oldest first, with the length of their replies.
    finished: VecDeque<(Ticket, usize)>,
    finished_bytes: usize,
}

/// What to do with a request that has just come in.
#[derive(Debug, PartialEq)]
pub enum Seen {
    /// Run it.
    New,
    /// It is being worked on: acknowledge it once more.
    Pending,
    /// Repeat the answer.
    Answered(Reply),
}

/// What is known of an earlier request.
#[derive(Debug, PartialEq)]
pub enum Outcome {
    Unknown,
    Pending,
    Known(Reply),
}

impl Ledger {
    /// Looks `ticket` up, and enters it when it is new.
    pub fn see(&mut self, ticket: Ticket) -> Seen {
        match self.entries.get(&ticket) {
            Some(Entry { reply: Some(reply), .. }) => Seen::Answered(reply.clone()),
            Some(_) => Seen::Pending,
            None => {
                self.entries.insert(ticket, Entry::default());
                Seen::New
            }
        }
    }

    /// The request was answered; with `follows` a second result comes later.
    pub fn answer(&mut self, ticket: Ticket, reply: &Reply, follows: bool) {
        let Some(entry) = self.entries.get_mut(&ticket) else { return };
        if entry.reply.is_some() {
            entry.outcome = Some(reply.clone());
            entry.follows = false;
        } else {
            entry.reply = Some(reply.clone());
            entry.follows = follows;
        }
        if !entry.follows {
            self.finish(ticket);
        }
    }

    /// The last result of `ticket`.
    pub fn outcome(&self, ticket: Ticket) -> Outcome {
        match self.entries.get(&ticket) {
            None => Outcome::Unknown,
            Some(Entry { outcome: Some(reply), .. }) => Outcome::Known(reply.clone()),
            Some(Entry { reply: Some(reply), follows: false, .. }) => Outcome::Known(reply.clone()),
            Some(_) => Outcome::Pending,
        }
    }

    fn finish(&mut self, ticket: Ticket) {
        let Some(entry) = self.entries.get(&ticket) else { return };
        let bytes = entry.reply.iter().chain(&entry.outcome).map(length).sum();
        self.finished.push_back((ticket, bytes));
        self.finished_bytes += bytes;
        while self.finished.len() > REMEMBERED || (self.finished_bytes > REMEMBERED_BYTES && self.finished.len() > 1) {
            let Some((oldest, bytes)) = self.finished.pop_front() else { return };
            self.finished_bytes -= bytes;
            self.entries.remove(&oldest);
        }
    }
}

/// About how much memory a reply takes beyond its fixed size, bytes.
fn length(reply: &Reply) -> usize {
    match reply {
        Reply::Loaded(loaded) => loaded.report_json.len() + loaded.report_lines.iter().map(String::len).sum::<usize>(),
        Reply::Updated(updated) => {
            let names = updated.changes.kinds().into_iter().flat_map(|(_, names)| names);
            names.chain(&updated.report_lines).map(String::len).sum()
        }
        Reply::Refused(refusal) => refusal.message.len(),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use overfly_wire::{Refusal, RefusalCode};

    use super::*;

    const TICKET: Ticket = Ticket { client: 1, correlation: 1 };

    #[test]
    fn a_request_that_is_sent_again_gets_the_same_answer() {
        let mut ledger = Ledger::default();
        assert_eq!(ledger.see(TICKET), Seen::New);
        assert_eq!(ledger.see(TICKET), Seen::Pending);
        ledger.answer(TICKET, &Reply::Done, false);
        assert_eq!(ledger.see(TICKET), Seen::Answered(Reply::Done));
        assert_eq!(ledger.see(Ticket { client: 2, ..TICKET }), Seen::New);
    }

    #[test]
    fn an_edit_has_an_answer_and_an_outcome() {
        let mut ledger = Ledger::default();
        assert_eq!(ledger.outcome(TICKET), Outcome::Unknown);
        ledger.see(TICKET);
        let edited = Reply::Edited { revision: 2, replan_follows: true };
        ledger.answer(TICKET, &edited, true);
        assert_eq!(ledger.outcome(TICKET), Outcome::Pending);
        ledger.answer(TICKET, &Reply::Planned { epoch: 4 }, false);
        assert_eq!(ledger.outcome(TICKET), Outcome::Known(Reply::Planned { epoch: 4 }));
        assert_eq!(ledger.see(TICKET), Seen::Answered(edited));
    }

    #[test]
    fn work_in_progress_is_never_forgotten_and_old_answers_are() {
        let mut ledger = Ledger::default();
        ledger.see(TICKET);
        for correlation in 2..2 * REMEMBERED as u64 {
            let ticket = Ticket { client: 1, correlation };
            ledger.see(ticket);
            ledger.answer(ticket, &Reply::Done, false);
        }
        assert_eq!(ledger.see(TICKET), Seen::Pending);
        assert_eq!(ledger.entries.len(), REMEMBERED + 1);
    }

    #[test]
    fn long_answers_are_forgotten_earlier_than_short_ones() {
        let mut ledger = Ledger::default();
        let long = Reply::Refused(Refusal::new(RefusalCode::Import, "x".repeat(REMEMBERED_BYTES / 3)));
        for correlation in 0..10 {
            let ticket = Ticket { client: 1, correlation };
            ledger.see(ticket);
            ledger.answer(ticket, &long, false);
        }
        assert_eq!(ledger.entries.len(), 3);
        assert_eq!(ledger.see(Ticket { client: 1, correlation: 9 }), Seen::Answered(long));
        assert_eq!(ledger.see(TICKET), Seen::New);
    }
}
