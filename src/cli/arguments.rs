//! What can be said on the command line.

mod edit;
mod export;
mod fly;
mod measuring;
mod reading;
mod view;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

pub use self::edit::{Change, EditArgs, ShapeArgs, UpdateArgs};
pub use self::export::{ExportArgs, Format};
pub use self::fly::FlyArgs;
pub use self::measuring::{BenchArgs, BoundArgs, ReproduceArgs, Subject};
pub use self::reading::{InspectArgs, ReadArgs};
pub use self::view::ViewArgs;
use super::en_route::EnRouteArgs;
use super::values::{self, Degrees2, Meters2, Meters3, Outline};
use crate::scene::degrade::Boundary;

const EXIT_CODES: &str = "\
Exit codes:
  0  done; a plan that stays below the coverage goal is a result too, with a note
  1  something unexpected, such as an output folder that cannot be written
  2  the command line itself is wrong
  3  a scene, rig or configuration file is missing, unreadable or refused
  4  no daemon answers, the contact to it was lost, or it cannot start
  5  the daemon refused: unknown scene or structure, an edit that makes no sense
  6  no plan: nothing to fly in, a start that cannot be flown, an unknown rig or method
  7  no autopilot answers, the link to it was lost, or it refused the mission
  130  interrupted: by a second Ctrl-C, or by the first before there was any plan

With --json each command prints one JSON object on standard output (`watch` and `fly` one per line), and an error is
{\"error\": {\"kind\": ..., \"message\": ...}} there. Progress, notes and logs go to standard error.

Lengths are metres, times seconds, angles degrees; positions are east, north, up in the scene's local frame.";

const EXAMPLES: &str = "\
Examples:
  overfly demo                                  the whole thing on a generated block, in a few seconds
  overfly plan town.geojson --out flights/town  plan without a daemon; writes plan.json, plan.svg, run.json and plan.html
  overfly view flights/town/plan.json           look at it in the browser
  overfly serve                                 start the daemon, then in another terminal:
  overfly load town.geojson
  overfly plan town --rig phantom4-rtk
  overfly edit town raise 8f02ac51 --by 15      the daemon replans at once
";

/// Plans one continuous flight of a camera drone that captures a city block for 3D reconstruction, and replans when the scene is edited.
#[derive(Debug, Parser)]
#[command(name = "overfly", version, before_long_help = EXAMPLES, after_help = EXIT_CODES, max_term_width = 120, subcommand_required = true)]
pub struct Arguments {
    /// Print one JSON object instead of text
    #[arg(long, global = true)]
    pub json: bool,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show the whole thing: generate a block, plan, make one building taller, replan
    Demo(DemoArgs),
    /// Say what a scene file holds, what was repaired and guessed, and draw it
    Inspect(InspectArgs),
    /// Run the daemon in the foreground
    Serve(ServeArgs),
    /// Give a scene file to the daemon, which builds its view information field
    Load(LoadArgs),
    /// Plan a flight over a scene file (in process) or a loaded scene (by the daemon)
    Plan(Box<PlanArgs>),
    /// Predict Error and Completeness of a plan's images, on its own scene or on another
    Evaluate(EvaluateArgs),
    /// Show a plan in its scene in the browser, or two plans against each other
    View(ViewArgs),
    /// Write a plan as files for ground stations, drones' apps and reconstruction software
    Export(Box<ExportArgs>),
    /// Change structures or no-fly zones of a loaded scene and receive the new plan
    Edit(EditArgs),
    /// Change what differs between a loaded scene and a new version of its file, and receive the new plan
    Update(UpdateArgs),
    /// Receive each new plan of a scene as it is published
    Watch(WatchArgs),
    /// Upload a plan to an autopilot by MAVLink, follow its flight and replace the mission when there is a newer plan
    Fly(Box<FlyArgs>),
    /// End the running search of a loaded scene with its best plan so far
    #[command(
        after_help = "A search that has not begun yet is refused. Without a search nothing happens.\n\nExample:\n  overfly cancel town"
    )]
    Cancel(SceneArgs),
    /// Drop a loaded scene, its field and everything that runs for it
    #[command(after_help = "Fields that clients have mapped stay readable for them.\n\nExample:\n  overfly unload town")]
    Unload(SceneArgs),
    /// Show the daemon and its scenes, or the structures of one scene
    Status(StatusArgs),
    /// Let the daemon read its configuration file again
    Reload(Reach),
    /// End the daemon
    Stop(Reach),
    /// Measure this machine
    Bench(BenchArgs),
    /// Prove how short a flight can be at all, on a graph of waypoints in a small scene
    Bound(BoundArgs),
    /// Write a generated city block as GeoJSON
    Generate(GenerateArgs),
    /// Write a scene file as an imperfect proxy: wrong heights, dilated boundaries
    Degrade(DegradeArgs),
    /// Plan and evaluate what the paper's tables and figures show, with the paper's own rows beside
    Reproduce(ReproduceArgs),
    /// List the rigs that are built in, or print the file of one
    Rigs(RigsArgs),
}

