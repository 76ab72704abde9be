//! Coordinates as they are typed.

use std::str::FromStr;

use crate::planner::MOST_BUDGET_S;
use crate::reproduction::MOST_SEEDS;
use crate::scene::degrade::MOST_HEIGHT_PERCENT;

/// Two lengths, `DX,DY`, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meters2(pub [f64; 2]);

/// Azimuth and pitch, `AZIMUTH,PITCH`, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Degrees2(pub [f64; 2]);

/// A position, `X,Y,Z`, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meters3(pub [f64; 3]);

/// Corners, `x,y x,y x,y`, m.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline(pub Vec<[f64; 2]>);

/// Largest count of samples, viewpoints, iterations or rounds.
const MOST: u32 = 10_000_000;

/// Waypoints of a bound's graph.
const MOST_WAYPOINTS: u32 = 1000;

/// Largest size of a coordinate, m, or of an angle, degrees: no scene reaches farther.
const MOST_SIZE: f64 = 1e7;

/// Why a value cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ValueError {
    #[error("{text:?} holds {found} number{plural}; give {expected}, separated by commas and without spaces, such as {example}", plural = if *found == 1 { "" } else { "s" })]
    Count { text: String, found: usize, expected: usize, example: &'static str },
    #[error("{0:?} is not a number")]
    Number(String),
    #[error("{0:?} is too large; give a number of at most ten million in size")]
    TooLarge(String),
    #[error("{text:?} will not do; give a whole number from {least} to {most}")]
    WholeNumber { text: String, least: u64, most: u64 },
    #[error("{0:?} is no direction; give an azimuth from -360 to 360 and a pitch from -90 to 90 degrees")]
    Direction(String),
    #[error("{text:?} will not do; give a number of percent from 0 to {most}")]
    Percent { text: String, most: f64 },
    #[error("{text:?} will not do; give a number of seconds above 0, at most {most}")]
    Seconds { text: String, most: f64 },
    #[error("an outline needs at least three corners, such as \"0,0 8,0 8,8 0,8\"")]
    TooFewCorners,
}

impl std::fmt::Display for Outline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let corners: Vec<String> = self.0.iter().map(|[x, y]| format!("{x},{y}")).collect();
        f.write_str(&corners.join(" "))
    }
}

impl FromStr for Meters2 {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        numbers(text, "12.5,-3").map(Self)
    }
}

impl FromStr for Degrees2 {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let [azimuth_deg, pitch_deg] = numbers(text, "135,-30")?;
        let fits = azimuth_deg.abs() <= 360.0 && pitch_deg.abs() <= 90.0;
        if fits { Ok(Self([azimuth_deg, pitch_deg])) } else { Err(ValueError::Direction(text.to_owned())) }
    }
}

impl FromStr for Meters3 {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        numbers(text, "10,-40,35").map(Self)
    }
}

impl FromStr for Outline {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let corners: Vec<[f64; 2]> = text.split_whitespace().map(|corner| numbers(corner, "8,0")).collect::<Result<_, _>>()?;
        if corners.len() < 3 { Err(ValueError::TooFewCorners) } else { Ok(Self(corners)) }
    }
}

/// A number of metres.
pub fn metres(text: &str) -> Result<f64, ValueError> {
    number(text)
}

/// By how much heights are off, percent.
pub fn height_percent(text: &str) -> Result<f64, ValueError> {
    let percent = text.trim().parse().ok().filter(|percent| (0.0..=MOST_HEIGHT_PERCENT).contains(percent));
    percent.ok_or_else(|| ValueError::Percent { text: text.to_owned(), most: MOST_HEIGHT_PERCENT })
}

/// A share, percent.
pub fn percent(text: &str) -> Result<f64, ValueError> {
    let percent = text.trim().parse().ok().filter(|percent| (0.0..=100.0).contains(percent));
    percent.ok_or_else(|| ValueError::Percent { text: text.to_owned(), most: 100.0 })
}

/// A time, s.
pub fn seconds(text: &str) -> Result<f64, ValueError> {
    let seconds = text.trim().parse().ok().filter(|seconds| *seconds > 0.0 && *seconds <= MOST_BUDGET_S);
    seconds.ok_or_else(|| ValueError::Seconds { text: text.to_owned(), most: MOST_BUDGET_S })
}

