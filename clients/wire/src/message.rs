//! The bodies of requests and replies, and the checks on what a client has sent.

use serde::{Deserialize, Serialize};

/// Longest rig file, bytes.
pub const MAX_RIG_FILE_BYTES: usize = 65_536;
/// Longest name of a scene, structure, file, rig or method, bytes.
pub const MAX_NAME_BYTES: usize = 128;

/// Longest path of a file, bytes.
pub const MAX_PATH_BYTES: usize = 4096;

/// Most corners of an outline.
pub const MAX_OUTLINE_CORNERS: usize = 10_000;

/// Largest coordinate that makes sense in a local frame, m.
pub const MAX_COORDINATE_M: f64 = 1.0e6;

/// Longest budget and longest flight that may be asked for, s.
pub const MAX_SECONDS: f64 = 86_400.0;

/// Largest number of iterations that may be asked for.
pub const MAX_ITERATIONS: u32 = 10_000_000;

/// What a client may ask for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// The first message: [`Reply::Welcome`].
    Hello,
    /// Nothing but an answer: [`Reply::Acknowledged`].
    Ping,
    /// A scene file that the daemon can read; the bytes of an absolute path.
    LoadPath {
        path: Vec<u8>,
        name: Option<String>,
    },
    /// A scene file that follows as bulk; its name or, better, its absolute path tells its format and names the scene.
    LoadBytes {
        file_name: String,
        name: Option<String>,
    },
    Unload {
        scene: String,
    },
    Plan {
        scene: String,
        order: Box<PlanOrder>,
    },
    Edit {
        scene: String,
        edit: EditOrder,
    },
    /// Ends the scene's running search; its best plan so far is published.
    Cancel {
        scene: String,
    },
    /// Where the field of a scene is published: [`Reply::Located`].
    Locate {
        scene: String,
    },
    /// Publishes the scene's last plan once more, for a receiver that missed it: [`Reply::Planned`] names it.
    Republish {
        scene: String,
    },
    /// What became of an earlier request of this client.
    Outcome {
        correlation: u64,
    },
    Structures {
        scene: String,
    },
    Status,
    Reload,
    Stop,
}

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
        }
    }
}

/// A change of one structure, which is given by its name or its id in hexadecimal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum EditOrder {
    Raise {
        structure: String,
        by_m: f64,
    },
    Lower {
        structure: String,
        by_m: f64,
    },
    Remove {
        structure: String,
    },
    /// A new prism. The outline is one ring in the local frame, m; its first corner is not repeated.
    Add {
        name: String,
        outline_m: Vec<[f64; 2]>,
        base_m: f64,
        top_m: f64,
    },
    /// Metres east and north.
    Move {
        structure: String,
        by_m: [f64; 2],
    },
}

/// What the daemon answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply {
    Welcome {
        version: String,
        pid: u32,
    },
    /// The request was taken up; a further reply follows unless it was a ping.
    Acknowledged,
    Progress(ProgressNote),
    Loaded(Loaded),
    /// The plan of this correlation was published with this epoch.
    Planned {
        epoch: u64,
    },
    Edited {
        revision: u64,
        replan_follows: bool,
    },
    /// The field of the scene: its service holds a table of this epoch, or of a later one.
    Located {
        epoch: u64,
        revision: u64,
        bytes: u64,
    },
    Structures(Vec<StructureInfo>),
    Status(Status),
    Done,
    Refused(Refusal),
}

/// The daemon did not do it, and nothing was changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    pub code: RefusalCode,
    /// What, where and what to do about it.
    pub message: String,
}

/// Why the daemon refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum RefusalCode {
    /// The message itself is damaged, too long, or of another schema version.
    Malformed,
    /// A value is not finite, out of range, or a name is too long or empty.
    Invalid,
    UnknownScene,
    UnknownStructure,
    /// The scene file cannot be read.
    Import,
    /// The scene offers nothing to plan on.
    Field,
    /// The edit would make the scene invalid.
    Edit,
    /// Unknown rig or method, or a start that cannot be flown.
    Plan,
    /// Something newer on the same scene took the place of this request.
    Superseded,
    /// The memory budget or /dev/shm is used up.
    Memory,
    /// The scene is being loaded, or too much is going on.
    Busy,
    /// The request was meant for an earlier daemon of the same domain.
    Restarted,
    Configuration,
    /// The daemon is ending.
    Stopping,
    /// A mistake in the daemon; its log says more.
    Internal,
    /// The daemon cannot read the path; whoever can may send the file's content instead.
    Unreadable,
}

