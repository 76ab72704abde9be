//! Heights of no-fly zones: whatever cannot be read without doubt is refused.

use serde_json::{Map, Value};

use super::{BASE_KEY, HEIGHT_KEYS, Reading, measure, plain_number, quantity};
use crate::scene::footprint::Repair;
use crate::scene::report::ItemKind;

/// What zones of flight services (ED-269, ED-318) say of their heights, and what of it is metres above the ground. Whatever else stands there cannot be kept.
const ZONE_REFERENCES: [(&[&str], &[&str]); 2] = [
    (
        &["verticalReference", "lowerVerticalReference", "upperVerticalReference", "lowerReference", "upperReference"],
        &["AGL", "SFC", "GND"],
    ),
    (&["uom", "uomDimensions"], &["M", "m"]),
];

/// Whether a property says from where a zone's heights count, or in which unit.
pub(super) fn is_reference(key: &str) -> bool {
    ZONE_REFERENCES.iter().any(|(keys, _)| keys.contains(&key))
}

/// Floor and ceiling of a no-fly zone above the ground below; the ceiling of a zone without a height is [`f64::MAX`]. What is given must be readable
/// without doubt: the error says what is not, and what to do about it.
pub(crate) fn zone_heights(
    properties: &Map<String, Value>,
    repairs: &mut Vec<Repair>,
) -> Result<(f64, f64), (String, &'static str)> {
    const REMEDY: &str = "write `min_height` and `height` as numbers (metres above ground), or leave `height` out for no ceiling";
    for (key, known) in ZONE_REFERENCES.iter().flat_map(|(keys, known)| keys.iter().map(move |key| (*key, *known))) {
        let Some(value) = properties.get(key).filter(|value| !value.is_null()) else { continue };
        let is_known = value.as_str().is_some_and(|text| known.iter().any(|known| text.trim().eq_ignore_ascii_case(known)));
        if !is_known {
            let shown: String = value.to_string().chars().take(40).collect();
            return Err((format!("says that its heights are of another kind (`{key}` is {shown})"), REMEDY));
        }
    }
    let mut read = |key: &str| -> Result<Option<f64>, (String, &'static str)> {
        let Some(value) = properties.get(key).filter(|value| !value.is_null()) else { return Ok(None) };
        let found = single_length(value).map_err(|reason| (format!("has a `{key}` that {reason}"), REMEDY))?;
        if let Some(reading) = found.reading {
            repairs.push((ItemKind::HeightText, format!("`{key}` {reading}")));
        }
        Ok(Some(found.value))
    };
    let given_floor_m = read(BASE_KEY)?.unwrap_or(0.0);
    let mut ceiling_m: Option<f64> = None;
    for key in HEIGHT_KEYS {
        // Where several are given the zone reaches to the highest.
        ceiling_m = read(key)?.map_or(ceiling_m, |found| Some(ceiling_m.map_or(found, |other| other.max(found))));
    }
    let floor_m = given_floor_m.max(0.0);
    let ceiling_m = ceiling_m.unwrap_or(f64::MAX);
    if floor_m >= ceiling_m {
        return Err((format!("has its ceiling at {ceiling_m} m, not above its floor at {floor_m} m"), REMEDY));
    }
    if given_floor_m < 0.0 {
        repairs.push((ItemKind::BaseIgnored, format!("the floor {given_floor_m} m lies below the ground: set to the ground")));
    }
    Ok((floor_m, ceiling_m))
}

/// A length that is one number, with or without a unit.
fn single_length(value: &Value) -> Result<Reading, String> {
    let Value::String(text) = value else { return quantity(value) };
    let shown: String = text.chars().take(40).collect();
    match (plain_number(text.trim()), measure(text.trim())) {
        (Some(value), _) => Ok(Reading { value, reading: None }),
        (None, Some(value)) => Ok(Reading { value, reading: Some(format!("{shown:?} read as {value}")) }),
        (None, None) => Err(format!("cannot be read ({shown:?})")),
    }
}
