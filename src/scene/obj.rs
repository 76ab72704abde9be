//! Wavefront OBJ meshes in local metres, z up.
//!
//! Objects (`o`), else groups (`g`), are structures; in a file without names each body of connected faces is one. The lowest vertex
//! lies on the ground. Materials, texture coordinates and normals do not matter here, so the few statements that do are read
//! directly, which lets an error name its line.

use std::borrow::Cow;
use std::collections::HashMap;

use nalgebra::Point3;

use super::anchor::Anchor;
use super::meshes::{self, MeshFile, RawMesh};
use super::names::tidy;
use super::proxy::{Scene, Triangle};
use super::read::ImportError;
use super::report::{Format, ImportReport, Place};
use crate::settings::{ProxySettings, UpAxis};

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let parsed = parse(bytes).map_err(|(line, what)| ImportError::Line { file: file.into(), line, what })?;
    let faces = parsed.faces.len();
    let meshes = if parsed.named { parsed.by_name() } else { parsed.by_body() };
    meshes::scene_of(file, MeshFile { format: Format::Obj, meshes, faces, up: UpAxis::Z }, settings, anchor)
}

/// What a file says.
struct Parsed {
    vertices: Vec<Point3<f64>>,
    faces: Vec<Face>,
    /// Names of objects or groups; the faces refer to them.
    names: Vec<String>,
    named: bool,
}

struct Face {
    line: usize,
    vertices: Vec<usize>,
    object: Option<usize>,
    group: Option<usize>,
}

fn parse(bytes: &[u8]) -> Result<Parsed, (usize, String)> {
    let mut parsed = Parsed { vertices: Vec::new(), faces: Vec::new(), names: Vec::new(), named: false };
    let mut numbers: HashMap<String, usize> = HashMap::new();
    let (mut object, mut group) = (None, None);
    for (line, text) in statements(bytes) {
        let (keyword, rest) = text.trim().split_once(char::is_whitespace).unwrap_or((text.trim(), ""));
        match keyword {
            "v" => parsed.vertices.push(vertex(rest).map_err(|what| (line, what))?),
            "f" => {
                let vertices = face(rest, parsed.vertices.len()).map_err(|what| (line, what))?;
                parsed.faces.push(Face { line, vertices, object, group });
            }
            "o" | "g" => {
                let name = tidy(rest);
                let number = (!name.is_empty()).then(|| {
                    *numbers.entry(name.clone()).or_insert_with(|| {
                        parsed.names.push(name);
                        parsed.names.len() - 1
                    })
                });
                if keyword == "o" { object = number } else { group = number }
            }
            _ => {}
        }
    }
    // Objects go before groups: files that have both use groups for the parts of an object.
    let has_objects = parsed.faces.iter().any(|face| face.object.is_some());
    for face in &mut parsed.faces {
        if !has_objects {
            face.object = face.group;
        }
    }
    parsed.named = parsed.faces.iter().any(|face| face.object.is_some());
    Ok(parsed)
}

/// The statements with the line that they start on; a backslash at the end of a line continues it.
fn statements(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = bytes.split(|&byte| byte == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (index, line) = lines.next()?;
        let mut text = String::from_utf8_lossy(line);
        while let Some(start) = text.trim_end().strip_suffix('\\') {
            let mut joined = start.to_owned();
            let Some((_, next)) = lines.next() else { return Some((index + 1, Cow::Owned(joined))) };
            joined.push(' ');
            joined.push_str(&String::from_utf8_lossy(next));
            text = Cow::Owned(joined);
        }
        Some((index + 1, text))
    })
}

fn vertex(rest: &str) -> Result<Point3<f64>, String> {
    let mut words = rest.split_whitespace();
    let mut next = || words.next().and_then(|word| word.parse::<f64>().ok());
    match (next(), next(), next()) {
        (Some(x), Some(y), Some(z)) => Ok(Point3::new(x, y, z)),
        _ => Err(format!("a vertex needs three numbers, found {:?}", shortened(rest))),
    }
}

fn face(rest: &str, vertices: usize) -> Result<Vec<usize>, String> {
    rest.split_whitespace().take_while(|word| !word.starts_with('#')).map(|word| index(word, vertices)).collect()
}

/// A vertex index counts from 1; a negative one counts back from the newest vertex.
fn index(word: &str, vertices: usize) -> Result<usize, String> {
    let number: i64 = word
        .split('/')
        .next()
        .and_then(|number| number.parse().ok())
        .ok_or_else(|| format!("{:?} is no vertex index", shortened(word)))?;
    let count = vertices as i64;
    let index = if number < 0 { count.checked_add(number) } else { number.checked_sub(1) };
    match index {
        Some(index) if (0..count).contains(&index) => Ok(index as usize),
        _ => Err(format!("a face refers to vertex {number}, but {vertices} vertices are known here")),
    }
}

fn shortened(text: &str) -> String {
    tidy(&text.chars().take(40).collect::<String>())
}

impl Parsed {
    fn by_name(&self) -> Vec<RawMesh> {
        let mut meshes: Vec<Option<RawMesh>> = Vec::new();
        meshes.resize_with(self.names.len() + 1, || None);
        for face in &self.faces {
            let number = face.object.unwrap_or(self.names.len());
            let name = self.names.get(number).map_or("unnamed", String::as_str);
            let mesh = meshes[number].get_or_insert_with(|| RawMesh::empty(name.to_owned(), Place::Line(face.line)));
            mesh.add(self.triangles(face));
        }
        meshes.into_iter().flatten().collect()
    }

