//! What the names of files tell: the formats, the name of a scene, the file of its ground.

/// The name of a scene: the last part of its path without the endings of the known formats, or the folder's name where the file's
/// says only what every such file is.
pub(crate) fn stem(file_name: &str) -> String {
    let mut parts = file_name.rsplit(['/', '\\']).filter(|part| !part.is_empty());
    let base = parts.next().unwrap_or(file_name);
    let lower = base.to_lowercase();
    let ending = ENDINGS.into_iter().find(|ending| lower.ends_with(ending));
    let stem = ending.and_then(|ending| base.get(..base.len() - ending.len())).unwrap_or(base);
    let telling = if GENERIC_STEMS.contains(&stem.to_lowercase().as_str()) { parts.next().unwrap_or(stem) } else { stem };
    if telling.is_empty() { "scene".into() } else { super::names::tidy(telling) }
}

/// Endings of files that are read, longer ones first.
pub const ENDINGS: [&str; 17] = [
    ".city.jsonl",
    ".city.json",
    ".geo.json",
    ".osm.pbf",
    ".geojson",
    ".jsonl",
    ".json",
    ".gltf",
    ".glb",
    ".obj",
    ".pbf",
    ".ply",
    ".stl",
    ".tif",
    ".tiff",
    ".las",
    ".laz",
];

/// File names that tell nothing about the scene.
const GENERIC_STEMS: [&str; 6] = ["buildings", "building", "scene", "model", "mesh", "city"];

/// The path of the model of the ground that belongs beside a surface model, whether or not there is one: that with `dtm` in place of the last `dsm` in
/// the file's name, in capitals where that is. `None` for files of other formats.
pub fn ground_beside(file_name: &str) -> Option<String> {
    let lower = file_name.to_ascii_lowercase();
    let is_raster = [".tif", ".tiff"].iter().any(|ending| lower.ends_with(ending));
    let base = lower.rfind(['/', '\\']).map_or(0, |slash| slash + 1);
    let at = base + lower[base..].rfind("dsm").filter(|_| is_raster)?;
    let ground = if file_name[at..].starts_with("DSM") { "DTM" } else { "dtm" };
    Some(format!("{}{ground}{}", &file_name[..at], &file_name[at + 3..]))
}

#[cfg(test)]
mod tests {
    use super::stem;

    #[test]
    fn a_scene_is_named_after_its_file_or_after_the_folder_where_the_file_s_name_says_nothing() {
        for (path, name) in [
            ("/towns/delfshaven.city.json", "delfshaven"),
            ("C:\\towns\\old town.GeoJSON", "old town"),
            ("/towns/nihonbashi/buildings.geojson", "nihonbashi"),
            ("buildings.geojson", "buildings"),
            ("/.geojson", "scene"),
        ] {
            assert_eq!(stem(path), name, "{path}");
        }
    }
}
