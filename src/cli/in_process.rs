//! The engine without a daemon: from a scene file to a plan in this process, with the times of its steps.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use nalgebra::Point3;
use overfly_wire::message::plain_scene_name;

use super::arguments::OrderArgs;
use super::en_route::Flown;
use super::failure::Failure;
use super::progress::Meter;
use super::{bounded_file, first_look};
use crate::camera::{Rig, direction_of};
use crate::planner::{self, Conduct, Method, Objective, PlanOptions, Progress, StopToken};
use crate::scene::anchor::Anchor;
use crate::scene::{self, GroundFile, ImportReport, Scene, Watched};
use crate::session::{FieldError, Session, Snapshot};
use crate::settings::Settings;
use crate::stop::Part;
use crate::trajectory::evaluate::Sightings;
use crate::trajectory::plan::{Plan, RunTimes};

/// A larger scene is a mistake: that of a whole city has a tenth of it.
const MOST_SCENE_BYTES: u64 = 1_000_000_000;

/// What planning a file gives.
pub struct Planned {
    pub plan: Plan,
    /// Which of its images see what.
    pub sightings: Sightings,
    pub times: RunTimes,
    pub snapshot: Snapshot,
    pub report: ImportReport,
    /// It is the first flight of a search that takes long.
    pub is_first: bool,
}

/// A scene file and, of a surface model, the model of its ground where one is named.
pub struct SceneFiles<'f> {
    pub scene: &'f Path,
    pub ground: Option<&'f Path>,
}

/// The same, kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnedFiles {
    pub scene: PathBuf,
    pub ground: Option<PathBuf>,
}

impl OwnedFiles {
    /// A file that is given: the model of the ground belongs to the file that it was named for.
    pub fn alone(scene: &Path) -> Self {
        Self { scene: scene.to_owned(), ground: None }
    }

    pub fn borrowed(&self) -> SceneFiles<'_> {
        SceneFiles { scene: &self.scene, ground: self.ground.as_deref() }
    }
}

/// Reads a scene file.
pub fn read_scene(path: &Path, settings: &Settings) -> Result<(Scene, ImportReport), Failure> {
    read_scene_files(&SceneFiles { scene: path, ground: None }, settings)
}

/// The same with the model of the ground that is named, or that stands beside the file.
pub fn read_scene_files(files: &SceneFiles, settings: &Settings) -> Result<(Scene, ImportReport), Failure> {
    read_in_frame(files, settings, None, &StopToken::default())
}

/// The same, with an anchor in the frame of a scene that was read before. Of a point cloud, the only file that takes long, `stop` counts what is read.
pub fn read_in_frame(
    files: &SceneFiles,
    settings: &Settings,
    anchor: Option<&Anchor>,
    stop: &StopToken,
) -> Result<(Scene, ImportReport), Failure> {
    // The daemon is told absolute paths too: both give a file without a telling name that of its folder.
    let path = std::path::absolute(files.scene).unwrap_or_else(|_| files.scene.to_owned());
    let name = path.to_string_lossy();
    if let Some(cloud) = opened_cloud(files.scene).filter(|_| files.ground.is_none()) {
        let length = cloud.metadata().map_or(0, |metadata| metadata.len());
        let (mut scene, report) = scene::read_cloud(&name, &mut Watched::new(cloud, length, stop), &settings.proxy, anchor)?;
        scene.name = plain_scene_name(&scene.name);
        return Ok((scene, report));
    }
    let bytes = read_bytes(files.scene)?;
    let beside = || scene::ground_beside(&name).map(PathBuf::from).filter(|path| path.is_file());
    let is_found = files.ground.is_none();
    let (mut scene, report) = match files.ground.map(Path::to_owned).or_else(beside) {
        Some(ground) => {
            let (bytes_of_ground, file_name) = (read_bytes(&ground)?, ground.to_string_lossy());
            let ground = GroundFile { file_name: &file_name, bytes: &bytes_of_ground, is_found };
            scene::read_over_ground(&name, &bytes, &ground, &settings.proxy, anchor)?
        }
        None => match anchor {
            Some(anchor) => scene::read_anchored(&name, &bytes, &settings.proxy, anchor)?,
            None => scene::read(&name, &bytes, &settings.proxy)?,
        },
    };
    scene.name = plain_scene_name(&scene.name);
    Ok((scene, report))
}

/// A point cloud, which is read from where it lies and may be larger than other scenes.
fn opened_cloud(path: &Path) -> Option<File> {
    // Opening a pipe would wait for whoever writes to it, and take what it holds.
    std::fs::metadata(path).ok().filter(std::fs::Metadata::is_file)?;
    let mut file = File::open(path).ok()?;
    let mut first = [0; 4];
    file.read_exact(&mut first).ok()?;
    file.rewind().ok()?;
    scene::is_cloud(&first).then_some(file)
}

/// What to do about a scene file that cannot be read.
const REMEDY: &str = "give a scene file that you may read";

