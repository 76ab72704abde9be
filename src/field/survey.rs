//! A field before and after it is built: what is surveyed first, and the immutable snapshot at the end.

use std::fmt;
use std::sync::Arc;

use overfly_table::field::{FieldCounts, FieldFacts};
use overfly_table::{Block, FieldTable, LayoutError};

use super::build::{FieldInputs, Outlines, build_visibility, fill_table};
use super::lookup::Lookup;
use super::update::{Earlier, Seen, update_visibility};
use super::viewpoints::{Cell, Site, Viewpoint};
use crate::coverage::{DiskModel, Mask};
use crate::scene::Scene;
use crate::scene::differences::Differences;
use crate::scene::free_space::{FreeSpace, ZoneError};
use crate::stop::StopToken;
use crate::surface::Samples;

/// Why no field can be built of a scene.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldError {
    #[error("the computation was stopped")]
    Stopped,
    #[error("the scene {scene:?} has no surface that could be seen from outside; check its heights and its outlines")]
    NoSurface { scene: String },
    #[error(
        "the scene {scene:?} leaves no free space between {safety_m} m and {shell_m} m from its surfaces, at altitudes from {low_m:.0} m to \
         {high_m:.0} m and outside of its no-fly zones; lower `flight.safety_distance_m` or widen the altitude limits"
    )]
    NoFreeSpace { scene: String, safety_m: f64, shell_m: f64, low_m: f64, high_m: f64 },
    #[error(
        "the scene {scene:?} would need {needed:.0} {what}, the most is {most}; raise `{key}`, or load the scene anew with a wider spacing (fewer `surface.samples`, a larger `field.max_spacing_m`)"
    )]
    TooLarge { scene: String, what: &'static str, needed: f64, most: f64, key: &'static str },
    #[error(transparent)]
    Zone(#[from] ZoneError),
    #[error("the table is not the field of this scene: {0}")]
    Layout(#[from] LayoutError),
}

/// Everything about a field but its visibility.
pub struct Survey {
    pub(crate) scene: Arc<Scene>,
    pub(crate) revision: u64,
    pub(crate) facts: FieldFacts,
    pub(crate) counts: FieldCounts,
    pub(crate) free: Arc<FreeSpace>,
    pub(crate) disks: Arc<DiskModel>,
    pub(crate) outlines: Outlines,
    pub(crate) samples: Samples,
    pub(crate) sites: Vec<Site>,
    /// Of the sites those that can be reached.
    pub(crate) cells: Vec<Cell>,
    pub(crate) viewpoints: Vec<Viewpoint>,
    pub(crate) offset_m: f64,
    /// The field that this one follows from, and how their scenes differ.
    pub(crate) earlier: Option<(Snapshot, Differences)>,
    /// What all viewpoints together cover of each sample, once it is built.
    pub(crate) unions: Vec<Mask>,
    /// How its samples compare with those of the field before, once it is built.
    pub(crate) seen: Option<Seen>,
}

impl fmt::Debug for Survey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Survey of revision {} ({:?})", self.revision, self.counts)
    }
}

/// What a field was built of, for the one that follows after an edit.
pub struct Footing {
    pub(crate) outlines: Outlines,
    pub(crate) samples: Samples,
    pub(crate) sites: Vec<Site>,
    cells: Vec<Cell>,
    unions: Vec<Mask>,
}

impl Survey {
    /// Size of the field's table in blocks.
    pub fn blocks(&self) -> usize {
        self.counts.blocks()
    }

    pub fn counts(&self) -> &FieldCounts {
        &self.counts
    }

