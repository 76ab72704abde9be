//! GeoJSON footprints with heights (RFC 7946, WGS84).
//!
//! A feature is a structure; a feature with the property `"overfly": "no-fly"` is a zone that must not be entered, from
//! `min_height` (the ground when missing) to `height` (no ceiling when missing). A foreign member `overfly_origin` of the
//! collection fixes the origin of the local frame; otherwise it is the middle of the box around the structures.

use std::collections::HashMap;

use geo::{Coord, MultiPolygon};
use geojson::{Geometry, GeometryValue, Position};
use nalgebra::Point3;
use serde_json::{Map, Value};

use super::footprint::{self, RawPolygon, Repair};
use super::heights;
use super::locate::{self, Location, Nowhere};
use super::names::{self, Names};
use super::proxy::{NoFlyZone, Scene, Shape, Structure, StructureId};
use super::read::{ImportError, assemble};
use super::report::{Format, ImportReport, ItemKind, Place};
use crate::frame::{Geodetic, LocalFrame};
use crate::settings::ProxySettings;

pub(crate) fn read(file: &str, bytes: &[u8], settings: &ProxySettings) -> Result<(Scene, ImportReport), ImportError> {
    let root: Value = serde_json::from_slice(bytes).map_err(|source| ImportError::Json { file: file.into(), source })?;
    let features = features(file, &root)?;
    let places: Vec<&[RawPolygon]> = features.iter().map(|feature| feature.polygons.as_slice()).collect();
    let locations = locate::locate(&places, settings.max_extent_m).map_err(|nowhere| refuse(file, &root, nowhere))?;
    let mut report = ImportReport::new(Format::GeoJson);
    let frame = frame(&root, &features, &locations, settings, &mut report);
    let mut builder = Builder::new(frame, settings, report);
    for (feature, location) in features.iter().zip(&locations) {
        builder.add(feature, *location);
    }
    builder.finish(file, features.len())
}

/// A feature as it stands in the file, coordinates in degrees.
struct Feature {
    index: usize,
    name: String,
    properties: Map<String, Value>,
    polygons: Vec<RawPolygon>,
    /// What was wrong with the geometry so far.
    repairs: Vec<Repair>,
    /// Why there are no polygons.
    missing: String,
}

impl Feature {
    fn is_zone(&self) -> bool {
        self.properties.get("overfly").and_then(Value::as_str) == Some("no-fly")
    }
}

fn features(file: &str, root: &Value) -> Result<Vec<Feature>, ImportError> {
    let wrong = |what: &str| ImportError::Structure {
        file: file.into(),
        what: what.into(),
        remedy: "give a GeoJSON FeatureCollection, a CityJSON file or an OBJ file",
    };
    match root.get("type").and_then(Value::as_str) {
        Some("FeatureCollection") => {
            let list = root
                .get("features")
                .and_then(Value::as_array)
                .ok_or_else(|| wrong("the FeatureCollection has no list `features`"))?;
            Ok(list.iter().enumerate().map(|(index, value)| feature(index, value)).collect())
        }
        Some("Feature") => Ok(vec![feature(0, root)]),
        Some("Polygon" | "MultiPolygon" | "GeometryCollection") => {
            Ok(vec![feature(0, &serde_json::json!({ "type": "Feature", "geometry": root }))])
        }
        Some(other) => Err(wrong(&format!("the JSON is of type {:?}, which is no collection of features", names::tidy(other)))),
        None => Err(wrong("the JSON has no member `type`")),
    }
}

fn feature(index: usize, value: &Value) -> Feature {
    let properties = value.get("properties").and_then(Value::as_object).cloned().unwrap_or_default();
    let name = names::feature_name(value.get("id"), &properties).unwrap_or_else(|| format!("feature-{index}"));
    let mut feature =
        Feature { index, name, properties, polygons: Vec::new(), repairs: Vec::new(), missing: "the geometry is null".into() };
    match value.get("geometry") {
        None | Some(Value::Null) => {}
        Some(geometry) => match serde_json::from_value::<Geometry>(geometry.clone()) {
            Ok(geometry) => collect(&geometry, &mut feature),
            Err(error) => feature.missing = format!("the geometry cannot be read ({})", names::tidy(&error.to_string())),
        },
    }
    feature
}

