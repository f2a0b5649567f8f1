//! The map file: a safetensors container, readable from Python in two lines.
//!
//! | tensor | type, shape | meaning |
//! |---|---|---|
//! | `sources` | f64, N_s × 3 | positions of the sources, model units |
//! | `coefficients` | f64, N_s × 3 | their coefficients `w` |
//! | `affine` | f64, 4 × 3 | rows for the functions 1, x, y, z |
//! | `domain_vertices`, `image_vertices` | f64, n × 3 | the boundary map that was fitted (optional) |
//! | `domain_triangles` | u32, m × 3 | its triangles (optional) |
//!
//! `f(x) = affine[0] + x · affine[1:4] + Σ_s coefficients[s] / (4π |x − sources[s]|)`. The metadata entry `solidmap` is a
//! JSON object: see [`MapMetadata`].

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::{IoError, atomic_write};
use crate::boundary_map::BoundaryMap;
use crate::fit::FitReport;
use crate::map::HarmonicMap;
use crate::mesh::SurfaceMesh;
use crate::solver::Coefficients;

/// Version of the format. A reader refuses a newer major version; a newer minor one only adds.
const FORMAT_VERSION: (u32, u32) = (1, 0);
const METADATA_KEY: &str = "solidmap";

/// A map as stored: the map, the boundary map it was fitted to, and its history.
#[derive(Debug, Clone)]
pub struct MapFile {
    /// The map.
    pub map: HarmonicMap,
    /// The boundary map; `None` in a file written by other means.
    pub boundary: Option<BoundaryMap>,
    /// What else the file says.
    pub metadata: MapMetadata,
}

/// What a map file says about its map.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct MapMetadata {
    /// `major.minor` of the format.
    pub format_version: String,
    /// Program and version that wrote the file.
    pub generator: String,
    /// Report of the fit, with the boundary error.
    #[serde(default)]
    pub fit: Option<FitReport>,
    /// The files the map was made from.
    #[serde(default)]
    pub inputs: Vec<Provenance>,
}

/// An input file by name and content.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Provenance {
    /// `"domain"` or `"image"`.
    pub role: String,
    /// File name without its folder.
    pub file: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

/// Why a file is no map.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapFileError {
    /// Reading or writing failed.
    #[error(transparent)]
    Io(#[from] IoError),
    /// Not a safetensors container.
    #[error("`{}` is not a map file: {cause}", path.display())]
    NotAMap {
        /// The file.
        path: PathBuf,
        /// What the container's reader found.
        cause: String,
    },
    /// A tensor is missing or has another type or shape.
    #[error("`{}` is not a whole map file: tensor `{tensor}` {problem}", path.display())]
    Tensor {
        /// The file.
        path: PathBuf,
        /// Which tensor.
        tensor: &'static str,
        /// What is wrong with it.
        problem: String,
    },
    /// Written by a later version of the program.
    #[error(
        "`{}` has map format {found}, and this program reads up to {}.x; install a newer solidmap",
        path.display(), FORMAT_VERSION.0
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: String,
    },
}

impl MapMetadata {
    /// Metadata of a map that this program has just fitted, without the times it took.
    pub fn new(fit: FitReport, inputs: Vec<Provenance>) -> Self {
        let fit = FitReport { seconds: None, ..fit };
        Self {
            format_version: format!("{}.{}", FORMAT_VERSION.0, FORMAT_VERSION.1),
            generator: concat!("solidmap ", env!("CARGO_PKG_VERSION")).into(),
            fit: Some(fit),
            inputs,
        }
    }
}

impl Provenance {
    /// Name and hash of a file.
    ///
    /// # Errors
    ///
    /// When the file cannot be read.
    pub fn of(role: &str, path: &Path) -> std::io::Result<Self> {
        use sha2::Digest;
        let digest = sha2::Sha256::digest(std::fs::read(path)?);
        let sha256 = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self {
            role: role.into(),
            file,
            sha256,
        })
    }
}

