//! Changes of a flight that are tried, at random.

use nalgebra::{Point3, Unit, Vector3, center};
use rand_chacha::ChaCha8Rng;
use rand_core::Rng;

use super::counts::Worth;
use super::draft::{Splice, Stop};
use super::flight::Flight;
use super::focus::Focus;
use super::ground::Ground;
use super::sectors::Sector;
use crate::camera::Pose;
use crate::search::leg::slerp;

/// A kind of change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Move {
    /// Leaves out a waypoint, or a few in a row.
    Remove,
    RemoveRun,
    /// Splits a leg at a waypoint somewhere near it.
    Insert,
    /// Goes to see a sample that is missing: by a new waypoint, or with the nearest one.
    Visit,
    Divert,
    /// Moves a waypoint, or two in parallel, or one towards the chord of its neighbours.
    Shift,
    ShiftLeg,
    Straighten,
    /// Turns the view of a waypoint, or of a few alike, or towards a sample that is missing.
    Turn,
    TurnRun,
    Aim,
    /// Flies a part of the path the other way round.
    Reverse,
    /// Gives a few waypoints another place in the order.
    Relocate,
    /// Exchanges two waypoints.
    Swap,
    /// Makes two waypoints one.
    Merge,
}

impl Move {
    pub const COUNT: usize = Self::Merge as usize + 1;
}

/// Standard deviations of a shift, m.
const SHIFTS_M: [f64; 3] = [1.5, 4.0, 12.0];

/// Waypoints that are left out, turned or relocated together, at most.
const LONGEST_RUN: usize = 5;

/// A number of 0..1.
pub fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Exponentially distributed with mean 1.
pub fn exponential(random: &mut ChaCha8Rng) -> f64 {
    -libm::log(1.0 - uniform(random))
}

fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
    ((uniform(random) * count as f64) as usize).min(count - 1)
}

/// About normally distributed in each coordinate with standard deviation 1.
fn normal(random: &mut ChaCha8Rng) -> Vector3<f64> {
    let mut one = || 2.0 * (uniform(random) + uniform(random) + uniform(random) - 1.5);
    Vector3::new(one(), one(), one())
}

/// Proposes a change of one kind within a sector; `false` when it is not possible where it was drawn.
pub fn propose(
    ground: &Ground,
    flight: &Flight,
    required: Worth,
    sector: Sector<'_>,
    kind: Move,
    random: &mut ChaCha8Rng,
    splice: &mut Splice,
) -> bool {
    splice.stops.clear();
    let is_near = |focus: &Focus, k: usize| focus.contains(&flight.waypoints[k].pose.position);
    let near = sector.focus.map(|focus| sector.of(flight.waypoints.len()).filter(|&k| is_near(focus, k)).collect());
    Proposal { ground, flight, required, sector, near, random, splice }.make(kind).is_some()
}

struct Proposal<'p> {
    ground: &'p Ground<'p>,
    flight: &'p Flight,
    required: Worth,
    sector: Sector<'p>,
    /// The waypoints of the sector in its focus, if it has one.
    near: Option<Vec<usize>>,
    random: &'p mut ChaCha8Rng,
    splice: &'p mut Splice,
}

