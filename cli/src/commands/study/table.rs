//! The table of a study in a file, which later runs go on with.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};

use super::measured::{Measured, QUANTITIES};
use crate::shared::output::write_file;

/// The last column: why a row has no measurements.
const ERROR: &str = "error";

/// Rows of settings with measurements or errors. A row is known by its key: the study, its input files, what is the same in
/// all rows, and what is varied.
pub struct StudyTable {
    path: Option<PathBuf>,
    header: Vec<String>,
    /// Number of columns that make a key.
    keys: usize,
    rows: Vec<Vec<String>>,
}

impl StudyTable {
    /// The table of a file, or an empty one where there is no file yet; without a path nothing is read or written. `varied`
    /// are the columns of the settings.
    ///
    /// Fails where the file cannot be read or holds something else.
    pub fn open(path: Option<&Path>, varied: &[&str]) -> anyhow::Result<Self> {
        let keys = ["study", "inputs", "settings"]
            .into_iter()
            .chain(varied.iter().copied());
        let keys: Vec<String> = keys.map(String::from).collect();
        let values = QUANTITIES.iter().map(|quantity| quantity.key).chain([ERROR]);
        let mut table = Self {
            path: path.map(Path::to_owned),
            header: keys.iter().cloned().chain(values.map(String::from)).collect(),
            keys: keys.len(),
            rows: Vec::new(),
        };
        if let Some(path) = path.filter(|path| path.is_file()) {
            table.rows = read(path, &table.header)?;
        }
        Ok(table)
    }

    /// The measurements of a row, if the table has any.
    pub fn find(&self, key: &[String]) -> Option<Measured> {
        let row = self.rows.iter().find(|row| row[..self.keys] == *key)?;
        let values = &row[self.keys..];
        if values.last().is_some_and(|error| !error.is_empty()) {
            return None;
        }
        let place = |key: &str| QUANTITIES.iter().position(|quantity| quantity.key == key);
        Measured::from_cells(|key| values[place(key)?].parse().ok())
    }

    /// Adds a row, or replaces that of the same key, and writes the table.
    pub fn put(&mut self, key: Vec<String>, found: Result<&Measured, &str>) -> anyhow::Result<()> {
        let (measured, error) = match found {
            Ok(measured) => (Some(measured), ""),
            Err(error) => (None, error),
        };
        let cells = QUANTITIES
            .iter()
            .map(|quantity| measured.and_then(quantity.of).map_or(String::new(), written));
        let place = self.rows.iter().position(|row| row[..self.keys] == key[..]);
        let row: Vec<String> = key.into_iter().chain(cells).chain([error.to_owned()]).collect();
        match place {
            Some(place) => self.rows[place] = row,
            None => self.rows.push(row),
        }
        self.write()
    }

    /// Writes the table, whole or not at all.
    pub fn write(&self) -> anyhow::Result<()> {
        let Some(path) = &self.path else { return Ok(()) };
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record(&self.header)?;
        self.rows.iter().try_for_each(|row| table.write_record(row))?;
        write_file(path, &table.into_inner().context("cannot make the table")?)
    }
}

/// The rows of a file, which must have these columns; none for an empty file.
fn read(path: &Path, header: &[String]) -> anyhow::Result<Vec<Vec<String>>> {
    let shown = path.display();
    let bytes = std::fs::read(path).with_context(|| format!("cannot read `{shown}`"))?;
    if bytes.is_empty() {
        return Ok(Vec::new());
    }
    let mut table = csv::Reader::from_reader(bytes.as_slice());
    let has_columns = table.headers().is_ok_and(|found| found.iter().eq(header.iter()));
    ensure!(
        has_columns,
        "`{shown}` is not a table of this study, and would be overwritten: name another file, or remove it"
    );
    let rows = table
        .records()
        .map(|record| Ok(record?.iter().map(String::from).collect()));
    let rows: Result<_, csv::Error> = rows.collect();
    rows.with_context(|| format!("cannot go on with `{shown}`: name another file, or remove it"))
}

/// A number that is read again as it was, with an exponent only where it is small or large.
fn written(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::tests::sample;
    use super::*;

    fn key(word: &str) -> Vec<String> {
        ["placement", "abc", "svd", word].map(String::from).to_vec()
    }

    #[test]
    fn rows_are_found_again_and_failed_ones_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let mut table = StudyTable::open(Some(&path), &["radius"]).unwrap();
        table.put(key("1"), Ok(&sample())).unwrap();
        table.put(key("2"), Err("too large, \"really\"")).unwrap();
        let again = StudyTable::open(Some(&path), &["radius"]).unwrap();
        assert_eq!(again.find(&key("1")), Some(sample()));
        assert_eq!(again.find(&key("2")), None);
        assert_eq!(again.find(&key("3")), None);
        let mut again = again;
        again.put(key("2"), Ok(&sample())).unwrap();
        let last = StudyTable::open(Some(&path), &["radius"]).unwrap();
        assert_eq!(last.rows.len(), 2);
        assert_eq!(last.find(&key("2")), Some(sample()));
    }

    #[test]
    fn other_tables_are_refused_and_empty_files_taken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.csv");
        std::fs::write(&path, "x,y,z\n1,2,3\n").unwrap();
        let refused = StudyTable::open(Some(&path), &["radius"]).err().unwrap().to_string();
        assert!(
            refused.contains("other.csv") && refused.contains("another file"),
            "{refused}"
        );
        std::fs::write(&path, "").unwrap();
        assert!(StudyTable::open(Some(&path), &["radius"]).unwrap().rows.is_empty());
        let table = StudyTable::open(Some(&path), &["radius"]).unwrap();
        table.write().unwrap();
        let cut = std::fs::read_to_string(&path).unwrap() + "placement,abc\n";
        std::fs::write(&path, cut).unwrap();
        assert!(StudyTable::open(Some(&path), &["radius"]).is_err());
    }
}
