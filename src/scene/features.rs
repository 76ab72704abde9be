//! Features with footprints in degrees and properties as OpenStreetMap has them, made into a scene: what GeoJSON and OpenStreetMap files have in common.

use std::borrow::Cow;
use std::collections::HashMap;

use geo::{Area, BooleanOps, Coord, MultiPolygon};
use nalgebra::Point3;
use serde_json::{Map, Value};

use super::anchor::Anchor;
use super::bounds::Bounds;
use super::crs::{self, Unplaced};
use super::footprint::{self, RawPolygon, Repair};
use super::heights;
use super::locate::{self, Location, Nowhere};
use super::names::Names;
use super::neighbours::{Guess, KnownHeights};
use super::proxy::{NoFlyZone, Scene, Shape, Structure, StructureId, ZoneSource};
use super::read::{ImportError, assemble};
use super::report::{Format, ImportReport, ItemKind, Place};
use super::zone;
use crate::frame::{Geodetic, LocalFrame};
use crate::settings::{MissingHeights, ProxySettings};

/// The property that makes a feature a part of a building, which the building's outline is there beside.
const PART_KEY: &str = "building:part";

/// Parts that cover so much of an outline stand in its place.
const PARTS_SHARE: f64 = 0.9;

/// Whether a property says something about a building.
pub(crate) fn is_key(key: &str) -> bool {
    key == PART_KEY || heights::is_key(key)
}

/// The features of a file.
pub(crate) struct Collection {
    pub format: Format,
    pub features: Vec<Feature>,
    /// The origin that the file wants for the local frame.
    pub origin: Option<Geodetic>,
    /// The reference system that the file names: its EPSG code, where there is one in it, and what it says.
    pub crs: Option<(Option<u32>, String)>,
}

/// A feature as it stands in the file, coordinates in degrees.
pub(crate) struct Feature {
    pub place: Place,
    pub name: String,
    /// Whether it is a no-fly zone.
    pub zone: bool,
    /// The properties that matter here.
    pub properties: Map<String, Value>,
    pub polygons: Vec<RawPolygon>,
    /// What was wrong with the geometry so far.
    pub repairs: Vec<Repair>,
    /// Why there are no polygons.
    pub missing: Cow<'static, str>,
}

