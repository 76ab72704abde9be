//! What can be said of pages.

use std::path::PathBuf;

use clap::Args;

#[derive(Debug, Args)]
#[command(
    after_help = "Writes one HTML file that needs nothing else, no network either: it can be sent to whoever shall see the plan. It shows the scene, the flight and what is captured when, \
    on its own or against OTHER: what only one of them captures, and structures that differ.\n\n\
    The scene is the file that the run.json beside PLAN names, read with the settings that stand there, or `--scene`. \
    Without one the page that came with the plan is shown, or the plan alone.\n\n\
    `overfly plan --out DIR` writes such a page already (plan.html).\n\nExamples:\n  overfly view flights/town/plan.json\n  \
    overfly view replan.json plan.json\n  overfly view plan.json --scene town.city.json --out town.html --no-open"
)]
pub struct ViewArgs {
    /// A plan.json
    pub plan: PathBuf,
    /// Another plan.json to compare it with
    pub other: Option<PathBuf>,
    /// Scene file [default: the scene file that each plan was made on]
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// HTML file to write [default: PLAN.html beside the plan, or PLAN-vs-OTHER.html]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Write the file and open no browser
    #[arg(long)]
    pub no_open: bool,
    /// TOML file whose keys replace the built-in values [default: the settings that each plan was made with]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}
