//! `inspect.svg`: a scene as it was read, from above. What was guessed and what was repaired stands out, and each structure tells what was done.

use std::collections::HashMap;

use svg::Document;
use svg::node::element::Group;

use super::colour::{self, AHEAD, HEIGHT, NEW, ZONE};
use super::pen::{self, Anchor, Place};
use super::plain_view::PlainView;
use crate::scene::{ImportReport, Meaning, ReportItem, Scene, Structure};

const WIDTH: f64 = 1200.0;
const MARGIN: f64 = 48.0;
const HEADING: f64 = 112.0;
/// Room for the scale and what cannot be drawn, below the view.
const FOOTER: f64 = 84.0;

/// Lengths of a scale bar, m.
const BARS_M: [f64; 8] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];

/// The file's content.
pub fn to_bytes(scene: &Scene, report: &ImportReport) -> Vec<u8> {
    let outlines = |structure: &Structure| rings(structure).into_iter().flatten();
    let view = PlainView::over(scene.structures.iter().flat_map(|structure| outlines(structure)), WIDTH - 2.0 * MARGIN);
    let corner = [MARGIN, HEADING];
    let height = (HEADING + view.height + FOOTER).ceil();
    let tallest_m = report.tallest_m.max(1.0);
    let mut items: HashMap<&str, Vec<&ReportItem>> = HashMap::new();
    report.items.iter().for_each(|item| items.entry(item.structure.as_str()).or_default().push(item));

    // Low structures first, so that a tower stands on its podium.
    let mut order: Vec<&Structure> = scene.structures.iter().map(AsRef::as_ref).collect();
    order.sort_by(|a, b| a.bounds().max.z.total_cmp(&b.bounds().max.z));
    let mut town = pen::group("structures");
    for structure in order {
        let own = items.get(structure.name.as_str()).map_or(&[][..], Vec::as_slice);
        let is = |meaning: Meaning| own.iter().any(|item| item.kind.meaning() == meaning);
        let fill = if is(Meaning::Guessed) { NEW.to_owned() } else { HEIGHT.at(structure.bounds().max.z / tallest_m) };
        let (stroke, width) = if is(Meaning::Repaired) { (AHEAD, 1.6) } else { (colour::OUTLINE, 0.7) };
        let data: String =
            rings(structure).into_iter().map(|ring| pen::ring(ring.into_iter().map(|place| view.at(corner, place)))).collect();
        let shape = pen::stroke(data, stroke, width).set("fill", fill).set("fill-rule", "evenodd");
        town = town.add(pen::titled(shape, &caption(structure, own)));
    }
    let mut zones = pen::group("zones");
    for polygon in scene.zones.iter().flat_map(|zone| &zone.outline) {
        let ring = polygon.exterior().0.iter().map(|corner_m| view.at(corner, [corner_m.x, corner_m.y]));
        let shape =
            pen::stroke(pen::ring(ring), ZONE, 1.6).set("fill", ZONE).set("fill-opacity", 0.14).set("stroke-dasharray", "6 4");
        zones = zones.add(shape);
    }
    let clip = svg::node::element::ClipPath::new().set("id", "view").add(pen::rectangle(
        corner,
        [view.width, view.height],
        colour::PAPER,
    ));
    let document = Document::new()
        .set("viewBox", (0, 0, WIDTH as u32, height as u32))
        .set("width", WIDTH)
        .set("height", height)
        .set("font-family", pen::FONT)
        .add(clip)
        .add(pen::rectangle([0.0, 0.0], [WIDTH, height], colour::PAPER))
        .add(heading(scene, report))
        .add(pen::rectangle(corner, [view.width, view.height], colour::GROUND).set("stroke", colour::HAIRLINE))
        .add(Group::new().set("clip-path", "url(#view)").add(town).add(zones))
        .add(footer(report, &view, [MARGIN, HEADING + view.height + 34.0]));
    format!("{document}\n").into_bytes()
}

fn rings(structure: &Structure) -> Vec<Vec<[f64; 2]>> {
    let outlines = structure.outlines();
    let rings = outlines.iter().flat_map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()));
    rings.map(|ring| ring.0.iter().map(|corner| [corner.x, corner.y]).collect()).collect()
}

