//! Landmarks: pairs of vertex indices as text, in one file or in two.
//!
//! One file has two indices per line, of the domain's vertex and of the target's. Two files, one for each surface, have
//! one index per line, and the n-th indices of both make a pair. Indices count from 0 and are separated by spaces,
//! tabs, commas or semicolons; `#` starts a comment, and lines without indices are skipped.

use std::path::{Path, PathBuf};

use super::number_rows::{NumberRow, read_number_rows};
use crate::boundary_map::pair::{LandmarkError, Landmarks};
use crate::io::IoError;

/// Why landmarks cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LandmarkFileError {
    /// The file cannot be read, or a line does not hold the right number of indices.
    #[error(transparent)]
    File(#[from] IoError),
    /// There is no pair in it.
    #[error("`{path}` holds no landmarks; write a line for each, or leave the file out")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Two files that do not go together.
    #[error(
        "`{domain}` names {domain_count} vertices and `{target}` {target_count}, but the n-th of both make a pair; \
         give both files the same number of vertices"
    )]
    Count {
        /// The file of the domain.
        domain: PathBuf,
        /// Vertices it names.
        domain_count: usize,
        /// The file of the target.
        target: PathBuf,
        /// Vertices it names.
        target_count: usize,
    },
    /// A vertex index that is out of range.
    #[error(
        "`{path}`: line {line} names vertex {vertex} of the {side}, which has {vertices} vertices, counted from 0; \
         correct the number, or swap the surfaces"
    )]
    OutOfRange {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// The vertex it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// One vertex in two pairs.
    #[error("`{path}`: lines {first} and {second} both name vertex {vertex} of the {side}; remove one of them")]
    Duplicate {
        /// The file.
        path: PathBuf,
        /// The earlier line, counted from 1.
        first: usize,
        /// The later one.
        second: usize,
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// The vertex.
        vertex: u32,
    },
}

/// Reads pairs from one file, for surfaces with `domain_vertices` and `target_vertices` vertices.
///
/// # Errors
///
/// When the file cannot be read, has no pairs, has a line that is not two vertex indices, or a vertex is out of range
/// or in two pairs.
pub fn read_landmarks(
    path: impl AsRef<Path>,
    domain_vertices: usize,
    target_vertices: usize,
) -> Result<Landmarks, LandmarkFileError> {
    let path = path.as_ref();
    let rows = read_rows::<2>(path)?;
    let pairs = rows.iter().map(|row| row.numbers).collect();
    let lines: Vec<usize> = rows.iter().map(|row| row.line).collect();
    Landmarks::new(pairs, domain_vertices, target_vertices).map_err(|error| in_file(error, |_| (path, &lines)))
}

/// Reads pairs from two files with one vertex index per line, for surfaces with `domain_vertices` and
/// `target_vertices` vertices.
///
/// # Errors
///
/// As [`read_landmarks`], and when the files name different numbers of vertices.
pub fn read_landmark_files(
    domain: impl AsRef<Path>,
    target: impl AsRef<Path>,
    domain_vertices: usize,
    target_vertices: usize,
) -> Result<Landmarks, LandmarkFileError> {
    let (domain, target) = (domain.as_ref(), target.as_ref());
    let (of_domain, of_target) = (read_rows::<1>(domain)?, read_rows::<1>(target)?);
    if of_domain.len() != of_target.len() {
        return Err(LandmarkFileError::Count {
            domain: domain.to_owned(),
            domain_count: of_domain.len(),
            target: target.to_owned(),
            target_count: of_target.len(),
        });
    }
    let pairs = of_domain
        .iter()
        .zip(&of_target)
        .map(|(a, b)| [a.numbers[0], b.numbers[0]])
        .collect();
    let [domain_lines, target_lines] =
        [&of_domain, &of_target].map(|rows| rows.iter().map(|row| row.line).collect::<Vec<_>>());
    Landmarks::new(pairs, domain_vertices, target_vertices).map_err(|error| {
        in_file(error, |side| match side {
            "domain" => (domain, &domain_lines),
            _ => (target, &target_lines),
        })
    })
}

