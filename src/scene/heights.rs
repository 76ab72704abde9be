//! Heights out of the properties of a GeoJSON feature, however they are written (OpenStreetMap keys `height`, `min_height`,
//! `building:levels`, `building:min_level`).

mod zones;

use serde_json::{Map, Value};

pub(crate) use self::zones::zone_heights;
use super::footprint::Repair;
use super::report::ItemKind;
use crate::settings::ProxySettings;

const HEIGHT_KEYS: [&str; 3] = ["height", "building:height", "measuredHeight"];
const LEVEL_KEYS: [&str; 2] = ["building:levels", "levels"];

/// The lower end: in metres of buildings and zones, in storeys of buildings.
const BASE_KEY: &str = "min_height";
const BASE_LEVEL_KEY: &str = "building:min_level";

/// The roof above the storeys, in metres and in storeys.
const ROOF_KEY: &str = "roof:height";
const ROOF_LEVEL_KEY: &str = "roof:levels";

/// Lower heights are taken for a mistake, m.
const LEAST_HEIGHT_M: f64 = 0.1;

/// A storey is taken to be this much lower or higher than the setting before height and storeys are said to disagree, share.
const STOREY_TOLERANCE: f64 = 1.0 / 3.0;

/// Whether a property says something about heights.
pub(crate) fn is_key(key: &str) -> bool {
    HEIGHT_KEYS.contains(&key)
        || LEVEL_KEYS.contains(&key)
        || [BASE_KEY, BASE_LEVEL_KEY, ROOF_KEY, ROOF_LEVEL_KEY].contains(&key)
        || zones::is_reference(key)
}

/// The vertical extent of a building, heights above ground.
pub(crate) struct Heights {
    pub base_m: f64,
    pub top_m: f64,
    /// Why nothing is known of the height, where that is so; `top_m` is the setting's then.
    pub missing: Option<String>,
}

/// The vertical extent that `properties` give, gaps filled from `settings`; what had to be read or guessed goes to `repairs`.
pub(crate) fn heights(properties: &Map<String, Value>, settings: &ProxySettings, repairs: &mut Vec<Repair>) -> Heights {
    let height = first_of(properties, &HEIGHT_KEYS, |value| length_m(value, settings.max_height_m));
    let levels = first_of(properties, &LEVEL_KEYS, |value| storeys(value, settings));
    let base_m = base(properties, settings, repairs);
    let (top_m, missing) = match (height, levels) {
        (Sought::Found(height), levels) => {
            if let Some(reading) = height.reading {
                repairs.push((ItemKind::HeightText, reading));
            }
            if let Sought::Found(levels) = levels {
                compare(height.value, levels.value, settings, repairs);
            }
            (height.value, None)
        }
        (height, Sought::Found(levels)) => {
            let (roof_m, roof) = roof(properties, settings);
            let top_m = levels.value * settings.storey_height_m + roof_m;
            let reading = levels.reading.map_or(String::new(), |reading| format!(" ({reading})"));
            let why = height.reason("height");
            let text = format!("{why}; {} storeys{reading} of {} m{roof}: {top_m} m", levels.value, settings.storey_height_m);
            repairs.push((ItemKind::HeightGuessed, text));
            (top_m, None)
        }
        (height, levels) => {
            let why = [height.reason("height"), levels.reason("number of storeys")].join(", ");
            (base_m + settings.default_height_m, Some(why))
        }
    };
    if base_m > 0.0 && top_m - base_m < LEAST_HEIGHT_M {
        repairs.push((
            ItemKind::BaseIgnored,
            format!("the lower end {base_m} m is not below the height {top_m} m; set to the ground"),
        ));
        return Heights { base_m: 0.0, top_m, missing };
    }
    Heights { base_m, top_m, missing }
}

/// A number, and how it was read when that was not plain.
struct Reading {
    value: f64,
    reading: Option<String>,
}

enum Sought {
    Found(Reading),
    Missing,
    Bad(String),
}

impl Sought {
    fn reason(&self, what: &str) -> String {
        match self {
            Self::Bad(reason) => reason.clone(),
            _ => format!("no {what}"),
        }
    }
}

