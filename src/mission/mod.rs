//! One writer per output format: a plan in, bytes out.

pub mod plan_table;
