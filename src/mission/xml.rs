//! XML as a tree: what KML and WPML are written from.

use std::fmt::Display;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesEnd, BytesStart, BytesText, Event};

/// An element with attributes, and either children or text.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    name: &'static str,
    attributes: Vec<(&'static str, &'static str)>,
    children: Vec<Element>,
    text: Option<String>,
}

impl Element {
    pub fn new(name: &'static str) -> Self {
        Self { name, attributes: Vec::new(), children: Vec::new(), text: None }
    }

    /// An element that holds a value.
    pub fn value(name: &'static str, value: impl Display) -> Self {
        // XML has no way to write most control characters.
        let mut text = value.to_string();
        if text.chars().any(char::is_control) {
            text = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        }
        Self { text: Some(text), ..Self::new(name) }
    }

    pub fn attribute(mut self, key: &'static str, value: &'static str) -> Self {
        self.attributes.push((key, value));
        self
    }

    pub fn with(mut self, child: Self) -> Self {
        self.children.push(child);
        self
    }

    pub fn with_value(self, name: &'static str, value: impl Display) -> Self {
        self.with(Self::value(name, value))
    }

    pub fn with_all(mut self, children: impl IntoIterator<Item = Self>) -> Self {
        self.children.extend(children);
        self
    }

    pub fn into_children(self) -> Vec<Self> {
        self.children
    }

    /// The whole file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut writer = Writer::new_with_indent(Vec::new(), b' ', 1);
        let declaration = Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None));
        writer.write_event(declaration).and_then(|()| self.write(&mut writer)).expect("memory takes everything");
        let mut bytes = writer.into_inner();
        bytes.push(b'\n');
        bytes
    }

    fn write(&self, writer: &mut Writer<Vec<u8>>) -> std::io::Result<()> {
        let start = BytesStart::new(self.name).with_attributes(self.attributes.iter().copied());
        if self.text.is_none() && self.children.is_empty() {
            return writer.write_event(Event::Empty(start));
        }
        writer.write_event(Event::Start(start))?;
        if let Some(text) = &self.text {
            writer.write_event(Event::Text(BytesText::new(text)))?;
        }
        self.children.iter().try_for_each(|child| child.write(writer))?;
        writer.write_event(Event::End(BytesEnd::new(self.name)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_a_name_holds_the_file_is_sound() {
        let name = "a<b>&\"c\"\u{1}\u{7f}é";
        let bytes = Element::new("kml").attribute("xmlns", "urn:x").with_value("name", name).with(Element::new("e")).to_bytes();
        let text = String::from_utf8(bytes).unwrap();
        let document = roxmltree::Document::parse(&text).unwrap();
        let read = document.descendants().find(|node| node.tag_name().name() == "name").and_then(|node| node.text());
        assert_eq!(read, Some("a<b>&\"c\"  é"));
    }
}
