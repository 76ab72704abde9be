//! From the bytes of a scene file to a scene, whatever the format.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use geo::{Area, BooleanOps, CoordsIter};
use nalgebra::Point3;
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::anchor::Anchor;
use super::bounds::Bounds;
use super::file_name::stem;
use super::json::Scalar;
use super::proxy::{NoFlyZone, Scene, Shape, Structure};
use super::raster::Source;
use super::report::{ImportReport, Place};
use super::{cityjson, geojson, gltf_file, obj, osm_pbf, ply, raster, stl};
use crate::frame::LocalFrame;
use crate::settings::ProxySettings;

/// What is read, as errors tell it.
pub const KNOWN_FORMATS: &str = "GeoJSON footprints with heights, OpenStreetMap PBF, CityJSON, CityJSON sequences, \
                                 meshes as OBJ, PLY, STL and glTF (.glb), GeoTIFF surface models, LAS and LAZ point clouds";

/// Why a file is no scene. Nothing has been loaded.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    #[error("{file}: the file is empty; give a scene file: {KNOWN}", KNOWN = KNOWN_FORMATS)]
    EmptyFile { file: String },
    #[error("{file}: this is {found}, which is not read; convert it to one of {KNOWN}", KNOWN = KNOWN_FORMATS)]
    UnknownFormat { file: String, found: String },
    #[error("{file}: the JSON is damaged at line {}, column {}: {source}; it may be cut off: fetch or export it again", .source.line(), .source.column())]
    Json { file: String, source: serde_json::Error },
    #[error("{file}: {what}; {remedy}")]
    Structure { file: String, what: String, remedy: &'static str },
    #[error(
        "{file}: it has {features} features, more than the {most} that are read; cut out the part that is to be flown, for example with \
         `ogr2ogr -spat west south east north out.geojson in.geojson`"
    )]
    TooManyFeatures { file: String, features: usize, most: usize },
    #[error(
        "{file}: feature {index} ({name:?}) has the value {value} in its property `overfly`, which is not known; the known value is \
         \"no-fly\": correct it, or remove the property"
    )]
    UnknownMark { file: String, index: usize, name: String, value: String },
    #[error("{file}: the no-fly zone {name:?} ({place}) {problem}, so it cannot be barred as it is given; {remedy}")]
    Zone { file: String, place: Place, name: String, problem: String, remedy: &'static str },
    #[error(
        "{file}: none of its {objects} features or objects is a usable structure{first}; export buildings as polygons or solids"
    )]
    NoStructures { file: String, objects: usize, first: String },
    #[error(
        "{file}: not one of its {structures} structures has a height; add a property `height` (metres) or `building:levels` to the features, or let all have one height with \
         `--missing-heights constant --default-height METRES`"
    )]
    NoHeights { file: String, structures: usize },
    #[error(
        "{file}: latitude and longitude are exchanged (for example [{}, {}]); GeoJSON wants [longitude, latitude]: swap them and load again",
        .example[0], .example[1]
    )]
    SwappedCoordinates { file: String, example: [f64; 2] },
    #[error(
        "{file}: the coordinates are no degrees (for example [{}, {}]{declared}); GeoJSON wants WGS84 longitude and latitude: reproject it, \
         for example with `ogr2ogr -t_srs EPSG:4326 out.geojson in.geojson`",
        .example[0], .example[1]
    )]
    Projected { file: String, example: [f64; 2], declared: String },
    #[error(
        "{file}: its coordinates are degrees (EPSG:{epsg}); CityJSON and meshes are read in metres: reproject it, for example with `cjio in.json crs_reproject`"
    )]
    Geographic { file: String, epsg: u32 },
    #[error(
        "{file}: coordinates like ({}, {}) cannot be brought from EPSG:{epsg} to WGS84; give the code of the projected reference system that they are in",
        .example[0], .example[1]
    )]
    UnknownGrid { file: String, epsg: u32, example: [f64; 2] },
    #[error(
        "{file}: object {object:?} refers to vertex {index}, but there are only {vertices}; the file is damaged or was cropped wrongly: export it again"
    )]
    VertexIndex { file: String, object: String, index: String, vertices: usize },
    #[error("{file}: the mesh is damaged or of a kind that is not read: {what}; export it again")]
    Mesh { file: String, what: String },
    #[error(
        "{file}: the OpenStreetMap extract is damaged: {what}; it may be cut off: fetch or cut it out again, for example with `osmium extract`"
    )]
    Pbf { file: String, what: String },
    #[error("{file}: the file contradicts itself, so that it cannot be decoded; it is damaged: fetch or export it again")]
    Undecodable { file: String },
    #[error("{file}: line {line}: {what}; correct the line or export the file again")]
    Line { file: String, line: usize, what: String },
    #[error(
        "{file}: this cannot be put into the frame of the loaded scene: {what}; give a newer version of the file that the scene was loaded from, or load \
         this one anew with `overfly load`"
    )]
    Anchor { file: String, what: String },
    #[error("{file}: the coordinates are absurd or not finite ({what}); check the export's units and origin")]
    Coordinates { file: String, what: String },
}

