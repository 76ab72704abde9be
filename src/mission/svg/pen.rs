//! Elements of a drawing, with coordinates rounded to hundredths of a pixel.

use svg::Node;
use svg::node::Value;
use svg::node::element::{Circle, Element, Group, Line, Rectangle, Text, Title};

use super::colour::{INK, QUIET_INK};

pub const FONT: &str = "Inter, 'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif";

/// A point on the sheet, pixels right and down.
pub type Place = [f64; 2];

/// Where a text stands relative to its anchor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// A text of `size` pixels in the ordinary ink.
pub fn text(place: Place, size: f64, anchor: Anchor, content: &str) -> Text {
    Text::new(printable(content))
        .set("x", rounded(place[0]))
        .set("y", rounded(place[1]))
        .set("font-size", size)
        .set("fill", INK)
        .set("text-anchor", anchor_name(anchor))
}

/// A text that stays in the background.
pub fn quiet_text(place: Place, size: f64, anchor: Anchor, content: &str) -> Text {
    text(place, size, anchor, content).set("fill", QUIET_INK)
}

pub fn line(from: Place, to: Place, colour: &str, width: f64) -> Line {
    Line::new()
        .set("x1", rounded(from[0]))
        .set("y1", rounded(from[1]))
        .set("x2", rounded(to[0]))
        .set("y2", rounded(to[1]))
        .set("stroke", colour)
        .set("stroke-width", rounded(width))
}

pub fn rectangle(corner: Place, size: Place, fill: &str) -> Rectangle {
    Rectangle::new()
        .set("x", rounded(corner[0]))
        .set("y", rounded(corner[1]))
        .set("width", rounded(size[0]))
        .set("height", rounded(size[1]))
        .set("fill", fill)
}

pub fn circle(centre: Place, radius: f64, fill: &str) -> Circle {
    Circle::new().set("cx", rounded(centre[0])).set("cy", rounded(centre[1])).set("r", rounded(radius)).set("fill", fill)
}

/// A path that is stroked and not filled.
pub fn stroke(data: String, colour: &str, width: f64) -> svg::node::element::Path {
    svg::node::element::Path::new()
        .set("d", data)
        .set("fill", "none")
        .set("stroke", colour)
        .set("stroke-width", rounded(width))
        .set("stroke-linejoin", "round")
        .set("stroke-linecap", "round")
}

/// The path data of an open polyline.
pub fn polyline(places: impl IntoIterator<Item = Place>) -> String {
    let mut data = String::new();
    for (index, place) in places.into_iter().enumerate() {
        data.push(if index == 0 { 'M' } else { 'L' });
        data.push_str(&coordinates(place));
    }
    data
}

/// The path data of a closed ring.
pub fn ring(places: impl IntoIterator<Item = Place>) -> String {
    let mut data = polyline(places);
    data.push('Z');
    data
}

/// Many dots of one size and colour as one path: round caps on strokes without length.
pub fn dots(places: impl IntoIterator<Item = Place>, diameter: f64, colour: &str) -> svg::node::element::Path {
    let data: String = places.into_iter().map(|place| format!("M{}h0", coordinates(place))).collect();
    stroke(data, colour, diameter)
}

/// A group that a reader of the file can find by `id`.
pub fn group(id: &str) -> Group {
    Group::new().set("id", id)
}

/// Gives an element a title, which viewers show as a tooltip.
pub fn titled(element: impl Into<Element>, title: &str) -> Element {
    let mut element = element.into();
    element.append(Title::new(printable(title)));
    element
}

/// A number with at most two decimals and no needless zeros.
pub fn rounded(value: f64) -> Value {
    number(value).into()
}

fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn coordinates(place: Place) -> String {
    format!("{},{}", number(place[0]), number(place[1]))
}

/// Characters that XML does not allow are replaced; the writer escapes the others.
fn printable(content: &str) -> String {
    let is_allowed = |c: char| !c.is_control() && c != '\u{fffe}' && c != '\u{ffff}';
    content.chars().map(|c| if is_allowed(c) { c } else { '\u{fffd}' }).collect()
}

fn anchor_name(anchor: Anchor) -> &'static str {
    match anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    }
}
