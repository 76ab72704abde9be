//! GeoJSON footprints with heights (RFC 7946, WGS84).
//!
//! A feature is a structure; a feature with the property `"overfly": "no-fly"` is a zone that must not be entered, from
//! `min_height` (the ground when missing) to `height` (no ceiling when missing). A foreign member `overfly_origin` of the
//! collection fixes the origin of the local frame; otherwise it is the middle of the box around the structures.

use std::borrow::Cow;
use std::collections::HashMap;

use geo::{Coord, MultiPolygon};
use nalgebra::Point3;
use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess};
use serde_json::{Map, Value};

use super::anchor::Anchor;
use super::footprint::{self, RawPolygon, Repair};
use super::geometry::{Draft, Parts};
use super::heights;
use super::json::{Intake, Into, Scalar};
use super::locate::{self, Location, Nowhere};
use super::names::{self, Names};
use super::proxy::{NoFlyZone, Scene, Shape, Structure, StructureId, ZoneSource};
use super::read::{ImportError, assemble};
use super::report::{Format, ImportReport, ItemKind, Place};
use super::zone;
use crate::frame::{Geodetic, LocalFrame};
use crate::settings::ProxySettings;

/// Files of more features are refused.
const MOST_FEATURES: usize = 250_000;

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let root = parse(bytes).map_err(|source| ImportError::Json { file: file.into(), source })?;
    let features = features(file, &root)?;
    // A zone says nothing about where the scene is.
    let places: Vec<&[RawPolygon]> =
        features.iter().map(|feature| if feature.zone { &[] } else { feature.polygons.as_slice() }).collect();
    let locations = locate::locate(&places, settings.max_extent_m).map_err(|nowhere| refuse(file, &root, nowhere))?;
    let mut report = ImportReport::new(Format::GeoJson);
    let frame = match anchor {
        Some(anchor) => LocalFrame { origin: Some(anchor.degrees(file)?) },
        None => frame(&root, features, &locations, settings, &mut report),
    };
    report.anchor = frame.origin.map(Anchor::Degrees);
    let mut builder = Builder::new(frame, settings, report);
    for (feature, location) in features.iter().zip(&locations) {
        if feature.zone {
            builder.add_zone(file, feature)?;
        } else {
            builder.add(feature, *location);
        }
    }
    builder.finish(file, features.len())
}

/// What is asked of a file.
#[derive(Default)]
struct Root {
    kind: Option<String>,
    /// The features of a collection, or the one of a file that is a feature or a geometry.
    features: Vec<Feature>,
    /// How many elements `features` has; `None` where it is missing or no list.
    listed: Option<usize>,
    crs_name: Option<String>,
    origin: Origin,
    /// The first value of the property `overfly` that is not known, and the feature that has it.
    unknown_mark: Option<(usize, String, String)>,
}

/// A feature as it stands in the file, coordinates in degrees.
struct Feature {
    index: usize,
    name: String,
    /// Whether it is a no-fly zone.
    zone: bool,
    /// The properties that matter here.
    properties: Map<String, Value>,
    polygons: Vec<RawPolygon>,
    /// What was wrong with the geometry so far.
    repairs: Vec<Repair>,
    /// Why there are no polygons.
    missing: Cow<'static, str>,
}

fn parse(bytes: &[u8]) -> Result<Root, serde_json::Error> {
    let mut reader = RootReader::default();
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    Into(&mut reader).deserialize(&mut deserializer)?;
    deserializer.end()?;
    let RootReader { mut root, feature, geometry } = reader;
    let alone = match root.kind.as_deref() {
        Some("Feature") => Some(feature),
        Some("Polygon" | "MultiPolygon" | "GeometryCollection") => Some(FeatureReader { geometry, ..feature }),
        _ => None,
    };
    if let Some(alone) = alone {
        root.features.clear();
        root.unknown_mark = None;
        root.push(alone, 0);
    }
    Ok(root)
}

/// A file while it is read: what it is becomes known from a member that may come last.
#[derive(Default)]
struct RootReader {
    root: Root,
    feature: FeatureReader,
    geometry: Draft,
}

