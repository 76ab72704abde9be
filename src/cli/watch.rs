//! `overfly watch`: each new plan of a scene, as it is published.

use std::path::PathBuf;
use std::time::Duration;

use overfly_client::{Client, PlanMessage};

use super::answer::{Answer, Form};
use super::arguments::WatchArgs;
use super::daemon;
use super::failure::Failure;
use super::outputs::{self, FileNames};
use crate::trajectory::plan::{Plan, StopReason};

/// How long to wait for a plan before asking whether the daemon is still there.
const ASK_AGAIN: Duration = Duration::from_secs(5);

pub fn run(arguments: &WatchArgs, form: Form) -> Result<(), Failure> {
    let client = daemon::connect(arguments.reach.domain.as_deref())?;
    let watch = client.watch(&arguments.scene)?;
    form.remark(&format!("watching {}; Ctrl-C ends it", arguments.scene));
    let mut received = 0;
    while arguments.count.is_none_or(|count| received < count) {
        match watch.next(ASK_AGAIN)? {
            Some(message) => {
                form.print(&show(&client, arguments, &message, form)?).map_err(Failure::Print)?;
                received += 1;
            }
            None => {
                client.ping()?;
            }
        }
    }
    Ok(())
}

fn show(client: &Client, arguments: &WatchArgs, message: &PlanMessage, form: Form) -> Result<Answer, Failure> {
    let (plan, times) = daemon::plan_of(message)?;
    let flight = daemon::flight(&plan, times, None, None);
    let mut files: Vec<PathBuf> = Vec::new();
    if let Some(folder) = &arguments.out {
        let names = FileNames::with_stem(&format!("revision-{}-seed-{}", plan.scene.revision, plan.seed));
        let (written, remark) = daemon::write(client, folder, &names, &flight)?;
        files = written;
        remark.into_iter().for_each(|remark| form.remark(remark));
    }
    Ok(Answer { text: line(&plan, times.total_s), json: outputs::figures_json(&flight, &files) })
}

fn line(plan: &Plan, total_s: f64) -> String {
    let metrics = &plan.metrics;
    let follows = if plan.stop == StopReason::Repaired { "; repaired after an edit, a better one follows" } else { "" };
    format!(
        "revision {}: {:.1} % of capturable, {:.0} m, {} waypoints, flight {:.0} s; planned in {total_s:.3} s{follows}",
        plan.scene.revision,
        metrics.coverage_percent,
        metrics.length_m,
        plan.waypoints.len(),
        metrics.flight_s
    )
}
