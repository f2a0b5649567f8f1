//! Stanford PLY, in text and both binary orders.
//!
//! Our own code: `ply-rs-bw` keeps every number as a tagged value in a map, which takes several times as long on large
//! scans, and its errors have no positions.

use std::io::{self, Write};
use std::path::Path;

use super::{
    IoError, Place, atomic_write,
    input::{ByteOrder, InputFile, Scalar, TEXT_NUMBER, Tokens, excerpt},
    raw_mesh::RawMesh,
};
use crate::{Point, mesh::SurfaceMesh};

/// The elements `vertex`, `face` and `tristrips` in file order; all other elements and properties are skipped.
pub(super) fn parse(file: &InputFile) -> Result<RawMesh, IoError> {
    let (header, body) = PlyHeader::parse(file)?;
    let mut values = PropertyValues {
        file,
        tokens: file.tokens_in(body..file.bytes.len()),
        order: header.order,
    };
    let mut raw = RawMesh::default();
    for element in &header.elements {
        read_element(element, &mut values, &mut raw)?;
    }
    Ok(raw)
}

/// The property of faces that is the label of a triangle of a polycube.
const LABEL: &str = "label";

/// The numbers of the property `label` of faces, each for all triangles of a face.
pub(super) fn labels(file: &InputFile) -> Result<Vec<u8>, IoError> {
    let (header, body) = PlyHeader::parse(file)?;
    let mut values = PropertyValues {
        file,
        tokens: file.tokens_in(body..file.bytes.len()),
        order: header.order,
    };
    let (mut labels, mut row) = (vec![], ElementValues::default());
    for element in header.elements.iter().filter(|element| !element.properties.is_empty()) {
        let count = values.count(element)?;
        let is_face = element.name == "face";
        let (mut corners, mut label) = (None, None);
        if is_face {
            corners = Some(element.position(file, is_corners, CORNERS)?);
            let is_label = |p: &PlyProperty| p.length.is_none() && p.name == LABEL;
            label = Some(element.position(file, is_label, "`label`")?);
        }
        for face in 0..count {
            values.read_row(element, corners, &mut row)?;
            let Some(found) = label.map(|k| row.singles[k]) else {
                continue;
            };
            let Some(label) = (0..6u8).find(|&label| f64::from(label) == found) else {
                let found = format!("face {face} (0-based) has the label {found} instead of one from 0 to 5");
                return Err(match values.order {
                    None => values.tokens.malformed(found),
                    Some(_) => file.malformed_at(Place::Byte(values.tokens.position()), found),
                });
            };
            labels.extend(std::iter::repeat_n(label, row.list.len().saturating_sub(2)));
        }
    }
    Ok(labels)
}

/// What is missing where faces have no corners.
const CORNERS: &str = "list `vertex_indices`";

fn is_corners(property: &PlyProperty) -> bool {
    property.length.is_some() && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
}

/// Writes binary little-endian PLY with coordinates in double precision.
pub(super) fn write(writer: &mut dyn Write, mesh: &SurfaceMesh) -> io::Result<()> {
    write_head(writer, mesh, "")?;
    write_triangles(writer, mesh.triangles())
}

/// As [`write`], with the label of each triangle.
pub(super) fn write_labelled(writer: &mut dyn Write, mesh: &SurfaceMesh, labels: &[u8]) -> io::Result<()> {
    write_head(writer, mesh, &format!("property uchar {LABEL}\n"))?;
    for (triangle, &label) in mesh.triangles().iter().zip(labels) {
        if label > 5 {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "a label is above 5"));
        }
        write_triangles(writer, &[*triangle])?;
        writer.write_all(&[label])?;
    }
    Ok(())
}

/// All before the triangles, which have this property after their corners.
fn write_head(writer: &mut dyn Write, mesh: &SurfaceMesh, of_faces: &str) -> io::Result<()> {
    write!(
        writer,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty \
         double z\nelement face {}\nproperty list uchar int vertex_indices\n{of_faces}end_header\n",
        mesh.vertices().len(),
        mesh.triangles().len()
    )?;
    for coordinate in mesh.vertices().iter().flat_map(|p| p.iter()) {
        writer.write_all(&coordinate.to_le_bytes())?;
    }
    Ok(())
}

