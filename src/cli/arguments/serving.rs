//! What can be said to a daemon, and of one: which it is, what it loads, and what it is asked.

use std::path::PathBuf;

use clap::Args;

use super::ReadArgs;
use crate::cli::values;

/// Which daemon is meant.
#[derive(Debug, Clone, Args)]
pub struct Reach {
    /// Domain of the daemon: a short name; daemons of different domains do not see each other [default: overfly]
    #[arg(long, value_name = "NAME", env = "OVERFLY_DOMAIN", hide_env_values = true)]
    pub domain: Option<String>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "SIGTERM and SIGINT end the daemon cleanly, SIGHUP (or `overfly reload`) reads the configuration again. The log goes \
    to standard error; RUST_LOG=debug says more.\n\nExamples:\n  overfly serve\n  overfly serve --config aircraft.toml --domain left-wing"
)]
pub struct ServeArgs {
    /// TOML file whose keys replace the built-in values; `config/default.toml` lists all keys with their units
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Aircraft that this daemon plans for: how far its cameras see decides on the fields (preset or rig file) [default: as the settings say]
    #[arg(long, value_name = "PRESET|RIG.toml")]
    pub rig: Option<String>,
    #[command(flatten)]
    pub reach: Reach,
    /// End when standard input ends, so that the program that started this daemon takes it along
    #[arg(long)]
    pub until_stdin_ends: bool,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Reads GeoJSON footprints with heights (.geojson, .json), OpenStreetMap extracts (.osm.pbf), CityJSON 1.0 to 2.0 (.city.json) and its sequences \
    (.city.jsonl), meshes as OBJ, PLY, STL and glTF (.glb), GeoTIFF surface models with their ground (.tif, `--dtm`) and point clouds (.las, .laz). What was repaired or guessed is listed. The daemon reads the file itself; when it cannot, because it runs as another user or sees other \
    files, the content is sent (at most `daemon.max_scene_mb`).\n\nExample:\n  overfly load delfshaven.city.json --name harbour"
)]
pub struct LoadArgs {
    /// Scene file
    pub file: PathBuf,
    /// Name of the scene from now on [default: the file's name without its extension]
    #[arg(long)]
    pub name: Option<String>,
    #[command(flatten)]
    pub reach: Reach,
    #[command(flatten)]
    pub read: ReadArgs,
}

#[derive(Debug, Args)]
#[command(
    after_help = "With --out each plan is written as revision-R-seed-S.json, revision-R-seed-S.svg and revision-R-seed-S-run.json.\n\n\
    With --html the address is printed. Whoever may use this machine may open it and edit the scene; nobody else can, and pages of other sites cannot either. \
    When the daemon ends the page says so, and goes on when it is back and the scene is loaded again.\n\n\
    Examples:\n  overfly watch town --count 3 --json\n  overfly watch town --html 8080 --open"
)]
pub struct WatchArgs {
    /// Name of the loaded scene
    pub scene: String,
    /// End after so many plans [default: watch until interrupted]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = values::count)]
    pub count: Option<u32>,
    /// Folder for the plans
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Instead of lines a page for the browsers of this machine, on this port of 127.0.0.1 (0: one that is free): scene and flight, what an edit changes of
    /// it, and buildings that are raised, lowered or removed by a click
    #[arg(long, value_name = "PORT", conflicts_with_all = ["count", "out"])]
    pub html: Option<u16>,
    /// With --html: show the page in the browser at once
    #[arg(long, requires = "html")]
    pub open: bool,
    #[command(flatten)]
    pub reach: Reach,
}

#[derive(Debug, Args)]
pub struct SceneArgs {
    /// Name of the loaded scene
    pub scene: String,
    #[command(flatten)]
    pub reach: Reach,
}

#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Name of a loaded scene: lists its structures with ids and heights
    pub scene: Option<String>,
    /// Show the status again whenever a scene comes, goes, or has another revision, state or plan, until interrupted
    #[arg(long, conflicts_with = "scene")]
    pub follow: bool,
    #[command(flatten)]
    pub reach: Reach,
}
