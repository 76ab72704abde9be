//! What the reader of a scene file did, for people: repairs change nothing in flight, guesses and omissions may.

use crate::scene::{ImportReport, Meaning};

/// Names that are listed before the rest is counted.
const FIRST_NAMES: usize = 5;

/// Lines for a person; `zones` are the no-fly zones of the configuration beside those of the file.
pub fn lines(report: &ImportReport, zones: usize) -> Vec<String> {
    let mut lines = vec![format!(
        "{}, {}, {:.0} x {:.0} m, tallest {:.1} m",
        counted(report.structures, "structure"),
        counted(report.zones + zones, "no-fly zone"),
        report.extent_m[0],
        report.extent_m[1],
        report.tallest_m
    )];
    let repairs: Vec<String> = report
        .counts
        .iter()
        .filter(|(kind, _)| kind.meaning() == Meaning::Repaired)
        .map(|(kind, count)| format!("{count} {kind}"))
        .collect();
    if !repairs.is_empty() {
        lines.push(format!("repaired: {}", repairs.join(", ")));
    }
    lines.extend(named(report, Meaning::Guessed, "guessed heights, may be taller"));
    lines.extend(named(report, Meaning::Dropped, "dropped, not avoided in flight"));
    if report.overlapping_pairs > 0 {
        let pairs = counted(report.overlapping_pairs, "pair");
        lines.push(format!("{pairs} of structures overlap; the higher one counts"));
    }
    if !report.ignored.is_empty() {
        let ignored: Vec<_> = report.ignored.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        lines.push(format!("no structures, left out: {}", ignored.join(", ")));
    }
    lines.extend(report.notes.iter().cloned());
    lines
}

/// `1 structure`, `2 structures`.
pub fn counted(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}

fn named(report: &ImportReport, wanted: Meaning, remark: &str) -> Option<String> {
    let names: Vec<&str> =
        report.items.iter().filter(|item| item.kind.meaning() == wanted).map(|item| item.structure.as_str()).collect();
    if names.is_empty() {
        return None;
    }
    let more = match names.len().saturating_sub(FIRST_NAMES) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let first = names.iter().take(FIRST_NAMES).copied().collect::<Vec<_>>().join(", ");
    Some(format!("{} {remark}: {first}{more}", names.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;
    use crate::settings::Settings;

    #[test]
    fn a_guessed_height_and_a_dropped_feature_are_named_with_what_they_mean() {
        let square = |west: f64| {
            let east = west + 0.0003;
            format!(
                r#"{{"type":"Polygon","coordinates":[[[{west},51.9],[{east},51.9],[{east},51.9002],[{west},51.9002],[{west},51.9]]]}}"#
            )
        };
        let feature = |name: &str, properties: &str, geometry: &str| {
            format!(r#"{{"type":"Feature","id":"{name}","properties":{{{properties}}},"geometry":{geometry}}}"#)
        };
        let file = format!(
            r#"{{"type":"FeatureCollection","features":[{},{},{}]}}"#,
            feature("hall", r#""height":9"#, &square(4.4)),
            feature("shed", r#""building":"yes""#, &square(4.401)),
            feature("ghost", r#""height":9"#, "null")
        );
        let (_, report) = scene::read("town.geojson", file.as_bytes(), &Settings::default().proxy).unwrap();
        let lines = lines(&report, 1);
        assert!(lines[0].starts_with("2 structures, 1 no-fly zone,"), "{lines:?}");
        let has = |text: &str| lines.iter().any(|line| line == text);
        assert!(has("1 guessed heights, may be taller: shed"), "{lines:?}");
        assert!(has("1 dropped, not avoided in flight: ghost"), "{lines:?}");
    }
}
