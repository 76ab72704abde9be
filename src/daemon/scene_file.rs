//! Scene files as clients name or send them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use overfly_wire::{Refusal, RefusalCode};

use crate::scene::Scene;
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

/// Reads the content of a file; `file_name` tells its format.
pub fn read_bytes(_file_name: &str, _bytes: &[u8], _settings: &ProxySettings) -> Result<SceneFile, Refusal> {
    Err(Refusal::new(RefusalCode::Import, "no reader"))
}
