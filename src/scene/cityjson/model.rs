//! A CityJSON file as it is taken in, piece by piece.

use std::collections::BTreeMap;

use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use crate::scene::json::{Intake, Into, Scalar};
use crate::scene::names::tidy;

#[derive(Default, Deserialize)]
pub struct CityModel {
    #[serde(default)]
    pub version: Scalar,
    #[serde(default)]
    pub metadata: Metadata,
    pub transform: Option<Transform>,
    #[serde(rename = "CityObjects", default)]
    pub objects: BTreeMap<String, CityObject>,
    #[serde(default)]
    pub vertices: Vec<[f64; 3]>,
}

#[derive(Default)]
pub struct Metadata {
    pub reference_system: Scalar,
}

#[derive(Deserialize)]
pub struct Transform {
    pub scale: [f64; 3],
    pub translate: [f64; 3],
}

#[derive(Deserialize)]
pub struct CityObject {
    #[serde(rename = "type", default)]
    pub kind: String,
    #[serde(default)]
    pub geometry: Geometries,
    pub parents: Option<Vec<String>>,
}

/// The geometries of an object that name their level of detail; the others are never used.
#[derive(Default)]
pub struct Geometries(pub Vec<CityGeometry>);

pub struct CityGeometry {
    pub kind: String,
    pub level: f64,
    pub boundaries: Boundaries,
}

/// Nested lists of vertex indices.
#[derive(Default)]
pub struct Boundaries {
    pub root: Lists,
    /// The first thing that is neither a list nor an index.
    pub bad: Option<String>,
}

pub enum Lists {
    Ring(Vec<u32>),
    Nested(Vec<Lists>),
}

impl Default for Lists {
    fn default() -> Self {
        Self::Nested(Vec::new())
    }
}

impl Lists {
    /// Counts the vertices from `first` on. What lies beyond all numbers stays beyond all vertices.
    pub fn renumber(&mut self, first: u32) {
        match self {
            Self::Ring(ring) => ring.iter_mut().for_each(|index| *index = index.saturating_add(first)),
            Self::Nested(parts) => parts.iter_mut().for_each(|part| part.renumber(first)),
        }
    }

    pub fn parts(&self) -> &[Lists] {
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

pub fn read_into<'de, T: Intake + Default, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
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
pub struct GeometryReader {
    pub kind: String,
    pub level: Option<f64>,
    pub boundaries: Boundaries,
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
pub struct ListReader<'a> {
    pub lists: &'a mut Lists,
    pub bad: &'a mut Option<String>,
    pub number: Option<f64>,
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

/// The level of detail as a number: 2, "2" and "2.2" occur.
pub fn level(lod: &Value) -> Option<f64> {
    let level = match lod {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().parse().ok(),
        _ => None,
    };
    level.filter(|level: &f64| level.is_finite())
}