fn read_rows<const N: usize>(path: &Path) -> Result<Vec<NumberRow<N>>, LandmarkFileError> {
    let expected = if N == 1 {
        "one vertex number"
    } else {
        "two vertex numbers (of the domain and of the target)"
    };
    let rows = read_number_rows::<N>(path, "landmark", expected)?;
    if rows.is_empty() {
        return Err(LandmarkFileError::Empty { path: path.to_owned() });
    }
    Ok(rows)
}

/// The error with the file and the lines that the pairs of a side come from.
fn in_file<'a>(error: LandmarkError, origin: impl Fn(&str) -> (&'a Path, &'a Vec<usize>)) -> LandmarkFileError {
    match error {
        LandmarkError::OutOfRange {
            pair,
            side,
            vertex,
            vertices,
        } => {
            let (path, lines) = origin(side);
            LandmarkFileError::OutOfRange {
                path: path.to_owned(),
                line: lines[pair],
                side,
                vertex,
                vertices,
            }
        }
        LandmarkError::Duplicate {
            first,
            second,
            side,
            vertex,
        } => {
            let (path, lines) = origin(side);
            LandmarkFileError::Duplicate {
                path: path.to_owned(),
                first: lines[first],
                second: lines[second],
                side,
                vertex,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(folder: &tempfile::TempDir, name: &str, content: &[u8]) -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    #[test]
    fn numbers_are_separated_by_spaces_tabs_commas_or_semicolons() {
        let folder = tempfile::tempdir().unwrap();
        let content = b"\xef\xbb\xbf# domain target\n0 5\r\n1,6\n\n 2 ;\t7 # nose\n3, 8";
        let path = file(&folder, "pairs.txt", content);
        let landmarks = read_landmarks(&path, 4, 9).unwrap();
        assert_eq!(landmarks.pairs(), [[0, 5], [1, 6], [2, 7], [3, 8]]);
    }

    #[test]
    fn lines_of_two_files_make_pairs() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (
            file(&folder, "a.pinned", b"3\n1\n"),
            file(&folder, "b.pinned", b"\n9\n# x\n2"),
        );
        assert_eq!(read_landmark_files(&a, &b, 4, 10).unwrap().pairs(), [[3, 9], [1, 2]]);
        let error = read_landmark_files(&a, &b, 4, 5).unwrap_err().to_string();
        assert!(
            error.contains("b.pinned`: line 2 names vertex 9 of the target, which has 5"),
            "{error}"
        );
        let longer = file(&folder, "c.pinned", b"1\n2\n3\n");
        assert!(matches!(
            read_landmark_files(&a, &longer, 9, 9),
            Err(LandmarkFileError::Count {
                domain_count: 2,
                target_count: 3,
                ..
            })
        ));
    }

    #[test]
    fn errors_name_the_line_and_what_is_wrong_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let error = |content: &[u8]| {
            let path = file(&folder, "bad.txt", content);
            read_landmarks(path, 10, 10).unwrap_err().to_string()
        };
        for (content, expected) in [
            (&b"1 2\n3\n"[..], "line 2: found 1 number,"),
            (b"1 2 3\n", "line 1: found 3 numbers"),
            (b"\n1 -2\n", "line 2: found `-2`"),
            (b"1.5 2\n", "line 1: found `1.5`"),
            (b"1 99999999999999\n", "line 1: found `99999999999999`"),
            (b"\xff\xfe1\0 2\0", "line 1: found `"),
            (
                b"1 2\n\n4 10\n",
                "line 3 names vertex 10 of the target, which has 10 vertices",
            ),
            (b"1 2\n3 4\n1 5\n", "lines 1 and 3 both name vertex 1 of the domain"),
            (b"# nothing\n", "holds no landmarks"),
        ] {
            let found = error(content);
            assert!(found.contains(expected) && found.contains("bad.txt"), "{found}");
        }
        let missing = read_landmarks(folder.path().join("none.txt"), 1, 1).unwrap_err();
        assert!(matches!(missing, LandmarkFileError::File(IoError::Read { .. })));
    }
}
