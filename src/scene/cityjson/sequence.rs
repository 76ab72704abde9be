//! CityJSON sequences: one feature a line.

use super::model::CityModel;
use super::scene_of;
use crate::scene::anchor::Anchor;
use crate::scene::proxy::Scene;
use crate::scene::read::ImportError;
use crate::scene::report::{Format, ImportReport};
use crate::settings::ProxySettings;

/// A CityJSON sequence: a line with the transform and the reference system, then a line for each feature, with vertices of its own.
pub(crate) fn read(
    file: &str,
    bytes: &[u8],
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let damaged = |source| ImportError::Json { file: file.into(), source };
    let mut lines = serde_json::Deserializer::from_slice(bytes).into_iter::<CityModel>();
    let mut whole = lines.next().transpose().map_err(damaged)?.unwrap_or_default();
    for feature in lines {
        whole.append(feature.map_err(damaged)?);
    }
    scene_of(file, &whole, Format::CityJsonSeq, settings, anchor)
}

impl CityModel {
    /// Takes over a feature of the same sequence. Two of one key are one object, the later one's.
    fn append(&mut self, feature: Self) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(feature.vertices);
        for (key, mut object) in feature.objects {
            object.geometry.0.iter_mut().for_each(|geometry| geometry.boundaries.root.renumber(first));
            self.objects.insert(key, object);
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::super::tests::{read_value, shell, town};
    use super::*;
    use crate::settings::Settings;

    /// The town as a sequence: each feature has the vertices that it uses, numbered from 0.
    fn sequence() -> String {
        let town = town();
        let vertices = town["vertices"].as_array().unwrap();
        let head = json!({ "type": "CityJSON", "version": "2.0", "transform": town["transform"], "metadata": town["metadata"],
            "CityObjects": {}, "vertices": [] });
        let feature = |id: &str, keys: &[&str], used: &[Value]| {
            let mut objects: Value = keys.iter().map(|key| ((*key).to_owned(), town["CityObjects"][key].clone())).collect();
            if id == "hall" {
                objects["hall"]["geometry"][0]["boundaries"] = json!([[shell(0)]]);
            }
            json!({ "type": "CityJSONFeature", "id": id, "CityObjects": objects, "vertices": used })
        };
        let lines =
            [head, feature("hall", &["hall"], &vertices[8..16]), feature("house", &["house", "house-0", "road"], vertices)];
        lines.iter().map(|line| format!("{line}\n")).collect()
    }

    #[test]
    fn a_sequence_says_what_the_whole_file_says() {
        let read_text = |text: &str| crate::scene::read("town.city.jsonl", text.as_bytes(), &Settings::default().proxy);
        let (scene, report) = read_text(&sequence()).unwrap();
        let (whole, _) = read_value(&town()).unwrap();
        assert_eq!((report.format, &scene.structures, &scene.frame), (Format::CityJsonSeq, &whole.structures, &whole.frame));
        assert_eq!(scene.name, "town");
        let cut = sequence();
        let error = read_text(&cut[..cut.len() - 10]).unwrap_err();
        assert!(matches!(error, ImportError::Json { .. }), "{error}");
        let headless = cut.split_once('\n').unwrap().1;
        assert!(matches!(read_text(headless), Err(ImportError::UnknownFormat { .. })));
    }
}