/// What the daemon is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stage {
    /// Reading and repairing the scene file.
    Read,
    /// Sampling the surface and the viewpoints.
    Survey,
    /// Casting the rays of the field.
    Field,
    Search,
}

/// How far the work on a request has come.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProgressNote {
    pub stage: Stage,
    /// Of the search; 0 in other stages.
    pub iteration: u32,
    pub iterations: u32,
    /// Best path so far, by the field.
    pub coverage_percent: f64,
    pub length_m: f64,
    pub objective: f64,
    /// Since the request was taken up.
    pub elapsed_s: f64,
}

/// A scene that stands ready to be planned on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Loaded {
    /// The name to use from now on.
    pub scene: String,
    pub revision: u64,
    pub structures: u64,
    pub samples: u64,
    /// Samples that lie on the outside of the scene.
    pub exposed: u64,
    pub viewpoints: u64,
    /// Share of the exposed samples that the viewpoints can capture at all.
    pub capturable_percent: f64,
    pub field_bytes: u64,
    /// Reading and repairing the file, s.
    pub read_s: f64,
    /// Building the field, s.
    pub field_s: f64,
    /// All of it, s.
    pub load_s: f64,
    /// The import report.
    pub report_json: String,
    /// The same in words, one line each.
    pub report_lines: Vec<String>,
}

/// A structure of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StructureInfo {
    pub id: u64,
    pub name: String,
    pub base_m: f64,
    pub top_m: f64,
    pub samples: u64,
}

/// The daemon and all its scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    pub version: String,
    pub domain: String,
    pub pid: u32,
    pub instance: u64,
    pub uptime_s: f64,
    pub threads: u32,
    /// Shared memory that the fields of all scenes take.
    pub field_bytes: u64,
    pub budget_bytes: u64,
    /// Resident memory of the daemon, shared memory included.
    pub resident_mb: f64,
    pub scenes: Vec<SceneStatus>,
}

/// One scene of a daemon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneStatus {
    pub name: String,
    pub revision: u64,
    pub structures: u64,
    pub samples: u64,
    pub viewpoints: u64,
    pub capturable_percent: f64,
    pub field_bytes: u64,
    pub state: SceneState,
    /// The last plan that was published for it.
    pub plan: Option<PlanSummary>,
    /// What is to be known of the last plan or of the attempt to make a newer one.
    pub remark: Option<String>,
}

/// What goes on with a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SceneState {
    Idle,
    /// Its field is being built.
    Building,
    Planning,
}

/// The figures of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanSummary {
    pub revision: u64,
    /// The scene has another revision by now, so that the plan may lead through something: do not fly it.
    pub is_stale: bool,
    pub seed: u64,
    pub waypoints: u64,
    pub length_m: f64,
    pub flight_s: f64,
    pub coverage_percent: f64,
    /// From taking up the request to the plan, s.
    pub total_s: f64,
}

impl Refusal {
    pub fn new(code: RefusalCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }
}

impl Request {
    /// Judges the values of a request that was decoded; the error says what is wrong and what is allowed.
    pub fn check(&self) -> Result<(), Refusal> {
        match self {
            Request::LoadPath { path, name } => {
                check_path(path)?;
                name.as_deref().map_or(Ok(()), check_scene_name)
            }
            Request::LoadBytes { file_name, name } => {
                check_file_name(file_name)?;
                name.as_deref().map_or(Ok(()), check_scene_name)
            }
            Request::Plan { scene, order } => {
                check_scene_name(scene)?;
                order.check()
            }
            Request::Edit { scene, edit } => {
                check_scene_name(scene)?;
                edit.check()
            }
            Request::Unload { scene }
            | Request::Cancel { scene }
            | Request::Locate { scene }
            | Request::Republish { scene }
            | Request::Structures { scene } => check_scene_name(scene),
            Request::Hello | Request::Ping | Request::Outcome { .. } | Request::Status | Request::Reload | Request::Stop => {
                Ok(())
            }
        }
    }
}

impl PlanOrder {
    fn check(&self) -> Result<(), Refusal> {
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
        self.region_m.iter().flatten().try_for_each(|value| check_coordinate("region", *value))?;
        self.start_m.into_iter().flatten().try_for_each(|value| check_coordinate("start", value))
    }
}

