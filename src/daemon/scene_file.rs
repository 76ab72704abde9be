//! Scene files as clients name or send them.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{Read, Seek};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use overfly_wire::{Refusal, RefusalCode};
use rustix::fs::OFlags;

use crate::scene::anchor::Anchor;
use crate::scene::{self, GroundFile, ImportError, ImportReport, Scene, Watched};
use crate::settings::ProxySettings;
use crate::stop::StopToken;

/// A scene that was read, and what its repairs were.
#[derive(Debug)]
pub struct SceneFile {
    pub scene: Scene,
    pub anchor: Option<Anchor>,
    /// Size of the file.
    pub bytes: usize,
    pub report_json: String,
    pub report_lines: Vec<String>,
    pub read_s: f64,
}

/// Reads the file at `path`, a surface model over the model of its ground: that at `ground`, or the one that stands beside it. Each may hold at most
/// `max_bytes`; with an anchor it is read in the frame of a scene that was read before. Of a point cloud `stop` counts what is read.
pub fn read_path(
    path: &Path,
    ground: Option<&Path>,
    max_bytes: u64,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
    stop: &StopToken,
) -> Result<SceneFile, Refusal> {
    let name = path.to_string_lossy();
    let (mut file, length) = opened(path, max_bytes)?;
    if ground.is_none() && is_cloud(&mut file) {
        return told(length as usize, || scene::read_cloud(&name, &mut Watched::new(file, length, stop), settings, anchor));
    }
    let bytes = bytes_of(path, file, length)?;
    let beside = || scene::ground_beside(&name).map(PathBuf::from).filter(|path| path.is_file());
    match ground.map(Path::to_owned).or_else(beside) {
        Some(below) => {
            let (file_below, length_below) = opened(&below, max_bytes)?;
            let (bytes_below, file_name) = (bytes_of(&below, file_below, length_below)?, below.to_string_lossy());
            let below = GroundFile { file_name: &file_name, bytes: &bytes_below, is_found: ground.is_none() };
            told(bytes.len(), || scene::read_over_ground(&name, &bytes, &below, settings, anchor))
        }
        None => read_bytes(&name, &bytes, settings, anchor),
    }
}

/// Whether it is a cloud, which is read from where it lies.
fn is_cloud(file: &mut File) -> bool {
    let mut first = [0; 4];
    let is_read = file.read_exact(&mut first).is_ok();
    is_read && file.rewind().is_ok() && scene::is_cloud(&first)
}

fn refusal(path: &Path, code: RefusalCode, cause: &str) -> Refusal {
    Refusal::new(code, format!("the daemon cannot read {path:?}: {cause}"))
}

/// The file at a path with its length.
fn opened(path: &Path, max_bytes: u64) -> Result<(File, u64), Refusal> {
    let refusal = |code, cause: String| refusal(path, code, &cause);
    let refuse = |cause: String| refusal(RefusalCode::Unreadable, cause);
    let unreadable = |error| refuse(format!("{error}; check the path and that the daemon's user may read it"));
    let check = |metadata: &Metadata| match metadata.is_file() {
        true => Ok(()),
        false => Err(refuse("it is not a regular file; give a scene file, or send its content".into())),
    };
    // Looked at before it is opened, because opening a device can do something, and afterwards, because it may be another by then.
    check(&fs::metadata(path).map_err(unreadable)?)?;
    // A pipe that has taken its place meanwhile must not make this wait for a writer.
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(unreadable)?;
    let metadata = file.metadata().map_err(unreadable)?;
    check(&metadata)?;
    if metadata.len() > max_bytes {
        let (size, limit) = (metadata.len() / 1_000_000, max_bytes / 1_000_000);
        let cause = format!("it holds {size} MB, at most {limit} MB are allowed; raise `daemon.max_scene_mb`");
        return Err(refusal(RefusalCode::Import, cause));
    }
    Ok((file, metadata.len()))
}

fn bytes_of(path: &Path, mut file: File, length: u64) -> Result<Vec<u8>, Refusal> {
    let mut bytes = Vec::with_capacity(length as usize);
    let read = file.rewind().and_then(|()| file.take(length).read_to_end(&mut bytes));
    read.map_err(|error| refusal(path, RefusalCode::Unreadable, &error.to_string()))?;
    Ok(bytes)
}

/// Reads the content of a file; `file_name` names the scene and helps to tell its format.
pub fn read_bytes(
    file_name: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<SceneFile, Refusal> {
    told(bytes.len(), || match anchor {
        Some(anchor) => scene::read_anchored(file_name, bytes, settings, anchor),
        None => scene::read(file_name, bytes, settings),
    })
}

/// What reading a file of so many bytes gives, with what is told of it.
fn told(bytes: usize, read: impl FnOnce() -> Result<(Scene, ImportReport), ImportError>) -> Result<SceneFile, Refusal> {
    let started = Instant::now();
    let (scene, report) = read().map_err(|error| Refusal::new(RefusalCode::Import, error.to_string()))?;
    let report_json = serde_json::to_string(&report)
        .map_err(|error| Refusal::new(RefusalCode::Internal, format!("the import report cannot be written: {error}")))?;
    let report_lines = report.summary().lines().map(str::to_owned).collect();
    let read_s = started.elapsed().as_secs_f64();
    Ok(SceneFile { scene, anchor: report.anchor, bytes, report_json, report_lines, read_s })
}