impl Proposal<'_> {
    /// Fills the splice; nothing when the change is not possible.
    fn make(&mut self, kind: Move) -> Option<()> {
        match kind {
            Move::Remove => self.remove(1),
            Move::RemoveRun => {
                let count = 2 + below(self.random, LONGEST_RUN - 1);
                self.remove(count)
            }
            Move::Insert => self.insert(),
            Move::Visit => self.visit(),
            Move::Divert => self.divert(),
            Move::Shift => self.shift(1),
            Move::ShiftLeg => self.shift(2),
            Move::Straighten => self.straighten(),
            Move::Turn => self.turn(1),
            Move::TurnRun => {
                let count = 2 + below(self.random, LONGEST_RUN - 1);
                self.turn(count)
            }
            Move::Aim => self.aim(),
            Move::Reverse => self.reverse(),
            Move::Relocate => self.relocate(),
            Move::Swap => self.swap(),
            Move::Merge => self.merge(),
        }
    }

    fn pose(&self, k: usize) -> Pose {
        self.flight.waypoints[k].pose
    }

    fn count(&self) -> usize {
        self.flight.waypoints.len()
    }

    /// Any waypoint of the sector, or of those in its focus.
    fn waypoint(&mut self) -> Option<usize> {
        match &self.near {
            Some(near) => (!near.is_empty()).then(|| near[below(self.random, near.len())]),
            None => {
                let sector = self.sector.of(self.count());
                (!sector.is_empty()).then(|| sector.start + below(self.random, sector.len()))
            }
        }
    }

    /// As many waypoints from `at` on as there are up to the end of the sector, at most `count`.
    fn run(&self, at: usize, count: usize) -> std::ops::Range<usize> {
        at..(at + count).min(self.sector.of(self.count()).end)
    }

    /// Adds a waypoint if it is admissible.
    fn put(&mut self, position: Point3<f64>, direction: Option<Unit<Vector3<f64>>>) -> Option<()> {
        let pose = Pose { position, direction };
        self.ground.problem.is_admissible(&pose).then(|| self.splice.stops.push(Stop::New(pose)))
    }

    fn remove(&mut self, count: usize) -> Option<()> {
        let at = self.waypoint()?;
        self.splice.range = self.run(at, count);
        Some(())
    }

    fn insert(&mut self) -> Option<()> {
        let sector = self.sector.of(self.count());
        let at = match &self.near {
            Some(_) => self.waypoint()?,
            None => sector.start + below(self.random, sector.len() + 1),
        };
        let share = uniform(self.random);
        let scale_m = 4.0 + 16.0 * uniform(self.random);
        let by = normal(self.random) * scale_m;
        let (position, direction) = match (at.checked_sub(1), at < self.count()) {
            (Some(before), true) => {
                let (from, to) = (self.pose(before), self.pose(at));
                (from.position + (to.position - from.position) * share + by, between(&from, &to, share))
            }
            // Beyond an end of the path.
            (before, _) => {
                let end = self.pose(before.unwrap_or(0));
                (end.position + by * 1.5, end.direction)
            }
        };
        let direction = if uniform(self.random) < 0.5 { direction } else { self.another_direction(direction, &position) };
        self.splice.range = at..at;
        self.put(position, direction)
    }

    fn visit(&mut self) -> Option<()> {
        let view = self.view_of_missing()?;
        let Pose { position, direction } = view;
        let to_m = |k: usize| (self.pose(k).position - position).norm();
        let detour_m = |at: usize| match (at.checked_sub(1), at < self.count()) {
            (Some(before), true) => to_m(before) + to_m(at) - (self.pose(at).position - self.pose(before).position).norm(),
            (before, _) => to_m(before.unwrap_or(0)),
        };
        let sector = self.sector.of(self.count());
        let mut places: Vec<(f64, usize)> = (sector.start..=sector.end).map(|at| (detour_m(at), at)).collect();
        let last = places.len() - 1;
        places.select_nth_unstable_by(DETOURS.min(last), |a, b| a.0.total_cmp(&b.0));
        places.truncate(DETOURS);
        places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // Structures often stand in the way of the shortest detour.
        let is_reached = |at: usize| {
            let before = at.checked_sub(1).is_none_or(|before| self.can_fly(&self.pose(before), &view));
            before && (at == self.count() || self.can_fly(&view, &self.pose(at)))
        };
        let at = places.into_iter().map(|(_, at)| at).find(|&at| is_reached(at))?;
        self.splice.range = at..at;
        self.put(position, direction)
    }

    fn can_fly(&self, from: &Pose, to: &Pose) -> bool {
        self.ground.problem.is_flyable(from, to) && self.ground.problem.free.is_leg_safe(&from.position, &to.position)
    }

    fn divert(&mut self) -> Option<()> {
        let Pose { position, direction } = self.view_of_missing()?;
        let away = |k: usize| (self.pose(k).position - position).norm_squared();
        let at = self.sector.of(self.count()).map(|k| (away(k), k)).min_by(|a, b| a.0.total_cmp(&b.0))?.1;
        self.splice.range = at..at + 1;
        self.put(position, direction)
    }

    fn shift(&mut self, count: usize) -> Option<()> {
        let at = self.waypoint()?;
        let mut by = normal(self.random) * SHIFTS_M[below(self.random, SHIFTS_M.len())];
        if uniform(self.random) < 0.3 {
            by.z = 0.0;
        }
        self.splice.range = self.run(at, count);
        self.splice.range.clone().try_for_each(|k| self.put(self.pose(k).position + by, self.pose(k).direction))
    }

    fn straighten(&mut self) -> Option<()> {
        let at = self.waypoint().filter(|&at| at > 0 && at + 1 < self.count())?;
        let [before, here, after] = [at - 1, at, at + 1].map(|k| self.pose(k).position);
        let chord = after - before;
        let share = ((here - before).dot(&chord) / chord.norm_squared().max(1e-9)).clamp(0.0, 1.0);
        let by = (before + chord * share - here) * uniform(self.random);
        self.splice.range = at..at + 1;
        self.put(here + by, self.pose(at).direction)
    }

    fn turn(&mut self, count: usize) -> Option<()> {
        let at = self.waypoint()?;
        let Pose { position, direction } = self.pose(at);
        let direction = self.another_direction(direction, &position)?;
        self.look_along(at, count, direction)
    }

    fn aim(&mut self) -> Option<()> {
        if !self.ground.problem.rig.has_gimbal() {
            return None;
        }
        let i = self.missing_sample()?;
        let frame = &self.ground.problem.frames[i];
        let target = frame.position + normal(self.random) * AIM_SPREAD_M;
        // The first one that could see it, from any waypoint on.
        let sector = self.sector.of(self.count());
        let from = self.waypoint()?;
        let at = (from..sector.end)
            .chain(sector.start..from)
            .find(|&k| self.ground.problem.disks.faces(frame, &self.pose(k).position))?;
        let direction = self.ground.aimed(&self.pose(at).position, &target)?;
        self.look_along(at, 1, direction)
    }

    fn look_along(&mut self, at: usize, count: usize, direction: Unit<Vector3<f64>>) -> Option<()> {
        self.splice.range = self.run(at, count);
        let turned =
            self.splice.range.clone().map(|k| Stop::New(Pose { direction: Some(direction), ..self.flight.waypoints[k].pose }));
        self.splice.stops.extend(turned);
        self.ground.problem.rig.reaches(&direction).then_some(())
    }

    fn reverse(&mut self) -> Option<()> {
        let at = self.waypoint()?;
        let other = self.neighbour(at)?;
        let (low, high) = (at.min(other), at.max(other));
        // `at` and `other` become neighbours, over the leg behind the one or before the other.
        let range = if uniform(self.random) < 0.5 { low + 1..high + 1 } else { low..high };
        self.splice.stops.extend(range.clone().rev().map(Stop::Kept));
        self.splice.range = range;
        (self.splice.range.len() >= 2).then_some(())
    }

    fn relocate(&mut self) -> Option<()> {
        let at = self.waypoint()?;
        let count = 1 + below(self.random, LONGEST_RUN - 1);
        let run = self.run(at, count);
        let other = self.neighbour(at)?;
        let place = other + usize::from(uniform(self.random) < 0.5);
        let is_turned = uniform(self.random) < 0.5;
        if (run.start..=run.end).contains(&place) {
            return None;
        }
        let moved = |k: usize| Stop::Kept(if is_turned { run.end - 1 - k } else { run.start + k });
        let stops = &mut self.splice.stops;
        if place < run.start {
            stops.extend((0..run.len()).map(moved));
            stops.extend((place..run.start).map(Stop::Kept));
            self.splice.range = place..run.end;
        } else {
            stops.extend((run.end..place).map(Stop::Kept));
            stops.extend((0..run.len()).map(moved));
            self.splice.range = run.start..place;
        }
        Some(())
    }

    fn swap(&mut self) -> Option<()> {
        let at = self.waypoint()?;
        let other = self.neighbour(at)?;
        let (low, high) = (at.min(other), at.max(other));
        self.splice.range = low..high + 1;
        let swapped = |k: usize| {
            Stop::Kept(if k == low {
                high
            } else if k == high {
                low
            } else {
                k
            })
        };
        self.splice.stops.extend((low..=high).map(swapped));
        Some(())
    }

    fn merge(&mut self) -> Option<()> {
        let at = self.waypoint()?;
        self.splice.range = self.run(at, 2);
        if self.splice.range.len() < 2 {
            return None;
        }
        let (a, b) = (self.pose(at), self.pose(at + 1));
        self.put(center(&a.position, &b.position), between(&a, &b, 0.5))
    }

    /// A waypoint of the sector, or of its focus, that is near another one in space: any of the nearest few.
    fn neighbour(&mut self, at: usize) -> Option<usize> {
        let here = self.pose(at).position;
        let sector = self.sector.of(self.count());
        let away = |k: usize| ((self.pose(k).position - here).norm_squared(), k);
        let mut others: Vec<(f64, usize)> = match &self.near {
            Some(near) => near.iter().filter(|&&k| k != at).map(|&k| away(k)).collect(),
            None => sector.filter(|&k| k != at).map(away).collect(),
        };
        let rank = below(self.random, NEIGHBOURS.min(others.len()).max(1));
        (rank < others.len()).then(|| others.select_nth_unstable_by(rank, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).1.1)
    }

    /// A sample that is not captured although it can be; while too few are matched, also one that is not. With a focus half of them lie in it: what
    /// cannot be had again there may be cheap elsewhere.
    fn missing_sample(&mut self) -> Option<usize> {
        let (all, counts) = (&self.ground.wanted, &self.flight.counts);
        let near = self.sector.focus.map(|focus| &focus.samples).filter(|near| !near.is_empty() && uniform(self.random) < 0.5);
        let wanted = near.unwrap_or(all);
        if wanted.is_empty() {
            return None;
        }
        let is_short = counts.worth().matched < self.required.matched;
        let is_missing = |&i: &usize| counts.cells.is_missing(i) || is_short && counts.matches.is_missing(i);
        (0..MISSING_TRIES).map(|_| wanted[below(self.random, wanted.len())] as usize).find(is_missing)
    }

    /// A place that the field shows a missing sample from, and a view towards it.
    fn view_of_missing(&mut self) -> Option<Pose> {
        let i = self.missing_sample()?;
        let (problem, seers) = (self.ground.problem, &self.ground.seers[i]);
        if seers.is_empty() {
            return None;
        }
        let j = seers[below(self.random, seers.len())] as usize;
        let mut jitter = || uniform(self.random) - 0.5;
        let offset = Vector3::new(jitter(), jitter(), jitter()) * problem.field.facts.lattice_spacing_m;
        let position = Point3::from(problem.field.viewpoints[j].position_m) + offset;
        if !problem.rig.has_gimbal() {
            return Some(Pose { position, direction: None });
        }
        let target = problem.frames[i].position + normal(self.random) * AIM_SPREAD_M;
        Some(Pose { position, direction: Some(self.ground.aimed(&position, &target)?) })
    }

    /// Another view direction for a place: one of the discretised ones, one towards any sample in range, or one near the present one.
    fn another_direction(&mut self, now: Option<Unit<Vector3<f64>>>, position: &Point3<f64>) -> Option<Unit<Vector3<f64>>> {
        let problem = self.ground.problem;
        let now = now.filter(|_| problem.rig.has_gimbal())?;
        match below(self.random, 4) {
            0 => Some(problem.view_directions[below(self.random, problem.view_directions.len())]),
            1 => {
                let range_m = problem.disks.range_m();
                let targets = (0..TARGET_TRIES).map(|_| problem.frames[below(self.random, problem.frames.len())].position);
                let target = targets.into_iter().find(|target| (target - position).norm() < range_m);
                target.and_then(|target| self.ground.aimed(position, &target)).or(Some(now))
            }
            _ => {
                let scale = 0.1 + 0.4 * uniform(self.random);
                self.ground.within_reach(&(now.into_inner() + normal(self.random) * scale))
            }
        }
    }
}

/// The shortest so many detours to a view are looked at.
const DETOURS: usize = 4;

/// So many waypoints are near one in space.
const NEIGHBOURS: usize = 10;

/// Draws until something that is looked for is given up.
const MISSING_TRIES: usize = 24;
const TARGET_TRIES: usize = 8;

/// How far beside a sample a view towards it aims, standard deviation in m: a sample seen with its surroundings is worth more.
const AIM_SPREAD_M: f64 = 5.0;

fn between(from: &Pose, to: &Pose, share: f64) -> Option<Unit<Vector3<f64>>> {
    let (first, last) = from.direction.zip(to.direction)?;
    Some(slerp(&first, &last, share))
}
