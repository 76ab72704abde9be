//! From the search's path to a flight: images, figures and the final safety check.

pub mod evaluate;
pub mod images;
pub mod plan;
pub mod safety;
