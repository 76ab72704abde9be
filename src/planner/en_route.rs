//! A flight that goes on from an aircraft in the air: with its speed and its view, with what was captured already, and back in time.
//!
//! How it leaves the pose is decided before anything is searched, by one rule. The aircraft flies straight on for twice the way on which it could come
//! to rest, and at least for the length of a leg, where that is safe: however sharp the corner is that follows, it can be flown. Elsewhere it brakes to
//! rest first. From where it must not be at rest (in a structure that was not known before, nearer to something than is safe, in a no-fly zone) it
//! gets out along the shortest straight way that leads nearer to nothing; without one it is told to hold ([`crate::trajectory::egress`]).

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};

use super::order::Order;
use super::resume::{self, REACH_SPACINGS};
use super::{PlanError, start};
use crate::baseline::router::Router;
use crate::camera::{Cameras, Pose};
use crate::field::Snapshot;
use crate::search::Problem;
use crate::search::captured::Captured;
use crate::search::leg::heading;
use crate::stop::StopToken;
use crate::trajectory::egress::{Egress, can_brake, leads_out};
use crate::trajectory::evaluate;
use crate::trajectory::limits::Limits;
use crate::trajectory::plan::{Image, Plan};
use crate::trajectory::profile::Profile;
use crate::trajectory::route::{Exposure, Route};

/// An aircraft in the air.
#[derive(Clone, Debug, PartialEq)]
pub struct EnRoute {
    /// Where it is, m in the local frame.
    pub position_m: Point3<f64>,
    /// How it moves, m/s; at less than 0.1 it counts as hovering.
    pub velocity_mps: Vector3<f64>,
    /// Where a camera on a gimbal looks; `None` lets the planner choose, as for a rig without one.
    pub view: Option<Unit<Vector3<f64>>>,
    /// What was captured so far: none of it is ordered again.
    pub captured: Arc<Captured>,
    /// The flight has to end within this time of its profile, s; `None` for as long as it takes.
    pub time_left_s: Option<f64>,
    /// Where it has to end, m in the local frame: as safe a place as any other of the flight; `None` for anywhere.
    pub landing_m: Option<Point3<f64>>,
}

/// An aircraft that is slower hovers, m/s.
const LEAST_SPEED_MPS: f64 = 0.1;
/// No aircraft that plans are made for is faster, m/s.
pub const MOST_SPEED_MPS: f64 = 50.0;
/// A way out is looked for to viewpoints no farther than this, m.
const FARTHEST_OUT_M: f64 = 150.0;
/// Places nearer to each other are one, m.
const SAME_M: f64 = 0.01;

/// Adds what images capture that were taken in the scene of a snapshot; `None`, and nothing is added, when abandoned.
pub fn add_images(captured: &mut Captured, snapshot: &Snapshot, images: &[Image], stop: &StopToken) -> Option<()> {
    let sightings = evaluate::sightings(snapshot, &snapshot.disks, images, stop)?;
    let seen: Vec<Vec<u32>> = sightings.0.iter().map(|seen| seen.iter().map(|one| one.image).collect()).collect();
    captured.add(snapshot, images.iter().map(|image| image.position_m), |i| &seen[i]);
    Some(())
}

/// What is left of a plan's waypoints behind the place where its flight is after a number of images, or at a time.
pub fn waypoints_left(plan: &Plan, images: usize) -> Vec<Pose> {
    let last_s = images.checked_sub(1).and_then(|last| plan.images.get(last)).map(|image| image.time_s);
    let passage = plan.profile().zip(last_s).and_then(|(profile, last_s)| profile.at(last_s));
    plan.poses().into_iter().skip(passage.map_or(0, |passage| passage.leg + 1)).collect()
}

/// What there is to say of how a flight begins; nothing of one that begins like all others.
pub fn remark(plan: &Plan) -> Option<String> {
    let leg_m = |leg: usize| (plan.waypoints[leg + 1].position_m - plan.waypoints[leg].position_m).norm();
    let Egress { brakes, escapes } = plan.egress;
    let brakes = brakes.then(|| format!("the way on is not safe: the aircraft brakes first, within {:.1} m", leg_m(0)));
    let escapes = escapes.then(|| {
        let leg = plan.egress.legs() - 1;
        let [x, y, z] = plan.waypoints[leg + 1].position_m.into();
        // A way out that leads away from a surface never touches one.
        let through = if plan.clearance_m > 0.0 { "" } else { ", through a surface that the scene has there" };
        let way_m = leg_m(leg);
        format!(
            "the aircraft comes to be where it must not: it gets out straight over {way_m:.1} m to ({x:.1}, {y:.1}, {z:.1}), nearer to nothing on the \
             way{through}"
        )
    });
    let said: Vec<String> = brakes.into_iter().chain(escapes).collect();
    (!said.is_empty()).then(|| said.join("; "))
}