/// Writes points, each with red, green, blue and opacity, and triangles over them if there are any, as binary
/// little-endian PLY (`.ply`) with coordinates in double precision.
///
/// # Errors
///
/// [`IoError::ValueCount`] unless there is one colour per point, [`IoError::Write`].
pub fn write_coloured_ply(
    path: impl AsRef<Path>,
    points: &[Point],
    rgba: &[[u8; 4]],
    triangles: &[[u32; 3]],
) -> Result<(), IoError> {
    if rgba.len() != points.len() {
        return Err(IoError::value_count(path.as_ref(), "colour", points.len(), rgba.len()));
    }
    atomic_write(path, |writer| {
        let colours = ["red", "green", "blue", "alpha"].map(|name| format!("property uchar {name}\n"));
        write!(
            writer,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty \
             double z\n{}",
            points.len(),
            colours.concat()
        )?;
        if !triangles.is_empty() {
            let count = triangles.len();
            write!(writer, "element face {count}\nproperty list uchar int vertex_indices\n")?;
        }
        writeln!(writer, "end_header")?;
        for (point, rgba) in points.iter().zip(rgba) {
            for coordinate in point.iter() {
                writer.write_all(&coordinate.to_le_bytes())?;
            }
            writer.write_all(rgba)?;
        }
        write_triangles(writer, triangles)
    })
}

fn write_triangles(writer: &mut dyn Write, triangles: &[[u32; 3]]) -> io::Result<()> {
    for triangle in triangles {
        writer.write_all(&[3])?;
        for corner in triangle {
            writer.write_all(&corner.to_le_bytes())?;
        }
    }
    Ok(())
}

struct PlyHeader {
    /// `None` for text.
    order: Option<ByteOrder>,
    elements: Vec<PlyElement>,
}

struct PlyElement {
    name: String,
    count: u64,
    properties: Vec<PlyProperty>,
}

struct PlyProperty {
    name: String,
    /// The type of the length, when the property is a list.
    length: Option<Scalar>,
    value: Scalar,
}

impl PlyHeader {
    /// The header, and the offset of the body.
    fn parse(file: &InputFile) -> Result<(Self, usize), IoError> {
        let mut tokens = file.tokens();
        if tokens.line() != b"ply" {
            return Err(tokens.unexpected(file.bytes, "`ply`"));
        }
        let mut order = None;
        let mut elements: Vec<PlyElement> = Vec::new();
        loop {
            if tokens.rest().is_empty() {
                return Err(file.truncated("the header"));
            }
            let line = String::from_utf8_lossy(tokens.line()).into_owned();
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            let parsed = match words[..] {
                [] | ["comment" | "obj_info", ..] => Some(()),
                ["format", format, _] => format_order(format).map(|o| order = Some(o)),
                ["element", name, count] => count.parse().ok().map(|count| {
                    elements.push(PlyElement {
                        name: name.to_owned(),
                        count,
                        properties: vec![],
                    });
                }),
                ["property", "list", length, value, name] => scalar(length)
                    .zip(scalar(value))
                    .zip(elements.last_mut())
                    .map(|((length, value), element)| element.add(name, Some(length), value)),
                ["property", value, name] => scalar(value)
                    .zip(elements.last_mut())
                    .map(|(value, element)| element.add(name, None, value)),
                ["end_header"] => break,
                _ => None,
            };
            if parsed.is_none() {
                return Err(tokens.malformed(format!(
                    "the header line `{}` is not understood",
                    excerpt(line.as_bytes())
                )));
            }
        }
        match order {
            Some(order) => Ok((Self { order, elements }, tokens.position())),
            None => Err(tokens.malformed("the header has no line `format`")),
        }
    }
}

impl PlyElement {
    fn add(&mut self, name: &str, length: Option<Scalar>, value: Scalar) {
        self.properties.push(PlyProperty {
            name: name.to_owned(),
            length,
            value,
        });
    }

    /// Fewest bytes of one element.
    fn min_size(&self, text: bool) -> usize {
        let size = |p: &PlyProperty| p.length.unwrap_or(p.value).size();
        let sizes = self.properties.iter().map(|p| if text { TEXT_NUMBER } else { size(p) });
        sizes.sum()
    }

    fn position(&self, file: &InputFile, is: impl Fn(&PlyProperty) -> bool, wanted: &str) -> Result<usize, IoError> {
        self.properties.iter().position(is).ok_or_else(|| {
            let element = excerpt(self.name.as_bytes());
            file.malformed(0, format!("element `{element}` has no property {wanted}"))
        })
    }
}

fn format_order(name: &str) -> Option<Option<ByteOrder>> {
    match name {
        "ascii" => Some(None),
        "binary_little_endian" => Some(Some(ByteOrder::Little)),
        "binary_big_endian" => Some(Some(ByteOrder::Big)),
        _ => None,
    }
}

fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "long" | "int64" => Scalar::I64,
        "ulong" | "uint64" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}

