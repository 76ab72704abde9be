//! `overfly generate`: a city block as GeoJSON.

use serde_json::json;

use super::answer::{Answer, Form};
use super::arguments::GenerateArgs;
use super::failure::Failure;
use super::import_lines::counted;
use crate::scene::{self, BlockSettings};

pub fn run(arguments: &GenerateArgs, form: Form) -> Result<Answer, Failure> {
    let scene = scene::generate_block(&BlockSettings { seed: arguments.seed, ..Default::default() });
    let text = scene::to_geojson(&scene);
    let facts =
        json!({ "scene": scene.name, "structures": scene.structures.len(), "seed": arguments.seed, "file": arguments.out });
    let Some(path) = &arguments.out else {
        let json = match form {
            Form::Json => serde_json::from_str(&text).unwrap_or(facts),
            Form::Text => facts,
        };
        return Ok(Answer { text, json });
    };
    std::fs::write(path, &text).map_err(|cause| Failure::write(path, cause))?;
    let text =
        format!("wrote {} with {}; `overfly plan {0}` plans it", path.display(), counted(scene.structures.len(), "structure"));
    Ok(Answer { text, json: facts })
}
