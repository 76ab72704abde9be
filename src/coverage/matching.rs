//! Views that can be matched with each other: a second measure beside the covered hemisphere, and independent of it.
//!
//! Multi-view stereo pairs two images of a surface when they see it from directions that differ neither too little to triangulate nor too
//! much to be recognised. A sample is reconstructed when enough of its views have a partner; a large covered share of its hemisphere alone
//! does not tell that (`quality.min_parallax_deg`, `quality.max_parallax_deg`, `quality.least_views`).

use multiversion::multiversion;
use nalgebra::{Point3, Vector3};

use crate::settings::QualitySettings;

/// The direction from a sample to a view in whole parts, so that what is equal on one machine is equal on all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bearing([i16; 3]);

/// Parts of a unit: 0.007 degrees.
const PARTS: f64 = 8192.0;

impl Bearing {
    /// From a sample to a view.
    pub fn new(sample: &Point3<f64>, view: &Point3<f64>) -> Self {
        let direction: Vector3<f64> = view - sample;
        let scale = PARTS / direction.norm().max(1e-9);
        // Halves away from zero, without a call: the search makes thousands of these for a change.
        let rounded = |v: f64| (v * scale + if v < 0.0 { -0.5 } else { 0.5 }) as i16;
        Self([rounded(direction.x), rounded(direction.y), rounded(direction.z)])
    }
}

/// Which views match, and how many of them a sample needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Matching {
    squared_chords: [i32; 2],
    pub least_views: u32,
}

impl Matching {
    pub fn new(settings: &QualitySettings) -> Self {
        Self::within(settings, 0.0)
    }

    /// Stricter at both ends of the parallax, by an angle: for views whose places are not exact.
    pub fn within(settings: &QualitySettings, margin_deg: f64) -> Self {
        let QualitySettings { min_parallax_deg, max_parallax_deg, least_views, .. } = *settings;
        let squared_chord = |angle_deg: f64| (2.0 * PARTS * libm::sin(angle_deg.to_radians() / 2.0)).powi(2) as i32;
        // Of a narrow range half is left.
        let margin_deg = margin_deg.min((max_parallax_deg - min_parallax_deg) / 4.0);
        let squared_chords = [min_parallax_deg + margin_deg, max_parallax_deg - margin_deg].map(squared_chord);
        Self { squared_chords, least_views }
    }
}

/// The views of one sample, each with the number of those that it matches; in lanes, so that a view is held against several at once.
#[derive(Clone, Debug, Default)]
pub struct MatchedViews {
    lanes: Vec<Lanes>,
    views: usize,
    matched: u32,
}

const LANES: usize = 16;

/// Views by coordinate. Lanes that hold none have a bearing that is too far from all others to match.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Lanes {
    x: [i16; LANES],
    y: [i16; LANES],
    z: [i16; LANES],
    partners: [u16; LANES],
}

/// Farther from every direction than two directions are from each other, and near enough for 32 bits.
const NOWHERE: Bearing = Bearing([24_000, 24_000, 0]);

impl Lanes {
    const EMPTY: Self =
        Self { x: [NOWHERE.0[0]; LANES], y: [NOWHERE.0[1]; LANES], z: [NOWHERE.0[2]; LANES], partners: [0; LANES] };

    fn get(&self, lane: usize) -> (Bearing, u16) {
        (Bearing([self.x[lane], self.y[lane], self.z[lane]]), self.partners[lane])
    }

    fn set(&mut self, lane: usize, (Bearing([x, y, z]), partners): (Bearing, u16)) {
        (self.x[lane], self.y[lane], self.z[lane], self.partners[lane]) = (x, y, z, partners);
    }

    fn find(&self, Bearing([x, y, z]): Bearing) -> Option<usize> {
        let differs: [i16; LANES] = std::array::from_fn(|k| self.x[k] ^ x | self.y[k] ^ y | self.z[k] ^ z);
        differs.iter().position(|&differs| differs == 0)
    }
}

impl MatchedViews {
    /// Views that match another one.
    pub fn matched(&self) -> u32 {
        self.matched
    }

    pub fn is_empty(&self) -> bool {
        self.views == 0
    }

    /// All views, matched or not.
    pub fn len(&self) -> usize {
        self.views
    }

    pub fn add(&mut self, matching: &Matching, view: Bearing) {
        let (partners, met) = meet_kernel(&mut self.lanes, view, matching.squared_chords, 1);
        self.matched += met + u32::from(partners > 0);
        let lane = self.views % LANES;
        if lane == 0 {
            self.lanes.push(Lanes::EMPTY);
        }
        self.lanes[self.views / LANES].set(lane, (view, partners));
        self.views += 1;
    }

    /// Takes away a view that was added before; without one nothing happens.
    pub fn remove(&mut self, matching: &Matching, view: Bearing) {
        let found = self.lanes.iter().enumerate().find_map(|(k, lanes)| Some((k, lanes.find(view)?)));
        let Some((chunk, lane)) = found else { return };
        let (_, partners) = self.lanes[chunk].get(lane);
        self.matched -= u32::from(partners > 0);
        self.views -= 1;
        let (last_chunk, last_lane) = (self.views / LANES, self.views % LANES);
        let last = self.lanes[last_chunk].get(last_lane);
        self.lanes[chunk].set(lane, last);
        self.lanes[last_chunk].set(last_lane, (NOWHERE, 0));
        if last_lane == 0 {
            self.lanes.pop();
        }
        let (_, parted) = meet_kernel(&mut self.lanes, view, matching.squared_chords, u16::MAX);
        self.matched -= parted;
    }
}

