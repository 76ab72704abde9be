//! The strongest linear rows for the capture of one sample.
//!
//! A weighting gives each image a whole weight such that every set of images that captures the sample weighs at least [`WHOLE`]. The sharpest weighting
//! against a fractional proposal is the dual of packing as many capturing sets into it as fit: it is found on the few images that the proposal uses, and then
//! lowered image by image on all others. No step relies on the solver: every weighting is checked, and repaired, in whole numbers.

use super::program::{Program, Row};
use crate::coverage::Mask;
use crate::settings::BoundSettings;

/// What a capturing set of images weighs at least.
pub const WHOLE: i64 = 60;

/// Images that are used by less are not counted as used.
const LEAST_USE: f64 = 1e-3;

/// The sharpest weighting that is found for images with these masks, used so much. `None` when the search for it was given up.
pub fn weigh(masks: &[Mask], uses: &[f64], needed: u32, settings: &BoundSettings) -> Option<Vec<i64>> {
    let mut used: Vec<usize> = (0..masks.len()).filter(|&j| uses[j] > LEAST_USE).collect();
    used.sort_by(|&a, &b| uses[b].total_cmp(&uses[a]).then(a.cmp(&b)));
    used.truncate(settings.weighed_images as usize);
    let used_masks: Vec<Mask> = used.iter().map(|&j| masks[j]).collect();
    let of_used = weigh_used(&used_masks, &used.iter().map(|&j| uses[j]).collect::<Vec<_>>(), needed, settings)?;

    let mut weights = vec![WHOLE; masks.len()];
    used.iter().zip(&of_used).for_each(|(&j, &weight)| weights[j] = weight);
    let mut rest: Vec<usize> = (0..masks.len()).filter(|j| !used.contains(j)).collect();
    rest.sort_by(|&a, &b| uses[b].total_cmp(&uses[a]).then(masks[b].count_ones().cmp(&masks[a].count_ones())).then(a.cmp(&b)));
    for j in rest {
        // With image j in the set the others weigh at least so much; images of the full weight cannot be among them.
        if let Search::Lightest(others) = lightest(masks, &weights, masks[j], needed, settings) {
            weights[j] = WHOLE - others.map_or(WHOLE, |set| set.iter().map(|&k| weights[k]).sum());
        }
    }
    Some(weights)
}

/// Rows "every capturing set weighs one" generated one by one.
fn weigh_used(masks: &[Mask], uses: &[f64], needed: u32, settings: &BoundSettings) -> Option<Vec<i64>> {
    let costs = uses.iter().map(|&use_| ((use_ * 1e6) as i64).max(1)).collect();
    let mut program = Program { costs, upper: vec![1; masks.len()], rows: Vec::new() };
    let active = vec![true; masks.len()];
    let mut weights = vec![0; masks.len()];
    for _ in 0..settings.weighed_sets {
        match lightest(masks, &weights, 0, needed, settings) {
            Search::GivenUp => return None,
            Search::Lightest(None) => return Some(weights),
            Search::Lightest(Some(set)) => {
                program.rows.push(Row { terms: set.into_iter().map(|j| (j, 1)).collect(), at_least: 1 })
            }
        }
        let found = program.solve(&active, settings).values;
        weights = found.iter().map(|&value| ((value * WHOLE as f64 - 1e-3).ceil() as i64).clamp(0, WHOLE)).collect();
        let kept = |row: &Row| row.terms.iter().map(|&(j, _)| weights[j]).sum::<i64>() >= WHOLE;
        if !program.rows.iter().all(kept) {
            return None;
        }
    }
    // Sets are still missing: raising all weights in proportion makes the lightest one heavy enough.
    let Search::Lightest(Some(set)) = lightest(masks, &weights, 0, needed, settings) else { return None };
    let least: i64 = set.iter().map(|&j| weights[j]).sum();
    (least > 0)
        .then(|| weights.iter().map(|&weight| (weight * WHOLE + least - 1) / least).map(|weight| weight.min(WHOLE)).collect())
}

enum Search {
    /// A lightest set below the limit that captures, or none.
    Lightest(Option<Vec<usize>>),
    GivenUp,
}

