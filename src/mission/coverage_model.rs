//! The scene's surface with what a plan captures of it, as a small disc for each sample: for point cloud viewers (PLY) and 3D viewers (GLB).
//!
//! A disc has the area that its sample stands for. Its colour goes from red (nothing) over yellow (half of the threshold) to blue (captured); what no image sees is grey.

use nalgebra::{Point3, Vector3};
use serde_json::json;

use crate::quality::{Quality, Truth};

/// Corners of a disc.
const CORNERS: usize = 6;
const NEVER_SEEN: [u8; 3] = [128, 128, 128];
/// Discs of neighbouring samples do not overlap much.
const SHARE_OF_AREA: f64 = 0.8;

/// What is drawn of one sample.
struct Disc {
    centre: Point3<f64>,
    normal: Vector3<f64>,
    radius_m: f64,
    colour: [u8; 3],
    /// r of Eq. 1 and the threshold that captured samples exceed, percent.
    r_percent: f64,
    is_captured: bool,
    views: u32,
}

fn discs(truth: &Truth, quality: &Quality) -> Vec<Disc> {
    let disc = |(index, sample): (usize, &crate::quality::TruthSample)| {
        let seen = &quality.samples[index];
        let r_percent = seen.covered.reconstructability_percent();
        let is_captured = quality.is_captured(index);
        let share = if is_captured { 1.0 } else { r_percent / quality.threshold_percent.max(1e-9) };
        Disc {
            centre: sample.frame.position,
            normal: sample.frame.normal,
            radius_m: (SHARE_OF_AREA * sample.area_mm2 as f64 * 1e-6 / std::f64::consts::PI).sqrt(),
            colour: if seen.views == 0 { NEVER_SEEN } else { colour(share, is_captured) },
            r_percent,
            is_captured,
            views: seen.views,
        }
    };
    truth.samples().iter().enumerate().map(disc).collect()
}

/// Red, orange, yellow up to the threshold; blue beyond.
fn colour(share: f64, is_captured: bool) -> [u8; 3] {
    if is_captured {
        return [38, 115, 178];
    }
    let share = share.clamp(0.0, 1.0);
    [215, (48.0 + 177.0 * share).round() as u8, (39.0 + 30.0 * share).round() as u8]
}

/// Binary PLY, little-endian: a point for each sample in the local frame, with normal, colour, r, whether it is captured, and how many images see it.
pub fn ply(truth: &Truth, quality: &Quality) -> Vec<u8> {
    let discs = discs(truth, quality);
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment overfly: metres east, north, up; r_percent exceeds {:.3} where captured\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float r_percent\nproperty uchar captured\nproperty uint views\n\
         end_header\n",
        quality.threshold_percent,
        discs.len()
    )
    .into_bytes();
    for disc in &discs {
        let numbers = disc.centre.coords.iter().chain(disc.normal.iter());
        numbers.for_each(|value| bytes.extend((*value as f32).to_le_bytes()));
        bytes.extend(disc.colour);
        bytes.extend((disc.r_percent as f32).to_le_bytes());
        bytes.push(u8::from(disc.is_captured));
        bytes.extend(disc.views.to_le_bytes());
    }
    bytes
}

/// Binary glTF 2.0: y is up and z south, as glTF has it; one mesh with the discs as triangles.
pub fn glb(truth: &Truth, quality: &Quality) -> Vec<u8> {
    let discs = discs(truth, quality);
    let (mut positions, mut normals, mut colours, mut indices) = (Vec::new(), Vec::new(), Vec::new(), Vec::<u32>::new());
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for disc in &discs {
        let first = (positions.len() / 3) as u32;
        let helper = if disc.normal.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
        let across = disc.normal.cross(&helper).normalize();
        let along = disc.normal.cross(&across);
        for corner in 0..CORNERS {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * corner as f64 / CORNERS as f64);
            // A little off the wall, so that a model of it in the same viewer does not shine through.
            let place = disc.centre + (across * cos + along * sin) * disc.radius_m + disc.normal * 0.02;
            let place = turned(&place.coords);
            for axis in 0..3 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
            positions.extend(place);
            normals.extend(turned(&disc.normal));
            colours.extend([disc.colour[0], disc.colour[1], disc.colour[2], 255]);
        }
        indices.extend((1..CORNERS as u32 - 1).flat_map(|k| [first, first + k, first + k + 1]));
    }
    let little = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let parts = [little(&positions), little(&normals), colours, indices.iter().flat_map(|index| index.to_le_bytes()).collect()];
    let (mut views, mut start) = (Vec::new(), 0);
    for (index, part) in parts.iter().enumerate() {
        let target = if index == 3 { 34_963 } else { 34_962 };
        views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": part.len(), "target": target }));
        start += part.len();
    }
    let corners = positions.len() / 3;
    let document = json!({
        "asset": { "version": "2.0", "generator": "overfly" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": truth.scene().name }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1, "COLOR_0": 2 }, "indices": 3, "material": 0 }] }],
        "materials": [{ "name": "captured share", "doubleSided": true, "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 } }],
        "buffers": [{ "byteLength": start }],
        "bufferViews": views,
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": corners, "type": "VEC3", "min": low, "max": high },
            { "bufferView": 1, "componentType": 5126, "count": corners, "type": "VEC3" },
            { "bufferView": 2, "componentType": 5121, "normalized": true, "count": corners, "type": "VEC4" },
            { "bufferView": 3, "componentType": 5125, "count": indices.len(), "type": "SCALAR" },
        ],
    });
    container(document.to_string().into_bytes(), parts.concat())
}

/// East, north, up in glTF's axes.
fn turned(vector: &Vector3<f64>) -> [f32; 3] {
    [vector.x as f32, vector.z as f32, -vector.y as f32]
}

/// The header and the two chunks, each padded to four bytes.
fn container(mut json: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut bytes = Vec::with_capacity(total);
    bytes.extend(b"glTF");
    for number in [2, total as u32, json.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}
