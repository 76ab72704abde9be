//! What all pages are to show: the newest state and nothing before it. A page that is slow, or comes late, misses states but never the last.

use hyper::body::Bytes;
use serde::Serialize;
use serde_json::json;
use tokio::sync::watch;

/// What goes on with the daemon and the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Nothing is known yet.
    Connecting,
    /// The daemon is gone; it is looked for again and again.
    Lost,
    /// The daemon is there, but the scene is not loaded.
    Unloaded,
    Idle,
    Building,
    Planning,
}

/// A structure that was removed from here and can be put back.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Removed {
    pub id: String,
    pub name: String,
    /// The daemon that has it removed, and no other one.
    #[serde(skip)]
    pub instance: u64,
}

/// The status line of a page.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Status {
    pub phase: Phase,
    /// What is to be known beyond that, and what to do about it.
    pub remark: Option<String>,
    pub revision: Option<u64>,
    pub removed: Vec<Removed>,
}

impl Status {
    /// Takes the daemon's word on the scene. What stood in one that was loaded anew, or with another daemon, is nothing to be put back.
    pub fn hear(&mut self, instance: u64, revision: u64) {
        if self.revision.is_some_and(|before| revision < before) {
            self.removed.clear();
        }
        self.removed.retain(|removed| removed.instance == instance);
        self.revision = Some(revision);
    }
}

/// A message, as it is written to every stream, and its number.
#[derive(Clone, Debug, Default)]
pub struct Numbered {
    pub number: u64,
    pub event: Bytes,
}

/// The newest message of each kind.
#[derive(Clone, Debug, Default)]
pub struct View {
    pub status: Numbered,
    /// Empty as long as there is nothing to show.
    pub shown: Numbered,
}

/// Where the newest state is put up.
#[derive(Debug)]
pub struct Board {
    views: watch::Sender<View>,
    status: std::sync::Mutex<Status>,
}

impl Board {
    pub fn new() -> Self {
        let status = Status { phase: Phase::Connecting, remark: None, revision: None, removed: Vec::new() };
        let first = Numbered { number: 1, event: status_event(&status) };
        Self {
            views: watch::Sender::new(View { status: first, shown: Numbered::default() }),
            status: std::sync::Mutex::new(status),
        }
    }

    /// A view on the board that is told whenever it changes.
    pub fn look(&self) -> watch::Receiver<View> {
        self.views.subscribe()
    }

    /// Changes the status; pages are told when it is another one than before.
    pub fn tell(&self, change: impl FnOnce(&mut Status)) {
        let mut status = self.status.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let before = status.clone();
        change(&mut status);
        if *status != before {
            let event = status_event(&status);
            self.views.send_modify(|view| view.status = Numbered { number: view.status.number + 1, event });
        }
    }

    /// What can be put back.
    pub fn removed(&self) -> Vec<Removed> {
        self.status.lock().unwrap_or_else(std::sync::PoisonError::into_inner).removed.clone()
    }

    /// Puts up what pages are to show: JSON without line breaks.
    pub fn show(&self, state: &[u8]) {
        let event = event("show", state);
        self.views.send_modify(|view| view.shown = Numbered { number: view.shown.number + 1, event });
    }
}

impl View {
    /// What a page has not been sent that has been sent the messages of these numbers: a plan before the word that the search is over.
    pub fn newer_than(&self, status: u64, shown: u64) -> impl Iterator<Item = Bytes> + use<> {
        let newer = |numbered: &Numbered, seen: u64| (numbered.number > seen).then(|| numbered.event.clone());
        [newer(&self.shown, shown), newer(&self.status, status)].into_iter().flatten()
    }
}

fn status_event(status: &Status) -> Bytes {
    event("status", json!(status).to_string().as_bytes())
}

/// A message of a stream of events. A line break would end its data.
pub fn event(name: &str, data: &[u8]) -> Bytes {
    let line: Vec<u8> = data.iter().copied().filter(|byte| !matches!(byte, b'\n' | b'\r')).collect();
    [b"event: ", name.as_bytes(), b"\ndata: ", &line, b"\n\n"].concat().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(view: &View, status: u64, shown: u64) -> Vec<String> {
        view.newer_than(status, shown).map(|event| String::from_utf8(event.to_vec()).unwrap()).collect()
    }

    #[test]
    fn what_was_removed_can_be_put_back_as_long_as_the_scene_is_the_one_it_stood_in() {
        let removed = |instance| Removed { id: format!("{instance:016x}"), name: "mill".into(), instance };
        let mut status = Status { phase: Phase::Connecting, remark: None, revision: None, removed: vec![removed(1)] };
        let mut left = |instance, revision| {
            status.hear(instance, revision);
            status.removed.len()
        };
        // The daemon's first word may come after the edit's answer, and be of before the edit.
        assert_eq!((left(1, 1), left(1, 2), left(1, 2)), (1, 1, 1));
        assert_eq!(left(1, 1), 0, "loaded anew");
        status.removed = vec![removed(1), removed(2)];
        status.hear(2, 7);
        assert_eq!(status.removed, [removed(2)], "the other daemon is gone");
    }

    #[test]
    fn a_late_page_gets_the_newest_state_alone() {
        let board = Board::new();
        board.show(b"{\"revision\":1}");
        board.tell(|status| status.phase = Phase::Planning);
        board.show(b"{\"revision\":\n2}");
        let view = board.look().borrow().clone();
        let late = texts(&view, 0, 0);
        assert_eq!(late.len(), 2, "{late:?}");
        assert_eq!(late[0], "event: show\ndata: {\"revision\":2}\n\n");
        assert!(late[1].starts_with("event: status\ndata: {") && late[1].contains("\"planning\""), "{late:?}");
        assert!(texts(&view, view.status.number, view.shown.number).is_empty());
        assert_eq!(texts(&view, view.status.number, view.shown.number - 1).len(), 1);
    }

    #[test]
    fn a_status_that_is_as_before_is_not_told_again() {
        let board = Board::new();
        let mut page = board.look();
        board.tell(|status| status.phase = Phase::Lost);
        assert!(page.has_changed().unwrap());
        page.mark_unchanged();
        board.tell(|status| status.phase = Phase::Lost);
        assert!(!page.has_changed().unwrap());
    }
}
