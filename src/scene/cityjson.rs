//! CityJSON 1.0, 1.1 and 2.0, and sequences of CityJSON features: buildings, bridges and other constructions at their highest level of
//! detail, or the highest that is wanted.
//!
//! A Building with its parts and installations is one structure, named by the Building. Only the outer shell of a solid is taken.
//! Walls that the file leaves out between terraced houses are filled in, so that a house has an inside. The ground plane is the
//! median of the structures' lowest points. Where the reference system is known, the grid is turned to true north and scaled to
//! true metres, so that the local frame is east-north-up at the middle of the scene.

use std::collections::BTreeMap;

use nalgebra::Point3;
use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use super::anchor::Anchor;
use super::close;
use super::crs;
use super::faces;
use super::json::{Intake, Into, Scalar};
use super::meshes::{self, RawMesh};
use super::names::tidy;
use super::proxy::Scene;
use super::read::{ImportError, assemble};
use super::report::{Format, ImportReport, ItemKind, Place};
use crate::frame::LocalFrame;
use crate::settings::ProxySettings;

/// The types that become structures or parts of one.
const TAKEN: [&str; 10] = [
    "Building",
    "BuildingPart",
    "BuildingInstallation",
    "BuildingConstructiveElement",
    "Bridge",
    "BridgePart",
    "BridgeInstallation",
    "BridgeConstructiveElement",
    "BridgeConstructionElement",
    "OtherConstruction",
];

/// Longer chains of parents are no building and its parts.
const MOST_GENERATIONS: usize = 16;

#[derive(Default, Deserialize)]
struct CityModel {
    #[serde(default)]
    version: Scalar,
    #[serde(default)]
    metadata: Metadata,
    transform: Option<Transform>,
    #[serde(rename = "CityObjects", default)]
    objects: BTreeMap<String, CityObject>,
    #[serde(default)]
    vertices: Vec<[f64; 3]>,
}

#[derive(Default)]
struct Metadata {
    reference_system: Scalar,
}

#[derive(Deserialize)]
struct Transform {
    scale: [f64; 3],
    translate: [f64; 3],
}

#[derive(Deserialize)]
struct CityObject {
    #[serde(rename = "type", default)]
    kind: String,
    #[serde(default)]
    geometry: Geometries,
    parents: Option<Vec<String>>,
}

/// The geometries of an object that name their level of detail; the others are never used.
#[derive(Default)]
struct Geometries(Vec<CityGeometry>);

struct CityGeometry {
    kind: String,
    level: f64,
    boundaries: Boundaries,
}

/// Nested lists of vertex indices.
#[derive(Default)]
struct Boundaries {
    root: Lists,
    /// The first thing that is neither a list nor an index.
    bad: Option<String>,
}

enum Lists {
    Ring(Vec<u32>),
    Nested(Vec<Lists>),
}

impl CityModel {
    /// Takes over a feature of the same sequence. Two of one key are one object, the later one's.
    fn append(&mut self, feature: Self) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(feature.vertices);
        for (key, mut object) in feature.objects {
            object.geometry.0.iter_mut().for_each(|geometry| geometry.boundaries.root.renumber(first));
            self.objects.insert(key, object);
        }
    }
}

impl Default for Lists {
    fn default() -> Self {
        Self::Nested(Vec::new())
    }
}

impl Lists {
    /// Counts the vertices from `first` on. What lies beyond all numbers stays beyond all vertices.
    fn renumber(&mut self, first: u32) {
        match self {
            Self::Ring(ring) => ring.iter_mut().for_each(|index| *index = index.saturating_add(first)),
            Self::Nested(parts) => parts.iter_mut().for_each(|part| part.renumber(first)),
        }
    }

    fn parts(&self) -> &[Lists] {
        match self {
            Self::Ring(_) => &[],
            Self::Nested(parts) => parts,
        }
    }
}

impl<'de> Deserialize<'de> for Metadata {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        read_into(deserializer)
    }
}

impl<'de> Deserialize<'de> for Geometries {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        read_into(deserializer)
    }
}

fn read_into<'de, T: Intake + Default, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    let mut value = T::default();
    Into(&mut value).deserialize(deserializer)?;
    Ok(value)
}