/// How many of something, from 1 to ten million.
pub fn count(text: &str) -> Result<u32, ValueError> {
    let count = text.trim().parse().ok().filter(|count| (1..=MOST).contains(count));
    count.ok_or_else(|| ValueError::WholeNumber { text: text.to_owned(), least: 1, most: MOST.into() })
}

/// How many waypoints a graph has: the work grows with the square of their number and more.
pub fn waypoints(text: &str) -> Result<u32, ValueError> {
    let waypoints = text.trim().parse().ok().filter(|waypoints| (2..=MOST_WAYPOINTS).contains(waypoints));
    waypoints.ok_or_else(|| ValueError::WholeNumber { text: text.to_owned(), least: 2, most: MOST_WAYPOINTS.into() })
}

/// How many seeds.
pub fn seeds(text: &str) -> Result<u32, ValueError> {
    let seeds = text.trim().parse().ok().filter(|seeds| (1..=MOST_SEEDS).contains(seeds));
    seeds.ok_or_else(|| ValueError::WholeNumber { text: text.to_owned(), least: 1, most: MOST_SEEDS.into() })
}

/// A seed, or how many plans.
pub fn seed(text: &str) -> Result<u64, ValueError> {
    text.trim().parse().map_err(|_| ValueError::WholeNumber { text: text.to_owned(), least: 0, most: u64::MAX })
}

fn numbers<const COUNT: usize>(text: &str, example: &'static str) -> Result<[f64; COUNT], ValueError> {
    let values: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    let found = values.len();
    values.try_into().map_err(|_| ValueError::Count { text: text.to_owned(), found, expected: COUNT, example })
}

fn number(text: &str) -> Result<f64, ValueError> {
    let value = text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
    let value = value.ok_or_else(|| ValueError::Number(text.to_owned()))?;
    if value.abs() <= MOST_SIZE { Ok(value) } else { Err(ValueError::TooLarge(text.to_owned())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_seeds_are_refused_in_plain_words() {
        for text in ["0", "-3", "10000001", "many", "1.5", ""] {
            assert!(count(text).unwrap_err().to_string().ends_with("give a whole number from 1 to 10000000"), "{text}");
        }
        assert_eq!((count("10000000"), seed("0")), (Ok(10_000_000), Ok(0)));
        assert!(seed("-1").is_err());
    }

    #[test]
    fn heights_are_off_by_at_most_ninety_percent() {
        assert_eq!((height_percent("0"), height_percent("90")), (Ok(0.0), Ok(90.0)));
        for text in ["-1", "90.1", "nan", "inf", "ten", ""] {
            assert!(height_percent(text).unwrap_err().to_string().ends_with("give a number of percent from 0 to 90"), "{text}");
        }
    }

    #[test]
    fn times_and_shares_are_refused_in_plain_words() {
        assert_eq!((seconds("0.5"), percent("0"), percent("100")), (Ok(0.5), Ok(0.0), Ok(100.0)));
        for text in ["0", "-1", "nan", "inf", "1e6", "soon"] {
            assert!(seconds(text).unwrap_err().to_string().ends_with("above 0, at most 86400"), "{text}");
        }
        assert!(percent("100.5").is_err() && percent("-1").is_err() && percent("nan").is_err());
    }

    #[test]
    fn an_outline_is_a_list_of_corners() {
        assert_eq!("0,0 8.5,0  -8,1e1".parse(), Ok(Outline(vec![[0.0, 0.0], [8.5, 0.0], [-8.0, 10.0]])));
        assert_eq!("0,0 1,1".parse::<Outline>(), Err(ValueError::TooFewCorners));
    }

    #[test]
    fn what_is_not_a_finite_number_is_refused_by_name() {
        for text in ["1,x,3", "1,,3", "nan,1,2", "inf,1,2"] {
            assert!(matches!(text.parse::<Meters3>(), Err(ValueError::Number(_))), "{text}");
        }
        assert_eq!("abc".parse::<Degrees2>().unwrap_err().to_string(), "\"abc\" is not a number");
        assert_eq!("1e300,0,40".parse::<Meters3>(), Err(ValueError::TooLarge("1e300".to_owned())));
        assert!(matches!("1,2".parse::<Meters3>(), Err(ValueError::Count { found: 2, expected: 3, .. })));
    }
}