fn collect(geometry: &Geometry, feature: &mut Feature) {
    let mut others = Vec::new();
    let mut elevations = false;
    let mut polygons = Vec::new();
    gather(&geometry.value, &mut polygons, &mut others);
    for rings in &polygons {
        match rings.iter().map(|ring| ring.iter().map(|position| corner(position, &mut elevations)).collect()).collect() {
            Some(polygon) => feature.polygons.push(polygon),
            None => feature.missing = "a position has fewer than two numbers".into(),
        }
    }
    if polygons.is_empty() {
        feature.missing = format!("a {} is no footprint", geometry.value.type_name());
    } else if polygons.iter().all(|rings| rings.is_empty()) {
        feature.missing = "the polygon is empty".into();
    } else if !others.is_empty() || feature.polygons.len() < polygons.len() {
        let others = if others.is_empty() { "damaged polygons".into() } else { others.join(", ") };
        feature
            .repairs
            .push((ItemKind::PartsDropped, format!("only the {} polygons are used; left out: {others}", feature.polygons.len())));
    }
    if elevations {
        feature.repairs.push((ItemKind::ElevationIgnored, "the third coordinates are ignored".into()));
    }
}

fn gather<'a>(value: &'a GeometryValue, polygons: &mut Vec<&'a Vec<Vec<Position>>>, others: &mut Vec<&'static str>) {
    match value {
        GeometryValue::Polygon { coordinates } => polygons.push(coordinates),
        GeometryValue::MultiPolygon { coordinates } => polygons.extend(coordinates),
        GeometryValue::GeometryCollection { geometries } => {
            geometries.iter().for_each(|geometry| gather(&geometry.value, polygons, others));
        }
        other => others.push(other.type_name()),
    }
}

fn corner(position: &Position, elevations: &mut bool) -> Option<Coord<f64>> {
    match *position.as_slice() {
        [x, y] => Some(Coord { x, y }),
        [x, y, ..] => {
            *elevations = true;
            Some(Coord { x, y })
        }
        _ => None,
    }
}

fn refuse(file: &str, root: &Value, nowhere: Nowhere) -> ImportError {
    let file = file.to_owned();
    match nowhere {
        Nowhere::Swapped(example) => ImportError::SwappedCoordinates { file, example },
        Nowhere::Projected(example) => {
            let crs = root.pointer("/crs/properties/name").and_then(Value::as_str);
            let declared = crs.map_or(String::new(), |crs| format!(", declared as {}", names::tidy(crs)));
            ImportError::Projected { file, example, declared }
        }
    }
}

fn frame(
    root: &Value,
    features: &[Feature],
    locations: &[Location],
    settings: &ProxySettings,
    report: &mut ImportReport,
) -> LocalFrame {
    let kept = features.iter().zip(locations).filter(|(feature, location)| **location == Location::Kept && !feature.is_zone());
    let corners: Vec<Coord<f64>> = kept.flat_map(|(feature, _)| feature.polygons.iter().flatten().flatten().copied()).collect();
    let middle = locate::centre(&corners);
    let given = root.get("overfly_origin").and_then(|value| serde_json::from_value::<Geodetic>(value.clone()).ok());
    let (Some(given), Some(middle)) = (given, middle) else { return LocalFrame { origin: middle } };
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

    /// Adds the structure or zone and returns its name, or says why it is left out.
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
            (ItemKind::NoGeometry, if nothing { feature.missing.clone() } else { reason })
        })?;
        if feature.is_zone() { self.add_zone(feature, footprint) } else { self.add_structure(feature, footprint, repairs) }
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

    fn add_zone(&mut self, feature: &Feature, outline: MultiPolygon<f64>) -> Result<String, (ItemKind, String)> {
        let (floor_m, ceiling_m) =
            heights::zone_heights(&feature.properties).map_err(|reason| (ItemKind::ZoneDropped, reason))?;
        let name = self.zone_names.unique(&feature.name);
        self.zones.push(NoFlyZone { name: name.clone(), outline, floor_m, ceiling_m });
        Ok(name)
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
    use serde_json::json;

    use super::*;
    use crate::settings::Settings;

    fn read_value(value: &Value) -> Result<(Scene, ImportReport), ImportError> {
        read("town.geojson", value.to_string().as_bytes(), &Settings::default().proxy)
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
            zone(json!({ "id": "wrong", "overfly": "no-fly", "min_height": 70, "height": 60 })),
        ]))
        .unwrap();
        let zones: Vec<_> = scene.zones.iter().map(|zone| (zone.name.as_str(), zone.floor_m, zone.ceiling_m)).collect();
        assert_eq!(zones, [("school", 0.0, f64::MAX), ("mast", 20.0, 60.0)]);
        assert_eq!(scene.structures.len(), 1);
        assert_eq!((report.zones, report.count(ItemKind::ZoneDropped)), (2, 1));
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
