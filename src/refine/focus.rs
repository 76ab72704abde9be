//! Where a flight is mended first after an edit: near what changed, because what the edit took is mostly had again there.

use nalgebra::Point3;

use super::flight::Flight;
use super::ground::Ground;
use crate::scene::bounds::Bounds;

/// So many waypoints are near what changed, however large the scene is; all that are less than `LEAST_M` away as well. With 32 of the 135 over
/// nihonbashi a flight of 1200 rounds is within 3 % of its old time after 0.06 s where rounds all along it take 0.12 s (median of 12 edits).
const WAYPOINTS: usize = 32;
const LEAST_M: f64 = 20.0;

/// An edit that changes more boxes than these touches the flight all along.
const MOST_BOXES: usize = 8;

/// The neighbourhood of what changed.
#[derive(Clone, Debug)]
pub struct Focus {
    changed: Vec<Bounds>,
    within_m: f64,
    /// The samples in it that count.
    pub samples: Vec<u32>,
}

impl Focus {
    /// Around boxes in which a scene changed, m; `None` where nothing did, or too much.
    pub fn new(ground: &Ground, flight: &Flight, changed: &[Bounds]) -> Option<Self> {
        Self::of_so_many(WAYPOINTS, ground, flight, changed)
    }

    fn of_so_many(waypoints: usize, ground: &Ground, flight: &Flight, changed: &[Bounds]) -> Option<Self> {
        if changed.is_empty() || changed.len() > MOST_BOXES {
            return None;
        }
        let mut focus = Self { changed: changed.to_vec(), within_m: LEAST_M, samples: Vec::new() };
        let mut away_m: Vec<f64> = flight.waypoints.iter().map(|waypoint| focus.away_m(&waypoint.pose.position)).collect();
        let last = waypoints.min(away_m.len()).checked_sub(1)?;
        let (_, farthest_m, _) = away_m.select_nth_unstable_by(last, f64::total_cmp);
        focus.within_m = farthest_m.max(LEAST_M);
        let is_near = |&i: &u32| focus.contains(&ground.problem.frames[i as usize].position);
        focus.samples = ground.wanted.iter().copied().filter(is_near).collect();
        Some(focus)
    }

    pub fn contains(&self, p: &Point3<f64>) -> bool {
        self.away_m(p) <= self.within_m
    }

    /// Distance to what changed as seen from above, m: flights pass high over most of it.
    fn away_m(&self, p: &Point3<f64>) -> f64 {
        let level = |bounds: &Bounds| bounds.distance_squared(&Point3::new(p.x, p.y, bounds.min.z));
        self.changed.iter().map(level).fold(f64::INFINITY, f64::min).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::camera::{Pose, Rig};
    use crate::refine::annealing::{Aim, Annealing};
    use crate::refine::counts::Worth;
    use crate::refine::ground::Counting;
    use crate::refine::tests::small_block;
    use crate::search::Problem;
    use crate::stop::StopToken;

    /// Places that two paths do not have in common: those of the first one.
    fn gone(before: &[Pose], after: &[Pose]) -> Vec<Point3<f64>> {
        let is_gone = |pose: &&Pose| after.iter().all(|other| other.position != pose.position);
        before.iter().filter(is_gone).map(|pose| pose.position).collect()
    }

    #[test]
    fn rounds_near_a_change_change_the_flight_there() {
        let (snapshot, settings) = small_block();
        let problem = Problem::new(&snapshot, &settings, Rig::preset("panoramic").expect("a preset"));
        let ground = Ground::new(&problem, &settings, false, Counting::Matched, &StopToken::default());
        let positions: Vec<Point3<f64>> = problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect();
        let next = *positions.iter().find(|next| problem.can_fly(&positions[0], next)).expect("some leg is free");
        let path = [positions[0], next].map(|position| Pose { position, direction: None });
        let required = Worth { captured: problem.sufficient, matched: problem.enough_matched(95.0) };
        let mut annealing = Annealing::new(&ground, &path, Aim::LeastTime { required }, 3);
        (0..24).for_each(|_| annealing.round(3e8));
        let before = annealing.flight.path();
        assert!(before.len() > 12, "{} waypoints", before.len());

        let corner = before.iter().map(|pose| pose.position).min_by(|a, b| (a.x + a.y).total_cmp(&(b.x + b.y))).expect("some");
        let changed = [Bounds { min: corner, max: corner + Vector3::repeat(2.0) }];
        let nearest = before.len() / 3;
        let focus = Focus::of_so_many(nearest, &ground, &annealing.flight, &changed).expect("something changed");
        let away_m = |p: &Point3<f64>| focus.away_m(p);
        let near: Vec<_> = before.iter().filter(|pose| focus.contains(&pose.position)).collect();
        let closer = before.iter().filter(|pose| near.iter().all(|near| away_m(&pose.position) < away_m(&near.position))).count();
        assert!(near.len() >= nearest && near.len() < 2 * before.len() / 3 && closer == 0, "{} of {}", near.len(), before.len());
        assert!(focus.samples.iter().all(|i| ground.wanted.contains(i)) && focus.samples.len() < ground.wanted.len());

        let share_near = |after: &Annealing| {
            let gone = gone(&before, &after.flight.path());
            assert!(gone.len() > 2, "{gone:?}");
            gone.iter().filter(|p| focus.contains(p)).count() as f64 / gone.len() as f64
        };
        let mut all_along = annealing.clone();
        let mut short = annealing.clone();
        (0..6).for_each(|_| annealing.round_near(&focus, 1e8));
        (0..6).for_each(|_| all_along.round(1e8));
        let shares = [share_near(&annealing), share_near(&all_along)];
        assert!(shares[0] > 0.8 && shares[1] < 0.6, "{shares:?} of what changed is near");

        // More than the flight has: what is missing becomes dearer by rounds all along it alone.
        short.demand.required = ground.most;
        let price_ns = |annealing: &Annealing| annealing.demand.prices_ns.captured;
        let at_first_ns = price_ns(&short);
        (0..4).for_each(|_| short.round_near(&focus, 3e7));
        assert_eq!(price_ns(&short), at_first_ns);
        (0..4).for_each(|_| short.round(3e7));
        assert!(price_ns(&short) > at_first_ns, "{} ns", price_ns(&short));
    }

    #[test]
    fn without_a_change_or_with_changes_everywhere_there_is_no_focus() {
        let (snapshot, settings) = small_block();
        let problem = Problem::new(&snapshot, &settings, Rig::preset("panoramic").expect("a preset"));
        let ground = Ground::new(&problem, &settings, false, Counting::Matched, &StopToken::default());
        let positions = problem.field.viewpoints.iter().take(2).map(|row| row.position_m.into());
        let path: Vec<Pose> = positions.map(|position| Pose { position, direction: None }).collect();
        let flight = Flight::new(&ground, &path);
        let of =
            |count: usize| Focus::new(&ground, &flight, &vec![Bounds { min: path[0].position, max: path[1].position }; count]);
        assert_eq!([0, 1, MOST_BOXES, MOST_BOXES + 1].map(|count| of(count).is_some()), [false, true, true, false]);
    }
}