/// Writes a map file. The same map gives the same bytes.
///
/// # Errors
///
/// When the file cannot be written.
pub fn write_map(path: &Path, file: &MapFile) -> Result<(), MapFileError> {
    let metadata = serde_json::to_string(&file.metadata).map_err(|e| not_a_map(path, &e))?;
    let rows = |points: &[crate::Point]| bytes(points.iter().flat_map(|p| p.iter().copied()));
    let coefficients = file.map.coefficients();
    let mut tensors = vec![
        (
            "sources",
            Dtype::F64,
            file.map.sources().len(),
            rows(file.map.sources()),
        ),
        (
            "coefficients",
            Dtype::F64,
            coefficients.sources.len(),
            bytes(coefficients.sources.iter().flatten().copied()),
        ),
        (
            "affine",
            Dtype::F64,
            4,
            bytes(coefficients.affine.iter().flatten().copied()),
        ),
    ];
    if let Some(boundary) = &file.boundary {
        let domain = boundary.domain();
        let triangles = domain
            .triangles()
            .iter()
            .flatten()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        tensors.push((
            "domain_vertices",
            Dtype::F64,
            domain.vertices().len(),
            rows(domain.vertices()),
        ));
        tensors.push(("domain_triangles", Dtype::U32, domain.triangles().len(), triangles));
        tensors.push((
            "image_vertices",
            Dtype::F64,
            boundary.image().len(),
            rows(boundary.image()),
        ));
    }
    let views: Vec<_> = tensors
        .iter()
        .map(|(name, dtype, rows, data)| Ok((*name, TensorView::new(*dtype, vec![*rows, 3], data)?)))
        .collect::<Result<_, safetensors::SafeTensorError>>()
        .map_err(|e| not_a_map(path, &e))?;
    let entries = HashMap::from([(METADATA_KEY.to_owned(), metadata)]);
    let bytes = safetensors::serialize(views, Some(entries)).map_err(|e| not_a_map(path, &e))?;
    Ok(atomic_write(path, |writer| writer.write_all(&bytes))?)
}

/// Reads a map file.
///
/// # Errors
///
/// When it cannot be read, is not a map or not whole, or is of a newer major version.
pub fn read_map(path: &Path) -> Result<MapFile, MapFileError> {
    let content = std::fs::read(path).map_err(|source| IoError::Read {
        path: path.to_owned(),
        source,
    })?;
    let tensors = SafeTensors::deserialize(&content).map_err(|e| not_a_map(path, &e))?;
    let (_, header) = SafeTensors::read_metadata(&content).map_err(|e| not_a_map(path, &e))?;
    let metadata = read_metadata(path, header.metadata().as_ref())?;

    let reader = Reader { path, tensors };
    let sources = reader.points("sources")?;
    let rows = reader.rows("coefficients")?;
    let affine = reader.rows("affine")?;
    let affine = <[[f64; 3]; 4]>::try_from(affine)
        .map_err(|rows| reader.problem("affine", format!("has {} rows instead of 4", rows.len())))?;
    let count = rows.len();
    let coefficients = Coefficients { sources: rows, affine };
    let mut map = HarmonicMap::new(sources, coefficients)
        .ok_or_else(|| reader.problem("coefficients", format!("has {count} rows, which is not one per source")))?;
    if let Some(fit) = &metadata.fit {
        map = map.with_error(fit.residual_rms);
    }
    let boundary = if reader.has("domain_vertices") {
        Some(reader.boundary()?)
    } else {
        None
    };
    Ok(MapFile {
        map,
        boundary,
        metadata,
    })
}

struct Reader<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
}

impl Reader<'_> {
    fn has(&self, tensor: &str) -> bool {
        self.tensors.tensor(tensor).is_ok()
    }

    fn boundary(&self) -> Result<BoundaryMap, MapFileError> {
        let triangles = self.data("domain_triangles", Dtype::U32)?;
        let (words, _) = triangles.as_chunks::<4>();
        let (triangles, _) = words.as_chunks::<3>();
        let triangles = triangles.iter().map(|t| t.map(u32::from_le_bytes)).collect();
        let domain = SurfaceMesh::new(self.points("domain_vertices")?, triangles)
            .map_err(|e| self.problem("domain_triangles", format!("is unusable: {e}")))?;
        BoundaryMap::new(domain, self.points("image_vertices")?)
            .map_err(|e| self.problem("image_vertices", format!("is unusable: {e}")))
    }

    fn points(&self, tensor: &'static str) -> Result<Vec<crate::Point>, MapFileError> {
        Ok(self.rows(tensor)?.into_iter().map(crate::Point::from).collect())
    }

    fn rows(&self, tensor: &'static str) -> Result<Vec<[f64; 3]>, MapFileError> {
        let data = self.data(tensor, Dtype::F64)?;
        let (numbers, _) = data.as_chunks::<8>();
        let (rows, _) = numbers.as_chunks::<3>();
        Ok(rows.iter().map(|row| row.map(f64::from_le_bytes)).collect())
    }

    fn data(&self, tensor: &'static str, dtype: Dtype) -> Result<&[u8], MapFileError> {
        let view = self
            .tensors
            .tensor(tensor)
            .map_err(|_| self.problem(tensor, "is missing".into()))?;
        match view.shape() {
            [_, 3] if view.dtype() == dtype => Ok(view.data()),
            shape => {
                let found = format!(
                    "is {:?} of shape {shape:?} instead of {dtype:?} of shape [n, 3]",
                    view.dtype()
                );
                Err(self.problem(tensor, found))
            }
        }
    }

    fn problem(&self, tensor: &'static str, problem: String) -> MapFileError {
        MapFileError::Tensor {
            path: self.path.to_owned(),
            tensor,
            problem,
        }
    }
}

