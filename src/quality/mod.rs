//! Predicted quality of a reconstruction: what the images of a plan see of any scene, by exact rays, and how well their geometry fixes
//! each point of its surface. In the form of the paper's evaluation (section 6, Tables 2 and 3): Error and Completeness.
//!
//! The scene may be another one than the proxy that the plan was made on, so that the loss by a rough proxy can be told.

mod assess;
mod flown;
mod shots;
mod smith;
mod statistics;
mod summary;
mod triangulation;
mod truth;

pub use assess::{SampleQuality, assess};
pub use flown::{Flown, flown};
pub use shots::{Misplaced, Shot, Which, carried, check_reach, shots};
pub use smith::Smith;
pub use statistics::{COMPLETENESS_M, Compared, Quality, compare};
pub use summary::Summary;
pub use triangulation::{Deviation, Sight, deviation};
pub use truth::{Truth, TruthSample};
