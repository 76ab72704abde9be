//! Why a command ends without its result: kind, exit code and one message that names what, where and the next step.

use std::io;
use std::path::{Path, PathBuf};

use overfly_client::{ClientError, DomainError, RefusalCode};
use serde_json::json;

use crate::autopilot::link::LinkError;
use crate::autopilot::mission::MissionError;
use crate::autopilot::notice::PilotError;
use crate::bound::BoundError;
use crate::camera::RigError;
use crate::daemon::{ConfigurationError, DaemonError};
use crate::mission::course::CourseError;
use crate::mission::plan_read::PlanReadError;
use crate::mission::svg::SvgError;
use crate::planner::PlanError;
use crate::quality::Misplaced;
use crate::reproduction::ReproductionError;
use crate::scene::ImportError;
use crate::session::FieldError;
use crate::settings::SettingsError;

/// The kinds of failure; the number is the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Unexpected = 1,
    Usage = 2,
    InputFile = 3,
    NoDaemon = 4,
    Refused = 5,
    NoPlan = 6,
    Autopilot = 7,
    Interrupted = 130,
}

#[derive(Debug, thiserror::Error)]
pub enum Failure {
    #[error("{0}")]
    Usage(String),
    #[error("cannot read {path:?}: {cause}; {remedy}")]
    Read { path: PathBuf, cause: io::Error, remedy: &'static str },
    #[error("{}; `config/default.toml` lists every key with its unit", .0.to_string().trim_end())]
    Configuration(#[from] ConfigurationError),
    #[error("the settings cannot be used: {0}; `config/default.toml` lists every key with its unit")]
    Settings(#[from] SettingsError),
    #[error(transparent)]
    Import(#[from] ImportError),
    /// What is wrong with another file, and what to do about it.
    #[error("{0}")]
    File(String),
    #[error("cannot write {path:?}: {cause}; give another place with `--out`")]
    Write { path: PathBuf, cause: io::Error },
    #[error(transparent)]
    Domain(#[from] DomainError),
    #[error(transparent)]
    Client(#[from] ClientError),
    #[error("there is no file {scene:?}, and as the name of a loaded scene it needs a daemon: {cause}")]
    NoSuchScene { scene: String, cause: String },
    #[error(transparent)]
    Field(#[from] FieldError),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error(transparent)]
    Bound(BoundError),
    #[error(transparent)]
    Rig(RigError),
    #[error("{path:?}: {cause}")]
    RigFile { path: PathBuf, cause: RigError },
    #[error(transparent)]
    Reproduction(ReproductionError),
    #[error(transparent)]
    PlanFile(#[from] PlanReadError),
    #[error(transparent)]
    Course(#[from] CourseError),
    #[error(transparent)]
    Misplaced(#[from] Misplaced),
    #[error("{plan:?} does not tell its scene ({run:?}: {cause}); give the scene file with `--truth`")]
    UnknownScene { plan: PathBuf, run: PathBuf, cause: String },
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error(transparent)]
    Pilot(#[from] PilotError),
    #[error("port {port} of 127.0.0.1 cannot be had: {cause}; give another one, or 0 for one that is free, with `--html`")]
    Port { port: u16, cause: io::Error },
    #[error(transparent)]
    Drawing(#[from] SvgError),
    #[error("{0}")]
    Daemon(String),
    #[error(transparent)]
    Serve(#[from] DaemonError),
    #[error("cannot print the result on standard output: {0}; free some space there or send it elsewhere")]
    Print(io::Error),
    #[error("interrupted before there was a result; nothing was written")]
    Interrupted,
    #[error("{0}")]
    Unexpected(String),
}

impl Failure {
    pub fn kind(&self) -> Kind {
        match self {
            Failure::Usage(_) | Failure::Domain(_) => Kind::Usage,
            Failure::Read { .. } | Failure::Configuration(_) | Failure::Settings(_) | Failure::Import(_) | Failure::File(_) => {
                Kind::InputFile
            }
            Failure::Client(error) => client_kind(error),
            Failure::Interrupted => Kind::Interrupted,
            Failure::Reproduction(ReproductionError::UnknownPart(_)) => Kind::Usage,
            Failure::Reproduction(_) => Kind::NoPlan,
            Failure::RigFile { .. } | Failure::PlanFile(_) | Failure::Misplaced(_) | Failure::UnknownScene { .. } => {
                Kind::InputFile
            }
            Failure::Course(
                CourseError::NoPlace { .. } | CourseError::FarHome { .. } | CourseError::NoTerrain | CourseError::TerrainFrame,
            ) => Kind::Usage,
            Failure::Course(
                CourseError::NoGeoreference { .. }
                | CourseError::TooFewWaypoints { .. }
                | CourseError::TooManyWaypoints { .. }
                | CourseError::NoLimits,
            ) => Kind::InputFile,
            Failure::Course(_) => Kind::NoPlan,
            Failure::Pilot(PilotError::Mission(
                MissionError::NoSortie { .. } | MissionError::Course(CourseError::NoTerrain | CourseError::TerrainFrame),
            )) => Kind::Usage,
            Failure::Pilot(PilotError::Mission(_)) => Kind::NoPlan,
            Failure::Link(_) | Failure::Pilot(_) => Kind::Autopilot,
            Failure::Field(_) | Failure::Plan(_) | Failure::Bound(_) | Failure::Rig(_) => Kind::NoPlan,
            Failure::Daemon(_) | Failure::Serve(_) | Failure::NoSuchScene { .. } => Kind::NoDaemon,
            Failure::Write { .. } | Failure::Print(_) | Failure::Port { .. } | Failure::Drawing(_) | Failure::Unexpected(_) => {
                Kind::Unexpected
            }
        }
    }

    pub fn to_json(&self) -> serde_json::Value {
        json!({ "error": { "kind": self.kind().name(), "message": self.to_string() } })
    }

    pub fn write(path: &Path, cause: io::Error) -> Self {
        Failure::Write { path: path.to_owned(), cause }
    }
}

impl Kind {
    /// The word for this kind in the JSON of an error.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Unexpected => "unexpected",
            Kind::Usage => "usage",
            Kind::InputFile => "input_file",
            Kind::NoDaemon => "no_daemon",
            Kind::Refused => "refused",
            Kind::NoPlan => "no_plan",
            Kind::Autopilot => "autopilot",
            Kind::Interrupted => "interrupted",
        }
    }
}

impl From<ReproductionError> for Failure {
    fn from(error: ReproductionError) -> Self {
        if error == ReproductionError::Stopped { Failure::Interrupted } else { Failure::Reproduction(error) }
    }
}

/// What a daemon refuses for the reason for which the in-process planner would fail is of the same kind.
fn client_kind(error: &ClientError) -> Kind {
    match error {
        ClientError::Refused { code: RefusalCode::Import | RefusalCode::Unreadable | RefusalCode::Configuration, .. } => {
            Kind::InputFile
        }
        ClientError::Refused { code: RefusalCode::Field | RefusalCode::Plan | RefusalCode::Hold | RefusalCode::Land, .. } => {
            Kind::NoPlan
        }
        ClientError::Refused { .. } => Kind::Refused,
        ClientError::Path { .. } => Kind::InputFile,
        ClientError::Domain(_) => Kind::Usage,
        _ => Kind::NoDaemon,
    }
}