/// The scene of all features.
pub(crate) fn scene_of(
    file: &str,
    mut collection: Collection,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let mut report = ImportReport::new(collection.format);
    let locations = located(file, &mut collection, settings, &mut report)?;
    let Collection { features, origin, .. } = collection;
    let frame = match anchor {
        Some(anchor) => LocalFrame { origin: Some(anchor.degrees(file)?) },
        None => frame(origin, &features, &locations, settings, &mut report),
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

/// Where the features lie, brought to degrees where they are not.
fn located(
    file: &str,
    collection: &mut Collection,
    settings: &ProxySettings,
    report: &mut ImportReport,
) -> Result<Vec<Location>, ImportError> {
    if settings.epsg != 0 {
        to_degrees(file, collection, settings.epsg, report)?;
    }
    match (locate(collection, settings), collection.crs.as_ref().and_then(|(epsg, _)| *epsg)) {
        (Err(Nowhere::Projected(_)), Some(epsg)) if settings.epsg == 0 => {
            to_degrees(file, collection, epsg, report)?;
            locate(collection, settings).map_err(|nowhere| refuse(file, collection, nowhere))
        }
        (located, _) => located.map_err(|nowhere| refuse(file, collection, nowhere)),
    }
}

/// A zone says nothing about where the scene is.
fn locate(collection: &Collection, settings: &ProxySettings) -> Result<Vec<Location>, Nowhere> {
    let places: Vec<&[RawPolygon]> =
        collection.features.iter().map(|feature| if feature.zone { &[] } else { feature.polygons.as_slice() }).collect();
    locate::locate(&places, settings.max_extent_m)
}

/// Brings all features from a projected reference system to degrees; one that is in degrees leaves them as they are.
fn to_degrees(file: &str, collection: &mut Collection, epsg: u32, report: &mut ImportReport) -> Result<(), ImportError> {
    let unknown = |example: [f64; 2]| ImportError::UnknownGrid { file: file.into(), epsg, example };
    let corners = || collection.features.iter().flat_map(|feature| feature.polygons.iter().flatten().flatten());
    let first = corners().next().map_or([0.0; 2], |corner| [corner.x, corner.y]);
    report.epsg = Some(epsg);
    let grid = match crs::Grid::new(epsg) {
        Ok(grid) => grid,
        Err(Unplaced::Geographic) => return Ok(()),
        Err(Unplaced::Unknown) => return Err(unknown(first)),
    };
    for corner in collection.features.iter_mut().flat_map(|feature| feature.polygons.iter_mut().flatten().flatten()) {
        let place = grid.geodetic(corner.x, corner.y);
        // One that has no place is an outlier like any other that is nowhere on Earth.
        *corner = place.map_or(Coord { x: f64::MAX, y: f64::MAX }, |place| Coord { x: place.lon_deg, y: place.lat_deg });
    }
    report.notes.push(format!("brought from EPSG:{epsg} to WGS84"));
    Ok(())
}

fn refuse(file: &str, collection: &Collection, nowhere: Nowhere) -> ImportError {
    let file = file.to_owned();
    match nowhere {
        Nowhere::Swapped(example) => ImportError::SwappedCoordinates { file, example },
        Nowhere::Projected(example) => {
            let declared = collection.crs.as_ref().map_or(String::new(), |(_, name)| format!(", declared as {name}"));
            ImportError::Projected { file, example, declared }
        }
    }
}

fn frame(
    origin: Option<Geodetic>,
    features: &[Feature],
    locations: &[Location],
    settings: &ProxySettings,
    report: &mut ImportReport,
) -> LocalFrame {
    let kept = features.iter().zip(locations).filter(|(feature, location)| **location == Location::Kept && !feature.zone);
    let corners: Vec<Coord<f64>> = kept.flat_map(|(feature, _)| feature.polygons.iter().flatten().flatten().copied()).collect();
    let middle = locate::centre(&corners);
    let (Some(given), Some(middle)) = (origin, middle) else { return LocalFrame { origin: middle } };
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
    /// Structures of whose height nothing is known, by index, with where they stand in the file and why.
    unknown: Vec<(usize, Place, String)>,
    /// Structures that are parts of buildings, and those that may be outlines around parts, with where they stand in the file.
    parts: Vec<usize>,
    outlines: Vec<(usize, Place)>,
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
            unknown: Vec::new(),
            parts: Vec::new(),
            outlines: Vec::new(),
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
            self.report.add(&name, feature.place.clone(), kind, done);
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
        let index = self.structures.len();
        if let Some(why) = extent.missing {
            self.unknown.push((index, feature.place.clone(), why));
        }
        if feature.properties.get(PART_KEY).and_then(Value::as_str).is_some_and(|part| part != "no") {
            self.parts.push(index);
        } else {
            self.outlines.push((index, feature.place.clone()));
        }
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
            place: feature.place.clone(),
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
            self.report.add(&name, feature.place.clone(), kind, done);
        }
        self.zones.push(NoFlyZone { name, outline, floor_m, ceiling_m, source: ZoneSource::File });
        Ok(())
    }

    fn finish(mut self, file: &str, objects: usize) -> Result<(Scene, ImportReport), ImportError> {
        let structures = self.structures.len();
        if structures > 0 && self.unknown.len() == structures && self.settings.missing_heights == MissingHeights::Neighbours {
            return Err(ImportError::NoHeights { file: file.into(), structures });
        }
        let mut is_kept = vec![true; structures];
        self.fill_heights(&mut is_kept);
        self.drop_outlines(&mut is_kept);
        let mut kept = is_kept.into_iter();
        self.structures.retain(|_| kept.next().unwrap_or(true));
        if self.structures.is_empty() {
            return Err(ImportError::NoStructures { file: file.into(), objects, first: self.first_problem });
        }
        self.report.items.sort_by(|a, b| a.place.cmp(&b.place));
        Ok(assemble(file, self.frame, self.structures, self.zones, self.report))
    }

    /// Gives structures of unknown height one, as it is wanted.
    fn fill_heights(&mut self, is_kept: &mut [bool]) {
        let unknown = std::mem::take(&mut self.unknown);
        let mut is_known = vec![true; self.structures.len()];
        unknown.iter().for_each(|(index, ..)| is_known[*index] = false);
        let known = self.structures.iter().zip(is_known).filter(|(_, is_known)| *is_known);
        let known = KnownHeights::new(known.map(|(structure, _)| middle_and_height(&structure.bounds())));
        let ProxySettings { missing_heights, default_height_m, .. } = *self.settings;
        for (index, place, why) in unknown {
            let structure = &mut self.structures[index];
            let (middle, _) = middle_and_height(&structure.bounds());
            let guess = if missing_heights == MissingHeights::Neighbours { known.near(middle) } else { None };
            let (kind, done) = match (missing_heights, guess) {
                (MissingHeights::Drop, _) => {
                    is_kept[index] = false;
                    (ItemKind::HeightMissing, format!("{why}: left out"))
                }
                (_, Some(Guess { height_m, neighbours, within_m })) => {
                    set_height(&mut structure.shape, height_m);
                    let done = format!("{why}; taken to be {height_m:.1} m, the median of {neighbours} within {within_m} m");
                    (ItemKind::HeightGuessed, done)
                }
                (_, None) => (ItemKind::HeightGuessed, format!("{why}; taken to be {default_height_m} m")),
            };
            self.report.add(&structure.name, place, kind, done);
        }
    }

    /// An outline around parts is there for maps: where parts cover it, they say what stands there.
    fn drop_outlines(&mut self, is_kept: &mut [bool]) {
        let mut parts: Vec<(Bounds, &MultiPolygon<f64>)> = Vec::new();
        for structure in self.parts.iter().filter(|index| is_kept[**index]).map(|&index| &self.structures[index]) {
            if let Shape::Prism { footprint, .. } = &structure.shape {
                parts.push((structure.bounds(), footprint));
            }
        }
        parts.sort_by(|a, b| a.0.min.x.total_cmp(&b.0.min.x));
        let widest_m = parts.iter().map(|(bounds, _)| bounds.max.x - bounds.min.x).fold(0.0, f64::max);
        for (index, place) in &self.outlines {
            let structure = &self.structures[*index];
            let Shape::Prism { footprint, .. } = &structure.shape else { continue };
            let bounds = structure.bounds();
            let first = parts.partition_point(|(part, _)| part.min.x < bounds.min.x - widest_m);
            let near = parts[first..].iter().take_while(|(part, _)| part.min.x <= bounds.max.x);
            let beside = near.filter(|(part, _)| part.min.y <= bounds.max.y && part.max.y >= bounds.min.y);
            let mut bare = footprint.clone();
            let mut count = 0;
            for (_, part) in beside {
                // What only touches the outline is a part of another building.
                if part.intersection(footprint).unsigned_area() > 0.5 * part.unsigned_area() {
                    bare = bare.difference(*part);
                    count += 1;
                }
            }
            if count > 0 && bare.unsigned_area() <= (1.0 - PARTS_SHARE) * footprint.unsigned_area() {
                is_kept[*index] = false;
                let done = format!("{count} parts stand in its place");
                self.report.add(&structure.name, place.clone(), ItemKind::OutlineReplaced, done);
            }
        }
    }
}

fn middle_and_height(bounds: &Bounds) -> (Coord<f64>, f64) {
    let middle = nalgebra::center(&bounds.min, &bounds.max);
    (Coord { x: middle.x, y: middle.y }, bounds.max.z - bounds.min.z)
}

fn set_height(shape: &mut Shape, height_m: f64) {
    if let Shape::Prism { base_m, top_m, .. } = shape {
        *top_m = *base_m + height_m;
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