/// Adds `change`, one or minus one in 16 bits, to the partners of all views that match `view`. How many there are, and how many of them had no
/// partner before it came, or have none once it is gone.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+popcnt", "aarch64+neon"))]
fn meet_kernel(chunks: &mut [Lanes], Bearing([x, y, z]): Bearing, [least, most]: [i32; 2], change: u16) -> (u16, u32) {
    let lonely = if change == 1 { 1u16 } else { 0 };
    let (mut partners, mut turned) = (0u16, 0u32);
    for lanes in chunks {
        let matches: [u16; LANES] = std::array::from_fn(|k| {
            let [dx, dy, dz] = [lanes.x[k] - x, lanes.y[k] - y, lanes.z[k] - z].map(i32::from);
            let squared_chord = dx * dx + dy * dy + dz * dz;
            u16::from(squared_chord >= least && squared_chord <= most)
        });
        let (mut of_lanes, mut turned_lanes) = (0u16, 0u16);
        for (count, is_match) in lanes.partners.iter_mut().zip(matches) {
            *count = count.wrapping_add(is_match.wrapping_mul(change));
            of_lanes += is_match;
            turned_lanes += is_match & u16::from(*count == lonely);
        }
        partners += of_lanes;
        turned += u32::from(turned_lanes);
    }
    (partners, turned)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::settings::Settings;

    /// A view on a sample at the origin from above, so many degrees off the vertical.
    fn tilted(angle_deg: f64) -> Bearing {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        Bearing::new(&Point3::origin(), &Point3::new(30.0 * sin, 0.0, 30.0 * cos))
    }

    fn matched(angles_deg: &[f64]) -> u32 {
        let matching = Matching::new(&Settings::default().quality);
        let mut views = MatchedViews::default();
        angles_deg.iter().for_each(|&angle_deg| views.add(&matching, tilted(angle_deg)));
        views.matched()
    }

    #[test]
    fn views_match_at_5_to_45_degrees() {
        for (angles_deg, expected) in [
            (&[0.0][..], 0),
            (&[0.0, 4.9], 0),
            (&[0.0, 5.1], 2),
            (&[-20.0, 24.9], 2),
            (&[-20.0, 25.1], 0),
            (&[0.0, 1.0, 10.0], 3),
            (&[-30.0, 30.0, 0.0], 3),
            (&[-60.0, 60.0, 0.0], 0),
            (&[0.0, 0.0, 0.0], 0),
        ] {
            assert_eq!(matched(angles_deg), expected, "{angles_deg:?}");
        }
        let narrow =
            Settings { quality: QualitySettings { max_parallax_deg: 6.0, ..Settings::default().quality }, ..Settings::default() };
        let narrow = Matching::within(&narrow.quality, 10.0);
        for (angle_deg, expected) in [(5.2, 0), (5.3, 2), (5.7, 2), (5.8, 0)] {
            let mut views = MatchedViews::default();
            [0.0, angle_deg].into_iter().for_each(|angle_deg| views.add(&narrow, tilted(angle_deg)));
            assert_eq!(views.matched(), expected, "{angle_deg} of 5 to 6 degrees with a margin of ten");
        }
        let strict = Matching::within(&Settings::default().quality, 1.0);
        for (angle_deg, expected) in [(5.9, 0), (6.1, 2), (43.9, 2), (44.1, 0)] {
            let mut views = MatchedViews::default();
            [0.0, angle_deg].into_iter().for_each(|angle_deg| views.add(&strict, tilted(angle_deg)));
            assert_eq!(views.matched(), expected, "{angle_deg} with a margin of a degree");
        }
    }

    proptest! {
        #[test]
        fn after_any_additions_and_removals_the_matched_are_those_that_have_a_partner(
            angles_deg in proptest::collection::vec(-80i32..80, 1..70),
            leaves in proptest::collection::vec(any::<bool>(), 70),
        ) {
            let matching = Matching::new(&Settings::default().quality);
            let mut views = MatchedViews::default();
            let bearings: Vec<Bearing> = angles_deg.iter().map(|&angle_deg| tilted(f64::from(angle_deg) * 0.995)).collect();
            bearings.iter().for_each(|&view| views.add(&matching, view));
            bearings.iter().zip(&leaves).filter(|(_, leaves)| **leaves).for_each(|(&view, _)| views.remove(&matching, view));
            let stay: Vec<i32> = angles_deg.iter().zip(&leaves).filter(|(_, leaves)| !**leaves).map(|(&angle, _)| angle).collect();
            let has_partner = |a: &&i32| stay.iter().any(|b| (6..=45).contains(&(*a - b).abs()));
            prop_assert_eq!(views.matched() as usize, stay.iter().filter(has_partner).count());
            prop_assert_eq!(views.is_empty(), stay.is_empty());
        }
    }
}
