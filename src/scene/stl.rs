//! STL meshes, ASCII and binary, in metres, z up. An STL file has no names: each body of connected triangles is a structure.

use std::io::{Cursor, ErrorKind};

use nalgebra::Point3;

use super::anchor::Anchor;
use super::meshes::{self, MeshFile};
use super::names::tidy;
use super::proxy::Scene;
use super::read::ImportError;
use super::report::{Format, ImportReport, Place};
use crate::settings::{ProxySettings, UpAxis};

/// A binary file has a header of 80 bytes, the number of its triangles, and 50 bytes for each of them.
const HEADER_BYTES: usize = 84;
const TRIANGLE_BYTES: usize = 50;

/// Whether a file is a binary STL by its length. A file can only be told by that: the header may say anything.
pub(crate) fn is_binary(bytes: &[u8]) -> bool {
    let Some(&[a, b, c, d]) = bytes.get(HEADER_BYTES - 4..HEADER_BYTES) else { return false };
    let triangles = u32::from_le_bytes([a, b, c, d]) as usize;
    triangles > 0 && triangles.checked_mul(TRIANGLE_BYTES).is_some_and(|length| bytes.len() == HEADER_BYTES + length)
}

/// Whether a file begins as an ASCII STL does.
pub(crate) fn is_ascii(bytes: &[u8]) -> bool {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(1000)]).to_lowercase();
    let head = head.trim_start();
    head.starts_with("solid") && (head.contains("facet") || head.contains("endsolid"))
}

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let damaged = |face: usize, error: std::io::Error| {
        let why = if error.kind() == ErrorKind::UnexpectedEof { "it ends too soon".to_owned() } else { tidy(&error.to_string()) };
        ImportError::Mesh { file: file.into(), what: format!("at triangle {face}: {why}") }
    };
    let mut cursor = Cursor::new(bytes);
    let triangles = stl_io::create_stl_reader(&mut cursor).map_err(|error| damaged(0, error))?;
    let mut faces = Vec::new();
    for (number, triangle) in triangles.enumerate() {
        let triangle = triangle.map_err(|error| damaged(number, error))?;
        let corners = triangle.vertices.map(|vertex| Point3::from(vertex.0.map(f64::from)));
        faces.push((Place::Face(number), meshes::face(corners.to_vec())));
    }
    let count = faces.len();
    let meshes = meshes::by_body(faces.into_iter());
    meshes::scene_of(file, MeshFile { format: Format::Stl, meshes, faces: count, up: UpAxis::Z }, settings, anchor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 20.0]];
    const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

    fn ascii() -> String {
        let mut text = String::from("solid tetrahedron\n");
        for face in FACES {
            text += "facet normal 0 0 0\nouter loop\n";
            for [x, y, z] in face.map(|corner| CORNERS[corner]) {
                text += &format!("vertex {x} {y} {z}\n");
            }
            text += "endloop\nendfacet\n";
        }
        text + "endsolid tetrahedron\n"
    }

    /// Many exporters begin binary files with the word that ASCII files begin with.
    fn binary() -> Vec<u8> {
        let mut bytes = b"solid of an exporter".to_vec();
        bytes.resize(80, b' ');
        bytes.extend((FACES.len() as u32).to_le_bytes());
        for face in FACES {
            bytes.extend([0; 12]);
            face.iter().flat_map(|&corner| CORNERS[corner]).for_each(|value| bytes.extend(value.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    #[test]
    fn both_kinds_say_the_same() {
        let proxy = &Settings::default().proxy;
        assert!(is_ascii(ascii().as_bytes()) && !is_binary(ascii().as_bytes()));
        assert!(is_binary(&binary()));
        let (one, report) = read("model.stl", ascii().as_bytes(), proxy, None).unwrap();
        let (other, _) = read("model.stl", &binary(), proxy, None).unwrap();
        assert_eq!(one, other);
        assert_eq!((one.structures.len(), one.bounds().unwrap().max.z, report.items.len()), (1, 20.0, 0));
    }

    #[test]
    fn what_is_cut_off_is_refused() {
        let proxy = &Settings::default().proxy;
        let bytes = binary();
        for cut in [0, 40, 84, 85, 133, bytes.len() - 1] {
            assert!(read("model.stl", &bytes[..cut], proxy, None).is_err(), "{cut} bytes");
        }
        let error = read("model.stl", ascii().replacen("vertex 20", "vertex x", 1).as_bytes(), proxy, None).unwrap_err();
        assert!(error.to_string().starts_with("model.stl: ") && error.to_string().contains("triangle"), "{error}");
    }

    #[test]
    fn units_axes_and_offsets_are_as_they_are_said() {
        let mut proxy = Settings::default().proxy;
        (proxy.unit_m, proxy.up, proxy.offset_m) = (0.5, UpAxis::Y, [5.0, 0.0, 0.0]);
        let (scene, _) = read("model.stl", &binary(), &proxy, None).unwrap();
        let bounds = scene.bounds().unwrap();
        // y becomes up, z becomes south.
        assert_eq!((bounds.min, bounds.max), (Point3::new(5.0, -10.0, 0.0), Point3::new(15.0, 0.0, 10.0)));
    }
}
