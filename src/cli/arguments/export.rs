//! What can be said of files for other programs.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use super::ImageChoice;
use crate::cli::values;
use crate::mission::course::{Altitudes, HomeChoice};
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

/// From where the heights of a mission count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AltitudeChoice {
    /// The take-off place
    Relative,
    /// The zero of the scene's vertical reference, taken for mean sea level
    Absolute,
}

/// A take-off place, `LAT,LON` or `LAT,LON,ALT`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HomeText(pub HomeChoice);

#[derive(Debug, Args)]
#[command(
    after_help = "Missions are divided into sorties, one for each battery: each climbs at the take-off place to a height above everything, goes to where the one before \
    has ended, sets speed, camera trigger and gimbal, and comes home the same way. The battery is what the plan's rig has (`battery_percent`), or `--sortie-time`.\n\n\
    The scene is the file that the run.json beside PLAN names, or `--scene`; without one nothing is known of structures and no-fly zones on the ways out and home. With it, no-fly \
    zones beside the flight become a geofence, and a way that something stands in is refused.\n\n\
    Absolute heights start from `origin.alt_m` of the plan, the ground's height in the vertical reference of the scene's file (0 where the file has none); no geoid is \
    applied. Files of DJI and Litchi have heights above the take-off place always.\n\n\
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
    /// Scene file [default: the scene file that the plan was made on]
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Take-off place: latitude, longitude, and height of its ground in the scene's vertical reference [default: free ground under or near the first waypoint]
    #[arg(long, value_name = "LAT,LON[,ALT]", allow_hyphen_values = true)]
    pub home: Option<HomeText>,
    /// Share of a battery that is left at landing, percent
    #[arg(long, value_name = "PERCENT", default_value_t = 25.0, allow_negative_numbers = true, value_parser = values::percent)]
    pub reserve: f64,
    /// Time of a sortie from take-off to landing, s, in place of what the battery gives
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = values::seconds)]
    pub sortie_time: Option<f64>,
    /// From where heights count
    #[arg(long, value_enum, default_value_t = AltitudeChoice::Relative)]
    pub altitude: AltitudeChoice,
    /// Autopilot that a `.plan` is for; `.waypoints` are for ArduPilot always
    #[arg(long, value_enum, default_value_t = AutopilotChoice::Px4)]
    pub autopilot: AutopilotChoice,
    /// Which images tables, poses and footprints hold; numbers count all
    #[arg(long, value_enum, default_value_t = ImageChoice::All)]
    pub images: ImageChoice,
    /// TOML file whose keys replace the built-in values
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

impl From<AutopilotChoice> for Autopilot {
    fn from(choice: AutopilotChoice) -> Self {
        match choice {
            AutopilotChoice::Px4 => Self::Px4,
            AutopilotChoice::Ardupilot => Self::ArduPilot,
        }
    }
}

impl From<AltitudeChoice> for Altitudes {
    fn from(choice: AltitudeChoice) -> Self {
        match choice {
            AltitudeChoice::Relative => Self::Relative,
            AltitudeChoice::Absolute => Self::Absolute,
        }
    }
}

impl FromStr for HomeText {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?} is no place; give latitude, longitude and perhaps a height in metres, such as 52.0116,4.3571 or 52.0116,4.3571,3.5"
            )
        };
        let numbers: Vec<f64> = text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().map_err(|_| wrong())?;
        let (lat_deg, lon_deg, alt_m) = match numbers[..] {
            [lat_deg, lon_deg] => (lat_deg, lon_deg, None),
            [lat_deg, lon_deg, alt_m] => (lat_deg, lon_deg, Some(alt_m)),
            _ => return Err(wrong()),
        };
        // Written so that NaN is refused too.
        let is_place = lat_deg.abs() <= 90.0 && lon_deg.abs() <= 180.0 && alt_m.is_none_or(|alt_m: f64| alt_m.abs() <= 10_000.0);
        if is_place { Ok(Self(HomeChoice { lat_deg, lon_deg, alt_m })) } else { Err(wrong()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_has_two_or_three_numbers_that_are_on_the_earth() {
        let place = |text: &str| text.parse::<HomeText>().ok().map(|home| (home.0.lat_deg, home.0.lon_deg, home.0.alt_m));
        assert_eq!(place("-52.5,4.25"), Some((-52.5, 4.25, None)));
        assert_eq!(place("52.5, 4.25, -3"), Some((52.5, 4.25, Some(-3.0))));
        for text in ["", "52", "91,4", "52,181", "nan,4", "52,4,inf", "52,4,1,1", "north,4"] {
            assert_eq!(place(text), None, "{text}");
        }
    }
}
