//! A scene as GeoJSON.

use geo::{Coord, MultiPolygon};
use nalgebra::Point3;
use serde_json::{Map, Value, json};

use super::proxy::Scene;
use crate::frame::{Geodetic, LocalFrame};

/// The scene as a GeoJSON FeatureCollection that [`super::read()`] reads back: the same structures for prisms; a mesh is written as
/// the prism over its outline. GeoJSON has flat ground: the terrain is left out, and heights stay those above z = 0. A scene without
/// georeference is written around latitude 0, longitude 0.
pub fn to_geojson(scene: &Scene) -> String {
    let origin = scene.frame.origin.unwrap_or(Geodetic { lat_deg: 0.0, lon_deg: 0.0, alt_m: 0.0 });
    let frame = LocalFrame { origin: Some(origin) };
    let mut features = Vec::with_capacity(scene.structures.len() + scene.zones.len());
    for structure in scene.structures.iter().filter(|structure| structure.terrain().is_none()) {
        let bounds = structure.bounds();
        let mut properties = Map::new();
        properties.insert("id".into(), json!(structure.name));
        properties.insert("height".into(), json!(bounds.max.z));
        if bounds.min.z > 0.0 {
            properties.insert("min_height".into(), json!(bounds.min.z));
        }
        features.push(feature(properties, &structure.outlines(), &frame));
    }
    // A zone without an outline lies far away: there is nothing to write.
    for zone in scene.zones.iter().filter(|zone| !zone.outline.0.is_empty()) {
        let mut properties = Map::new();
        properties.insert("id".into(), json!(zone.name));
        properties.insert("overfly".into(), json!("no-fly"));
        properties.insert("min_height".into(), json!(zone.floor_m));
        if zone.ceiling_m < f64::MAX {
            properties.insert("height".into(), json!(zone.ceiling_m));
        }
        features.push(feature(properties, &zone.outline, &frame));
    }
    json!({ "type": "FeatureCollection", "name": scene.name, "overfly_origin": origin, "features": features }).to_string()
}

fn feature(properties: Map<String, Value>, outline: &MultiPolygon<f64>, frame: &LocalFrame) -> Value {
    let polygons: Vec<Value> = outline
        .iter()
        .map(|polygon| {
            let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors());
            rings.map(|ring| ring.0.iter().map(|corner| position(corner, frame)).collect::<Value>()).collect()
        })
        .collect();
    let geometry = match &polygons[..] {
        [polygon] => json!({ "type": "Polygon", "coordinates": polygon }),
        polygons => json!({ "type": "MultiPolygon", "coordinates": polygons }),
    };
    json!({ "type": "Feature", "properties": properties, "geometry": geometry })
}

fn position(corner: &Coord<f64>, frame: &LocalFrame) -> Value {
    match frame.geodetic_from_local(&Point3::new(corner.x, corner.y, 0.0)) {
        Some(place) => json!([place.lon_deg, place.lat_deg]),
        None => Value::Null,
    }
}
