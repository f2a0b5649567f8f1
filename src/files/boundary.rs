//! The boundary file: where every point of a domain's surface goes, not its vertices alone. A safetensors container.
//!
//! Its tensors are those of [`boundary_tensors`](super::boundary_tensors), which map files hold as well. The metadata
//! entry `solidmap_boundary` is a JSON object: [`BoundaryMetadata`] and `boundary`, with `way` (`straight`,
//! `onto_sphere`, `through_sphere`, from version 1.1 on `through_torus`, from 1.2 on `through_hyperbolic_surface`, from 1.3 on `by_shells`) and
//! `subdivisions`.

use std::path::Path;

use super::Provenance;
use super::boundary_tensors::{self, BoundaryHeader};
use super::tensor_file::{BOUNDARY, GENERATOR, Reader, TensorFileError};
use crate::boundary_map::BoundaryMap;
use crate::io::read_bytes;

/// A boundary map as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryFile {
    /// The boundary map.
    pub boundary: BoundaryMap,
    /// What else the file says.
    pub metadata: BoundaryMetadata,
}

/// What a boundary file says about its map.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct BoundaryMetadata {
    /// `major.minor` of the format.
    pub format_version: String,
    /// Program and version that wrote the file.
    pub generator: String,
    /// The files the map was made from.
    #[serde(default)]
    pub inputs: Vec<Provenance>,
}

impl BoundaryMetadata {
    /// Metadata of a boundary map that this program has just made.
    pub fn new(inputs: Vec<Provenance>) -> Self {
        Self {
            format_version: BOUNDARY.format_version(),
            generator: GENERATOR.into(),
            inputs,
        }
    }
}

#[derive(serde::Serialize)]
struct BoundaryFileHeader<'a> {
    #[serde(flatten)]
    metadata: &'a BoundaryMetadata,
    boundary: BoundaryHeader,
}

/// Writes a boundary file. The same map gives the same bytes.
///
/// # Errors
///
/// When the file cannot be written.
pub fn write_boundary(path: &Path, file: &BoundaryFile) -> Result<(), TensorFileError> {
    let version = BOUNDARY.version_for(&file.metadata.format_version, Some(&file.boundary));
    let header = BoundaryFileHeader {
        metadata: &BoundaryMetadata {
            format_version: version,
            ..file.metadata.clone()
        },
        boundary: boundary_tensors::header_of(&file.boundary),
    };
    BOUNDARY.write(path, &header, &boundary_tensors::tensors_of(&file.boundary))
}

