//! Named tensors with metadata in a safetensors container: what map, boundary and texture files have in common.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::io::{IoError, atomic_write, printable};

/// Why a map, boundary or texture file cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TensorFileError {
    /// Reading or writing failed.
    #[error(transparent)]
    Io(#[from] IoError),
    /// Not a safetensors container, or one of something else.
    #[error("`{}` is not a {kind}: {cause}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// `"map file"`, `"boundary file"` or `"texture file"`.
        kind: &'static str,
        /// What was found.
        cause: String,
    },
    /// A tensor is missing, has another type or shape, or has unusable entries.
    #[error("`{}` is not a valid {kind}: tensor `{tensor}` {problem}", path.display())]
    Tensor {
        /// The file.
        path: PathBuf,
        /// `"map file"`, `"boundary file"` or `"texture file"`.
        kind: &'static str,
        /// Which tensor.
        tensor: String,
        /// What is wrong with it.
        problem: String,
    },
    /// Written by a later version of the program.
    #[error(
        "`{}` is a {kind} of format {found}, and this program reads up to {supported}.x; install a newer solidmap",
        path.display()
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// `"map file"`, `"boundary file"` or `"texture file"`.
        kind: &'static str,
        /// Its version.
        found: String,
        /// The newest major version that is read.
        supported: u32,
    },
}

/// This program and its version, for the entry `generator` of the metadata.
pub(super) const GENERATOR: &str = concat!("solidmap ", env!("CARGO_PKG_VERSION"));

/// A kind of file. A reader refuses a newer major version; a newer minor one only adds.
#[derive(Debug, PartialEq)]
pub(super) struct FileKind {
    pub name: &'static str,
    /// The entry of the container's metadata that holds ours, a JSON object.
    pub key: &'static str,
    pub version: (u32, u32),
    /// The versions of files that hold a boundary map through a flat torus, through a hyperbolic surface, or of several shells, which
    /// earlier programs do not know.
    pub later_versions: [(u32, u32); 3],
    /// What the file is for, said where another kind is wanted.
    pub purpose: &'static str,
}

pub(super) static MAP: FileKind = FileKind {
    name: "map file",
    key: "solidmap",
    version: (1, 2),
    later_versions: [(1, 3), (1, 4), (1, 5)],
    purpose: "it holds a fitted map, for `solidmap eval` and `energy`",
};

pub(super) static BOUNDARY: FileKind = FileKind {
    name: "boundary file",
    key: "solidmap_boundary",
    version: (1, 0),
    later_versions: [(1, 1), (1, 2), (1, 3)],
    purpose: "it holds a boundary map, for `solidmap fit --boundary`",
};

pub(super) static TEXTURE: FileKind = FileKind {
    name: "texture file",
    key: "solidmap_texture",
    version: (1, 0),
    later_versions: [(1, 1), (1, 2), (1, 3)],
    purpose: "it holds a solid texture, for `solidmap texture`",
};

/// A table.
pub(super) struct Tensor {
    name: String,
    dtype: Dtype,
    rows: usize,
    columns: usize,
    data: Vec<u8>,
}

impl Tensor {
    /// A table with three columns.
    fn new(name: &str, dtype: Dtype, rows: usize, data: Vec<u8>) -> Self {
        Self {
            name: name.to_owned(),
            dtype,
            rows,
            columns: 3,
            data,
        }
    }

