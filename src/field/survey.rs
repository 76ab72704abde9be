//! A field before and after it is built: what is surveyed first, and the immutable snapshot at the end.

use std::fmt;
use std::sync::Arc;

use overfly_table::field::{FieldCounts, FieldFacts};
use overfly_table::{Block, FieldTable, LayoutError, Segment, TableMemory};

use super::build::{FieldInputs, Outlines, write_table};
use super::lookup::Lookup;
use super::rows::{Place, Visibility, build_rows};
use super::strips::Strip;
use super::tiles::Tile;
use super::update::{Earlier, Seen, update_rows};
use crate::coverage::{DiskModel, Mask, SampleFrame};
use crate::scene::Scene;
use crate::scene::clearance::Exchange;
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

/// A scene after an edit, whose free space is known and whose field is still to be built.
pub struct Cleared {
    pub scene: Arc<Scene>,
    pub revision: u64,
    pub free: Arc<FreeSpace>,
    /// How it differs from the scene that the field before was built of.
    pub differences: Differences,
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
    pub(crate) sites: Vec<Arc<Strip>>,
    /// Of the sites those that can be reached: the viewpoints.
    pub(crate) tiles: Vec<Tile>,
    pub(crate) offset_m: f64,
    /// The field that this one follows from, and how their scenes differ.
    pub(crate) earlier: Option<(Snapshot, Differences)>,
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
    pub(crate) sites: Vec<Arc<Strip>>,
    tiles: Vec<Tile>,
    unions: Vec<Mask>,
    frames: Arc<Vec<SampleFrame>>,
}

/// A survey with its visibility: everything that the field's tables hold.
pub struct Findings {
    survey: Survey,
    visibility: Visibility,
    /// How its samples compare with those of the field before.
    seen: Option<Seen>,
}

impl Survey {
    /// The size of the field's table, but for tiles and patches.
    pub fn counts(&self) -> &FieldCounts {
        &self.counts
    }

    /// Builds the visibility rows (Algorithm 1), in parallel over tiles; where there is an earlier field, only what differs from it. `place` gives memory
    /// for the segments; what is as before keeps the earlier field's.
    pub fn build<E: From<FieldError> + Send>(self, place: &Place<E>, stop: &StopToken) -> Result<Findings, E> {
        let (inputs, tiles) = (self.inputs(), &self.tiles);
        let (visibility, seen) = match &self.earlier {
            None => (build_rows(&inputs, tiles, place, stop)?, None),
            Some((snapshot, differences)) => {
                let Footing { samples, tiles: before, unions, .. } = &*snapshot.footing;
                let earlier =
                    Earlier { field: snapshot.field(), tiles: before, samples, clearance: &snapshot.free.clearance, unions };
                let (visibility, seen) = update_rows(&inputs, tiles, differences, &earlier, place, stop)?;
                (visibility, Some(seen))
            }
        };
        Ok(Findings { survey: self, visibility, seen })
    }

    /// Builds the field in memory of its own.
    pub fn into_snapshot(self, stop: &StopToken) -> Result<Snapshot, FieldError> {
        let findings = self.build::<FieldError>(&on_heap, stop)?;
        let mut blocks = vec![Block::ZERO; findings.blocks()];
        findings.write(&mut blocks);
        let segments = findings.segments().to_vec();
        findings.snapshot(Arc::new(HeapField { blocks, segments }))
    }

    fn inputs(&self) -> FieldInputs<'_> {
        FieldInputs {
            scene: &self.scene,
            outlines: &self.outlines,
            free: &self.free,
            samples: &self.samples,
            disks: &self.disks,
            facts: self.facts,
            offset_m: self.offset_m,
        }
    }
}

/// Memory of this process alone.
fn on_heap(count: usize, write: &dyn Fn(&mut [Block])) -> Result<Arc<dyn TableMemory>, FieldError> {
    let mut blocks = vec![Block::ZERO; count];
    write(&mut blocks);
    Ok(Arc::new(blocks))
}

impl fmt::Debug for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Findings of revision {} ({:?})", self.survey.revision, self.counts())
    }
}

impl Findings {
    /// The segments with the visibility rows.
    pub fn segments(&self) -> &[Segment] {
        &self.visibility.segments
    }