/// Reads a scene. The format follows from the content, then from the ending of `file_name`; the scene is named after the file.
/// `bytes` may hold anything.
pub fn read(file_name: &str, bytes: &[u8], settings: &ProxySettings) -> Result<(Scene, ImportReport), ImportError> {
    read_format(file_name, bytes, None, settings, None)
}

/// Whether a file is a point cloud, by its first bytes: one that is read with [`read_cloud`] needs no memory for what it holds.
pub fn is_cloud(first: &[u8]) -> bool {
    first.starts_with(b"LASF")
}

/// Reads a point cloud from where it lies; in the frame of a scene that was read before where an anchor is given.
pub fn read_cloud(
    file_name: &str,
    source: &mut dyn Source,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let read = guarded(file_name, || raster::read_cloud(file_name, source, settings, anchor))?;
    if anchor.is_some() { near(file_name, read, settings) } else { Ok(read) }
}

/// A model of the ground (DTM) that belongs to a surface model (DSM), both GeoTIFF.
#[derive(Clone, Copy, Debug)]
pub struct GroundFile<'f> {
    pub file_name: &'f str,
    pub bytes: &'f [u8],
    /// It was not named, but stands beside the surface model.
    pub is_found: bool,
}

/// Reads a surface model over a model of the ground; in the frame of a scene that was read before where an anchor is given. Other formats have their
/// ground in themselves and are refused with one.
pub fn read_over_ground(
    file_name: &str,
    bytes: &[u8],
    ground: &GroundFile,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let read = read_format(file_name, bytes, Some(ground), settings, anchor)?;
    if anchor.is_some() { near(file_name, read, settings) } else { Ok(read) }
}

/// The same in the frame of a scene that was read before with this anchor (`ImportReport::anchor`): what both files have in common is the same, bit for
/// bit. A file that cannot be put there is refused.
pub fn read_anchored(
    file_name: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: &Anchor,
) -> Result<(Scene, ImportReport), ImportError> {
    near(file_name, read_format(file_name, bytes, None, settings, Some(anchor))?, settings)
}

/// What was read into the frame of another scene, unless it lies too far away.
fn near(
    file_name: &str,
    (scene, report): (Scene, ImportReport),
    settings: &ProxySettings,
) -> Result<(Scene, ImportReport), ImportError> {
    let middle = scene.bounds().map_or(Point3::origin(), |bounds| nalgebra::center(&bounds.min, &bounds.max));
    let distance_m = libm::hypot(middle.x, middle.y);
    if distance_m > settings.max_extent_m {
        let what = format!("its structures lie {:.0} km away", distance_m / 1000.0);
        return Err(ImportError::Anchor { file: file_name.into(), what });
    }
    Ok((scene, report))
}