impl Intake for RootReader {
    fn object(&mut self) {
        self.geometry.object();
    }

    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        match key {
            "type" => {
                self.root.kind = members.next_value::<Scalar>()?.text().map(str::to_owned);
                self.geometry.set_kind(self.root.kind.clone());
                Ok(())
            }
            "features" => members.next_value_seed(Into(&mut Features(&mut self.root))),
            "crs" => members.next_value_seed(Into(&mut Crs(&mut self.root.crs_name))),
            "overfly_origin" => members.next_value_seed(Into(&mut self.root.origin)),
            "coordinates" | "geometries" => self.geometry.member(key, members),
            _ => self.feature.member(key, members),
        }
    }
}

struct Features<'a>(&'a mut Root);

impl Intake for Features<'_> {
    fn list(&mut self) {
        self.0.features.clear();
        self.0.listed = Some(0);
    }

    fn element<'de, A: SeqAccess<'de>>(&mut self, list: &mut A) -> Result<bool, A::Error> {
        let index = self.0.listed.unwrap_or(0);
        if index >= MOST_FEATURES {
            let more = list.next_element::<IgnoredAny>()?.is_some();
            self.0.listed = Some(index + usize::from(more));
            return Ok(more);
        }
        let mut feature = FeatureReader::default();
        if list.next_element_seed(Into(&mut feature))?.is_none() {
            return Ok(false);
        }
        self.0.push(feature, index);
        self.0.listed = Some(index + 1);
        Ok(true)
    }
}

/// A feature while it is read.
#[derive(Default)]
struct FeatureReader {
    id: Option<Value>,
    properties: Map<String, Value>,
    geometry: Draft,
}

impl Intake for FeatureReader {
    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        match key {
            "id" => self.id = Some(members.next_value::<Scalar>()?.0),
            "properties" => members.next_value_seed(Into(&mut Properties(&mut self.properties)))?,
            "geometry" => {
                self.geometry = Draft::default();
                members.next_value_seed(Into(&mut self.geometry))?;
            }
            _ => drop(members.next_value::<IgnoredAny>()?),
        }
        Ok(())
    }
}

struct Properties<'a>(&'a mut Map<String, Value>);

impl Intake for Properties<'_> {
    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        if key == MARK || heights::is_key(key) || names::is_key(key) {
            self.0.insert(key.to_owned(), members.next_value::<Scalar>()?.0);
        } else {
            members.next_value::<IgnoredAny>()?;
        }
        Ok(())
    }
}

/// The name within `crs`, which old files have.
struct Crs<'a>(&'a mut Option<String>);

impl Intake for Crs<'_> {
    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        match key {
            "properties" => members.next_value_seed(Into(self)),
            "name" => {
                *self.0 = members.next_value::<Scalar>()?.text().map(names::tidy);
                Ok(())
            }
            _ => members.next_value::<IgnoredAny>().map(drop),
        }
    }
}

/// The member `overfly_origin`: latitude and longitude, degrees, and height, m.
#[derive(Default)]
struct Origin([Option<f64>; 3]);

impl Origin {
    fn place(&self) -> Option<Geodetic> {
        let [lat_deg, lon_deg, alt_m] = self.0;
        Some(Geodetic { lat_deg: lat_deg?, lon_deg: lon_deg?, alt_m: alt_m? })
    }
}

impl Intake for Origin {
    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        let value = members.next_value::<Scalar>()?.0.as_f64();
        if let Some(index) = ["lat_deg", "lon_deg", "alt_m"].iter().position(|name| *name == key) {
            self.0[index] = value;
        }
        Ok(())
    }
}

/// The property that says what a feature is, and the one value that is known.
const MARK: &str = "overfly";
const NO_FLY: &str = "no-fly";

impl Root {
    fn push(&mut self, reader: FeatureReader, index: usize) {
        let FeatureReader { id, properties, geometry } = reader;
        let name = names::feature_name(id.as_ref(), &properties).unwrap_or_else(|| format!("feature-{index}"));
        let mark = properties.get(MARK).filter(|mark| !mark.is_null());
        let zone = mark.is_some_and(|mark| mark.as_str() == Some(NO_FLY));
        if let (Some(mark), false, None) = (mark, zone, &self.unknown_mark) {
            self.unknown_mark = Some((index, name.clone(), names::tidy(&mark.to_string())));
        }
        let mut feature = Feature {
            index,
            name,
            zone,
            properties,
            polygons: Vec::new(),
            repairs: Vec::new(),
            missing: "the geometry is null".into(),
        };
        if let Some(parts) = geometry.finish() {
            collect(parts, &mut feature);
        }
        self.features.push(feature);
    }
}