/// Which daemon is meant.
#[derive(Debug, Clone, Args)]
pub struct Reach {
    /// Domain of the daemon: a short name; daemons of different domains do not see each other [default: overfly]
    #[arg(long, value_name = "NAME", env = "OVERFLY_DOMAIN", hide_env_values = true)]
    pub domain: Option<String>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Writes plan.json, plan.svg, run.json, plan.html, the same for the replan (replan.json, replan.svg, replan-run.json, replan.html), both plans in one page (replan-vs-plan.html), a flight \
    on which the scene changes three times (flight.svg), the block (scene.geojson) and the daemon's log (daemon.log) into DIR. The daemon lives in a domain of its own and is stopped at the end."
)]
pub struct DemoArgs {
    /// Folder for the results; it is created
    #[arg(long, value_name = "DIR", default_value = "overfly-out/demo")]
    pub out: PathBuf,
    /// Seed of the block and of the search
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = values::seed)]
    pub seed: u64,
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
    /// Only for a GeoTIFF surface model (DSM): the model of its ground (DTM), a GeoTIFF too [default: the file beside it with `dtm` for `dsm` in its name,
    /// else a guess]
    #[arg(long, value_name = "FILE")]
    pub dtm: Option<PathBuf>,
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
    after_help = "If SCENE is a file, or looks like a path (it holds a `/` or ends like one, .geojson or .glb for example), it is planned in process; else \
    it is the name of a scene that the daemon has loaded. Both give the same plan.json, byte for byte, for the same scene, settings, seed and iterations.\n\n\
    The rig decides what an image sees: `panoramic` everything around, a camera on a gimbal (`phantom4-rtk`, `mavic3e`) where its view \
    direction points, cameras bolted to the airframe (`m300-oblique`) where the drone flies. `overfly rigs` lists them, `overfly rigs phantom4-rtk` \
    prints a rig file to change.\n\nExamples:\n  \
    overfly plan town.geojson --seed 7 --out flights/town\n  overfly plan town.geojson --samples 1600 --viewpoints 2000 --iterations 1000\n  \
    overfly plan town.geojson --rig phantom4-rtk --start 10,-40,35 --look 90,-30\n  \
    overfly plan town.geojson --rig phantom4-rtk --overlap 80\n  overfly plan town --rig my-drone.toml\n  \
    overfly plan town --pose 10,-40,35 --velocity 6,0,0 --taken 120 --time-left 300 --landing 0,-60,20"
)]
pub struct PlanArgs {
    /// Scene file, or the name of a loaded scene
    pub scene: String,
    /// Only for a GeoTIFF surface model (DSM): the model of its ground (DTM), a GeoTIFF too [default: the file beside it with `dtm` for `dsm` in its name,
    /// else a guess]
    #[arg(long, value_name = "FILE")]
    pub dtm: Option<PathBuf>,
    #[command(flatten)]
    pub order: OrderArgs,
    #[command(flatten)]
    pub en_route: EnRouteArgs,
    /// Folder for plan.json, plan.svg, run.json and plan.html; without it only the figures are printed
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Only for a scene file: TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub sizes: SizeArgs,
    #[command(flatten)]
    pub reach: Reach,
    /// Only for a scene file
    #[command(flatten)]
    pub read: ReadArgs,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Casts exact rays from the images to dense samples of the scene and carries pixel noise through the views' geometry. The scene is \
    the file that the run.json beside PLAN names, or TRUTH: the same place in another file, finer than the proxy for example. A path that \
    comes too near to TRUTH is told in a note. With --out it writes quality.json and quality.svg.\n\nExamples:\n  \
    overfly evaluate flights/town/plan.json\n  overfly evaluate plan.json --truth town-lod22.city.json --images selected --out quality"
)]
pub struct EvaluateArgs {
    /// A plan.json
    pub plan: PathBuf,
    /// Scene file to hold the plan against [default: the scene file that the plan was made on]
    #[arg(long, value_name = "SCENE")]
    pub truth: Option<PathBuf>,
    /// Folder for quality.json and quality.svg; without it only the figures are printed
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Which images are used
    #[arg(long, value_enum, default_value_t = ImageChoice::All)]
    pub images: ImageChoice,
    /// Target number of samples of the scene [default: the setting quality.samples, 20000]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = values::count)]
    pub samples: Option<u32>,
    /// TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// Which images of a plan are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ImageChoice {
    /// Every image of the flight
    All,
    /// Those that the post-selection keeps for the reconstruction
    Selected,
}

