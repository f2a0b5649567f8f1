//! Wavefront OBJ: the `v` and `f` statements; all others are passed over.

use std::{
    borrow::Cow,
    io::{self, Write},
};

use super::{
    IoError,
    contents::Contents,
    source::{Source, excerpt, parsed},
};
use crate::{Point, mesh::SurfaceMesh};

/// All objects and groups as one mesh, vertices and faces in file order. Normals, texture coordinates, colours,
/// weights, materials, lines, points and free-form curves are passed over.
pub(super) fn parse(source: &Source) -> Result<Contents, IoError> {
    let mut reader = Reader::default();
    let mut offset = 0;
    while offset < source.bytes.len() {
        let (statement, length) = logical_line(&source.bytes[offset..]);
        reader.add(&statement).map_err(|wanted| {
            let found = excerpt(statement.trim_ascii());
            source.malformed(offset, format!("found `{found}`: {wanted}"))
        })?;
        offset += length;
    }
    match reader.before_first {
        Some((face, vertex)) => Err(IoError::IndexOutOfRange {
            path: source.path.to_owned(),
            element: "face",
            index: face,
            vertex,
            vertices: reader.contents.vertices.len(),
            base: 1,
        }),
        None => Ok(reader.contents),
    }
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

/// Gathers what the statements say.
struct Reader {
    contents: Contents,
    faces: usize,
    /// The first face that counts back from a vertex farther than there are, and the number it names.
    before_first: Option<(usize, i64)>,
}

impl Default for Reader {
    fn default() -> Self {
        Self {
            contents: Contents {
                base: 1,
                ..Contents::default()
            },
            faces: 0,
            before_first: None,
        }
    }
}

impl Reader {
    /// The error says what a statement needs to have.
    fn add(&mut self, statement: &[u8]) -> Result<(), &'static str> {
        let code = statement.split(|&b| b == b'#').next().unwrap_or_default();
        let mut words = code.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"v") => {
                let mut coordinate = || words.next().and_then(parsed).ok_or("a vertex needs three numbers");
                let point = Point::new(coordinate()?, coordinate()?, coordinate()?);
                self.contents.vertices.push(point);
            }
            Some(b"f") => {
                let mut corners = Vec::with_capacity(4);
                for word in words {
                    let number: i64 = parsed(vertex_part(word)).ok_or("a face needs whole numbers")?;
                    corners.push(self.resolved(number));
                }
                self.contents.polygons.push(corners);
                self.faces += 1;
            }
            _ => {}
        }
        Ok(())
    }

    /// From 0. Negative numbers count back from the last vertex so far.
    fn resolved(&mut self, number: i64) -> i64 {
        if number >= 0 {
            return number - 1;
        }
        let index = number.saturating_add(self.contents.vertices.len() as i64);
        if index < 0 {
            self.before_first.get_or_insert((self.faces, number));
        }
        index
    }
}

/// The vertex of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`; a corner without a vertex stays as it is, to be refused.
fn vertex_part(corner: &[u8]) -> &[u8] {
    match corner.iter().position(|&b| b == b'/') {
        Some(end) if end > 0 => &corner[..end],
        _ => corner,
    }
}

/// The first line of `bytes`, joined with those that a backslash at its end continues it by, and the length of all
/// that. A comment is not continued: it may well end in a path such as `C:\models\`.
fn logical_line(bytes: &[u8]) -> (Cow<'_, [u8]>, usize) {
    let mut length = 0;
    let mut joined = Vec::new();
    let mut commented = false;
    loop {
        let rest = &bytes[length..];
        let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        length += (end + 1).min(rest.len());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{
        Place,
        testing::{place_of, surface},
    };

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
    fn polygons_are_fanned_about_their_first_corner() {
        let mesh = surface(
            "obj",
            b"v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 1 0\nf 2 3 4 5 1\nf 1 2 3 4\n",
        )
        .unwrap();
        assert_eq!(
            mesh.triangles(),
            [[1, 2, 3], [1, 3, 4], [1, 4, 0], [0, 1, 2], [0, 2, 3]]
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