fn read_element(element: &PlyElement, values: &mut PropertyValues, raw: &mut RawMesh) -> Result<(), IoError> {
    // Without properties there is nothing to read, whatever the count.
    if element.properties.is_empty() {
        return Ok(());
    }
    let count = values.count(element)?;
    let mut row = ElementValues::default();
    match element.name.as_str() {
        "vertex" => {
            let mut at = [0; 3];
            for (place, name) in at.iter_mut().zip(["x", "y", "z"]) {
                let single = |p: &PlyProperty| p.length.is_none() && p.name == name;
                *place = element.position(values.file, single, &format!("`{name}`"))?;
            }
            raw.vertices.reserve(count);
            for _ in 0..count {
                values.read_row(element, None, &mut row)?;
                raw.vertices.push(Point::from(at.map(|k| row.singles[k])));
            }
        }
        "face" | "tristrips" => {
            let corners = element.position(values.file, is_corners, CORNERS)?;
            for _ in 0..count {
                values.read_row(element, Some(corners), &mut row)?;
                if element.name == "face" {
                    raw.polygons.push(row.list.iter().copied());
                } else {
                    raw.polygons.push_strip(&row.list);
                }
            }
        }
        _ => {
            for _ in 0..count {
                values.read_row(element, None, &mut row)?;
            }
        }
    }
    Ok(())
}

/// The properties of one element, reused to save allocations.
#[derive(Default)]
struct ElementValues {
    /// One value per property; 0 for lists.
    singles: Vec<f64>,
    /// The requested list.
    list: Vec<i64>,
}

/// The numbers of the body, in text or binary.
struct PropertyValues<'a> {
    file: &'a InputFile<'a>,
    tokens: Tokens<'a>,
    order: Option<ByteOrder>,
}