fn features<'a>(file: &str, root: &'a Root) -> Result<&'a [Feature], ImportError> {
    let file = file.to_owned();
    let remedy = "give a GeoJSON FeatureCollection, a CityJSON file or an OBJ file";
    match (root.kind.as_deref(), root.listed) {
        (Some("FeatureCollection"), None) => {
            let what = "the FeatureCollection has no list `features`".into();
            return Err(ImportError::Structure { file, what, remedy });
        }
        (Some("FeatureCollection"), Some(features)) if features > MOST_FEATURES => {
            return Err(ImportError::TooManyFeatures { file, features, most: MOST_FEATURES });
        }
        (Some("FeatureCollection" | "Feature" | "Polygon" | "MultiPolygon" | "GeometryCollection"), _) => {}
        (Some(other), _) => {
            let what = format!("the JSON is of type {:?}, which is no collection of features", names::tidy(other));
            return Err(ImportError::Structure { file, what, remedy });
        }
        (None, _) => return Err(ImportError::Structure { file, what: "the JSON has no member `type`".into(), remedy }),
    }
    match root.unknown_mark.clone() {
        Some((index, name, value)) => Err(ImportError::UnknownMark { file, index, name, value }),
        None => Ok(&root.features),
    }
}

/// Hands the parts of a geometry to its feature, with a word on what is not used.
fn collect(parts: Parts, feature: &mut Feature) {
    let Parts { polygons, given, others, elevations, damage } = parts;
    let used = polygons.len();
    if given == 0 {
        feature.missing = match (others.first(), damage) {
            (_, Some(damage)) => damage.into(),
            (Some(other), None) => format!("a {other} is no footprint").into(),
            (None, None) => "the geometry is empty".into(),
        };
    } else if used > 0 && polygons.iter().all(Vec::is_empty) {
        feature.missing = "the polygon is empty".into();
    } else {
        let left_out: Vec<&str> = damage.as_deref().into_iter().chain(others).collect();
        if !left_out.is_empty() {
            let done = format!("only the {used} polygons are used; left out: {}", left_out.join(", "));
            feature.repairs.push((ItemKind::PartsDropped, done));
        }
        if let Some(damage) = damage {
            feature.missing = damage.into();
        }
    }
    if elevations {
        feature.repairs.push((ItemKind::ElevationIgnored, "the third coordinates are ignored".into()));
    }
    feature.polygons = polygons;
}

fn refuse(file: &str, root: &Root, nowhere: Nowhere) -> ImportError {
    let file = file.to_owned();
    match nowhere {
        Nowhere::Swapped(example) => ImportError::SwappedCoordinates { file, example },
        Nowhere::Projected(example) => {
            let declared = root.crs_name.as_ref().map_or(String::new(), |crs| format!(", declared as {crs}"));
            ImportError::Projected { file, example, declared }
        }
    }
}

fn frame(
    root: &Root,
    features: &[Feature],
    locations: &[Location],
    settings: &ProxySettings,
    report: &mut ImportReport,
) -> LocalFrame {
    let kept = features.iter().zip(locations).filter(|(feature, location)| **location == Location::Kept && !feature.zone);
    let corners: Vec<Coord<f64>> = kept.flat_map(|(feature, _)| feature.polygons.iter().flatten().flatten().copied()).collect();
    let middle = locate::centre(&corners);
    let (Some(given), Some(middle)) = (root.origin.place(), middle) else { return LocalFrame { origin: middle } };
    let [a, b] = [given, middle].map(|place| Coord { x: place.lon_deg, y: place.lat_deg });
    let sound = given.lat_deg.abs() <= 90.0 && given.lon_deg.abs() <= 180.0 && given.alt_m.abs() <= 10_000.0;
    if sound && locate::rough_distance_m(a, b) <= settings.max_extent_m {
        return LocalFrame { origin: Some(given) };
    }
    report.notes.push("overfly_origin lies far from the structures: ignored".into());
    LocalFrame { origin: Some(middle) }
}

/// The scene in the making.
struct Builder<'a> {
    frame: LocalFrame,
    settings: &'a ProxySettings,
    report: ImportReport,
    structures: Vec<Structure>,
    zones: Vec<NoFlyZone>,
    names: Names,
    zone_names: Names,
    /// Names of the structures by their geometry in millimetres.
    seen: HashMap<Vec<i64>, String>,
    heights_known: usize,
    first_problem: String,
}