impl EditOrder {
    fn check(&self) -> Result<(), Refusal> {
        match self {
            EditOrder::Raise { structure, by_m } | EditOrder::Lower { structure, by_m } => {
                check_name("structure", structure)?;
                check_coordinate("change of height", *by_m)?;
                if *by_m <= 0.0 {
                    return invalid(format!("the change of height is {by_m} m; give a length above 0 and choose raise or lower"));
                }
                Ok(())
            }
            EditOrder::Remove { structure } => check_name("structure", structure),
            EditOrder::Move { structure, by_m } => {
                check_name("structure", structure)?;
                by_m.iter().try_for_each(|value| check_coordinate("shift", *value))
            }
            EditOrder::Add { name, outline_m, base_m, top_m } => {
                check_name("structure", name)?;
                if !(3..=MAX_OUTLINE_CORNERS).contains(&outline_m.len()) {
                    let corners = outline_m.len();
                    return invalid(format!("the outline of {name:?} has {corners} corners; give 3 to {MAX_OUTLINE_CORNERS}"));
                }
                outline_m.iter().flatten().try_for_each(|value| check_coordinate("outline", *value))?;
                check_coordinate("base", *base_m)?;
                check_coordinate("top", *top_m)?;
                if base_m >= top_m {
                    return invalid(format!("the base of {name:?} at {base_m} m is not below its top at {top_m} m"));
                }
                Ok(())
            }
        }
    }
}

/// A scene's name is part of the name of a service, so it is short and plain.
pub fn check_scene_name(name: &str) -> Result<(), Refusal> {
    check_name("scene", name)?;
    let plain = |c: char| c.is_alphanumeric() || "._-+ ".contains(c);
    if !name.chars().all(plain) || name.trim() != name {
        return invalid(format!(
            "the scene name {name:?} holds other characters than letters, digits, inner spaces and `._-+`; give another with `--name`"
        ));
    }
    Ok(())
}

/// The name of the scene that a file gives, with everything replaced that a scene's name cannot hold.
pub fn plain_scene_name(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_alphanumeric() || "._-+ ".contains(c) { c } else { '-' }).collect();
    let plain = plain.trim();
    let mut end = plain.len().min(MAX_NAME_BYTES);
    while !plain.is_char_boundary(end) {
        end -= 1;
    }
    let plain = plain[..end].trim_end();
    if plain.is_empty() { "scene".into() } else { plain.into() }
}

fn check_name(what: &str, name: &str) -> Result<(), Refusal> {
    if name.is_empty() || name.len() > MAX_NAME_BYTES || name.chars().any(char::is_control) {
        let bytes = name.len();
        return invalid(format!(
            "the {what} name is {bytes} bytes long or holds control characters; give 1 to {MAX_NAME_BYTES} bytes of plain text"
        ));
    }
    Ok(())
}

/// It may be a whole path: where the file's name says nothing, its folder's names the scene.
fn check_file_name(name: &str) -> Result<(), Refusal> {
    if name.is_empty() || name.len() > MAX_PATH_BYTES || name.contains('\0') {
        return invalid(format!("the file name is {} bytes long or holds a zero; give 1 to {MAX_PATH_BYTES} bytes", name.len()));
    }
    Ok(())
}

fn check_path(path: &[u8]) -> Result<(), Refusal> {
    let text = String::from_utf8_lossy(path);
    if path.len() > MAX_PATH_BYTES || path.contains(&0) || path.first() != Some(&b'/') {
        return invalid(format!(
            "the path {:?} is not an absolute path of at most {MAX_PATH_BYTES} bytes",
            text.chars().take(80).collect::<String>()
        ));
    }
    Ok(())
}

fn check_coordinate(what: &str, value: f64) -> Result<(), Refusal> {
    if value.is_finite() && value.abs() <= MAX_COORDINATE_M {
        return Ok(());
    }
    invalid(format!("the {what} holds {value}; give finite metres of at most {MAX_COORDINATE_M} in the scene's local frame"))
}

