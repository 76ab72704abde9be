//! `overfly status`: the daemon with its scenes, or the structures of one scene. `overfly reload` and `overfly stop` stand beside it.

use std::time::Duration;

use overfly_client::{Client, SceneState, SceneStatus, Status, StructureInfo, StructureKind, ZoneInfo};
use serde_json::{Value, json};

use super::answer::{self, Answer, Form};
use super::arguments::{Reach, StatusArgs};
use super::daemon;
use super::failure::Failure;

/// How long to wait for a status before asking whether the daemon is still there.
const ASK_AGAIN: Duration = Duration::from_secs(5);

pub fn run(arguments: &StatusArgs, form: Form) -> Result<Option<Answer>, Failure> {
    let client = daemon::connect(arguments.reach.domain.as_deref())?;
    match &arguments.scene {
        Some(scene) => Ok(Some(content(scene, &client.structures(scene)?, &client.zones(scene)?))),
        None if arguments.follow => follow(&client, form).map(|()| None),
        None => Ok(Some(overview(&client.status()?))),
    }
}

fn follow(client: &Client, form: Form) -> Result<(), Failure> {
    let feed = client.status_feed()?;
    loop {
        match feed.next(ASK_AGAIN)? {
            Some(status) => form.print(&overview(&status)).map_err(Failure::Print)?,
            None => drop(client.ping()?),
        }
    }
}

/// `overfly reload`.
pub fn reload(reach: &Reach) -> Result<Answer, Failure> {
    daemon::connect(reach.domain.as_deref())?.reload()?;
    let text = "the configuration was read again; scenes that are loaded keep what they were loaded with".to_owned();
    Ok(Answer { text, json: json!({ "reloaded": true }) })
}

/// `overfly stop`.
pub fn stop(reach: &Reach) -> Result<Answer, Failure> {
    daemon::connect(reach.domain.as_deref())?.stop()?;
    Ok(Answer { text: "the daemon ends".to_owned(), json: json!({ "stopped": true }) })
}

fn overview(status: &Status) -> Answer {
    let mb = |bytes: u64| bytes as f64 / 1e6;
    let mut text = format!(
        "daemon {} in domain {:?}, process {}, up {:.0} s, {} threads\nfields {:.1} of {:.0} MB, resident {:.0} MB\n",
        status.version,
        status.domain,
        status.pid,
        status.uptime_s,
        status.threads,
        mb(status.field_bytes),
        mb(status.budget_bytes),
        status.resident_mb
    );
    if status.scenes.is_empty() {
        text.push_str("no scene is loaded; `overfly load FILE` loads one");
    } else {
        let head = ["scene", "revision", "structures", "samples", "viewpoints", "capturable %", "state", "plan %", "plan m"];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        rows.extend(status.scenes.iter().map(scene_row));
        text.push_str(&answer::table(&rows));
        status.scenes.iter().filter_map(scene_note).for_each(|note| text.push_str(&note));
    }
    Answer { text, json: status_json(status) }
}

fn scene_row(scene: &SceneStatus) -> Vec<String> {
    let plan = |figure: fn(&overfly_client::PlanSummary) -> String| scene.plan.as_ref().map_or("-".to_owned(), figure);
    vec![
        scene.name.clone(),
        scene.revision.to_string(),
        scene.structures.to_string(),
        scene.samples.to_string(),
        scene.viewpoints.to_string(),
        format!("{:.1}", scene.capturable_percent),
        state_name(scene.state).to_owned(),
        plan(|plan| if plan.coverage_percent.is_nan() { "follows".to_owned() } else { format!("{:.1}", plan.coverage_percent) }),
        plan(|plan| format!("{:.0}", plan.length_m)),
    ]
}

/// What is to be known before the last plan is flown.
fn scene_note(scene: &SceneStatus) -> Option<String> {
    let stale = scene.plan.as_ref().filter(|plan| plan.is_stale);
    let stale = stale.map(|plan| format!("its plan is of revision {} and stale: do not fly it", plan.revision));
    let notes: Vec<String> = stale.into_iter().chain(scene.remark.clone()).collect();
    (!notes.is_empty()).then(|| format!("\n{}: {}", scene.name, notes.join("; ")))
}

fn state_name(state: SceneState) -> &'static str {
    match state {
        SceneState::Idle => "idle",
        SceneState::Building => "building",
        SceneState::Planning => "planning",
    }
}

fn status_json(status: &Status) -> Value {
    json!({
        "version": status.version,
        "domain": status.domain,
        "pid": status.pid,
        "instance": format!("{:016x}", status.instance),
        "uptime_s": status.uptime_s,
        "threads": status.threads,
        "field_bytes": status.field_bytes,
        "budget_bytes": status.budget_bytes,
        "resident_mb": status.resident_mb,
        "scenes": status.scenes.iter().map(scene_json).collect::<Vec<_>>(),
    })
}

fn scene_json(scene: &SceneStatus) -> Value {
    let plan = scene.plan.as_ref().map(|plan| {
        json!({
            "revision": plan.revision,
            "stale": plan.is_stale,
            "seed": plan.seed,
            "waypoints": plan.waypoints,
            "length_m": plan.length_m,
            "flight_s": plan.flight_s,
            "coverage_percent": plan.coverage_percent,
            "total_s": plan.total_s,
        })
    });
    json!({
        "name": scene.name,
        "revision": scene.revision,
        "structures": scene.structures,
        "samples": scene.samples,
        "viewpoints": scene.viewpoints,
        "capturable_percent": scene.capturable_percent,
        "field_bytes": scene.field_bytes,
        "state": state_name(scene.state),
        "plan": plan,
        "remark": scene.remark,
    })
}

fn content(scene: &str, structures: &[StructureInfo], zones: &[ZoneInfo]) -> Answer {
    let mut rows = vec![["name", "id", "kind", "base m", "top m", "samples"].map(str::to_owned).to_vec()];
    rows.extend(structures.iter().map(|structure| {
        vec![
            structure.name.clone(),
            format!("{:016x}", structure.id),
            kind_name(structure.kind).to_owned(),
            format!("{:.1}", structure.base_m),
            format!("{:.1}", structure.top_m),
            structure.samples.to_string(),
        ]
    }));
    let mut text = answer::table(&rows);
    for zone in zones {
        let ceiling = zone.ceiling_m.map_or("up".into(), |ceiling_m| format!("to {ceiling_m} m"));
        let source = if zone.by_edit { ", added by an edit" } else { "" };
        text.push_str(&format!("\nno-fly zone {}: from {} m {ceiling}{source}", zone.name, zone.floor_m));
    }
    let structures = structures.iter().map(|structure| {
        json!({
            "name": structure.name,
            "id": format!("{:016x}", structure.id),
            "kind": kind_name(structure.kind),
            "base_m": structure.base_m,
            "top_m": structure.top_m,
            "samples": structure.samples,
        })
    });
    let zones = zones
        .iter()
        .map(|zone| json!({ "name": zone.name, "floor_m": zone.floor_m, "ceiling_m": zone.ceiling_m, "by_edit": zone.by_edit }));
    let (structures, zones): (Vec<Value>, Vec<Value>) = (structures.collect(), zones.collect());
    Answer { text, json: json!({ "scene": scene, "structures": structures, "zones": zones }) }
}

fn kind_name(kind: StructureKind) -> &'static str {
    match kind {
        StructureKind::Prism => "prism",
        StructureKind::Mesh => "mesh",
        StructureKind::Obstacle => "obstacle",
        StructureKind::Terrain => "terrain",
    }
}
