//! From the route of a planning method to a flight: timing, images, figures and the final safety check.

pub mod corner;
pub mod curve;
pub mod egress;
pub mod evaluate;
pub mod images;
pub mod known;
pub mod limits;
pub mod places;
pub mod plan;
pub mod profile;
pub mod record;
pub mod route;
pub mod safety;
pub mod samples;
pub mod select;
pub mod straight;
