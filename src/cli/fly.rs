//! `overfly fly`: a plan flown by an autopilot, and newer ones in its place.

mod orders;
mod say;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use overfly_client::FlightReport;
use serde_json::json;

use self::orders::{PlanSource, Word};
use super::answer::{Answer, Form};
use super::arguments::FlyArgs;
use super::failure::Failure;
use super::interrupt::Interrupts;
use super::{bounded_file, flown_scene, in_process, settings_file};
use crate::autopilot::link::Link;
use crate::autopilot::mission::{Mission, MissionOptions, NewPlan};
use crate::autopilot::notice::PilotError;
use crate::autopilot::pilot::{Pilot, PilotOptions};
use crate::frame::Geodetic;
use crate::mission::course::Course;
use crate::mission::mav_items::Autopilot;
use crate::mission::plan_read;
use crate::scene::free_space::FreeSpace;
use crate::trajectory::plan::Plan;

/// A larger plan.json is a mistake.
const MOST_PLAN_BYTES: u64 = 1_000_000_000;
/// How long one look at the link may take: that is how late a time-out is noticed.
const TURN: Duration = Duration::from_millis(10);
/// Messages that are taken before anything else is done.
const MESSAGES_AT_ONCE: usize = 64;
/// How often the daemon is told where the aircraft is, and how often the user, if nothing else is said.
const REPORT: Duration = Duration::from_millis(500);
const TELL: Duration = Duration::from_secs(5);
/// Less time than this cannot be planned for, s.
const LEAST_LEFT_S: f64 = 1.0;

pub fn run(arguments: &FlyArgs, form: Form) -> Result<(), Failure> {
    let is_file = arguments.plan.contains('/') || arguments.plan.ends_with(".json") || Path::new(&arguments.plan).is_file();
    let file = if is_file { Some(read(&arguments.plan)?) } else { None };
    let (file, space) = free_space(arguments, file)?;
    let note = space.as_ref().and_then(|space| space.note.clone());
    if arguments.dry_run {
        let new = file.map_or_else(|| orders::last_plan(arguments), Ok)?;
        let free = space.as_ref().map(|space| space.of(&new.plan)).transpose()?;
        return form.print(&dry_run(arguments, &new, free, note)?).map_err(Failure::Print);
    }
    let Some(place) = arguments.link.clone() else { return Err(Failure::Usage("give `--link`, or `--dry-run`".to_owned())) };
    let source = file.map_or_else(|| PlanSource::open(arguments), |new| Ok(PlanSource::File(new)))?;
    let stop = Arc::new(AtomicBool::new(false));
    let stopper = Arc::clone(&stop);
    let what_follows = "stopping: the autopilot flies its mission on by itself; Ctrl-C again ends at once";
    let _interrupts = Interrupts::announced(form, what_follows, move || stopper.store(true, Ordering::Relaxed));
    let link = Link::open(place)?;
    if let (Some(space), Some(first)) = (&space, source.first()) {
        space.of(&first.plan)?;
    }
    if let Some(note) = note {
        form.print(&say::note(&note)).map_err(Failure::Print)?;
    }
    Flight::new(arguments, form, link, source, space).fly(&stop)
}

