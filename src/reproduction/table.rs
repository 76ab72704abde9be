//! Tables of figures, before anybody writes them down.

use super::statistics::Spread;

/// A table with the paper's rows and ours.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Short and unique: `table1`.
    pub key: &'static str,
    pub title: String,
    /// Heads with units, for the cells of every row.
    pub columns: Vec<&'static str>,
    pub rows: Vec<Row>,
    /// What a reader has to know to compare the rows.
    pub notes: Vec<String>,
}

/// Whose figures a row gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    Paper,
    Overfly,
}

impl Source {
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Overfly => "overfly",
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub source: Source,
    pub cells: Vec<Cell>,
}

/// One cell; figures know to how many decimals they are worth printing.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    Text(String),
    Number { value: f64, decimals: usize },
    Spread { spread: Spread, decimals: usize },
    Missing,
}

impl Cell {
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    pub fn number(value: f64, decimals: usize) -> Self {
        Self::Number { value, decimals }
    }

    /// Median and range; missing where a run has no finite figure.
    pub fn spread(values: &[f64], decimals: usize) -> Self {
        Spread::of(values).map_or(Self::Missing, |spread| Self::Spread { spread, decimals })
    }

    /// The figure, or the median; `None` for text and what is missing.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Number { value, .. } => Some(*value),
            Self::Spread { spread, .. } => Some(spread.median),
            Self::Text(_) | Self::Missing => None,
        }
    }
}

impl Table {
    pub fn new(key: &'static str, title: impl Into<String>, columns: &[&'static str]) -> Self {
        Self { key, title: title.into(), columns: columns.to_vec(), rows: Vec::new(), notes: Vec::new() }
    }

    /// A row of the paper: its labels, then its figures with their decimals.
    pub fn paper(&mut self, labels: &[&str], figures: &[(f64, usize)]) {
        let figures = figures.iter().map(|&(value, decimals)| Cell::number(value, decimals)).collect();
        self.push(Source::Paper, labels, figures);
    }

    /// A row of ours: its labels, then its figures.
    pub fn ours(&mut self, labels: &[&str], figures: Vec<Cell>) {
        self.push(Source::Overfly, labels, figures);
    }

    pub fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Cells that a row lacks are missing ones: the paper does not give every figure that we do.
    fn push(&mut self, source: Source, labels: &[&str], figures: Vec<Cell>) {
        let mut cells: Vec<Cell> = labels.iter().map(|label| Cell::text(*label)).chain(figures).collect();
        assert!(cells.len() <= self.columns.len(), "{} has {} columns", self.key, self.columns.len());
        cells.resize(self.columns.len(), Cell::Missing);
        self.rows.push(Row { source, cells });
    }
}
