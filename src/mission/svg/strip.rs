//! `flight.svg`: a flight that goes on while the scene changes. One picture from above for each stretch of it, to one scale: what was flown, where the
//! aircraft is, and what it is going to fly now.

use nalgebra::Point3;
use overfly_table::FieldTable;
use svg::Document;
use svg::node::element::Group;

use super::colour::{self, AHEAD, FLOWN, HEIGHT, NEW, ZONE};
use super::flight::timed_path;
use super::pen::{self, Anchor, Place};
use super::plain_view::PlainView;
use crate::trajectory::plan::Plan;

/// What a picture shows: the scene and the flight at the moment at which a plan came.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// What has happened, in a few words.
    pub title: String,
    /// Figures below it.
    pub caption: String,
    pub buildings: Vec<Building>,
    /// No-fly zones as rings, m.
    pub zones: Vec<Vec<[f64; 2]>>,
    /// What was flown before, m.
    pub flown: Vec<Point3<f64>>,
    /// What is flown from here on, m.
    pub ahead: Vec<Point3<f64>>,
}

/// A structure from above.
#[derive(Clone, Debug)]
pub struct Building {
    pub rings: Vec<Vec<[f64; 2]>>,
    pub top_m: f64,
    /// It is what has changed.
    pub is_new: bool,
}

const ACROSS: usize = 2;
const WIDTH: f64 = 1600.0;
const MARGIN: f64 = 48.0;
const GAP: f64 = 40.0;
const HEADING: f64 = 96.0;
/// Room for the words over each picture.
const WORDS: f64 = 64.0;

impl Stretch {
    /// The scene as its field shows it, with the structure called `changed` marked, and a plan in it.
    pub fn new(
        title: String,
        caption: String,
        field: &FieldTable,
        changed: Option<&str>,
        flown: &[Point3<f64>],
        plan: &Plan,
    ) -> Self {
        let building = |structure| Building {
            rings: field.outline(structure).map(<[[f64; 2]]>::to_vec).collect(),
            top_m: structure.top_m,
            is_new: changed.is_some_and(|name| field.name(structure) == name),
        };
        let buildings = field.structures.iter().map(building).collect();
        Self { title, caption, buildings, zones: Vec::new(), flown: flown.to_vec(), ahead: flown_until(plan, f64::INFINITY) }
    }
}

/// The points of a plan's curve that are passed until a time.
pub fn flown_until(plan: &Plan, time_s: f64) -> Vec<Point3<f64>> {
    let passed = timed_path(plan).into_iter().take_while(|instant| instant.time_s <= time_s);
    passed.map(|instant| instant.position_m).collect()
}

/// The file's content.
pub fn to_bytes(title: &str, stretches: &[Stretch]) -> Vec<u8> {
    let scale = scale(stretches);
    let rows = stretches.len().div_ceil(ACROSS);
    let height = HEADING + rows as f64 * (scale.height + WORDS + GAP) + MARGIN;
    let legend = "Grey: flown. Violet: ahead. Dot: the aircraft. Orange: what has changed. Red: a no-fly zone.";
    let document = Document::new()
        .set("viewBox", (0, 0, WIDTH as u32, height.ceil() as u32))
        .set("width", WIDTH)
        .set("height", height.ceil())
        .set("font-family", pen::FONT)
        .add(pen::rectangle([0.0, 0.0], [WIDTH, height.ceil()], colour::PAPER))
        .add(pen::text([MARGIN, 48.0], 28.0, Anchor::Start, title).set("font-weight", 700))
        .add(pen::quiet_text([MARGIN, 76.0], 15.0, Anchor::Start, legend));
    let pictures = stretches.iter().enumerate().map(|(index, stretch)| picture(&scale, index, stretch));
    format!("{}\n", pictures.fold(document, Document::add)).into_bytes()
}