    fn by_body(&self) -> Vec<RawMesh> {
        meshes::by_body(self.faces.iter().map(|face| (Place::Line(face.line), self.triangles(face))))
    }

    fn triangles(&self, face: &Face) -> Option<Vec<Triangle>> {
        meshes::face(face.vertices.iter().map(|&index| self.vertices[index]).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    fn read_text(text: &str) -> Result<(Scene, ImportReport), ImportError> {
        read("model.obj", text.as_bytes(), &Settings::default().proxy, None)
    }

    /// Two boxes 100 m apart, the second floating; faces are quads, some indices relative.
    fn boxes(names: [&str; 2]) -> String {
        boxes_at(0.0, names)
    }

    fn boxes_at(west_m: f64, names: [&str; 2]) -> String {
        let mut text = String::from("# boxes\nmtllib none.mtl\n");
        for (index, name) in names.iter().enumerate() {
            let (x, z) = (west_m + 100.0 * index as f64, 5.0 + 3.0 * index as f64);
            text += name;
            for z in [z, z + 10.0] {
                for [dx, y] in [[0, 0], [10, 0], [10, 10], [0, 10]] {
                    text += &format!("v {} {y} {z}\n", x + f64::from(dx));
                }
            }
            text += "f -8 -5 -6 -7\nf -4 -3 -2 -1\nf -8/1/1 -7//2 -3 \\\n -4\nf -7 -6 -2 -3\nf -6 -5 -1 -2\nf -5 -8 -4 -1\n";
        }
        text
    }

    #[test]
    fn names_make_structures() {
        let (scene, report) = read_text(&boxes(["o first one\n", "g ignored\no second\n"])).unwrap();
        let mut names: Vec<_> = scene.structures.iter().map(|s| (s.name.as_str(), s.bounds().min.z, s.bounds().max.z)).collect();
        names.sort_by(|a, b| a.0.cmp(b.0));
        assert_eq!(names, [("first one", 0.0, 10.0), ("second", 3.0, 13.0)]);
        assert_eq!(report.items, []);
        assert_eq!(read_text(&boxes(["g a\n", "g b\n"])).unwrap().0.structures.len(), 2);
        assert_eq!(read_text(&boxes(["g a\n", "g a\n"])).unwrap().0.structures.len(), 1);
    }

    #[test]
    fn without_names_each_body_is_a_structure() {
        let (scene, _) = read_text(&boxes(["", ""])).unwrap();
        assert_eq!(scene.structures.len(), 2);
        assert!(scene.find("body-1").is_some() && scene.find("body-2").is_some());
        assert!(scene.structures.iter().all(|s| s.contains(&nalgebra::center(&s.bounds().min, &s.bounds().max))));
    }

    #[test]
    fn concave_faces_are_cut_right() {
        let text = "v 0 0 0\nv 10 0 0\nv 10 10 0\nv 5 2 0\nv 0 10 0\nv 5 5 9\nf 1 2 3 4 5\nf 1 2 6\n";
        let (scene, _) = read_text(text).unwrap();
        let area: f64 = scene.structures[0].triangles().iter().map(|[a, b, c]| (b - a).cross(&(c - a)).z.abs() / 2.0).sum();
        assert!((area - (60.0 + 25.0)).abs() < 1e-9, "{area}");
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (text, line) in [
            ("v 1 2\n", 1),
            ("v 0 0 0\nv 1 0 x\n", 2),
            ("v 0 0 0\nf 1 2 3\n", 2),
            ("v 0 0 0\n\nf 1 0 1\n", 3),
            ("v 0 0 0\nf 1 -2 1\n", 2),
            ("v 0 0 0\nf a b c\n", 2),
            ("v 0 0 0\nf 1 1 9223372036854775807\n", 2),
            ("v 0 0 0\nf 1 1 -9223372036854775808\n", 2),
        ] {
            match read_text(text) {
                Err(ImportError::Line { line: found, .. }) => assert_eq!(found, line, "{text}"),
                other => panic!("{text}: {other:?}"),
            }
        }
    }

    #[test]
    fn nothing_usable_is_an_error() {
        assert!(matches!(read_text("v 0 0 0\n"), Err(ImportError::NoStructures { .. })));
        assert!(matches!(read_text("v 0 0 0\nf 1 1 1\n"), Err(ImportError::Coordinates { .. })));
        assert!(matches!(read_text("v nan 0 0\nv 1 inf 0\nv 0 1 0\nf 1 2 3\n"), Err(ImportError::Coordinates { .. })));
        assert!(matches!(read_text("v 0 0 0\nv 1 1e300 0\nv 0 1 5\nf 1 2 3\n"), Err(ImportError::Coordinates { .. })));
    }

    #[test]
    fn grid_coordinates_are_moved_near_the_origin() {
        let (scene, report) = read_text(&boxes_at(90_759.0, ["", ""])).unwrap();
        assert_eq!(scene.bounds().unwrap().max.x, 55.0);
        assert!(report.notes.iter().any(|note| note.contains("origin")), "{:?}", report.notes);
    }
}
