//! What is typed, or stands in a file, as edits that the daemon understands.

use std::collections::HashMap;
use std::path::Path;

use overfly_client::{EditOrder, ShapeOrder};
use overfly_wire::codec::MAX_REQUEST_BYTES;

use super::arguments::{Change, ShapeArgs};
use super::bounded_file;
use super::failure::Failure;
use super::in_process;
use crate::scene::anchor::Anchor;
use crate::scene::{self, ImportError, Triangle};
use crate::settings::Settings;

/// JSON takes up to so many times the room of what is sent.
const TEXT_PER_BYTE: usize = 8;

/// The edits that a command line asks for, to be made together.
pub fn of_change(change: &Change) -> Result<Vec<EditOrder>, Failure> {
    let one = match change.clone() {
        Change::Raise { id, by } => EditOrder::Raise { structure: id, by_m: positive("--by", by)? },
        Change::Lower { id, by } => EditOrder::Lower { structure: id, by_m: positive("--by", by)? },
        Change::Remove { id } => EditOrder::Remove { structure: id },
        Change::Add { name, shape } => EditOrder::Add { name, shape: of_shape(&shape)? },
        Change::Replace { id, shape } => EditOrder::Replace { structure: id, shape: of_shape(&shape)? },
        Change::Move { id, by } => EditOrder::Move { structure: id, by_m: by.0 },
        Change::AddZone { name, outline, floor, ceiling } => {
            EditOrder::AddZone { name, outline_m: outline.0, floor_m: floor, ceiling_m: ceiling }
        }
        Change::RemoveZone { name } => EditOrder::RemoveZone { name },
        Change::Batch { file } => return of_file(&file),
    };
    Ok(vec![one])
}

fn of_shape(arguments: &ShapeArgs) -> Result<ShapeOrder, Failure> {
    let ShapeArgs { outline, height, base, mesh, centre, size, yaw } = arguments;
    match (outline, mesh, centre) {
        (Some(outline), ..) => {
            let height_m = positive("--height", height.unwrap_or_default())?;
            Ok(ShapeOrder::Prism { outline_m: outline.0.clone(), base_m: *base, top_m: base + height_m })
        }
        (None, Some(file), _) => of_mesh(file),
        (None, None, Some(centre)) => {
            let size_m = size.map_or([0.0; 3], |size| size.0);
            Ok(ShapeOrder::Obstacle { centre_m: centre.0, size_m, yaw_deg: yaw.unwrap_or_default() })
        }
        (None, None, None) => Err(Failure::Usage("give a shape: `--outline`, `--mesh` or `--centre`".into())),
    }
}

/// All objects of an OBJ file as one mesh.
fn of_mesh(path: &Path) -> Result<ShapeOrder, Failure> {
    let bytes = in_process::read_bytes(path)?;
    let name = path.to_string_lossy();
    let read = scene::read_anchored(&name, &bytes, &Settings::default().proxy, &Anchor::LOCAL_MESH);
    let (scene, _) = read.map_err(|error| match error {
        ImportError::Anchor { .. } => {
            let what =
                format!("{name}: this is no OBJ file with metres in the scene's local frame; a mesh is read from nothing else");
            Failure::File(what)
        }
        other => other.into(),
    })?;
    Ok(indexed(scene.structures.iter().flat_map(|structure| structure.triangles())))
}

/// Triangles with corners at one place as one vertex.
fn indexed(triangles: impl Iterator<Item = Triangle>) -> ShapeOrder {
    let (mut numbers, mut vertices_m) = (HashMap::new(), Vec::new());
    let mut number = |corner: nalgebra::Point3<f64>| -> u32 {
        let place: [f64; 3] = corner.coords.into();
        *numbers.entry(place.map(f64::to_bits)).or_insert_with(|| {
            vertices_m.push(place);
            vertices_m.len() as u32 - 1
        })
    };
    let triangles = triangles.map(|corners| corners.map(&mut number)).collect();
    ShapeOrder::Mesh { vertices_m, triangles }
}

/// The list of edits of a JSON file.
fn of_file(path: &Path) -> Result<Vec<EditOrder>, Failure> {
    let remedy = "give a JSON file with a list of edits that you may read; `overfly edit --help` shows one";
    let most = (MAX_REQUEST_BYTES * TEXT_PER_BYTE) as u64;
    let bytes = bounded_file::read(path, most).map_err(|cause| Failure::Read { path: path.to_owned(), cause, remedy })?;
    let mut text = serde_json::Deserializer::from_slice(&bytes);
    let read = serde_path_to_error::deserialize(&mut text).map_err(|error| error.to_string());
    let edits = read.and_then(|edits| text.end().map(|()| edits).map_err(|error| error.to_string()));
    edits.map_err(|cause| Failure::File(format!("{}: {cause}; {remedy}", path.display())))
}

fn positive(option: &str, metres: f64) -> Result<f64, Failure> {
    if metres.is_finite() && metres > 0.0 {
        return Ok(metres);
    }
    Err(Failure::Usage(format!("{option} is {metres}; give a length above 0 m, and choose `raise` or `lower` for the direction")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The list in the help of the command.
    fn example() -> String {
        let mut command = <crate::cli::arguments::Arguments as clap::CommandFactory>::command();
        let help = command.find_subcommand_mut("edit").unwrap().get_after_help().unwrap().to_string();
        let start = help.find("[{").unwrap();
        help[start..help[start..].find("}]").unwrap() + start + 2].to_owned()
    }

    #[test]
    fn the_example_of_the_help_can_be_read_and_shows_every_edit() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("changes.json");
        std::fs::write(&file, example()).unwrap();
        let edits = of_file(&file).unwrap();
        let kinds: std::collections::HashSet<_> = edits.iter().map(std::mem::discriminant).collect();
        assert_eq!(kinds.len(), 8, "{edits:?}");
        let request = overfly_wire::Request::Edit { scene: "town".into(), edits };
        assert_eq!(request.check(), Ok(()));
    }

    #[test]
    fn a_list_with_a_mistake_is_refused_by_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("changes.json");
        for (from, to, place) in [
            ("\"by_m\": 3", "\"by\": 3", "[0].raise"),
            ("\"remove\"", "\"rmove\"", "[1]"),
            ("\"top_m\": 60", "\"top_m\": \"high\"", "[2].add.shape.prism.top_m"),
            ("[{\"raise\"", "{\"raise\"", "."),
        ] {
            std::fs::write(&file, example().replacen(from, to, 1)).unwrap();
            let message = of_file(&file).unwrap_err().to_string();
            assert!(message.contains(place) && message.contains("--help"), "{message}");
        }
    }

    #[test]
    fn a_mesh_keeps_its_place_and_shares_its_vertices() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("roof.obj");
        std::fs::write(&file, "o a\nv 5 5 7\nv 9 5 7\nv 5 9 7\nv 9 9 8\nf 1 2 3\no b\nf 2 4 3\n").unwrap();
        let ShapeOrder::Mesh { vertices_m, triangles } = of_mesh(&file).unwrap() else { panic!("another shape") };
        assert_eq!((vertices_m.len(), triangles.len()), (4, 2));
        assert!(vertices_m.contains(&[9.0, 9.0, 8.0]));
        std::fs::write(&file, "{\"type\": \"FeatureCollection\", \"features\": []}").unwrap();
        assert!(of_mesh(&file).unwrap_err().to_string().contains("OBJ"));
    }
}
