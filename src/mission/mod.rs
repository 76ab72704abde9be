//! One writer per output format: a plan in, bytes out.

pub mod course;
#[cfg(test)]
pub(crate) mod fixture;
pub mod mav_items;
pub mod plan_json;
pub mod plan_read;
pub mod plan_table;
pub mod quality_json;
pub mod run_json;
pub mod svg;
