//! Which views of each sample match, so that views can be taken away again.

use std::sync::Arc;

use super::sights::Sights;
use crate::coverage::{Bearing, MatchedViews, Matching};

/// The views of all samples that count with what they add up to.
#[derive(Clone, Debug)]
pub struct MatchCounts {
    matching: Matching,
    /// By sample: whether it counts.
    counts: Arc<[bool]>,
    samples: Vec<MatchedViews>,
    /// Samples with enough matched views.
    matched: u32,
    /// Views of all samples, up to as many as each needs.
    views: u32,
    countable: u32,
}

impl MatchCounts {
    /// `counts` by sample; where none does nothing is kept.
    pub fn new(matching: Matching, counts: Arc<[bool]>) -> Self {
        let countable = counts.iter().filter(|counts| **counts).count() as u32;
        let samples = if countable == 0 { Vec::new() } else { vec![MatchedViews::default(); counts.len()] };
        Self { matching, counts, samples, matched: 0, views: 0, countable }
    }

    /// Samples that count.
    pub fn countable(&self) -> u32 {
        self.countable
    }

    /// Samples with enough matched views.
    pub fn matched(&self) -> u32 {
        self.matched
    }

    /// Whether a sample counts and has too few matched views.
    pub fn is_missing(&self, sample: usize) -> bool {
        self.counts[sample] && self.samples[sample].matched() < self.matching.least_views
    }

    /// The views that are missing, counted in samples that miss all of theirs.
    pub fn missing_samples(&self) -> f64 {
        f64::from(self.countable) - f64::from(self.views) / f64::from(self.matching.least_views.max(1))
    }

    /// Adds what images see.
    pub fn add(&mut self, seen: &Sights) {
        self.change(seen, MatchedViews::add);
    }

    /// Takes away what was added before.
    pub fn remove(&mut self, seen: &Sights) {
        self.change(seen, MatchedViews::remove);
    }

    fn change(&mut self, seen: &Sights, change: fn(&mut MatchedViews, &Matching, Bearing)) {
        if self.countable == 0 {
            return;
        }
        let least = self.matching.least_views;
        for (i, bearing) in seen.bearings().filter(|&(i, _)| self.counts[i]) {
            let views = &mut self.samples[i];
            let before = counted(views, least);
            change(views, &self.matching, bearing);
            let after = counted(views, least);
            self.views = self.views + after - before;
            self.matched = self.matched + u32::from(after >= least) - u32::from(before >= least);
        }
    }
}

/// Views up to as many as are needed. The first one has no partner yet, and counts all the same: the second one needs it.
fn counted(views: &MatchedViews, least: u32) -> u32 {
    views.matched().max(u32::from(!views.is_empty())).min(least)
}
