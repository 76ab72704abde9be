//! glTF 2.0 meshes: `.glb`, and `.gltf` with its buffers in the file; metres, y up as the format prescribes.
//!
//! Each node with a mesh is a structure, named after the node; where there is only one, each body of connected faces is. Materials and textures do
//! not matter here, so that none is missed.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer::Source;
use gltf::mesh::Mode;
use gltf::{Accessor, Gltf, Node, Primitive, Semantic};
use nalgebra::{Matrix4, Point3};

use super::anchor::Anchor;
use super::meshes::{self, MeshFile, RawMesh};
use super::names::tidy;
use super::proxy::{Scene, Triangle};
use super::read::ImportError;
use super::report::{Format, ImportReport, Place};
use crate::settings::{ProxySettings, UpAxis};

/// Nodes lie in each other no deeper than this; in a file that is wrong they may run in a circle.
const MOST_GENERATIONS: usize = 64;

/// A mesh may stand in many nodes: no more faces than this are read.
const MOST_FACES: usize = 20_000_000;

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let damaged = |what: String| ImportError::Mesh { file: file.into(), what };
    let found = Gltf::from_slice(bytes).map_err(|error| damaged(tidy(&error.to_string())))?;
    let buffers: Result<Vec<Vec<u8>>, String> = found.buffers().map(|buffer| bytes_of(&found, buffer.source())).collect();
    let buffers = buffers.map_err(damaged)?;
    let mut reader = NodeReader { buffers, parts: Vec::new(), faces: 0 };
    let scene = found.default_scene().or_else(|| found.scenes().next());
    let roots = scene.ok_or_else(|| damaged("it has no scene".into()))?;
    for node in roots.nodes() {
        reader.node(&node, &Matrix4::identity(), 0).map_err(damaged)?;
    }
    let NodeReader { parts, faces, .. } = reader;
    let meshes = match parts.len() {
        1 => {
            let place = &parts[0].place;
            meshes::by_body(parts[0].faces.iter().map(|face| (place.clone(), face.clone())))
        }
        _ => parts.into_iter().map(Part::whole).collect(),
    };
    meshes::scene_of(file, MeshFile { format: Format::Gltf, meshes, faces, up: UpAxis::Y }, settings, anchor)
}

/// The bytes of a buffer that lies in the file.
fn bytes_of(found: &Gltf, source: Source) -> Result<Vec<u8>, String> {
    match source {
        Source::Bin => found.blob.clone().ok_or_else(|| "its binary part is missing".to_owned()),
        Source::Uri(uri) => match uri.strip_prefix("data:").and_then(|data| data.split_once(";base64,")) {
            Some((_, data)) => STANDARD.decode(data).map_err(|error| format!("a buffer is no base64: {error}")),
            None => Err(format!("its data lies in another file ({:?}): export it as one `.glb` file", tidy(uri))),
        },
    }
}

/// The faces of one node.
struct Part {
    name: String,
    place: Place,
    faces: Vec<Option<Vec<Triangle>>>,
}

impl Part {
    fn whole(self) -> RawMesh {
        let mut mesh = RawMesh::empty(self.name, self.place);
        self.faces.into_iter().for_each(|face| mesh.add(face));
        mesh
    }
}

struct NodeReader {
    buffers: Vec<Vec<u8>>,
    parts: Vec<Part>,
    faces: usize,
}

