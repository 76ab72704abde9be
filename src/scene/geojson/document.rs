//! A GeoJSON file as it is taken in, piece by piece.

use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess};
use serde_json::{Map, Value};

use super::MOST_FEATURES;
use crate::frame::Geodetic;
use crate::scene::features::{self, Feature};
use crate::scene::geometry::{Draft, Parts};
use crate::scene::json::{Intake, Into, Scalar};
use crate::scene::names;
use crate::scene::report::{ItemKind, Place};

/// What is asked of a file.
#[derive(Default)]
pub struct Root {
    pub kind: Option<String>,
    /// The features of a collection, or the one of a file that is a feature or a geometry.
    pub features: Vec<Feature>,
    /// How many elements `features` has; `None` where it is missing or no list.
    pub listed: Option<usize>,
    pub crs_name: Option<String>,
    pub origin: Origin,
    /// The first value of the property `overfly` that is not known, and the feature that has it.
    pub unknown_mark: Option<(usize, String, String)>,
}

pub fn parse(bytes: &[u8]) -> Result<Root, serde_json::Error> {
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
pub struct RootReader {
    pub root: Root,
    pub feature: FeatureReader,
    pub geometry: Draft,
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

pub struct Features<'a>(pub &'a mut Root);

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
pub struct FeatureReader {
    pub id: Option<Value>,
    pub properties: Map<String, Value>,
    pub geometry: Draft,
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

pub struct Properties<'a>(pub &'a mut Map<String, Value>);

impl Intake for Properties<'_> {
    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        if key == MARK || features::is_key(key) || names::is_key(key) {
            self.0.insert(key.to_owned(), members.next_value::<Scalar>()?.0);
        } else {
            members.next_value::<IgnoredAny>()?;
        }
        Ok(())
    }
}

/// The name within `crs`, which old files have.
pub struct Crs<'a>(pub &'a mut Option<String>);

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
pub struct Origin(pub [Option<f64>; 3]);

impl Origin {
    pub fn place(&self) -> Option<Geodetic> {
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
pub const MARK: &str = "overfly";
pub const NO_FLY: &str = "no-fly";

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
            place: Place::Feature(index),
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

/// Hands the parts of a geometry to its feature, with a word on what is not used.
pub fn collect(parts: Parts, feature: &mut Feature) {
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