/// The first key with a usable value; else what is wrong with the first key that is there.
fn first_of(properties: &Map<String, Value>, keys: &[&str], read: impl Fn(&Value) -> Result<Reading, String>) -> Sought {
    let mut sought = Sought::Missing;
    for key in keys {
        let Some(value) = properties.get(*key) else { continue };
        match read(value) {
            Ok(mut found) => {
                found.reading = found.reading.map(|reading| format!("`{key}` {reading}"));
                return Sought::Found(found);
            }
            Err(reason) if matches!(sought, Sought::Missing) => sought = Sought::Bad(format!("`{key}` {reason}")),
            Err(_) => {}
        }
    }
    sought
}

fn base(properties: &Map<String, Value>, settings: &ProxySettings, repairs: &mut Vec<Repair>) -> f64 {
    let (key, unit_m) = if properties.get(BASE_KEY).is_some_and(|value| !value.is_null()) {
        (BASE_KEY, 1.0)
    } else {
        (BASE_LEVEL_KEY, settings.storey_height_m)
    };
    let Some(value) = properties.get(key).filter(|value| !value.is_null()) else { return 0.0 };
    match quantity(value) {
        Ok(found) if (0.0..=settings.max_height_m).contains(&(found.value * unit_m)) => found.value * unit_m,
        Ok(found) => {
            repairs.push((ItemKind::BaseIgnored, format!("`{key}` is {}; set to the ground", found.value)));
            0.0
        }
        Err(reason) => {
            repairs.push((ItemKind::BaseIgnored, format!("`{key}` {reason}; set to the ground")));
            0.0
        }
    }
}

/// What the roof adds to the storeys, m, and how that is said; the height of a building has it in it.
fn roof(properties: &Map<String, Value>, settings: &ProxySettings) -> (f64, String) {
    for (key, unit_m) in [(ROOF_KEY, 1.0), (ROOF_LEVEL_KEY, settings.storey_height_m)] {
        let found = properties.get(key).and_then(|value| quantity(value).ok()).map(|found| found.value * unit_m);
        if let Some(roof_m) = found.filter(|roof_m| *roof_m > 0.0 && *roof_m <= settings.max_height_m) {
            return (roof_m, format!(" and a roof of {roof_m} m"));
        }
    }
    (0.0, String::new())
}

fn compare(height_m: f64, levels: f64, settings: &ProxySettings, repairs: &mut Vec<Repair>) {
    let storey_m = height_m / levels;
    if (storey_m / settings.storey_height_m - 1.0).abs() > STOREY_TOLERANCE {
        let text = format!("{height_m} m and {levels} storeys make {storey_m:.1} m a storey; the height counts");
        repairs.push((ItemKind::HeightDisagreement, text));
    }
}

fn length_m(value: &Value, max_m: f64) -> Result<Reading, String> {
    let found = quantity(value)?;
    if found.value < 0.0 {
        Err(format!("is negative ({value})"))
    } else if found.value == 0.0 {
        Err("is zero".into())
    } else if found.value < LEAST_HEIGHT_M {
        Err(format!("is below {LEAST_HEIGHT_M} m ({value})"))
    } else if found.value > max_m {
        Err(format!("is absurd ({value}; the limit is {max_m} m)"))
    } else {
        Ok(found)
    }
}

fn storeys(value: &Value, settings: &ProxySettings) -> Result<Reading, String> {
    let found = quantity(value)?;
    let most = settings.max_height_m / settings.storey_height_m;
    if found.value * settings.storey_height_m >= LEAST_HEIGHT_M && found.value <= most {
        Ok(found)
    } else {
        Err(format!("is not a number of storeys ({value})"))
    }
}

fn quantity(value: &Value) -> Result<Reading, String> {
    match value {
        Value::Number(number) => match number.as_f64().filter(|number| number.is_finite()) {
            Some(value) => Ok(Reading { value, reading: None }),
            None => Err(format!("is not finite ({number})")),
        },
        Value::String(text) => quantity_of_text(text),
        Value::Null => Err("is null".into()),
        Value::Bool(flag) => Err(format!("is a boolean ({flag})")),
        Value::Array(_) => Err("is a list".into()),
        Value::Object(_) => Err("is an object".into()),
    }
}