/// The space that the ways out and home lead through: of the scene that is given, and for a plan.json else of the one that it was made on. A file's plan comes back
/// in the frame of the scene, and is held against it; a daemon has checked its own against what the scene is by now.
fn free_space(arguments: &FlyArgs, file: Option<NewPlan>) -> Result<(Option<NewPlan>, Option<Space>), Failure> {
    let config = arguments.course.config.as_ref();
    let Some(new) = file else {
        let Some(scene) = &arguments.course.scene else { return Ok((None, None)) };
        let settings = settings_file::settings(config, None)?;
        let (scene, _) = in_process::read_scene(scene, &settings)?;
        let free = Arc::new(flown_scene::free_space(&scene, &settings)?);
        return Ok((None, Some(Space { free, origin: scene.frame.origin, note: None })));
    };
    let plan_file = Path::new(&arguments.plan);
    let (settings, note) = flown_scene::settings(config, plan_file, &new.plan)?;
    let found = flown_scene::find(arguments.course.scene.as_ref(), plan_file, &new.plan, &settings)?;
    let Ok(scene) = found else { return Ok((Some(new), None)) };
    let plan = flown_scene::carried(&new.plan, &scene, &settings)?;
    let free = flown_scene::free_space(&scene, &settings)?;
    let options = arguments.course.options();
    Course::new(&plan, Some(&free), &options)?.check(&plan, &free)?;
    let space = Space { free: Arc::new(free), origin: scene.frame.origin, note };
    Ok((Some(NewPlan { plan: Arc::new(plan), ..new }), Some(space)))
}

/// The space of a scene, and where its frame lies.
struct Space {
    free: Arc<FreeSpace>,
    origin: Option<Geodetic>,
    /// What is to be said of it.
    note: Option<String>,
}

impl Space {
    /// The space, for a plan in the same frame: a daemon keeps that of the file that it has loaded first.
    fn of(&self, plan: &Plan) -> Result<&FreeSpace, Failure> {
        if self.origin == plan.scene.origin {
            return Ok(&self.free);
        }
        let what = "the file of `--scene` lies in another frame than the loaded scene; give the file that the daemon has loaded first, or none";
        Err(Failure::Usage(what.to_owned()))
    }
}

fn read(path: &str) -> Result<NewPlan, Failure> {
    let remedy = "give a plan.json that you may read, or the name of a loaded scene";
    let read = bounded_file::read(Path::new(path), MOST_PLAN_BYTES);
    let bytes = read.map_err(|cause| Failure::Read { path: path.into(), cause, remedy })?;
    Ok(NewPlan { epoch: 0, plan: Arc::new(plan_read::read(path, &bytes)?), differs_from: None })
}

fn dry_run(arguments: &FlyArgs, new: &NewPlan, free: Option<&FreeSpace>, note: Option<String>) -> Result<Answer, Failure> {
    let autopilot = arguments.autopilot.map_or(Autopilot::Px4, Into::into);
    let course = &arguments.course.options();
    let options = MissionOptions { course, free, sortie: arguments.sortie as usize, autopilot };
    let mut mission = Mission::new(new, &options, None).map_err(PilotError::from)?;
    mission.notes.extend(note);
    Ok(say::items(&mission))
}

/// A flight with everything that it needs of the world.
struct Flight<'a> {
    arguments: &'a FlyArgs,
    form: Form,
    link: Link,
    source: PlanSource,
    space: Option<Space>,
    pilot: Pilot,
    began: Instant,
    reported: Duration,
    told: Duration,
    told_of: Option<usize>,
    armed: Option<Duration>,
}

impl<'a> Flight<'a> {
    fn new(arguments: &'a FlyArgs, form: Form, link: Link, source: PlanSource, space: Option<Space>) -> Self {
        let options = PilotOptions {
            system: arguments.system,
            autopilot: arguments.autopilot.map(Into::into),
            course: arguments.course.options(),
            free: space.as_ref().map(|space| Arc::clone(&space.free)),
            sortie: arguments.sortie as usize,
            starts: arguments.start,
            holds: !arguments.no_hold,
            follows: !arguments.upload_only,
            wait: Duration::from_secs_f64(arguments.wait),
            lost: Duration::from_secs_f64(arguments.lost),
        };
        let pilot = Pilot::new(options, Duration::ZERO);
        let (reported, told) = (Duration::ZERO, Duration::ZERO);
        Self { arguments, form, link, source, space, pilot, began: Instant::now(), reported, told, told_of: None, armed: None }
    }