/// What is to be planned.
#[derive(Debug, Clone, Args)]
pub struct OrderArgs {
    /// Cameras of the drone: panoramic, phantom4-rtk, m300-oblique, mavic3e, or a rig file (its name ends with .toml or holds a `/`)
    #[arg(long, value_name = "PRESET|RIG.toml", default_value = "panoramic")]
    pub rig: String,
    /// Planning method: `refined` (the paper's tree, then local search), `paper`, or a baseline: `op` (oblique photography), `smith` (after
    /// Smith 2018), `zhou` (after Zhou 2020)
    #[arg(long, value_name = "NAME", default_value = "refined")]
    pub method: String,
    /// Seed of the search: the same seed gives the same plan
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = values::seed)]
    pub seed: u64,
    /// Rounds of `refined` [default: as many as the scene is large, the setting refine.rounds], or iterations of the tree search of `paper`
    /// [default: the setting search.iterations, 400]
    #[arg(long, value_name = "K", allow_negative_numbers = true, value_parser = values::count)]
    pub iterations: Option<u32>,
    /// For `refined`, in place of iterations: about how long the search may take, s. The answer tells how many rounds these were
    /// (`iterations`); the same number gives the same plan again
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, conflicts_with = "iterations", value_parser = values::seconds)]
    pub budget: Option<f64>,
    /// Coverage goal, percent of what the rig can capture at all [default: the setting coverage.goal_percent, 95]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, value_parser = values::percent)]
    pub coverage: Option<f64>,
    /// For `refined`: share of the surface, of what can be seen so at all, that is to be seen in enough views that match (by default three,
    /// 5 to 45 degrees apart), percent; 0 asks for none [default: the coverage goal]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, value_parser = values::percent)]
    pub matched: Option<f64>,
    /// What `refined` improves the flight for: `time` (the least time at the goals) or `eq6` (the most of the paper's objective of
    /// information, efficiency and turning, without goals)
    #[arg(long, value_name = "NAME", default_value = "time", value_parser = ["time", "eq6"])]
    pub objective: String,
    /// For `refined`, in place of a goal: the most coverage within this flight time, s
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, conflicts_with_all = ["coverage", "matched"], value_parser = values::seconds)]
    pub max_time: Option<f64>,
    /// Ground sampling distance that an image must have to count, m: nearer views are planned [default: whatever the range of the coverage
    /// model gives]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, value_parser = values::metres)]
    pub gsd: Option<f64>,
    /// For `refined` and `paper`: forward overlap, the share of an image that the next one of the same camera shows as well, percent above 0 and
    /// below 100. It holds for a flat surface seen frontally from where an image has the ground sampling distance of `--gsd` (else from the geometric
    /// mean of safety distance and range of sight) and a camera that moves parallel to the shorter side of its image; for all images of the flight,
    /// not for those that are selected for the reconstruction. The flight cruises more slowly where the shutter needs it (`cruise_mps`)
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, value_parser = values::percent)]
    pub overlap: Option<f64>,
    /// Area whose surfaces are to be captured: corners in metres east and north of the scene's origin [default: the whole scene]
    #[arg(long, value_name = "\"X,Y X,Y X,Y\"", allow_hyphen_values = true)]
    pub region: Option<Outline>,
    /// Start of the flight, for the methods `refined` and `paper`; the others begin where their tour does: metres east, north, up in the scene's local frame [default: the viewpoint that captures most on its own]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub start: Option<Meters3>,
    /// Where the camera looks at the start, or at the pose, for a rig with a gimbal: azimuth clockwise from north and pitch up from the horizon, degrees
    /// [default: the direction that captures most]
    #[arg(long, value_name = "AZIMUTH,PITCH", allow_hyphen_values = true)]
    pub look: Option<Degrees2>,
}

