//! Coordinates as they are typed.

use std::str::FromStr;

/// Two lengths, `DX,DY`, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meters2(pub [f64; 2]);

/// A position, `X,Y,Z`, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meters3(pub [f64; 3]);

/// Corners, `x,y x,y x,y`, m.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline(pub Vec<[f64; 2]>);

/// Why a value cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ValueError {
    #[error("{text:?} holds {found} numbers; give {expected}, separated by commas and without spaces, such as {example}")]
    Count { text: String, found: usize, expected: usize, example: &'static str },
    #[error("{0:?} is not a number of metres")]
    Number(String),
    #[error("an outline needs at least three corners, such as \"0,0 8,0 8,8 0,8\"")]
    TooFewCorners,
}

impl FromStr for Meters2 {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        numbers(text, "12.5,-3").map(Self)
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

fn numbers<const COUNT: usize>(text: &str, example: &'static str) -> Result<[f64; COUNT], ValueError> {
    let values: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    let found = values.len();
    values.try_into().map_err(|_| ValueError::Count { text: text.to_owned(), found, expected: COUNT, example })
}

fn number(text: &str) -> Result<f64, ValueError> {
    let value = text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| ValueError::Number(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert!(matches!("1,2".parse::<Meters3>(), Err(ValueError::Count { found: 2, expected: 3, .. })));
    }
}
