//! What can be said of scene files that are written.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::cli::values::{self, Meters2};
use crate::scene::degrade::Boundary;

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