impl Intake for Metadata {
    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        match key {
            "referenceSystem" => self.reference_system = members.next_value()?,
            _ => drop(members.next_value::<IgnoredAny>()?),
        }
        Ok(())
    }
}

impl Intake for Geometries {
    fn element<'de, A: SeqAccess<'de>>(&mut self, list: &mut A) -> Result<bool, A::Error> {
        let mut geometry = GeometryReader::default();
        let more = list.next_element_seed(Into(&mut geometry))?.is_some();
        let GeometryReader { kind, level, boundaries } = geometry;
        self.0.extend(level.map(|level| CityGeometry { kind, level, boundaries }));
        Ok(more)
    }
}

#[derive(Default)]
struct GeometryReader {
    kind: String,
    level: Option<f64>,
    boundaries: Boundaries,
}

impl Intake for GeometryReader {
    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        match key {
            "type" => self.kind = members.next_value::<Scalar>()?.text().map(tidy).unwrap_or_default(),
            "lod" => self.level = level(&members.next_value::<Scalar>()?.0),
            "boundaries" => {
                self.boundaries = Boundaries::default();
                let Boundaries { root, bad } = &mut self.boundaries;
                members.next_value_seed(Into(&mut ListReader { lists: root, bad, number: None }))?;
            }
            _ => drop(members.next_value::<IgnoredAny>()?),
        }
        Ok(())
    }
}

/// A list of lists or of indices while it is read.
struct ListReader<'a> {
    lists: &'a mut Lists,
    bad: &'a mut Option<String>,
    number: Option<f64>,
}

impl Intake for ListReader<'_> {
    fn number(&mut self, number: f64) {
        self.number = Some(number);
    }

    fn element<'de, A: SeqAccess<'de>>(&mut self, list: &mut A) -> Result<bool, A::Error> {
        let mut lists = Lists::default();
        let mut element = ListReader { lists: &mut lists, bad: self.bad, number: None };
        if list.next_element_seed(Into(&mut element))?.is_none() {
            return Ok(false);
        }
        let number = element.number;
        let index = number.filter(|number| number.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(number));
        match (&mut *self.lists, number, index) {
            (Lists::Ring(ring), _, Some(index)) => ring.push(index as u32),
            (Lists::Nested(parts), _, Some(index)) if parts.is_empty() => *self.lists = Lists::Ring(vec![index as u32]),
            (Lists::Nested(parts), None, None) => parts.push(lists),
            (_, Some(number), _) => *self.bad = self.bad.take().or(Some(number.to_string())),
            (_, None, _) => *self.bad = self.bad.take().or(Some("a list".into())),
        }
        Ok(true)
    }
}

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let model: CityModel = serde_json::from_slice(bytes).map_err(|source| ImportError::Json { file: file.into(), source })?;
    scene_of(file, &model, Format::CityJson, settings, anchor)
}

/// A CityJSON sequence: a line with the transform and the reference system, then a line for each feature, with vertices of its own.
pub(crate) fn read_sequence(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let damaged = |source| ImportError::Json { file: file.into(), source };
    let mut lines = serde_json::Deserializer::from_slice(bytes).into_iter::<CityModel>();
    let mut whole = lines.next().transpose().map_err(damaged)?.unwrap_or_default();
    for feature in lines {
        whole.append(feature.map_err(damaged)?);
    }
    scene_of(file, &whole, Format::CityJsonSeq, settings, anchor)
}

fn scene_of(
    file: &str,
    model: &CityModel,
    format: Format,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let mut report = ImportReport::new(format);
    note_version(model, &mut report);
    let vertices = vertices(model);
    let mut meshes = Vec::new();
    for (root, members) in families(model, &mut report) {
        meshes.push(mesh(file, root, &members, &vertices, settings.lod, &mut report)?);
    }
    let objects = model.objects.len();
    if !meshes.is_empty() && !vertices.iter().any(|vertex| vertex.iter().all(|metres| metres.is_finite())) {
        return Err(ImportError::Coordinates { file: file.into(), what: "no vertex is finite".into() });
    }
    meshes::drop_strays(&mut meshes, settings.max_extent_m, &mut report);
    let frame = to_local(file, model, &mut meshes, settings, anchor, &mut report)?;
    for mesh in &mut meshes {
        let walls = close::close_walls(&mut mesh.triangles);
        if walls > 0 {
            report.add(&mesh.name, mesh.place.clone(), ItemKind::WallsClosed, format!("{walls} missing walls filled in"));
        }
    }
    let structures = meshes::structures(meshes, &mut report);
    if structures.is_empty() {
        return Err(ImportError::NoStructures { file: file.into(), objects, first: report.first_item() });
    }
    Ok(assemble(file, frame, structures, Vec::new(), report))
}

