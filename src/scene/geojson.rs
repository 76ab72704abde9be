//! GeoJSON footprints with heights (RFC 7946, WGS84).
//!
//! A feature is a structure; a feature with the property `"overfly": "no-fly"` is a zone that must not be entered, from
//! `min_height` (the ground when missing) to `height` (no ceiling when missing). A foreign member `overfly_origin` of the
//! collection fixes the origin of the local frame; otherwise it is the middle of the box around the structures.

mod document;

use serde_json::Value;

use self::document::{Root, parse};
use super::anchor::Anchor;
use super::crs;
use super::features::{self, Collection};
use super::names;
use super::proxy::Scene;
use super::read::ImportError;
use super::report::{Format, ImportReport};
use crate::settings::ProxySettings;

/// Files of more features are refused.
pub(crate) const MOST_FEATURES: usize = 250_000;

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let root = parse(bytes).map_err(|source| ImportError::Json { file: file.into(), source })?;
    check(file, &root)?;
    let Root { features, origin, crs_name, .. } = root;
    let crs = crs_name.map(|name| (crs::epsg_code(&Value::from(name.as_str())), name));
    let collection = Collection { format: Format::GeoJson, features, origin: origin.place(), crs };
    features::scene_of(file, collection, settings, anchor)
}

/// Whether a file is a collection of features that can be read as they are meant.
fn check(file: &str, root: &Root) -> Result<(), ImportError> {
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
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
