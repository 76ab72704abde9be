//! PLY meshes, ASCII and binary, in metres, z up. A PLY file has no names: each body of connected faces is a structure.

use std::io::Cursor;

use nalgebra::Point3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult};

use super::anchor::Anchor;
use super::meshes::{self, MeshFile};
use super::names::tidy;
use super::proxy::Scene;
use super::read::ImportError;
use super::report::{Format, ImportReport, Place};
use crate::settings::{ProxySettings, UpAxis};

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let damaged = |what: String| ImportError::Mesh { file: file.into(), what };
    let said = |error: ParseError| damaged(tidy(&error.to_string()));
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(said)?;
    let (mut vertices, mut faces): (Option<Vec<Vertex>>, Vec<Face>) = (None, Vec::new());
    for element in header.elements.values() {
        check(element, bytes.len()).map_err(damaged)?;
        match element.name.as_str() {
            "vertex" => vertices = Some(Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(said)?),
            "face" => faces = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(said)?,
            _ => drop(Parser::<Skipped>::new().read_payload_for_element(&mut reader, element, &header).map_err(said)?),
        }
    }
    let vertices: Vec<Point3<f64>> = vertices.unwrap_or_default().into_iter().map(|vertex| vertex.0).collect();
    if faces.is_empty() {
        return Err(damaged(format!("it has {} points and no faces: it is a cloud, not a mesh", vertices.len())));
    }
    let corner = |number: usize, index: i64| {
        let found = usize::try_from(index).ok().and_then(|index| vertices.get(index)).copied();
        found.ok_or_else(|| damaged(format!("face {number} refers to vertex {index}, and there are {}", vertices.len())))
    };
    let mut cut = Vec::with_capacity(faces.len());
    for (number, Face(indices)) in faces.iter().enumerate() {
        let corners: Vec<Point3<f64>> = indices.iter().map(|&index| corner(number, index)).collect::<Result<_, _>>()?;
        cut.push((Place::Face(number), meshes::face(corners)));
    }
    let meshes = meshes::by_body(cut.into_iter());
    meshes::scene_of(file, MeshFile { format: Format::Ply, meshes, faces: faces.len(), up: UpAxis::Z }, settings, anchor)
}

/// No element takes less than a byte, so that a file cannot hold more of them than it has bytes.
fn check(element: &ElementDef, bytes: usize) -> Result<(), String> {
    let ElementDef { name, count, properties, .. } = element;
    if *count > bytes || (properties.iter().next().is_none() && *count > 0) {
        return Err(format!("its header promises {count} elements {:?}, more than the file can hold", tidy(name)));
    }
    Ok(())
}

/// Coordinates that are not there are no place.
struct Vertex(Point3<f64>);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(Point3::new(f64::NAN, f64::NAN, f64::NAN))
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0[axis] = match value {
            Property::Float(value) => value.into(),
            Property::Double(value) => value,
            Property::Char(value) => value.into(),
            Property::UChar(value) => value.into(),
            Property::Short(value) => value.into(),
            Property::UShort(value) => value.into(),
            Property::Int(value) => value.into(),
            Property::UInt(value) => value.into(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// Indices of vertices.
struct Face(Vec<i64>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        fn wide<T: Into<i64>>(indices: Vec<T>) -> Vec<i64> {
            indices.into_iter().map(Into::into).collect()
        }
        self.0 = match value {
            Property::ListChar(indices) => wide(indices),
            Property::ListUChar(indices) => wide(indices),
            Property::ListShort(indices) => wide(indices),
            Property::ListUShort(indices) => wide(indices),
            Property::ListInt(indices) => wide(indices),
            Property::ListUInt(indices) => wide(indices),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// What does not matter here.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    fn read_text(text: &str) -> Result<(Scene, ImportReport), ImportError> {
        read("model.ply", text.as_bytes(), &Settings::default().proxy, None)
    }

    /// Two tetrahedra 100 m apart, the faces of one given as quads are not there: triangles, colours and an edge list.
    fn tetrahedra() -> String {
        let mut text = String::from(
            "ply\nformat ascii 1.0\ncomment two\nelement vertex 8\nproperty float x\nproperty double y\nproperty float z\n\
             property uchar red\nelement face 8\nproperty list uchar int vertex_indices\nelement edge 1\nproperty int vertex1\nend_header\n",
        );
        for west in [0, 100] {
            text += &format!("{west} 0 7 255\n{} 0 7 0\n{west} 20 7 0\n{west} 0 27 9\n", west + 20);
        }
        for first in [0, 4] {
            for [a, b, c] in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]] {
                text += &format!("3 {} {} {}\n", a + first, b + first, c + first);
            }
        }
        text + "3\n"
    }

    #[test]
    fn bodies_are_structures_on_the_ground() {
        let (scene, report) = read_text(&tetrahedra()).unwrap();
        assert_eq!(report.format, Format::Ply);
        assert_eq!(scene.structures.len(), 2);
        assert!(scene.structures.iter().all(|s| (s.bounds().min.z, s.bounds().max.z) == (0.0, 20.0)));
        assert!(scene.find("body-2").is_some() && report.items.is_empty(), "{:?}", report.items);
    }

    #[test]
    fn binary_files_say_the_same() {
        let mut bytes =
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
            element face 4\nproperty list uchar uint vertex_index\nend_header\n"
                .to_vec();
        for corner in [[0.0f32, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 20.0]] {
            corner.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        }
        for face in [[0u32, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]] {
            bytes.push(3);
            face.iter().for_each(|index| bytes.extend(index.to_le_bytes()));
        }
        let proxy = &Settings::default().proxy;
        let (scene, _) = read("model.ply", &bytes, proxy, None).unwrap();
        assert_eq!((scene.structures.len(), scene.bounds().unwrap().max.z), (1, 20.0));
        for cut in 0..bytes.len() {
            assert!(read("model.ply", &bytes[..cut], proxy, None).is_err(), "{cut} bytes");
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        let text = tetrahedra();
        for (from, to, word) in [
            ("3 0 2 1", "3 0 2 99", "vertex 99"),
            ("3 0 2 1", "3 0 -2 1", "vertex -2"),
            ("3 0 2 1", "3 0 2", "Line"),
            ("element vertex 8", "element vertex 4000000000", "4000000000"),
            ("property int vertex1\n", "", "more than the file can hold"),
            ("element face 8", "element facet 8", "no faces"),
            ("end_header", "", "Line 13"),
        ] {
            let error = read_text(&text.replacen(from, to, 1)).expect_err(to).to_string();
            assert!(error.starts_with("model.ply: ") && error.contains(word), "{to}: {error}");
        }
    }
}
