//! What can be said of files for other programs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::ImageChoice;
use super::course::CourseArgs;
use crate::mission::mav_items::Autopilot;

/// A file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, ValueEnum)]
pub enum Format {
    /// All that the plan allows
    All,
    /// QGroundControl mission with geofence and rally points (NAME-1.plan, one for each sortie)
    Qgc,
    /// ArduPilot and Mission Planner (NAME-1.waypoints)
    Ardupilot,
    /// DJI Pilot 2 and docks, WPML (NAME-1.kmz)
    Dji,
    /// Litchi mission (NAME-1-litchi.csv)
    Litchi,
    /// Path, waypoints and images for Google Earth (NAME.kml)
    Kml,
    /// Path, waypoints and images (NAME.geojson)
    Geojson,
    /// Tables of images and waypoints (NAME-images.csv, NAME-waypoints.csv)
    Csv,
    /// Poses as a COLMAP text model in the local frame (NAME-colmap/)
    Colmap,
    /// Poses as a RealityCapture flight log (NAME-realitycapture.csv)
    Realitycapture,
    /// Poses as a Metashape reference (NAME-metashape.csv)
    Metashape,
    /// What each image shows of flat ground (NAME-footprints.geojson)
    Footprints,
    /// Surface coloured by what is captured, as points (NAME-coverage.ply)
    CoveragePly,
    /// The same as small discs for 3D viewers (NAME-coverage.glb)
    CoverageGlb,
}

/// Whose dialect of MAVLink a `.plan` speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AutopilotChoice {
    Px4,
    Ardupilot,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Missions are divided into sorties, one for each battery: each climbs at the take-off place to a height above everything, goes to where the one before \
    has ended, sets speed, camera trigger and gimbal, and comes home the same way. The battery is what the plan's rig has (`battery_percent`), or `--sortie-time`.\n\n\
    The scene is the file that the run.json beside PLAN names, or `--scene`, with the settings in that run.json, or those of `--config`; \
    without a scene nothing is known of structures and no-fly zones on the ways out and home, and the take-off place is taken to lie at its \
    zero, the lowest ground (`--home LAT,LON,ALT` gives its height). With it, these ways lead around no-fly zones, zones beside the flight \
    become a geofence, and a way that something stands in is refused.\n\n\
    Absolute heights start from `origin.alt_m` of the plan, the ground's height in the vertical reference of the scene's file (0 where the file has none); no geoid is \
    applied. Heights above the terrain (`--altitude terrain`) are those above the ground of the scene; an ArduPilot counts them from its own terrain data, Litchi from its own for \
    each waypoint, and where the ground between two waypoints would lead an aircraft more than half a metre from the straight leg, ArduPilot's missions have waypoints in \
    between. Ways out and home, and take-off, keep to heights above the take-off place. PX4 has no such missions. DJI's aircraft fly heights above the take-off place always, \
    Litchi's as well with absolute heights.\n\n\
    Images are called CAMERA_NNNNNN.jpg: the camera's name, and how many images that camera has taken. Rename yours so, in the order in which they were taken, and they match.\n\n\
    A plan without georeference (of an OBJ scene) gives csv, colmap, realitycapture, metashape and the coverage models, in metres of its local frame.\n\n\
    Examples:\n  overfly export flights/town/plan.json --to qgc --out missions\n  \
    overfly export plan.json --to ardupilot --to csv --home 52.0110,4.3560 --reserve 30 --out missions\n  \
    overfly export plan.json --to dji --sortie-time 1200 --out missions\n  \
    overfly export plan.json --to colmap --images selected --out priors\n  overfly export plan.json --to all --scene town.geojson --out everything --json"
)]
pub struct ExportArgs {
    /// A plan.json
    pub plan: PathBuf,
    /// Format to write; may be given several times
    #[arg(long = "to", value_enum, value_name = "FORMAT", required = true)]
    pub formats: Vec<Format>,
    /// Folder for the files; it is created
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub course: CourseArgs,
    /// Autopilot that a `.plan` is for; `.waypoints` are for ArduPilot always
    #[arg(long, value_enum, default_value_t = AutopilotChoice::Px4)]
    pub autopilot: AutopilotChoice,
    /// Which images tables, poses and footprints hold; numbers count all
    #[arg(long, value_enum, default_value_t = ImageChoice::All)]
    pub images: ImageChoice,
}

impl From<AutopilotChoice> for Autopilot {
    fn from(choice: AutopilotChoice) -> Self {
        match choice {
            AutopilotChoice::Px4 => Self::Px4,
            AutopilotChoice::Ardupilot => Self::ArduPilot,
        }
    }
}
