//! Wavefront OBJ, read through the crate `tobj`.
//!
//! `tobj` renumbers vertices in the order in which faces first use them, drops unused ones and returns objects and
//! groups separately. It is therefore given only the `v` and `f` statements, after one face that lists all vertices in
//! order: this keeps the numbering of the file.

use std::{
    borrow::Cow,
    io::{self, BufRead, Read, Write},
};

use super::{
    IoError,
    input::{InputFile, excerpt, parsed},
    raw_mesh::RawMesh,
};
use crate::{Point, mesh::SurfaceMesh};

/// All objects and groups as one mesh, vertices and faces in file order. Normals, texture coordinates, colours,
/// weights, materials, lines, points and free-form curves are skipped.
pub(super) fn parse(file: &InputFile) -> Result<RawMesh, IoError> {
    raw(file, &Statements::of(file.bytes, ObjPart::Shape))
}

/// A mesh of the faces with texture coordinates as vertices, whose third coordinate is 0. `None` without texture
/// coordinates.
pub(super) fn parse_uv(file: &InputFile) -> Result<Option<RawMesh>, IoError> {
    let statements = Statements::of(file.bytes, ObjPart::Texture);
    let is_textured = statements
        .text
        .lines()
        .any(|line| line.starts_with("f ") && line != UNTEXTURED);
    if !is_textured {
        return Ok(None);
    }
    if let Some(line) = statements.text.lines().position(|line| line == UNTEXTURED) {
        let found = "a face without texture coordinates for all its corners, among others that have them";
        return Err(file.malformed(statements.offsets[line], found));
    }
    raw(file, &statements).map(Some)
}

fn raw(file: &InputFile, statements: &Statements) -> Result<RawMesh, IoError> {
    let heading = statements.face_of_all_vertices();
    let mut reader = LineCounter {
        rest: statements.text.as_bytes(),
        read: 0,
    };
    let options = tobj::LoadOptions::default();
    let no_materials = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let loaded = tobj::load_obj_buf(&mut heading.as_bytes().chain(&mut reader), &options, no_materials);
    let mesh = match loaded {
        Ok((models, _)) => models.into_iter().next().map(|model| model.mesh).unwrap_or_default(),
        Err(tobj::LoadError::FaceVertexOutOfBounds) => return Err(statements.first_missing_vertex(file)),
        Err(error) => return Err(statements.malformed(file, reader.read.saturating_sub(1), &error)),
    };

    let vertices = mesh.positions.chunks_exact(3).map(|p| Point::new(p[0], p[1], p[2]));
    let mut raw = RawMesh {
        vertices: vertices.collect(),
        base: 1,
        ..RawMesh::default()
    };
    let mut corners = mesh.indices.as_slice();
    let arities = match mesh.face_arities {
        // `tobj` leaves them out when all faces are triangles.
        arities if arities.is_empty() => vec![3; corners.len() / 3],
        arities => arities,
    };
    for (face, &arity) in arities.iter().enumerate() {
        let (these, others) = corners.split_at(arity as usize);
        corners = others;
        if face > 0 || heading.is_empty() {
            raw.polygons.push(these.iter().map(|&v| i64::from(v)));
        }
    }
    Ok(raw)
}

/// Writes vertices and triangles; coordinates read back to the same bits.
pub(super) fn write(writer: &mut dyn Write, mesh: &SurfaceMesh) -> io::Result<()> {
    for p in mesh.vertices() {
        writeln!(writer, "v {:?} {:?} {:?}", p.x, p.y, p.z)?;
    }
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|v| v + 1);
        writeln!(writer, "f {a} {b} {c}")?;
    }
    Ok(())
}

/// The statements to read.
#[derive(Clone, Copy, PartialEq)]
enum ObjPart {
    /// Vertices, and the faces over them.
    Shape,
    /// Texture coordinates, and the faces over them.
    Texture,
}

/// Placeholder for a face without texture coordinates.
const UNTEXTURED: &str = "f -";

/// All statements of a file with their offsets.
pub(super) fn statements(bytes: &[u8]) -> impl Iterator<Item = (Cow<'_, [u8]>, usize)> {
    // A byte order mark would hide the first statement.
    let mut offset = if bytes.starts_with("\u{feff}".as_bytes()) { 3 } else { 0 };
    std::iter::from_fn(move || {
        if offset >= bytes.len() {
            return None;
        }
        let (statement, length) = logical_line(&bytes[offset..]);
        let at = offset;
        offset += length;
        Some((statement, at))
    })
}

