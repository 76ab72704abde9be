//! Charts as SVG: lines over a common axis, and bars in groups. Small multiples, one panel for each quantity.

use svg::node::element::{Circle, Group, Line, Polyline, Rectangle, Text};
use svg::{Document, Node};

/// A chart with its file name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawing {
    pub file: String,
    pub svg: String,
}

/// One quantity over the axis that all panels share.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Quantity with its unit.
    pub title: String,
    pub series: Vec<Series>,
}

/// One line, as pairs along and up.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    pub name: String,
    pub points: Vec<[f64; 2]>,
}

/// One quantity as bars: groups of the same members.
#[derive(Clone, Debug, PartialEq)]
pub struct BarPanel {
    /// Quantity with its unit.
    pub title: String,
    /// Name of each group, and the bar of each of its members; a member may be missing.
    pub groups: Vec<(String, Vec<Option<f64>>)>,
}

const COLOURS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const INK: &str = "#222222";
const QUIET: &str = "#bbbbbb";
const FONT: &str = "Inter, 'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif";

const PANEL: [f64; 2] = [380.0, 250.0];
const GAP: [f64; 2] = [90.0, 80.0];
const MARGIN: [f64; 2] = [80.0, 70.0];
const ACROSS: usize = 2;
const LEGEND_ROW: f64 = 20.0;

/// Lines over `along`, in panels two abreast; the legend names the lines of the first panel, where it has several.
pub fn lines(title: &str, along: &str, panels: &[Panel]) -> String {
    let several = panels.first().filter(|panel| panel.series.len() > 1);
    let names = several.map_or(Vec::new(), |panel| panel.series.iter().map(|series| series.name.as_str()).collect());
    let mut sheet = Sheet::new(title, panels.len(), &names);
    let most = panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.points).map(|point| point[0]);
    let most = round_up(most.fold(0.0, f64::max));
    for (index, panel) in panels.iter().enumerate() {
        let values = panel.series.iter().flat_map(|series| &series.points).map(|point| point[1]);
        let scale = Scale { corner: Sheet::corner(index), least: [0.0; 2], most: [most, round_up(values.fold(0.0, f64::max))] };
        sheet.add(axes(&scale, &panel.title));
        for share in [0.0, 0.5, 1.0] {
            let [x, y] = scale.at([share * most, 0.0]);
            sheet.add(text([x, y + 16.0], 12.0, "middle", &short(share * most)));
        }
        let [x, y] = scale.at([most / 2.0, 0.0]);
        sheet.add(text([x, y + 32.0], 12.0, "middle", along));
        for (number, series) in panel.series.iter().enumerate() {
            sheet.add(curve(&scale, series, COLOURS[number % COLOURS.len()]));
        }
    }
    sheet.finish()
}

/// Points over `along`, joined where a line has several: each panel has axes of its own, and the one upward begins where it has to, so that what
/// lies close together can be told apart. The legend names the lines of the first panel.
pub fn scatter(title: &str, along: &str, panels: &[Panel]) -> String {
    let names = panels.first().map_or(Vec::new(), |panel| panel.series.iter().map(|series| series.name.as_str()).collect());
    let mut sheet = Sheet::new(title, panels.len(), &names);
    for (index, panel) in panels.iter().enumerate() {
        let figures = |axis: usize| panel.series.iter().flat_map(|series| &series.points).map(move |point| point[axis]);
        let most = round_up(figures(0).fold(0.0, f64::max));
        let [low, high] = [figures(1).fold(f64::INFINITY, f64::min), figures(1).fold(0.0, f64::max)];
        let up = [(low / 10.0).floor().max(0.0) * 10.0, (high / 10.0).ceil().max(1.0) * 10.0];
        let up = if up[0] < up[1] { up } else { [0.0, up[1]] };
        let scale = Scale { corner: Sheet::corner(index), least: [0.0, up[0]], most: [most, up[1]] };
        sheet.add(axes(&scale, &panel.title));
        for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let [x, y] = scale.at([share * most, up[0]]);
            sheet.add(text([x, y + 16.0], 12.0, "middle", &short(share * most)));
        }
        let [x, y] = scale.at([most / 2.0, up[0]]);
        sheet.add(text([x, y + 32.0], 12.0, "middle", along));
        for (number, series) in panel.series.iter().enumerate() {
            sheet.add(curve(&scale, series, COLOURS[number % COLOURS.len()]));
        }
    }
    sheet.finish()
}