    /// Builds the field in place (Algorithm 1), in parallel over viewpoints; where there is an earlier one, only what differs from it. `blocks` is
    /// exactly [`Survey::blocks`] long; what it held is overwritten. When stopped the blocks hold nothing of use.
    pub fn build(&mut self, blocks: &mut [Block], stop: &StopToken) -> Result<(), FieldError> {
        let inputs = FieldInputs {
            scene: &self.scene,
            outlines: &self.outlines,
            clearance: &self.free.clearance,
            samples: &self.samples,
            viewpoints: &self.viewpoints,
            disks: &self.disks,
            facts: self.facts,
            offset_m: self.offset_m,
        };
        let mut seen = None;
        let visibility = |rows: &mut [u64], words_per_row: usize| match &self.earlier {
            None => build_visibility(&inputs, rows, words_per_row, stop),
            Some((snapshot, differences)) => {
                let Footing { samples, cells, unions, .. } = &*snapshot.footing;
                let earlier = Earlier { field: snapshot.field(), cells, samples, unions };
                let updated = update_visibility(&inputs, &self.cells, differences, &earlier, rows, words_per_row, stop);
                updated.map(|(unions, samples)| {
                    seen = Some(samples);
                    unions
                })
            }
        };
        self.unions = fill_table(&inputs, &self.counts, blocks, visibility).ok_or(FieldError::Stopped)?;
        self.seen = seen;
        Ok(())
    }

    /// The snapshot over a table that [`Survey::build`] has filled.
    pub fn snapshot(self, field: Arc<dyn FieldStorage>) -> Result<Snapshot, FieldError> {
        let table = FieldTable::open(field.blocks())?;
        let same = self.earlier.as_ref().filter(|(earlier, _)| earlier.footing.cells == self.cells);
        let lookup = match same {
            Some((earlier, _)) => Arc::clone(&earlier.lookup),
            None => {
                let lookup = Lookup::new(table.viewpoints);
                Arc::new(lookup.ok_or_else(|| FieldError::NoSurface { scene: self.scene.name.clone() })?)
            }
        };
        let Self { outlines, samples, sites, cells, unions, .. } = self;
        let changes = self.earlier.zip(self.seen).map(|((earlier, differences), Seen { same, is_touched })| {
            Arc::new(Changes { since: earlier.revision, differences, same, is_touched })
        });
        Ok(Snapshot {
            scene: self.scene,
            revision: self.revision,
            free: self.free,
            disks: self.disks,
            lookup,
            offset_m: self.offset_m,
            footing: Arc::new(Footing { outlines, samples, sites, cells, unions }),
            changes,
            field,
        })
    }

    /// Builds the field in memory of its own.
    pub fn into_snapshot(mut self, stop: &StopToken) -> Result<Snapshot, FieldError> {
        let mut blocks = vec![Block::ZERO; self.blocks()];
        self.build(&mut blocks, stop)?;
        self.snapshot(Arc::new(blocks))
    }
}

/// Memory that holds a finished field: a vector in process, a received sample in the daemon.
pub trait FieldStorage: Send + Sync {
    fn blocks(&self) -> &[Block];
}

impl FieldStorage for Vec<Block> {
    fn blocks(&self) -> &[Block] {
        self
    }
}

/// One revision of a scene with its field, for searches and readers. Cheap to clone; never changes.
#[derive(Clone)]
pub struct Snapshot {
    pub scene: Arc<Scene>,
    pub revision: u64,
    pub free: Arc<FreeSpace>,
    pub disks: Arc<DiskModel>,
    pub lookup: Arc<Lookup>,
    /// How far in front of a sample a line of sight ends, m.
    pub offset_m: f64,
    pub(crate) footing: Arc<Footing>,
    changes: Option<Arc<Changes>>,
    field: Arc<dyn FieldStorage>,
}

/// How a field differs from the one that it followed from.
#[derive(Debug)]
pub struct Changes {
    /// The revision of the field before.
    pub since: u64,
    pub differences: Differences,
    /// For each sample its place in the field before, where it was the same and as exposed.
    pub same: Vec<Option<u32>>,
    /// For each sample whether a viewpoint sees it that did not before, or the other way round.
    pub is_touched: Vec<bool>,
}

impl Snapshot {
    pub fn field(&self) -> FieldTable<'_> {
        FieldTable::open(self.field.blocks()).expect("the table was opened when the snapshot was made and nobody writes to it")
    }

    /// How it differs from the field that it followed from; `None` for one that was built anew.
    pub fn changes(&self) -> Option<&Changes> {
        self.changes.as_deref()
    }

    /// The memory that holds the field.
    pub fn storage(&self) -> &Arc<dyn FieldStorage> {
        &self.field
    }
}