/// The `v` and `f` statements of a file, one per line, without comments, colours and texture or normal indices; or the
/// `vt` and `f` statements in the same form, without vertex and normal indices.
#[derive(Default)]
struct Statements {
    text: String,
    /// For each line of `text`, the offset of its statement in the file.
    offsets: Vec<usize>,
    vertices: usize,
}

impl Statements {
    fn of(bytes: &[u8], part: ObjPart) -> Self {
        let mut collected = Self::default();
        for (statement, offset) in statements(bytes) {
            collected.add(&statement, offset, part);
        }
        collected
    }

    /// A face statement that lists all vertices in order; empty without vertices.
    fn face_of_all_vertices(&self) -> String {
        let mut face = String::with_capacity(8 * self.vertices);
        for v in 1..=self.vertices {
            face.push_str(if v == 1 { "f " } else { " " });
            face.push_str(&v.to_string());
        }
        face.push_str(if self.vertices > 0 { "\n" } else { "" });
        face
    }

    fn add(&mut self, statement: &[u8], offset: usize, part: ObjPart) {
        let code = statement.split(|&b| b == b'#').next().unwrap_or_default();
        let mut words = code.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match (words.next(), part) {
            (Some(b"v"), ObjPart::Shape) => {
                self.text.push('v');
                words.take(3).for_each(|word| self.add_word(word));
                self.vertices += 1;
            }
            (Some(b"vt"), ObjPart::Texture) => {
                self.text.push('v');
                let [u, v] = [words.next(), words.next()].map(|word| word.unwrap_or(b"0"));
                [u, v, b"0"].into_iter().for_each(|word| self.add_word(word));
                self.vertices += 1;
            }
            (Some(b"f"), ObjPart::Shape) => {
                self.text.push('f');
                words.for_each(|word| self.add_word(vertex_part(word)));
            }
            (Some(b"f"), ObjPart::Texture) => match words.map(texture_part).collect::<Option<Vec<_>>>() {
                Some(parts) => {
                    self.text.push('f');
                    parts.into_iter().for_each(|word| self.add_word(word));
                }
                None => self.text.push_str(UNTEXTURED),
            },
            _ => return,
        }
        self.text.push('\n');
        self.offsets.push(offset);
    }

    fn add_word(&mut self, word: &[u8]) {
        self.text.push(' ');
        self.text.push_str(&String::from_utf8_lossy(word));
    }

    fn malformed(&self, file: &InputFile, line: usize, error: &tobj::LoadError) -> IoError {
        let offset = self.offsets.get(line).copied().unwrap_or(file.bytes.len());
        let (statement, _) = logical_line(&file.bytes[offset..]);
        let wanted = match error {
            tobj::LoadError::PositionParseError if statement.trim_ascii().starts_with(b"vt") => {
                "texture coordinates need numbers".to_owned()
            }
            tobj::LoadError::PositionParseError => "a vertex needs three numbers".to_owned(),
            tobj::LoadError::FaceParseError => "a face needs whole numbers".to_owned(),
            other => other.to_string(),
        };
        file.malformed(offset, format!("found `{}`: {wanted}", excerpt(statement.trim_ascii())))
    }

    /// Finds the missing vertex that `tobj` reports without its place.
    fn first_missing_vertex(&self, file: &InputFile) -> IoError {
        let (mut vertices, mut faces) = (0, 0);
        for (line, statement) in self.text.lines().enumerate() {
            let mut words = statement.split(' ');
            if words.next() == Some("v") {
                vertices += 1;
                continue;
            }
            for word in words {
                let Some(index) = parsed::<i64>(word.as_bytes()) else {
                    return self.malformed(file, line, &tobj::LoadError::FaceParseError);
                };
                let from_first = if index < 0 {
                    index.saturating_add(vertices + 1)
                } else {
                    index
                };
                if from_first < 1 || from_first > self.vertices as i64 {
                    return IoError::IndexOutOfRange {
                        path: file.path.to_owned(),
                        element: "face",
                        index: faces,
                        vertex: index,
                        vertices: self.vertices,
                        base: 1,
                    };
                }
            }
            faces += 1;
        }
        file.malformed(file.bytes.len(), tobj::LoadError::FaceVertexOutOfBounds.to_string())
    }
}

/// The vertex of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`; a corner without a vertex is returned whole and refused
/// later.
fn vertex_part(corner: &[u8]) -> &[u8] {
    match corner.iter().position(|&b| b == b'/') {
        Some(end) if end > 0 => &corner[..end],
        _ => corner,
    }
}

