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
    /// The field of the scene: its service holds a table of this epoch, or of a later one.
    Located {
        epoch: u64,
        revision: u64,
        bytes: u64,
    },
    Structures(Vec<StructureInfo>),
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
    /// Of the search; 0 in other stages.
    pub iteration: u32,
    pub iterations: u32,
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
}
impl Refusal {
    pub fn new(code: RefusalCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }
}
