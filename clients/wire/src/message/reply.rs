//! What the daemon answers.

use serde::{Deserialize, Serialize};

use super::Status;

/// What the daemon answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply {
    Welcome {
        version: String,
        pid: u32,
    },
    /// The request was taken up; a further reply follows unless it was a ping.
    Acknowledged,
    Progress(ProgressNote),
    Loaded(Loaded),
    /// The plan of this correlation was published with this epoch.
    Planned {
        epoch: u64,
    },
    Edited {
        revision: u64,
        replan_follows: bool,
    },
    Updated(Updated),
    /// The field of the scene: its service holds a table of this epoch, or of a later one.
    Located {
        epoch: u64,
        revision: u64,
        bytes: u64,
    },
    Structures(Vec<StructureInfo>),
    Zones(Vec<ZoneInfo>),
    Status(Status),
    Done,
    Refused(Refusal),
}

/// The daemon did not do it, and nothing was changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    pub code: RefusalCode,
    /// What, where and what to do about it.
    pub message: String,
}

/// Why the daemon refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum RefusalCode {
    /// The message itself is damaged, too long, or of another schema version.
    Malformed,
    /// A value is not finite, out of range, or a name is too long or empty.
    Invalid,
    UnknownScene,
    /// Also of a no-fly zone.
    UnknownStructure,
    /// The scene file cannot be read.
    Import,
    /// The scene offers nothing to plan on.
    Field,
    /// The edit would make the scene invalid.
    Edit,
    /// Unknown rig or method, or a start that cannot be flown.
    Plan,
    /// Something newer on the same scene took the place of this request.
    Superseded,
    /// The memory budget or /dev/shm is used up.
    Memory,
    /// The scene is being loaded, or too much is going on.
    Busy,
    /// The request was meant for an earlier daemon of the same domain.
    Restarted,
    Configuration,
    /// The daemon is ending.
    Stopping,
    /// A mistake in the daemon; its log says more.
    Internal,
    /// The daemon cannot read the path; whoever can may send the file's content instead.
    Unreadable,
    /// There is nothing that the aircraft can safely fly from where it is: it has to brake and hold there.
    Hold,
    /// There is no time left but for landing, or not even for the way there.
    Land,
}

/// What the daemon is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stage {
    /// Reading and repairing the scene file.
    Read,
    /// Sampling the surface and the viewpoints.
    Survey,
    /// Casting the rays of the field.
    Field,
    Search,
}

/// How far the work on a request has come.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProgressNote {
    pub stage: Stage,
    /// Steps that are done, and all: of the search iterations, of the field viewpoints whose rays are cast. 0 of 0 where nobody counts.
    pub done: u32,
    pub of: u32,
    /// Best path so far, by the field.
    pub coverage_percent: f64,
    pub length_m: f64,
    pub objective: f64,
    /// Since the request was taken up.
    pub elapsed_s: f64,
}

/// A scene that stands ready to be planned on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Loaded {
    /// The name to use from now on.
    pub scene: String,
    pub revision: u64,
    pub structures: u64,
    pub samples: u64,
    /// Samples that lie on the outside of the scene.
    pub exposed: u64,
    pub viewpoints: u64,
    /// Share of the exposed samples that the viewpoints can capture at all.
    pub capturable_percent: f64,
    pub field_bytes: u64,
    /// Reading and repairing the file, s.
    pub read_s: f64,
    /// Building the field, s.
    pub field_s: f64,
    /// All of it, s.
    pub load_s: f64,
    /// The import report.
    pub report_json: String,
    /// The same in words, one line each.
    pub report_lines: Vec<String>,
}

/// A structure of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StructureInfo {
    pub id: u64,
    pub name: String,
    pub base_m: f64,
    pub top_m: f64,
    pub samples: u64,
    pub kind: StructureKind,
}

/// What a structure is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StructureKind {
    Prism,
    Mesh,
    /// It is kept clear of, but not captured.
    Obstacle,
    /// The ground where it is not flat: kept clear of, not captured, and not to be edited.
    Terrain,
}

/// A no-fly zone of a scene; those of the configuration belong to no scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ZoneInfo {
    pub name: String,
    /// Above the ground.
    pub floor_m: f64,
    /// `None` for a zone without a ceiling.
    pub ceiling_m: Option<f64>,
    /// An edit has added it, so that a new version of the scene's file does not take it away.
    pub by_edit: bool,
}

/// A scene that was compared with a new version of its file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Updated {
    /// The scene's revision from now on; the one that was compared after a dry run, and when nothing differed.
    pub revision: u64,
    pub replan_follows: bool,
    pub changes: SceneChanges,
    /// What was repaired or guessed in the file, one line each.
    pub report_lines: Vec<String>,
}

/// How a new version of a scene differs, by names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneChanges {
    pub added: Vec<String>,
    pub removed: Vec<String>,
    pub changed: Vec<String>,
    pub zones_added: Vec<String>,
    pub zones_removed: Vec<String>,
    pub zones_changed: Vec<String>,
}

impl SceneChanges {
    /// Everything that differs, each kind with its names.
    pub fn kinds(&self) -> [(&'static str, &[String]); 6] {
        [
            ("added", &self.added),
            ("removed", &self.removed),
            ("changed", &self.changed),
            ("zones added", &self.zones_added),
            ("zones removed", &self.zones_removed),
            ("zones changed", &self.zones_changed),
        ]
    }

    /// Whether nothing differs.
    pub fn is_empty(&self) -> bool {
        self.kinds().iter().all(|(_, names)| names.is_empty())
    }
}
impl Refusal {
    pub fn new(code: RefusalCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }

    /// The same, of one of several edits that were to be made together: it says which one, and that none was made.
    pub fn of_edit(self, index: usize, count: usize) -> Self {
        if count == 1 {
            return self;
        }
        Self { message: format!("edit {} of {count}: {}; none of them was made", index + 1, self.message), ..self }
    }
}
