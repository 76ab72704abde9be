//! One writer per output format: a plan in, bytes out.

pub mod plan_json;
pub mod plan_read;
pub mod plan_table;
pub mod quality_json;
pub mod run_json;
pub mod svg;

pub mod page;

pub mod course;
pub mod mav_items;

pub mod dji;
pub mod litchi;
pub mod qgc;
pub mod waypoints;

pub mod geojson;
pub mod kml;
pub mod pictures;
pub mod tables;
mod xml;

pub mod colmap;
pub mod coverage_model;
pub mod footprints;

#[cfg(test)]
pub(crate) mod fixture;
#[cfg(test)]
mod tests;
