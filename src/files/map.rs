//! The map file: a safetensors container, readable from Python in two lines.
//!
//! | tensor | type, shape | meaning |
//! |---|---|---|
//! | `sources` | f64, N_s × 3 | positions of the sources, model units |
//! | `coefficients` | f64, N_s × 3 | their coefficients `w` |
//! | `affine` | f64, 4 × 3 | rows for the functions 1, x, y, z |
//!
//! | `bijective_nodes`, `bijective_images` | f64, n × 3 | nodes of a tet mesh of the domain, and their images (optional) |
//! | `bijective_tets` | u32, m × 4 | its tetrahedra; the map that is linear over them is one to one |
//!
//! The tensors of [`boundary_tensors`](super::boundary_tensors) hold the boundary map that was fitted (optional).
//! Readers of format 1.1 and later read a composition of spherical embeddings exactly; older ones interpolate linearly
//! between its vertices.
//!
//! `f(x) = affine[0] + x · affine[1:4] + Σ_s coefficients[s] / (4π |x − sources[s]|)`. The metadata entry `solidmap` is
//! a JSON object: see [`MapMetadata`].

use std::path::Path;

use super::Provenance;
use super::boundary_tensors::{self, BoundaryHeader, Way};
use super::tensor_file::{GENERATOR, MAP, Reader, Tensor, TensorFileError};
use crate::bijective::{Bijective, BijectiveMap, BijectiveReport};
use crate::boundary_map::BoundaryMap;
use crate::fit::FitReport;
use crate::io::read_bytes;
use crate::map::HarmonicMap;
use crate::mesh::TetMesh;
use crate::solver::Coefficients;

/// A map as stored: the map, the boundary map it was fitted to, the bijective map that was made from it, and its history.
#[derive(Debug, Clone)]
pub struct MapFile {
    /// The map.
    pub map: HarmonicMap,
    /// The boundary map; `None` in a file written by other means.
    pub boundary: Option<BoundaryMap>,
    /// The one-to-one map that was made from it (format 1.2).
    pub bijective: Option<Bijective>,
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

impl MapFile {
    /// The same file with a bijective map, in the format that has it.
    pub fn with_bijective(self, bijective: Bijective) -> Self {
        Self {
            bijective: Some(bijective),
            metadata: MapMetadata {
                format_version: MAP.format_version(),
                ..self.metadata
            },
            ..self
        }
    }
}

impl MapMetadata {
    /// Metadata of a map that this program has just fitted, without the times it took.
    pub fn new(fit: FitReport, inputs: Vec<Provenance>) -> Self {
        let fit = FitReport { seconds: None, ..fit };
        Self {
            format_version: MAP.format_version(),
            generator: GENERATOR.into(),
            fit: Some(fit),
            inputs,
        }
    }
}

#[derive(serde::Serialize)]
struct MapHeader<'a> {
    #[serde(flatten)]
    metadata: &'a MapMetadata,
    #[serde(skip_serializing_if = "Option::is_none")]
    boundary: Option<BoundaryHeader>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bijective: Option<&'a BijectiveReport>,
}

/// The part of the metadata about the bijective map.
#[derive(serde::Deserialize)]
struct BijectiveHeader {
    bijective: BijectiveReport,
}

const NODES: &str = "bijective_nodes";
const IMAGES: &str = "bijective_images";
const TETS: &str = "bijective_tets";

/// Writes a map file. The same map gives the same bytes.
///
/// # Errors
///
/// When the file cannot be written.
pub fn write_map(path: &Path, file: &MapFile) -> Result<(), TensorFileError> {
    let mut tensors = Vec::from(tensors_of(&file.map));
    tensors.extend(file.boundary.iter().flat_map(boundary_tensors::tensors_of));
    if let Some(Bijective { map, .. }) = &file.bijective {
        tensors.push(Tensor::points(NODES, map.domain().vertices()));
        tensors.push(Tensor::points(IMAGES, map.target().vertices()));
        tensors.push(Tensor::tets(TETS, map.domain().tets()));
    }
    let boundary = file.boundary.as_ref().map(boundary_tensors::header_of);
    let header = MapHeader {
        metadata: &MapMetadata {
            format_version: MAP.version_for(&file.metadata.format_version, file.boundary.as_ref()),
            ..file.metadata.clone()
        },
        // Straight maps are written as they always were.
        boundary: boundary.filter(|header| header.way != Way::Straight),
        bijective: file.bijective.as_ref().map(|bijective| &bijective.report),
    };
    MAP.write(path, &header, &tensors)
}

