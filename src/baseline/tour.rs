//! The order in which views are flown: a short open path through all of them, with free ends.
//!
//! Iterated local search: 2-opt and Or-opt moves among near neighbours until none shortens the path, then a kick (two neighbouring
//! stretches change places) and local search around it, undone when the path became longer (Lourenço, Martin, Stützle 2003). The open
//! path is a closed tour through one more place that is as near as nothing to all others.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::costs::Costs;
use crate::stop::StopToken;

/// Longest stretch of Or-opt, and of a kick.
const STRETCH: usize = 3;
const KICKED: usize = 30;

/// A path to begin with: always on to the nearest place that was not visited yet.
pub fn nearest_neighbour(costs: &Costs) -> Vec<u32> {
    let places = costs.count();
    let mut left: Vec<u32> = (1..places).collect();
    let mut order: Vec<u32> = (0..places.min(1)).collect();
    while let Some(place) = (0..left.len()).min_by_key(|&place| costs.cost_mm(order[order.len() - 1], left[place])) {
        order.push(left.remove(place));
    }
    order
}

/// Shortens a path by local search and `kicks` kicks.
pub fn shorten(costs: &Costs, order: Vec<u32>, kicks: u64, seed: u64, stop: &StopToken) -> Vec<u32> {
    if order.len() < 3 {
        return order;
    }
    let mut tour = Tour::new(costs, order);
    let everywhere = tour.order.clone();
    tour.improve(everywhere);
    tour.undo.clear();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for kick in 0..kicks {
        if kick % 64 == 0 && stop.is_stopped() {
            break;
        }
        tour.kick(&mut random);
    }
    tour.open()
}

/// A closed tour through all places and the one that opens it.
struct Tour<'a> {
    costs: &'a Costs,
    order: Vec<u32>,
    /// Where in the order each place stands.
    position: Vec<usize>,
    /// Reversals since the last kick.
    undo: Vec<(usize, usize)>,
    /// The place that opens the tour.
    gap: u32,
}

impl<'a> Tour<'a> {
    fn new(costs: &'a Costs, mut order: Vec<u32>) -> Self {
        let gap = order.len() as u32;
        order.push(gap);
        let mut position = vec![0; order.len()];
        order.iter().enumerate().for_each(|(at, &place)| position[place as usize] = at);
        Self { costs, order, position, undo: Vec::new(), gap }
    }

    fn open(mut self) -> Vec<u32> {
        let at = self.position[self.gap as usize];
        self.order.rotate_left(at);
        self.order.remove(0);
        self.order
    }

    fn cost(&self, a: u32, b: u32) -> i64 {
        if a == self.gap || b == self.gap { 0 } else { self.costs.cost_mm(a, b) as i64 }
    }

    fn after(&self, a: u32) -> u32 {
        let at = self.position[a as usize] + 1;
        self.order[if at == self.order.len() { 0 } else { at }]
    }

    fn before(&self, a: u32) -> u32 {
        let at = self.position[a as usize];
        self.order[if at == 0 { self.order.len() - 1 } else { at - 1 }]
    }

    /// Reverses the stretch from position `from` on to position `to`, round the end if need be.
    fn reverse(&mut self, from: usize, to: usize) {
        let places = self.order.len();
        let length = (to + places - from) % places + 1;
        let (mut low, mut high) = (from, to);
        for _ in 0..length / 2 {
            self.order.swap(low, high);
            self.position[self.order[low] as usize] = low;
            self.position[self.order[high] as usize] = high;
            low = if low + 1 == places { 0 } else { low + 1 };
            high = if high == 0 { places - 1 } else { high - 1 };
        }
    }

    /// Reverses the stretch from place `a` on to place `b`.
    fn flip(&mut self, a: u32, b: u32) {
        let (from, to) = (self.position[a as usize], self.position[b as usize]);
        self.reverse(from, to);
        self.undo.push((from, to));
    }

    /// Local search that begins at the given places; returns what the tour became shorter.
    fn improve(&mut self, mut queue: Vec<u32>) -> i64 {
        let mut gained = 0;
        let mut is_queued = vec![false; self.order.len()];
        queue.iter().for_each(|&a| is_queued[a as usize] = true);
        while let Some(a) = queue.pop() {
            is_queued[a as usize] = false;
            while let Some((gain, touched)) = self.step(a) {
                gained += gain;
                for place in touched {
                    if !std::mem::replace(&mut is_queued[place as usize], true) {
                        queue.push(place);
                    }
                }
            }
        }
        gained
    }

