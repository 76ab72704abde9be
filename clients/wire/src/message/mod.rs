//! The bodies of requests and replies, and the checks on what a client has sent.

mod check;
mod edit;
mod plan;
mod read;
mod reply;
mod status;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use crate::en_route::FlightReport;

pub use self::check::{MAX_COORDINATE_M, MAX_NAME_BYTES, MAX_PATH_BYTES, check_scene_name, plain_scene_name};
use self::check::{check_file_name, check_path};
use self::edit::check_edits;
pub use self::edit::{EditOrder, MAX_EDITS, MAX_MESH_TRIANGLES, MAX_MESH_VERTICES, OBSTACLE_SIDE_M, ShapeOrder};
pub use self::plan::{MAX_ITERATIONS, MAX_RIG_FILE_BYTES, MAX_SECONDS, PlanOrder};
pub use self::read::ReadOrder;
pub use self::reply::{
    Loaded, ProgressNote, Refusal, RefusalCode, Reply, SceneChanges, Stage, StructureInfo, StructureKind, Updated, ZoneInfo,
};
pub use self::status::{PlanSummary, SceneState, SceneStatus, Status};

/// Most corners of an outline.
pub const MAX_OUTLINE_CORNERS: usize = 10_000;

/// What a client may ask for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// The first message: [`Reply::Welcome`].
    Hello,
    /// Nothing but an answer: [`Reply::Acknowledged`].
    Ping,
    /// A scene file that the daemon can read; the bytes of an absolute path.
    LoadPath {
        path: Vec<u8>,
        /// Of a surface model the model of its ground, likewise.
        ground: Option<Vec<u8>>,
        name: Option<String>,
        order: Box<ReadOrder>,
    },
    /// A scene file that follows as bulk; its name or, better, its absolute path tells its format and names the scene.
    LoadBytes {
        file_name: String,
        name: Option<String>,
        order: Box<ReadOrder>,
    },
    Unload {
        scene: String,
    },
    Plan {
        scene: String,
        order: Box<PlanOrder>,
    },
    /// Edits that are made together, one after the other, as one revision, or not at all: [`Reply::Edited`].
    Edit {
        scene: String,
        edits: Vec<EditOrder>,
    },
    /// A new version of the scene's file, which the daemon can read: the bytes of an absolute path. What differs is changed as by edits that are made
    /// together, or with `dry_run` only told: [`Reply::Updated`].
    UpdatePath {
        scene: String,
        path: Vec<u8>,
        /// As in `LoadPath`.
        ground: Option<Vec<u8>>,
        dry_run: bool,
    },
    /// The same with the file as bulk.
    UpdateBytes {
        scene: String,
        file_name: String,
        dry_run: bool,
    },
    /// Where the aircraft is on its flight over a scene, and what it has captured: whatever is planned from now on, after an edit too, goes on from there.
    /// The next order without such a report begins another flight.
    Progress {
        scene: String,
        report: FlightReport,
    },
    /// Ends the scene's running search; its best plan so far is published.
    Cancel {
        scene: String,
    },
    /// Where the field of a scene is published: [`Reply::Located`].
    Locate {
        scene: String,
    },
    /// Publishes the scene's last plan once more, for a receiver that missed it: [`Reply::Planned`] names it.
    Republish {
        scene: String,
    },
    /// What became of an earlier request of this client.
    Outcome {
        correlation: u64,
    },
    Structures {
        scene: String,
    },
    Zones {
        scene: String,
    },
    Status,
    Reload,
    Stop,
}
impl Request {
    /// Judges the values of a request that was decoded; the error says what is wrong and what is allowed.
    pub fn check(&self) -> Result<(), Refusal> {
        match self {
            Request::LoadPath { path, ground, name, order } => {
                check_path(path)?;
                ground.as_deref().map_or(Ok(()), check_path)?;
                order.check()?;
                name.as_deref().map_or(Ok(()), check_scene_name)
            }
            Request::LoadBytes { file_name, name, order } => {
                check_file_name(file_name)?;
                order.check()?;
                name.as_deref().map_or(Ok(()), check_scene_name)
            }
            Request::Plan { scene, order } => {
                check_scene_name(scene)?;
                order.check()
            }
            Request::Edit { scene, edits } => {
                check_scene_name(scene)?;
                check_edits(edits)
            }
            Request::UpdatePath { scene, path, ground, .. } => {
                check_scene_name(scene)?;
                ground.as_deref().map_or(Ok(()), check_path)?;
                check_path(path)
            }
            Request::UpdateBytes { scene, file_name, .. } => {
                check_scene_name(scene)?;
                check_file_name(file_name)
            }
            Request::Progress { scene, report } => {
                check_scene_name(scene)?;
                report.check()
            }
            Request::Unload { scene }
            | Request::Cancel { scene }
            | Request::Locate { scene }
            | Request::Republish { scene }
            | Request::Structures { scene }
            | Request::Zones { scene } => check_scene_name(scene),
            Request::Hello | Request::Ping | Request::Outcome { .. } | Request::Status | Request::Reload | Request::Stop => {
                Ok(())
            }
        }
    }
}