fn read_format(
    file_name: &str,
    bytes: &[u8],
    ground: Option<&GroundFile>,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let file = file_name.to_owned();
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let Some(first) = bytes.iter().find(|byte| !byte.is_ascii_whitespace()) else {
        return Err(ImportError::EmptyFile { file });
    };
    if is_tiff(bytes) {
        return guarded(file_name, || raster::read_tiff(file_name, bytes, ground, settings, anchor));
    }
    if let Some(ground) = ground {
        let what =
            format!("a model of the ground ({}) is given to a file that is no surface model in a GeoTIFF", ground.file_name);
        return Err(ImportError::Structure { file, what, remedy: "leave it out" });
    }
    if is_cloud(bytes) {
        return guarded(file_name, || raster::read_cloud(file_name, &mut Cursor::new(bytes), settings, anchor));
    }
    if matches!(first, b'{' | b'[') {
        return match json_kind(file_name, bytes)? {
            JsonKind::Sequence => cityjson::sequence::read(file_name, bytes, settings, anchor),
            JsonKind::Gltf => guarded(file_name, || gltf_file::read(file_name, bytes, settings, anchor)),
            JsonKind::Typed(kind) if kind == "CityJSON" => cityjson::read(file_name, bytes, settings, anchor),
            JsonKind::Typed(kind) if kind == "CityJSONFeature" => {
                Err(ImportError::UnknownFormat { file, found: "a CityJSON sequence without its first line".into() })
            }
            JsonKind::Typed(_) => geojson::read(file_name, bytes, settings, anchor),
        };
    }
    let lower = file_name.to_lowercase();
    let reader: Option<Reader> = match () {
        () if bytes.starts_with(b"glTF") => Some(gltf_file::read),
        () if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") => Some(ply::read),
        () if osm_pbf::is_one(bytes) => Some(osm_pbf::read),
        () if stl::is_binary(bytes) || stl::is_ascii(bytes) => Some(stl::read),
        () => None,
    };
    if let Some(reader) = reader {
        return guarded(file_name, || reader(file_name, bytes, settings, anchor));
    }
    if let Some(found) = foreign_format(bytes) {
        return Err(ImportError::UnknownFormat { file, found: found.into() });
    }
    if lower.ends_with(".obj") || looks_like_obj(bytes) {
        return obj::read(file_name, bytes, settings, anchor);
    }
    if lower.ends_with(".stl") {
        return stl::read(file_name, bytes, settings, anchor);
    }
    if lower.ends_with("json") {
        json_kind(file_name, bytes)?;
    }
    Err(ImportError::UnknownFormat { file, found: "of no format that is known by its content".into() })
}

type Reader = fn(&str, &[u8], &ProxySettings, Option<&Anchor>) -> Result<(Scene, ImportReport), ImportError>;

/// Reads by a decoder that is not ours. Some panic on damaged files: that of OpenStreetMap extracts on an unknown kind of member, that of glTF on an accessor
/// that there is not.
fn guarded(
    file_name: &str,
    read: impl FnOnce() -> Result<(Scene, ImportReport), ImportError>,
) -> Result<(Scene, ImportReport), ImportError> {
    let read = catch_unwind(AssertUnwindSafe(read));
    read.unwrap_or_else(|_| Err(ImportError::Undecodable { file: file_name.into() }))
}

/// Puts the scene in order and completes the report.
pub(crate) fn assemble(
    file_name: &str,
    frame: LocalFrame,
    structures: Vec<Structure>,
    zones: Vec<NoFlyZone>,
    mut report: ImportReport,
) -> (Scene, ImportReport) {
    count_overlaps(&structures, &mut report);
    let mut structures: Vec<Arc<Structure>> = structures.into_iter().map(Arc::new).collect();
    structures.sort_by_key(|structure| structure.id);
    let scene = Scene { name: stem(file_name), frame, structures, zones };
    report.structures = scene.structures.iter().filter(|structure| structure.terrain().is_none()).count();
    report.zones = scene.zones.len();
    if let Some(bounds) = scene.bounds() {
        report.extent_m = [bounds.max.x - bounds.min.x, bounds.max.y - bounds.min.y];
        report.tallest_m = bounds.max.z;
    }
    (scene, report)
}

/// What a JSON file is.
enum JsonKind {
    /// By its member `type`.
    Typed(String),
    Gltf,
    /// Several values one after the other, the first a CityJSON object.
    Sequence,
}

