use std::fmt;

/// The alignment of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    heads: [String; N],
    units: [String; N],
    aligns: [Align; N],
    rows: Vec<[String; N]>,
}

impl<const N: usize> Table<N> {
    /// A table without rows; a column is its heading, its unit (or `""`) and its alignment.
    pub fn new(columns: [(&str, &str, Align); N]) -> Self {
        Self {
            heads: columns.map(|c| c.0.to_owned()),
            units: columns.map(|c| c.1.to_owned()),
            aligns: columns.map(|c| c.2),
            rows: Vec::new(),
        }
    }

    /// Adds a row at the end.
    pub fn row(&mut self, cells: [String; N]) {
        self.rows.push(cells);
    }

    /// The same table in Markdown (GitHub's), units in brackets behind the headings.
    pub fn to_markdown(&self) -> String {
        let head = |k: usize| match (self.heads[k].as_str(), self.units[k].as_str()) {
            (head, "") => head.to_owned(),
            ("", unit) => unit.to_owned(),
            (head, unit) => format!("{head} ({unit})"),
        };
        let line = |cells: Vec<String>| {
            let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rules = self.aligns.iter().map(|align| match align {
            Align::Left => "---",
            Align::Right => "--:",
        });
        let mut text = line((0..N).map(head).collect());
        text += &format!("|{}|\n", rules.collect::<Vec<_>>().join("|"));
        self.rows.iter().for_each(|row| text += &line(row.to_vec()));
        text
    }

    fn write_line(&self, f: &mut fmt::Formatter<'_>, cells: &[String; N], widths: &[usize; N]) -> fmt::Result {
        let mut line = String::new();
        for (k, cell) in cells.iter().enumerate() {
            let width = widths[k];
            let gap = if k > 0 { "  " } else { "" };
            line += &match self.aligns[k] {
                Align::Left => format!("{gap}{cell:<width$}"),
                Align::Right => format!("{gap}{cell:>width$}"),
            };
        }
        writeln!(f, "{}", line.trim_end())
    }
}

impl<const N: usize> fmt::Display for Table<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = [&self.heads, &self.units].into_iter().chain(&self.rows);
        let mut widths = [0; N];
        for line in lines {
            for (width, cell) in widths.iter_mut().zip(line) {
                *width = (*width).max(cell.chars().count());
            }
        }
        self.write_line(f, &self.heads, &widths)?;
        if self.units.iter().any(|unit| !unit.is_empty()) {
            self.write_line(f, &self.units, &widths)?;
        }
        self.write_line(f, &widths.map(|width| "-".repeat(width)), &widths)?;
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
        assert_eq!(table.to_markdown(), expected);
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
