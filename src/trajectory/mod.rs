//! From the search's path to a flight: images, figures and the final safety check.

pub mod plan;
