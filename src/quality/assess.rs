//! What a set of images sees of every sample of the truth, by exact rays, and what follows for the sample.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::shots::Shot;
use super::smith::{Smith, Weight};
use super::statistics::Quality;
use super::triangulation::{Deviation, Sight, deviation};
use super::truth::{Truth, TruthSample};
use crate::camera::View;
use crate::coverage::{FineDisks, FineMask};
use crate::settings::Settings;
use crate::stop::StopToken;

/// What the images tell of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleQuality {
    /// Images that see it, within range and incidence.
    pub views: u32,
    /// Views with another one at a parallax that can be matched.
    pub matched_views: u32,
    /// Largest angle between two views, rad.
    pub parallax_rad: f64,
    /// Best ground sampling distance, m; `None` for a sample that nothing sees.
    pub gsd_m: Option<f64>,
    /// The covered hemisphere (Eq. 1).
    pub covered: FineMask,
    /// Reconstructability after Smith et al. 2018.
    pub smith: f64,
    /// Triangulated from its matched views; `None` for a sample that is not reconstructed.
    pub deviation: Option<Deviation>,
}

/// Assesses every sample of the truth, in parallel. `None` when stopped.
pub fn assess(truth: &Truth, shots: &[Shot], settings: &Settings, stop: &StopToken) -> Option<Quality> {
    let assessor = Assessor::new(truth, shots, settings);
    let assessed = |sample: &TruthSample| (!stop.is_stopped()).then(|| assessor.sample(sample));
    let samples: Option<Vec<SampleQuality>> = truth.samples().par_iter().map(assessed).collect();
    let areas_mm2 = truth.samples().iter().map(|sample| sample.area_mm2).collect();
    Some(Quality::new(samples?, areas_mm2, shots.len(), settings))
}

struct Assessor<'a> {
    truth: &'a Truth,
    shots: &'a [Shot],
    views: Vec<Option<View>>,
    disks: FineDisks,
    smith: Smith,
    noise_px: f64,
    /// Squared chords of the least and the largest parallax that can be matched.
    matching: [f64; 2],
    least_views: u32,
}

/// A view of the sample at hand.
struct Seen {
    sight: Sight,
    weight: Weight,
    gsd_m: f64,
    is_matched: bool,
}

impl<'a> Assessor<'a> {
    fn new(truth: &'a Truth, shots: &'a [Shot], settings: &Settings) -> Self {
        let quality = &settings.quality;
        let squared_chord = |angle_deg: f64| (2.0 * libm::sin(angle_deg.to_radians() / 2.0)).powi(2);
        Self {
            truth,
            shots,
            views: shots.iter().map(|shot| shot.image.view()).collect(),
            disks: FineDisks::new(&settings.coverage),
            smith: Smith::new(quality.smith_range_m),
            noise_px: quality.pixel_noise_px,
            matching: [squared_chord(quality.min_parallax_deg), squared_chord(quality.max_parallax_deg)],
            least_views: quality.least_views,
        }
    }

    fn sample(&self, sample: &TruthSample) -> SampleQuality {
        let (mut seen, covered) = self.seen(sample);
        let Pairs { parallax_rad, smith } = self.pair_up(&mut seen);
        let matched_views = seen.iter().filter(|view| view.is_matched).count() as u32;
        let matched = seen.iter().filter(|view| view.is_matched).map(|view| view.sight);
        let is_reconstructed = matched_views >= self.least_views;
        SampleQuality {
            views: seen.len() as u32,
            matched_views,
            parallax_rad,
            gsd_m: seen.iter().map(|view| view.gsd_m).min_by(f64::total_cmp),
            covered,
            smith,
            deviation: is_reconstructed.then(|| deviation(matched, &sample.frame.normal)).flatten(),
        }
    }

    /// The views of a sample in the order of the images, and the union of their disks.
    fn seen(&self, sample: &TruthSample) -> (Vec<Seen>, FineMask) {
        let frame = &sample.frame;
        let end = frame.position + frame.normal * self.truth.offset_m;
        let mut sight: Option<(Point3<f64>, bool, FineMask)> = None;
        let mut covered = FineMask::default();
        let mut seen = Vec::new();
        for (shot, view) in self.shots.iter().zip(&self.views) {
            let position = shot.image.position_m;
            let is_framed = |view: &View| view.frames(&frame.position);
            if !self.disks.faces(frame, &position) || !view.as_ref().is_none_or(is_framed) {
                continue;
            }
            // The cameras of a rig stand at one place, so that one ray does for all of them.
            let (is_free, mask) = match sight {
                Some((known, is_free, mask)) if known == position => (is_free, mask),
                _ => {
                    let is_free = !self.truth.free.clearance.occluded(&position, &end);
                    (is_free, if is_free { self.disks.mask(frame, &position) } else { FineMask::default() })
                }
            };
            sight = Some((position, is_free, mask));
            if is_free {
                covered = covered.union(mask);
                seen.push(self.view(shot, &(position - frame.position), &frame.normal));
            }
        }
        (seen, covered)
    }

    fn view(&self, shot: &Shot, to_view: &Vector3<f64>, normal: &Vector3<f64>) -> Seen {
        let distance_m = to_view.norm();
        let direction = to_view / distance_m;
        let gsd_m = shot.pixel_rad * distance_m;
        Seen {
            sight: Sight { direction, spread_m: self.noise_px * gsd_m },
            weight: self.smith.weight(distance_m, direction.dot(normal)),
            gsd_m,
            is_matched: false,
        }
    }

    /// Looks at every pair of views, and marks those that can be matched.
    fn pair_up(&self, seen: &mut [Seen]) -> Pairs {
        let (mut largest, mut smith) = (0.0f64, 0.0);
        let [least, most] = self.matching;
        for second in 1..seen.len() {
            let (before, rest) = seen.split_at_mut(second);
            let second = &mut rest[0];
            for first in before {
                let squared_chord = (first.sight.direction - second.sight.direction).norm_squared();
                largest = largest.max(squared_chord);
                if (least..=most).contains(&squared_chord) {
                    first.is_matched = true;
                    second.is_matched = true;
                }
                smith += self.smith.pair(squared_chord.sqrt(), &first.weight, &second.weight);
            }
        }
        Pairs { parallax_rad: 2.0 * libm::asin((largest.sqrt() / 2.0).min(1.0)), smith }
    }
}

/// What all pairs of views of a sample give.
struct Pairs {
    parallax_rad: f64,
    smith: f64,
}