/// Reads "45", "45 m", "120 ft", "12,5", "~30", "6'4\"", "10;25" and "3-5"; of several values the highest.
fn quantity_of_text(text: &str) -> Result<Reading, String> {
    let shown: String = text.chars().take(40).collect();
    let trimmed = text.trim();
    if trimmed.is_empty() {
        return Err("is empty".into());
    }
    if let Some(value) = plain_number(trimmed) {
        return Ok(Reading { value, reading: None });
    }
    let values = trimmed.split(';').map(|part| one_or_range(part.trim())).collect::<Option<Vec<f64>>>();
    let highest = values.and_then(|values| values.into_iter().reduce(f64::max));
    match highest {
        Some(value) => Ok(Reading { value, reading: Some(format!("{shown:?} read as {}", (value * 1000.0).round() / 1000.0)) }),
        None => Err(format!("cannot be read ({shown:?})")),
    }
}

fn one_or_range(text: &str) -> Option<f64> {
    measure(text).or_else(|| {
        let (low, high) = text.split_once(['-', '–'])?;
        let high = measure(high.trim())?;
        measure(low.trim()).map(|low| low.max(high))
    })
}

/// A number with an optional unit of length.
fn measure(text: &str) -> Option<f64> {
    let lower = text.to_lowercase();
    let bare = ["~", "≈", "approx.", "approx", "about", "ca.", "ca", "c."]
        .iter()
        .find_map(|prefix| lower.strip_prefix(prefix))
        .unwrap_or(&lower)
        .trim_start();
    let unit_at = bare.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | ',' | '+' | '-'))).unwrap_or(bare.len());
    let (number, unit) = bare.split_at(unit_at);
    let value = plain_number(&number.replacen(',', ".", 1))?;
    let unit = unit.trim();
    if let Some(inches) = unit.strip_prefix(['\'', '′', '’']) {
        let inches = inches.trim().trim_end_matches(['"', '″', '”', '\'']);
        let inches = if inches.is_empty() { 0.0 } else { plain_number(inches)? };
        return Some(value * FOOT_M + inches * FOOT_M / 12.0);
    }
    Some(value * unit_m(unit)?)
}

const FOOT_M: f64 = 0.3048;

fn unit_m(unit: &str) -> Option<f64> {
    match unit.trim_end_matches('.') {
        "" | "m" | "meter" | "meters" | "metre" | "metres" | "mtr" => Some(1.0),
        "ft" | "foot" | "feet" => Some(FOOT_M),
        "in" | "inch" | "inches" | "\"" | "″" => Some(FOOT_M / 12.0),
        "cm" => Some(0.01),
        "mm" => Some(0.001),
        "km" => Some(1000.0),
        _ => None,
    }
}

