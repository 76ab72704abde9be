//! What a flight says: a line for people, an object for scripts.

use serde_json::{Value, json};

use super::line;
use super::orders::Word;
use crate::autopilot::follow::Progress;
use crate::autopilot::link::LinkError;
use crate::autopilot::mission::Mission;
use crate::autopilot::notice::{End, Notice};
use crate::cli::answer::{Answer, table};
use crate::mission::mav_items::Autopilot;

fn name(autopilot: Autopilot) -> &'static str {
    match autopilot {
        Autopilot::Px4 => "px4",
        Autopilot::ArduPilot => "ardupilot",
    }
}

fn plan(epoch: u64) -> String {
    if epoch == 0 { "the plan".to_owned() } else { format!("plan {epoch}") }
}

pub fn notice(notice: &Notice) -> Answer {
    match notice {
        Notice::Found { vehicle, autopilot, is_armed } => line(
            "found",
            format!("{}: {}, {}", name(*autopilot), vehicle, if *is_armed { "armed" } else { "disarmed" }),
            json!({ "system": vehicle.system, "component": vehicle.component, "autopilot": name(*autopilot), "armed": is_armed }),
        ),
        Notice::Note(text) => note(text),
        Notice::Uploading { epoch, items, attempt } => line(
            "uploading",
            format!(
                "uploading {}: {items} items{}",
                plan(*epoch),
                if *attempt > 1 { format!(", attempt {attempt}") } else { String::new() }
            ),
            json!({ "epoch": epoch, "items": items, "attempt": attempt }),
        ),
        Notice::Uploaded { epoch, items, took, sortie, sorties } => {
            let of = if *sorties > 1 { format!("; sortie {sortie} of {sorties}") } else { String::new() };
            let took_s = took.as_secs_f64();
            line(
                "uploaded",
                format!("the autopilot has {}: {items} items in {took_s:.2} s{of}", plan(*epoch)),
                json!({ "epoch": epoch, "items": items, "upload_s": took_s, "sortie": sortie, "sorties": sorties }),
            )
        }
        Notice::Joined { epoch, waypoint, item, off_m } => line(
            "joined",
            format!("flying on along {}: waypoint {waypoint} is next (item {item}), {off_m:.1} m off the path", plan(*epoch)),
            json!({ "epoch": epoch, "waypoint": waypoint, "item": item, "off_path_m": off_m }),
        ),
        Notice::FarOff { off_m } => line(
            "far_off",
            format!(
                "{off_m:.0} m off the new path: the aircraft holds, climbs above everything, flies across and comes down to it"
            ),
            json!({ "off_path_m": off_m }),
        ),
        Notice::Superseded { epoch, asked } => line(
            "superseded",
            format!("{} gives way to a newer one after {asked} items", plan(*epoch)),
            json!({ "epoch": epoch, "items_sent": asked }),
        ),
        Notice::Again { epoch, why } => {
            line("again", format!("{} is uploaded again: {why}", plan(*epoch)), json!({ "epoch": epoch, "message": why }))
        }
        Notice::Kept { epoch, why, is_held } => {
            let instead = if *is_held { "the aircraft holds" } else { "the one before is flown on" };
            let text = format!("{} is not flown, {instead}: {why}", plan(*epoch));
            line("kept", text, json!({ "epoch": epoch, "message": why, "holds": is_held }))
        }
        Notice::LinkLost { silent } => {
            let silent_s = silent.as_secs_f64();
            let text =
                format!("no heartbeat for {silent_s:.0} s: the link is lost; the autopilot flies its mission on by itself");
            line("link_lost", text, json!({ "silent_s": silent_s }))
        }
        Notice::LinkBack { silent } => {
            let silent_s = silent.as_secs_f64();
            line("link_back", format!("the link is back after {silent_s:.1} s"), json!({ "silent_s": silent_s }))
        }
        Notice::Obeyed(order) => line("obeyed", format!("done: {}", order.name()), json!({ "order": order.name() })),
        Notice::Disobeyed(error) => line("disobeyed", error.to_string(), json!({ "message": error.to_string() })),
        Notice::Mode { is_mission, mode } => line(
            "mode",
            format!("the autopilot {} its mission (mode {mode:#x})", if *is_mission { "flies on along" } else { "has left" }),
            json!({ "on_mission": is_mission, "mode": mode }),
        ),
        Notice::Said(text) => line("said", format!("the autopilot says: {text}"), json!({ "message": text })),
    }
}

pub fn note(text: &str) -> Answer {
    line("note", format!("note: {text}"), json!({ "message": text }))
}

