//! Scene reconstructability: how much of the hemisphere over a surface sample a set of views covers (paper, section 4.1, Eq. 1 to 3).

mod disk;
mod fine;
mod hemisphere;
mod matching;
pub mod union;

pub use disk::{DiskModel, SampleFrame};
pub use fine::{FINE_CELLS, FineDisks, FineMask};
pub use hemisphere::{CELLS, Mask, cell_direction};
pub use matching::{Bearing, MatchedViews, Matching};
pub use union::Observations;

/// Information in whole units: covered cells times square millimetres of surface. Integers add up to the same sum in any order,
/// so that an information gain can be added, removed and compared without drift.
pub type Information = u64;

/// The discretised integral of Eq. 1: r in percent of the weighted hemisphere.
pub fn reconstructability_percent(covered: Mask) -> f64 {
    100.0 * f64::from(covered.count_ones()) / CELLS as f64
}

/// "r greater than h" in whole cells: a sample is captured when MORE than this many cells are covered.
pub fn threshold_cells(threshold_percent: f64) -> u32 {
    (threshold_percent * CELLS as f64 / 100.0).floor() as u32
}
