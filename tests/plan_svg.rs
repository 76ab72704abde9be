//! `plan.svg` is well-formed, to scale, small, and shows for each wall the share that a plain count gives.

mod block;

use nalgebra::{Unit, Vector3};
use overfly::camera::Intrinsics;
use overfly::mission::svg::walls::{self, Tally};
use overfly::mission::svg::{self, SvgError};
use overfly::trajectory::plan::Plan;
use overfly_table::{Block, FieldTable};
use roxmltree::{Document, Node};

#[test]
fn the_sheet_of_a_city_is_well_formed_and_small() {
    let blocks = block::field(&block::city(17, 18));
    let text = draw(&blocks);
    let document = Document::parse(&text).unwrap();
    assert_eq!(by_id(&document, "buildings").children().filter(Node::is_element).count(), 17 * 18);
    assert!(text.len() < 1_500_000, "{} bytes", text.len());
}

#[test]
fn names_that_are_markup_or_control_characters_do_no_harm() {
    let name = "<a href=\"x\">&amp;\u{1}\u{0}</a>";
    let blocks = block::field(&[block::box_building(name, [0.0, 0.0], [20.0, 20.0], 12.0)]);
    let text = draw(&blocks);
    let document = Document::parse(&text).unwrap();
    let title = by_id(&document, "buildings").descendants().find(|node| node.has_tag_name("title")).unwrap();
    assert!(title.text().unwrap().starts_with("<a href=\"x\">&amp;\u{fffd}\u{fffd}</a>: 0.0 m to 12.0 m"), "{title:?}");
}

#[test]
fn a_building_of_100_m_measures_100_m_by_the_scale_bar_in_both_views() {
    let blocks = block::field(&[block::box_building("long", [-20.0, 5.0], [80.0, 45.0], 40.0)]);
    let text = draw(&blocks);
    let document = Document::parse(&text).unwrap();

    let bar = by_id(&document, "scale-bar");
    let metres: f64 = number(bar, "data-metres");
    let pixels: f64 = bar.children().filter(|node| node.has_tag_name("rect")).map(|part| number(part, "width")).sum();
    let pixels_per_m = pixels / metres;

    let outline = by_id(&document, "buildings").first_element_child().unwrap().attribute("d").unwrap();
    let places = places(outline);
    let extent = |axis: usize| {
        let values = places.iter().map(|place| place[axis]);
        values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
    };
    assert_near(extent(0) / pixels_per_m, 100.0);
    assert_near(extent(1) / pixels_per_m, 40.0);

    let elevation = by_id(&document, "side-view")
        .descendants()
        .find(|node| node.has_tag_name("rect") && node.children().any(|child| child.has_tag_name("title")))
        .unwrap();
    assert_near(number(elevation, "width") / pixels_per_m, 100.0);
    assert_near(number(elevation, "height") / pixels_per_m, 40.0);
}

#[test]
fn every_wall_and_roof_shows_the_share_of_a_plain_count() {
    let buildings = block::city(4, 5);
    let blocks = block::field(&buildings);
    let field = FieldTable::open(&blocks, &[]).unwrap();
    let plan = block::plan(&field);
    let tallies = walls::tally(&field, &plan);

    let mut counted = 0;
    for (structure, building) in buildings.iter().enumerate() {
        for (ring, points) in building.rings.iter().enumerate() {
            for edge in 0..points.len() {
                let (from, to) = (points[edge], points[(edge + 1) % points.len()]);
                let expected = count(&field, &plan.cells, |index| {
                    let sample = &field.samples[index];
                    let faces_sideways = sample.normal[2] == 0.0;
                    sample.structure as usize == structure && faces_sideways && lies_between(sample.position_m, from, to)
                });
                assert_eq!(tallies[structure].walls[ring][edge], expected, "{} ring {ring} edge {edge}", building.name);
                counted += expected.exposed;
            }
        }
        let roof = count(&field, &plan.cells, |index| {
            let sample = &field.samples[index];
            sample.structure as usize == structure && sample.normal[2] == 1.0
        });
        assert_eq!(tallies[structure].roof, roof, "{}", building.name);
        assert_eq!(tallies[structure].other, Tally::default());
        counted += roof.exposed;
    }
    assert_eq!(counted, field.samples.iter().map(|sample| sample.exposed).sum::<u32>());
}

#[test]
fn walls_are_drawn_in_the_step_of_their_share() {
    let buildings = [block::box_building("cube", [0.0, 0.0], [20.0, 20.0], 20.0)];
    let blocks = block::field(&buildings);
    let field = FieldTable::open(&blocks, &[]).unwrap();
    let mut plan = block::plan(&field);
    let faces_south = |index: usize| field.samples[index].normal == [0.0, -1.0, 0.0];
    plan.cells = (0..field.samples.len()).map(|index| if faces_south(index) { 90 } else { 0 }).collect();
    let text = String::from_utf8(svg::to_bytes(&field, None, &plan).unwrap()).unwrap();
    let document = Document::parse(&text).unwrap();

    let full: Vec<Node> = by_id(&document, "walls")
        .children()
        .filter(|node| node.attribute("data-share-percent").is_some_and(|share| share == "100"))
        .collect();
    let drawn = places(full[0].attribute("d").unwrap());
    let south = places(by_id(&document, "buildings").first_element_child().unwrap().attribute("d").unwrap());
    assert_eq!((full.len(), drawn.as_slice()), (1, &south[..2]));
}

