//! What a command has to say at its end, for people and for scripts.

use std::io::{self, IsTerminal, Write};

use serde_json::Value;

/// The result of a command.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Lines for a person.
    pub text: String,
    /// The same as one object.
    pub json: Value,
}

/// How answers are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    Text,
    Json,
}

impl Form {
    /// Prints an answer on standard output. A reader that has gone away (`| head`) is no error.
    pub fn print(self, answer: &Answer) -> io::Result<()> {
        let mut out = io::stdout().lock();
        let printed = match self {
            Form::Text => writeln!(out, "{}", answer.text.trim_end()),
            Form::Json => writeln!(out, "{}", answer.json),
        };
        match printed.and_then(|()| out.flush()) {
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error),
            _ => Ok(()),
        }
    }

    /// Prints a remark on standard error; scripts do without.
    pub fn remark(self, text: &str) {
        if self == Form::Text {
            eprintln!("{text}");
        }
    }

    /// Whether moving progress makes sense.
    pub fn shows_progress(self) -> bool {
        self == Form::Text && io::stderr().is_terminal()
    }
}

/// Lays rows of cells out in columns: the first one to the left, the others to the right.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().enumerate().map(|(column, cell)| match column {
            0 => format!("{cell:<width$}", width = widths[0]),
            _ => format!("{cell:>width$}", width = widths[column]),
        });
        cells.collect::<Vec<_>>().join("   ").trim_end().to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_whatever_the_length_of_their_cells() {
        let rows = [vec!["length, m".to_owned(), "1".to_owned()], vec!["é".to_owned(), "1234".to_owned()]];
        assert_eq!(table(&rows), "length, m      1\né           1234");
    }
}