fn note_version(model: &CityModel, report: &mut ImportReport) {
    let version = model.version.text().unwrap_or("(none)");
    if !["1.0", "1.1", "2.0"].iter().any(|known| version.starts_with(known)) {
        report.notes.push(format!("CityJSON version {:?} is not known: read as 2.0", tidy(version)));
    }
}

fn vertices(model: &CityModel) -> Vec<Point3<f64>> {
    let place = |vertex: &[f64; 3]| match &model.transform {
        Some(Transform { scale, translate }) => Point3::from([0, 1, 2].map(|axis| vertex[axis] * scale[axis] + translate[axis])),
        None => Point3::from(*vertex),
    };
    model.vertices.iter().map(place).collect()
}

/// The taken objects with their descendants, by key; the others are counted.
fn families<'a>(model: &'a CityModel, report: &mut ImportReport) -> BTreeMap<&'a str, Vec<(&'a str, &'a CityObject)>> {
    let mut families: BTreeMap<&str, Vec<(&str, &CityObject)>> = BTreeMap::new();
    for (key, object) in &model.objects {
        if TAKEN.contains(&object.kind.as_str()) {
            families.entry(ancestor(model, key, object)).or_default().push((key, object));
        } else {
            report.ignore(tidy(&object.kind));
        }
    }
    families
}

/// The topmost taken object above an object. Where parents run in a circle it is the first of the circle by key.
fn ancestor<'a>(model: &'a CityModel, key: &'a str, object: &'a CityObject) -> &'a str {
    let mut line = vec![key];
    let mut object = object;
    loop {
        let known = object.parents.iter().flatten().filter_map(|parent| model.objects.get_key_value(parent));
        let Some((parent_key, parent)) = known.into_iter().find(|(_, parent)| TAKEN.contains(&parent.kind.as_str())) else {
            return line[line.len() - 1];
        };
        if let Some(start) = line.iter().position(|seen| seen == parent_key) {
            return line[start..].iter().min().copied().unwrap_or(key);
        }
        if line.len() == MOST_GENERATIONS {
            return key;
        }
        line.push(parent_key);
        object = parent;
    }
}

fn mesh(
    file: &str,
    root: &str,
    members: &[(&str, &CityObject)],
    vertices: &[Point3<f64>],
    most_detail: f64,
    report: &mut ImportReport,
) -> Result<RawMesh, ImportError> {
    let mut mesh = RawMesh { name: tidy(root), place: Place::Object(tidy(root)), triangles: Vec::new(), degenerate: 0 };
    let detail = |object: &CityObject| detail(object, most_detail);
    let parts_detail = members.iter().filter(|(key, _)| *key != root).map(|(_, object)| detail(object)).fold(0.0, f64::max);
    for (key, object) in members {
        let own = detail(object);
        // A coarse hull of the whole would swallow its finer parts.
        if *key == root && own < parts_detail {
            continue;
        }
        for geometry in object.geometry.0.iter().filter(|geometry| own > 0.0 && geometry.level == own) {
            if let Some(bad) = &geometry.boundaries.bad {
                return Err(no_vertex(file, key, bad, vertices));
            }
            let mut surfaces = Vec::new();
            if !gather(&geometry.kind, &geometry.boundaries.root, &mut surfaces) {
                let done = format!("a geometry of type {:?} is not read", tidy(&geometry.kind));
                report.add(&mesh.name, Place::Object(tidy(key)), ItemKind::PartsDropped, done);
            }
            for surface in surfaces {
                add_surface(file, key, surface, vertices, &mut mesh)?;
            }
        }
    }
    Ok(mesh)
}