fn caption(structure: &Structure, items: &[&ReportItem]) -> String {
    let bounds = structure.bounds();
    let head = format!("{}: {:.1} m to {:.1} m", structure.name, bounds.min.z, bounds.max.z);
    std::iter::once(head).chain(items.iter().map(|item| item.done.clone())).collect::<Vec<_>>().join("\n")
}

fn heading(scene: &Scene, report: &ImportReport) -> Group {
    let figures = format!(
        "{}; {} structures, {:.0} x {:.0} m, tallest {:.1} m",
        report.format.name(),
        scene.structures.len(),
        report.extent_m[0],
        report.extent_m[1],
        report.tallest_m
    );
    let mut group = Group::new()
        .add(pen::text([MARGIN, 44.0], 26.0, Anchor::Start, &scene.name).set("font-weight", 700))
        .add(pen::quiet_text([MARGIN, 70.0], 14.0, Anchor::Start, &figures));
    let key = [
        (HEIGHT.at(0.7), colour::OUTLINE, "as the file says, darker where taller"),
        (NEW.to_owned(), colour::OUTLINE, "height guessed"),
        (colour::PAPER.to_owned(), AHEAD, "repaired"),
        (colour::PAPER.to_owned(), ZONE, "no-fly zone"),
    ];
    let mut left = MARGIN;
    for (fill, stroke, words) in key {
        group = group
            .add(pen::rectangle([left, 84.0], [16.0, 12.0], &fill).set("stroke", stroke).set("stroke-width", 1.4))
            .add(pen::text([left + 22.0, 94.5], 13.0, Anchor::Start, words));
        left += 50.0 + 7.0 * words.len() as f64;
    }
    group
}

fn footer(report: &ImportReport, view: &PlainView, corner: Place) -> Group {
    let dropped: usize =
        report.counts.iter().filter(|(kind, _)| kind.meaning() == Meaning::Dropped).map(|(_, count)| count).sum();
    let words = match dropped {
        0 => "Nothing of the file was left out that may stand in the way.".to_owned(),
        1 => "1 item of the file was left out and is not drawn: nothing keeps a flight away from it.".to_owned(),
        _ => format!("{dropped} items of the file were left out and are not drawn: nothing keeps a flight away from them."),
    };
    let bar_m = BARS_M.into_iter().rfind(|bar_m| bar_m * view.pixels_per_m <= 220.0).unwrap_or(BARS_M[0]);
    let right = [corner[0] + view.width, corner[1] - 8.0];
    let left = [right[0] - bar_m * view.pixels_per_m, right[1]];
    Group::new()
        .add(pen::quiet_text(corner, 14.0, Anchor::Start, &words))
        .add(pen::line(left, right, colour::INK, 2.0))
        .add(pen::text([right[0], right[1] + 20.0], 13.0, Anchor::End, &format!("{bar_m} m, north is up")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::read;
    use crate::settings::Settings;

    #[test]
    fn what_was_guessed_and_repaired_stands_out() {
        let feature = |west: f64, properties: &str, ring: &str| {
            let ring = ring.replace('W', &west.to_string()).replace('E', &(west + 0.0003).to_string());
            format!(
                r#"{{"type":"Feature","properties":{{{properties}}},"geometry":{{"type":"Polygon","coordinates":[[{ring}]]}}}}"#
            )
        };
        let (closed, open) = ("[W,51.9],[E,51.9],[E,51.9002],[W,51.9002],[W,51.9]", "[W,51.9],[E,51.9],[E,51.9002],[W,51.9002]");
        let file = format!(
            r#"{{"type":"FeatureCollection","features":[{},{},{}]}}"#,
            feature(4.4, r#""height":9"#, closed),
            feature(4.401, "", closed),
            feature(4.402, r#""height":9"#, open)
        );
        let (scene, report) = read("town.geojson", file.as_bytes(), &Settings::default().proxy).unwrap();
        let svg = String::from_utf8(to_bytes(&scene, &report)).unwrap();
        let document = roxmltree::Document::parse(&svg).unwrap();
        let town = document.descendants().find(|node| node.attribute("id") == Some("structures")).unwrap();
        let with = |name: &str, value: &str| town.descendants().filter(|node| node.attribute(name) == Some(value)).count();
        assert_eq!((with("fill", NEW), with("stroke", AHEAD)), (1, 1));
        assert_eq!(town.descendants().filter(|node| node.has_tag_name("title")).count(), 3);
        assert!(svg.contains("taken to be 10 m"));
    }
}
