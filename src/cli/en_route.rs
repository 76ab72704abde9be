//! `overfly plan --pose`: a flight that goes on from an aircraft in the air.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use nalgebra::Point3;
use overfly_client::FlightReport;
use serde_json::{Value, json};

use super::arguments::OrderArgs;
use super::bounded_file;
use super::failure::Failure;
use super::values::{self, Meters3};
use crate::camera::direction_of;
use crate::mission::plan_read;
use crate::planner::en_route::{add_images, waypoints_left};
use crate::planner::{EnRoute, PlanOptions, StopToken};
use crate::search::captured::Captured;
use crate::session::Snapshot;
use crate::trajectory::plan::Plan;

/// A larger plan.json is a mistake.
const MOST_PLAN_BYTES: u64 = 1_000_000_000;

/// An aircraft in the air.
#[derive(Debug, Clone, Args)]
pub struct EnRouteArgs {
    /// For `refined`, in place of --start: an aircraft that is in the air here already, metres east, north, up in the scene's local frame. The flight goes
    /// on from there without a stop or a jerk, its camera as --look says
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, conflicts_with = "start")]
    pub pose: Option<Meters3>,
    /// How it moves: metres a second east, north, up [default: it hovers]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "pose")]
    pub velocity: Option<Meters3>,
    /// So many images of the plan that it flies were taken, from the first one on; what they captured is not ordered again [default: none]
    #[arg(long, value_name = "N", allow_negative_numbers = true, requires = "pose", value_parser = values::count)]
    pub taken: Option<u32>,
    /// Only for a scene file: the plan.json that it flies. For a loaded scene it is the daemon's last plan
    #[arg(long, value_name = "PLAN.json", requires = "pose")]
    pub flown: Option<PathBuf>,
    /// The flight has to end within this time, s: with less than its goals if need be, and with an error that says how long the way takes if even that is
    /// too long
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, requires = "pose", value_parser = values::seconds)]
    pub time_left: Option<f64>,
    /// Where the flight has to end: a place as safe as any other, metres east, north, up [default: anywhere]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "pose")]
    pub landing: Option<Meters3>,
}

/// The part of a flight that is over.
pub struct Flown {
    plan: Plan,
    taken: usize,
}

impl EnRouteArgs {
    /// What the daemon is told.
    pub fn report(&self, order: &OrderArgs) -> Option<FlightReport> {
        Some(FlightReport {
            epoch: 0,
            images_taken: u64::from(self.taken.unwrap_or(0)),
            position_m: self.pose?.0,
            velocity_mps: self.velocity.map_or([0.0; 3], |velocity| velocity.0),
            view_deg: order.look.map(|look| look.0),
            time_left_s: self.time_left,
            landing_m: self.landing.map(|landing| landing.0),
        })
    }

    /// What the planner is asked for, but for what was captured.
    pub fn complete(&self, order: &OrderArgs, options: PlanOptions) -> Result<PlanOptions, Failure> {
        let Some(pose) = self.pose else { return Ok(options) };
        let en_route = EnRoute {
            position_m: Point3::from(pose.0),
            velocity_mps: self.velocity.map_or([0.0; 3], |velocity| velocity.0).into(),
            view: order.look.map(|look| direction_of(look.0[0], look.0[1])),
            captured: Arc::default(),
            time_left_s: self.time_left,
            landing_m: self.landing.map(|landing| Point3::from(landing.0)),
        };
        let options = PlanOptions { start_m: None, start_view: None, en_route: Some(en_route), ..options };
        options.check()?;
        Ok(options)
    }

    /// The plan that the aircraft flies over a scene file.
    pub fn read_flown(&self) -> Result<Option<Flown>, Failure> {
        let Some(path) = &self.flown else {
            return match self.taken {
                None => Ok(None),
                Some(_) => Err(Failure::Usage(
                    "--taken counts images of a plan; with a scene file give that plan as well (`--flown PLAN.json`)".into(),
                )),
            };
        };
        let remedy = "give a plan.json that you may read";
        let read = bounded_file::read(path, MOST_PLAN_BYTES);
        let bytes = read.map_err(|cause| Failure::Read { path: path.clone(), cause, remedy })?;
        let plan = plan_read::read(&path.to_string_lossy(), &bytes)?;
        let taken = self.taken.unwrap_or(0) as usize;
        if taken > plan.images.len() {
            let has = plan.images.len();
            return Err(Failure::Usage(format!("--taken {taken}: the plan {} has {has} images", path.display())));
        }
        Ok(Some(Flown { plan, taken }))
    }

    /// For `run.json`.
    pub fn json(&self) -> Value {
        match &self.pose {
            None => Value::Null,
            Some(pose) => json!({
                "position_m": pose.0,
                "velocity_mps": self.velocity.map(|velocity| velocity.0),
                "images_taken": self.taken,
                "time_left_s": self.time_left,
                "landing_m": self.landing.map(|landing| landing.0),
            }),
        }
    }
}

impl Flown {
    /// Completes what the planner is asked for: the images count for what they see in the scene of the snapshot. Without anything captured when abandoned.
    pub fn complete(&self, options: &mut PlanOptions, snapshot: &Snapshot, stop: &StopToken) {
        let Some(en_route) = &mut options.en_route else { return };
        let mut captured = Captured::default();
        let _ = add_images(&mut captured, snapshot, &self.plan.images[..self.taken], stop);
        en_route.captured = Arc::new(captured);
        options.earlier = Some(waypoints_left(&self.plan, self.taken));
    }
}