/// The texture coordinates of a corner `v/vt` or `v/vt/vn`.
fn texture_part(corner: &[u8]) -> Option<&[u8]> {
    corner.split(|&b| b == b'/').nth(1).filter(|part| !part.is_empty())
}

/// The first line of `bytes`, joined with its continuation lines (after a backslash), and their total length. A comment
/// is not continued: it may end in a path such as `C:\models\`.
fn logical_line(bytes: &[u8]) -> (Cow<'_, [u8]>, usize) {
    let mut length = 0;
    let mut joined = Vec::new();
    let mut commented = false;
    loop {
        let rest = &bytes[length..];
        let end = rest.iter().position(|b| b"\r\n".contains(b)).unwrap_or(rest.len());
        // Line ends of any system.
        let ending = if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
        length += (end + ending).min(rest.len());
        let line = rest[..end].trim_ascii_end();
        commented |= line.contains(&b'#');
        match line {
            [head @ .., b'\\'] if !commented && length < bytes.len() => {
                joined.extend_from_slice(head);
                joined.push(b' ');
            }
            _ if joined.is_empty() => return (Cow::Borrowed(line), length),
            _ => {
                joined.extend_from_slice(line);
                return (Cow::Owned(joined), length);
            }
        }
    }
}

/// Counts the lines that were read.
struct LineCounter<'a> {
    rest: &'a [u8],
    read: usize,
}

impl Read for LineCounter<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.rest.len().min(buffer.len());
        buffer[..length].copy_from_slice(&self.rest[..length]);
        self.consume(length);
        Ok(length)
    }
}