    /// Size of the field's table in blocks, without the segments.
    pub fn blocks(&self) -> usize {
        self.counts().blocks()
    }

    /// Writes the field's table into `blocks`, which are exactly [`Findings::blocks`] long; all of them are written.
    pub fn write(&self, blocks: &mut [Block]) {
        write_table(&self.survey.inputs(), &self.counts(), &self.survey.tiles, &self.visibility, blocks);
    }

    /// The snapshot over the segments and a table that [`Findings::write`] has written.
    pub fn snapshot(self, field: Arc<dyn FieldStorage>) -> Result<Snapshot, FieldError> {
        let Self { survey, visibility: Visibility { unions, frames, .. }, seen } = self;
        let table = FieldTable::open(field.blocks(), field.segments())?;
        let tiles = &survey.tiles;
        let has_cells_of = |before: &[Tile]| {
            tiles.len() == before.len() && tiles.iter().zip(before).all(|(tile, before)| tile.has_cells_of(before))
        };
        let same = survey.earlier.as_ref().filter(|(earlier, _)| has_cells_of(&earlier.footing.tiles));
        let lookup = match same {
            Some((earlier, _)) => Arc::clone(&earlier.lookup),
            None => {
                let lookup = Lookup::new(table.viewpoints);
                Arc::new(lookup.ok_or_else(|| FieldError::NoSurface { scene: survey.scene.name.clone() })?)
            }
        };
        let Survey { outlines, samples, sites, tiles, earlier, .. } = survey;
        let changes = earlier.zip(seen).map(|((earlier, differences), Seen { same, is_touched, exchange })| {
            Arc::new(Changes { since: earlier.revision, differences, exchange, same, is_touched })
        });
        Ok(Snapshot {
            scene: survey.scene,
            revision: survey.revision,
            free: survey.free,
            disks: survey.disks,
            lookup,
            offset_m: survey.offset_m,
            footing: Arc::new(Footing { outlines, samples, sites, tiles, unions, frames: Arc::new(frames) }),
            changes,
            field,
        })
    }

    fn counts(&self) -> FieldCounts {
        let patches = self.visibility.patches.iter().map(Vec::len).sum();
        FieldCounts { tiles: self.survey.tiles.len(), patches, ..self.survey.counts }
    }
}

/// Memory that holds a finished field: vectors in process, a received sample and mapped segments in the daemon.
pub trait FieldStorage: Send + Sync {
    /// The field's table.
    fn blocks(&self) -> &[Block];

    /// Its segments, one for each tile.
    fn segments(&self) -> &[Segment];

    /// Whether both hold the same bytes.
    fn is_same(&self, other: &dyn FieldStorage) -> bool {
        let segments = || self.segments().iter().zip(other.segments());
        self.blocks() == other.blocks()
            && self.segments().len() == other.segments().len()
            && segments().all(|(a, b)| a.memory().blocks() == b.memory().blocks())
    }
}

/// A field in the memory of one process.
pub struct HeapField {
    pub blocks: Vec<Block>,
    pub segments: Vec<Segment>,
}

impl FieldStorage for HeapField {
    fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    fn segments(&self) -> &[Segment] {
        &self.segments
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
    /// The surfaces that only one of the scenes has.
    pub exchange: Exchange,
    /// For each sample its place in the field before, where it was the same and as exposed.
    pub same: Vec<Option<u32>>,
    /// For each sample whether a viewpoint sees it that did not before, or the other way round.
    pub is_touched: Vec<bool>,
}

impl Snapshot {
    /// This field in a scene that was edited since, until that has its own: where its viewpoints lie is all that is right of it there.
    pub fn carried_to(&self, cleared: &Cleared) -> Self {
        let Cleared { scene, revision, free, .. } = cleared;
        Self { scene: Arc::clone(scene), revision: *revision, free: Arc::clone(free), changes: None, ..self.clone() }
    }

    pub fn field(&self) -> FieldTable<'_> {
        let table = FieldTable::open_again(self.field.blocks(), self.field.segments());
        table.expect("the table was opened when the snapshot was made and nobody writes to it")
    }

    /// The samples with the axes of their hemispheres.
    pub fn frames(&self) -> &Arc<Vec<SampleFrame>> {
        &self.footing.frames
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
