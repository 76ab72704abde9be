//! What can be said on the command line.

mod course;
mod edit;
mod export;
mod fly;
mod making;
mod measuring;
mod planning;
mod reading;
mod serving;
mod shell;
mod view;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

pub use self::edit::{Change, EditArgs, ShapeArgs, UpdateArgs};
pub use self::export::{ExportArgs, Format};
pub use self::fly::FlyArgs;
pub use self::making::{DegradeArgs, GenerateArgs};
pub use self::measuring::{BenchArgs, BoundArgs, ReproduceArgs, Subject};
pub use self::planning::{EvaluateArgs, ImageChoice, OrderArgs, PlanArgs, SizeArgs};
pub use self::reading::{InspectArgs, ReadArgs};
pub use self::serving::{LoadArgs, Reach, SceneArgs, ServeArgs, StatusArgs, WatchArgs};
pub use self::shell::{CompletionsArgs, ManArgs};
pub use self::view::ViewArgs;
use super::values;

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
    /// Print what lets a shell complete commands and options
    Completions(CompletionsArgs),
    /// Print a manual page, or write those of all commands
    Man(ManArgs),
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
    use crate::cli::values::Meters3;

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
