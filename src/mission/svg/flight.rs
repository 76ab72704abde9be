//! The path with the time at which each of its points is passed.

use nalgebra::Point3;

use crate::trajectory::plan::Plan;
use crate::trajectory::samples::samples;

/// How far an image may lie from its leg, m, and still count as taken on it.
const ON_LEG_M: f64 = 1e-3;

/// A point of the path and when it is passed, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instant {
    pub position_m: Point3<f64>,
    pub time_s: f64,
}

/// The timed curve. Of a plan that does not say what it was timed with, the waypoints and the images between them, in flight order: images
/// carry their time; at the waypoints between them time is interpolated over the distance flown.
pub fn timed_path(plan: &Plan) -> Vec<Instant> {
    if let Some(profile) = plan.profile() {
        let samples = samples(&profile).into_iter();
        return samples.map(|sample| Instant { position_m: sample.position_m, time_s: sample.time_s }).collect();
    }
    let (stations, total_m) = stations(plan);
    let mut knots: Vec<(f64, f64)> = vec![(0.0, 0.0)];
    for station in &stations {
        if let Some(time_s) = station.time_s {
            let (last_m, last_s) = knots[knots.len() - 1];
            if station.distance_m > last_m && time_s >= last_s {
                knots.push((station.distance_m, time_s));
            }
        }
    }
    let (last_m, last_s) = knots[knots.len() - 1];
    if total_m > last_m {
        knots.push((total_m, plan.metrics.profile_s.max(last_s)));
    }
    stations
        .iter()
        .map(|station| Instant { position_m: station.position_m, time_s: time_at(&knots, station.distance_m) })
        .collect()
}

/// Splits the path into pieces of equal duration; each piece is a polyline that starts where the one before ends.
pub fn split_by_time(path: &[Instant], pieces: usize) -> Vec<Vec<Point3<f64>>> {
    let Some(duration_s) = path.last().map(|last| last.time_s).filter(|duration_s| *duration_s > 0.0) else {
        return vec![path.iter().map(|instant| instant.position_m).collect()];
    };
    let mut split: Vec<Vec<Point3<f64>>> = vec![Vec::new(); pieces];
    let piece_of = |time_s: f64| ((time_s / duration_s * pieces as f64) as usize).min(pieces - 1);
    for leg in path.windows(2) {
        let (from, to) = (&leg[0], &leg[1]);
        let (first, last) = (piece_of(from.time_s), piece_of(to.time_s));
        for (index, piece) in split.iter_mut().enumerate().take(last + 1).skip(first) {
            let starts_s = duration_s * index as f64 / pieces as f64;
            let ends_s = duration_s * (index + 1) as f64 / pieces as f64;
            if piece.is_empty() {
                piece.push(at_time(from, to, starts_s.max(from.time_s)).unwrap_or(from.position_m));
            }
            piece.push(at_time(from, to, ends_s.min(to.time_s)).unwrap_or(to.position_m));
        }
    }
    split.retain(|piece| piece.len() > 1);
    split
}

struct Station {
    position_m: Point3<f64>,
    distance_m: f64,
    time_s: Option<f64>,
}

/// Waypoints and images in flight order with the distance flown. Images lie on the path in flight order; from the first one that does
/// not, they are left out.
fn stations(plan: &Plan) -> (Vec<Station>, f64) {
    let mut stations = Vec::with_capacity(plan.waypoints.len() + plan.images.len());
    let mut images = plan.images.iter().peekable();
    let mut flown_m = 0.0;
    for (index, waypoint) in plan.waypoints.iter().enumerate() {
        let from = waypoint.position_m;
        stations.push(Station { position_m: from, distance_m: flown_m, time_s: None });
        let Some(next) = plan.waypoints.get(index + 1) else { break };
        let leg = next.position_m - from;
        let leg_m = leg.norm();
        let mut along_m = 0.0;
        while let Some(image) = images.peek() {
            let share = if leg_m > 0.0 { (image.position_m - from).dot(&leg) / (leg_m * leg_m) } else { 0.0 };
            let foot = from + leg * share.clamp(0.0, 1.0);
            if (image.position_m - foot).norm() > ON_LEG_M || share * leg_m + ON_LEG_M < along_m {
                break;
            }
            along_m = (share.clamp(0.0, 1.0) * leg_m).max(along_m);
            stations.push(Station { position_m: foot, distance_m: flown_m + along_m, time_s: Some(image.time_s) });
            images.next();
        }
        flown_m += leg_m;
    }
    (stations, flown_m)
}

fn time_at(knots: &[(f64, f64)], distance_m: f64) -> f64 {
    let above = knots.partition_point(|knot| knot.0 < distance_m);
    let Some(&(to_m, to_s)) = knots.get(above) else { return knots[knots.len() - 1].1 };
    let Some(&(from_m, from_s)) = above.checked_sub(1).and_then(|below| knots.get(below)) else { return to_s };
    from_s + (to_s - from_s) * (distance_m - from_m) / (to_m - from_m)
}

/// The point of a leg at `time_s`; `None` for a leg that takes no time.
fn at_time(from: &Instant, to: &Instant, time_s: f64) -> Option<Point3<f64>> {
    let duration_s = to.time_s - from.time_s;
    let share = ((time_s - from.time_s) / duration_s).clamp(0.0, 1.0);
    (duration_s > 0.0).then(|| from.position_m + (to.position_m - from.position_m) * share)
}
