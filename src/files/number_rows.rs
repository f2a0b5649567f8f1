//! Rows of whole numbers as text: separated by spaces, tabs, commas or semicolons; `#` starts a comment, and lines without numbers are
//! skipped.

use std::path::Path;

use crate::io::{IoError, Place, read_bytes};

/// A line with numbers.
pub(super) struct NumberRow<const N: usize> {
    pub numbers: [u32; N],
    /// Counted from 1.
    pub line: usize,
}

/// Reads the rows of a file of a format that errors name; `expected` says what a line holds.
///
/// # Errors
///
/// When the file cannot be read, or a line does not hold `N` numbers.
pub(super) fn read_number_rows<const N: usize>(
    path: &Path,
    format: &'static str,
    expected: &str,
) -> Result<Vec<NumberRow<N>>, IoError> {
    let bytes = read_bytes(path)?;
    // Bytes that are not UTF-8 are replaced by a character that is refused below.
    let text = String::from_utf8_lossy(&bytes);
    let mut rows = Vec::new();
    for (k, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default();
        let is_separator = |c: char| c.is_whitespace() || c == ',' || c == ';';
        let words: Vec<&str> = content.split(is_separator).filter(|word| !word.is_empty()).collect();
        if !words.is_empty() {
            let numbers = numbers(&words, expected).map_err(|found| IoError::Malformed {
                path: path.to_owned(),
                format,
                place: Place::Line(k + 1),
                found,
            })?;
            rows.push(NumberRow { numbers, line: k + 1 });
        }
    }
    Ok(rows)
}

/// The `N` numbers of a line, or what was found instead.
fn numbers<const N: usize>(words: &[&str], expected: &str) -> Result<[u32; N], String> {
    let mut numbers = [0; N];
    for (number, word) in numbers.iter_mut().zip(words) {
        *number = word.parse().map_err(|_| {
            let shown: String = word.chars().take(40).collect();
            format!(
                "found `{}`, but a line holds {expected}, counted from 0",
                shown.escape_debug()
            )
        })?;
    }
    if words.len() == N {
        Ok(numbers)
    } else {
        let found = if words.len() == 1 { "number" } else { "numbers" };
        Err(format!("found {} {found}, but a line holds {expected}", words.len()))
    }
}
