//! Colour ramps. Each runs monotonically in lightness, so that it survives grey printing and every kind of colour blindness.

/// A ramp by its stops, dark or light first, as sRGB bytes at equal steps.
pub struct Ramp(&'static [[u8; 3]]);

/// Time along the flight: violet over magenta to amber. The stops follow the perceptually uniform ramp "plasma" without its palest end,
/// which would vanish on white.
pub const TIME: Ramp = Ramp(&[
    [0x3b, 0x04, 0x9a],
    [0x6a, 0x00, 0xa8],
    [0x98, 0x18, 0x9e],
    [0xbf, 0x39, 0x84],
    [0xdc, 0x5d, 0x68],
    [0xf2, 0x83, 0x4c],
    [0xfc, 0xb0, 0x31],
]);

/// Height of a building: warm light grey to mid grey, pale enough for everything that is drawn on it.
pub const HEIGHT: Ramp = Ramp(&[[0xf0, 0xee, 0xea], [0xd8, 0xd6, 0xd3], [0xbd, 0xbc, 0xbb], [0x9f, 0xa0, 0xa2]]);

/// Captured share of a wall: white (hollow, nothing captured) to deep teal (full).
pub const SHARE: Ramp = Ramp(&[
    [0xff, 0xff, 0xff],
    [0xc9, 0xea, 0xe2],
    [0x85, 0xcb, 0xbf],
    [0x3c, 0xa2, 0x98],
    [0x0f, 0x76, 0x71],
    [0x00, 0x4d, 0x4c],
]);

/// Predicted deviation, small to large: dark violet over green to yellow, after the perceptually uniform ramp "viridis" without its palest
/// end.
pub const DEVIATION: Ramp = Ramp(&[
    [0x44, 0x01, 0x54],
    [0x41, 0x44, 0x87],
    [0x2a, 0x78, 0x8e],
    [0x22, 0xa8, 0x84],
    [0x7a, 0xd1, 0x51],
    [0xe3, 0xd6, 0x2a],
]);

/// What is seen and not reconstructed, and what no image sees.
pub const NOT_RECONSTRUCTED: &str = "#e0876f";
pub const NOT_SEEN: &str = "#a3172c";

pub const INK: &str = "#16191d";
pub const QUIET_INK: &str = "#5f656d";
pub const HAIRLINE: &str = "#d9dbde";
pub const GRID: &str = "#ecedef";
pub const PAPER: &str = "#ffffff";
pub const GROUND: &str = "#fbfbfa";
/// Ground of one height, its numbers, and seen from the side hills and what lies below all ground.
pub const CONTOUR: &str = "#b59a72";
pub const CONTOUR_INK: &str = "#7d6238";
pub const HILLS: &str = "#f4eee3";
pub const SOIL: &str = "#e6dac5";
/// A roof without exposed samples, where roofs are filled by share.
pub const NOT_EXPOSED: &str = "#e3e2df";
pub const OUTLINE: &str = "#74777c";
pub const WALL_CASING: &str = "#33373c";
/// What no admissible view can capture.
pub const BEYOND_REACH: &str = "#c8442b";

/// A flight on its way: what was flown, what is ahead, what has just changed in the scene, and where nobody may fly.
pub const FLOWN: &str = "#8d9299";
pub const AHEAD: &str = "#3b049a";
pub const NEW: &str = "#f2834c";
pub const ZONE: &str = BEYOND_REACH;

impl Ramp {
    /// The colour at `share` of the ramp, 0 to 1; values outside are clamped.
    pub fn at(&self, share: f64) -> String {
        let Self(stops) = self;
        let position = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let below = (position as usize).min(stops.len() - 2);
        let weight = position - below as f64;
        let [red, green, blue] = [0, 1, 2].map(|channel| {
            let (from, to) = (f64::from(stops[below][channel]), f64::from(stops[below + 1][channel]));
            (from + (to - from) * weight).round() as u8
        });
        format!("#{red:02x}{green:02x}{blue:02x}")
    }

    /// The colour at `share` of the ramp, mixed with white by `paleness`, 0 (the colour itself) to 1 (white).
    pub fn paler(&self, share: f64, paleness: f64) -> String {
        mix_with_white(&self.at(share), paleness)
    }

    /// The stops as `(offset, colour)`, for a gradient in a legend.
    pub fn stops(&self) -> impl Iterator<Item = (f64, String)> + '_ {
        let last = (self.0.len() - 1) as f64;
        (0..self.0.len()).map(move |index| (index as f64 / last, self.at(index as f64 / last)))
    }
}

/// An sRGB colour `#rrggbb` mixed with white.
pub fn mix_with_white(colour: &str, paleness: f64) -> String {
    let channel = |at: usize| {
        let value = colour.get(at..at + 2).and_then(|digits| u8::from_str_radix(digits, 16).ok()).unwrap_or(0xff);
        (f64::from(value) + (255.0 - f64::from(value)) * paleness.clamp(0.0, 1.0)).round() as u8
    };
    format!("#{:02x}{:02x}{:02x}", channel(1), channel(3), channel(5))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lightness(colour: &str) -> f64 {
        let channel = |range| f64::from(u8::from_str_radix(&colour[range], 16).unwrap());
        0.2126 * channel(1..3) + 0.7152 * channel(3..5) + 0.0722 * channel(5..7)
    }

    #[test]
    fn every_ramp_changes_lightness_in_one_direction() {
        for ramp in [TIME, HEIGHT, SHARE, DEVIATION] {
            let steps: Vec<f64> = (0..=50).map(|step| lightness(&ramp.at(f64::from(step) / 50.0))).collect();
            let rising = steps[50] > steps[0];
            for pair in steps.windows(2) {
                assert!((pair[1] - pair[0]).abs() < 1e-9 || (pair[1] > pair[0]) == rising, "{steps:?}");
            }
        }
    }

    #[test]
    fn mixing_with_white_runs_from_the_colour_to_white() {
        assert_eq!(mix_with_white("#004080", 0.0), "#004080");
        assert_eq!(mix_with_white("#004080", 0.5), "#80a0c0");
        assert_eq!(mix_with_white("#004080", 1.0), "#ffffff");
    }

    #[test]
    fn shares_outside_of_the_ramp_take_its_ends() {
        assert_eq!(SHARE.at(-3.0), "#ffffff");
        assert_eq!(SHARE.at(7.0), "#004d4c");
        assert_eq!(SHARE.at(f64::NAN).len(), 7);
    }
}
