//! All derived state of one scene. The daemon owns a [`Session`] and is the only one that changes it; everybody else works on
//! immutable [`Snapshot`]s.

use std::sync::Arc;

use overfly_table::{Block, FieldTable};

use crate::planner::StopToken;
use crate::scene::Scene;
use crate::scene::edit::{DirtyRegion, Edit, EditError};
use crate::settings::Settings;

/// Why no field can be built of a scene.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldError {
    #[error("the computation was stopped")]
    Stopped,
    #[error("the scene {scene:?} has no surface that can be sampled")]
    NoSurface { scene: String },
    #[error("the scene {scene:?} leaves no free space within the flight limits: {hint}")]
    NoFreeSpace { scene: String, hint: String },
}

/// A scene with its revision and the field settings that were pinned when it was loaded.
#[derive(Clone, Debug)]
pub struct Session {
    scene: Arc<Scene>,
    revision: u64,
    settings: Arc<Settings>,
}

impl Session {
    /// Pins lattice, spacings and units for `scene`; revision 1. This samples the whole scene once (tens of milliseconds).
    pub fn new(_scene: Scene, _settings: Arc<Settings>, _stop: &StopToken) -> Result<Self, FieldError> {
        unimplemented!("core")
    }

    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    pub fn revision(&self) -> u64 {
        self.revision
    }

    pub fn settings(&self) -> &Arc<Settings> {
        &self.settings
    }

    /// Changes the scene and counts the revision up; a refused edit changes nothing.
    pub fn apply(&mut self, edit: &Edit) -> Result<DirtyRegion, EditError> {
        let (scene, dirty) = self.scene.edited(edit)?;
        self.scene = Arc::new(scene);
        self.revision += 1;
        Ok(dirty)
    }

    /// Samples, viewpoints and clearance of the current revision: all that is needed to size the field's table.
    pub fn survey(&self, _stop: &StopToken) -> Result<Survey, FieldError> {
        unimplemented!("core")
    }
}

/// Everything about a field but its visibility.
#[derive(Debug)]
pub struct Survey {}

impl Survey {
    /// Size of the field's table in blocks.
    pub fn blocks(&self) -> usize {
        unimplemented!("core")
    }

    /// Builds the field in place (Algorithm 1), in parallel over viewpoints. `blocks` is exactly [`Survey::blocks`] long; what it
    /// held is overwritten. When stopped the blocks hold nothing of use.
    pub fn build(&self, _blocks: &mut [Block], _stop: &StopToken) -> Result<(), FieldError> {
        unimplemented!("core")
    }

    /// The snapshot over a table that [`Survey::build`] has filled.
    pub fn snapshot(self, _field: Arc<dyn FieldStorage>) -> Snapshot {
        unimplemented!("core")
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
    field: Arc<dyn FieldStorage>,
}

impl Snapshot {
    pub fn field(&self) -> FieldTable<'_> {
        FieldTable::open(self.field.blocks()).expect("the survey built this table")
    }
}