impl PropertyValues<'_> {
    fn count(&self, element: &PlyElement) -> Result<usize, IoError> {
        let available = self.tokens.rest().len() + usize::from(self.order.is_none());
        let least = element.min_size(self.order.is_none());
        let name = format!("elements `{}`", excerpt(element.name.as_bytes()));
        self.file.checked_count(element.count, &name, least, available)
    }

    fn read_row(
        &mut self,
        element: &PlyElement,
        wanted: Option<usize>,
        row: &mut ElementValues,
    ) -> Result<(), IoError> {
        let within = if element.name == "vertex" {
            "the vertices"
        } else {
            "the faces or other elements"
        };
        row.singles.clear();
        row.list.clear();
        for (k, property) in element.properties.iter().enumerate() {
            let Some(length) = property.length else {
                row.singles.push(self.float(property.value, within)?);
                continue;
            };
            row.singles.push(0.0);
            let position = self.tokens.position();
            let length = self.integer(length, "the length of a list")?;
            let Ok(length) = u64::try_from(length) else {
                let found = format!("found a list of length {length}");
                return Err(match self.order {
                    None => self.tokens.malformed(found),
                    Some(_) => self.file.malformed_at(Place::Byte(position), found),
                });
            };
            for _ in 0..length {
                let value = self.integer(property.value, within)?;
                if wanted == Some(k) {
                    row.list.push(value);
                }
            }
        }
        Ok(())
    }

    fn float(&mut self, scalar: Scalar, within: &str) -> Result<f64, IoError> {
        match self.order {
            None => self.tokens.float(within),
            Some(order) => Ok(scalar.float(self.tokens.take(scalar.size(), within)?, order)),
        }
    }

    /// A whole number; a floating-point value is truncated.
    fn integer(&mut self, scalar: Scalar, within: &str) -> Result<i64, IoError> {
        match self.order {
            None if matches!(scalar, Scalar::F32 | Scalar::F64) => Ok(self.tokens.float(within)? as i64),
            None => self.tokens.integer(within),
            Some(order) => Ok(scalar.integer(self.tokens.take(scalar.size(), within)?, order)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::testing::{place_of, surface};

    /// A file with unusual types and a binary body; `encoded` takes the little-endian bytes of each value to those of
    /// `order`.
    fn binary(order: &str, encoded: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
        let mut file = format!(
            "ply\nformat {order} 1.0\ncomment end_header is not here\nobj_info none\nelement camera 1\nproperty list \
             ushort double pose\nproperty char flag\nelement vertex 4\nproperty double z\nproperty uchar red\nproperty \
             float32 x\nproperty int16 y\nelement face 2\nproperty uint8 material\nproperty list uint ushort \
             vertex_index\nproperty list uchar float weights\nend_header\n"
        )
        .into_bytes();
        let mut add = |bytes: &[u8]| file.extend(encoded(bytes));
        add(&2u16.to_le_bytes());
        add(&0.5f64.to_le_bytes());
        add(&0.25f64.to_le_bytes());
        add(&[0xff]);
        for (x, y, z) in [(0.5f32, 0i16, 0f64), (1., -2, 0.), (0., 1, 0.1), (0., 0, 1.)] {
            add(&z.to_le_bytes());
            add(&[200]);
            add(&x.to_le_bytes());
            add(&y.to_le_bytes());
        }
        for face in [vec![3u16, 2, 1], vec![0, 1, 2, 3]] {
            add(&[7]);
            add(&(face.len() as u32).to_le_bytes());
            face.iter().for_each(|v| add(&v.to_le_bytes()));
            add(&[1]);
            add(&1.5f32.to_le_bytes());
        }
        file
    }

    fn check(bytes: &[u8]) {
        let mesh = surface("ply", bytes).unwrap();
        let expected = [[0.5, 0., 0.], [1., -2., 0.], [0., 1., 0.1], [0., 0., 1.]].map(Point::from);
        assert_eq!(mesh.vertices(), expected);
        assert_eq!(mesh.triangles(), [[3, 2, 1], [0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn any_types_order_and_extra_data_are_read_in_both_byte_orders() {
        check(&binary("binary_little_endian", |bytes| bytes.to_vec()));
        check(&binary("binary_big_endian", |bytes| {
            bytes.iter().rev().copied().collect()
        }));
    }

    #[test]
    fn text_is_read_with_either_line_end() {
        let text = "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\nproperty float \
                    quality\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty list int \
                    int neighbours\nelement empty 5000000000\nelement edge 1\nproperty int vertex1\nproperty int \
                    vertex2\nend_header\n3 3 2 1 nan\n4 0 1 2 3 0.5\n0.5 0 0 0\n1 -2 0 2 4 5\n0 1 0.1 0\n0 0 1 0\n0 1\n";
        check(text.as_bytes());
        check(text.replace('\n', "\r\n").as_bytes());
    }

    #[test]
    fn triangles_of_strips_alternate_in_orientation_and_minus_one_starts_a_new_strip() {
        let text = "ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\nproperty float z\n\
                    element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n\
                    0 2 0\n5 5 5\nnan inf -inf\n11 0 1 2 3 -1 4 3 2 2 1 0\n";
        let mesh = surface("ply", text.as_bytes()).unwrap();
        // At the repeated vertex 2 the second strip has triangles without area, which count in the alternation.
        assert_eq!(mesh.triangles(), [[0, 1, 2], [2, 1, 3], [4, 3, 2], [1, 2, 0]]);
        assert_eq!(mesh.vertices()[5], Point::new(5., 5., 5.));
        assert!(mesh.vertices()[6].x.is_nan() && mesh.vertices()[6].z == f64::NEG_INFINITY);
    }

    #[test]
    fn faults_are_named() {
        let good = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                    element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        let read = |from: &str, to: &str| {
            assert!(good.contains(from));
            surface("ply", good.replace(from, to).as_bytes())
        };
        assert_eq!(read("", "").unwrap().triangles(), [[0, 1, 2]]);
        assert_eq!(place_of(read("ply\n", "obj\n")), Place::Line(1));
        assert_eq!(place_of(read("ascii", "utf8")), Place::Line(2));
        assert_eq!(place_of(read("float x", "quaternion x")), Place::Line(4));
        assert_eq!(place_of(read("element vertex 3\n", "")), Place::Line(3));
        assert_eq!(place_of(read("vertex 3", "vertex -3")), Place::Line(3));
        assert_eq!(place_of(read("1 0 0\n", "1 o 0\n")), Place::Line(11));
        assert_eq!(place_of(read("3 0 1 2", "-3 0 1 2")), Place::Line(13));
        for from in ["float x", "vertex_indices"] {
            let error = read(from, &from.replace(['x', 'i'], "q")).unwrap_err().to_string();
            assert!(error.contains("has no property"), "{error}");
        }
        assert!(matches!(read("3 0 1 2", "4 0 1 2"), Err(IoError::Truncated { .. })));
        assert!(matches!(
            read("end_header", "comment"),
            Err(IoError::Truncated { .. } | IoError::Malformed { .. })
        ));
        assert!(matches!(
            read("face 1", "face 9999999999"),
            Err(IoError::CountExceedsFile {
                count: 9_999_999_999,
                ..
            })
        ));
        assert!(matches!(
            read("3 0 1 2", "3 0 1 3"),
            Err(IoError::IndexOutOfRange {
                index: 0,
                vertex: 3,
                ..
            })
        ));
        assert!(matches!(
            read("3 0 1 2", "3 0 1 -1"),
            Err(IoError::IndexOutOfRange { vertex: -1, .. })
        ));
        assert!(matches!(
            read("3 0 1 2", "2 0 1"),
            Err(IoError::FewCorners { corners: 2, .. })
        ));
        assert!(matches!(
            read("face 1", "face 0"),
            Err(IoError::NoGeometry { vertices: 3, .. })
        ));

        let whole = binary("binary_little_endian", |bytes| bytes.to_vec());
        let cut = surface("ply", &whole[..whole.len() - 3]);
        assert!(matches!(cut, Err(IoError::Truncated { .. })), "{cut:?}");
    }
}