pub fn word(word: &Word) -> Answer {
    match word {
        Word::Plan(new) => line("plan", format!("plan {} has come", new.epoch), json!({ "epoch": new.epoch })),
        Word::Infeasible { revision, reason } => line(
            "infeasible",
            format!("revision {revision}: no flight, do not fly the plan before: {reason}"),
            json!({ "revision": revision, "infeasible": reason }),
        ),
        Word::Failed(error) => line("daemon_lost", error.to_string(), json!({ "message": error.to_string() })),
        Word::Lost(why) => {
            line("daemon_lost", format!("there are no newer plans for now, the flight goes on: {why}"), json!({ "message": why }))
        }
        Word::Back => line("daemon_back", "the daemon is back: newer plans are taken again".to_owned(), json!({})),
        Word::Refused(why) => line("daemon_refused", format!("the daemon: {why}"), json!({ "message": why })),
    }
}

pub fn link(error: &LinkError) -> Answer {
    line("link_broken", error.to_string(), json!({ "message": error.to_string() }))
}

/// How far the flight has come.
fn figures(progress: &Progress) -> Value {
    let plan = &progress.mission.plan;
    json!({
        "epoch": progress.mission.epoch,
        "waypoint": progress.ahead(),
        "waypoints": plan.waypoints.len(),
        "images_taken": progress.images_taken(),
        "images": plan.images.len(),
        "camera_tells": progress.is_fed,
        "exposures_missed": progress.missed(),
        "images_elsewhere": progress.strays(),
        "position_m": progress.fix.map(|fix| <[f64; 3]>::from(fix.position_m)),
        "velocity_mps": progress.fix.map(|fix| <[f64; 3]>::from(fix.velocity_mps)),
    })
}

pub fn progress(progress: &Progress) -> Answer {
    let plan = &progress.mission.plan;
    let (waypoints, taken, images) = (plan.waypoints.len(), progress.images_taken(), plan.images.len());
    let at = progress.ahead().map_or(format!("all {waypoints} waypoints"), |ahead| format!("to waypoint {ahead} of {waypoints}"));
    let how = if progress.is_fed { format!("taken, {} exposures missed", progress.missed()) } else { "passed".to_owned() };
    line("progress", format!("{at}: {taken} of {images} images {how}"), figures(progress))
}

pub fn end(end: End, progress: Option<&Progress>) -> Answer {
    let figures = progress.map_or_else(|| json!({}), figures);
    match end {
        End::Uploaded => line("uploaded_only", "the mission is up".to_owned(), figures),
        End::Flown => line("flown", "the plan is flown; the mission's last items bring the aircraft home".to_owned(), figures),
        End::Landed => line("landed", "the aircraft was disarmed before the last waypoint".to_owned(), figures),
    }
}

pub fn stopped(progress: Option<&Progress>) -> Answer {
    let text = "stopped following; the autopilot flies on by itself what it has".to_owned();
    line("stopped", text, progress.map_or_else(|| json!({}), figures))
}

/// The items of a mission, as they would be sent. Numbers that are left to the autopilot are `null`.
pub fn items(mission: &Mission) -> Answer {
    let number = |value: f32| if value.is_nan() { "-".to_owned() } else { format!("{value}") };
    let mut rows =
        vec![["item", "command", "frame", "1", "2", "3", "4", "5 (lat)", "6 (lon)", "7 (alt)"].map(str::to_owned).to_vec()];
    let mut list = Vec::new();
    for (seq, item) in mission.items.iter().enumerate() {
        let command = format!("{:?}", item.command);
        let params = [item.param1, item.param2, item.param3, item.param4];
        let short = command.strip_prefix("MAV_CMD_").unwrap_or(&command).to_owned();
        let mut row = vec![seq.to_string(), short, (item.frame as u8).to_string()];
        row.extend(params.map(number));
        row.extend([item.x.to_string(), item.y.to_string(), number(item.z)]);
        rows.push(row);
        list.push(json!({
            "seq": seq,
            "command": item.command as u32,
            "name": command,
            "frame": item.frame as u8,
            "params": params.map(|param| (!param.is_nan()).then_some(param)),
            "x": item.x,
            "y": item.y,
            "z": item.z,
        }));
    }
    let notes: Vec<String> = mission.notes.iter().map(|note| format!("note: {note}")).collect();
    let text = format!(
        "{}\n{} items, sortie {} of {}\n{}",
        table(&rows),
        mission.items.len(),
        mission.sortie,
        mission.sorties,
        notes.join("\n")
    );
    let json = json!({ "items": list, "sortie": mission.sortie, "sorties": mission.sorties, "notes": mission.notes });
    Answer { text, json }
}
