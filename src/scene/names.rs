//! Names of structures: from the file where it has them, made unique.

use std::collections::HashSet;

use serde_json::{Map, Value};

use super::proxy::StructureId;

/// Properties that hold an identifier, in the order in which they are asked.
const ID_KEYS: [&str; 10] =
    ["id", "@id", "osm", "osm_id", "gml_id", "gml:id", "identificatie", "building_id", "uuid", "globalid"];

/// Names longer than this are cut, in characters.
const LONGEST_NAME: usize = 120;

/// The identifier of a GeoJSON feature: its own `id`, else a property that holds one.
pub(crate) fn feature_name(id: Option<&Value>, properties: &Map<String, Value>) -> Option<String> {
    id.and_then(text_of).or_else(|| ID_KEYS.iter().find_map(|key| properties.get(*key).and_then(text_of)))
}

/// A name without line breaks and other control characters, and of bounded length.
pub(crate) fn tidy(name: &str) -> String {
    name.trim().chars().map(|c| if c.is_control() { ' ' } else { c }).take(LONGEST_NAME).collect()
}

fn text_of(value: &Value) -> Option<String> {
    let text = match value {
        Value::String(text) => tidy(text),
        Value::Number(number) => number.to_string(),
        _ => return None,
    };
    (!text.is_empty()).then_some(text)
}

/// The names given so far.
#[derive(Default)]
pub(crate) struct Names {
    ids: HashSet<StructureId>,
}

impl Names {
    /// `name` when it is still free, else `name` with the first free suffix.
    pub fn unique(&mut self, name: &str) -> String {
        if self.ids.insert(StructureId::of_name(name)) {
            return name.to_owned();
        }
        let mut number = 2u64;
        loop {
            let candidate = format!("{name}-{number}");
            if self.ids.insert(StructureId::of_name(&candidate)) {
                return candidate;
            }
            number += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_feature_s_own_id_comes_first() {
        let properties = json!({"osm": "way/7", "gml_id": "g"});
        let properties = properties.as_object().unwrap();
        assert_eq!(feature_name(Some(&json!(12)), properties), Some("12".into()));
        assert_eq!(feature_name(Some(&json!(" ")), properties), Some("way/7".into()));
        assert_eq!(feature_name(None, &Map::new()), None);
    }

    #[test]
    fn names_become_unique() {
        let mut names = Names::default();
        let given: Vec<_> = ["a", "a", "a-2", "b", "a"].iter().map(|name| names.unique(name)).collect();
        assert_eq!(given, ["a", "a-2", "a-2-2", "b", "a-3"]);
    }
}