/// Reads a map file.
///
/// # Errors
///
/// When it cannot be read, is not a complete map file, is of a newer major version, or holds a boundary map whose
/// spherical embeddings are not one to one, or a bijective map with inverted tetrahedra.
pub fn read_map(path: &Path) -> Result<MapFile, TensorFileError> {
    let content = read_bytes(path)?;
    let reader = Reader::new(&MAP, path, &content)?;
    let metadata: MapMetadata = reader.metadata()?;
    let mut map = read_tensors(&reader)?;
    if let Some(fit) = &metadata.fit {
        map = map.with_error(fit.residual_rms);
    }
    let boundary = reader
        .has("domain_vertices")
        .then(|| boundary_tensors::read(&reader))
        .transpose()?;
    let bijective = reader.has(TETS).then(|| read_bijective(&reader, boundary.as_ref()));
    Ok(MapFile {
        map,
        boundary,
        bijective: bijective.transpose()?,
        metadata,
    })
}

/// The bijective map, with its tetrahedra checked anew.
fn read_bijective(reader: &Reader, boundary: Option<&BoundaryMap>) -> Result<Bijective, TensorFileError> {
    let BijectiveHeader { bijective: report } = reader.metadata()?;
    let mesh = TetMesh::new(reader.points(NODES)?, reader.tets(TETS)?);
    let mesh = mesh.map_err(|error| reader.problem(TETS, error.to_string()))?;
    let map = BijectiveMap::new(mesh, reader.points(IMAGES)?);
    let map = map.map_err(|error| reader.problem(TETS, error.to_string()))?;
    let gap = boundary.map_or(0.0, |boundary| report.gap * boundary.target_diagonal());
    Ok(Bijective {
        map: map.with_gap(gap),
        report,
    })
}

/// The tensors of a harmonic map.
pub(super) fn tensors_of(map: &HarmonicMap) -> [Tensor; 3] {
    let coefficients = map.coefficients();
    [
        Tensor::points("sources", map.sources()),
        Tensor::rows("coefficients", coefficients.sources.iter()),
        Tensor::rows("affine", coefficients.affine.iter()),
    ]
}

