//! Tables of numbers in a page, with units and explanations.

use serde::Serialize;

/// A table of a report's numbers.
#[derive(Debug, Clone, Serialize)]
pub struct NumberTable {
    title: String,
    rows: Vec<NumberRow>,
}

#[derive(Debug, Clone, Serialize)]
struct NumberRow {
    name: String,
    value: String,
    unit: String,
    meaning: String,
}

impl NumberTable {
    /// A table without rows.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            rows: vec![],
        }
    }

    /// Adds a number with its unit, and what it means in one line.
    pub fn row(
        &mut self,
        name: impl Into<String>,
        value: impl Into<String>,
        unit: impl Into<String>,
        meaning: impl Into<String>,
    ) {
        self.rows.push(NumberRow {
            name: name.into(),
            value: value.into(),
            unit: unit.into(),
            meaning: meaning.into(),
        });
    }
}
