//! `overfly export`: a plan as files for ground stations, drones' apps and reconstruction software.

mod words;

use std::collections::HashSet;
use std::fs;
use std::path::PathBuf;
use std::time::UNIX_EPOCH;

use clap::ValueEnum;
use serde_json::json;

use super::answer::{Answer, Form};
use super::arguments::{ExportArgs, Format};
use super::evaluate::read_plan_or_run;
use super::failure::Failure;
use super::flown_scene;
use super::interrupt::Interrupts;
use super::outputs::Folder;
use super::progress::Meter;
use crate::mission::course::{Altitudes, Course, CourseError, Ground};
use crate::mission::mav_items::Autopilot;
use crate::mission::pictures::plain_name;
use crate::mission::{colmap, coverage_model, dji, footprints, geojson, kml, litchi, plan_read, qgc, tables, waypoints};
use crate::quality::{self, Quality, Truth};
use crate::scene::Scene;
use crate::scene::free_space::FreeSpace;
use crate::session::FieldError;
use crate::settings::Settings;
use crate::stop::StopToken;
use crate::trajectory::plan::Plan;

/// Formats of a plan that has no place on the Earth.
const WITHOUT_GEOREFERENCE: &str = "csv, colmap, realitycapture, metashape, coverage-ply and coverage-glb need none";

pub fn run(arguments: &ExportArgs, form: Form) -> Result<Answer, Failure> {
    let plan = plan_read::read(&arguments.plan.to_string_lossy(), &read_plan_or_run(&arguments.plan)?)?;
    let (settings, guessed) = flown_scene::settings(arguments.course.config.as_ref(), &arguments.plan, &plan)?;
    let stop = StopToken::default();
    let stopper = stop.clone();
    let interrupts =
        Interrupts::announced(form, "stopping: nothing is written; Ctrl-C again ends at once", move || stopper.stop());
    let _folder = Folder::prepare(&arguments.out)?;
    let mut export = Export::new(arguments, plan, &settings)?;
    export.notes.extend(guessed.filter(|_| export.scene.is_ok()));
    export.write_all(&stop, form)?;
    drop(interrupts);
    let files = export.put()?;
    export.notes.iter().for_each(|note| form.remark(&format!("note: {note}")));
    Ok(export.answer(&files))
}

