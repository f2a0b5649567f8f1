//! Which shells of two solids go to each other, as text: in each line the number of one of the domain's and that of one of the
//! target's.
//!
//! Shells are components and cavities. They count from 0 in the order of their first triangles, as `solidmap check` lists them, and are
//! separated by spaces, tabs, commas or semicolons; `#` starts a comment, and lines without anything else are skipped.

use std::path::Path;

use super::number_rows::read_number_rows;
use crate::io::{IoError, Place};

/// Reads pairs of shells, for [`PairOptions::components`](crate::boundary_map::pair::PairOptions::components). That there are such
/// shells, and that they can go to each other, is for the map to check.
///
/// # Errors
///
/// When the file cannot be read, holds no pair, or a line is not two numbers.
pub fn read_components(path: impl AsRef<Path>) -> Result<Vec<[usize; 2]>, IoError> {
    let path = path.as_ref();
    let expected = "two numbers of components or cavities (of the domain and of the target)";
    let rows = read_number_rows::<2>(path, "component", expected)?;
    match rows.is_empty() {
        true => Err(IoError::Malformed {
            path: path.to_owned(),
            format: "component",
            place: Place::Line(1),
            found: "found no pair of components or cavities; write a line for each, or leave the file out".into(),
        }),
        false => Ok(rows.iter().map(|row| row.numbers.map(|shell| shell as usize)).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &[u8]) -> Result<Vec<[usize; 2]>, IoError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("components.txt");
        std::fs::write(&path, content).unwrap();
        read_components(&path)
    }

    #[test]
    fn a_line_holds_a_shell_of_each_solid() {
        let pairs = read(b"# domain target\n0 1\r\n\n1;0 # the smaller one\n 7,\t3").unwrap();
        assert_eq!(pairs, [[0, 1], [1, 0], [7, 3]]);
    }

    #[test]
    fn errors_name_the_line_and_what_is_wrong_with_it() {
        for (content, expected) in [
            (
                &b"0 1\n2\n"[..],
                "line 2: found 1 number, but a line holds two numbers of components or cavities",
            ),
            (b"0 1 2\n", "line 1: found 3 numbers"),
            (b"\n0 -1\n", "line 2: found `-1`"),
            (b"0 99999999999999999999\n", "line 1: found `99999999999999999999`"),
            (b"one two\n", "line 1: found `one`"),
            (b"# nothing\n", "found no pair"),
        ] {
            let found = read(content).unwrap_err().to_string();
            assert!(found.contains(expected) && found.contains("components.txt"), "{found}");
        }
    }
}
