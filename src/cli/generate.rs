//! `overfly generate`: a city block as GeoJSON.

use serde_json::json;

use super::answer::{Answer, Form};
use super::arguments::GenerateArgs;
use super::failure::Failure;
use super::import_lines::counted;
use super::values::Meters2;
use crate::scene::{self, BlockSettings};

/// Sides of a generated block, m, its lots and its tallest tower, m: within these limits blocks look like towns.
const EXTENT_M: [f64; 2] = [60.0, 5000.0];
const MOST_BUILDINGS: u32 = 20_000;
const TALLEST_M: [f64; 2] = [20.0, 500.0];

fn block(arguments: &GenerateArgs) -> Result<BlockSettings, Failure> {
    let within = |value: f64, [least, most]: [f64; 2]| (least..=most).contains(&value);
    let Meters2(extent_m) = arguments.extent;
    if !extent_m.iter().all(|&side_m| within(side_m, EXTENT_M)) {
        return Err(Failure::Usage(format!(
            "--extent {}: give sides from {} to {} m",
            commas(extent_m),
            EXTENT_M[0],
            EXTENT_M[1]
        )));
    }
    if arguments.buildings > MOST_BUILDINGS {
        return Err(Failure::Usage(format!("--buildings {}: give at most {MOST_BUILDINGS}", arguments.buildings)));
    }
    if !within(arguments.tallest, TALLEST_M) {
        return Err(Failure::Usage(format!("--tallest {}: give {} to {} m", arguments.tallest, TALLEST_M[0], TALLEST_M[1])));
    }
    if !within(arguments.built, [0.0, 1.0]) {
        return Err(Failure::Usage(format!("--built {}: give a share from 0 to 1", arguments.built)));
    }
    let (seed, buildings, max_height_m) = (arguments.seed, arguments.buildings, arguments.tallest);
    Ok(BlockSettings { seed, extent_m, buildings, max_height_m, built_share: arguments.built, ..Default::default() })
}

fn commas([x, y]: [f64; 2]) -> String {
    format!("{x},{y}")
}

pub fn run(arguments: &GenerateArgs, form: Form) -> Result<Answer, Failure> {
    let scene = scene::generate_block(&block(arguments)?);
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
