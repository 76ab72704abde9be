//! How often each kind of change is tried: those that lately brought more for their effort come more often.
//!
//! While a flight grows, new waypoints where samples are missing bring the most; once it covers enough, small shifts and turns do, and what
//! changes the order of the waypoints hardly ever passes. Nobody has to know which phase it is: each kind is given by its return, what
//! its changes gained over the views that had to be looked at for them (adaptive large neighbourhood search, Ropke and Pisinger
//! 2006). Effort is counted and not timed, so that the same flight comes out on every machine.

use rand_chacha::ChaCha8Rng;

use super::moves::{Move, uniform};

/// How often each kind is tried at equal returns, in parts of all.
const WEIGHTS: [(Move, f64); Move::COUNT] = [
    (Move::Remove, 2.0),
    (Move::RemoveRun, 0.5),
    (Move::Insert, 1.5),
    (Move::Visit, 1.5),
    (Move::Divert, 0.5),
    (Move::Shift, 4.0),
    (Move::ShiftLeg, 0.75),
    (Move::Straighten, 1.0),
    (Move::Turn, 2.5),
    (Move::TurnRun, 0.5),
    (Move::Aim, 1.0),
    (Move::Reverse, 0.75),
    (Move::Relocate, 0.75),
    (Move::Swap, 0.25),
    (Move::Merge, 0.5),
];

/// Share of a kind's weight that it keeps whatever it returns: a flight may come to where it is wanted again.
const STEADY_SHARE: f64 = 0.1;

/// A kind is tried at most so many times as often as at equal returns.
const MOST_FACTOR: f64 = 8.0;

/// What remains of older returns after a round.
const REMAINS: f64 = 0.95;

/// Effort at the common return that every kind is credited with, so that few trials do not decide; in views.
const PRIOR_EFFORT: f64 = 5_000.0;

/// The weights of the kinds as they have been learned.
#[derive(Clone, Debug)]
pub struct Choice {
    weights: [f64; Move::COUNT],
    total: f64,
    returns: Returns,
}

/// What the changes of each kind gained, and the effort that they took.
#[derive(Clone, Debug, Default)]
pub struct Returns([Return; Move::COUNT]);

#[derive(Clone, Copy, Debug, Default)]
struct Return {
    gained: f64,
    effort: f64,
}

impl Choice {
    /// Without experience.
    pub fn new() -> Self {
        let mut choice = Self { weights: [0.0; Move::COUNT], total: 0.0, returns: Returns::default() };
        choice.weigh();
        choice
    }

    pub fn draw(&self, random: &mut ChaCha8Rng) -> Move {
        let mut left = uniform(random) * self.total;
        for ((kind, _), weight) in WEIGHTS.iter().zip(self.weights) {
            left -= weight;
            if left < 0.0 {
                return *kind;
            }
        }
        Move::Shift
    }

    /// Learns from the returns of a round, worker by worker.
    pub fn learn<'r>(&mut self, rounds: impl Iterator<Item = &'r Returns>) {
        let Returns(kept) = &mut self.returns;
        for Return { gained, effort } in kept.iter_mut() {
            (*gained, *effort) = (*gained * REMAINS, *effort * REMAINS);
        }
        for Returns(fresh) in rounds {
            for (kept, fresh) in kept.iter_mut().zip(fresh) {
                (kept.gained, kept.effort) = (kept.gained + fresh.gained, kept.effort + fresh.effort);
            }
        }
        self.weigh();
    }

    fn weigh(&mut self) {
        let Returns(kinds) = &self.returns;
        let [gained, effort] = kinds.iter().fold([0.0; 2], |[gained, effort], kind| [gained + kind.gained, effort + kind.effort]);
        let common = if effort > 0.0 { gained / effort } else { 0.0 };
        for ((weight, (_, at_equal)), kind) in self.weights.iter_mut().zip(WEIGHTS).zip(kinds) {
            let rate = (kind.gained + common * PRIOR_EFFORT) / (kind.effort + PRIOR_EFFORT);
            let factor = if common > 0.0 { (rate / common).min(MOST_FACTOR) } else { 1.0 };
            *weight = at_equal * (STEADY_SHARE + (1.0 - STEADY_SHARE) * factor);
        }
        self.total = self.weights.iter().sum();
    }
}

impl Returns {
    /// Takes note of a change: what it gained if it was made, and how many views were looked at.
    pub fn note(&mut self, kind: Move, gained: f64, views: usize) {
        let entry = &mut self.0[kind as usize];
        entry.gained += gained.max(0.0);
        entry.effort += PROPOSAL_VIEWS + views as f64;
    }
}

/// What it takes to propose a change and to give it up at once, in views.
const PROPOSAL_VIEWS: f64 = 100.0;

#[cfg(test)]
mod tests {
    use rand_core::SeedableRng;

    use super::*;

    fn drawn(choice: &Choice) -> [u32; Move::COUNT] {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut counts = [0; Move::COUNT];
        (0..20_000).for_each(|_| counts[choice.draw(&mut random) as usize] += 1);
        counts
    }

    #[test]
    fn without_experience_each_kind_comes_by_its_weight() {
        let counts = drawn(&Choice::new());
        let total: f64 = WEIGHTS.iter().map(|(_, weight)| weight).sum();
        for (kind, weight) in WEIGHTS {
            let expected = 20_000.0 * weight / total;
            assert!((f64::from(counts[kind as usize]) - expected).abs() < 5.0 * expected.sqrt(), "{kind:?}: {counts:?}");
        }
    }

    #[test]
    fn a_kind_that_pays_comes_more_often_and_none_is_given_up() {
        let mut choice = Choice::new();
        let before = drawn(&choice);
        for _ in 0..50 {
            let mut returns = Returns::default();
            for (kind, _) in WEIGHTS {
                let gained = if kind == Move::Visit { 9e9 } else { 0.0 };
                (0..10).for_each(|_| returns.note(kind, gained, 1000));
            }
            returns.note(Move::Swap, -1e12, 1000);
            choice.learn([returns].iter());
        }
        let after = drawn(&choice);
        assert!(after[Move::Visit as usize] > 3 * before[Move::Visit as usize], "{after:?}");
        // A tenth of the weights is left, while the one that pays has eight times its own.
        assert!(before.iter().zip(after).all(|(before, after)| after * 12 > *before), "{before:?} became {after:?}");
    }

    #[test]
    fn the_same_gain_for_less_effort_counts_for_more() {
        let mut choice = Choice::new();
        let before = drawn(&choice);
        for _ in 0..50 {
            let mut returns = Returns::default();
            (0..20).for_each(|_| returns.note(Move::Shift, 1e9, 5000));
            (0..20).for_each(|_| returns.note(Move::Insert, 1e9, 100));
            choice.learn([returns].iter());
        }
        let after = drawn(&choice);
        let share = |counts: &[u32; Move::COUNT], kind: Move| f64::from(counts[kind as usize]);
        assert!(share(&after, Move::Insert) > 2.0 * share(&before, Move::Insert), "{after:?}");
        assert!(share(&after, Move::Shift) < share(&before, Move::Shift), "{after:?}");
    }
}