/// The level of detail at which an object is read: the highest that is wanted (0: that there is), else the lowest with a volume; 0 where there is none.
fn detail(object: &CityObject, most: f64) -> f64 {
    let levels = || object.geometry.0.iter().map(|geometry| geometry.level).filter(|level| *level >= 1.0);
    let wanted = levels().filter(|level| most == 0.0 || *level <= most).fold(0.0, f64::max);
    if wanted > 0.0 { wanted } else { levels().reduce(f64::min).unwrap_or(0.0) }
}

/// The level of detail as a number: 2, "2" and "2.2" occur.
fn level(lod: &Value) -> Option<f64> {
    let level = match lod {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().parse().ok(),
        _ => None,
    };
    level.filter(|level: &f64| level.is_finite())
}

/// Collects the surfaces (lists of rings) of a geometry; says whether its type is one that has them.
fn gather<'a>(kind: &str, boundaries: &'a Lists, surfaces: &mut Vec<&'a [Lists]>) -> bool {
    let parts = boundaries.parts();
    match kind {
        "MultiSurface" | "CompositeSurface" => surfaces.extend(parts.iter().map(Lists::parts)),
        "Solid" => surfaces.extend(parts.first().into_iter().flat_map(Lists::parts).map(Lists::parts)),
        "MultiSolid" | "CompositeSolid" => return parts.iter().all(|solid| gather("Solid", solid, surfaces)),
        _ => return false,
    }
    true
}

fn add_surface(
    file: &str,
    object: &str,
    surface: &[Lists],
    vertices: &[Point3<f64>],
    mesh: &mut RawMesh,
) -> Result<(), ImportError> {
    let mut rings = Vec::with_capacity(surface.len());
    for ring in surface {
        let indices: &[u32] = if let Lists::Ring(indices) = ring { indices } else { &[] };
        let vertex = |index: &u32| {
            let vertex = vertices.get(*index as usize).copied();
            vertex.ok_or_else(|| no_vertex(file, object, &index.to_string(), vertices))
        };
        rings.push(indices.iter().map(vertex).collect::<Result<Vec<_>, _>>()?);
    }
    match faces::triangulate(&rings) {
        Some(triangles) => mesh.triangles.extend(triangles),
        None => mesh.degenerate += 1,
    }
    Ok(())
}

fn no_vertex(file: &str, object: &str, index: &str, vertices: &[Point3<f64>]) -> ImportError {
    ImportError::VertexIndex { file: file.into(), object: tidy(object), index: index.into(), vertices: vertices.len() }
}

