use std::fmt;

use serde::Serialize;

/// The alignment of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Align {
    /// For words.
    Left,
    /// For numbers.
    Right,
}

/// A plain-text table of `N` columns: a heading, units where there are any, a rule, and rows. Its `Display` gives the
/// lines, each ended, with columns two spaces apart and nothing after the last.
///
/// ```
/// use solidmap_cli::drawing::{Align, Table};
///
/// let mut table = Table::new([("method", "", Align::Left), ("time", "s", Align::Right)]);
/// table.row(["mfs".into(), "0.41".into()]);
/// table.row(["fem".into(), "12.90".into()]);
/// let text = "method   time\n            s\n------  -----\nmfs      0.41\nfem     12.90\n";
/// assert_eq!(table.to_string(), text);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Table<const N: usize> {
    content: TableContent,
}

impl<const N: usize> Table<N> {
    /// A table without rows; a column is its heading, its unit (or `""`) and its alignment.
    pub fn new(columns: [(&str, &str, Align); N]) -> Self {
        let column = |(head, unit, align): (&str, &str, Align)| TableColumn {
            head: head.to_owned(),
            unit: unit.to_owned(),
            align,
        };
        Self {
            content: TableContent {
                columns: columns.map(column).into(),
                rows: Vec::new(),
            },
        }
    }

    /// Adds a row at the end.
    pub fn row(&mut self, cells: [String; N]) {
        self.content.rows.push(cells.into());
    }

    /// What it says, with the number of columns forgotten.
    pub fn into_content(self) -> TableContent {
        self.content
    }
}

impl<const N: usize> fmt::Display for Table<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.content.fmt(f)
    }
}

/// A column of a table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TableColumn {
    /// Its heading; empty where that of the column before stands over it, too.
    pub head: String,
    /// Its unit, or empty.
    pub unit: String,
    /// Its alignment.
    pub align: Align,
}

/// What a table of any number of columns says. Its `Display` is that of [`Table`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TableContent {
    /// The columns.
    pub columns: Vec<TableColumn>,
    /// The rows, from left to right.
    pub rows: Vec<Vec<String>>,
}

impl TableContent {
    /// The same table in Markdown (GitHub's), units in brackets behind the headings.
    pub fn to_markdown(&self) -> String {
        let head = |column: &TableColumn| match (column.head.as_str(), column.unit.as_str()) {
            (head, "") => head.to_owned(),
            ("", unit) => unit.to_owned(),
            (head, unit) => format!("{head} ({unit})"),
        };
        let line = |cells: &[String]| {
            let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rules = self.columns.iter().map(|column| match column.align {
            Align::Left => "---",
            Align::Right => "--:",
        });
        let mut text = line(&self.columns.iter().map(head).collect::<Vec<_>>());
        text += &format!("|{}|\n", rules.collect::<Vec<_>>().join("|"));
        self.rows.iter().for_each(|row| text += &line(row));
        text
    }

    fn write_line(&self, f: &mut fmt::Formatter<'_>, cells: &[String], widths: &[usize]) -> fmt::Result {
        let mut line = String::new();
        for (k, ((cell, column), &width)) in cells.iter().zip(&self.columns).zip(widths).enumerate() {
            let gap = if k > 0 { "  " } else { "" };
            line += &match column.align {
                Align::Left => format!("{gap}{cell:<width$}"),
                Align::Right => format!("{gap}{cell:>width$}"),
            };
        }
        writeln!(f, "{}", line.trim_end())
    }
}

impl fmt::Display for TableContent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of_columns = |text: fn(&TableColumn) -> &String| self.columns.iter().map(text).cloned().collect();
        let (heads, units): (Vec<String>, Vec<String>) = (of_columns(|c| &c.head), of_columns(|c| &c.unit));
        let mut widths = vec![0; self.columns.len()];
        for line in [&heads, &units].into_iter().chain(&self.rows) {
            for (width, cell) in widths.iter_mut().zip(line) {
                *width = (*width).max(cell.chars().count());
            }
        }
        self.write_line(f, &heads, &widths)?;
        if units.iter().any(|unit| !unit.is_empty()) {
            self.write_line(f, &units, &widths)?;
        }
        let rules: Vec<String> = widths.iter().map(|&width| "-".repeat(width)).collect();
        self.write_line(f, &rules, &widths)?;
        self.rows.iter().try_for_each(|row| self.write_line(f, row, &widths))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markdown_has_the_same_cells() {
        let mut table = Table::new([
            ("method", "", Align::Left),
            ("error", "rms", Align::Right),
            ("", "max", Align::Right),
        ]);
        table.row(["a|b".into(), "1e-4".into(), "2e-4".into()]);
        let expected = "| method | error (rms) | max |\n|---|--:|--:|\n| a\\|b | 1e-4 | 2e-4 |\n";
        assert_eq!(table.into_content().to_markdown(), expected);
    }

    #[test]
    fn columns_are_aligned_and_as_wide_as_their_widest_cell() {
        let mut table = Table::new([("solid", "", Align::Left), ("p99", "", Align::Right)]);
        table.row(["moai".into(), "1.2e-4".into()]);
        table.row(["bunny × 2".into(), "3e-4".into()]);
        assert_eq!(
            table.to_string(),
            "solid         p99\n---------  ------\nmoai       1.2e-4\nbunny × 2    3e-4\n"
        );
    }
}