/// What a JSON file is, which is parsed to its end, or, of a sequence, to the end of its first value.
fn json_kind(file_name: &str, bytes: &[u8]) -> Result<JsonKind, ImportError> {
    #[derive(Deserialize)]
    struct Probe {
        #[serde(rename = "type", default)]
        kind: Scalar,
        asset: Option<IgnoredAny>,
    }
    let damaged = |source| ImportError::Json { file: file_name.into(), source };
    if bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'[') {
        // Parsed for the sake of a precise message when the file is cut off.
        let _: IgnoredAny = serde_json::from_slice(bytes).map_err(damaged)?;
        return Err(ImportError::UnknownFormat { file: file_name.into(), found: "a bare JSON list".into() });
    }
    let kind_of = |probe: &Probe| probe.kind.text().unwrap_or_default().to_owned();
    match serde_json::from_slice::<Probe>(bytes) {
        Ok(probe) if probe.asset.is_some() && probe.kind.text().is_none() => Ok(JsonKind::Gltf),
        Ok(probe) => Ok(JsonKind::Typed(kind_of(&probe))),
        Err(source) if source.is_syntax() && source.to_string().starts_with("trailing characters") => {
            match serde_json::Deserializer::from_slice(bytes).into_iter::<Probe>().next() {
                Some(Ok(probe)) if kind_of(&probe) == "CityJSON" => Ok(JsonKind::Sequence),
                Some(Ok(probe)) if kind_of(&probe) == "CityJSONFeature" => Ok(JsonKind::Typed(kind_of(&probe))),
                _ => Err(ImportError::UnknownFormat {
                    file: file_name.into(),
                    found: "several JSON values in one file (a sequence)".into(),
                }),
            }
        }
        Err(source) => Err(damaged(source)),
    }
}

fn foreign_format(bytes: &[u8]) -> Option<&'static str> {
    const MAGIC: [(&[u8], &str); 3] =
        [(b"PK\x03\x04", "a zip archive"), (b"\x1f\x8b", "gzip-compressed"), (b"<", "XML (CityGML, KML or Collada)")];
    MAGIC.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, name)| *name)
}

/// TIFF and BigTIFF, in both orders of bytes.
fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| bytes.starts_with(*magic))
}

fn looks_like_obj(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(65_536)];
    head.split(|&byte| byte == b'\n').any(|line| line.starts_with(b"v ") || line.starts_with(b"f "))
}

/// Overlaps below this are rounding between neighbours, m^2 and m.
const LEAST_OVERLAP_M2: f64 = 0.5;
const LEAST_OVERLAP_M: f64 = 0.1;

/// The search for overlaps ends after this much work, counted in products of corners; real scenes of thousands of structures
/// stay far below.
const MOST_WORK: usize = 100_000_000;

/// Counts pairs of prisms whose solids overlap. Meshes are left out: their shared walls cannot be told from overlaps.
fn count_overlaps(structures: &[Structure], report: &mut ImportReport) {
    let prisms = structures.iter().filter_map(|structure| match &structure.shape {
        Shape::Prism { footprint, .. } => Some((structure.bounds(), structure.name.as_str(), footprint)),
        Shape::Mesh { .. } | Shape::Obstacle { .. } | Shape::Terrain(_) => None,
    });
    let mut prisms: Vec<_> = prisms.collect();
    prisms.sort_by(|a, b| a.0.min.x.total_cmp(&b.0.min.x));
    let mut work = 0;
    for (index, (bounds, name, footprint)) in prisms.iter().enumerate() {
        let near = prisms[index + 1..].iter().take_while(|(other, ..)| other.min.x < bounds.max.x);
        for (other_bounds, other_name, other) in near {
            work += 1;
            if boxes_overlap(bounds, other_bounds) {
                work += footprint.coords_count() * other.coords_count();
                if footprint.intersection(*other).unsigned_area() > LEAST_OVERLAP_M2 {
                    report.add_overlap(name, other_name);
                }
            }
            if work > MOST_WORK {
                report.notes.push("so many structures overlap that not all pairs were counted".into());
                return;
            }
        }
    }
}

fn boxes_overlap(a: &Bounds, b: &Bounds) -> bool {
    let depth = |axis: usize| a.max[axis].min(b.max[axis]) - a.min[axis].max(b.min[axis]);
    depth(0) > 0.0 && depth(1) > 0.0 && depth(0) * depth(1) > LEAST_OVERLAP_M2 && depth(2) > LEAST_OVERLAP_M
}
