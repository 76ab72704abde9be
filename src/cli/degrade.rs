//! `overfly degrade`: a scene as an imperfect proxy, as GeoJSON.

use serde_json::json;

use super::answer::{Answer, Form};
use super::arguments::DegradeArgs;
use super::failure::Failure;
use super::import_lines::counted;
use super::{in_process, settings_file};
use crate::scene::degrade::{Degradation, LargestError, degrade};
use crate::scene::{Shape, to_geojson};

pub fn run(arguments: &DegradeArgs, form: Form) -> Result<Answer, Failure> {
    let settings = settings_file::settings(arguments.config.as_ref(), None)?;
    let (truth, _) = in_process::read_scene(&arguments.file, &settings)?;
    if truth.structures.iter().any(|structure| structure.terrain().is_some()) {
        let what = format!("{} has terrain, and GeoJSON, which is written here, has flat ground", arguments.file.display());
        return Err(Failure::Usage(format!("{what}; degrade a scene of footprints or meshes")));
    }
    let degradation =
        Degradation { heights_percent: arguments.heights, boundary: arguments.boundary.into(), seed: arguments.seed };
    let degraded = degrade(&truth, &degradation);
    std::fs::write(&arguments.out, to_geojson(&degraded.scene)).map_err(|cause| Failure::write(&arguments.out, cause))?;

    let safety_m = settings.flight.safety_distance_m;
    let LargestError { vertical, lateral } = degraded.largest_error_m;
    let warning = degraded.largest_error_m.exceeds(safety_m).then(|| warning(&degraded.largest_error_m, safety_m));
    if let Some(warning) = &warning {
        form.remark(&format!("warning: {warning}"));
    }
    let structures = degraded.scene.structures.len();
    let meshes = truth.structures.iter().filter(|structure| matches!(structure.shape, Shape::Mesh { .. })).count();
    let mut text = format!(
        "wrote {} with {}; tops are off by up to {vertical:.2} m, walls by up to {lateral:.2} m",
        arguments.out.display(),
        counted(structures, "structure")
    );
    if meshes > 0 {
        text.push_str(&format!("\n{} written as the prism over its outline", counted(meshes, "mesh surface")));
    }
    let json = json!({
        "scene": degraded.scene.name,
        "structures": structures,
        "meshes_as_prisms": meshes,
        "heights_percent": degradation.heights_percent,
        "boundary": degradation.boundary.name(),
        "seed": arguments.seed,
        "largest_error_m": { "vertical": vertical, "lateral": lateral },
        "safety_distance_m": safety_m,
        "warning": warning,
        "file": arguments.out,
    });
    Ok(Answer { text, json })
}

fn warning(error: &LargestError, safety_m: f64) -> String {
    let worst_m = error.vertical.max(error.lateral);
    format!(
        "the proxy is wrong by up to {worst_m:.2} m, more than the safety distance of {safety_m} m, which therefore cannot cover it: a flight that \
         keeps clear of this proxy may hit what really stands there; raise `flight.safety_distance_m` above {worst_m:.2} m"
    )
}