/// A finite number in digits; unlike the standard parser it knows no "nan" and no "inf".
fn plain_number(text: &str) -> Option<f64> {
    let digits = text.chars().all(|c| c.is_ascii_digit() || matches!(c, '.' | '+' | '-' | 'e' | 'E'));
    if !digits {
        return None;
    }
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;
    use crate::settings::Settings;

    fn read(properties: Value) -> (f64, f64, bool, Vec<ItemKind>) {
        let mut repairs = Vec::new();
        let found = heights(properties.as_object().unwrap(), &Settings::default().proxy, &mut repairs);
        let top_m = (found.top_m * 1000.0).round() / 1000.0;
        (found.base_m, top_m, found.missing.is_none(), repairs.into_iter().map(|(kind, _)| kind).collect())
    }

    #[test]
    fn heights_are_read_as_they_are_written() {
        use ItemKind::*;
        let cases = [
            (json!({"height": 12.5}), (0.0, 12.5, true, vec![])),
            (json!({"height": " 15 "}), (0.0, 15.0, true, vec![])),
            (json!({"height": "45 m"}), (0.0, 45.0, true, vec![HeightText])),
            (json!({"height": "45m"}), (0.0, 45.0, true, vec![HeightText])),
            (json!({"height": "120 ft"}), (0.0, 36.576, true, vec![HeightText])),
            (json!({"height": "6'6\""}), (0.0, 1.981, true, vec![HeightText])),
            (json!({"height": "40'"}), (0.0, 12.192, true, vec![HeightText])),
            (json!({"height": "12,5"}), (0.0, 12.5, true, vec![HeightText])),
            (json!({"height": "~30"}), (0.0, 30.0, true, vec![HeightText])),
            (json!({"height": "10;25"}), (0.0, 25.0, true, vec![HeightText])),
            (json!({"height": "10 - 12 m"}), (0.0, 12.0, true, vec![HeightText])),
            (json!({"building:height": 9, "height": "?"}), (0.0, 9.0, true, vec![])),
            (json!({"building:levels": "5"}), (0.0, 15.0, true, vec![HeightGuessed])),
            (json!({"building:levels": "3;5"}), (0.0, 15.0, true, vec![HeightGuessed])),
            (json!({"height": "unknown", "building:levels": 2}), (0.0, 6.0, true, vec![HeightGuessed])),
            (json!({"height": 8.7, "building:levels": "2"}), (0.0, 8.7, true, vec![HeightDisagreement])),
            (json!({"height": 9, "building:levels": 3}), (0.0, 9.0, true, vec![])),
            (json!({"height": 20, "min_height": 12}), (12.0, 20.0, true, vec![])),
            (json!({"height": 20, "building:min_level": 2}), (6.0, 20.0, true, vec![])),
            (json!({"height": 20, "min_height": 25}), (0.0, 20.0, true, vec![BaseIgnored])),
            (json!({"height": 20, "min_height": -2}), (0.0, 20.0, true, vec![BaseIgnored])),
            (json!({"height": 20, "min_height": "low"}), (0.0, 20.0, true, vec![BaseIgnored])),
            (json!({"building:levels": 3, "roof:height": "2.5 m"}), (0.0, 11.5, true, vec![HeightGuessed])),
            (json!({"building:levels": 3, "roof:levels": 2}), (0.0, 15.0, true, vec![HeightGuessed])),
            (json!({"height": 9, "building:levels": 3, "roof:height": 3}), (0.0, 9.0, true, vec![])),
            (json!({"building:levels": 0}), (0.0, 10.0, false, vec![])),
            (json!({"building:levels": ".01"}), (0.0, 10.0, false, vec![])),
            (json!({"min_height": 30}), (30.0, 40.0, false, vec![])),
        ];
        for (properties, expected) in cases {
            assert_eq!(read(properties.clone()), expected, "{properties}");
        }
    }

    #[test]
    fn what_cannot_be_a_height_is_guessed() {
        for height in [
            json!(null),
            json!(-3),
            json!(0),
            json!(1e6),
            json!(true),
            json!([12]),
            json!({}),
            json!("NaN"),
            json!("inf"),
            json!(""),
            json!("-5"),
            json!("0"),
            json!("unknown"),
            json!("12 parsec"),
            json!("'"),
            json!("--"),
            json!(0.001),
            json!("1e999"),
        ] {
            assert_eq!(read(json!({"height": height})), (0.0, 10.0, false, vec![]), "{height}");
        }
    }

    proptest! {
        #[test]
        fn any_text_gives_a_usable_extent(height in ".{0,20}", levels in "[0-9;,.-]{0,6}", low in "[-0-9.]{0,6}") {
            let (base_m, top_m, _, _) = read(json!({"height": height, "building:levels": levels, "min_height": low}));
            prop_assert!(base_m >= 0.0 && top_m <= 2000.0 && top_m - base_m >= LEAST_HEIGHT_M - 1e-3);
        }

        #[test]
        fn metres_survive_every_spelling(height in 0.2..900.0f64) {
            for text in [format!("{height}"), format!("{height} m"), format!("{} ft", height / FOOT_M), format!("~{height}").replace('.', ",")] {
                let (_, top_m, known, _) = read(json!({"height": text}));
                prop_assert!(known && (top_m - height).abs() < 1e-3);
            }
        }
    }
}