impl EnRoute {
    /// What can be refused before there is a scene.
    pub(super) fn check(&self) -> Result<(), PlanError> {
        let Self { position_m, velocity_mps, landing_m, .. } = self;
        let places = std::iter::once(position_m).chain(landing_m);
        let are_finite = places.flat_map(|place| place.coords.iter()).all(|value| value.is_finite());
        let speed_mps = velocity_mps.norm();
        // Written so that NaN is refused too.
        let flies = are_finite && speed_mps <= MOST_SPEED_MPS;
        if flies { Ok(()) } else { Err(PlanError::Pose { speed_mps }) }
    }
}

/// How a flight leaves the pose.
pub(super) struct Departure {
    /// Where the aircraft is to come to rest before the part of the flight that is searched begins, the pose itself first; none where it flies on.
    stops: Vec<Pose>,
    pub egress: Egress,
    /// The beginning of the part that is searched, which stays as it is.
    head: Vec<Pose>,
    /// Speed at the pose, m/s.
    entry_mps: f64,
    /// Time until the part that is searched begins, s.
    stops_s: f64,
    landing_m: Option<Point3<f64>>,
    time_left_s: Option<f64>,
}

impl Departure {
    /// Decides how the aircraft leaves its pose; `direction` is where its camera looks.
    pub fn of(
        problem: &Problem,
        limits: &Limits,
        en_route: &EnRoute,
        direction: Option<Unit<Vector3<f64>>>,
    ) -> Result<Self, PlanError> {
        let EnRoute { position_m, velocity_mps, landing_m, time_left_s, .. } = en_route;
        let free = problem.free;
        if let Some((position, cause)) = landing_m.and_then(|landing_m| Some((landing_m, free.obstruction_at(&landing_m)?))) {
            return Err(PlanError::Landing { position: place(&position), cause });
        }
        let speed_mps = velocity_mps.norm();
        let entry_mps = if speed_mps < LEAST_SPEED_MPS { 0.0 } else { speed_mps };
        let pose = |position: Point3<f64>| Pose { position, direction };
        let departure = Self {
            stops: Vec::new(),
            egress: Egress::default(),
            head: vec![pose(*position_m)],
            entry_mps,
            stops_s: 0.0,
            landing_m: *landing_m,
            time_left_s: *time_left_s,
        };
        let braking_m = limits.braking_m(entry_mps);
        let ahead = |way_m: f64| position_m + velocity_mps * (way_m / speed_mps.max(f64::MIN_POSITIVE));
        let is_safe_to = |to: &Point3<f64>| free.is_safe(position_m) && free.is_safe(to) && free.is_leg_safe(position_m, to);
        let lead_m = (2.0 * braking_m).max(problem.spacing.least_leg_m);
        if entry_mps == 0.0 && free.is_safe(position_m) {
            return Ok(departure);
        }
        if entry_mps > 0.0 && is_safe_to(&ahead(lead_m)) {
            return Ok(Self { head: vec![pose(*position_m), pose(ahead(lead_m))], ..departure });
        }
        let (mut stops, mut egress, mut at) = (Vec::new(), Egress::default(), *position_m);
        if entry_mps > 0.0 {
            if !can_brake(free, position_m, &ahead(braking_m)) {
                return Err(PlanError::CannotBrake { position: place(position_m), braking_m });
            }
            (at, egress.brakes) = (ahead(braking_m), true);
            stops.push(pose(*position_m));
        }
        if let Some(cause) = free.obstruction_at(&at) {
            stops.push(pose(at));
            at = way_out(problem, &at).ok_or_else(|| PlanError::Hold { position: place(&at), cause })?;
            egress.escapes = true;
        }
        let mut flown: Vec<Pose> = stops.clone();
        flown.push(pose(at));
        let limits = Limits { entry_mps, ..*limits };
        let stops_s = Profile::rounded(&flown, &limits, &vec![0.0; flown.len()]).duration_s();
        Ok(Self { stops, egress, head: vec![pose(at)], stops_s, ..departure })
    }

    /// Speed with which the part that is searched begins, m/s.
    pub fn search_entry_mps(&self) -> f64 {
        if self.stops.is_empty() { self.entry_mps } else { 0.0 }
    }

    /// Where the search begins: at the end of what stays as it is.
    pub fn start(&self) -> Pose {
        *self.head.last().expect("the head has the pose")
    }

    /// So many waypoints of the part that is searched have to stay at its beginning and at its end.
    pub fn fixed(&self) -> [usize; 2] {
        [self.head.len(), usize::from(self.landing_m.is_some())]
    }

    /// Whether images are taken at both ends of the part that is searched: not at the pose, where the shutter may have been released just before, and not
    /// where the aircraft lands, which may be where it came from.
    pub fn takes_at_ends(&self) -> [bool; 2] {
        [false, self.landing_m.is_none()]
    }

    /// Time that is left for the part that is searched, s.
    pub fn search_left_s(&self) -> Option<f64> {
        self.time_left_s.map(|left_s| left_s - self.stops_s)
    }