    /// The first move at `a` that shortens the tour, with the places whose neighbours it changed.
    fn step(&mut self, a: u32) -> Option<(i64, Vec<u32>)> {
        if a == self.gap { None } else { self.two_opt(a).or_else(|| self.or_opt(a)) }
    }

    /// Places to join `a` with: the open end and the near places.
    fn partners(&self, a: u32) -> impl Iterator<Item = u32> + use<'a> {
        std::iter::once(self.gap).chain(self.costs.near(a).iter().copied())
    }

    /// Two legs are exchanged for two others.
    fn two_opt(&mut self, a: u32) -> Option<(i64, Vec<u32>)> {
        for is_after in [true, false] {
            let neighbour = |tour: &Self, place: u32| if is_after { tour.after(place) } else { tour.before(place) };
            let b = neighbour(self, a);
            let removed = self.cost(a, b);
            for c in self.partners(a) {
                if c != self.gap && self.costs.straight_mm(a, c) as i64 >= removed {
                    break;
                }
                let d = neighbour(self, c);
                let gain = removed + self.cost(c, d) - self.cost(a, c) - self.cost(b, d);
                if gain > 0 && b != c && d != a {
                    if is_after {
                        self.flip(b, c)
                    } else {
                        self.flip(a, d)
                    }
                    return Some((gain, vec![a, b, c, d]));
                }
            }
        }
        None
    }

    /// A stretch of up to three places that ends with `a` moves next to a near place, either way round.
    fn or_opt(&mut self, a: u32) -> Option<(i64, Vec<u32>)> {
        for is_first in [true, false] {
            let mut e = a;
            for _ in 0..STRETCH {
                if let Some(found) = self.move_stretch(a, e, is_first) {
                    return Some(found);
                }
                e = if is_first { self.after(e) } else { self.before(e) };
                if e == a {
                    break;
                }
            }
        }
        None
    }

    /// Moves the stretch between `a` and `e`, of which `a` is the first place on the tour or the last one, so that `a` joins a partner.
    fn move_stretch(&mut self, a: u32, e: u32, is_first: bool) -> Option<(i64, Vec<u32>)> {
        let (s, t) = if is_first { (a, e) } else { (e, a) };
        let (p, n) = (self.before(s), self.after(t));
        let places = self.order.len();
        let length = (self.position[t as usize] + places - self.position[s as usize]) % places + 1;
        if length + 2 > places || p == n {
            return None;
        }
        let freed = self.cost(p, s) + self.cost(t, n) - self.cost(p, n);
        let is_inside = |tour: &Self, c: u32| (tour.position[c as usize] + places - tour.position[s as usize]) % places < length;
        for c in self.partners(a) {
            // The places come in the order of their distance, and no leg costs less than that.
            if c != self.gap && self.costs.straight_mm(a, c) as i64 >= freed {
                break;
            }
            if is_inside(self, c) {
                continue;
            }
            for (x, y) in [(c, self.after(c)), (self.before(c), c)] {
                if x == p || is_inside(self, x) || is_inside(self, y) {
                    continue;
                }
                // `a` joins `c`, `e` the other one of x and y.
                let other = if c == x { y } else { x };
                let gain = freed + self.cost(x, y) - self.cost(a, c) - self.cost(e, other);
                if gain > 0 {
                    self.carry([s, t], n, x, (c == x) == (a == s));
                    return Some((gain, vec![p, n, s, t, x, y]));
                }
            }
        }
        None
    }

    /// Carries the stretch from `s` to `t` behind place `x`, where `n` follows on the stretch; `keeps` its direction or not.
    fn carry(&mut self, [s, t]: [u32; 2], n: u32, x: u32, keeps: bool) {
        self.flip(s, x);
        self.flip(x, n);
        if keeps {
            self.flip(t, s);
        }
    }

    /// Two neighbouring stretches change places; what does not shorten the tour in the end is undone.
    fn kick(&mut self, random: &mut ChaCha8Rng) {
        let places = self.order.len();
        let most = KICKED.min((places - 1) / 2).max(1) as u64;
        let mut length = || 1 + (random.next_u64() % most) as usize;
        let (first, second) = (length(), length());
        let from = (random.next_u64() % places as u64) as usize;
        let at = |offset: usize| (from + offset) % places;
        if first + second + 1 > places {
            return;
        }
        let place = |tour: &Self, offset: usize| tour.order[at(offset)];
        let [p, a, b, c, d, n] = [0, 1, first, first + 1, first + second, first + second + 1].map(|offset| place(self, offset));
        let change = self.cost(p, a) + self.cost(b, c) + self.cost(d, n) - self.cost(p, c) - self.cost(d, a) - self.cost(b, n);
        self.undo.clear();
        for (from, to) in [(at(1), at(first + second)), (at(1), at(second)), (at(second + 1), at(first + second))] {
            self.reverse(from, to);
            self.undo.push((from, to));
        }
        let gained = change + self.improve(vec![p, a, b, c, d, n]);
        if gained < 0 {
            while let Some((from, to)) = self.undo.pop() {
                self.reverse(from, to);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;

    fn costs(places: &[Point3<f64>]) -> Costs {
        let mut costs = Costs::new(places.to_vec());
        for a in 0..places.len() as u32 {
            for b in 0..a {
                costs.set(a, b, costs.straight_mm(a, b));
            }
        }
        costs
    }

    fn shortened(costs: &Costs, kicks: u64, seed: u64) -> Vec<u32> {
        shorten(costs, nearest_neighbour(costs), kicks, seed, &StopToken::default())
    }

    /// Held and Karp: the shortest open path by the set of visited places and the last one of them.
    fn exact_mm(costs: &Costs, places: usize) -> u64 {
        let mut best = vec![vec![u64::MAX; places]; 1 << places];
        (0..places).for_each(|last| best[1 << last][last] = 0);
        for set in 1usize..1 << places {
            for last in (0..places).filter(|last| set >> last & 1 == 1) {
                let so_far = best[set][last];
                for next in (0..places).filter(|next| set >> next & 1 == 0 && so_far < u64::MAX) {
                    let entry = &mut best[set | 1 << next][next];
                    *entry = (*entry).min(so_far + costs.cost_mm(last as u32, next as u32));
                }
            }
        }
        best[(1 << places) - 1].iter().copied().min().unwrap_or(0)
    }

    fn is_order_of(order: &[u32], places: usize) -> bool {
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        sorted == (0..places as u32).collect::<Vec<_>>()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn short_paths_are_the_shortest(
            places in proptest::collection::vec([-50.0..50.0f64, -50.0..50.0, 5.0..40.0], 1..12), blocked in proptest::collection::vec((0u32..12, 0u32..12), 0..12), seed in 0u64..9,
        ) {
            let places: Vec<Point3<f64>> = places.into_iter().map(Point3::from).collect();
            let mut costs = costs(&places);
            let count = places.len() as u32;
            for (a, b) in blocked.into_iter().map(|(a, b)| (a % count, b % count)).filter(|(a, b)| a != b) {
                costs.set(a, b, costs.detour_mm(a, b));
            }
            let order = shortened(&costs, 2000, seed);
            prop_assert!(is_order_of(&order, places.len()));
            let (found, least) = (costs.length_mm(&order), exact_mm(&costs, places.len()));
            prop_assert!(found >= least && found as f64 <= least as f64 * 1.05, "{found} instead of {least}");
        }
    }

    #[test]
    fn long_paths_are_within_a_twentieth_of_the_best_known() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for places in [100usize, 180] {
            let mut next = |most: f64| (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64 * most;
            let places: Vec<Point3<f64>> = (0..places).map(|_| Point3::new(next(300.0), next(200.0), next(40.0))).collect();
            let costs = costs(&places);
            let per_place = u64::from(crate::settings::Settings::default().baseline.tour_kicks);
            let kicks = per_place * places.len() as u64;
            let first = costs.length_mm(&nearest_neighbour(&costs));
            let best = (0..2).map(|seed| costs.length_mm(&shortened(&costs, 40_000, 100 + seed))).min().unwrap_or(0);
            for seed in 0..4 {
                let order = shortened(&costs, kicks, seed);
                assert!(is_order_of(&order, places.len()));
                assert_eq!(order, shortened(&costs, kicks, seed));
                let found = costs.length_mm(&order);
                assert!(found as f64 <= best as f64 * 1.05 && found < first, "{found}, best known {best}, first {first}");
            }
        }
    }

    #[test]
    fn a_stopped_search_keeps_all_places() {
        let places: Vec<Point3<f64>> = (0..30).map(|k| Point3::new(f64::from(k * 7 % 30), f64::from(k * 11 % 30), 9.0)).collect();
        let stop = StopToken::default();
        stop.stop();
        let costs = costs(&places);
        assert!(is_order_of(&shorten(&costs, nearest_neighbour(&costs), 1 << 40, 1, &stop), 30));
    }
}
