//! What can be said of how a scene file is read.

use std::path::PathBuf;

use clap::Args;
use overfly_client::ReadOrder;

use crate::cli::values::Meters3;

/// How a scene file is read where it does not say so itself, or says it wrongly.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "How the scene file is read")]
pub struct ReadArgs {
    /// Only for a GeoTIFF surface model (DSM): the model of its ground (DTM), a GeoTIFF too [default: the file beside it with `dtm` for `dsm` in its name,
    /// else a guess]
    #[arg(long, value_name = "FILE")]
    pub dtm: Option<PathBuf>,
    /// Reference system of the file's coordinates, EPSG code (28992, 7415, 25830, 32631 ...); 0 for what the file says [default: the setting proxy.epsg, 0]
    #[arg(long, value_name = "CODE")]
    pub epsg: Option<u32>,
    /// Axis of a mesh that points up; `file` means y in glTF and z in OBJ, PLY and STL [default: the setting proxy.up, file]
    #[arg(long, value_name = "AXIS", value_parser = ["y", "z", "file"])]
    pub up: Option<String>,
    /// Metres in a unit of a mesh: 0.3048 for feet, 0.001 for millimetres [default: the setting proxy.unit_m, 1]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub unit: Option<f64>,
    /// Added to a mesh's coordinates, m, for a file whose origin was shifted away from its grid's [default: the setting proxy.offset_m, 0,0,0]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub offset: Option<Meters3>,
    /// Highest level of detail of CityJSON that is read, such as 1.2; 0 for the highest that there is [default: the setting proxy.lod, 0]
    #[arg(long, value_name = "LEVEL", allow_negative_numbers = true)]
    pub lod: Option<f64>,
    /// A building without height and storeys is as tall as its `neighbours` (their median, else the constant), has a `constant` height, or is left out
    /// (`drop`) [default: the setting proxy.missing_heights, neighbours]
    #[arg(long, value_name = "POLICY", value_parser = ["neighbours", "constant", "drop"])]
    pub missing_heights: Option<String>,
    /// The constant, m [default: the setting proxy.default_height_m, 10]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub default_height: Option<f64>,
}

impl ReadArgs {
    pub fn order(&self) -> ReadOrder {
        ReadOrder {
            epsg: self.epsg,
            up: self.up.clone(),
            unit_m: self.unit,
            offset_m: self.offset.map(|offset| offset.0),
            lod: self.lod,
            missing_heights: self.missing_heights.clone(),
            default_height_m: self.default_height,
        }
    }
}

#[derive(Debug, Args)]
#[command(
    after_help = "Says what is in a scene file, what was repaired, guessed and left out, item by item, and draws it: with --out inspect.json and inspect.svg. \
    Formats: GeoJSON, OpenStreetMap PBF, CityJSON and CityJSON sequences, OBJ, PLY, STL, glTF, GeoTIFF, LAS and LAZ.\n\nExamples:\n  overfly inspect town.osm.pbf --out report\n  \
    overfly inspect town.geojson --missing-heights drop\n  overfly inspect scan.glb --up z --unit 0.3048\n  \
    overfly inspect hall.ply --epsg 28992 --offset 90759,435665,0"
)]
pub struct InspectArgs {
    /// Scene file
    pub file: PathBuf,
    /// Folder for inspect.json and inspect.svg; without it the report is only printed
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print every item, not only the first of each kind
    #[arg(long)]
    pub all: bool,
    #[command(flatten)]
    pub read: ReadArgs,
    /// TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}