/// What is to be written, and what it is made of.
struct Export<'a> {
    arguments: &'a ExportArgs,
    settings: &'a Settings,
    plan: Plan,
    /// Without one, why.
    scene: Result<Scene, String>,
    /// The plan in the frame of the scene, and the space around it, where something has needed them.
    flown: Option<(Plan, FreeSpace)>,
    course: Option<Course>,
    /// What files are called by.
    stem: String,
    notes: Vec<String>,
    /// By paths within the folder.
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl<'a> Export<'a> {
    fn new(arguments: &'a ExportArgs, plan: Plan, settings: &'a Settings) -> Result<Self, Failure> {
        let is_needed = arguments.formats.iter().any(|format| needs_scene(*format));
        let scene = match is_needed {
            true => flown_scene::find(arguments.course.scene.as_ref(), &arguments.plan, &plan, settings)?,
            false => Err("nobody asked for it".to_owned()),
        };
        let stem = plain_name(&plan.scene.name);
        Ok(Self { arguments, settings, plan, scene, flown: None, course: None, stem, notes: Vec::new(), files: Vec::new() })
    }

    /// Each wanted format once; of `all`, those that the plan allows.
    fn write_all(&mut self, stop: &StopToken, form: Form) -> Result<(), Failure> {
        let is_all = self.arguments.formats.contains(&Format::All);
        let wanted: Vec<Format> = if is_all { Format::value_variants().to_vec() } else { self.arguments.formats.clone() };
        let mut known = HashSet::new();
        let (mut coverage, mut left_out) = (None, Vec::new());
        for format in wanted.into_iter().filter(|format| *format != Format::All) {
            if !known.insert(format) {
                continue;
            }
            if stop.is_stopped() {
                return Err(Failure::Interrupted);
            }
            if let Some(cause) = self.impossible(format) {
                let is_asked = self.arguments.formats.contains(&format);
                if is_asked {
                    return Err(Failure::File(format!("{:?}: {}: {cause}", self.arguments.plan, name(format))));
                }
                left_out.push(format!("{} is left out: {cause}", name(format)));
                continue;
            }
            match format {
                Format::All => {}
                Format::Qgc | Format::Ardupilot | Format::Dji | Format::Litchi => match self.write_mission(format) {
                    Err(Failure::Course(error)) if !self.arguments.formats.contains(&format) => {
                        left_out.push(format!("{} is left out: {error}", name(format)));
                    }
                    written => written?,
                },
                Format::Kml => match self.write_map() {
                    Err(Failure::Course(error)) if !self.arguments.formats.contains(&format) => {
                        left_out.push(format!("{} is left out: {error}", name(format)));
                    }
                    written => written?,
                },
                Format::CoveragePly | Format::CoverageGlb => {
                    if coverage.is_none() {
                        coverage = Some(self.coverage(stop, form)?);
                    }
                    if let Some((truth, quality)) = &coverage {
                        self.write_coverage(format, truth, quality);
                    }
                }
                _ => self.write_plan(format),
            }
        }
        self.notes.extend(left_out);
        Ok(())
    }

    /// Why the plan cannot be written so.
    fn impossible(&self, format: Format) -> Option<String> {
        let is_on_earth = self.plan.scene.origin.is_some();
        let has_panoramas = self.plan.cameras.iter().any(|camera| camera.intrinsics.is_none())
            || self.plan.images.iter().any(|image| image.direction.is_none());
        let no_georeference = || {
            let error = CourseError::NoGeoreference { scene: self.plan.scene.name.clone() };
            Some(format!("{error}; {WITHOUT_GEOREFERENCE}"))
        };
        match format {
            Format::Qgc
            | Format::Ardupilot
            | Format::Dji
            | Format::Litchi
            | Format::Kml
            | Format::Geojson
            | Format::Footprints
                if !is_on_earth =>
            {
                no_georeference()
            }
            Format::Colmap if has_panoramas => Some(format!(
                "the rig {:?} takes panoramas, which are no pinhole images; csv and realitycapture hold their places",
                self.plan.rig
            )),
            Format::Footprints if has_panoramas => {
                Some(format!("the rig {:?} takes panoramas, which show all of the ground", self.plan.rig))
            }
            Format::CoveragePly | Format::CoverageGlb => {
                let cause = self.scene.as_ref().err()?;
                Some(format!("what is captured needs the scene ({cause}); give its file with `--scene`"))
            }
            _ => None,
        }
    }

    /// The plan in its scene, where that is known, worked out once.
    fn flown(&mut self) -> Result<Option<&(Plan, FreeSpace)>, Failure> {
        if let (None, Ok(scene)) = (&self.flown, &self.scene) {
            let plan = flown_scene::carried(&self.plan, scene, self.settings)?;
            self.flown = Some((plan, flown_scene::free_space(scene, self.settings)?));
        }
        Ok(self.flown.as_ref())
    }

    /// The course of the plan, worked out once.
    fn prepare_course(&mut self) -> Result<(), Failure> {
        if self.course.is_some() {
            return Ok(());
        }
        let options = self.arguments.course.options();
        let course = match self.flown()? {
            Some((plan, free)) => {
                let course = Course::new(plan, Some(free), &options)?;
                course.check(plan, free)?;
                course
            }
            None => Course::new(&self.plan, None, &options)?,
        };
        self.notes.extend(course.notes.iter().cloned());
        self.course = Some(course);
        Ok(())
    }

    fn write_mission(&mut self, format: Format) -> Result<(), Failure> {
        let autopilot: Autopilot = self.arguments.autopilot.into();
        if format == Format::Qgc {
            autopilot.check(self.arguments.course.altitude.into())?;
        }
        self.prepare_course()?;
        let Some(course) = &self.course else { return Ok(()) };
        let made_ms = made_ms(self.arguments);
        for sortie in &course.sorties {
            let (ending, bytes) = match format {
                Format::Qgc => (".plan", qgc::to_bytes(course, sortie, autopilot)),
                Format::Ardupilot => (".waypoints", waypoints::to_bytes(course, sortie)),
                Format::Dji => (".kmz", dji::to_bytes(course, sortie, made_ms)),
                _ => ("-litchi.csv", litchi::to_bytes(course, sortie)),
            };
            self.files.push((format!("{}-{}{ending}", self.stem, sortie.number).into(), bytes));
        }
        self.notes.extend(words::remarks(format, course));
        Ok(())
    }

    fn write_map(&mut self) -> Result<(), Failure> {
        let (which, altitudes) = (self.arguments.images.which(), self.arguments.course.altitude.into());
        let bytes = match self.flown()? {
            Some((plan, free)) => kml::to_bytes(plan, which, altitudes, Ground::of(Some(free))),
            None if altitudes == Altitudes::Terrain => return Err(CourseError::NoTerrain.into()),
            None => {
                if altitudes == Altitudes::Relative {
                    self.notes.push(
                        "the scene is not known: heights above the ground in the kml are those above the scene's zero (its lowest ground); \
                         over hilly ground give the scene with `--scene`, or take absolute heights (`--altitude absolute`)"
                            .to_owned(),
                    );
                }
                kml::to_bytes(&self.plan, which, altitudes, Ground::default())
            }
        };
        self.files.extend(bytes.map(|bytes| (PathBuf::from(format!("{}.kml", self.stem)), bytes)));
        Ok(())
    }

    fn write_plan(&mut self, format: Format) {
        let (plan, stem, which) = (&self.plan, &self.stem, self.arguments.images.which());
        let named = |ending: &str, bytes: Vec<u8>| (PathBuf::from(format!("{stem}{ending}")), bytes);
        let files: Vec<(PathBuf, Vec<u8>)> = match format {
            Format::Geojson => geojson::to_bytes(plan, which).map(|bytes| named(".geojson", bytes)).into_iter().collect(),
            Format::Csv => {
                vec![named("-images.csv", tables::images(plan, which)), named("-waypoints.csv", tables::waypoints(plan))]
            }
            Format::Realitycapture => vec![named("-realitycapture.csv", tables::reality_capture(plan, which))],
            Format::Metashape => vec![named("-metashape.csv", tables::metashape(plan, which))],
            Format::Footprints => {
                footprints::to_bytes(plan, which).map(|bytes| named("-footprints.geojson", bytes)).into_iter().collect()
            }
            Format::Colmap => {
                let folder = PathBuf::from(format!("{stem}-colmap"));
                let files = colmap::to_files(plan, which).into_iter().flatten();
                files.map(|(name, bytes)| (folder.join(name), bytes)).collect()
            }
            _ => Vec::new(),
        };
        self.files.extend(files);
    }

    /// What the images see of dense samples, as `overfly evaluate` looks at it.
    fn coverage(&self, stop: &StopToken, form: Form) -> Result<(Truth, Quality), Failure> {
        let scene = self.scene.as_ref().map_err(|cause| Failure::File(cause.clone()))?;
        let plan = flown_scene::carried(&self.plan, scene, self.settings)?;
        let mut meter = Meter::new(form);
        meter.keep_moving();
        meter.stage("casting the rays of the images");
        let stopped = |error| if error == FieldError::Stopped { Failure::Interrupted } else { Failure::Field(error) };
        let truth = Truth::new(scene.clone(), self.settings, stop).map_err(stopped)?;
        let shots = quality::shots(&plan, self.arguments.images.which());
        let quality = quality::assess(&truth, &shots, self.settings, stop).ok_or(Failure::Interrupted)?;
        Ok((truth, quality))
    }

    fn write_coverage(&mut self, format: Format, truth: &Truth, quality: &Quality) {
        let (ending, bytes) = match format {
            Format::CoveragePly => ("-coverage.ply", coverage_model::ply(truth, quality)),
            _ => ("-coverage.glb", coverage_model::glb(truth, quality)),
        };
        self.files.push((format!("{}{ending}", self.stem).into(), bytes));
    }

    /// Writes what has been made; nothing stands in the folder before all of it is made.
    fn put(&self) -> Result<Vec<PathBuf>, Failure> {
        let put = |(name, bytes): &(PathBuf, Vec<u8>)| {
            let path = self.arguments.out.join(name);
            if let Some(folder) = path.parent() {
                fs::create_dir_all(folder).map_err(|cause| Failure::write(folder, cause))?;
            }
            fs::write(&path, bytes).map_err(|cause| Failure::write(&path, cause))?;
            Ok(path)
        };
        self.files.iter().map(put).collect()
    }

    fn answer(&self, files: &[PathBuf]) -> Answer {
        let mut text = self.course.as_ref().map_or(String::new(), |course| words::sorties_table(course) + "\n");
        text.push_str(&files.iter().map(|path| format!("wrote {}", path.display())).collect::<Vec<_>>().join("\n"));
        let mut object = json!({
            "scene": self.plan.scene.name,
            "rig": self.plan.rig,
            "notes": self.notes,
            "files": files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        });
        if let Some(course) = &self.course {
            let home = &course.home.geodetic;
            object["home"] = json!({ "lat_deg": home.lat_deg, "lon_deg": home.lon_deg, "alt_m": home.alt_m });
            object["transit_m"] = course.transit_m.into();
            object["trigger"] = json!(
                course.trigger.map(|trigger| { json!({ "distance_m": trigger.distance_m, "interval_s": trigger.interval_s }) })
            );
            object["fences"] = json!(course.fences.iter().map(|fence| &fence.name).collect::<Vec<_>>());
            object["sorties"] = course.sorties.iter().map(words::sortie_json).collect();
        }
        Answer { text, json: object }
    }
}

fn needs_scene(format: Format) -> bool {
    matches!(
        format,
        Format::All
            | Format::Qgc
            | Format::Ardupilot
            | Format::Dji
            | Format::Litchi
            | Format::Kml
            | Format::CoveragePly
            | Format::CoverageGlb
    )
}

/// When the plan was made, as far as its file tells, in milliseconds since 1970.
fn made_ms(arguments: &ExportArgs) -> u64 {
    let modified = fs::metadata(&arguments.plan).and_then(|metadata| metadata.modified()).ok();
    let since = modified.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    since.map_or(0, |since| since.as_millis().min(u128::from(u64::MAX)) as u64)
}

fn name(format: Format) -> String {
    format.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
}
