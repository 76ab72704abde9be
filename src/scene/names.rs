//! Names of structures: from the file where it has them, made unique.

use std::collections::{HashMap, HashSet};

use serde_json::{Map, Value};

use super::proxy::StructureId;

/// Properties that hold an identifier, in the order in which they are asked.
const ID_KEYS: [&str; 10] =
    ["id", "@id", "osm", "osm_id", "gml_id", "gml:id", "identificatie", "building_id", "uuid", "globalid"];

/// Names longer than this are cut, in characters.
const LONGEST_NAME: usize = 120;

/// Whether a property may hold an identifier.
pub(crate) fn is_key(key: &str) -> bool {
    ID_KEYS.contains(&key)
}

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
    /// The suffix to try next for a name that was taken; all below are taken too.
    next: HashMap<StructureId, u64>,
}

impl Names {
    /// `name` when it is still free, else `name` with the first free suffix.
    pub fn unique(&mut self, name: &str) -> String {
        let id = StructureId::of_name(name);
        if self.ids.insert(id) {
            return name.to_owned();
        }
        let next = self.next.entry(id).or_insert(2);
        loop {
            let candidate = format!("{name}-{next}");
            *next += 1;
            if self.ids.insert(StructureId::of_name(&candidate)) {
                return candidate;
            }
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

    #[test]
    fn a_name_given_very_often_stays_cheap() {
        let mut names = Names::default();
        let last = (0..200_000).map(|_| names.unique("a")).last();
        assert_eq!(last.as_deref(), Some("a-200000"));
    }
}