    pub fn rows<'a, const N: usize>(name: &str, rows: impl ExactSizeIterator<Item = &'a [f64; N]>) -> Self {
        let count = rows.len();
        let data = rows.flatten().flat_map(|x| x.to_le_bytes()).collect();
        Self {
            columns: N,
            ..Self::new(name, Dtype::F64, count, data)
        }
    }

    pub fn integers<const N: usize>(name: &str, rows: impl ExactSizeIterator<Item = [i32; N]>) -> Self {
        let count = rows.len();
        let data = rows.flatten().flat_map(|x| x.to_le_bytes()).collect();
        Self {
            columns: N,
            ..Self::new(name, Dtype::I32, count, data)
        }
    }

    pub fn points(name: &str, points: &[Point]) -> Self {
        Self::rows(name, points.iter().map(|p| p.coords.as_ref()))
    }

    pub fn triangles(name: &str, triangles: &[[u32; 3]]) -> Self {
        let data = triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        Self::new(name, Dtype::U32, triangles.len(), data)
    }

    pub fn tets(name: &str, tets: &[[u32; 4]]) -> Self {
        let data = tets.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        Self {
            columns: 4,
            ..Self::new(name, Dtype::U32, tets.len(), data)
        }
    }

    pub fn bytes(name: &str, rows: &[[u8; 3]]) -> Self {
        Self::new(name, Dtype::U8, rows.len(), rows.as_flattened().to_vec())
    }
}

impl FileKind {
    pub fn format_version(&self) -> String {
        format!("{}.{}", self.version.0, self.version.1)
    }

    /// The version of a file with this boundary map: the given one, unless that is too low for it.
    pub fn version_for(&self, given: &str, boundary: Option<&BoundaryMap>) -> String {
        let [with_torus, with_hyperbolic_surface, with_shells] = self.later_versions;
        let (major, minor) = match boundary {
            Some(map) if map.torus_embeddings().is_some() => with_torus,
            Some(map) if map.hyperbolic_embeddings().is_some() => with_hyperbolic_surface,
            Some(map) if map.shells().is_some() => with_shells,
            _ => return given.to_owned(),
        };
        match given == self.format_version() {
            true => format!("{major}.{minor}"),
            false => given.to_owned(),
        }
    }

    /// The same tensors and metadata give the same bytes.
    pub fn write(&self, path: &Path, metadata: &impl Serialize, tensors: &[Tensor]) -> Result<(), TensorFileError> {
        let metadata = serde_json::to_string(metadata).map_err(|e| self.foreign(path, &e))?;
        let views: Vec<_> = tensors
            .iter()
            .map(|t| {
                Ok((
                    t.name.as_str(),
                    TensorView::new(t.dtype, vec![t.rows, t.columns], &t.data)?,
                ))
            })
            .collect::<Result<_, safetensors::SafeTensorError>>()
            .map_err(|e| self.foreign(path, &e))?;
        let entries = HashMap::from([(self.key.to_owned(), metadata)]);
        let bytes = safetensors::serialize(views, Some(entries)).map_err(|e| self.foreign(path, &e))?;
        Ok(atomic_write(path, |writer| writer.write_all(&bytes))?)
    }

    fn foreign(&self, path: &Path, cause: &dyn std::fmt::Display) -> TensorFileError {
        TensorFileError::Foreign {
            path: path.to_owned(),
            kind: self.name,
            cause: printable(cause.to_string()),
        }
    }
}

pub(super) struct Reader<'a> {
    kind: &'static FileKind,
    path: &'a Path,
    tensors: SafeTensors<'a>,
    metadata: serde_json::Value,
}

impl<'a> Reader<'a> {
    pub fn new(kind: &'static FileKind, path: &'a Path, content: &'a [u8]) -> Result<Self, TensorFileError> {
        let no_container = |e| kind.foreign(path, &format_args!("it is no safetensors file, or a damaged one ({e})"));
        let tensors = SafeTensors::deserialize(content).map_err(no_container)?;
        let (_, header) = SafeTensors::read_metadata(content).map_err(no_container)?;
        let empty = HashMap::new();
        let entries = header.metadata().as_ref().unwrap_or(&empty);
        let Some(text) = entries.get(kind.key) else {
            let mut others = [&MAP, &BOUNDARY, &TEXTURE].into_iter();
            let other = others.find(|other| entries.contains_key(other.key));
            let cause = other.map_or("it has no solidmap metadata", |other| other.purpose);
            return Err(kind.foreign(path, &cause));
        };
        let metadata: serde_json::Value = serde_json::from_str(text).map_err(|e| kind.foreign(path, &e))?;
        // The version comes first: the rest of a newer file's metadata need not parse.
        let found = metadata["format_version"].as_str().unwrap_or_default();
        match found.split('.').next().and_then(|major| major.parse::<u32>().ok()) {
            Some(major) if major > kind.version.0 => Err(TensorFileError::Newer {
                path: path.into(),
                kind: kind.name,
                found: printable(found),
                supported: kind.version.0,
            }),
            Some(_) => Ok(Self {
                kind,
                path,
                tensors,
                metadata,
            }),
            None => Err(kind.foreign(path, &"its metadata has no format version")),
        }
    }

