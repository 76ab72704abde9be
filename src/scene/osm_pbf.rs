//! OpenStreetMap extracts in the PBF format: buildings and their parts, from ways and from multipolygons.
//!
//! The file is read three times, for relations, ways and nodes, because each refers to those that come before it: so only what belongs to buildings is
//! ever kept.

use std::collections::{HashMap, HashSet};
use std::io::Cursor;

use geo::{Area, Coord, LineString, Polygon};
use osmpbf::{Element, ElementReader, RelMemberType};
use serde_json::{Map, Value};

use super::anchor::Anchor;
use super::features::{self, Collection, Feature};
use super::footprint::RawPolygon;
use super::geojson::MOST_FEATURES;
use super::names::tidy;
use super::proxy::Scene;
use super::read::ImportError;
use super::report::{Format, ImportReport, ItemKind, Place};
use crate::settings::ProxySettings;

/// Corners of all buildings together.
const MOST_CORNERS: usize = 20_000_000;

/// Whether a file is one: its first block is called so, behind its length and a tag byte or two.
pub(crate) fn is_one(bytes: &[u8]) -> bool {
    bytes.get(..16).is_some_and(|head| head.windows(9).any(|part| part == b"OSMHeader"))
}

pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let mut found = Buildings::default();
    for pass in [Buildings::relation, Buildings::way, Buildings::node] {
        let read = ElementReader::new(Cursor::new(bytes)).for_each(|element| pass(&mut found, &element));
        read.map_err(|error| ImportError::Pbf { file: file.into(), what: tidy(&error.to_string()) })?;
        let buildings = found.relations.len() + found.ways.len();
        if buildings > MOST_FEATURES || found.corners > MOST_CORNERS {
            return Err(ImportError::TooManyFeatures { file: file.into(), features: buildings, most: MOST_FEATURES });
        }
    }
    let collection = Collection { format: Format::OsmPbf, features: found.features(), origin: None, crs: None };
    features::scene_of(file, collection, settings, anchor)
}

/// What belongs to buildings.
#[derive(Default)]
struct Buildings {
    relations: Vec<Multipolygon>,
    /// Ways that are buildings themselves, in the order of the file.
    ways: Vec<(i64, Map<String, Value>)>,
    /// The nodes of all ways that matter.
    nodes_of: HashMap<i64, Vec<i64>>,
    /// Ways that relations refer to.
    members: HashSet<i64>,
    needed: HashSet<i64>,
    corners: usize,
    places: HashMap<i64, Coord<f64>>,
}

struct Multipolygon {
    id: i64,
    properties: Map<String, Value>,
    outer: Vec<i64>,
    inner: Vec<i64>,
}

impl Buildings {
    fn relation(&mut self, element: &Element) {
        let Element::Relation(relation) = element else { return };
        let Some(properties) = building(relation.tags()) else { return };
        let is_multipolygon = relation.tags().any(|(key, value)| key == "type" && value == "multipolygon");
        // Relations of the type `building` only say which parts belong together.
        if !is_multipolygon || self.relations.len() > MOST_FEATURES {
            return;
        }
        let (mut outer, mut inner) = (Vec::new(), Vec::new());
        for member in relation.members().filter(|member| member.member_type == RelMemberType::Way) {
            let list = if member.role().is_ok_and(|role| role == "inner") { &mut inner } else { &mut outer };
            list.push(member.member_id);
            self.corners += 1;
            self.members.insert(member.member_id);
        }
        self.relations.push(Multipolygon { id: relation.id(), properties, outer, inner });
    }

    fn way(&mut self, element: &Element) {
        let Element::Way(way) = element else { return };
        let properties = building(way.tags());
        if (properties.is_none() && !self.members.contains(&way.id()))
            || self.ways.len() > MOST_FEATURES
            || self.corners > MOST_CORNERS
        {
            return;
        }
        let nodes: Vec<i64> = way.refs().collect();
        self.corners += nodes.len();
        self.needed.extend(&nodes);
        self.nodes_of.insert(way.id(), nodes);
        self.ways.extend(properties.map(|properties| (way.id(), properties)));
    }

    fn node(&mut self, element: &Element) {
        let (id, lon, lat) = match element {
            Element::Node(node) => (node.id(), node.lon(), node.lat()),
            Element::DenseNode(node) => (node.id(), node.lon(), node.lat()),
            _ => return,
        };
        if self.needed.contains(&id) {
            self.places.insert(id, Coord { x: lon, y: lat });
        }
    }

    fn features(self) -> Vec<Feature> {
        let Self { relations, ways, nodes_of, places, .. } = &self;
        let of_way = |(id, properties): &(i64, Map<String, Value>)| {
            let nodes = &nodes_of[id];
            let ring = ring(nodes, places);
            let missing = nodes.len() - ring.len();
            feature(
                format!("way/{id}"),
                properties,
                polygons(vec![ring], Vec::new()),
                (missing > 0).then(|| format!("{missing} of its nodes are not in the file")),
            )
        };
        let of_relation = |relation: &Multipolygon| {
            let Multipolygon { id, properties, outer, inner } = relation;
            let (outer, gaps) = rings(outer, nodes_of);
            let (inner, more) = rings(inner, nodes_of);
            let [outer, inner]: [Vec<Vec<Coord<f64>>>; 2] =
                [outer, inner].map(|rings| rings.iter().map(|nodes| ring(nodes, places)).collect());
            let gaps = gaps + more;
            let fault = (gaps > 0).then(|| format!("{gaps} of its ways are not in the file or close no ring"));
            feature(format!("relation/{id}"), properties, polygons(outer, inner), fault)
        };
        ways.iter().map(of_way).chain(relations.iter().map(of_relation)).collect()
    }
}

