//! Scene files as clients name or send them.

use std::fs::{self, Metadata, OpenOptions};
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::Instant;

use overfly_wire::{Refusal, RefusalCode};
use rustix::fs::OFlags;

use crate::scene::anchor::Anchor;
use crate::scene::{self, Scene};
use crate::settings::ProxySettings;

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

/// Reads the file at `path`, which may hold at most `max_bytes`; with an anchor in the frame of a scene that was read before.
pub fn read_path(path: &Path, max_bytes: u64, settings: &ProxySettings, anchor: Option<&Anchor>) -> Result<SceneFile, Refusal> {
    let refusal = |code, cause: String| Refusal::new(code, format!("the daemon cannot read {path:?}: {cause}"));
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
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    file.take(max_bytes).read_to_end(&mut bytes).map_err(|error| refuse(error.to_string()))?;
    read_bytes(&path.to_string_lossy(), &bytes, settings, anchor)
}

/// Reads the content of a file; `file_name` names the scene and helps to tell its format.
pub fn read_bytes(
    file_name: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<SceneFile, Refusal> {
    let started = Instant::now();
    let read = match anchor {
        Some(anchor) => scene::read_anchored(file_name, bytes, settings, anchor),
        None => scene::read(file_name, bytes, settings),
    };
    let (scene, report) = read.map_err(|error| Refusal::new(RefusalCode::Import, error.to_string()))?;
    let report_json = serde_json::to_string(&report)
        .map_err(|error| Refusal::new(RefusalCode::Internal, format!("the import report cannot be written: {error}")))?;
    let report_lines = report.summary().lines().map(str::to_owned).collect();
    let read_s = started.elapsed().as_secs_f64();
    Ok(SceneFile { scene, anchor: report.anchor, bytes: bytes.len(), report_json, report_lines, read_s })
}