impl<'a> Builder<'a> {
    fn new(frame: LocalFrame, settings: &'a ProxySettings, report: ImportReport) -> Self {
        Self {
            frame,
            settings,
            report,
            structures: Vec::new(),
            zones: Vec::new(),
            names: Names::default(),
            zone_names: Names::default(),
            seen: HashMap::new(),
            heights_known: 0,
            first_problem: String::new(),
        }
    }

    fn add(&mut self, feature: &Feature, location: Location) {
        let mut repairs = feature.repairs.clone();
        let fate = self.build(feature, location, &mut repairs);
        let name = match &fate {
            Ok(name) => name.clone(),
            Err((kind, reason)) => {
                if self.first_problem.is_empty() {
                    self.first_problem = format!(" (the first, {}: {reason})", feature.name);
                }
                repairs = vec![(*kind, format!("{reason}: left out"))];
                feature.name.clone()
            }
        };
        for (kind, done) in repairs {
            self.report.add(&name, Place::Feature(feature.index), kind, done);
        }
    }

    /// Adds the structure and returns its name, or says why it is left out.
    fn build(&mut self, feature: &Feature, location: Location, repairs: &mut Vec<Repair>) -> Result<String, (ItemKind, String)> {
        match location {
            Location::Kept => {}
            Location::Swapped => {
                repairs.push((ItemKind::SwappedCoordinates, "latitude and longitude were exchanged: swapped back".into()))
            }
            Location::Outlier { distance_km } => {
                return Err((ItemKind::Outlier, format!("{distance_km:.0} km from the middle of the scene")));
            }
            Location::OffEarth => return Err((ItemKind::Outlier, "its coordinates are no longitude and latitude".into())),
        }
        let polygons = self.project(feature, location == Location::Swapped);
        let footprint = footprint::repair(&polygons, repairs).map_err(|reason| {
            let nothing = feature.polygons.iter().all(Vec::is_empty);
            (ItemKind::NoGeometry, if nothing { feature.missing.to_string() } else { reason })
        })?;
        self.add_structure(feature, footprint, repairs)
    }

    fn project(&self, feature: &Feature, swapped: bool) -> Vec<RawPolygon> {
        let local = |corner: &Coord<f64>| {
            let (lon_deg, lat_deg) = if swapped { (corner.y, corner.x) } else { (corner.x, corner.y) };
            let place = Geodetic { lat_deg, lon_deg, alt_m: 0.0 };
            let point = self.frame.local_from_geodetic(&place).unwrap_or(Point3::origin());
            Coord { x: point.x, y: point.y }
        };
        let project_ring = |ring: &Vec<Coord<f64>>| ring.iter().map(local).collect();
        feature.polygons.iter().map(|rings| rings.iter().map(project_ring).collect()).collect()
    }

    fn add_structure(
        &mut self,
        feature: &Feature,
        footprint: MultiPolygon<f64>,
        repairs: &mut Vec<Repair>,
    ) -> Result<String, (ItemKind, String)> {
        let extent = heights::heights(&feature.properties, self.settings, repairs);
        let key = geometry_key(&footprint, extent.base_m, extent.top_m);
        if let Some(first) = self.seen.get(&key) {
            return Err((ItemKind::DuplicateDropped, format!("the same footprint and height as {first}")));
        }
        let name = self.names.unique(&feature.name);
        if name != feature.name {
            repairs.push((ItemKind::Renamed, format!("another structure is called {}: renamed to {name}", feature.name)));
        }
        self.heights_known += usize::from(extent.known);
        self.seen.insert(key, name.clone());
        let shape = Shape::Prism { footprint, base_m: extent.base_m, top_m: extent.top_m };
        self.structures.push(Structure { id: StructureId::of_name(&name), name: name.clone(), shape });
        Ok(name)
    }