/// Checks that there is a scene file that can be opened, and leaves it; what is no file is read, because it cannot be read twice.
pub fn read_piped(path: &Path) -> Result<Option<Vec<u8>>, Failure> {
    let opened = std::fs::metadata(path).and_then(|metadata| match metadata.is_file() {
        true => File::open(path).map(|_| true),
        false => Ok(false),
    });
    match opened {
        Ok(true) => Ok(None),
        Ok(false) => read_bytes(path).map(Some),
        Err(cause) => Err(Failure::Read { path: path.to_owned(), cause, remedy: REMEDY }),
    }
}

/// The bytes of a scene file.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, Failure> {
    let remedy = REMEDY;
    bounded_file::read(path, MOST_SCENE_BYTES).map_err(|cause| Failure::Read { path: path.to_owned(), cause, remedy })
}

/// What is done with a first flight.
pub type OnFirst<'f> = &'f mut dyn FnMut(&Planned, &Meter) -> Result<(), Failure>;

/// Plans a flight over a scene file. `on_first` is handed a first one where the search will take long.
pub fn plan_file(
    files: &SceneFiles,
    settings: &Arc<Settings>,
    options: &PlanOptions,
    flown: Option<&Flown>,
    stop: &StopToken,
    meter: &mut Meter,
    on_first: Option<OnFirst>,
) -> Result<Planned, Failure> {
    let started = Instant::now();
    let (scene, report) = meter.while_counting(Part::Reading, stop, || read_in_frame(files, settings, None, stop))?;
    if stop.is_stopped() {
        return Err(Failure::Interrupted);
    }

    let field_started = Instant::now();
    let snapshot = build_field(scene, settings, stop, meter).map_err(|failure| match failure {
        Failure::Field(FieldError::Stopped) => Failure::Interrupted,
        other => other,
    })?;
    let field_s = field_started.elapsed().as_secs_f64();

    let mut options = options.clone();
    if let Some(flown) = flown {
        flown.complete(&mut options, &snapshot, stop);
    }
    let search = |options: &PlanOptions, on_progress: &mut (dyn FnMut(&Progress) + Send)| -> Result<Planned, Failure> {
        // The search ends with its last word of progress; what follows is the exact evaluation and the safety check.
        let search_started = Instant::now();
        let mut search_ended = search_started;
        let on_progress = &mut |progress: &Progress| {
            search_ended = Instant::now();
            on_progress(progress);
        };
        let made = planner::replan(&snapshot, settings, options, None, Conduct { on_progress, ..Conduct::unheard(stop) })?;
        let times = RunTimes {
            field_s,
            search_s: (search_ended - search_started).as_secs_f64(),
            check_s: search_ended.elapsed().as_secs_f64(),
            total_s: started.elapsed().as_secs_f64(),
            threads: rayon::current_num_threads() as u32,
        };
        let (sightings, is_first) = (made.record.into_sightings(), false);
        Ok(Planned { plan: made.plan, sightings, times, snapshot: snapshot.clone(), report: report.clone(), is_first })
    };
    let mut first = None;
    if let Some((on_first, options)) = on_first.zip(first_look::options(&options, &snapshot, settings)) {
        meter.stage("searching for a first look");
        meter.keep_moving();
        // What is wrong with the order the search itself says.
        if let Ok(planned) = search(&options, &mut |_| {}) {
            let planned = Planned { is_first: true, ..planned };
            if !stop.is_stopped() {
                on_first(&planned, meter)?;
            }
            first = Some(planned);
        }
    }
    let last = search(&options, &mut |progress| meter.search(progress));
    match (first, last) {
        (Some(first), Ok(last)) => Ok(first_look::better(first, last)),
        // It was ended before it had any plan.
        (Some(first), Err(_)) if stop.is_stopped() => Ok(first_look::ended(first)),
        (_, last) => last,
    }
}

/// Samples a scene and builds its field.
pub fn build_field(scene: Scene, settings: &Arc<Settings>, stop: &StopToken, meter: &mut Meter) -> Result<Snapshot, Failure> {
    let session = meter.while_counting(Part::Survey, stop, || Session::new(scene, Arc::clone(settings), stop))?;
    field_of(&session, stop, meter)
}

/// The field of a session's scene.
pub fn field_of(session: &Session, stop: &StopToken, meter: &mut Meter) -> Result<Snapshot, Failure> {
    let survey = meter.while_counting(Part::Survey, stop, || session.survey(stop))?;
    Ok(meter.while_counting(Part::Rays, stop, || survey.into_snapshot(stop))?)
}

/// What the command line asks of the planner.
pub fn options(order: &OrderArgs, rig: &Rig) -> Result<PlanOptions, Failure> {
    let options = PlanOptions {
        iterations: order.iterations,
        budget_s: order.budget,
        goal_percent: order.coverage,
        objective: Objective::parse(&order.objective)?,
        matched_percent: order.matched,
        within_s: order.max_time,
        gsd_m: order.gsd,
        overlap_percent: order.overlap,
        region_m: order.region.clone().map(|region| region.0),
        start_m: order.start.map(|start| Point3::from(start.0)),
        start_view: order.look.map(|look| direction_of(look.0[0], look.0[1])),
        ..PlanOptions::new(rig.clone(), Method::parse(&order.method)?, order.seed)
    };
    options.check()?;
    Ok(options)
}