impl BufRead for LineCounter<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        Ok(self.rest)
    }

    fn consume(&mut self, amount: usize) {
        let (taken, rest) = self.rest.split_at(amount);
        self.read += taken.iter().filter(|&&b| b == b'\n').count();
        self.rest = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{
        Place,
        testing::{place_of, surface},
    };

    #[test]
    fn byte_order_marks_and_line_ends_of_all_systems_are_passed_over() {
        let plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n# one \\\nf 1 2 \\\n3\nf 2 3 4\n";
        let expected = surface("obj", plain.as_bytes()).unwrap();
        assert_eq!(expected.triangles(), [[0, 1, 2], [1, 2, 3]]);
        for text in [
            format!("\u{feff}{plain}"),
            plain.replace('\n', "\r\n"),
            plain.replace('\n', "\r"),
        ] {
            assert_eq!(surface("obj", text.as_bytes()).unwrap(), expected, "{text:?}");
        }
    }

    #[test]
    fn vertex_order_survives_and_unreferenced_vertices_stay() {
        // Faces use the vertices backwards, and vertex 1 not at all.
        let mesh = surface(
            "obj",
            b"v 0 0 0\nv 9 9 9\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 5 4 3\nf 3 4 1\n",
        )
        .unwrap();
        assert_eq!(mesh.vertices()[1], Point::new(9., 9., 9.));
        assert_eq!(mesh.vertices()[4], Point::new(0., 0., 1.));
        assert_eq!(mesh.triangles(), [[4, 3, 2], [2, 3, 0]]);
    }

    #[test]
    fn objects_groups_and_materials_are_one_mesh_in_file_order() {
        let text = b"mtllib missing.mtl\no one\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 3 2 1\no two\ng a b\n\
                     v 0 0 1\nvt 0 0\nvn 0 0 1\nusemtl\nf 4/1/1 1//1 2/1\ns off\nf 1 2 3\n";
        let mesh = surface("obj", text).unwrap();
        assert_eq!(mesh.vertices().len(), 4);
        assert_eq!(mesh.triangles(), [[2, 1, 0], [3, 0, 1], [0, 1, 2]]);
    }

    #[test]
    fn negative_indices_count_back_from_the_face() {
        let mesh = surface("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf -1 -3 -2\n").unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2], [3, 1, 2]]);
    }

    #[test]
    fn faces_may_come_before_their_vertices() {
        let mesh = surface("obj", b"v 0 0 0\nf 1 3 2\nv 1 0 0\nv 0 1 0\n").unwrap();
        assert_eq!(mesh.vertices()[1], Point::new(1., 0., 0.));
        assert_eq!(mesh.triangles(), [[0, 2, 1]]);
    }

    #[test]
    fn polygons_are_cut_by_the_order_of_their_corners() {
        let mesh = surface(
            "obj",
            b"v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 1 0\nf 2 3 4 5 1\nf 1 2 3 4\n",
        )
        .unwrap();
        assert_eq!(
            mesh.triangles(),
            [[1, 2, 3], [3, 4, 0], [1, 3, 0], [0, 1, 2], [0, 2, 3]]
        );
    }

    #[test]
    fn lines_go_on_after_a_backslash_but_comments_do_not() {
        let text = b"# C:\\models\\\nv 0 0 \\\r\n 0\nv 1 0 0 # and \\\nv 0 1 0\nf 1 \\\n2 \\\n3\n";
        let mesh = surface("obj", text).unwrap();
        assert_eq!(mesh.vertices().len(), 3);
        assert_eq!(mesh.triangles(), [[0, 1, 2]]);
    }

    #[test]
    fn comments_may_hold_any_bytes_and_lines_any_end() {
        let mesh = surface("obj", b"# caf\xe9 \xff\r\nv 0 0 0\r\n\tv 1 0 0 \r\nv 0 1 0\r\nf 1 2 3").unwrap();
        assert_eq!(mesh.triangles().len(), 1);
    }

    #[test]
    fn colours_weights_lines_and_points_are_passed_over() {
        let text = b"v 0 0 0 1 0 0\nv 2 0 0 2\nv 0 1 0 0.5 0.5\nl 1 2\np 3\nf 1 2 3\n";
        let mesh = surface("obj", text).unwrap();
        assert_eq!(mesh.vertices()[1], Point::new(2., 0., 0.));
        assert_eq!(mesh.triangles(), [[0, 1, 2]]);
    }

    #[test]
    fn meshes_of_up_to_three_vertices_are_read() {
        // The face that heads the text then has as few corners as a point, a line and a triangle.
        assert_eq!(surface("obj", b"v 0 0 0\nf 1 1 1\n").unwrap().triangles(), [[0, 0, 0]]);
        assert_eq!(
            surface("obj", b"v 0 0 0\nv 1 0 0\nf 2 1 1\n").unwrap().triangles(),
            [[1, 0, 0]]
        );
        assert_eq!(
            surface("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 3 2 1\n")
                .unwrap()
                .triangles(),
            [[2, 1, 0]]
        );
    }

    #[test]
    fn unusual_numbers_are_read_as_they_are() {
        let mesh = surface("obj", b"v nan inf -inf\nv 1e300 -0.0 +1.5E-3\nv NaN 0 0\nf 1 2 3\n").unwrap();
        let [p, q] = [mesh.vertices()[0], mesh.vertices()[1]];
        assert!(p.x.is_nan() && p.y == f64::INFINITY && p.z == f64::NEG_INFINITY);
        assert!(q.x == 1e300 && q.y.is_sign_negative() && q.z == 1.5e-3);
    }

    #[test]
    fn malformed_statements_are_named_by_their_line() {
        for (text, line) in [
            ("v 0 0 0\n\n# c\nv 1 x 0\n", 4),
            ("v 0 0\n", 1),
            ("v 0 0 0\nf 1 2 \\\n three\n", 2),
            ("v 0 0 0\nv 0 0 0\nf /1 1 1\n", 3),
            ("v 0 0 0\nf 1.5 1 1\n", 2),
        ] {
            assert_eq!(place_of(surface("obj", text.as_bytes())), Place::Line(line), "{text}");
        }
    }

    #[test]
    fn missing_vertices_are_named_by_their_face() {
        for (text, face, missing) in [
            ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 4\n", 1, 4),
            ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 0 3\n", 0, 0),
            ("v 0 0 0\nf -1 -1 -2\nv 1 0 0\n", 0, -2),
            ("f 1 2 3\n", 0, 1),
        ] {
            match surface("obj", text.as_bytes()) {
                Err(IoError::IndexOutOfRange {
                    index, vertex, base: 1, ..
                }) => {
                    assert_eq!((index, vertex), (face, missing), "{text}");
                }
                other => panic!("{text}: {other:?}"),
            }
        }
    }

    #[test]
    fn faces_need_three_corners_and_surfaces_need_faces() {
        let two = surface("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\n");
        assert!(
            matches!(
                two,
                Err(IoError::FewCorners {
                    face: 1,
                    corners: 2,
                    ..
                })
            ),
            "{two:?}"
        );
        let none = surface("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf\n");
        assert!(
            matches!(
                none,
                Err(IoError::FewCorners {
                    face: 0,
                    corners: 0,
                    ..
                })
            ),
            "{none:?}"
        );
        let cloud = surface("obj", b"v 0 0 0\nv 1 0 0\n");
        assert!(
            matches!(cloud, Err(IoError::NoGeometry { vertices: 2, .. })),
            "{cloud:?}"
        );
        assert!(matches!(
            surface("obj", b""),
            Err(IoError::NoGeometry { vertices: 0, .. })
        ));
    }
}