    /// Adds a zone. One that cannot be barred as it is given stops the import: a flight through it must not be planned.
    fn add_zone(&mut self, file: &str, feature: &Feature) -> Result<(), ImportError> {
        // Without a structure there is no scene, which `finish` says.
        let Some(origin) = self.frame.origin else { return Ok(()) };
        let refuse = |(problem, remedy): (String, &'static str)| ImportError::Zone {
            file: file.into(),
            index: feature.index,
            name: feature.name.clone(),
            problem,
            remedy,
        };
        let mut repairs = feature.repairs.clone();
        if let Some((_, problem)) = repairs.iter().find(|(kind, _)| *kind == ItemKind::PartsDropped) {
            return Err(refuse((problem.clone(), zone::ONLY_POLYGONS)));
        }
        if feature.polygons.iter().all(Vec::is_empty) {
            return Err(refuse((feature.missing.to_string(), zone::ONLY_POLYGONS)));
        }
        let (floor_m, ceiling_m) = heights::zone_heights(&feature.properties, &mut repairs).map_err(refuse)?;
        let outline = zone::outline(&feature.polygons, origin, self.settings.max_extent_m, &mut repairs).map_err(refuse)?;
        let name = self.zone_names.unique(&feature.name);
        if name != feature.name {
            repairs.push((ItemKind::Renamed, format!("another zone is called {}: renamed to {name}", feature.name)));
        }
        for (kind, done) in repairs {
            self.report.add(&name, Place::Feature(feature.index), kind, done);
        }
        self.zones.push(NoFlyZone { name, outline, floor_m, ceiling_m, source: ZoneSource::File });
        Ok(())
    }

    fn finish(self, file: &str, objects: usize) -> Result<(Scene, ImportReport), ImportError> {
        if self.structures.is_empty() {
            return Err(ImportError::NoStructures { file: file.into(), objects, first: self.first_problem });
        }
        if self.heights_known == 0 {
            return Err(ImportError::NoHeights { file: file.into(), structures: self.structures.len() });
        }
        Ok(assemble(file, self.frame, self.structures, self.zones, self.report))
    }
}