fn invalid(message: String) -> Result<(), Refusal> {
    Err(Refusal::new(RefusalCode::Invalid, message))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::codec;

    fn order() -> PlanOrder {
        PlanOrder::default()
    }

    proptest! {
        #[test]
        fn every_name_becomes_one_that_a_scene_can_have(name in "\\PC{0,200}", controls: String) {
            for name in [name, controls] {
                let plain = plain_scene_name(&name);
                prop_assert_eq!(check_scene_name(&plain), Ok(()), "{:?}", plain);
                prop_assert_eq!(plain_scene_name(&plain), plain);
            }
        }

        #[test]
        fn random_bytes_are_refused_or_make_a_request_that_can_be_judged(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(request) = codec::decode_request::<Request>(&bytes) {
                let _ = request.check();
            }
        }

        #[test]
        fn an_edit_survives_the_way_over_the_wire(
            name in "[a-z]{1,20}", outline_m in prop::collection::vec(prop::array::uniform2(-1e5..1e5f64), 3..50), base_m in -10.0..0.0f64,
        ) {
            let request = Request::Edit { scene: "town".into(), edit: EditOrder::Add { name, outline_m, base_m, top_m: 5.0 } };
            let bytes = codec::encode(&request, codec::MAX_REQUEST_BYTES).unwrap();
            let back: Request = codec::decode_request(&bytes).unwrap();
            prop_assert!(back.check().is_ok());
            prop_assert_eq!(back, request);
        }
    }

    #[test]
    fn a_list_that_claims_to_be_huge_is_refused_before_it_is_allocated() {
        let edit = EditOrder::Add { name: "a".into(), outline_m: vec![[0.0; 2]; 3], base_m: 0.0, top_m: 1.0 };
        let request = Request::Edit { scene: "t".into(), edit };
        let mut bytes = codec::encode(&request, codec::MAX_REQUEST_BYTES).unwrap();
        let length = bytes.iter().position(|byte| *byte == 3).expect("variant 3 or the length 3");
        let place = bytes.iter().skip(length + 1).position(|byte| *byte == 3).expect("the length") + length + 1;
        bytes.splice(place..=place, [253, 255, 255, 255, 255, 255, 255, 255, 127]);
        let message = codec::decode_request::<Request>(&bytes).unwrap_err().to_string();
        assert!(message.contains("cannot be decoded"), "{message}");
    }

    #[test]
    fn values_that_make_no_sense_are_refused_with_a_remedy() {
        let edit = |edit| Request::Edit { scene: "town".into(), edit };
        let plan = |order| Request::Plan { scene: "town".into(), order: Box::new(order) };
        let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, f64::NAN]];
        let faults = [
            edit(EditOrder::Raise { structure: "a".into(), by_m: f64::INFINITY }),
            edit(EditOrder::Raise { structure: "a".into(), by_m: -3.0 }),
            edit(EditOrder::Move { structure: "a".into(), by_m: [0.0, 1e9] }),
            edit(EditOrder::Remove { structure: String::new() }),
            edit(EditOrder::Add { name: "n".into(), outline_m: square, base_m: 0.0, top_m: 1.0 }),
            edit(EditOrder::Add { name: "n".into(), outline_m: vec![[0.0; 2]; 2], base_m: 0.0, top_m: 1.0 }),
            edit(EditOrder::Add { name: "n".into(), outline_m: vec![[0.0; 2]; 3], base_m: 1.0, top_m: 1.0 }),
            plan(PlanOrder { start_m: Some([0.0, f64::NAN, 0.0]), ..order() }),
            plan(PlanOrder { iterations: Some(0), ..order() }),
            plan(PlanOrder { budget_s: Some(0.0), ..order() }),
            plan(PlanOrder { within_s: Some(f64::NAN), ..order() }),
            plan(PlanOrder { goal_percent: Some(100.1), ..order() }),
            plan(PlanOrder { matched_percent: Some(f64::NAN), ..order() }),
            plan(PlanOrder { gsd_m: Some(-0.01), ..order() }),
            plan(PlanOrder { overlap_percent: Some(0.0), ..order() }),
            plan(PlanOrder { overlap_percent: Some(100.0), ..order() }),
            plan(PlanOrder { overlap_percent: Some(f64::NAN), ..order() }),
            plan(PlanOrder { region_m: vec![[0.0; 2]; 2], ..order() }),
            plan(PlanOrder { region_m: vec![[0.0, 1.0], [1.0, 2.0], [1e9, 0.0]], ..order() }),
            plan(PlanOrder { rig: "x".repeat(1000), ..order() }),
            plan(PlanOrder { rig_file: Some("#".repeat(MAX_RIG_FILE_BYTES + 1)), ..order() }),
            plan(PlanOrder { start_view_deg: Some([0.0, f64::NAN]), ..order() }),
            plan(PlanOrder { start_view_deg: Some([0.0, 91.0]), ..order() }),
            Request::Locate { scene: "a/b".into() },
            Request::LoadPath { path: b"relative".to_vec(), name: None },
        ];
        for request in faults {
            let refusal = request.check().unwrap_err();
            assert_eq!(refusal.code, RefusalCode::Invalid, "{request:?}");
        }
        assert_eq!(plan(order()).check(), Ok(()));
    }
}
