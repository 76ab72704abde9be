//! Tables as JSON.

use serde_json::{Map, Value, json};

use super::statistics::Spread;
use super::table::{Cell, Table};

/// A table with its rows as objects by column.
pub fn table(table: &Table) -> Value {
    let rows: Vec<Value> = table
        .rows
        .iter()
        .map(|row| {
            let cells: Map<String, Value> =
                table.columns.iter().zip(&row.cells).map(|(column, content)| ((*column).to_owned(), cell(content))).collect();
            json!({ "by": row.source.name(), "cells": cells })
        })
        .collect();
    json!({ "key": table.key, "title": table.title, "columns": table.columns, "rows": rows, "notes": table.notes })
}

fn cell(cell: &Cell) -> Value {
    match cell {
        Cell::Text(text) => json!(text),
        Cell::Number { value, .. } => json!(value),
        Cell::Spread { spread: Spread { median, least, most, runs }, .. } => {
            json!({ "median": median, "least": least, "most": most, "runs": runs })
        }
        Cell::Missing => Value::Null,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_stand_under_their_columns() {
        let mut figures = Table::new("t", "Test", &["Method", "Length [m]", "Time [s]"]);
        figures.ours(&["a"], vec![Cell::spread(&[1.0, 2.0], 0)]);
        let expected =
            json!({ "Method": "a", "Length [m]": { "median": 1.5, "least": 1.0, "most": 2.0, "runs": 2 }, "Time [s]": null });
        assert_eq!(table(&figures)["rows"][0]["cells"], expected);
    }
}