    /// The metadata, or as much of them as the type asks for.
    pub fn metadata<T: DeserializeOwned>(&self) -> Result<T, TensorFileError> {
        T::deserialize(&self.metadata).map_err(|e| self.kind.foreign(self.path, &e))
    }

    /// The names of all tensors.
    pub fn names(&self) -> Vec<String> {
        self.tensors.names().into_iter().map(|name| name.to_string()).collect()
    }

    pub fn has(&self, tensor: &str) -> bool {
        self.tensors.tensor(tensor).is_ok()
    }

    pub fn points(&self, tensor: &str) -> Result<Vec<Point>, TensorFileError> {
        Ok(self.rows::<3>(tensor)?.into_iter().map(Point::from).collect())
    }

    pub fn rows<const N: usize>(&self, tensor: &str) -> Result<Vec<[f64; N]>, TensorFileError> {
        let data = self.data(tensor, Dtype::F64, N)?;
        let (numbers, _) = data.as_chunks::<8>();
        let (rows, _) = numbers.as_chunks::<N>();
        Ok(rows.iter().map(|row| row.map(f64::from_le_bytes)).collect())
    }

    pub fn integers<const N: usize>(&self, tensor: &str) -> Result<Vec<[i32; N]>, TensorFileError> {
        let data = self.data(tensor, Dtype::I32, N)?;
        let (words, _) = data.as_chunks::<4>();
        let (rows, _) = words.as_chunks::<N>();
        Ok(rows.iter().map(|row| row.map(i32::from_le_bytes)).collect())
    }

    pub fn triangles(&self, tensor: &str) -> Result<Vec<[u32; 3]>, TensorFileError> {
        let data = self.data(tensor, Dtype::U32, 3)?;
        let (words, _) = data.as_chunks::<4>();
        let (triangles, _) = words.as_chunks::<3>();
        Ok(triangles.iter().map(|t| t.map(u32::from_le_bytes)).collect())
    }

    pub fn tets(&self, tensor: &str) -> Result<Vec<[u32; 4]>, TensorFileError> {
        let data = self.data(tensor, Dtype::U32, 4)?;
        let (words, _) = data.as_chunks::<4>();
        let (tets, _) = words.as_chunks::<4>();
        Ok(tets.iter().map(|t| t.map(u32::from_le_bytes)).collect())
    }

    pub fn bytes(&self, tensor: &str) -> Result<Vec<[u8; 3]>, TensorFileError> {
        let (rows, _) = self.data(tensor, Dtype::U8, 3)?.as_chunks::<3>();
        Ok(rows.to_vec())
    }

    fn data(&self, tensor: &str, dtype: Dtype, columns: usize) -> Result<&[u8], TensorFileError> {
        let view = self
            .tensors
            .tensor(tensor)
            .map_err(|_| self.problem(tensor, "is missing".into()))?;
        match view.shape() {
            [_, found] if *found == columns && view.dtype() == dtype => Ok(view.data()),
            shape => {
                let found = view.dtype();
                let problem = format!("is {found:?} of shape {shape:?} instead of {dtype:?} of shape [n, {columns}]");
                Err(self.problem(tensor, problem))
            }
        }
    }

    pub fn problem(&self, tensor: &str, problem: String) -> TensorFileError {
        TensorFileError::Tensor {
            path: self.path.to_owned(),
            kind: self.kind.name,
            tensor: tensor.to_owned(),
            problem,
        }
    }
}
