//! Landmark curves as text: a line for each, with the vertices of the domain, `>`, and those of the target.
//!
//! Vertices count from 0 and are separated by spaces, tabs, commas or semicolons; `#` starts a comment, and lines without
//! anything else are skipped.

use std::path::Path;

use crate::boundary_map::pair::LandmarkCurve;
use crate::io::{IoError, Place, read_bytes};

/// Reads landmark curves. That their vertices exist is for the map to check.
///
/// # Errors
///
/// When the file cannot be read, holds no curve, or a line is not two lists of vertices.
pub fn read_landmark_curves(path: impl AsRef<Path>) -> Result<Vec<LandmarkCurve>, IoError> {
    let path = path.as_ref();
    let bytes = read_bytes(path)?;
    // Bytes that are not UTF-8 are replaced by a character that is refused below.
    let text = String::from_utf8_lossy(&bytes);
    let malformed = |place, found| IoError::Malformed {
        path: path.to_owned(),
        format: "landmark curve",
        place,
        found,
    };
    let mut curves = Vec::new();
    for (k, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default();
        if !content.trim().is_empty() {
            curves.push(curve(content).map_err(|found| malformed(Place::Line(k + 1), found))?);
        }
    }
    match curves.is_empty() {
        true => Err(malformed(Place::Line(1), "found no curve".into())),
        false => Ok(curves),
    }
}

fn curve(line: &str) -> Result<LandmarkCurve, String> {
    let vertices = |part: &str| -> Result<Vec<u32>, String> {
        let is_separator = |c: char| c.is_whitespace() || c == ',' || c == ';';
        let words = part.split(is_separator).filter(|word| !word.is_empty());
        let vertices: Vec<u32> = words
            .map(|word| {
                let shown: String = word.chars().take(40).collect();
                word.parse().map_err(|_| {
                    format!(
                        "found `{}`, but vertices are numbers, counted from 0",
                        shown.escape_debug()
                    )
                })
            })
            .collect::<Result<_, _>>()?;
        match vertices.len() {
            0 => Err("found no vertex on one side, but a curve has at least two".to_string()),
            1 => Err("found 1 vertex on one side, but a curve has at least two".to_string()),
            _ => Ok(vertices),
        }
    };
    match line.split('>').collect::<Vec<_>>()[..] {
        [domain, target] => Ok(LandmarkCurve {
            domain: vertices(domain)?,
            target: vertices(target)?,
        }),
        _ => Err("found no single `>` between the vertices of the domain and those of the target".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &[u8]) -> Result<Vec<LandmarkCurve>, IoError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curves.txt");
        std::fs::write(&path, content).unwrap();
        read_landmark_curves(&path)
    }

    #[test]
    fn a_line_holds_the_vertices_of_both_sides() {
        let curves = read(b"# back\n0 5, 7 > 3;4\r\n\n1 2>2 1 0 # tail\n").unwrap();
        let expected = [(vec![0, 5, 7], vec![3, 4]), (vec![1, 2], vec![2, 1, 0])];
        assert_eq!(
            curves,
            expected.map(|(domain, target)| LandmarkCurve { domain, target })
        );
    }

    #[test]
    fn errors_name_the_line_and_what_is_wrong_with_it() {
        for (content, expected) in [
            (&b"0 1 > 2 3\n4 5\n"[..], "line 2: found no single `>`"),
            (b"0 1 > 2 > 3", "line 1: found no single `>`"),
            (b"0 > 1 2", "line 1: found 1 vertex on"),
            (b"0 1 >", "line 1: found no vertex on"),
            (b"0 x > 1 2", "line 1: found `x`"),
            (b"0 -1 > 1 2", "line 1: found `-1`"),
            (b"# nothing\n", "found no curve"),
        ] {
            let found = read(content).unwrap_err().to_string();
            assert!(found.contains(expected) && found.contains("curves.txt"), "{found}");
        }
    }
}