impl NodeReader {
    fn node(&mut self, node: &Node, above: &Matrix4<f64>, generation: usize) -> Result<(), String> {
        if generation > MOST_GENERATIONS {
            return Err(format!("its nodes lie more than {MOST_GENERATIONS} deep in each other, or in a circle"));
        }
        let own = node.transform().matrix().map(|column| column.map(f64::from));
        let to_scene = above * Matrix4::from(own);
        if let Some(mesh) = node.mesh() {
            let name = [node.name(), mesh.name()].into_iter().flatten().map(tidy).find(|name| !name.is_empty());
            let name = name.unwrap_or_else(|| format!("node-{}", node.index()));
            let mut faces = Vec::new();
            for primitive in mesh.primitives() {
                self.primitive(&primitive, &to_scene, &mut faces).map_err(|what| format!("node {name:?}: {what}"))?;
            }
            self.parts.push(Part { place: Place::Object(name.clone()), name, faces });
        }
        node.children().try_for_each(|child| self.node(&child, &to_scene, generation + 1))
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        to_scene: &Matrix4<f64>,
        faces: &mut Vec<Option<Vec<Triangle>>>,
    ) -> Result<(), String> {
        let mode = primitive.mode();
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            // Points and lines have no surface.
            return Ok(());
        }
        let positions = primitive.get(&Semantic::Positions).ok_or("a surface without positions")?;
        let corners = self.positions(&positions, to_scene)?;
        let order: Vec<usize> = match primitive.indices() {
            Some(indices) => self.indices(&indices)?,
            None => (0..corners.len()).collect(),
        };
        if let Some(wrong) = order.iter().find(|&&index| index >= corners.len()) {
            return Err(format!("a face refers to vertex {wrong}, and there are {}", corners.len()));
        }
        let count = if mode == Mode::Triangles { order.len() / 3 } else { order.len().saturating_sub(2) };
        self.faces += count;
        if self.faces > MOST_FACES {
            return Err(format!("there are more than {MOST_FACES} faces; simplify the mesh"));
        }
        faces.extend((0..count).map(|k| {
            let [a, b, c] = match mode {
                Mode::TriangleFan => [0, k + 1, k + 2],
                Mode::TriangleStrip if k % 2 == 1 => [k + 1, k, k + 2],
                Mode::TriangleStrip => [k, k + 1, k + 2],
                _ => [3 * k, 3 * k + 1, 3 * k + 2],
            };
            meshes::face([a, b, c].map(|corner| corners[order[corner]]).to_vec())
        }));
        Ok(())
    }

    fn positions(&self, accessor: &Accessor, to_scene: &Matrix4<f64>) -> Result<Vec<Point3<f64>>, String> {
        if (accessor.data_type(), accessor.dimensions()) != (DataType::F32, Dimensions::Vec3) {
            return Err("positions that are not three floats each".to_owned());
        }
        let place = |bytes: &[u8]| {
            let [x, y, z] = std::array::from_fn(|axis| f64::from(f32::from_le_bytes(four(&bytes[4 * axis..]))));
            to_scene.transform_point(&Point3::new(x, y, z))
        };
        Ok(self.elements(accessor, 12)?.map(place).collect())
    }

    fn indices(&self, accessor: &Accessor) -> Result<Vec<usize>, String> {
        let size = match (accessor.data_type(), accessor.dimensions()) {
            (DataType::U8, Dimensions::Scalar) => 1,
            (DataType::U16, Dimensions::Scalar) => 2,
            (DataType::U32, Dimensions::Scalar) => 4,
            _ => return Err("indices that are no unsigned whole numbers".to_owned()),
        };
        let index = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte));
        Ok(self.elements(accessor, size)?.map(index).collect())
    }

    /// The elements of an accessor, `size` bytes each.
    fn elements(&self, accessor: &Accessor, size: usize) -> Result<impl Iterator<Item = &[u8]>, String> {
        let beyond = || "it refers to bytes beyond the end of its buffer".to_owned();
        let view = accessor.view().filter(|_| accessor.sparse().is_none());
        let view = view.ok_or("a sparse accessor, which is not read: export the mesh without")?;
        let buffer = self.buffers.get(view.buffer().index()).ok_or_else(beyond)?;
        let end = view.offset().checked_add(view.length()).ok_or_else(beyond)?;
        let bytes = buffer.get(view.offset()..end).and_then(|bytes| bytes.get(accessor.offset()..)).ok_or_else(beyond)?;
        let stride = view.stride().unwrap_or(size);
        let needed =
            accessor.count().checked_sub(1).map(|steps| steps.checked_mul(stride).and_then(|bytes| bytes.checked_add(size)));
        let is_inside = needed.is_none_or(|needed| needed.is_some_and(|needed| needed <= bytes.len()));
        if stride < size || !is_inside {
            return Err(beyond());
        }
        Ok((0..accessor.count()).map(move |k| &bytes[k * stride..k * stride + size]))
    }
}

