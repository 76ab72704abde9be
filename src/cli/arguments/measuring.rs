//! What can be said of measurements: benchmarks, bounds, and the paper's tables.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::SizeArgs;
use crate::cli::values;

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Subject {
    /// Loading, sampling and building the view information field
    Field,
    /// The tree search
    Search,
    /// Messages and tables between two processes
    Ipc,
    /// From an edit to the first safe plan, between two processes
    Replan,
    /// From an edit to a flight as good as one planned from nothing, and how soon a cancelled search ends
    Warm,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Prints median, p99 and spread (p90 - p10) beside what a prototype reached on two cores of a server processor.\n\n\
    Example:\n  overfly bench field delfshaven.city.json --samples 1600 --viewpoints 2000"
)]
pub struct BenchArgs {
    #[arg(value_enum)]
    pub subject: Subject,
    /// Scene file
    pub file: PathBuf,
    /// How often each step is measured
    #[arg(long, value_name = "N", default_value_t = 9, allow_negative_numbers = true, value_parser = values::count)]
    pub repeat: u32,
    /// For `replan`: edits, a third of them on the flight, a third beside it, a third far off
    #[arg(long, value_name = "N", default_value_t = 60, allow_negative_numbers = true, value_parser = values::count)]
    pub edits: u32,
    /// Iterations of the tree search [default: the setting search.iterations, 400], for `replan` rounds of the refinement [default: 12], for `warm` as well
    /// [default: 120]
    #[arg(long, value_name = "K", allow_negative_numbers = true, value_parser = values::count)]
    pub iterations: Option<u32>,
    /// Cameras of the drone, as for `plan`
    #[arg(long, value_name = "PRESET|RIG.toml", default_value = "panoramic")]
    pub rig: String,
    /// TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub sizes: SizeArgs,
}

#[derive(Debug, Args)]
#[command(
    after_help = "For small scenes: 150 samples and 100 waypoints take one to five minutes; Ctrl-C ends with the best bound so far. The bound is certified in whole numbers, whatever the solver's tolerance, for plans on the graph \
    alone; the answer says what exactly is bounded. A plan on the same graph is made for comparison where an image sees all around. With --out it \
    writes bound.json.\n\nExample:\n  overfly generate --extent 100,100 --buildings 4 --out block.geojson\n  overfly bound block.geojson --samples 150 --viewpoints 200"
)]
pub struct BoundArgs {
    /// Scene file
    pub file: PathBuf,
    /// Cameras of the drone: a preset or a rig file
    #[arg(long, value_name = "PRESET|RIG.toml", default_value = "panoramic")]
    pub rig: String,
    /// Viewpoints of the field that plans may use, spread evenly [default: the setting bound.waypoints, 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = values::waypoints)]
    pub waypoints: Option<u32>,
    /// Rounds of the search for a plan on the graph [default: the setting bound.plan_rounds, 3000]
    #[arg(long, value_name = "K", allow_negative_numbers = true, value_parser = values::count)]
    pub rounds: Option<u32>,
    /// Seed of that search
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = values::seed)]
    pub seed: u64,
    #[command(flatten)]
    pub sizes: SizeArgs,
    /// Folder for bound.json; without it only the figures are printed
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Writes reproduction.md, reproduction.json and the charts (fig9.svg, fig10.svg, convergence.svg, pareto.svg, growth.svg) into the folder of `--out`. Parts: table1, table2, \
    table3, table4, table5, equal, equal-refined, fig9, fig10, convergence, pareto, times, refined, sight, sweep, growth; by default all but equal-refined (hours) and the last three. The seeds are 1, 2, ...; everything but \
    times, refined and growth is the same on every run. Scenes that the folder of `--scenes` does not hold are left out and named.\n\nExamples:\n  overfly reproduce\n  \
    overfly reproduce --only table1,fig9 --out figures\n  overfly reproduce --only sweep --out sweep"
)]
pub struct ReproduceArgs {
    /// Parts to reproduce, separated by commas [default: all but equal-refined, sight, sweep and growth]
    #[arg(long, value_name = "PARTS", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Flights for each row: medians and ranges are of so many seeds
    #[arg(long, value_name = "N", default_value_t = 5, allow_negative_numbers = true, value_parser = values::seeds)]
    pub seeds: u32,
    /// One seed and small sizes: shows whether everything runs, and nothing else
    #[arg(long)]
    pub quick: bool,
    /// Folder that holds the real scenes, each in a folder of its name
    #[arg(long, value_name = "DIR", env = "OVERFLY_SCENES", hide_env_values = true, default_value = "../shared/scenes")]
    pub scenes: PathBuf,
    /// Folder for the results; it is created
    #[arg(long, value_name = "DIR", default_value = "tests/reproduction")]
    pub out: PathBuf,
    /// TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}