/// Moves the meshes to the local frame: the middle of their box, or the anchor, becomes the origin, the ground z = 0.
fn to_local(
    file: &str,
    model: &CityModel,
    meshes: &mut [RawMesh],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
    report: &mut ImportReport,
) -> Result<LocalFrame, ImportError> {
    let Some(bounds) = meshes::bounds(meshes) else { return Ok(LocalFrame::default()) };
    let named = crs::epsg_code(&model.metadata.reference_system.0);
    report.epsg = if settings.epsg == 0 { named } else { Some(settings.epsg) };
    let origin = match anchor {
        Some(anchor) => Point3::from(anchor.grid(file, report.epsg)?),
        None => {
            let middle = nalgebra::center(&bounds.min, &bounds.max);
            Point3::new(middle.x, middle.y, meshes::ground(meshes))
        }
    };
    meshes::to_frame(file, meshes, report.epsg, origin, settings, report)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::settings::Settings;

    fn read_value(value: &Value) -> Result<(Scene, ImportReport), ImportError> {
        read("town.city.json", value.to_string().as_bytes(), &Settings::default().proxy, None)
    }

    /// Eight corners of a box, `first` its lowest index: the faces of its solid look outwards.
    fn shell(first: u32) -> Value {
        let faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
        json!(faces.map(|face| [face.map(|index| index + first)]))
    }

    fn corners(x: f64, side: f64, z: f64, height: f64) -> Vec<[f64; 3]> {
        let ring = [[x, 0.0], [x + side, 0.0], [x + side, side], [x, side]];
        [z, z + height].iter().flat_map(|&z| ring.map(|[x, y]| [x, y, z])).collect()
    }

    fn town() -> Value {
        json!({
            "type": "CityJSON", "version": "1.1",
            "transform": { "scale": [0.5, 0.5, 0.5], "translate": [90_000.0, 435_000.0, -1.0] },
            "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415" },
            "CityObjects": {
                "house": { "type": "Building", "children": ["house-0"], "geometry": [
                    { "type": "Solid", "lod": "1.2", "boundaries": [shell(16)] },
                    { "type": "MultiSurface", "lod": "0", "boundaries": [[[0, 1, 2, 3]]] },
                ] },
                "house-0": { "type": "BuildingPart", "parents": ["house"], "geometry": [
                    { "type": "Solid", "lod": "1.3", "boundaries": [shell(16)] },
                    { "type": "Solid", "lod": 2.2, "boundaries": [shell(0), shell(16)] },
                ] },
                "hall": { "type": "Building", "geometry": [{ "type": "CompositeSolid", "lod": 2, "boundaries": [[shell(8)]] }] },
                "road": { "type": "Road", "geometry": [{ "type": "MultiSurface", "lod": "1", "boundaries": [[[0, 1, 2, 3]]] }] },
            },
            "vertices": ([corners(0.0, 20.0, 0.0, 24.0), corners(60.0, 20.0, 0.0, 40.0), corners(0.0, 100.0, 0.0, 200.0)].concat()),
        })
    }

    #[test]
    fn a_building_is_one_structure_at_its_highest_detail() {
        let (scene, report) = read_value(&town()).unwrap();
        let mut heights: Vec<_> =
            scene.structures.iter().map(|s| (s.name.as_str(), s.triangles().len(), s.bounds().max.z)).collect();
        heights.sort_by(|a, b| a.0.cmp(b.0));
        assert_eq!(heights, [("hall", 12, 20.0), ("house", 12, 12.0)]);
        assert_eq!(report.ignored["Road"], 1);
        assert_eq!(report.epsg, Some(7415));
        let origin = scene.frame.origin.unwrap();
        assert!((origin.lat_deg - 51.9).abs() < 0.02 && (origin.lon_deg - 4.43).abs() < 0.02, "{origin:?}");
        assert_eq!(origin.alt_m, -1.0);
        let bounds = scene.bounds().unwrap();
        assert_eq!(bounds.min.z, 0.0);
        assert!((bounds.min.x + bounds.max.x).abs() < 0.2, "the origin is the middle");
        assert!(scene.structures.iter().all(|s| s.contains(&nalgebra::center(&s.bounds().min, &s.bounds().max))));
    }

    #[test]
    fn other_reference_systems_are_noted_or_refused() {
        let mut town = town();
        town["metadata"]["referenceSystem"] = json!("EPSG:99999");
        let (scene, report) = read_value(&town).unwrap();
        assert_eq!(scene.frame.origin, None);
        assert!(report.notes.iter().any(|note| note.contains("99999")), "{:?}", report.notes);
        town["metadata"] = json!({});
        assert_eq!(read_value(&town).unwrap().0.frame.origin, None);
        town["metadata"]["referenceSystem"] = json!("EPSG:4326");
        assert!(matches!(read_value(&town), Err(ImportError::Geographic { epsg: 4326, .. })));
    }

    #[test]
    fn damaged_models_are_refused() {
        let mut broken = town();
        broken["CityObjects"]["hall"]["geometry"][0]["boundaries"] = json!([[[[[0, 1, 99]]]]]);
        let error = read_value(&broken).unwrap_err();
        assert!(error.to_string().contains("\"hall\"") && error.to_string().contains("99"), "{error}");
        broken["CityObjects"]["hall"]["geometry"][0]["boundaries"] = json!([[[[[0, 1, -1]]]]]);
        assert!(matches!(read_value(&broken), Err(ImportError::VertexIndex { .. })));
        broken["CityObjects"] = json!({});
        assert!(matches!(read_value(&broken), Err(ImportError::NoStructures { .. })));
        let mut absurd = town();
        absurd["transform"]["scale"] = json!([1e308, 1e308, 1e308]);
        absurd["transform"]["translate"] = json!([1e308, 1e308, 1e308]);
        assert!(read_value(&absurd).is_err());
    }

    /// The town as a sequence: each feature has the vertices that it uses, numbered from 0.
    fn sequence() -> String {
        let town = town();
        let vertices = town["vertices"].as_array().unwrap();
        let head = json!({ "type": "CityJSON", "version": "2.0", "transform": town["transform"], "metadata": town["metadata"],
            "CityObjects": {}, "vertices": [] });
        let feature = |id: &str, keys: &[&str], used: &[Value]| {
            let mut objects: Value = keys.iter().map(|key| ((*key).to_owned(), town["CityObjects"][key].clone())).collect();
            if id == "hall" {
                objects["hall"]["geometry"][0]["boundaries"] = json!([[shell(0)]]);
            }
            json!({ "type": "CityJSONFeature", "id": id, "CityObjects": objects, "vertices": used })
        };
        let lines =
            [head, feature("hall", &["hall"], &vertices[8..16]), feature("house", &["house", "house-0", "road"], vertices)];
        lines.iter().map(|line| format!("{line}\n")).collect()
    }

    #[test]
    fn a_sequence_says_what_the_whole_file_says() {
        let read_text = |text: &str| super::super::read("town.city.jsonl", text.as_bytes(), &Settings::default().proxy);
        let (scene, report) = read_text(&sequence()).unwrap();
        let (whole, _) = read_value(&town()).unwrap();
        assert_eq!((report.format, &scene.structures, &scene.frame), (Format::CityJsonSeq, &whole.structures, &whole.frame));
        assert_eq!(scene.name, "town");
        let cut = sequence();
        let error = read_text(&cut[..cut.len() - 10]).unwrap_err();
        assert!(matches!(error, ImportError::Json { .. }), "{error}");
        let headless = cut.split_once('\n').unwrap().1;
        assert!(matches!(read_text(headless), Err(ImportError::UnknownFormat { .. })));
    }

    #[test]
    fn a_level_of_detail_can_be_chosen() {
        let tops = |lod: f64| {
            let proxy = ProxySettings { lod, ..Settings::default().proxy };
            let (scene, _) = read("town.city.json", town().to_string().as_bytes(), &proxy, None).unwrap();
            ["hall", "house"].map(|name| scene.structure(scene.find(name).unwrap()).unwrap().bounds().max.z)
        };
        assert_eq!(tops(0.0), [20.0, 12.0]);
        assert_eq!(tops(2.2), [20.0, 12.0]);
        // The hall has nothing coarser.
        assert_eq!(tops(1.3), [20.0, 100.0]);
    }

    #[test]
    fn a_reference_system_can_be_given() {
        let mut town = town();
        town["metadata"] = json!({});
        let mut proxy = ProxySettings { epsg: 7415, ..Settings::default().proxy };
        let read_with = |proxy: &ProxySettings| read("town.city.json", town.to_string().as_bytes(), proxy, None);
        assert!(read_with(&proxy).unwrap().0.frame.origin.is_some());
        proxy.epsg = 99_999;
        assert!(matches!(read_with(&proxy), Err(ImportError::UnknownGrid { epsg: 99_999, .. })));
    }

    #[test]
    fn parents_in_a_circle_end() {
        let mut town = town();
        town["CityObjects"]["house"]["parents"] = json!(["house-0", "nobody"]);
        assert_eq!(read_value(&town).unwrap().0.structures.len(), 2);
    }

    #[test]
    fn a_part_far_away_and_flat_ground_are_left_out() {
        let mut town = town();
        let vertices = town["vertices"].as_array_mut().unwrap();
        vertices.extend(corners(1e6, 20.0, 0.0, 24.0).into_iter().map(|corner| json!(corner)));
        vertices.extend(corners(100.0, 20.0, 0.0, 0.4).into_iter().map(|corner| json!(corner)));
        town["CityObjects"]["far"] =
            json!({ "type": "Building", "geometry": [{ "type": "Solid", "lod": 1, "boundaries": [shell(24)] }] });
        town["CityObjects"]["slab"] =
            json!({ "type": "Bridge", "geometry": [{ "type": "Solid", "lod": 1, "boundaries": [shell(32)] }] });
        let (scene, report) = read_value(&town).unwrap();
        assert_eq!(scene.structures.len(), 2);
        assert_eq!((report.count(ItemKind::Outlier), report.count(ItemKind::NoGeometry)), (1, 1));
    }
}
