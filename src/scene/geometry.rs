//! The polygons of a GeoJSON geometry, read without storing the rest of it.

use geo::Coord;
use serde::de::{IgnoredAny, MapAccess, SeqAccess};

use super::footprint::RawPolygon;
use super::json::{Intake, Into, Scalar};
use super::names::tidy;

/// Lists and positions that are stored of one geometry; ten times what any usable footprint has.
const MOST_NODES: usize = 20_000;

/// Names of other geometries that are kept for the report.
const MOST_OTHERS: usize = 8;

/// What a geometry holds. Coordinates are as they stand in the file, degrees: x longitude, y latitude.
#[derive(Default)]
pub(crate) struct Parts {
    pub polygons: Vec<RawPolygon>,
    /// How many polygons the file gives; more than `polygons` when some are damaged.
    pub given: usize,
    /// The types of what is no polygon, the first few.
    pub others: Vec<&'static str>,
    /// Whether positions have a third coordinate.
    pub elevations: bool,
    /// What is wrong with the first damaged part.
    pub damage: Option<String>,
}

impl Parts {
    fn append(&mut self, other: Self) {
        self.polygons.extend(other.polygons);
        self.given += other.given;
        let room = MOST_OTHERS - self.others.len();
        self.others.extend(other.others.into_iter().take(room));
        self.elevations |= other.elevations;
        self.damage = self.damage.take().or(other.damage);
    }
}

/// A geometry while it is read: the order of its members is free, so the coordinates are known before their meaning.
pub(crate) struct Draft {
    kind: Option<String>,
    coordinates: Node,
    members: Parts,
    nodes_left: usize,
    /// Whether anything stood there but null.
    present: bool,
}

impl Default for Draft {
    fn default() -> Self {
        Self { kind: None, coordinates: Node::Junk, members: Parts::default(), nodes_left: MOST_NODES, present: false }
    }
}

impl Draft {
    pub fn set_kind(&mut self, kind: Option<String>) {
        self.kind = kind;
    }

    /// What the geometry holds; `None` for null and no geometry at all.
    pub fn finish(self) -> Option<Parts> {
        self.present.then(|| self.parts())
    }

    fn parts(self) -> Parts {
        let overfull = self.nodes_left == 0;
        let kind = self.kind.unwrap_or_default();
        let mut parts = Parts::default();
        match (kind.as_str(), self.coordinates) {
            ("Polygon", coordinates) => parts.add_polygon(&coordinates),
            ("MultiPolygon", Node::List(polygons)) => polygons.iter().for_each(|polygon| parts.add_polygon(polygon)),
            ("MultiPolygon", coordinates) => parts.add_polygon(&coordinates),
            ("GeometryCollection", _) => parts.append(self.members),
            (kind, _) => match OTHERS.iter().find(|other| **other == kind) {
                Some(other) => parts.others.push(other),
                None => parts.damage = Some(format!("its geometry is of the unknown type {:?}", tidy(kind))),
            },
        }
        if overfull {
            let damage = format!("it has more than {MOST_NODES} corners; simplify it");
            return Parts { given: parts.given.max(1), damage: Some(damage), ..Parts::default() };
        }
        parts
    }
}

const OTHERS: [&str; 4] = ["Point", "MultiPoint", "LineString", "MultiLineString"];

impl Parts {
    fn add_polygon(&mut self, polygon: &Node) {
        self.given += 1;
        let mut elevations = false;
        match rings(polygon, &mut elevations) {
            Ok(rings) => self.polygons.push(rings),
            Err(damage) => self.damage = self.damage.take().or_else(|| Some(damage.into())),
        }
        self.elevations |= elevations;
    }
}

fn rings(polygon: &Node, elevations: &mut bool) -> Result<RawPolygon, &'static str> {
    const NO_RINGS: &str = "its coordinates are no lists of positions";
    let Node::List(rings) = polygon else { return Err(NO_RINGS) };
    let ring = |ring: &Node| {
        let Node::List(positions) = ring else { return Err(NO_RINGS) };
        positions.iter().map(|position| corner(position, elevations)).collect()
    };
    rings.iter().map(ring).collect()
}

fn corner(position: &Node, elevations: &mut bool) -> Result<Coord<f64>, &'static str> {
    match *position {
        Node::Position { at, numbers } if numbers >= 2 => {
            *elevations |= numbers > 2;
            Ok(at)
        }
        _ => Err("a position is not made of at least two numbers"),
    }
}

/// A value within the coordinates.
enum Node {
    /// A list of numbers, of which only the first two are kept.
    Position {
        at: Coord<f64>,
        numbers: usize,
    },
    List(Vec<Node>),
    Number(f64),
    Junk,
}

/// A value within the coordinates while it is read.
struct Coordinates<'a> {
    node: Node,
    nodes_left: &'a mut usize,
}

impl Intake for Coordinates<'_> {
    fn list(&mut self) {
        self.node = Node::List(Vec::new());
    }

    fn number(&mut self, number: f64) {
        self.node = Node::Number(number);
    }

    fn element<'de, A: SeqAccess<'de>>(&mut self, list: &mut A) -> Result<bool, A::Error> {
        let mut element = Coordinates { node: Node::Junk, nodes_left: self.nodes_left };
        if list.next_element_seed(Into(&mut element))?.is_none() {
            return Ok(false);
        }
        let element = element.node;
        match (&mut self.node, element) {
            (Node::Position { at, numbers }, Node::Number(number)) => {
                if *numbers == 1 {
                    at.y = number;
                }
                *numbers += 1;
            }
            (Node::List(nodes), Node::Number(number)) if nodes.is_empty() => {
                self.node = Node::Position { at: Coord { x: number, y: 0.0 }, numbers: 1 };
            }
            (Node::List(nodes), element) if !matches!(element, Node::Number(_)) => {
                if *self.nodes_left > 0 {
                    *self.nodes_left -= 1;
                    nodes.push(element);
                }
            }
            // Numbers and lists in one list make neither a position nor a ring.
            _ => self.node = Node::Junk,
        }
        Ok(true)
    }
}

impl Intake for Draft {
    fn object(&mut self) {
        self.present = true;
    }

    fn list(&mut self) {
        self.present = true;
    }

    fn number(&mut self, _: f64) {
        self.present = true;
    }

    fn member<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<(), A::Error> {
        match key {
            "type" => self.kind = members.next_value::<Scalar>()?.text().map(str::to_owned),
            "coordinates" => {
                let mut coordinates = Coordinates { node: Node::Junk, nodes_left: &mut self.nodes_left };
                members.next_value_seed(Into(&mut coordinates))?;
                self.coordinates = coordinates.node;
            }
            "geometries" => members.next_value_seed(Into(&mut Geometries(self)))?,
            _ => drop(members.next_value::<IgnoredAny>()?),
        }
        Ok(())
    }
}

struct Geometries<'a>(&'a mut Draft);

impl Intake for Geometries<'_> {
    fn element<'de, A: SeqAccess<'de>>(&mut self, list: &mut A) -> Result<bool, A::Error> {
        let mut draft = Draft { nodes_left: self.0.nodes_left, ..Draft::default() };
        if list.next_element_seed(Into(&mut draft))?.is_none() {
            return Ok(false);
        }
        self.0.nodes_left = draft.nodes_left.saturating_sub(1);
        if self.0.nodes_left > 0 {
            self.0.members.append(draft.parts());
        }
        Ok(true)
    }
}
