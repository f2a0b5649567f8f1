use std::{
    fmt, io,
    path::{Path, PathBuf},
};

/// Why a file could not be read or written. Counts and positions of elements are 0-based, lines count from 1.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IoError {
    /// The extension is not one of the usable formats.
    #[error("`{path}` has none of the extensions known for {purpose}: {known}; give the file one of them")]
    UnknownExtension {
        /// The file.
        path: PathBuf,
        /// The purpose, as in `"a surface"`.
        purpose: &'static str,
        /// The usable extensions.
        known: String,
    },
    /// The file cannot be opened or read.
    #[error("cannot read `{path}`: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file cannot be written; a previous file is unchanged.
    #[error("cannot write `{path}`: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The content violates the format.
    #[error("`{path}` is not a valid {format} file: {place}: {found}")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The format it was read as.
        format: &'static str,
        /// Where.
        place: Place,
        /// What was found and what was expected.
        found: String,
    },
    /// The file ends before its content does.
    #[error("`{path}` ends early ({format}), within {within}: the file is cut off; copy or export it again")]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The format it was read as.
        format: &'static str,
        /// What was being read.
        within: String,
    },
    /// A count in the file is larger than the rest of the file could hold.
    #[error(
        "`{path}` ({format}) promises {count} {element}, which the {available} bytes that follow cannot hold: the \
         count is wrong or the file is cut off; copy or export it again"
    )]
    CountExceedsFile {
        /// The file.
        path: PathBuf,
        /// The format it was read as.
        format: &'static str,
        /// What is counted, in the plural.
        element: String,
        /// How many the file says there are.
        count: u64,
        /// Bytes after the count.
        available: usize,
    },
    /// Compressed or shared data expand to far more than the size of the file.
    #[error(
        "`{path}` ({format}) unpacks to more than {limit} bytes, which no valid file of {size} bytes does; if it is \
         valid, save it without compression"
    )]
    Expands {
        /// The file.
        path: PathBuf,
        /// The format it was read as.
        format: &'static str,
        /// Bytes of the file.
        size: usize,
        /// The limit in bytes.
        limit: usize,
    },
    /// A face has fewer than three corners.
    #[error("face {face} (0-based) of `{path}` has {corners} corners, and a face needs at least 3; remove it")]
    FewCorners {
        /// The file.
        path: PathBuf,
        /// Which face, 0-based.
        face: usize,
        /// How many corners it has.
        corners: usize,
    },
    /// A face or cell refers to a missing vertex.
    #[error(
        "{element} {index} (0-based) of `{path}` refers to vertex {vertex}, but there are {vertices} vertices, counted \
         from {base}"
    )]
    IndexOutOfRange {
        /// The file.
        path: PathBuf,
        /// `"face"`, `"tetrahedron"` and so on.
        element: &'static str,
        /// Which one, 0-based.
        index: usize,
        /// The index as written in the file.
        vertex: i64,
        /// How many vertices there are.
        vertices: usize,
        /// The index of the first vertex in this format: 0 or 1.
        base: i64,
    },
    /// The file is valid but has neither faces nor cells.
    #[error(
        "`{path}` holds {vertices} vertices but no faces or cells, so it is not a solid; export the mesh with its faces \
         or cells"
    )]
    NoGeometry {
        /// The file.
        path: PathBuf,
        /// How many vertices it holds.
        vertices: usize,
    },
    /// The file is valid but uses an unsupported part of its format.
    #[error("`{path}` holds {found}, which is not supported: {remedy}")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// A surface where tetrahedra are needed, or vice versa.
    #[error("`{path}` holds {found}, but {wanted}")]
    WrongKind {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What is needed and how to get it.
        wanted: &'static str,
    },
    /// More elements than 31-bit indices can name.
    #[error(
        "`{path}` holds {count} {element}, more than the {} that 31-bit indices can name",
        i32::MAX
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What is counted, in the plural.
        element: &'static str,
        /// How many there are.
        count: usize,
    },
    /// The number of values does not match the mesh or the columns.
    #[error("`{path}`: `{name}` has {found} values, but {expected} are needed")]
    ValueCount {
        /// The file.
        path: PathBuf,
        /// The field or table.
        name: String,
        /// How many values there should be.
        expected: usize,
        /// How many there are.
        found: usize,
    },
}

impl IoError {
    pub(super) fn unsupported(path: &Path, found: impl Into<String>, remedy: &'static str) -> Self {
        Self::Unsupported {
            path: path.to_owned(),
            found: found.into(),
            remedy,
        }
    }

    pub(super) fn value_count(path: &Path, name: impl Into<String>, expected: usize, found: usize) -> Self {
        Self::ValueCount {
            path: path.to_owned(),
            name: name.into(),
            expected,
            found,
        }
    }
}

/// A place in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A line of text, counted from 1.
    Line(usize),
    /// An offset in bytes from the beginning.
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}