/// The properties of a building or of a part of one that stands above the ground.
fn building<'a>(tags: impl Iterator<Item = (&'a str, &'a str)>) -> Option<Map<String, Value>> {
    let (mut is_building, mut is_below) = (false, false);
    let mut properties = Map::new();
    for (key, value) in tags {
        is_building |= matches!(key, "building" | "building:part") && value != "no";
        is_below |= key == "location" && value == "underground";
        if features::is_key(key) {
            properties.insert(key.to_owned(), Value::from(value));
        }
    }
    (is_building && !is_below).then_some(properties)
}

fn feature(name: String, properties: &Map<String, Value>, polygons: Vec<RawPolygon>, fault: Option<String>) -> Feature {
    Feature {
        place: Place::Object(name.clone()),
        name,
        zone: false,
        properties: properties.clone(),
        missing: fault.clone().unwrap_or_else(|| "it has no ring".to_owned()).into(),
        repairs: fault.into_iter().map(|fault| (ItemKind::PartsDropped, fault)).collect(),
        polygons,
    }
}

fn ring(nodes: &[i64], places: &HashMap<i64, Coord<f64>>) -> Vec<Coord<f64>> {
    nodes.iter().filter_map(|node| places.get(node).copied()).collect()
}

/// Closed rings of ways that follow one another by their end nodes, and how many ways are missing or left over.
fn rings(ways: &[i64], nodes_of: &HashMap<i64, Vec<i64>>) -> (Vec<Vec<i64>>, usize) {
    let mut left: Vec<&[i64]> =
        ways.iter().filter_map(|way| nodes_of.get(way)).map(Vec::as_slice).filter(|nodes| nodes.len() > 1).collect();
    let mut gaps = ways.len() - left.len();
    let mut rings = Vec::new();
    while let Some(first) = left.pop() {
        let (mut ring, mut used) = (first.to_vec(), 1);
        while ring.first() != ring.last() {
            let end = ring[ring.len() - 1];
            let Some(next) = left.iter().position(|nodes| nodes[0] == end || nodes[nodes.len() - 1] == end) else { break };
            let nodes = left.swap_remove(next);
            if nodes[0] == end {
                ring.extend(&nodes[1..])
            } else {
                ring.extend(nodes.iter().rev().skip(1))
            }
            used += 1;
        }
        if ring.first() == ring.last() { rings.push(ring) } else { gaps += used }
    }
    (rings, gaps)
}

/// A ring as footprints have it: the ways of OpenStreetMap run as they were drawn.
fn wound(mut ring: Vec<Coord<f64>>, is_hole: bool) -> Vec<Coord<f64>> {
    let area = Polygon::new(LineString(ring.clone()), Vec::new()).signed_area();
    if area < 0.0 && !is_hole || area > 0.0 && is_hole {
        ring.reverse();
    }
    ring
}

/// Polygons of outer rings, each with the inner rings that begin within it.
fn polygons(outer: Vec<Vec<Coord<f64>>>, inner: Vec<Vec<Coord<f64>>>) -> Vec<RawPolygon> {
    let mut polygons: Vec<RawPolygon> = outer.into_iter().map(|ring| vec![wound(ring, false)]).collect();
    for hole in inner {
        let Some(corner) = hole.first() else { continue };
        let around = polygons.iter_mut().find(|rings| is_within(&rings[0], corner));
        around.into_iter().for_each(|rings| rings.push(wound(hole.clone(), true)));
    }
    polygons
}

fn is_within(ring: &[Coord<f64>], corner: &Coord<f64>) -> bool {
    use geo::Intersects;
    Polygon::new(LineString(ring.to_vec()), Vec::new()).intersects(corner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_make_rings_in_whatever_order_and_direction() {
        let nodes_of: HashMap<i64, Vec<i64>> =
            [(1, vec![10, 11, 12]), (2, vec![14, 13, 12]), (3, vec![14, 10]), (4, vec![20, 21, 22, 20]), (5, vec![30, 31])]
                .into();
        let (mut found, gaps) = rings(&[1, 4, 3, 2, 5, 6], &nodes_of);
        found.iter_mut().for_each(|ring| {
            ring.pop();
            ring.sort_unstable();
        });
        found.sort();
        // Way 5 closes no ring, way 6 is not there.
        assert_eq!((found, gaps), (vec![vec![10, 11, 12, 13, 14], vec![20, 21, 22]], 2));
    }

    #[test]
    fn what_is_a_building_above_the_ground() {
        let is_one = |tags: &[(&str, &str)]| building(tags.iter().copied()).is_some();
        assert!(is_one(&[("building", "yes"), ("height", "9")]) && is_one(&[("building:part", "roof")]));
        assert!(!is_one(&[("building", "no")]) && !is_one(&[("height", "9")]));
        assert!(!is_one(&[("building", "yes"), ("location", "underground")]));
        let properties = building([("building", "yes"), ("height", "9"), ("name", "Hall")].into_iter()).unwrap();
        assert_eq!(Value::Object(properties), serde_json::json!({ "height": "9" }));
    }

    #[test]
    fn holes_go_to_the_outline_around_them() {
        let square = |x: f64, side: f64| {
            [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[dx, dy]| Coord { x: x + dx, y: dy + 0.1 }).to_vec()
        };
        let found = polygons(vec![square(0.0, 4.0), square(10.0, 4.0)], vec![square(11.0, 1.0)]);
        assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [1, 2]);
    }
}
