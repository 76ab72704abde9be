//! What is to be planned.

use serde::{Deserialize, Serialize};

use super::check::{check_coordinate, check_name, invalid};
use super::{MAX_OUTLINE_CORNERS, Refusal};
use crate::en_route::FlightReport;

/// Longest rig file, bytes.
pub const MAX_RIG_FILE_BYTES: usize = 65_536;

/// Longest budget and longest flight that may be asked for, s.
pub const MAX_SECONDS: f64 = 86_400.0;

/// Largest number of iterations that may be asked for.
pub const MAX_ITERATIONS: u32 = 10_000_000;

/// What is to be planned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanOrder {
    /// Name of a rig preset; with a rig file what the client calls it.
    pub rig: String,
    /// Content of a rig file (TOML), in place of a preset.
    pub rig_file: Option<String>,
    /// Name of a planning method.
    pub method: String,
    pub seed: u64,
    /// Iterations of the tree search, or rounds of the refinement; `None` takes the daemon's setting.
    pub iterations: Option<u32>,
    /// For the method `refined`: about how long the search may take, s, in place of iterations.
    pub budget_s: Option<f64>,
    /// Coverage goal, percent of the capturable samples; `None` takes the daemon's setting.
    pub goal_percent: Option<f64>,
    /// What the method `refined` improves the flight for: `time` or `eq6`.
    pub objective: String,
    /// For the method `refined`: share of the samples that can have enough matched views that are to have them, percent; `None` takes the
    /// coverage goal, 0 asks for none.
    pub matched_percent: Option<f64>,
    /// For the method `refined`: the most coverage within this flight time, s, in place of a goal.
    pub within_s: Option<f64>,
    /// Views with a larger ground sampling distance show nothing, m; `None` for the range of the daemon's coverage model.
    pub gsd_m: Option<f64>,
    /// For the methods `refined` and `paper`: share of an image that the next one of the same camera shows as well, percent above 0 and below
    /// 100; `None` asks for none.
    pub overlap_percent: Option<f64>,
    /// Corners of the area whose surfaces count, m in the local frame; empty for the whole scene.
    pub region_m: Vec<[f64; 2]>,
    /// Where the flight starts, m in the local frame; `None` lets the planner choose.
    pub start_m: Option<[f64; 3]>,
    /// Where a camera on a gimbal looks at the start: azimuth clockwise from north and pitch up from the horizon, degrees; `None`
    /// lets the planner choose.
    pub start_view_deg: Option<[f64; 2]>,
    /// For the method `refined`, in place of a start: an aircraft that is in the air already.
    pub en_route: Option<FlightReport>,
}

impl Default for PlanOrder {
    fn default() -> Self {
        Self {
            rig: "panoramic".into(),
            rig_file: None,
            method: "refined".into(),
            seed: 1,
            iterations: None,
            budget_s: None,
            goal_percent: None,
            objective: "time".into(),
            matched_percent: None,
            within_s: None,
            gsd_m: None,
            overlap_percent: None,
            region_m: Vec::new(),
            start_m: None,
            start_view_deg: None,
            en_route: None,
        }
    }
}
impl PlanOrder {
    pub(super) fn check(&self) -> Result<(), Refusal> {
        check_name("rig", &self.rig)?;
        check_name("method", &self.method)?;
        check_name("objective", &self.objective)?;
        if let Some(text) = &self.rig_file
            && text.len() > MAX_RIG_FILE_BYTES
        {
            return invalid(format!("the rig file has {} bytes; the most is {MAX_RIG_FILE_BYTES}", text.len()));
        }
        if let Some([azimuth_deg, pitch_deg]) = self.start_view_deg
            && !(azimuth_deg.abs() <= 360.0 && pitch_deg.abs() <= 90.0)
        {
            return invalid(format!(
                "the view at the start is {azimuth_deg}, {pitch_deg}; give -360 to 360 and -90 to 90 degrees"
            ));
        }
        if let Some(iterations) = self.iterations
            && !(1..=MAX_ITERATIONS).contains(&iterations)
        {
            return invalid(format!("{iterations} iterations were asked for; give 1 to {MAX_ITERATIONS}"));
        }
        for (what, seconds) in [("budget", self.budget_s), ("flight time", self.within_s)] {
            if let Some(seconds) = seconds.filter(|seconds| !(*seconds > 0.0 && *seconds <= MAX_SECONDS)) {
                return invalid(format!("the {what} is {seconds} s; give more than 0 and at most {MAX_SECONDS} s"));
            }
        }
        for (what, percent) in [("coverage", self.goal_percent), ("matched", self.matched_percent)] {
            if let Some(percent) = percent.filter(|percent| !(0.0..=100.0).contains(percent)) {
                return invalid(format!("the {what} goal is {percent} %; give 0 to 100"));
            }
        }
        if let Some(gsd_m) = self.gsd_m.filter(|gsd_m| !(*gsd_m > 0.0 && gsd_m.is_finite())) {
            return invalid(format!("the ground sampling distance is {gsd_m} m; give a length above 0, such as 0.01"));
        }
        if let Some(percent) = self.overlap_percent.filter(|percent| !(*percent > 0.0 && *percent < 100.0)) {
            return invalid(format!("the overlap is {percent} %; give more than 0 and less than 100, such as 80"));
        }
        if !self.region_m.is_empty() && !(3..=MAX_OUTLINE_CORNERS).contains(&self.region_m.len()) {
            let corners = self.region_m.len();
            return invalid(format!(
                "the region has {corners} corners; give 3 to {MAX_OUTLINE_CORNERS}, or none for the whole scene"
            ));
        }
        self.en_route.as_ref().map_or(Ok(()), FlightReport::check)?;
        self.region_m.iter().flatten().try_for_each(|value| check_coordinate("region", *value))?;
        self.start_m.into_iter().flatten().try_for_each(|value| check_coordinate("start", value))
    }
}
