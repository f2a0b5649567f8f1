//! Surfaces with the labels of their triangles: in PLY as a property `label` of faces, in OBJ as materials `-x` to `+z`.

use std::io;
use std::path::Path;

use super::input::{InputFile, excerpt};
use super::triangle_labels::label;
use super::{IoError, Place, atomic_write, extension, obj, ply, read_bytes, unknown_extension};
use crate::mesh::{DIRECTION_NAMES, SurfaceMesh};

/// Whether labels in a file of this name stand beside a surface (.ply, .obj), and not alone, as text.
pub fn holds_labelled_surface(path: impl AsRef<Path>) -> bool {
    matches!(extension(path.as_ref()).as_str(), "ply" | "obj")
}

/// Writes a surface with the label of each triangle, 0 to 5 for -x, +x, -y, +y, -z, +z: as the property `label` of faces (.ply), or as
/// materials `-x` to `+z` (.obj), which [`read_triangle_labels`](super::read_triangle_labels) reads.
///
/// # Errors
///
/// [`IoError::ValueCount`] unless there is one label per triangle, [`IoError::UnknownExtension`] for other extensions, [`IoError::Write`],
/// also for other labels.
pub fn write_labelled_surface(path: impl AsRef<Path>, surface: &SurfaceMesh, labels: &[u8]) -> Result<(), IoError> {
    let path = path.as_ref();
    let triangles = surface.triangles();
    if labels.len() != triangles.len() {
        return Err(IoError::value_count(path, "label", triangles.len(), labels.len()));
    }
    match extension(path).as_str() {
        "ply" => atomic_write(path, |writer| ply::write_labelled(writer, surface, labels)),
        "obj" => atomic_write(path, |writer| {
            for p in surface.vertices() {
                writeln!(writer, "v {} {} {}", p.x, p.y, p.z)?;
            }
            let mut last = None;
            for (t, &label) in triangles.iter().zip(labels) {
                if last != Some(label) {
                    let name = DIRECTION_NAMES.get(usize::from(label));
                    let name = name.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a label is above 5"))?;
                    writeln!(writer, "usemtl {name}")?;
                    last = Some(label);
                }
                let [a, b, c] = t.map(|v| u64::from(v) + 1);
                writeln!(writer, "f {a} {b} {c}")?;
            }
            Ok(())
        }),
        _ => Err(unknown_extension(path, "a surface with labels", ["ply", "obj"])),
    }
}

/// The labels of the triangles of a surface file, in its order; those of a polygon are those of all its triangles.
pub(super) fn labels_of(path: &Path) -> Result<Vec<u8>, IoError> {
    let bytes = read_bytes(path)?;
    let format = if extension(path) == "ply" { "PLY" } else { "OBJ" };
    let file = InputFile {
        path,
        format,
        bytes: &bytes,
    };
    match format {
        "PLY" => ply::labels(&file),
        _ => materials(&file),
    }
}

/// Labels by the material, or else the group, that faces of an OBJ file stand under.
fn materials(file: &InputFile) -> Result<Vec<u8>, IoError> {
    let (mut labels, mut current) = (vec![], None);
    for (number, (statement, _)) in (1..).zip(obj::statements(file.bytes)) {
        let code = statement.split(|&b| b == b'#').next().unwrap_or_default();
        let mut words = code.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"usemtl" | b"g") => current = words.next().and_then(label).or(current),
            Some(b"f") => {
                let Some(label) = current else {
                    let found = format!(
                        "found `{}` before a material or group -x, +x, -y, +y, -z or +z",
                        excerpt(code)
                    );
                    return Err(file.malformed_at(Place::Line(number), found));
                };
                let corners = words.count();
                labels.extend(std::iter::repeat_n(label, corners.saturating_sub(2)));
            }
            _ => {}
        }
    }
    Ok(labels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{read_surface, read_triangle_labels, write_triangle_labels};
    use crate::mesh::shapes;

    #[test]
    fn labels_beside_a_surface_read_back_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let cube = shapes::cube(1.0, 2);
        let labels: Vec<u8> = (0..cube.triangles().len()).map(|t| (t * 5 % 6) as u8).collect();
        for name in ["cube.ply", "cube.OBJ"] {
            let path = folder.path().join(name);
            write_labelled_surface(&path, &cube, &labels).unwrap();
            assert_eq!(read_triangle_labels(&path, labels.len()).unwrap(), labels);
            assert_eq!(read_surface(&path).unwrap(), cube);
            let error = read_triangle_labels(&path, 5).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("48"), "{error}");
            assert!(write_labelled_surface(&path, &cube, &labels[1..]).is_err());
            assert!(write_labelled_surface(&path, &cube, &[6; 48]).is_err());
            assert_eq!(
                read_surface(&path).unwrap(),
                cube,
                "a failure leaves the file as it was"
            );
        }
        let other = write_labelled_surface(folder.path().join("cube.stl"), &cube, &labels);
        assert!(matches!(other, Err(IoError::UnknownExtension { .. })));
        write_triangle_labels(folder.path().join("plain"), &labels).unwrap();
        assert_eq!(read_triangle_labels(folder.path().join("plain"), 48).unwrap(), labels);
    }

    #[test]
    fn polygons_groups_and_other_types_are_read_and_missing_labels_named() {
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str, text: &str, count| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            read_triangle_labels(&path, count).map_err(|error| error.to_string())
        };
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
        let text = format!("{square}g +z\nf 1 2 3 4\nusemtl none\nf 1 2 3\nusemtl -y # down\nf 3/1 2/1 1/1\n");
        assert_eq!(read("a.obj", &text, 4).unwrap(), [5, 5, 5, 2]);
        let error = read("a.obj", &format!("{square}f 1 2 3\n"), 1).unwrap_err();
        assert!(error.contains("line 5") && error.contains("+x"), "{error}");
        let ply = |property: &str, faces: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\nproperty list \
                 uchar int vertex_indices\n{property}end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n{faces}"
            )
        };
        let labelled = ply("property int label\n", "4 0 1 2 3 5\n3 2 1 0 2\n");
        assert_eq!(read("a.ply", &labelled, 3).unwrap(), [5, 5, 2]);
        let error = read("a.ply", &ply("", "3 0 1 2\n3 2 1 0\n"), 2).unwrap_err();
        assert!(error.contains("`label`"), "{error}");
        for wrong in ["6", "-1", "2.5"] {
            let faces = format!("3 0 1 2 4\n3 2 1 0 {wrong}\n");
            let error = read("a.ply", &ply("property float label\n", &faces), 2).unwrap_err();
            assert!(error.contains("0 to 5") && error.contains("face 1"), "{error}");
        }
    }
}