/// The lightest set of images that, with what is `given`, covers enough; only sets that weigh less than a whole. A search that takes too many steps is
/// given up, which leaves weights as they were.
fn lightest(masks: &[Mask], weights: &[i64], given: Mask, needed: u32, settings: &BoundSettings) -> Search {
    let free = (0..masks.len()).filter(|&j| weights[j] == 0);
    let start = free.clone().fold(given, |cells, j| cells | masks[j]);
    let mut order: Vec<usize> =
        (0..masks.len()).filter(|&j| weights[j] > 0 && weights[j] < WHOLE && masks[j] & !start != 0).collect();
    order.sort_by_key(|&j| (weights[j], std::cmp::Reverse(masks[j].count_ones()), j));
    // What all images from here on could still add, together: a branch that cannot reach the end is left.
    let mut rest = vec![0; order.len() + 1];
    (0..order.len()).rev().for_each(|k| rest[k] = rest[k + 1] | masks[order[k]]);
    let mut search = Branches {
        masks,
        weights,
        order: &order,
        rest: &rest,
        needed,
        best: WHOLE,
        set: None,
        chosen: Vec::new(),
        steps_left: settings.weighing_steps as i64,
    };
    search.branch(0, start, 0);
    if search.steps_left < 0 {
        return Search::GivenUp;
    }
    Search::Lightest(search.set.map(|set| set.into_iter().chain(free).collect()))
}

struct Branches<'a> {
    masks: &'a [Mask],
    weights: &'a [i64],
    /// Images by weight.
    order: &'a [usize],
    rest: &'a [Mask],
    needed: u32,
    best: i64,
    set: Option<Vec<usize>>,
    chosen: Vec<usize>,
    /// Negative when the search is given up.
    steps_left: i64,
}

impl Branches<'_> {
    fn branch(&mut self, from: usize, cells: Mask, weight: i64) {
        if cells.count_ones() >= self.needed {
            if weight < self.best {
                self.best = weight;
                self.set = Some(self.chosen.clone());
            }
            return;
        }
        for k in from..self.order.len() {
            let j = self.order[k];
            // The images stand by weight: if this one is too heavy, so are the others.
            if weight + self.weights[j] >= self.best || (cells | self.rest[k]).count_ones() < self.needed {
                return;
            }
            self.steps_left -= 1;
            if self.steps_left < 0 {
                return;
            }
            if self.masks[j] & !cells == 0 {
                continue;
            }
            self.chosen.push(j);
            self.branch(k + 1, cells | self.masks[j], weight + self.weights[j]);
            self.chosen.pop();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::settings::Settings;

    fn settings() -> BoundSettings {
        Settings::default().bound
    }

    proptest! {
        #[test]
        fn every_capturing_set_weighs_a_whole(
            images in proptest::collection::vec((any::<u16>(), 0.0..1.0f64), 1..10), needed in 1u32..16,
        ) {
            let masks: Vec<Mask> = images.iter().map(|image| Mask::from(image.0)).collect();
            let uses: Vec<f64> = images.iter().map(|image| if image.1 < 0.5 { 0.0 } else { image.1 }).collect();
            let Some(weights) = weigh(&masks, &uses, needed, &settings()) else { return Ok(()) };
            for set in 0u32..1 << masks.len() {
                let members = || (0..masks.len()).filter(|j| set >> j & 1 == 1);
                if members().fold(0, |cells: Mask, j| cells | masks[j]).count_ones() >= needed {
                    prop_assert!(members().map(|j| weights[j]).sum::<i64>() >= WHOLE, "{weights:?} on {set:b}");
                }
            }
        }
    }

    #[test]
    fn two_halves_weigh_half_each_and_an_image_that_does_it_alone_the_whole() {
        let masks: Vec<Mask> = vec![0b0011, 0b1100, 0b1111, 0b0001];
        assert_eq!(weigh(&masks, &[0.5, 0.5, 0.5, 0.0], 4, &settings()).map(|weights| weights[2]), Some(WHOLE));
        let three: Vec<Mask> = vec![0b000011, 0b001100, 0b110000];
        // Any two of three are enough.
        assert_eq!(weigh(&three, &[0.4, 0.4, 0.4], 4, &settings()), Some(vec![WHOLE / 2; 3]));
    }
}
