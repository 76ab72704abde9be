//! The memory that the fields of all scenes may take together.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counts the bytes of all fields that exist: current ones, those being built, and old ones that a search still reads.
#[derive(Debug)]
pub struct Budget {
    limit: AtomicU64,
    used: AtomicU64,
}

/// Bytes that were granted, until this is dropped.
#[derive(Debug)]
pub struct Reservation {
    budget: Arc<Budget>,
    bytes: u64,
}

/// The budget does not allow another field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the field needs {asked_mb:.1} MB more of shared memory, but fields take {used_mb:.1} MB already and the budget is {limit_mb:.1} MB (with what is built of this one; while a field is rebuilt the old one stays); unload a scene with `overfly unload NAME`, lower `field.viewpoints` or `surface.samples`, or raise `daemon.memory_budget_mb`",
    asked_mb = megabytes(*asked), used_mb = megabytes(*used), limit_mb = megabytes(*limit)
)]
pub struct OverBudget {
    pub asked: u64,
    pub used: u64,
    pub limit: u64,
}

impl Budget {
    pub fn new(limit_mb: u64) -> Arc<Self> {
        Arc::new(Self { limit: AtomicU64::new(bytes(limit_mb)), used: AtomicU64::new(0) })
    }

    /// What is granted already stays granted.
    pub fn set_limit_mb(&self, limit_mb: u64) {
        self.limit.store(bytes(limit_mb), Ordering::Relaxed);
    }

    pub fn limit(&self) -> u64 {
        self.limit.load(Ordering::Relaxed)
    }

    pub fn used(&self) -> u64 {
        self.used.load(Ordering::Relaxed)
    }

    pub fn reserve(self: &Arc<Self>, asked: u64) -> Result<Reservation, OverBudget> {
        let limit = self.limit();
        self.used
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |used| used.checked_add(asked).filter(|sum| *sum <= limit))
            .map(|_| Reservation { budget: self.clone(), bytes: asked })
            .map_err(|used| OverBudget { asked, used, limit })
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.budget.used.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

fn bytes(megabytes: u64) -> u64 {
    megabytes.saturating_mul(1_000_000)
}

fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dropped_can_be_had_again() {
        let budget = Budget::new(10);
        let first = budget.reserve(6_000_000).unwrap();
        let refused = budget.reserve(5_000_000).unwrap_err();
        assert_eq!(refused, OverBudget { asked: 5_000_000, used: 6_000_000, limit: 10_000_000 });
        drop(first);
        let _all = budget.reserve(10_000_000).unwrap();
        assert!(budget.reserve(u64::MAX).is_err());
        assert_eq!(budget.used(), 10_000_000);
    }
}