fn picture(scale: &PlainView, index: usize, stretch: &Stretch) -> Group {
    let corner = corner(scale, index);
    let project = |point: &Point3<f64>| scale.at(corner, [point.x, point.y]);
    let ring = |ring: &Vec<[f64; 2]>| pen::ring(ring.iter().map(|place| scale.at(corner, *place)));
    let top_m = stretch.buildings.iter().map(|building| building.top_m).fold(1.0, f64::max);
    let mut group = pen::group(&format!("stretch-{}", index + 1))
        .add(pen::text([corner[0], corner[1] - 32.0], 18.0, Anchor::Start, &stretch.title).set("font-weight", 600))
        .add(pen::quiet_text([corner[0], corner[1] - 12.0], 14.0, Anchor::Start, &stretch.caption))
        .add(pen::rectangle(corner, [scale.width, scale.height], colour::GROUND).set("stroke", colour::HAIRLINE));
    // An obstacle may stand over a roof: what is new is drawn on top.
    let (new, old): (Vec<&Building>, Vec<_>) = stretch.buildings.iter().partition(|building| building.is_new);
    for building in old.into_iter().chain(new) {
        let data: String = building.rings.iter().map(ring).collect();
        let fill = if building.is_new { NEW.to_owned() } else { HEIGHT.at(building.top_m / top_m) };
        let path = pen::stroke(data, colour::OUTLINE, 0.8).set("fill", fill).set("fill-rule", "evenodd");
        group = group.add(path);
    }
    for zone in &stretch.zones {
        group = group
            .add(pen::stroke(ring(zone), ZONE, 1.6).set("fill", ZONE).set("fill-opacity", 0.14).set("stroke-dasharray", "6 4"));
    }
    group = group
        .add(pen::stroke(pen::polyline(stretch.flown.iter().map(project)), FLOWN, 2.4))
        .add(pen::stroke(pen::polyline(stretch.ahead.iter().map(project)), colour::PAPER, 4.2).set("stroke-opacity", 0.85))
        .add(pen::stroke(pen::polyline(stretch.ahead.iter().map(project)), AHEAD, 2.2));
    match stretch.ahead.first() {
        Some(here) => group.add(pen::circle(project(here), 7.0, colour::INK).set("stroke", colour::PAPER).set("stroke-width", 2)),
        None => group,
    }
}

/// How metres become pixels, in all pictures alike.
fn scale(stretches: &[Stretch]) -> PlainView {
    let corners = stretches.iter().flat_map(|stretch| &stretch.buildings).flat_map(|building| building.rings.iter().flatten());
    let zones = stretches.iter().flat_map(|stretch| stretch.zones.iter().flatten());
    let paths = stretches.iter().flat_map(|stretch| stretch.flown.iter().chain(&stretch.ahead)).map(|point| [point.x, point.y]);
    let width = (WIDTH - 2.0 * MARGIN - GAP * (ACROSS - 1) as f64) / ACROSS as f64;
    PlainView::over(corners.chain(zones).copied().chain(paths), width)
}

/// The upper left corner of a picture.
fn corner(scale: &PlainView, index: usize) -> Place {
    let (column, row) = ((index % ACROSS) as f64, (index / ACROSS) as f64);
    [MARGIN + column * (scale.width + GAP), HEADING + WORDS + row * (scale.height + WORDS + GAP)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stretch(title: &str) -> Stretch {
        let square = |x: f64| vec![[x, 0.0], [x + 10.0, 0.0], [x + 10.0, 20.0], [x, 20.0]];
        Stretch {
            title: title.to_owned(),
            caption: "40 s".to_owned(),
            buildings: vec![
                Building { rings: vec![square(30.0)], top_m: 30.0, is_new: true },
                Building { rings: vec![square(0.0)], top_m: 12.0, is_new: false },
            ],
            zones: vec![square(60.0)],
            flown: vec![Point3::new(-5.0, -5.0, 30.0), Point3::new(20.0, -5.0, 30.0)],
            ahead: vec![Point3::new(20.0, -5.0, 30.0), Point3::new(55.0, 30.0, 30.0)],
        }
    }

    #[test]
    fn every_stretch_has_a_picture_with_all_that_it_shows() {
        let svg = String::from_utf8(to_bytes("A flight", &["one", "two", "three"].map(stretch))).unwrap();
        let document = roxmltree::Document::parse(&svg).unwrap();
        for (number, title) in ["one", "two", "three"].into_iter().enumerate() {
            let id = format!("stretch-{}", number + 1);
            let group = document.descendants().find(|node| node.attribute("id") == Some(&id)).unwrap();
            assert!(group.descendants().any(|node| node.text().is_some_and(|text| text.trim() == title)));
            let fills = |fill: &str| group.descendants().filter(|node| node.attribute("fill") == Some(fill)).count();
            assert_eq!((fills(NEW), fills(ZONE)), (1, 1));
            let strokes = |colour: &str| group.descendants().filter(|node| node.attribute("stroke") == Some(colour)).count();
            assert_eq!((strokes(FLOWN), strokes(AHEAD)), (1, 1));
            let mut buildings = group.descendants().filter(|node| node.attribute("stroke") == Some(colour::OUTLINE));
            assert_eq!(buildings.next_back().and_then(|node| node.attribute("fill")), Some(NEW), "nothing hides what is new");
        }
    }

    #[test]
    fn no_stretch_is_a_picture_too() {
        assert!(!to_bytes("nothing", &[]).is_empty());
    }
}