/// Bars of `members` in groups, in panels two abreast.
pub fn bars(title: &str, members: &[&str], panels: &[BarPanel]) -> String {
    let mut sheet = Sheet::new(title, panels.len(), members);
    for (index, panel) in panels.iter().enumerate() {
        let values = panel.groups.iter().flat_map(|(_, bars)| bars).flatten().copied();
        let scale = Scale {
            corner: Sheet::corner(index),
            least: [0.0; 2],
            most: [panel.groups.len() as f64, round_up(values.fold(0.0, f64::max))],
        };
        sheet.add(axes(&scale, &panel.title));
        for (number, (name, bars)) in panel.groups.iter().enumerate() {
            let [x, y] = scale.at([number as f64 + 0.5, 0.0]);
            sheet.add(text([x, y + 16.0], 12.0, "middle", name));
            let width = 0.8 / bars.len().max(1) as f64;
            for (member, value) in bars.iter().enumerate() {
                let Some(value) = value else { continue };
                let left = number as f64 + 0.1 + member as f64 * width;
                sheet.add(bar(&scale, [left, left + 0.92 * width], *value, COLOURS[member % COLOURS.len()]));
            }
        }
    }
    sheet.finish()
}

/// A document that is filled panel by panel.
struct Sheet {
    document: Document,
}

impl Sheet {
    fn new(title: &str, panels: usize, names: &[&str]) -> Self {
        let rows = panels.div_ceil(ACROSS).max(1) as f64;
        let width = 2.0 * MARGIN[0] + ACROSS as f64 * PANEL[0] + (ACROSS as f64 - 1.0) * GAP[0];
        let panels_end = MARGIN[1] + rows * (PANEL[1] + GAP[1]);
        let height = panels_end + LEGEND_ROW * names.len() as f64 + 16.0;
        let document = Document::new().set("viewBox", (0, 0, width, height)).set("font-family", FONT);
        let mut sheet = Self { document };
        sheet.add(Rectangle::new().set("width", width).set("height", height).set("fill", "#ffffff"));
        sheet.add(text([MARGIN[0], 34.0], 18.0, "start", title));
        for (index, name) in names.iter().enumerate() {
            let y = panels_end + LEGEND_ROW * index as f64;
            let colour = COLOURS[index % COLOURS.len()];
            sheet.add(
                Rectangle::new().set("x", MARGIN[0]).set("y", y - 10.0).set("width", 14).set("height", 10).set("fill", colour),
            );
            sheet.add(text([MARGIN[0] + 22.0, y], 13.0, "start", name));
        }
        sheet
    }

    /// Upper left corner of a panel.
    fn corner(index: usize) -> [f64; 2] {
        let place = [index % ACROSS, index / ACROSS].map(|number| number as f64);
        [0, 1].map(|axis| MARGIN[axis] + place[axis] * (PANEL[axis] + GAP[axis]))
    }

    fn add(&mut self, node: impl Into<Box<dyn Node>>) {
        self.document.append(node);
    }

    fn finish(self) -> String {
        self.document.to_string() + "\n"
    }
}

/// From figures to places on the sheet.
struct Scale {
    corner: [f64; 2],
    least: [f64; 2],
    most: [f64; 2],
}

impl Scale {
    fn at(&self, point: [f64; 2]) -> [f64; 2] {
        let share = [0, 1].map(|axis| {
            let range = self.most[axis] - self.least[axis];
            if range > 0.0 { (point[axis] - self.least[axis]) / range } else { 0.0 }
        });
        [rounded(self.corner[0] + share[0] * PANEL[0]), rounded(self.corner[1] + (1.0 - share[1]) * PANEL[1])]
    }
}

fn axes(scale: &Scale, title: &str) -> Group {
    let mut group = Group::new().add(text([scale.corner[0], scale.corner[1] - 12.0], 14.0, "start", title));
    for share in [0.0, 0.5, 1.0] {
        let value = scale.least[1] + share * (scale.most[1] - scale.least[1]);
        let [x, y] = scale.at([scale.least[0], value]);
        let colour = if share == 0.0 { INK } else { QUIET };
        group = group
            .add(Line::new().set("x1", x).set("y1", y).set("x2", x + PANEL[0]).set("y2", y).set("stroke", colour))
            .add(text([x - 8.0, y + 4.0], 12.0, "end", &short(value)));
    }
    group
}

fn curve(scale: &Scale, series: &Series, colour: &str) -> Group {
    let places: Vec<[f64; 2]> = series.points.iter().map(|&point| scale.at(point)).collect();
    let path: Vec<String> = places.iter().map(|[x, y]| format!("{x},{y}")).collect();
    let line = Polyline::new().set("points", path.join(" ")).set("fill", "none").set("stroke", colour).set("stroke-width", 1.8);
    // Dots where they can be told apart.
    let dots = if places.len() <= 20 { places } else { Vec::new() };
    dots.iter().fold(Group::new().add(line), |group, [x, y]| {
        group.add(Circle::new().set("cx", *x).set("cy", *y).set("r", 3).set("fill", colour))
    })
}

