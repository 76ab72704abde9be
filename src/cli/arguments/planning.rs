//! What can be said of plans: what is ordered, and what a finished one is held against.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::{Reach, ReadArgs};
use crate::cli::en_route::EnRouteArgs;
use crate::cli::values::{self, Degrees2, Meters3, Outline};

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
    /// For `refined`, in place of iterations: about how long the search may take, s, beyond the fewest rounds that make a flight. The answer tells how
    /// many rounds these were (`iterations`); the same number gives the same plan again
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
