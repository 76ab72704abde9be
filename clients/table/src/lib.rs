//! Flat, relocatable tables: the same bytes serve in process, in shared memory and on disk.
//!
//! A table is a slice of 64-byte [`Block`]s. It starts with a fixed header of its kind, which holds a magic number, the schema
//! version, the total size and the place of every section; a section is a slice of one plain row type that starts on a 64-byte
//! boundary. There are no pointers, so a table may be copied or mapped anywhere. Readers open a table with [`FieldTable::open`] or
//! [`PlanTable::open`], which check every bound once, so that a damaged or foreign table is an error and never a fault.
//!
//! A field is more than one table: its visibility rows lie in segments of their own ([`rows`]), which fields before and after an edit share.
//!
//! Units: metres, radians, seconds, in the scene's local frame (x east, y north, z up, ground plane z = 0) unless a name says otherwise.

pub mod field;
mod layout;
pub mod plan;
pub mod rows;

pub use field::{FieldTable, FieldTableMut};
pub use layout::{Block, LayoutError, Section, blocks_for, first_table};
pub use plan::{PlanTable, PlanTableMut};
pub use rows::{Row, SampleSet, Segment, SegmentRows, TableMemory};
