//! From coarse to fine: in the first rounds only every so many samples count, in the last ones all do.
//!
//! While a flight grows, a few hundred samples tell as well where it has to lead as ten thousand do, and a change takes a fraction of the time.
//! What was left out between them is filled in by the rounds in which all count.

use super::Aim;
use super::ground::Ground;

/// The levels of a refinement: all samples at the last one.
pub struct Levels<'l, 'a> {
    coarse: Vec<Coarse<'a>>,
    all: &'l Ground<'a>,
}

struct Coarse<'a> {
    ground: Ground<'a>,
    /// Share of the rounds that are over when the level ends.
    end_share: f64,
}

/// Share of the rounds that are over when the coarsest level ends, and when the one between it and the last does. A flight that captures the goal of every
/// sixteenth sample over tokyo-2km captures 60 % of every fourth, and has to become half as long again: that takes rounds. With 20 s, flights after 0.5 and 0.8
/// are as long, but captured 94.2 to 94.7 % in place of 95.0; over nihonbashi (1 and 3 s) and marunouchi (5 s) neither is better.
const END_SHARES: [f64; 2] = [0.3, 0.6];

/// From so many samples for one on, there is a level between the coarsest and the last one.
const LEAST_STRIDE_BETWEEN: usize = 4;

/// Share of a round's time that grows with the number of samples; the rest is safety, timing and what is drawn.
const SAMPLES_SHARE: f64 = 0.75;

impl<'l, 'a> Levels<'l, 'a> {
    pub fn new(all: &'l Ground<'a>, aim: Aim) -> Self {
        let most = match aim {
            // Eq. 6 sums over all samples.
            Aim::MostObjective => 1,
            _ => all.wanted.len() / all.settings.coarse_samples.max(1) as usize,
        };
        let stride = 1 << most.max(1).ilog2();
        let between = if stride >= LEAST_STRIDE_BETWEEN { 1 << (stride.ilog2() / 2) } else { 1 };
        let strides = [stride, between].into_iter().zip(END_SHARES).filter(|&(stride, _)| stride > 1);
        Self { coarse: strides.map(|(stride, end_share)| Coarse { ground: all.thinned(stride), end_share }).collect(), all }
    }

    /// All samples from the beginning.
    pub fn fine(all: &'l Ground<'a>) -> Self {
        Self { coarse: Vec::new(), all }
    }

    /// The number of the last level, in which all samples count.
    pub fn last(&self) -> usize {
        self.coarse.len()
    }

    pub fn ground(&self, level: usize) -> &Ground<'a> {
        self.coarse.get(level).map_or(self.all, |coarse| &coarse.ground)
    }

    /// Of so many rounds, those that are over when a level ends.
    pub fn end(&self, level: usize, rounds: u32) -> u32 {
        (f64::from(rounds) * self.end_share(level)) as u32
    }

    /// How long a round after the first `share` of all takes on average where one of the first level takes `first_s`; one of each level takes as
    /// long as was measured, which is guessed where nothing was.
    pub fn later_s(&self, share: f64, first_s: f64, measured_s: &[f64]) -> f64 {
        let cost = |level: usize| 1.0 - SAMPLES_SHARE + SAMPLES_SHARE / self.ground(level).stride as f64;
        let mut from = share;
        let mut sum_s = 0.0;
        for level in 0..=self.last() {
            let to = self.end_share(level);
            sum_s += (to - from) * measured_s.get(level).copied().unwrap_or(first_s * cost(level) / cost(0));
            from = to;
        }
        sum_s / (1.0 - share)
    }

    fn end_share(&self, level: usize) -> f64 {
        self.coarse.get(level).map_or(1.0, |coarse| coarse.end_share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Rig;
    use crate::refine::tests::small_block;
    use crate::refine::{Counting, Worth};
    use crate::search::Problem;
    use crate::stop::StopToken;

    #[test]
    fn levels_get_finer_until_all_samples_count() {
        let (snapshot, mut settings) = small_block();
        let problem = Problem::new(&snapshot, &settings, Rig::preset("panoramic").unwrap());
        let aim = Aim::LeastTime { required: Worth::default() };
        let wanted = Ground::new(&problem, &settings, false, Counting::Captured, &StopToken::default()).wanted.len() as u32;
        for (coarse_samples, strides) in
            [(wanted, vec![1]), (wanted / 2, vec![2, 1]), (wanted / 4, vec![4, 2, 1]), (wanted / 9, vec![8, 2, 1])]
        {
            settings.refine.coarse_samples = coarse_samples;
            let ground = Ground::new(&problem, &settings, false, Counting::Captured, &StopToken::default());
            let levels = Levels::new(&ground, aim);
            assert_eq!((0..=levels.last()).map(|level| levels.ground(level).stride).collect::<Vec<_>>(), strides);
            let ends: Vec<u32> = (0..=levels.last()).map(|level| levels.end(level, 100)).collect();
            assert!(ends.is_sorted() && ends.last() == Some(&100), "{ends:?}");
            let later = levels.later_s(0.1, 1.0, &[]);
            assert!(
                later >= 1.0 && later < strides[0] as f64 + 1e-9 && (strides.len() > 1) == (later > 1.0),
                "{later} for {strides:?}"
            );
            let measured = levels.later_s(0.1, 1.0, &vec![2.0; strides.len()]);
            assert!((measured - 2.0).abs() < 1e-12, "{measured} for {strides:?}");
            // Where every sample counts for the objective, none is left out.
            assert_eq!(Levels::new(&ground, Aim::MostObjective).last(), 0);
        }
    }
}
