//! Geomview's Object File Format, in text: `OFF`, `COFF`, `NOFF`, `STOFF` and their combinations.

use std::io::{self, Write};

use super::{
    IoError,
    input::{InputFile, TEXT_NUMBER, Tokens, parsed},
    raw_mesh::RawMesh,
};
use crate::mesh::SurfaceMesh;

/// Vertices and faces in file order. Colours, normals and texture coordinates, which follow the coordinates on the
/// line of their vertex or the corners on that of their face, are skipped.
pub(super) fn parse(file: &InputFile) -> Result<RawMesh, IoError> {
    let mut tokens = file.tokens().without_comments();
    skip_keyword(file, &mut tokens)?;

    let vertices = tokens.count("vertices", 3 * TEXT_NUMBER)?;
    let faces = tokens.count("faces", TEXT_NUMBER)?;
    skip_count_of_edges(&mut tokens);
    let mut raw = RawMesh {
        vertices: Vec::with_capacity(vertices),
        ..RawMesh::default()
    };
    for _ in 0..vertices {
        raw.vertices.push(tokens.point()?);
        tokens.line();
    }
    let mut polygon = Vec::new();
    for _ in 0..faces {
        let corners = tokens.count("the corners of a face", 0)?;
        polygon.clear();
        for _ in 0..corners {
            polygon.push(tokens.integer("the corners of a face")?);
        }
        tokens.line();
        raw.polygons.push(polygon.iter().copied());
    }
    Ok(raw)
}

/// Writes vertices and triangles; coordinates read back to the same bits.
pub(super) fn write(writer: &mut dyn Write, mesh: &SurfaceMesh) -> io::Result<()> {
    writeln!(writer, "OFF\n{} {} 0", mesh.vertices().len(), mesh.triangles().len())?;
    for p in mesh.vertices() {
        writeln!(writer, "{:?} {:?} {:?}", p.x, p.y, p.z)?;
    }
    for [a, b, c] in mesh.triangles() {
        writeln!(writer, "3 {a} {b} {c}")?;
    }
    Ok(())
}

/// Reads the optional keyword.
fn skip_keyword(file: &InputFile, tokens: &mut Tokens) -> Result<(), IoError> {
    let Some(first) = tokens.peek() else {
        return Err(file.truncated("the keyword OFF"));
    };
    if parsed::<u64>(first).is_some() {
        return Ok(());
    }
    tokens.next();
    let Some(prefix) = first.strip_suffix(b"OFF") else {
        return Err(tokens.unexpected(first, "the keyword OFF"));
    };
    if prefix.iter().any(|b| matches!(b, b'4' | b'n')) {
        return Err(file.unsupported("vertices that are not three-dimensional", "save it as plain OFF"));
    }
    if !prefix.iter().all(|b| b"STCN".contains(b)) {
        return Err(tokens.unexpected(first, "the keyword OFF"));
    }
    if tokens.peek().is_some_and(|next| next.eq_ignore_ascii_case(b"BINARY")) {
        return Err(file.unsupported("binary OFF data", "save it as OFF in text, or as PLY"));
    }
    Ok(())
}

/// The count of edges may be missing or stand alone on the next line.
fn skip_count_of_edges(tokens: &mut Tokens) {
    let counts_end_line = tokens.line().trim_ascii().is_empty();
    tokens.peek();
    let rest = tokens.rest();
    let next_line = rest.split(|&b| b == b'\n').next().unwrap_or_default();
    if counts_end_line && parsed::<u64>(next_line.trim_ascii()).is_some() {
        tokens.line();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Point,
        io::{
            Place,
            testing::{place_of, surface},
        },
    };

    #[test]
    fn counts_comments_and_extra_values_may_stand_anywhere() {
        let plain = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        let expected = surface("off", plain.as_bytes()).unwrap();
        for text in [
            "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2",
            "# made by hand\nOFF # really\n\n3 1 0\n0 0 0 # first\n1 0 0\n\n0 1 0\n3 0 1 2\n",
            "OFF\n3 1\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            "OFF\n3\n1\n0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            "3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 255 0 0 255\n0 1 0 1 1 1\n3 0 1 2 0.5 0.5 0.5\n",
            "NOFF\r\n3 1 0\r\n0 0 0 0 0 1\r\n1 0 0 0 0 1\r\n0 1 0 0 0 1\r\n3 0 1 2\r\n",
            "STCNOFF\n3 1 0\n0\n0\n0\n1 0 0\n0 1 0\n3\n0 1\n2\n",
        ] {
            assert_eq!(surface("off", text.as_bytes()).unwrap(), expected, "{text}");
        }
    }

    #[test]
    fn polygons_are_fanned_and_unusual_numbers_kept() {
        let mesh = surface("off", b"OFF\n5 1 0\nnan 0 0\n1 0 0\n1 1 0\n0 inf 0\n7 7 7\n4 1 2 3 0\n").unwrap();
        assert_eq!(mesh.triangles(), [[1, 2, 3], [1, 3, 0]]);
        assert!(mesh.vertices()[0].x.is_nan() && mesh.vertices()[3].y.is_infinite());
        assert_eq!(mesh.vertices()[4], Point::new(7., 7., 7.));
    }

    #[test]
    fn faults_are_named() {
        let read = |text: &str| surface("off", text.as_bytes());
        assert_eq!(place_of(read("PLY\n3 1 0\n")), Place::Line(1));
        assert_eq!(
            place_of(read("OFF\n3 1 0\n0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n")),
            Place::Line(4)
        );
        assert_eq!(place_of(read("OFF\n-3 1 0\n0 0 0\n")), Place::Line(2));
        assert!(matches!(
            read("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0"),
            Err(IoError::Truncated { .. })
        ));
        assert!(matches!(
            read("OFF\n3 1 0\n0 0 0\n"),
            Err(IoError::CountExceedsFile { count: 3, .. })
        ));
        let absurd = read("OFF\n3 99999999999 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
        assert!(matches!(
            absurd,
            Err(IoError::CountExceedsFile {
                count: 99_999_999_999,
                ..
            })
        ));
        let missing = read("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n");
        assert!(matches!(
            missing,
            Err(IoError::IndexOutOfRange {
                index: 0,
                vertex: 3,
                base: 0,
                ..
            })
        ));
        let two = read("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n");
        assert!(matches!(
            two,
            Err(IoError::FewCorners {
                face: 0,
                corners: 2,
                ..
            })
        ));
        assert!(matches!(
            read("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"),
            Err(IoError::NoGeometry { .. })
        ));
        assert!(matches!(
            read("4OFF\n1 0 0\n0 0 0 1\n"),
            Err(IoError::Unsupported { .. })
        ));
        assert!(matches!(read("OFF BINARY\n"), Err(IoError::Unsupported { .. })));
    }
}