/// Reads a boundary file.
///
/// # Errors
///
/// When it cannot be read, is not a complete boundary file, is of a newer major version, or holds embeddings that
/// are not one to one, which is decided exactly.
pub fn read_boundary(path: &Path) -> Result<BoundaryFile, TensorFileError> {
    let content = read_bytes(path)?;
    let reader = Reader::new(&BOUNDARY, path, &content)?;
    Ok(BoundaryFile {
        boundary: boundary_tensors::read(&reader)?,
        metadata: reader.metadata()?,
    })
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use safetensors::tensor::{SafeTensors, TensorView};

    use super::*;
    use crate::files::{MapFile, read_map, write_map};
    use crate::mesh::shapes;
    use crate::spherical::testing::radial_embedding;

    fn through() -> BoundaryMap {
        let [domain, target] = [shapes::bumpy_sphere(5), shapes::cube(2.0, 3)].map(radial_embedding);
        BoundaryMap::through_sphere(domain, target).unwrap()
    }

    fn maps() -> Vec<BoundaryMap> {
        let onto = BoundaryMap::onto_sphere(radial_embedding(shapes::bumpy_sphere(5))).unwrap();
        let straight = BoundaryMap::new(onto.domain().clone(), onto.image().to_vec()).unwrap();
        vec![through(), through().subdivided(), onto, straight]
    }

    fn file_of(boundary: BoundaryMap) -> BoundaryFile {
        let inputs = vec![Provenance {
            role: "domain".into(),
            file: "bumpy.obj".into(),
            sha256: "ab".into(),
        }];
        BoundaryFile {
            boundary,
            metadata: BoundaryMetadata::new(inputs),
        }
    }

    #[test]
    fn what_is_written_is_read_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let [path, again] = ["a.boundary", "again.boundary"].map(|name| folder.path().join(name));
        for map in maps() {
            let file = file_of(map);
            write_boundary(&path, &file).unwrap();
            let read = read_boundary(&path).unwrap();
            assert_eq!(read, file);
            write_boundary(&again, &read).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&again).unwrap());
        }
    }

    #[test]
    fn map_files_hold_the_same_boundary_maps() {
        let folder = tempfile::tempdir().unwrap();
        let [path, boundary_path] = ["a.map", "a.boundary"].map(|name| folder.path().join(name));
        for map in maps() {
            let coefficients = crate::solver::Coefficients {
                sources: vec![],
                affine: [[0.0; 3]; 4],
            };
            let file = MapFile {
                map: crate::map::HarmonicMap::new(vec![], coefficients).unwrap(),
                boundary: Some(map.clone()),
                bijective: None,
                metadata: crate::files::MapMetadata {
                    format_version: "1.1".into(),
                    ..Default::default()
                },
            };
            write_map(&path, &file).unwrap();
            let read = read_map(&path).unwrap();
            assert_eq!(read.boundary.as_ref(), Some(&map));
            assert_eq!(read.metadata, file.metadata);

            write_boundary(&boundary_path, &file_of(map)).unwrap();
            let message = read_map(&boundary_path).unwrap_err().to_string();
            assert!(
                message.contains("not a map file") && message.contains("fit --boundary"),
                "{message}"
            );
            let message = read_boundary(&path).unwrap_err().to_string();
            assert!(
                message.contains("not a boundary file") && message.contains("fitted map"),
                "{message}"
            );
        }
    }

    /// The type, shape and bytes of each tensor.
    type Tables = HashMap<String, (safetensors::Dtype, Vec<usize>, Vec<u8>)>;

    /// The error of reading a boundary file whose tensors and metadata `change` has altered.
    fn changed(path: &Path, change: impl FnOnce(&mut Tables, &mut String)) -> String {
        write_boundary(path, &file_of(through())).unwrap();
        let content = std::fs::read(path).unwrap();
        let tensors = SafeTensors::deserialize(&content).unwrap();
        let table = |(name, t): (String, TensorView)| (name, (t.dtype(), t.shape().to_vec(), t.data().to_vec()));
        let mut tables: Tables = tensors.tensors().into_iter().map(table).collect();
        let (_, header) = SafeTensors::read_metadata(&content).unwrap();
        let mut metadata = header.metadata().as_ref().unwrap()[BOUNDARY.key].clone();
        change(&mut tables, &mut metadata);
        let views: Vec<_> = tables
            .iter()
            .map(|(name, (dtype, shape, data))| (name, TensorView::new(*dtype, shape.clone(), data).unwrap()))
            .collect();
        let entries = HashMap::from([(BOUNDARY.key.to_owned(), metadata)]);
        std::fs::write(path, safetensors::serialize(views, Some(entries)).unwrap()).unwrap();
        read_boundary(path).map(|_| ()).unwrap_err().to_string()
    }

    fn put(tables: &mut Tables, tensor: &str, row: usize, value: f64) {
        tables.get_mut(tensor).unwrap().2[24 * row..24 * row + 8].copy_from_slice(&value.to_le_bytes());
    }

    #[test]
    fn every_kind_of_damage_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("odd.boundary");
        let tensors = [
            "domain_vertices",
            "domain_triangles",
            "domain_directions",
            "image_vertices",
        ];
        let of_target = ["target_vertices", "target_triangles", "target_directions"];
        for tensor in tensors.into_iter().chain(of_target) {
            let message = changed(&path, |tables, _| drop(tables.remove(tensor)));
            assert!(message.contains(tensor) && message.contains("missing"), "{message}");
            let message = changed(&path, |tables, _| {
                let (_, shape, data) = tables.get_mut(tensor).unwrap();
                shape[0] -= 1;
                data.truncate(data.len() / (shape[0] + 1) * shape[0]);
            });
            assert!(message.contains("tensor `"), "{message}");
            let message = changed(&path, |tables, _| tables.get_mut(tensor).unwrap().1.reverse());
            assert!(message.contains(tensor) && message.contains("shape"), "{message}");
        }
        for tensor in [
            "domain_vertices",
            "domain_directions",
            "image_vertices",
            "target_vertices",
            "target_directions",
        ] {
            for value in [f64::NAN, f64::INFINITY] {
                let message = changed(&path, |tables, _| put(tables, tensor, 7, value));
                assert!(message.contains("tensor `"), "{message}");
            }
        }
        for tensor in ["domain_directions", "target_directions"] {
            let message = changed(&path, |tables, _| put(tables, tensor, 7, -0.9));
            assert!(
                message.contains(tensor) && message.contains("not one to one"),
                "{message}"
            );
            let message = changed(&path, |tables, _| {
                for byte in (0..24).step_by(8) {
                    let cell = &mut tables.get_mut(tensor).unwrap().2[byte..byte + 8];
                    let value = f64::from_le_bytes((&*cell).try_into().unwrap());
                    cell.copy_from_slice(&(2.0 * value).to_le_bytes());
                }
            });
            assert!(message.contains(tensor) && message.contains("length 2"), "{message}");
        }
        let message = changed(&path, |tables, _| put(tables, "image_vertices", 7, 0.123));
        assert!(
            message.contains("image_vertices") && message.contains("row 7"),
            "{message}"
        );
        let message = changed(&path, |tables, _| put(tables, "target_vertices", 0, -1.1));
        assert!(
            message.contains("image_vertices") && message.contains("changed"),
            "{message}"
        );
        let message = changed(&path, |_, metadata| {
            *metadata = metadata.replace("through_sphere", "straight")
        });
        assert!(
            message.contains("domain_directions") && message.contains("metadata"),
            "{message}"
        );
        let message = changed(&path, |_, metadata| {
            *metadata = metadata.replace("through_sphere", "onto_sphere")
        });
        assert!(message.contains("target_directions"), "{message}");
        let message = changed(&path, |_, metadata| {
            *metadata = metadata.replace("through_sphere", "by_plane")
        });
        assert!(message.contains("by_plane"), "{message}");
        let many = |metadata: &String| metadata.replace("\"subdivisions\":0", "\"subdivisions\":40");
        let message = changed(&path, |_, metadata| *metadata = many(metadata));
        assert!(message.contains("40 times"), "{message}");
        let message = changed(&path, |_, metadata| *metadata = metadata.replace("\"1.0\"", "\"2.0\""));
        assert!(message.contains("format 2.0"), "{message}");
    }

    #[test]
    fn files_cut_off_anywhere_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cut.boundary");
        write_boundary(&path, &file_of(through())).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(211) {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(
                matches!(read_boundary(&path), Err(TensorFileError::Foreign { .. })),
                "{length}"
            );
        }
        assert!(matches!(
            read_boundary(&folder.path().join("none.boundary")),
            Err(TensorFileError::Io(_))
        ));
    }
}