    /// A path from the start of the search on, with the head before it and the way to the landing place behind it. Waypoints from which there is none are
    /// left out from the end; `None` where there is no way at all.
    pub fn landed(&self, problem: &Problem, path: &[Pose]) -> Option<Vec<Pose>> {
        let mut body = self.head.clone();
        body.extend_from_slice(path.get(1..).unwrap_or_default());
        let Some(landing_m) = self.landing_m else { return Some(body) };
        while body.len() > self.head.len() {
            let last = body.last().expect("it is longer than the head");
            let landing = Pose { position: landing_m, ..*last };
            if let Some(way) = resume::way(problem, last, &landing) {
                body.extend(way);
                body.push(landing);
                return Some(body);
            }
            body.pop();
        }
        self.direct(problem)
    }

    /// The shortest safe way to the landing place, whatever images there are on it; without one the head alone. `None` where there is no way.
    pub fn direct(&self, problem: &Problem) -> Option<Vec<Pose>> {
        let mut body = self.head.clone();
        let Some(landing_m) = self.landing_m else { return Some(body) };
        let start = self.start();
        if (landing_m - start.position).norm() < SAME_M {
            return Some(body);
        }
        if problem.free.is_leg_safe(&start.position, &landing_m) {
            body.push(Pose { position: landing_m, ..start });
            return Some(body);
        }
        let field = &problem.field;
        let nodes = field.viewpoints.iter().map(|row| Point3::from(row.position_m)).collect();
        let mut router = Router::new(problem.free, nodes, field.facts.lattice_spacing_m * REACH_SPACINGS);
        let corners = router.detour(&start.position, &landing_m)?;
        body.extend(corners.into_iter().chain([landing_m]).map(|position| Pose { position, ..start }));
        Some(body)
    }

    /// The whole path of a flight whose searched part is `body`.
    pub fn whole(&self, body: &[Pose]) -> Vec<Pose> {
        self.stops.iter().chain(body).copied().collect()
    }

    /// The whole route of a flight whose searched part is `route`.
    pub fn whole_route(&self, route: Route) -> Route {
        let before = self.stops.len();
        let behind = |exposure: &Exposure| exposure.leg > 0 || exposure.flown_m > 0.0;
        let mut exposures = route.exposures;
        if self.landing_m.is_some() {
            exposures.pop();
        }
        let exposures = exposures.into_iter().filter(behind).map(|one| Exposure { leg: one.leg + before, ..one });
        Route { waypoints: self.whole(&route.waypoints), exposures: exposures.collect(), ..route }
    }

    /// The deviations of the arcs with stops where the aircraft is to come to rest.
    pub fn stopped(&self, mut deviations_m: Vec<f64>) -> Vec<f64> {
        if !self.stops.is_empty() {
            deviations_m.iter_mut().take(self.stops.len() + 1).for_each(|deviation_m| *deviation_m = 0.0);
        }
        deviations_m
    }

    pub fn entry_mps(&self) -> f64 {
        self.entry_mps
    }

    pub fn stops_s(&self) -> f64 {
        self.stops_s
    }
}

impl Order<'_> {
    /// How the flight leaves the pose, where there is one; an error when there is no time left but for landing.
    pub(super) fn depart(&self, en_route: &EnRoute) -> Result<Departure, PlanError> {
        let Self { problem, settings, .. } = *self;
        let limits = Limits::new(&problem.rig, &settings.flight, &settings.dynamics);
        let direction = match problem.rig.cameras {
            Cameras::Panoramic { .. } => None,
            Cameras::Gimbal { .. } => Some(match en_route.view {
                Some(view) => view,
                None => start::best_direction(problem, &en_route.position_m),
            }),
            Cameras::Rigid(_) => Some(heading(&Point3::origin(), &Point3::from(en_route.velocity_mps))),
        };
        Departure::of(problem, &limits, en_route, direction)
    }

    /// The way to the landing place, if there is time for it.
    pub(super) fn way_home(&self, departure: &Departure) -> Result<Vec<Pose>, PlanError> {
        let to_landing = || departure.landing_m.as_ref().map(place).unwrap_or_default();
        let home = departure.direct(self.problem).ok_or_else(|| PlanError::NoWayHome { landing: to_landing() })?;
        match departure.time_left_s {
            Some(left_s) if self.profile(&home).duration_s() > left_s => {
                Err(PlanError::LandNow { left_s, way_s: self.profile(&home).duration_s() })
            }
            _ => Ok(home),
        }
    }
}

/// The nearest safe viewpoint that a way out leads to.
fn way_out(problem: &Problem, at: &Point3<f64>) -> Option<Point3<f64>> {
    let places = problem.field.viewpoints.iter().map(|row| Point3::from(row.position_m));
    let mut near: Vec<(f64, Point3<f64>)> = places.map(|place| ((place - at).norm(), place)).collect();
    near.retain(|(distance_m, _)| (SAME_M..=FARTHEST_OUT_M).contains(distance_m));
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    near.into_iter().map(|(_, place)| place).find(|place| leads_out(problem.free, at, place))
}

fn place(p: &Point3<f64>) -> String {
    format!("{:.1}, {:.1}, {:.1}", p.x, p.y, p.z)
}
