//! `overfly bound`: how short a flight can be at all, certified, on a graph of waypoints.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};

use super::answer::{self, Answer, Form};
use super::arguments::BoundArgs;
use super::failure::Failure;
use super::interrupt::Interrupts;
use super::outputs::Folder;
use super::progress::Meter;
use super::{in_process, rig_file, settings_file};
use crate::bound::{self, Bound, BoundError, Ended, Progress};
use crate::camera::Cameras;
use crate::search::Problem;
use crate::session::FieldError;
use crate::stop::{Part, StopToken};

pub fn run(arguments: &BoundArgs, form: Form) -> Result<Answer, Failure> {
    let rig = rig_file::read(&arguments.rig)?.rig;
    let settings = settings_file::settings(arguments.config.as_ref(), Some(&arguments.sizes))?;
    let mut settings = settings.with_sight(rig.sight_scale());
    settings.bound.waypoints = arguments.waypoints.unwrap_or(settings.bound.waypoints);
    settings.bound.plan_rounds = arguments.rounds.unwrap_or(settings.bound.plan_rounds);
    settings.check()?;
    let settings = Arc::new(settings);
    let _folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let started = Instant::now();
    let mut meter = Meter::new(form);
    meter.keep_moving();
    let stop = StopToken::default();
    let stopper = stop.clone();
    let interrupts =
        Interrupts::announced(form, "stopping: the best bound so far follows; Ctrl-C again ends at once", move || stopper.stop());
    meter.begin(Part::Reading);
    let (scene, _) = in_process::read_scene(&arguments.file, &settings)?;
    let name = scene.name.clone();
    let snapshot = in_process::build_field(scene, &settings, &stop, &mut meter).map_err(|failure| match failure {
        Failure::Field(FieldError::Stopped) => Failure::Interrupted,
        other => other,
    })?;
    let problem = Problem::new(&snapshot, &settings, rig);
    meter.stage("looking for a short plan on the graph");
    let bound = bound::bound(&problem, &settings.bound, arguments.seed, &stop, &mut |progress| meter.stage(&line(progress)))?;
    drop(interrupts);
    drop(meter);

    let statement = statement(&bound, &problem, &name);
    let json = to_json(&bound, &problem, &name, &statement, started.elapsed().as_secs_f64());
    let mut text = text(&bound, &problem, &statement, started.elapsed().as_secs_f64());
    if let Some(folder) = &arguments.out {
        let path = folder.join("bound.json");
        write(&path, &json)?;
        text.push_str(&format!("\nwrote {}", path.display()));
    }
    Ok(Answer { text, json })
}

impl From<BoundError> for Failure {
    fn from(error: BoundError) -> Self {
        if error == BoundError::Stopped { Failure::Interrupted } else { Failure::Bound(error) }
    }
}

fn line(progress: &Progress) -> String {
    let metres = |length_um: i64| length_um as f64 / 1e6;
    let plan = progress.plan_um.map_or(String::new(), |plan_um| format!(", a plan of {:.0} m is known", metres(plan_um)));
    format!("bounding   round {}, no plan below {:.0} m{plan}", progress.round, metres(progress.bound_um))
}

/// What exactly is bounded.
fn statement(bound: &Bound, problem: &Problem, scene: &str) -> String {
    let credit = match problem.rig.cameras {
        Cameras::Panoramic { .. } => "every image sees all around",
        Cameras::Gimbal { .. } => {
            "a visit to a waypoint takes one image in one of the discretised directions, and an image on the way is credited with everything around it, \
             however the gimbal turns"
        }
        Cameras::Rigid(_) => "every image is credited with everything around it, whatever the heading",
    };
    format!(
        "No plan on this graph is shorter: it flies straight legs between {} viewpoints of the field of {scene} ({} legs of at most {:.0} m), photographs at \
         both ends of each leg and at least {} m apart between them, and captures at least {} of the {} samples that {} can capture ({} of {} cells of \
         each hemisphere, by the field). Credit: {credit}. Flights through other points are not bounded.",
        bound.graph.positions_m.len(),
        bound.graph.edges.len(),
        bound.radius_m,
        problem.spacing.least_leg_m,
        problem.sufficient,
        problem.capturable,
        problem.rig.name,
        bound.graph.demand.needed_cells,
        crate::coverage::CELLS,
    )
}

fn text(bound: &Bound, problem: &Problem, statement: &str, total_s: f64) -> String {
    let mut rows = vec![
        vec!["rig".to_owned(), problem.rig.name.clone()],
        vec!["certified lower bound, m".to_owned(), format!("{:.1}", bound.length_m())],
    ];
    if let (Some(plan_m), Some(ratio), Some(plan)) = (bound.plan_m(), bound.ratio(), &bound.plan) {
        rows.push(vec!["plan on the same graph, m".to_owned(), format!("{plan_m:.1}")]);
        rows.push(vec!["  captured samples".to_owned(), format!("{} of {}", plan.captured, problem.capturable)]);
        // Rounded up: the statement has to hold.
        rows.push(vec!["  times the optimum, at most".to_owned(), format!("{:.2}", (ratio * 100.0).ceil() / 100.0)]);
    }
    rows.push(vec!["rounds".to_owned(), bound.outcome.rounds.to_string()]);
    rows.push(vec!["total, s".to_owned(), format!("{total_s:.1}")]);
    let note = match bound.outcome.ended {
        Ended::Still => "",
        Ended::MostRounds => "\nthe rounds were used up: more (`bound.most_rounds`) would lift the bound",
        Ended::Stopped => "\nstopped: the bound holds, but more rounds would lift it",
    };
    format!("{}\n{statement}{note}", answer::table(&rows))
}

fn to_json(bound: &Bound, problem: &Problem, scene: &str, statement: &str, total_s: f64) -> Value {
    let places = |v: &usize| -> [f64; 3] { bound.graph.positions_m[*v].coords.into() };
    let plan = bound.plan.as_ref().map(|plan| {
        json!({
            "length_m": bound.plan_m(),
            "captured": plan.captured,
            "waypoints_m": plan.vertices.iter().map(places).collect::<Vec<_>>(),
        })
    });
    json!({
        "format": "overfly-bound/1",
        "scene": scene,
        "rig": problem.rig.name,
        "bound_m": bound.length_m(),
        "plan": plan,
        "ratio": bound.ratio(),
        "statement": statement,
        "waypoints": bound.graph.positions_m.len(),
        "legs": bound.graph.edges.len(),
        "samples": problem.field.samples.len(),
        "capturable": problem.capturable,
        "sufficient": problem.sufficient,
        "rounds": bound.outcome.rounds,
        "rows": bound.outcome.rows,
        "ended": match bound.outcome.ended {
            Ended::Still => "still",
            Ended::MostRounds => "most_rounds",
            Ended::Stopped => "stopped",
        },
        "total_s": total_s,
    })
}

fn write(path: &Path, json: &Value) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(json).map_err(|cause| Failure::Unexpected(cause.to_string()))?;
    std::fs::write(path, text + "\n").map_err(|cause| Failure::write(path, cause))
}
