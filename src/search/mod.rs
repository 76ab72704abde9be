//! The tree search for one continuous path (paper, section 5).

pub mod captured;
pub mod cover;
pub mod leg;
pub mod objective;
pub mod outcome;
pub mod problem;
pub mod reach;
mod rrt_star;
pub mod spacing;
#[cfg(test)]
mod tests;
mod tree;
mod view_choice;

pub use outcome::{Iteration, Outcome, Progress, StopReason};
pub use problem::{Problem, SearchError, Wanted};
pub use rrt_star::search;
