//! `overfly inspect`: what a scene file holds, and what its reader repaired, guessed and left out.

use serde_json::json;

use super::answer::{self, Answer, Form};
use super::arguments::InspectArgs;
use super::failure::Failure;
use super::import_lines;
use super::in_process::SceneFiles;
use super::outputs::Folder;
use super::progress::Meter;
use super::{in_process, settings_file};
use crate::mission::svg::scene_view;
use crate::scene::{ImportReport, Meaning, Scene, Shape};
use crate::stop::{Part, StopToken};

/// Items of a kind that are printed unless all are wanted.
const FIRST_ITEMS: usize = 5;

pub fn run(arguments: &InspectArgs, form: Form) -> Result<Answer, Failure> {
    let settings = settings_file::reading(arguments.config.as_ref(), None, &arguments.read)?;
    let folder = arguments.out.as_deref().map(Folder::prepare).transpose()?;
    let mut meter = Meter::new(form);
    meter.keep_moving();
    let files = SceneFiles { scene: &arguments.file, ground: arguments.read.dtm.as_deref() };
    let stop = StopToken::default();
    let (scene, report) =
        meter.while_counting(Part::Reading, &stop, || in_process::read_in_frame(&files, &settings, None, &stop))?;
    drop(meter);
    let mut object = json!({
        "scene": scene.name,
        "file": arguments.file,
        "origin": scene.frame.origin,
        "structures": scene.structures.iter().map(|structure| json!({
            "name": structure.name,
            "id": structure.id.to_string(),
            "shape": shape_name(&structure.shape),
            "base_m": structure.bounds().min.z,
            "top_m": structure.bounds().max.z,
        })).collect::<Vec<_>>(),
        "import": report,
    });
    let mut files = Vec::new();
    if let Some(path) = &arguments.out {
        let written = serde_json::to_vec_pretty(&object).map_err(|error| Failure::Unexpected(error.to_string()))?;
        for (name, bytes) in [("inspect.json", written), ("inspect.svg", scene_view::to_bytes(&scene, &report))] {
            let path = path.join(name);
            std::fs::write(&path, bytes).map_err(|cause| Failure::write(&path, cause))?;
            files.push(path.display().to_string());
        }
    }
    drop(folder);
    let text = text(&scene, &report, arguments.all, &files);
    object["files"] = json!(files);
    Ok(Answer { text, json: object })
}

fn shape_name(shape: &Shape) -> &'static str {
    match shape {
        Shape::Prism { .. } => "prism",
        Shape::Mesh { .. } => "mesh",
        Shape::Obstacle { .. } => "obstacle",
        Shape::Terrain(_) => "terrain",
    }
}

fn text(scene: &Scene, report: &ImportReport, all: bool, files: &[String]) -> String {
    let row = |label: &str, value: String| vec![label.to_owned(), value];
    let place = scene.frame.origin.map_or("none: metres in the file's own frame".to_owned(), |origin| {
        format!("{:.6} N, {:.6} E, ground at {:.1} m", origin.lat_deg, origin.lon_deg, origin.alt_m)
    });
    let count = |name: &str| scene.structures.iter().filter(|structure| shape_name(&structure.shape) == name).count();
    let shapes: Vec<String> = ["prism", "mesh", "obstacle", "terrain"]
        .into_iter()
        .map(|name| (name, count(name)))
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    let triangles: usize = scene.structures.iter().map(|structure| structure.triangles().len()).sum();
    let rows = [
        row("scene", scene.name.clone()),
        row("format", report.format.name().to_owned()),
        row("origin on Earth", place),
        row("structures", format!("{} ({})", scene.structures.len(), shapes.join(", "))),
        row("triangles", triangles.to_string()),
    ];
    let mut lines = vec![answer::table(&rows)];
    lines.extend(import_lines::lines(report, 0));
    for (kind, count) in &report.counts {
        let of_kind: Vec<_> = report.items.iter().filter(|item| item.kind == *kind).collect();
        let shown = if all { of_kind.len() } else { of_kind.len().min(FIRST_ITEMS) };
        lines.push(format!("\n{count} {kind}{}", remark(kind.meaning())));
        lines.extend(of_kind[..shown].iter().map(|item| format!("  {item}")));
        match count - shown {
            0 => {}
            _ if of_kind.is_empty() => {}
            more if all || of_kind.len() == shown => lines.push(format!("  and {more} more, too many to be kept")),
            more => lines.push(format!("  and {more} more (--all prints them)")),
        }
    }
    lines.extend(files.iter().map(|file| format!("wrote {file}")));
    lines.join("\n")
}

fn remark(meaning: Meaning) -> &'static str {
    match meaning {
        Meaning::Repaired => "",
        Meaning::Guessed => " (may be taller than taken: give the height, or raise the structure)",
        Meaning::Dropped => " (not avoided in flight: mend the file, or add what stands there)",
    }
}
