//! `overfly watch`: each new plan of a scene, as it is published; as lines, or on a page.

use std::path::PathBuf;
use std::time::Duration;

use overfly_client::{Client, PlanMessage};
use serde_json::json;

use super::answer::{Answer, Form};
use super::arguments::WatchArgs;
use super::failure::Failure;
use super::outputs::{self, FileNames};
use super::{daemon, live};
use crate::trajectory::plan::{Plan, StopReason};

/// How long to wait for a plan before asking whether the daemon is still there.
const ASK_AGAIN: Duration = Duration::from_secs(5);

pub fn run(arguments: &WatchArgs, form: Form) -> Result<(), Failure> {
    if let Some(port) = arguments.html {
        return live::run(arguments, port, form);
    }
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
    if let Some(reason) = message.infeasible() {
        let revision = message.table().facts.revision;
        let text = format!("revision {revision}: no flight, do not fly the plan before: {reason}");
        return Ok(Answer { text, json: json!({ "revision": revision, "infeasible": reason }) });
    }
    let (plan, times) = daemon::plan_of(message)?;
    let flight = daemon::flight(&plan, times, None, None);
    let mut files: Vec<PathBuf> = Vec::new();
    // One of which it is not known yet what it captures is followed at once by one of which it is.
    if let Some(folder) = arguments.out.as_ref().filter(|_| plan.is_counted()) {
        let names = FileNames::with_stem(&format!("revision-{}-seed-{}", plan.scene.revision, plan.seed));
        let (written, remark) = daemon::write(client, folder, &names, &flight)?;
        files = written;
        remark.into_iter().for_each(|remark| form.remark(remark));
    }
    let mut text = line(&plan, times.total_s);
    let mut json = outputs::figures_json(&flight, &files);
    json["epoch"] = message.epoch().into();
    if let Some((epoch, waypoint)) = message.differs_from() {
        text += &format!("; as plan {epoch} before waypoint {waypoint}");
        json["follows"] = epoch.into();
        json["first_changed_waypoint"] = waypoint.into();
    }
    Ok(Answer { text, json })
}

fn line(plan: &Plan, total_s: f64) -> String {
    let metrics = &plan.metrics;
    let captured = if plan.is_counted() { format!("{:.1} % of capturable, ", metrics.coverage_percent) } else { String::new() };
    let follows = match plan.stop {
        StopReason::Safe => "; safe after an edit, what it captures follows",
        StopReason::Repaired => "; repaired after an edit, a better one follows",
        StopReason::Improved => "; improved after an edit, the search goes on",
        _ => "",
    };
    format!(
        "revision {}: {captured}{:.0} m, {} waypoints, flight {:.0} s; planned in {total_s:.3} s{follows}",
        plan.scene.revision,
        metrics.length_m,
        plan.waypoints.len(),
        metrics.flight_s
    )
}