fn bar(scale: &Scale, sides: [f64; 2], value: f64, colour: &str) -> Group {
    let ([left, top], [right, bottom]) = (scale.at([sides[0], value]), scale.at([sides[1], 0.0]));
    let shape = Rectangle::new()
        .set("x", left)
        .set("y", top)
        .set("width", rounded(right - left))
        .set("height", rounded(bottom - top))
        .set("fill", colour);
    Group::new().add(shape).add(text([rounded((left + right) / 2.0), top - 3.0], 9.0, "middle", &short(value)))
}

fn text(place: [f64; 2], size: f64, anchor: &str, content: &str) -> Text {
    Text::new(content)
        .set("x", rounded(place[0]))
        .set("y", rounded(place[1]))
        .set("font-size", size)
        .set("fill", INK)
        .set("text-anchor", anchor)
}

/// The next number at or above a value whose half reads well too: one of a few times a power of ten.
fn round_up(value: f64) -> f64 {
    if value <= 0.0 || !value.is_finite() {
        return 1.0;
    }
    let mut unit = 1.0;
    while unit > value {
        unit /= 10.0;
    }
    while unit * 10.0 <= value {
        unit *= 10.0;
    }
    [1.0, 1.2, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0]
        .into_iter()
        .map(|factor| factor * unit)
        .find(|rounded| *rounded >= value)
        .unwrap_or(value)
}

/// A number as it stands at an axis.
fn short(value: f64) -> String {
    let decimals = if value >= 100.0 || value == 0.0 {
        0
    } else if value >= 1.0 {
        1
    } else {
        3
    };
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn rounded(pixels: f64) -> f64 {
    (pixels * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_end_at_numbers_that_read_well() {
        for (value, expected) in [(0.0, 1.0), (0.03, 0.03), (1.0, 1.0), (1.1, 1.2), (2.4, 2.5), (83.0, 100.0), (2151.0, 2500.0)] {
            assert!((round_up(value) - expected).abs() < 1e-12 * expected, "{value}: {}", round_up(value));
        }
    }

    #[test]
    fn a_curve_ends_where_its_figures_say() {
        let scale = Scale { corner: [10.0, 20.0], least: [0.0; 2], most: [4.0, 2.0] };
        assert_eq!(scale.at([0.0, 0.0]), [10.0, 20.0 + PANEL[1]]);
        assert_eq!(scale.at([4.0, 1.0]), [10.0 + PANEL[0], 20.0 + PANEL[1] / 2.0]);
    }

    #[test]
    fn an_axis_that_does_not_begin_at_zero_is_used_from_end_to_end() {
        let scale = Scale { corner: [10.0, 20.0], least: [0.0, 80.0], most: [4.0, 100.0] };
        assert_eq!(scale.at([0.0, 80.0]), [10.0, 20.0 + PANEL[1]]);
        assert_eq!(scale.at([4.0, 90.0]), [10.0 + PANEL[0], 20.0 + PANEL[1] / 2.0]);
        let of = |points: Vec<[f64; 2]>| Panel { title: "y".to_owned(), series: vec![Series { name: "a".to_owned(), points }] };
        let drawing = scatter("s", "x", &[of(vec![[10.0, 81.0], [20.0, 97.0]]), of(Vec::new()), of(vec![[1.0, 0.0]])]);
        let document = roxmltree::Document::parse(&drawing).unwrap();
        assert_eq!(document.descendants().filter(|node| node.has_tag_name("circle")).count(), 3);
        assert!(!drawing.contains("NaN") && !drawing.contains("inf"), "{drawing}");
    }

    #[test]
    fn charts_are_sound_xml_whatever_they_are_called() {
        let series = Series { name: "a < b & c".to_owned(), points: vec![[0.0, 1.0], [5.0, 2.0]] };
        let drawing = lines("Images & <error>", "images", &[Panel { title: "error [m]".to_owned(), series: vec![series] }]);
        assert!(roxmltree::Document::parse(&drawing).is_ok(), "{drawing}");
        let panel = BarPanel { title: "x".to_owned(), groups: vec![("g".to_owned(), vec![Some(1.0), None, Some(2.0)])] };
        let drawing = bars("Bars", &["a", "b", "c"], &[panel]);
        let document = roxmltree::Document::parse(&drawing).unwrap();
        // The sheet, three marks of the legend, two bars.
        assert_eq!(document.descendants().filter(|node| node.has_tag_name("rect")).count(), 6);
    }
}
