//! What the images of a flight are worth: the samples that they capture (r > h), and those that they show in enough matched views.

use super::cells::CellCounts;
use super::matches::MatchCounts;
use super::sights::Sights;

/// Both measures, kept up to date view by view.
#[derive(Clone, Debug)]
pub struct Counts {
    pub cells: CellCounts,
    pub matches: MatchCounts,
}

/// Samples by both measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Worth {
    /// Samples whose covered share of the hemisphere exceeds the threshold.
    pub captured: u32,
    /// Samples with enough matched views.
    pub matched: u32,
}

impl Counts {
    pub fn worth(&self) -> Worth {
        Worth { captured: self.cells.totals().captured, matched: self.matches.matched() }
    }

    /// The most that any flight is worth.
    pub fn most(&self) -> Worth {
        Worth { captured: self.cells.countable(), matched: self.matches.countable() }
    }

    /// Whether some sample has too many views to be counted with these as well.
    pub fn is_full<'s>(&self, more: impl Iterator<Item = &'s Sights> + Clone) -> bool {
        self.cells.is_full(more)
    }

    /// Adds what images see.
    pub fn add(&mut self, seen: &Sights) {
        self.cells.add(seen);
        self.matches.add(seen);
    }

    /// Takes away what was added before.
    pub fn remove(&mut self, seen: &Sights) {
        self.cells.remove(seen);
        self.matches.remove(seen);
    }
}

impl Worth {
    /// What counts of it where no more than `required` is wanted.
    pub fn counted(self, required: Worth) -> Worth {
        Worth { captured: self.captured.min(required.captured), matched: self.matched.min(required.matched) }
    }

    pub fn is_enough(self, required: Worth) -> bool {
        self.counted(required) == required
    }

    pub fn sum(self) -> u32 {
        self.captured + self.matched
    }
}
