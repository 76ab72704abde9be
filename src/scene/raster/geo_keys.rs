//! Where a raster or a point cloud says which reference system its coordinates have: GeoKeys (OGC 19-008r4) and well-known text.

/// What a file says of its coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Reference {
    /// Code of the projected system.
    pub epsg: Option<u32>,
    /// The coordinates are degrees; of this system, where it says.
    pub geographic: Option<Option<u32>>,
    /// Metres in a unit of the grid and of the heights, where the file says.
    pub unit_m: Option<f64>,
    pub height_unit_m: Option<f64>,
    /// Heights belong to the middles of the outer cells, so that the origin is half a cell inside.
    pub is_point: bool,
}

const MODEL_TYPE: u16 = 1024;
const RASTER_TYPE: u16 = 1025;
const GEOGRAPHIC: u16 = 2048;
const PROJECTED: u16 = 3072;
const LINEAR_UNITS: u16 = 3076;
const VERTICAL_UNITS: u16 = 4099;
const USER_DEFINED: u16 = 32767;

/// Reads a GeoKeyDirectory: four numbers about itself, then key, place, count and value of each entry. Values that do not stand in the directory itself
/// (names, parameters of a system of one's own) are not needed.
pub(super) fn of_keys(directory: &[u16]) -> Reference {
    let mut reference = Reference::default();
    let (mut model, mut geographic) = (None, None);
    let entries = directory.get(4..).unwrap_or_default().chunks_exact(4);
    for entry in entries.filter(|entry| entry[1] == 0) {
        let value = entry[3];
        let code = (value != USER_DEFINED && value != 0).then_some(u32::from(value));
        match entry[0] {
            MODEL_TYPE => model = Some(value),
            RASTER_TYPE => reference.is_point = value == 2,
            GEOGRAPHIC => geographic = code,
            PROJECTED => reference.epsg = code,
            LINEAR_UNITS => reference.unit_m = unit_m(value),
            VERTICAL_UNITS => reference.height_unit_m = unit_m(value),
            _ => {}
        }
    }
    if model == Some(2) || (model != Some(1) && reference.epsg.is_none() && geographic.is_some()) {
        reference.geographic = Some(geographic);
    }
    reference
}

/// Metres in a unit of length by its EPSG code.
fn unit_m(code: u16) -> Option<f64> {
    match code {
        9001 => Some(1.0),
        9002 => Some(0.3048),
        9003 => Some(1200.0 / 3937.0),
        _ => None,
    }
}

/// Reads the code of the projected system in well-known text: that of `PROJCS[...]` or `PROJCRS[...]` itself, not of what stands in it.
pub(super) fn of_text(text: &str) -> Reference {
    let upper = text.to_ascii_uppercase();
    let starts = |names: [&str; 3]| names.iter().filter_map(|name| upper.find(name)).min();
    if let Some(start) = starts(["PROJCS[", "PROJCRS[", "PROJECTEDCRS["]) {
        return Reference { epsg: own_code(&upper[start..]), ..Reference::default() };
    }
    let geographic = starts(["GEOGCS[", "GEOGCRS[", "GEODCRS["]).map(|start| own_code(&upper[start..]));
    Reference { geographic, ..Reference::default() }
}

/// The EPSG code directly within the brackets with which `text` begins.
fn own_code(text: &str) -> Option<u32> {
    let mut depth = 0;
    for (index, byte) in text.bytes().enumerate() {
        match byte {
            b'[' | b'(' => depth += 1,
            b']' | b')' if depth == 1 => return None,
            b']' | b')' => depth -= 1,
            _ => {}
        }
        let rest = &text.as_bytes()[index..];
        let after = [&b"AUTHORITY[\"EPSG\","[..], b"ID[\"EPSG\","].into_iter().find_map(|name| rest.strip_prefix(name));
        if let (1, Some(after)) = (depth, after) {
            let digits: String = after.iter().skip_while(|byte| **byte == b'"').map(|&byte| char::from(byte)).take(9).collect();
            return digits.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok();
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn keys_tell_system_units_and_where_the_heights_stand() {
        let utm = of_keys(&[1, 1, 0, 4, 1024, 0, 1, 1, 1025, 0, 1, 2, 3072, 0, 1, 25830, 3076, 0, 1, 9001]);
        assert_eq!(utm, Reference { epsg: Some(25830), unit_m: Some(1.0), is_point: true, ..Reference::default() });
        let degrees = of_keys(&[1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326]);
        assert_eq!((degrees.geographic, degrees.epsg), (Some(Some(4326)), None));
        let feet = of_keys(&[1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 2263, 4099, 0, 1, 9003]);
        assert!((feet.height_unit_m.unwrap() - 0.304_800_6).abs() < 1e-7);
        assert_eq!(of_keys(&[1, 1, 0, 1, 3072, 0, 1, 32767]), Reference::default());
        assert_eq!(of_keys(&[1, 1]), Reference::default());
    }

    #[test]
    fn text_tells_the_code_of_the_grid_and_not_of_its_parts() {
        let old = r#"COMPD_CS["x",PROJCS["Amersfoort / RD New",GEOGCS["Amersfoort",AUTHORITY["EPSG","4289"]],UNIT["metre",1,AUTHORITY["EPSG","9001"]],
            AUTHORITY["EPSG","28992"]],VERT_CS["NAP",AUTHORITY["EPSG","5709"]],AUTHORITY["EPSG","7415"]]"#;
        assert_eq!(of_text(old).epsg, Some(28992));
        let new = r#"PROJCRS["ETRS89 / UTM 30N",BASEGEOGCRS["ETRS89",ID["EPSG",4258]],ID["EPSG",25830]]"#;
        assert_eq!(of_text(new).epsg, Some(25830));
        assert_eq!(of_text(r#"GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]]"#).geographic, Some(Some(4326)));
        assert_eq!(of_text(r#"PROJCS["own",UNIT["m",1]]"#), Reference::default());
    }

    proptest! {
        #[test]
        fn any_text_is_read(text in ".{0,60}", keys in proptest::collection::vec(any::<u16>(), 0..40)) {
            of_text(&format!("PROJCS[{text}"));
            of_keys(&keys);
        }
    }
}
