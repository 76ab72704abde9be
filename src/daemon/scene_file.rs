//! Scene files as clients name or send them.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Instant;

use overfly_wire::{Refusal, RefusalCode};

use crate::scene::{self, Scene};
use crate::settings::ProxySettings;

/// A scene that was read, and what its repairs were.
#[derive(Debug)]
pub struct SceneFile {
    pub scene: Scene,
    pub report_json: String,
    pub report_lines: Vec<String>,
    pub read_s: f64,
}

/// Reads the file at `path`, which may hold at most `max_bytes`.
pub fn read_path(path: &Path, max_bytes: u64, settings: &ProxySettings) -> Result<SceneFile, Refusal> {
    let refuse = |cause: String| Refusal::new(RefusalCode::Import, format!("the daemon cannot read {path:?}: {cause}"));
    let file =
        File::open(path).map_err(|error| refuse(format!("{error}; check the path and that the daemon's user may read it")))?;
    let metadata = file.metadata().map_err(|error| refuse(error.to_string()))?;
    if !metadata.is_file() {
        return Err(refuse("it is not a file; give a scene file".into()));
    }
    if metadata.len() > max_bytes {
        let (size, limit) = (metadata.len() / 1_000_000, max_bytes / 1_000_000);
        return Err(refuse(format!("it holds {size} MB, at most {limit} MB are allowed; raise `daemon.max_scene_mb`")));
    }
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    file.take(max_bytes).read_to_end(&mut bytes).map_err(|error| refuse(error.to_string()))?;
    read_bytes(&path.to_string_lossy(), &bytes, settings)
}

/// Reads the content of a file; `file_name` names the scene and helps to tell its format.
pub fn read_bytes(file_name: &str, bytes: &[u8], settings: &ProxySettings) -> Result<SceneFile, Refusal> {
    let started = Instant::now();
    let (scene, report) =
        scene::read::read(file_name, bytes, settings).map_err(|error| Refusal::new(RefusalCode::Import, error.to_string()))?;
    let report_json = serde_json::to_string(&report)
        .map_err(|error| Refusal::new(RefusalCode::Internal, format!("the import report cannot be written: {error}")))?;
    let report_lines = report.summary().lines().map(str::to_owned).collect();
    Ok(SceneFile { scene, report_json, report_lines, read_s: started.elapsed().as_secs_f64() })
}