/// The first four bytes.
fn four(bytes: &[u8]) -> [u8; 4] {
    std::array::from_fn(|k| bytes[k])
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::settings::Settings;

    /// A tetrahedron with its right angle at the origin, 20 long, y up: in two nodes, the second 100 m farther east.
    fn model() -> Value {
        let mut data: Vec<u8> = Vec::new();
        for corner in [[0.0f32, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 20.0]] {
            corner.iter().for_each(|value| data.extend(value.to_le_bytes()));
        }
        data.extend([0u8, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]);
        json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [
                { "name": "town", "children": [1, 2] },
                { "name": "hall", "mesh": 0 },
                { "mesh": 0, "translation": [100.0, 0.0, 0.0] },
            ],
            "meshes": [{ "name": "tower", "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4, "min": [0, 0, 0], "max": [20, 20, 20] },
                { "bufferView": 1, "componentType": 5121, "type": "SCALAR", "count": 12 },
            ],
            "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 12 }],
            "buffers": [{ "byteLength": 60, "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(data)) }],
        })
    }

    fn read_value(value: &Value) -> Result<(Scene, ImportReport), ImportError> {
        read("model.gltf", value.to_string().as_bytes(), &Settings::default().proxy, None)
    }

    #[test]
    fn nodes_are_structures_and_y_points_up() {
        let (scene, report) = read_value(&model()).unwrap();
        assert_eq!((scene.structures.len(), report.items.len()), (2, 0), "{:?}", report.items);
        let bounds = |name: &str| scene.structure(scene.find(name).unwrap()).unwrap().bounds();
        // What points to the viewer in the file points south here.
        assert_eq!((bounds("hall").min, bounds("hall").max), (Point3::new(0.0, -20.0, 0.0), Point3::new(20.0, 0.0, 20.0)));
        assert_eq!(bounds("tower").min.x, 100.0);
    }

    #[test]
    fn one_node_falls_into_its_bodies() {
        let mut value = model();
        value["nodes"] = json!([{ "name": "town", "mesh": 0 }]);
        value["scenes"][0]["nodes"] = json!([0]);
        assert!(read_value(&value).unwrap().0.find("body-1").is_some());
    }

    #[test]
    fn what_is_wrong_is_said() {
        type Change = fn(&mut Value);
        let cases: [(Change, &str); 10] = [
            (|v| v["buffers"][0]["uri"] = json!("town.bin"), "town.bin"),
            (|v| v["buffers"][0]["uri"] = json!("data:x;base64,***"), "base64"),
            (|v| v["accessors"][0]["count"] = json!(4_000_000_000u64), "beyond"),
            (|v| v["accessors"][1]["count"] = json!(13), "beyond"),
            (|v| v["bufferViews"][0]["byteStride"] = json!(4), "beyond"),
            (|v| v["bufferViews"][1]["byteOffset"] = json!(u64::MAX), "beyond"),
            (|v| v["accessors"][1]["componentType"] = json!(5123), "beyond"),
            (|v| v["nodes"][1]["children"] = json!([0]), "circle"),
            (|v| v["accessors"][0]["count"] = json!(3), "vertex 3"),
            (|v| v["scenes"] = json!([]), "scene"),
        ];
        for (change, word) in cases {
            let mut value = model();
            change(&mut value);
            let error = read_value(&value).expect_err(word).to_string();
            assert!(error.starts_with("model.gltf: ") && error.contains(word), "{word}: {error}");
        }
    }
}
