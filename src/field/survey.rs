//! A field before and after it is built: what is surveyed first, and the immutable snapshot at the end.

use std::sync::Arc;

use overfly_table::field::{FieldCounts, FieldFacts};
use overfly_table::{Block, FieldTable, LayoutError};

use super::build::{FieldInputs, Outlines, build};
use super::lookup::Lookup;
use super::viewpoints::Viewpoint;
use crate::coverage::DiskModel;
use crate::scene::Scene;
use crate::scene::free_space::{FreeSpace, ZoneError};
use crate::stop::StopToken;
use crate::surface::Sample;

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
#[derive(Debug)]
pub struct Survey {
    pub(crate) scene: Arc<Scene>,
    pub(crate) revision: u64,
    pub(crate) facts: FieldFacts,
    pub(crate) counts: FieldCounts,
    pub(crate) free: Arc<FreeSpace>,
    pub(crate) disks: Arc<DiskModel>,
    pub(crate) outlines: Outlines,
    pub(crate) samples: Vec<Sample>,
    pub(crate) viewpoints: Vec<Viewpoint>,
    pub(crate) offset_m: f64,
}

impl Survey {
    /// Size of the field's table in blocks.
    pub fn blocks(&self) -> usize {
        self.counts.blocks()
    }

    pub fn counts(&self) -> &FieldCounts {
        &self.counts
    }

    /// Builds the field in place (Algorithm 1), in parallel over viewpoints. `blocks` is exactly [`Survey::blocks`] long; what it
    /// held is overwritten. When stopped the blocks hold nothing of use.
    pub fn build(&self, blocks: &mut [Block], stop: &StopToken) -> Result<(), FieldError> {
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
        build(&inputs, &self.counts, blocks, stop).ok_or(FieldError::Stopped)
    }

    /// The snapshot over a table that [`Survey::build`] has filled.
    pub fn snapshot(self, field: Arc<dyn FieldStorage>) -> Result<Snapshot, FieldError> {
        let table = FieldTable::open(field.blocks())?;
        let lookup = Lookup::new(table.viewpoints).ok_or_else(|| FieldError::NoSurface { scene: self.scene.name.clone() })?;
        Ok(Snapshot {
            scene: self.scene,
            revision: self.revision,
            free: self.free,
            disks: self.disks,
            lookup: Arc::new(lookup),
            offset_m: self.offset_m,
            field,
        })
    }

    /// Builds the field in memory of its own.
    pub fn into_snapshot(self, stop: &StopToken) -> Result<Snapshot, FieldError> {
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
    field: Arc<dyn FieldStorage>,
}

impl Snapshot {
    pub fn field(&self) -> FieldTable<'_> {
        FieldTable::open(self.field.blocks()).expect("the table was opened when the snapshot was made and nobody writes to it")
    }

    /// The memory that holds the field.
    pub fn storage(&self) -> &Arc<dyn FieldStorage> {
        &self.field
    }
}