fn read_metadata(path: &Path, entries: Option<&HashMap<String, String>>) -> Result<MapMetadata, MapFileError> {
    let Some(text) = entries.and_then(|entries| entries.get(METADATA_KEY)) else {
        return Err(not_a_map(path, &"it has no metadata of solidmap"));
    };
    // The version is looked at first: what else a newer file holds need not parse.
    let value: serde_json::Value = serde_json::from_str(text).map_err(|e| not_a_map(path, &e))?;
    let found = value["format_version"].as_str().unwrap_or_default();
    match found.split('.').next().and_then(|major| major.parse::<u32>().ok()) {
        Some(major) if major > FORMAT_VERSION.0 => Err(MapFileError::Newer {
            path: path.into(),
            found: found.into(),
        }),
        Some(_) => serde_json::from_value(value).map_err(|e| not_a_map(path, &e)),
        None => Err(not_a_map(path, &"its metadata has no format version")),
    }
}

fn not_a_map(path: &Path, cause: &dyn std::fmt::Display) -> MapFileError {
    MapFileError::NotAMap {
        path: path.to_owned(),
        cause: cause.to_string(),
    }
}

fn bytes(numbers: impl Iterator<Item = f64>) -> Vec<u8> {
    numbers.flat_map(f64::to_le_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;
    use crate::mesh::shapes;

    fn example() -> MapFile {
        let domain = shapes::sphere(1.0, 1);
        let image = shapes::deformed(&domain, |p| Point::new(2.0 * p.x, p.y, p.z + 0.1 * p.x))
            .vertices()
            .to_vec();
        let sources: Vec<Point> = shapes::sphere(1.5, 0).vertices().to_vec();
        let coefficients = Coefficients {
            sources: (0..sources.len())
                .map(|k| [k as f64, 0.1 + k as f64, -1.0 / (1.0 + k as f64)])
                .collect(),
            affine: [[0.5, 0.0, 0.1], [2.0, 0.0, 0.1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let inputs = vec![Provenance {
            role: "domain".into(),
            file: "ball.obj".into(),
            sha256: "ab".into(),
        }];
        MapFile {
            map: HarmonicMap::new(sources, coefficients).unwrap(),
            boundary: Some(BoundaryMap::new(domain, image).unwrap()),
            metadata: MapMetadata {
                inputs,
                format_version: "1.0".into(),
                ..MapMetadata::default()
            },
        }
    }

    fn folder() -> tempfile::TempDir {
        tempfile::tempdir().unwrap()
    }

    #[test]
    fn what_is_written_is_read_again_bit_for_bit() {
        let (folder, file) = (folder(), example());
        let path = folder.path().join("ball.map");
        write_map(&path, &file).unwrap();
        let read = read_map(&path).unwrap();
        assert_eq!(read.map.sources(), file.map.sources());
        assert_eq!(read.map.coefficients(), file.map.coefficients());
        assert_eq!(read.boundary, file.boundary);
        assert_eq!(read.metadata, file.metadata);
        let again = folder.path().join("again.map");
        write_map(&again, &read).unwrap();
        assert_eq!(std::fs::read(path).unwrap(), std::fs::read(again).unwrap());
    }

    #[test]
    fn a_newer_major_version_is_refused_by_name() {
        let (folder, mut file) = (folder(), example());
        let path = folder.path().join("new.map");
        file.metadata.format_version = "2.0".into();
        write_map(&path, &file).unwrap();
        assert!(matches!(read_map(&path), Err(MapFileError::Newer { found, .. }) if found == "2.0"));
        file.metadata.format_version = "1.7".into();
        write_map(&path, &file).unwrap();
        assert!(read_map(&path).is_ok());
    }

    #[test]
    fn truncated_and_foreign_files_are_errors() {
        let folder = folder();
        let path = folder.path().join("cut.map");
        write_map(&path, &example()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(97) {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(
                matches!(read_map(&path), Err(MapFileError::NotAMap { .. })),
                "{length} bytes"
            );
        }
        std::fs::write(&path, b"v 0 0 0\nv 1 0 0\n").unwrap();
        assert!(matches!(read_map(&path), Err(MapFileError::NotAMap { .. })));
        assert!(matches!(
            read_map(&folder.path().join("none.map")),
            Err(MapFileError::Io(_))
        ));
    }

    #[test]
    fn a_tensor_of_another_shape_is_named() {
        let folder = folder();
        let path = folder.path().join("odd.map");
        let data = vec![0u8; 64];
        let entries = HashMap::from([(
            METADATA_KEY.to_owned(),
            r#"{"format_version":"1.0","generator":"x"}"#.into(),
        )]);
        let view = TensorView::new(Dtype::F64, vec![4, 2], &data).unwrap();
        std::fs::write(
            &path,
            safetensors::serialize([("sources", view)], Some(entries)).unwrap(),
        )
        .unwrap();
        assert!(matches!(
            read_map(&path),
            Err(MapFileError::Tensor { tensor: "sources", .. })
        ));
    }
}