#[test]
fn a_camera_on_a_gimbal_has_wedges_in_its_view_directions_and_other_rigs_have_none() {
    let blocks = block::field(&block::city(3, 3));
    let field = FieldTable::open(&blocks, &[]).unwrap();
    let mut plan = block::plan(&field);
    let views = |plan: &Plan| {
        let text = String::from_utf8(svg::to_bytes(&field, None, plan).unwrap()).unwrap();
        let document = Document::parse(&text).unwrap();
        let wedges: Vec<Vec<[f64; 2]>> =
            by_id(&document, "views").children().filter_map(|node| node.attribute("d")).map(places).collect();
        (wedges, text)
    };
    assert_eq!(views(&plan).0.len(), 0, "a panorama looks everywhere");

    let intrinsics = Intrinsics { focal_mm: 8.8, sensor_mm: [13.2, 8.8], pixels: [5472, 3648] };
    plan.cameras[0].intrinsics = Some(intrinsics);
    plan.metrics.battery_percent = Some(61.7);
    plan.images[3].selected = false;
    let look = |direction: Vector3<f64>| {
        let mut plan = plan.clone();
        let direction = Some(Unit::new_normalize(direction));
        plan.waypoints.iter_mut().for_each(|waypoint| waypoint.direction = direction);
        plan.images.iter_mut().for_each(|image| image.direction = direction);
        plan
    };
    // East lies to the right on the sheet, north upwards.
    let (level, text) = views(&look(Vector3::new(1.0, 0.0, 0.0)));
    let axis = |wedge: &[[f64; 2]]| [0, 1].map(|k| (wedge[1][k] + wedge[2][k]) / 2.0 - wedge[0][k]);
    assert!(level.len() > 3 && level.iter().all(|wedge| axis(wedge)[0] > 5.0 && axis(wedge)[1].abs() < 0.02), "{level:?}");
    let (pitched, _) = views(&look(Vector3::new(0.0, 1.0, -1.0)));
    let ratio = -axis(&pitched[0])[1] / axis(&level[0])[0];
    assert!((ratio - 0.5f64.sqrt()).abs() < 0.01, "a view pitched by 45 degrees is drawn at {ratio} of its length");
    assert_eq!(views(&look(-Vector3::z())).0.len(), 0, "straight down there is nothing to draw");

    let selected = format!("{} selected", plan.images.len() - 1);
    for part in ["62 %", selected.as_str(), "rig panoramic", "method paper", &minutes(plan.metrics.profile_s)] {
        assert!(text.contains(part), "{part} is not on the sheet");
    }
    let mut bolted = look(Vector3::x());
    bolted.cameras.push(bolted.cameras[0].clone());
    assert_eq!(views(&bolted).0.len(), 0, "cameras that are bolted on turn with the path");
}

fn minutes(time_s: f64) -> String {
    format!("{}:{:02}", time_s.round() as u64 / 60, time_s.round() as u64 % 60)
}

#[test]
fn a_plan_of_another_revision_is_refused() {
    let blocks = block::field(&block::city(2, 2));
    let field = FieldTable::open(&blocks, &[]).unwrap();
    let mut plan = block::plan(&field);
    plan.scene.revision = 2;
    let error = svg::to_bytes(&field, None, &plan).unwrap_err();
    assert!(matches!(error, SvgError::OtherField { plan_revision: 2, field_revision: 1, .. }), "{error}");
}

#[test]
fn a_plan_that_stays_where_it_starts_can_be_drawn() {
    let blocks = block::field(&block::city(1, 1));
    let field = FieldTable::open(&blocks, &[]).unwrap();
    let mut plan = block::plan(&field);
    plan.waypoints.truncate(1);
    plan.images.clear();
    plan.convergence.clear();
    plan.metrics = Default::default();
    let text = String::from_utf8(svg::to_bytes(&field, None, &plan).unwrap()).unwrap();
    assert!(Document::parse(&text).is_ok() && !text.contains("NaN") && !text.contains("inf"), "{text}");
}

fn draw(blocks: &[Block]) -> String {
    let field = FieldTable::open(blocks, &[]).unwrap();
    String::from_utf8(svg::to_bytes(&field, None, &block::plan(&field)).unwrap()).unwrap()
}

fn by_id<'a>(document: &'a Document, id: &str) -> Node<'a, 'a> {
    document.descendants().find(|node| node.attribute("id") == Some(id)).unwrap_or_else(|| panic!("there is no {id}"))
}

fn number(node: Node, attribute: &str) -> f64 {
    node.attribute(attribute).unwrap().parse().unwrap()
}

/// The points of path data that has absolute moves and lines only.
fn places(data: &str) -> Vec<[f64; 2]> {
    let points = data.split(['M', 'L', 'Z']).filter(|part| !part.is_empty());
    points
        .map(|point| {
            let (x, y) = point.split_once(',').unwrap();
            [x.parse().unwrap(), y.parse().unwrap()]
        })
        .collect()
}

fn count(field: &FieldTable, cells: &[u16], belongs: impl Fn(usize) -> bool) -> Tally {
    let chosen: Vec<usize> =
        (0..field.samples.len()).filter(|index| field.samples[*index].exposed == 1 && belongs(*index)).collect();
    let above = |rows: &[u16]| chosen.iter().filter(|index| u32::from(rows[**index]) > block::THRESHOLD_CELLS).count() as u32;
    Tally { exposed: chosen.len() as u32, capturable: above(field.ceilings), captured: above(cells) }
}

/// Whether a sample lies on the wall over the axis-parallel edge from `from` to `to`.
fn lies_between(position_m: [f64; 3], from: [f64; 2], to: [f64; 2]) -> bool {
    (0..2).all(|axis| {
        let (low, high) = (from[axis].min(to[axis]), from[axis].max(to[axis]));
        (low - 1e-9..=high + 1e-9).contains(&position_m[axis])
    })
}

fn assert_near(measured: f64, expected: f64) {
    assert!((measured - expected).abs() < 0.02, "{measured} is not {expected}");
}
