//! What is ordered of a flight, and the way from a path to a plan.

use std::sync::Arc;

use super::en_route::Departure;
use super::{Made, Method, PlanError, PlanOptions, resume, start};
use crate::camera::Pose;
use crate::field::Snapshot;
use crate::refine::{Confirmed, Worth};
use crate::search::leg::headed;
use crate::search::objective::PathSums;
use crate::search::{Outcome, Problem, Progress, search};
use crate::settings::Settings;
use crate::stop::StopToken;
use crate::trajectory::egress::Egress;
use crate::trajectory::evaluate::Capture;
use crate::trajectory::images::Exposed;
use crate::trajectory::known::{Known, SafeFlight, Scope};
use crate::trajectory::limits::Limits;
use crate::trajectory::plan::{Camera, Metrics, Plan, SceneStamp, StopReason, Waypoint};
use crate::trajectory::profile::Profile;
use crate::trajectory::record::Record;
use crate::trajectory::route::{Found, Route};
use crate::trajectory::{images, safety, select};

/// What the images of another flight see, so that only those are looked at that are new.
pub enum Before {
    Nothing,
    /// In the field before an edit.
    Edit(Record),
    /// In this very field.
    Look(Record),
}

/// What a flight is planned by.
pub struct Order<'o> {
    pub snapshot: &'o Snapshot,
    pub settings: &'o Settings,
    pub options: &'o PlanOptions,
    pub problem: &'o Problem<'o>,
    pub matched_goal_percent: f64,
    pub stop: &'o StopToken,
    /// How a flight leaves an aircraft's pose, for one that is in the air already.
    pub departure: Option<Departure>,
    /// What is known to be safe of the flight before.
    pub known: Option<Known>,
}