/// Corners and heights in whole millimetres: equal for features that say the same.
fn geometry_key(footprint: &MultiPolygon<f64>, base_m: f64, top_m: f64) -> Vec<i64> {
    let mm = |metres: f64| (metres * 1000.0).round() as i64;
    let mut key = vec![mm(base_m), mm(top_m)];
    for polygon in footprint {
        for ring in std::iter::once(polygon.exterior()).chain(polygon.interiors()) {
            key.push(ring.0.len() as i64);
            key.extend(ring.0.iter().flat_map(|corner| [mm(corner.x), mm(corner.y)]));
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use geo::Contains;
    use serde_json::json;

    use super::*;
    use crate::settings::Settings;

    fn read_value(value: &Value) -> Result<(Scene, ImportReport), ImportError> {
        read("town.geojson", value.to_string().as_bytes(), &Settings::default().proxy, None)
    }

    fn square(lon: f64, lat: f64) -> Value {
        let d = 1e-4;
        json!([[[lon, lat], [lon + d, lat], [lon + d, lat + d], [lon, lat + d], [lon, lat]]])
    }

    fn building(lon: f64, lat: f64, properties: Value) -> Value {
        json!({ "type": "Feature", "properties": properties, "geometry": { "type": "Polygon", "coordinates": square(lon, lat) } })
    }

    fn town(features: Vec<Value>) -> Value {
        json!({ "type": "FeatureCollection", "features": features })
    }

    #[test]
    fn no_fly_features_become_zones() {
        let zone = |properties: Value| building(4.002, 52.0, properties);
        let (scene, report) = read_value(&town(vec![
            building(4.0, 52.0, json!({ "id": "a", "height": 10 })),
            zone(json!({ "id": "school", "overfly": "no-fly" })),
            zone(json!({ "id": "mast", "overfly": "no-fly", "min_height": 20, "height": "60 m" })),
            zone(json!({ "id": "cellar", "overfly": "no-fly", "min_height": -10, "height": null })),
        ]))
        .unwrap();
        let zones: Vec<_> = scene.zones.iter().map(|zone| (zone.name.as_str(), zone.floor_m, zone.ceiling_m)).collect();
        assert_eq!(zones, [("school", 0.0, f64::MAX), ("mast", 20.0, 60.0), ("cellar", 0.0, f64::MAX)]);
        assert_eq!(scene.structures.len(), 1);
        assert_eq!((report.zones, report.count(ItemKind::BaseIgnored), report.count(ItemKind::HeightText)), (3, 1, 1));
    }

    #[test]
    fn a_zone_that_cannot_be_barred_as_given_stops_the_import() {
        let marked = |geometry: Value, properties: Value| {
            let mut properties = properties;
            properties["id"] = json!("field");
            json!({ "type": "Feature", "properties": properties, "geometry": geometry })
        };
        let outline = || json!({ "type": "Polygon", "coordinates": square(4.002, 52.0) });
        let zone = |properties: Value| {
            let mut properties = properties;
            properties["overfly"] = json!("no-fly");
            marked(outline(), properties)
        };
        let shaped = |geometry: Value| marked(geometry, json!({ "overfly": "no-fly" }));
        let point = || json!({ "type": "Point", "coordinates": [4.002, 52.0] });
        let cases = [
            zone(json!({ "min_height": 70, "height": 60 })),
            zone(json!({ "height": 0 })),
            zone(json!({ "height": "high" })),
            zone(json!({ "height": -5 })),
            zone(json!({ "height": [60] })),
            zone(json!({ "height": "high", "building:height": 60 })),
            zone(json!({ "min_height": "10;25", "height": 60 })),
            zone(json!({ "min_height": "low" })),
            shaped(Value::Null),
            shaped(point()),
            shaped(json!({ "type": "GeometryCollection", "geometries": [outline(), point()] })),
            shaped(json!({ "type": "Polygon", "coordinates": [[[4.002], [4.003, 52.0], [4.003, 52.1]]] })),
            shaped(json!({ "type": "Circle", "coordinates": square(4.002, 52.0) })),
            shaped(json!({ "type": "MultiPolygon", "coordinates": [square(4.002, 52.0), 7] })),
            marked(outline(), json!({ "overfly": "no_fly" })),
            marked(outline(), json!({ "overfly": true })),
        ];
        for case in cases {
            let error =
                read_value(&town(vec![building(4.0, 52.0, json!({ "height": 10 })), case.clone()])).expect_err(&case.to_string());
            let text = error.to_string();
            assert!(text.contains("feature 1 ") || text.contains("(feature 1)"), "{text}");
            assert!(text.contains("\"field\"") && (text.contains("; ") || text.contains("\"no-fly\"")), "{text}");
        }
    }

    #[test]
    fn great_zones_are_kept_and_do_not_move_the_scene() {
        let control_zone = json!({ "type": "Feature", "properties": { "overfly": "no-fly" }, "geometry": { "type": "Polygon",
            "coordinates": [[[3.0, 51.0], [5.0, 51.0], [5.0, 53.0], [3.0, 53.0], [3.0, 51.0]]] } });
        let far = building(-74.0, 40.7, json!({ "overfly": "no-fly", "id": "far" }));
        let alone = read_value(&town(vec![building(4.0, 52.0, json!({ "height": 10 }))])).unwrap().0;
        let (scene, report) = read_value(&town(vec![control_zone, building(4.0, 52.0, json!({ "height": 10 })), far])).unwrap();
        assert_eq!(scene.frame, alone.frame);
        assert_eq!((report.zones, report.count(ItemKind::Outlier)), (2, 1));
        assert!(scene.zones[0].outline.contains(&geo::Point::new(0.0, 0.0)));
        assert!(scene.zones[1].outline.0.is_empty());
        let again =
            read("town.geojson", super::super::to_geojson(&scene).as_bytes(), &Settings::default().proxy, None).unwrap().0;
        assert!(again.zones[0].outline.contains(&geo::Point::new(0.0, 0.0)));
    }

    #[test]
    fn members_come_in_any_order_and_the_unknown_is_passed_over() {
        let ring = "[[4,52],[4.0001,52],[4.0001,52.0001],[4,52]]";
        let feature = format!(
            r#""geometry":{{"x":[[]],"coordinates":[{ring}],"bbox":[1,{{}}],"type":"Polygon"}},"properties":{{"y":{{"height":7}},"height":9}}"#
        );
        let collection = format!(r#"{{"z":[1,[2]],"features":[{{{feature},"type":"Feature"}}],"type":"FeatureCollection"}}"#);
        let alone = format!(r#"{{{feature},"type":"Feature"}}"#);
        let nested = collection.replace(r#""type":"Polygon"}"#, r#""type":"Polygon"}],"type":"GeometryCollection"}"#);
        let nested = nested.replace(r#""geometry":"#, r#""geometry":{"geometries":["#);
        for text in [collection, alone, nested] {
            let (scene, report) = read("town.geojson", text.as_bytes(), &Settings::default().proxy, None).expect(&text);
            assert_eq!((scene.structures.len(), report.tallest_m, report.items.len()), (1, 9.0, 0), "{text}");
        }
    }

    #[test]
    fn too_many_features_are_refused_and_counted() {
        let text = |count: usize| format!("{{\"type\":\"FeatureCollection\",\"features\":[{}0]}}", "0,".repeat(count - 1));
        let read_text = |text: String| read("town.geojson", text.as_bytes(), &Settings::default().proxy, None).unwrap_err();
        assert!(matches!(read_text(text(MOST_FEATURES)), ImportError::NoStructures { objects: MOST_FEATURES, .. }));
        let error = read_text(text(MOST_FEATURES + 7));
        assert!(matches!(error, ImportError::TooManyFeatures { features, .. } if features == MOST_FEATURES + 7), "{error}");
    }

    #[test]
    fn names_stay_unique_and_ids_sorted() {
        let (scene, report) = read_value(&town(vec![
            building(4.0, 52.0, json!({ "id": "a", "height": 10 })),
            building(4.001, 52.0, json!({ "id": "a", "height": 10 })),
            building(4.002, 52.0, json!({ "height": 10 })),
        ]))
        .unwrap();
        for name in ["a", "a-2", "feature-2"] {
            assert!(scene.find(name).is_some(), "{name}");
        }
        assert_eq!(report.count(ItemKind::Renamed), 1);
        assert!(scene.structures.is_sorted_by(|a, b| a.id < b.id));
    }

    #[test]
    fn the_order_of_the_file_does_not_matter() {
        let mut features: Vec<Value> = (0..9)
            .map(|i| building(4.0 + 2e-4 * f64::from(i % 3), 52.0 + 2e-4 * f64::from(i), json!({ "id": i, "height": 5 + i })))
            .collect();
        let (first, _) = read_value(&town(features.clone())).unwrap();
        features.reverse();
        assert_eq!(read_value(&town(features)).unwrap().0, first);
    }

    #[test]
    fn files_that_are_no_scene_are_refused() {
        let tokyo = |properties: Value| building(139.77, 35.68, properties);
        let swapped = json!({ "type": "Feature", "properties": { "height": 9 }, "geometry": { "type": "Polygon", "coordinates": square(35.68, 139.77) } });
        let projected = json!({ "type": "Feature", "properties": { "height": 9 }, "geometry": { "type": "Polygon", "coordinates": square(90_759.0, 435_665.0) } });
        let mut declared = town(vec![projected.clone()]);
        declared["crs"] = json!({ "type": "name", "properties": { "name": "urn:ogc:def:crs:EPSG::28992" } });
        type Check = fn(&ImportError) -> bool;
        let cases: [(Value, Check); 8] = [
            (town(vec![]), |error| matches!(error, ImportError::NoStructures { .. })),
            (town(vec![json!({ "type": "Feature", "properties": {}, "geometry": null })]), |error| {
                matches!(error, ImportError::NoStructures { .. })
            }),
            (town(vec![json!(7), json!([]), json!("x")]), |error| matches!(error, ImportError::NoStructures { .. })),
            (town(vec![tokyo(json!({})), tokyo(json!({ "height": "tall" }))]), |error| {
                matches!(error, ImportError::NoHeights { .. })
            }),
            (town(vec![swapped]), |error| matches!(error, ImportError::SwappedCoordinates { .. })),
            (town(vec![projected]), |error| matches!(error, ImportError::Projected { .. })),
            (declared, |error| error.to_string().contains("28992")),
            (json!({ "type": "FeatureCollection" }), |error| matches!(error, ImportError::Structure { .. })),
        ];
        for (value, check) in cases {
            let error = read_value(&value).expect_err(&value.to_string());
            assert!(check(&error) && error.to_string().starts_with("town.geojson: "), "{error}");
        }
    }

    #[test]
    fn a_given_origin_is_kept_when_it_is_near() {
        let mut value = town(vec![building(4.0, 52.0, json!({ "height": 10 }))]);
        value["overfly_origin"] = json!({ "lat_deg": 52.001, "lon_deg": 4.001, "alt_m": 3.0 });
        let origin = |value: &Value| read_value(value).unwrap().0.frame.origin.unwrap();
        assert_eq!(origin(&value), Geodetic { lat_deg: 52.001, lon_deg: 4.001, alt_m: 3.0 });
        value["overfly_origin"] = json!({ "lat_deg": 12.0, "lon_deg": 4.001, "alt_m": 3.0 });
        assert!((origin(&value).lat_deg - 52.000_05).abs() < 1e-9);
    }
}
