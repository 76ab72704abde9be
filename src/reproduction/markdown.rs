//! Tables as Markdown.

use std::fmt::Write;

use super::table::{Cell, Row, Table};

/// A table under a heading of the given level, with its notes below.
pub fn table(table: &Table, level: usize) -> String {
    let mut text = format!("{} {}\n\n", "#".repeat(level), table.title);
    let heads: Vec<String> = std::iter::once("By").chain(table.columns.iter().copied()).map(escaped).collect();
    line(&mut text, &heads);
    let rules: Vec<String> =
        (0..heads.len()).map(|column| if is_text(table, column) { "---" } else { "---:" }.to_owned()).collect();
    line(&mut text, &rules);
    table.rows.iter().for_each(|row| line(&mut text, &cells(row)));
    text.push('\n');
    for note in &table.notes {
        let _ = writeln!(text, "- {}", escaped(note));
    }
    if !table.notes.is_empty() {
        text.push('\n');
    }
    text
}

fn line(text: &mut String, cells: &[String]) {
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

fn cells(row: &Row) -> Vec<String> {
    std::iter::once(row.source.name().to_owned()).chain(row.cells.iter().map(cell)).collect()
}

/// Whether a column holds labels; the first one names the source.
fn is_text(table: &Table, column: usize) -> bool {
    column == 0 || table.rows.iter().any(|row| matches!(row.cells[column - 1], Cell::Text(_)))
}

/// The cell as it stands in a table: a median with its range where there are several runs.
pub fn cell(cell: &Cell) -> String {
    match cell {
        Cell::Text(text) => escaped(text),
        Cell::Number { value, decimals } => format!("{value:.decimals$}"),
        Cell::Spread { spread, decimals } if spread.runs == 1 => format!("{:.decimals$}", spread.median),
        Cell::Spread { spread, decimals } => {
            format!("{:.decimals$} [{:.decimals$}..{:.decimals$}]", spread.median, spread.least, spread.most)
        }
        Cell::Missing => "–".to_owned(),
    }
}

/// Nothing in a cell may end it or the line.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('|', "\\|").replace(['\n', '\r'], " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_written_with_both_sources_ranges_and_notes() {
        let mut figures = Table::new("t", "Table 0. Test", &["Method", "Length [m]", "Coverage [%]"]);
        figures.paper(&["a|b"], &[(2151.0, 0)]);
        figures.ours(&["c"], vec![Cell::spread(&[1.0, 3.0, 2.5], 1), Cell::spread(&[9.0], 0)]);
        figures.note("seen");
        figures.note("seen");
        let expected = "## Table 0. Test\n\n| By | Method | Length [m] | Coverage [%] |\n| --- | --- | ---: | ---: |\n\
                        | paper | a\\|b | 2151 | – |\n| overfly | c | 2.5 [1.0..3.0] | 9 |\n\n- seen\n\n";
        assert_eq!(table(&figures, 2), expected);
    }
}