impl Order<'_> {
    /// The plan of a flight that is not the last one.
    pub fn on_the_way(&self, path: &[Pose], stop: StopReason, before: Before) -> Result<Made, PlanError> {
        let outcome = Outcome { path: path.to_vec(), convergence: Vec::new(), stop };
        self.finished(Found::of(outcome, self.problem), before)
    }

    /// The plan of a flight that was found, with what its images capture. With the record of another flight only what differs from it is
    /// looked at.
    pub fn finished(&self, Found { route, convergence, stop: reason }: Found, before: Before) -> Result<Made, PlanError> {
        let Self { snapshot, problem, matched_goal_percent, stop, ref departure, .. } = *self;
        let flight = self.checked(route)?;
        let images = &flight.exposed.images;
        let record = match before {
            Before::Edit(before) => before.after(snapshot, problem, images, stop),
            Before::Look(before) => before.beside(snapshot, problem, images, stop),
            Before::Nothing => Record::new(snapshot, problem, images, stop),
        };
        let mut record = record.ok_or(PlanError::Abandoned)?;
        let capture = record.capture(problem);
        let mut plan = self.uncounted(&flight);
        // Which images are dispensable takes longer to find out than a flight on the way may wait.
        if !matches!(reason, StopReason::Repaired | StopReason::Improved) {
            let enough = problem.enough_matched(matched_goal_percent);
            let selected = select::select(problem, record.sightings(), images.len(), enough);
            plan.images.iter_mut().zip(selected).for_each(|(image, selected)| image.selected = selected);
        }
        self.check_wanted()?;
        // What belongs to no leg: the views at the start, or what was captured before a flight that begins in the air.
        let at_start = match departure {
            None => record.information_at_start(problem),
            Some(_) => problem.captured_information(),
        };
        // Eq. 6 sums from k = 2: what the views at the start see belongs to no leg.
        let Metrics { length_m, turning_s, .. } = plan.metrics;
        let on_legs = PathSums { information: capture.information - at_start, length_m, turning_s };
        let metrics = Metrics {
            coverage_percent: capture.coverage_percent,
            coverage_exposed_percent: capture.coverage_exposed_percent,
            capturable_percent: capture.capturable_percent,
            matched_percent: capture.matched_percent,
            information: problem.objective.gain(capture.information),
            objective: problem.objective.value(&on_legs),
            ..plan.metrics
        };
        let (cells, ceilings) = (capture.cells, problem.ceilings.clone());
        record.flight = Some(flight);
        Ok(Made { plan: Plan { metrics, cells, ceilings, convergence, stop: reason, ..plan }, record })
    }

    /// The plan of a path of which nobody has looked yet what it captures, and what is known of its safety then.
    pub fn safe_plan(&self, path: &[Pose]) -> Result<(Plan, Arc<SafeFlight>), PlanError> {
        let flight = self.checked(Route::continuous(path, &self.problem.rig, self.problem.spacing))?;
        Ok((self.uncounted(&flight), flight))
    }

    /// A route as it is flown: its curve, timed, with its images, and safe all along.
    fn checked(&self, route: Route) -> Result<Arc<SafeFlight>, PlanError> {
        let Self { snapshot, problem, ref departure, .. } = *self;
        let (rig, free) = (&problem.rig, &snapshot.free);
        let route = self.whole_route(route);
        let (limits, egress) = (self.limits(), departure.as_ref().map_or_else(Egress::default, |departure| departure.egress));
        if let Some(flight) = self.known.as_ref().and_then(|known| known.flight(rig, &route, &limits, egress, free)) {
            return Ok(Arc::clone(flight));
        }
        self.check_wanted()?;
        let (deviations_m, profile) = self.timed(&route.waypoints, &limits);
        self.check_wanted()?;
        let exposed = images::expose(&route, rig, &profile);
        self.check_wanted()?;
        egress.check(&profile.curve().waypoints, &limits, free)?;
        let clearance_m = safety::check_behind(profile.curve(), egress.legs(), self.scope())?;
        safety::check_views(rig, &exposed.images)?;
        self.check_wanted()?;
        let blur_px = images::blur_px(&exposed, rig, &free.clearance);
        Ok(Arc::new(SafeFlight {
            rig: rig.clone(),
            route,
            limits,
            deviations_m,
            profile,
            exposed,
            egress,
            clearance_m,
            blur_px,
            space: Arc::downgrade(free),
            revision: snapshot.revision,
            safety_distance_m: free.safety_distance_m,
        }))
    }

    /// The plan of a flight without what it captures.
    fn uncounted(&self, flight: &SafeFlight) -> Plan {
        let Self { snapshot, settings, options, problem, matched_goal_percent, .. } = *self;
        let SafeFlight { rig, route, limits, deviations_m, profile, exposed, egress, clearance_m, blur_px, .. } = flight;
        let Exposed { images, delayed, dropped, .. } = exposed;
        let travel = problem.objective.travel(&route.waypoints);
        let movement_s = travel.length_m / settings.flight.cruise_speed_mps;
        let metrics = Metrics {
            length_m: travel.length_m,
            movement_s,
            turning_s: travel.turning_s,
            flight_s: movement_s + travel.turning_s,
            profile_s: profile.duration_s(),
            battery_percent: rig.battery.map(|battery| battery.percent(movement_s, travel.turning_s)),
            delayed_exposures: *delayed,
            dropped_exposures: *dropped,
            blur_px: *blur_px,
            ..Metrics::uncounted()
        };
        let waypoint =
            |(pose, &deviation_m): (&Pose, &f64)| Waypoint { position_m: pose.position, direction: pose.direction, deviation_m };
        Plan {
            scene: SceneStamp {
                name: snapshot.scene.name.clone(),
                origin: snapshot.scene.frame.origin,
                revision: snapshot.revision,
            },
            seed: options.seed,
            rig: rig.name.clone(),
            method: options.method.name().to_owned(),
            cameras: Camera::all_of(rig),
            metrics,
            limits: Some(*limits),
            waypoints: route.waypoints.iter().zip(deviations_m).map(waypoint).collect(),
            images: images.clone(),
            cells: Vec::new(),
            ceilings: Vec::new(),
            goal_percent: settings.coverage.goal_percent,
            matched_goal_percent,
            egress: *egress,
            clearance_m: *clearance_m,
            convergence: Vec::new(),
            stop: StopReason::Safe,
        }
    }

    /// Each of a plan's parts takes milliseconds in a large scene: between them it is looked whether anybody still wants it.
    pub fn check_wanted(&self) -> Result<(), PlanError> {
        if self.stop.is_abandoned() { Err(PlanError::Abandoned) } else { Ok(()) }
    }

    /// What can still be flown of an earlier flight, for the methods whose images are all along the path.
    pub fn resumed(&self) -> Option<Vec<Pose>> {
        let Self { options, problem, .. } = *self;
        let earlier = options.earlier.as_ref().filter(|_| matches!(options.method, Method::Refined | Method::Paper))?;
        let path = match &self.departure {
            None => resume::resumed(problem, earlier, options.start_m.is_some(), self.scope())?,
            Some(departure) => {
                let from_start: Vec<Pose> = std::iter::once(departure.start()).chain(earlier.iter().copied()).collect();
                departure.landed(problem, &resume::resumed(problem, &from_start, true, self.scope())?)?
            }
        };
        Some(headed(&problem.rig, &path))
    }

    /// Where a flight has to be looked at to know that it is safe.
    fn scope(&self) -> Scope<'_> {
        Scope::after(&self.snapshot.free, self.known.as_ref())
    }

    /// The paper's own method: a random tree, and the best path in it.
    pub fn tree_search(&self, iterations: u32, on_progress: &mut dyn FnMut(&Progress)) -> Result<Outcome, PlanError> {
        let Self { options, problem, stop, .. } = *self;
        let start = match &self.departure {
            None => start::start_pose(problem, options, stop)?,
            Some(departure) => departure.start(),
        };
        let confirm = |path: &[Pose]| self.confirmed(path).worth.captured;
        Ok(search(problem, start, iterations, options.seed, stop, &confirm, on_progress)?)
    }

    /// What a finished path is really worth, by exact rays from its images; of a flight that begins in the air the part that is searched.
    pub fn confirmed(&self, path: &[Pose]) -> Confirmed {
        self.confirmed_beside(path, &mut None)
    }

    /// The same where another path may have been looked at before: only images that are new are looked at.
    pub fn confirmed_beside(&self, path: &[Pose], looked: &mut Option<Record>) -> Confirmed {
        let Self { snapshot, problem, stop, .. } = *self;
        if self.check_wanted().is_err() {
            return Confirmed { worth: Worth::default(), duration_s: f64::INFINITY };
        }
        let route = self.whole_route(Route::continuous(path, &problem.rig, problem.spacing));
        let (_, profile) = self.timed(&route.waypoints, &self.limits());
        let Exposed { images, .. } = images::expose(&route, &problem.rig, &profile);
        *looked = match looked.take() {
            None => Record::new(snapshot, problem, &images, stop),
            Some(before) => before.beside(snapshot, problem, &images, stop),
        };
        let worth = looked.as_ref().map_or(Worth::default(), |record| {
            let Capture { captured, matched, .. } = record.capture(problem);
            Worth { captured, matched }
        });
        Confirmed { worth, duration_s: profile.duration_s() - self.before_s() }
    }

    /// Time until the part of the flight begins that is searched, s.
    pub fn before_s(&self) -> f64 {
        self.departure.as_ref().map_or(0.0, Departure::stops_s)
    }

    /// The profile of the curve that is flown, with all that comes before the part of it that is searched.
    pub fn profile(&self, path: &[Pose]) -> Profile {
        match &self.departure {
            None => self.timed(path, &self.limits()).1,
            Some(departure) => self.timed(&departure.whole(path), &self.limits()).1,
        }
    }

    /// What a whole path is timed with.
    fn limits(&self) -> Limits {
        let limits = Limits::new(&self.problem.rig, &self.settings.flight, &self.settings.dynamics);
        Limits { entry_mps: self.departure.as_ref().map_or(limits.entry_mps, Departure::entry_mps), ..limits }
    }

    /// A whole path as it is flown: how far the arcs may pass from the corners, m, and its profile.
    fn timed(&self, path: &[Pose], limits: &Limits) -> (Vec<f64>, Profile) {
        let mut deviations_m = safety::deviations_m(path, limits, self.scope());
        if let Some(departure) = &self.departure {
            deviations_m = departure.stopped(deviations_m);
        }
        let profile = Profile::rounded(path, limits, &deviations_m);
        (deviations_m, profile)
    }

    fn whole_route(&self, route: Route) -> Route {
        match &self.departure {
            None => route,
            Some(departure) => departure.whole_route(route),
        }
    }

    /// What is wanted of the samples. More than no share would be a sample: who asks for none gets none.
    pub fn required(&self) -> Worth {
        let captured = if self.settings.coverage.goal_percent > 0.0 { self.problem.sufficient } else { 0 };
        Worth { captured, matched: self.problem.enough_matched(self.matched_goal_percent) }
    }

    /// The most time that the flight may take, s.
    pub fn within_s(&self) -> Option<f64> {
        let left_s = self.options.en_route.as_ref().and_then(|en_route| en_route.time_left_s);
        [self.options.within_s, left_s].into_iter().flatten().reduce(f64::min)
    }
}