    fn fly(mut self, stop: &AtomicBool) -> Result<(), Failure> {
        if let PlanSource::File(new) = &self.source {
            self.pilot.fly(new.clone());
        }
        loop {
            self.listen()?;
            let now = self.began.elapsed();
            self.pilot.tick(now);
            while let Some(word) = self.source.word() {
                self.take(word)?;
            }
            self.speak()?;
            if let Some(outcome) = self.pilot.outcome().cloned() {
                self.tell_progress(now, true)?;
                let end = outcome?;
                return self.print(&say::end(end, self.pilot.progress()));
            }
            if stop.load(Ordering::Relaxed) {
                self.pilot.leave();
                self.speak()?;
                return self.print(&say::stopped(self.pilot.progress()));
            }
            self.tell_progress(now, false)?;
            self.report(now);
        }
    }

    /// Takes what has come over the link, and waits a moment for it.
    fn listen(&mut self) -> Result<(), Failure> {
        let mut wait = TURN;
        for _ in 0..MESSAGES_AT_ONCE {
            match self.link.receive(wait) {
                Ok(Some((from, message))) => self.pilot.hear(from, &message, self.began.elapsed()),
                Ok(None) => break,
                Err(error) => return self.print(&say::link(&error)),
            }
            wait = Duration::ZERO;
        }
        Ok(())
    }

    /// Sends what is to be sent, and says what has happened.
    fn speak(&mut self) -> Result<(), Failure> {
        let us = self.pilot.us();
        for message in self.pilot.take_messages() {
            if let Err(error) = self.link.send(us, &message) {
                self.print(&say::link(&error))?;
            }
        }
        for notice in self.pilot.take_notices() {
            self.print(&say::notice(&notice))?;
        }
        Ok(())
    }

    fn take(&mut self, word: Word) -> Result<(), Failure> {
        match word {
            Word::Plan(new) => {
                // Another scene may have been loaded under this name.
                if self.space.as_ref().is_some_and(|space| space.of(&new.plan).is_err()) {
                    self.space = None;
                    self.pilot.forget_space();
                    self.print(&say::note(
                        "the plan lies in another frame than the file of `--scene`: what the ways out and home have to keep clear of is \
                         not known any more",
                    ))?;
                }
                self.pilot.fly(new);
                return Ok(());
            }
            Word::Infeasible { .. } => self.pilot.hold(),
            Word::Failed(error) => return Err(error.into()),
            Word::Lost(_) | Word::Back | Word::Refused(_) => {}
        }
        self.print(&say::word(&word))
    }

    fn tell_progress(&mut self, now: Duration, is_last: bool) -> Result<(), Failure> {
        let Some(progress) = self.pilot.progress().filter(|progress| progress.is_under_way() || is_last) else { return Ok(()) };
        if is_last || progress.ahead() != self.told_of || now >= self.told + TELL {
            let answer = say::progress(progress);
            (self.told, self.told_of) = (now, progress.ahead());
            self.print(&answer)?;
        }
        Ok(())
    }

    fn report(&mut self, now: Duration) {
        if self.pilot.is_armed() {
            self.armed.get_or_insert(now);
        }
        if now < self.reported + REPORT {
            return;
        }
        self.reported = now;
        let Some(report) = self.pilot.report(now) else { return };
        let flown = now.saturating_sub(self.armed.unwrap_or(now)).as_secs_f64();
        self.source.report(FlightReport {
            time_left_s: self.arguments.air_time.map(|air_s| (air_s - flown).max(LEAST_LEFT_S)),
            landing_m: self.arguments.landing.map(|landing| landing.0),
            ..report
        });
    }

    fn print(&self, answer: &Answer) -> Result<(), Failure> {
        self.form.print(answer).map_err(Failure::Print)
    }
}

/// A line of the flight: for scripts with the name of what has happened.
fn line(event: &str, text: String, mut json: serde_json::Value) -> Answer {
    json["event"] = json!(event);
    Answer { text, json }
}