/// How fine the field is.
#[derive(Debug, Clone, Args)]
pub struct SizeArgs {
    /// Only for a file: target number of surface samples [default: the setting surface.samples, 1200]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = values::count)]
    pub samples: Option<u32>,
    /// Only for a file: target number of viewpoints [default: the setting field.viewpoints, 1500]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = values::count)]
    pub viewpoints: Option<u32>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "With --out each plan is written as revision-R-seed-S.json, revision-R-seed-S.svg and revision-R-seed-S-run.json.\n\nExample:\n  overfly watch town --count 3 --json"
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

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  overfly generate --seed 7 --out block.geojson && overfly plan block.geojson")]
pub struct GenerateArgs {
    /// Seed of the block
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = values::seed)]
    pub seed: u64,
    /// Size of the block, m east and north; `428,302` with `--buildings 84 --tallest 95 --built 0.2` stands for the paper's scene NY-1
    #[arg(long, value_name = "X,Y", default_value = "300,300")]
    pub extent: Meters2,
    /// Number of building lots
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = values::count)]
    pub buildings: u32,
    /// Height of the tallest tower, m
    #[arg(long, value_name = "M", default_value_t = 90.0, value_parser = values::metres)]
    pub tallest: f64,
    /// Share of the lots that are built on
    #[arg(long, value_name = "SHARE", default_value_t = 1.0)]
    pub built: f64,
    /// File to write [default: standard output]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// How far boundaries are dilated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BoundaryDegree {
    /// Not at all
    Original,
    /// 1 m
    Minor,
    /// 2 m
    Medium,
    /// 4 m
    Rough,
}

impl From<BoundaryDegree> for Boundary {
    fn from(degree: BoundaryDegree) -> Self {
        match degree {
            BoundaryDegree::Original => Self::Original,
            BoundaryDegree::Minor => Self::Minor,
            BoundaryDegree::Medium => Self::Medium,
            BoundaryDegree::Rough => Self::Rough,
        }
    }
}

#[derive(Debug, Args)]
#[command(
    after_help = "Structures keep their names and ids. Warns when the proxy is wrong by more than `flight.safety_distance_m`. Meshes are written as \
    the prism over their outline.\n\nExample:\n  overfly degrade town.geojson --heights 20 --boundary medium --out rough-town.geojson"
)]
pub struct DegradeArgs {
    /// Scene file
    pub file: PathBuf,
    /// Each height is off by up to so much, percent (0 to 90)
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, allow_negative_numbers = true, value_parser = values::height_percent)]
    pub heights: f64,
    /// How far boundaries are moved outward
    #[arg(long, value_enum, value_name = "DEGREE", default_value = "original")]
    pub boundary: BoundaryDegree,
    /// Seed of the heights
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = values::seed)]
    pub seed: u64,
    /// GeoJSON file to write
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "A rig is the cameras of a drone. A file of the same form describes another one; its comments say what the keys mean.\n\n\
    Example:\n  overfly rigs phantom4-rtk > my-drone.toml   # change focal length, sensor, gimbal, battery\n  overfly plan town.geojson --rig my-drone.toml"
)]
pub struct RigsArgs {
    /// Print the rig file of this preset
    pub name: Option<String>,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn coordinates_may_start_with_a_minus() {
        let line = ["overfly", "plan", "town", "--start", "-10,-4.5,30"];
        let Command::Plan(plan) = Arguments::try_parse_from(line).unwrap().command else { panic!("another command") };
        assert_eq!(plan.order.start, Some(Meters3([-10.0, -4.5, 30.0])));
    }
}
