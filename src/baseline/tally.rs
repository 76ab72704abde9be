//! The reconstructability of all samples under a changing set of views, kept up to date pair by pair.

use super::pairs::{PairModel, Quality, Ray};
use super::shots::Sight;

/// Sums of pair qualities. Everything is in integers, so a view that is added and removed again leaves no trace.
#[derive(Clone, Debug)]
pub struct Tally<'a> {
    model: &'a PairModel,
    /// What a unit of reconstructability is worth, by sample: its area, mm^2.
    areas_mm2: &'a [u64],
    /// Beyond this more pairs are worth nothing, by sample.
    pub wanted: Vec<Quality>,
    pub sums: Vec<Quality>,
    /// The views that see each sample.
    seen: Vec<Vec<(u32, Ray)>>,
    /// Sum of area times min(sum, wanted).
    value: u64,
}

impl<'a> Tally<'a> {
    pub fn new(model: &'a PairModel, areas_mm2: &'a [u64], wanted: Vec<Quality>) -> Self {
        let samples = areas_mm2.len();
        Self { model, areas_mm2, wanted, sums: vec![0; samples], seen: vec![Vec::new(); samples], value: 0 }
    }

    /// Sum of area times reconstructability up to what is wanted.
    pub fn value(&self) -> u64 {
        self.value
    }

    /// The most that the value can become.
    pub fn most(&self) -> u64 {
        self.wanted.iter().zip(self.areas_mm2).map(|(wanted, area)| wanted * area).sum()
    }

    /// Whether no view sees the sample.
    pub fn is_unseen(&self, sample: u32) -> bool {
        self.seen[sample as usize].is_empty()
    }

    /// Pair qualities of a line of sight with all views but `view` itself.
    pub fn links(&self, view: u32, sight: &Sight) -> Quality {
        let others = self.seen[sight.sample as usize].iter().filter(|(other, _)| *other != view);
        others.map(|(_, ray)| self.model.quality(ray, &sight.ray)).sum()
    }

    /// Adds a view; its number must not be in use.
    pub fn add(&mut self, view: u32, sights: &[Sight]) {
        for sight in sights {
            let links = self.links(view, sight);
            self.change(sight.sample, |sum| sum + links);
            self.seen[sight.sample as usize].push((view, sight.ray));
        }
    }

    /// Removes a view that was added with these sights.
    pub fn remove(&mut self, view: u32, sights: &[Sight]) {
        for sight in sights {
            let seen = &mut self.seen[sight.sample as usize];
            if let Some(place) = seen.iter().position(|(other, _)| *other == view) {
                seen.swap_remove(place);
            }
            let links = self.links(view, sight);
            self.change(sight.sample, |sum| sum - links);
        }
    }

    /// What the value would gain by a view.
    pub fn gain(&self, sights: &[Sight]) -> u64 {
        let open = sights.iter().filter(|sight| self.sums[sight.sample as usize] < self.wanted[sight.sample as usize]);
        open.map(|sight| self.worth(sight.sample, self.links(u32::MAX, sight))).sum()
    }

    /// What the value would lose without a view that was added.
    pub fn loss(&self, view: u32, sights: &[Sight]) -> u64 {
        let lost = |sight: &Sight| {
            let i = sight.sample as usize;
            let (sum, wanted) = (self.sums[i], self.wanted[i]);
            let left = sum - self.links(view, sight);
            (sum.min(wanted) - left.min(wanted)) * self.areas_mm2[i]
        };
        sights.iter().map(lost).sum()
    }

    /// What a sample gains when `links` are added to its sum.
    pub fn worth(&self, sample: u32, links: Quality) -> u64 {
        let i = sample as usize;
        let (sum, wanted) = (self.sums[i], self.wanted[i]);
        ((sum + links).min(wanted) - sum.min(wanted)) * self.areas_mm2[i]
    }

    fn change(&mut self, sample: u32, to: impl Fn(Quality) -> Quality) {
        let i = sample as usize;
        let (before, after) = (self.sums[i], to(self.sums[i]));
        self.value -= before.min(self.wanted[i]) * self.areas_mm2[i];
        self.value += after.min(self.wanted[i]) * self.areas_mm2[i];
        self.sums[i] = after;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    use super::super::pairs::UNIT;
    use super::*;
    use crate::coverage::SampleFrame;

    fn sights(position: &[f64; 3], seen: u8) -> Vec<Sight> {
        let frame = |i: u32| SampleFrame::new(Point3::new(f64::from(i) * 3.0, 0.0, 0.0), Vector3::z());
        let view = Point3::from(*position);
        (0..4).filter(|i| seen >> i & 1 == 1).map(|sample| Sight { sample, ray: Ray::new(&frame(sample), &view) }).collect()
    }

    /// All pairs, from nothing.
    fn brute_force(model: &PairModel, views: &[&Vec<Sight>]) -> Vec<Quality> {
        let mut sums = vec![0; 4];
        for (a, first) in views.iter().enumerate() {
            for second in &views[..a] {
                for (x, y) in first.iter().flat_map(|x| second.iter().map(move |y| (x, y))).filter(|(x, y)| x.sample == y.sample)
                {
                    sums[x.sample as usize] += model.quality(&x.ray, &y.ray);
                }
            }
        }
        sums
    }

    proptest! {
        #[test]
        fn sums_gains_and_losses_agree_with_all_pairs_recomputed(
            views in proptest::collection::vec(([-30.0..30.0f64, -30.0..30.0, 3.0..40.0], 0u8..16), 1..9), steps in proptest::collection::vec(0usize..9, 1..30),
        ) {
            let model = PairModel::new(80.0);
            let areas = [5, 7, 11, 13];
            let wanted = vec![2 * UNIT, UNIT, 3 * UNIT, UNIT / 2];
            let mut tally = Tally::new(&model, &areas, wanted.clone());
            let views: Vec<Vec<Sight>> = views.iter().map(|(position, seen)| sights(position, *seen)).collect();
            let mut chosen = vec![false; views.len()];
            let value = |chosen: &[bool]| -> (u64, Vec<Quality>) {
                let sums = brute_force(&model, &views.iter().zip(chosen).filter(|(_, c)| **c).map(|(v, _)| v).collect::<Vec<_>>());
                ((0..4).map(|i| sums[i].min(wanted[i]) * areas[i]).sum(), sums)
            };
            for view in steps.into_iter().map(|step| step % views.len()) {
                let before = tally.value();
                let id = view as u32;
                if chosen[view] {
                    let loss = tally.loss(id, &views[view]);
                    tally.remove(id, &views[view]);
                    prop_assert_eq!(before - loss, tally.value());
                } else {
                    let gain = tally.gain(&views[view]);
                    tally.add(id, &views[view]);
                    prop_assert_eq!(before + gain, tally.value());
                }
                chosen[view] = !chosen[view];
                let (value, sums) = value(&chosen);
                prop_assert_eq!(tally.value(), value);
                prop_assert_eq!(&tally.sums, &sums);
            }
        }
    }
}
