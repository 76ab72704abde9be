//! How a plan becomes a course: what exporting and flying it have in common.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use crate::cli::values;
use crate::mission::course::{Altitudes, CourseOptions, HomeChoice};

/// From where the heights of a mission count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AltitudeChoice {
    /// The take-off place
    Relative,
    /// The zero of the scene's vertical reference, taken for mean sea level
    Absolute,
    /// The ground below, as the aircraft's terrain data has it (needs the scene)
    Terrain,
}

/// A take-off place, `LAT,LON` or `LAT,LON,ALT`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HomeText(pub HomeChoice);

#[derive(Debug, Args)]
pub struct CourseArgs {
    /// Scene file, for what is on the ways out and home [default: the scene file that a plan.json was made on]
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Take-off place: latitude, longitude, and height of its ground in the scene's vertical reference [default: where the aircraft stands; not known, free ground
    /// under or near the first waypoint]
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
    /// TOML file whose keys replace the built-in values [default: the settings that a plan.json was made with]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

impl CourseArgs {
    pub fn options(&self) -> CourseOptions {
        CourseOptions {
            reserve_percent: self.reserve,
            sortie_s: self.sortie_time,
            home: self.home.map(|home| home.0),
            altitudes: self.altitude.into(),
            in_flight: false,
        }
    }
}

impl From<AltitudeChoice> for Altitudes {
    fn from(choice: AltitudeChoice) -> Self {
        match choice {
            AltitudeChoice::Relative => Self::Relative,
            AltitudeChoice::Absolute => Self::Absolute,
            AltitudeChoice::Terrain => Self::Terrain,
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