/// The harmonic map whose [`tensors_of`] a file holds.
pub(super) fn read_tensors(reader: &Reader) -> Result<HarmonicMap, TensorFileError> {
    let positions = reader.points("sources")?;
    let sources = reader.rows("coefficients")?;
    let count = sources.len();
    let affine = <[[f64; 3]; 4]>::try_from(reader.rows("affine")?)
        .map_err(|rows| reader.problem("affine", format!("has {} rows instead of 4", rows.len())))?;
    HarmonicMap::new(positions, Coefficients { sources, affine })
        .ok_or_else(|| reader.problem("coefficients", format!("has {count} rows, which is not one per source")))
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use safetensors::tensor::{Dtype, TensorView};

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
            bijective: None,
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
    fn what_is_written_is_read_back_bit_for_bit() {
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

    /// A tetrahedron, and its image under `p ↦ (2 p.x, p.y + p.x, 3 p.z)`.
    fn bijective() -> Bijective {
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]
            .map(Point::from)
            .to_vec();
        let images = corners
            .iter()
            .map(|p| Point::new(2.0 * p.x, p.y + p.x, 3.0 * p.z))
            .collect();
        let mesh = TetMesh::new(corners, vec![[0, 1, 2, 3]]).unwrap();
        Bijective {
            map: BijectiveMap::new(mesh, images).unwrap(),
            report: BijectiveReport {
                tets: 1,
                // The first is a number that an inexact reader of decimals takes for its neighbour.
                difference_place: [0.0467972, 0.2, 0.3],
                ..BijectiveReport::default()
            },
        }
    }

    #[test]
    fn a_bijective_map_is_read_back_bit_for_bit_and_refused_with_inverted_tetrahedra() {
        let (folder, mut file) = (folder(), example());
        let path = folder.path().join("bijective.map");
        file.bijective = Some(bijective());
        write_map(&path, &file).unwrap();
        let read = read_map(&path).unwrap();
        assert_eq!(read.bijective, file.bijective);
        let again = folder.path().join("again.map");
        write_map(&again, &read).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes, std::fs::read(again).unwrap());
        // The first tensor in the file is the one whose name comes first: the images. A mirrored corner inverts the only
        // tetrahedron, which is a mirrored map; a flat one is none.
        let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let text = String::from_utf8_lossy(&bytes[8..8 + header]).into_owned();
        let described: serde_json::Value = serde_json::from_str(&text).unwrap();
        let begin = described[IMAGES]["data_offsets"][0].as_u64().unwrap() as usize;
        let last = 8 + header + begin + 8 * 11;
        let mut flat = bytes.clone();
        flat[last..last + 8].copy_from_slice(&0f64.to_le_bytes());
        std::fs::write(&path, flat).unwrap();
        let error = read_map(&path).unwrap_err().to_string();
        assert!(
            error.contains("bijective_tets") && error.contains("inverted or flat"),
            "{error}"
        );
    }

    #[test]
    fn a_newer_major_version_is_refused_by_name() {
        let (folder, mut file) = (folder(), example());
        let path = folder.path().join("new.map");
        file.metadata.format_version = "2.0".into();
        write_map(&path, &file).unwrap();
        assert!(matches!(read_map(&path), Err(TensorFileError::Newer { found, .. }) if found == "2.0"));
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
                matches!(read_map(&path), Err(TensorFileError::Foreign { .. })),
                "{length} bytes"
            );
        }
        std::fs::write(&path, b"v 0 0 0\nv 1 0 0\n").unwrap();
        assert!(matches!(read_map(&path), Err(TensorFileError::Foreign { .. })));
        assert!(matches!(
            read_map(&folder.path().join("none.map")),
            Err(TensorFileError::Io(_))
        ));
    }

    /// A file of format 1.0: sources at the corners of a triangle, which is its own image.
    #[test]
    fn files_of_the_first_format_are_read() {
        let folder = folder();
        let path = folder.path().join("old.map");
        let numbers: Vec<u8> = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0f64]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let affine = vec![0u8; 96];
        let triangle: Vec<u8> = [0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()).collect();
        let table = |rows: usize, data| TensorView::new(Dtype::F64, vec![rows, 3], data).unwrap();
        let mut views: Vec<_> = ["sources", "coefficients", "domain_vertices", "image_vertices"]
            .map(|name| (name, table(3, &numbers)))
            .into();
        views.push(("affine", table(4, &affine)));
        views.push((
            "domain_triangles",
            TensorView::new(Dtype::U32, vec![1, 3], &triangle).unwrap(),
        ));
        let metadata = r#"{"format_version":"1.0","generator":"solidmap 0.1.0","fit":null,"inputs":[]}"#;
        let entries = HashMap::from([("solidmap".to_owned(), metadata.to_owned())]);
        std::fs::write(&path, safetensors::serialize(views, Some(entries)).unwrap()).unwrap();
        let read = read_map(&path).unwrap();
        let boundary = read.boundary.unwrap();
        assert_eq!(boundary.image(), boundary.domain().vertices());
        assert!(boundary.domain_embedding().is_none());
        assert_eq!(read.map.sources()[1], Point::new(1.0, 0.0, 0.0));
    }

    #[test]
    fn a_tensor_of_another_shape_is_named() {
        let folder = folder();
        let path = folder.path().join("odd.map");
        let data = vec![0u8; 64];
        let entries = HashMap::from([(MAP.key.to_owned(), r#"{"format_version":"1.0","generator":"x"}"#.into())]);
        let view = TensorView::new(Dtype::F64, vec![4, 2], &data).unwrap();
        std::fs::write(
            &path,
            safetensors::serialize([("sources", view)], Some(entries)).unwrap(),
        )
        .unwrap();
        assert!(matches!(
            read_map(&path),
            Err(TensorFileError::Tensor { tensor, .. }) if tensor == "sources"
        ));
    }
}
