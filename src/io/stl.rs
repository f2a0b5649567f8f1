//! STL, in text and binary.
//!
//! Our own code: `stl_io` rounds text to single precision, takes a binary file that begins with `solid` for text, and
//! its errors have no positions.

use std::collections::HashMap;
use std::io::{self, Write};

use super::{
    IoError,
    input::{ByteOrder, InputFile, Scalar, Tokens},
    raw_mesh::RawMesh,
};
use crate::Point;
use crate::mesh::SurfaceMesh;

/// Bytes of the header and of a facet in a binary file.
const HEADER: usize = 80;
const FACET: usize = 50;

/// The facets of all solids in the file as one mesh. STL has no vertices: corners with equal coordinates become one
/// vertex, in order of first appearance. Normals and attributes are skipped.
pub(super) fn parse(file: &InputFile) -> Result<RawMesh, IoError> {
    if is_text(file.bytes) {
        parse_text(file)
    } else {
        parse_binary(file)
    }
}

/// Whether the bytes are STL in text. Many binary files begin with `solid` too: they are recognised by a length that
/// matches the binary count, or no facet after the first line.
fn is_text(bytes: &[u8]) -> bool {
    if binary_count(bytes).is_some_and(|n| bytes.len() as u64 == (HEADER + 4) as u64 + n * FACET as u64) {
        return false;
    }
    let bytes = bytes.trim_ascii_start();
    let starts_with = |bytes: &[u8], word: &[u8]| {
        let head = &bytes[..bytes.len().min(word.len())];
        head.eq_ignore_ascii_case(&word[..head.len()])
    };
    if bytes.is_empty() || !starts_with(bytes, b"solid") {
        return false;
    }
    let end = bytes.iter().position(|&b| b == b'\n').unwrap_or(bytes.len());
    let body = bytes[end..].trim_ascii_start();
    starts_with(body, b"facet") || starts_with(body, b"endsolid")
}

fn binary_count(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER..HEADER + 4)?;
    Some(Scalar::U32.integer(count, ByteOrder::Little) as u64)
}

fn parse_binary(file: &InputFile) -> Result<RawMesh, IoError> {
    let Some(count) = binary_count(file.bytes) else {
        if file.bytes.iter().all(|b| b.is_ascii() && *b != 0) {
            return Err(file.tokens().unexpected(file.bytes, "`solid`"));
        }
        return Err(file.truncated("the binary header"));
    };
    let facets = &file.bytes[HEADER + 4..];
    let count = file.checked_count(count, "triangles", FACET, facets.len())?;
    let mut corners = CornerMerger::default();
    for facet in facets.chunks_exact(FACET).take(count) {
        let coordinate = |k: usize| Scalar::F32.float(&facet[12 + 4 * k..], ByteOrder::Little);
        let triangle = [0, 3, 6].map(|k| Point::new(coordinate(k), coordinate(k + 1), coordinate(k + 2)));
        corners.add_face(&triangle);
    }
    Ok(corners.raw)
}

fn parse_text(file: &InputFile) -> Result<RawMesh, IoError> {
    let mut tokens = file.tokens();
    let mut corners = CornerMerger::default();
    let mut inside = false;
    loop {
        // The file may end between solids; a solid without its end was truncated.
        if !inside && tokens.peek().is_none() {
            return Ok(corners.raw);
        }
        let word = tokens.word("a solid without `endsolid`")?.to_ascii_lowercase();
        match (inside, word.as_str()) {
            (false, "solid") | (true, "endsolid") => {
                tokens.line();
                inside = !inside;
            }
            (true, "facet") => corners.add_face(&facet(&mut tokens)?),
            _ => {
                let wanted = if inside { "`facet` or `endsolid`" } else { "`solid`" };
                return Err(tokens.unexpected(word.as_bytes(), wanted));
            }
        }
    }
}

/// The corners of a facet, from its normal to `endfacet`.
fn facet(tokens: &mut Tokens) -> Result<Vec<Point>, IoError> {
    expect(tokens, "normal")?;
    // Not parsed as numbers: degenerate facets may have normals such as `-1.#IND`.
    (0..3).try_for_each(|_| tokens.word("a normal").map(drop))?;
    expect(tokens, "outer")?;
    expect(tokens, "loop")?;
    let mut corners = Vec::with_capacity(3);
    loop {
        let word = tokens.word("a facet")?;
        if word.eq_ignore_ascii_case("endloop") {
            break;
        }
        if !word.eq_ignore_ascii_case("vertex") {
            return Err(tokens.unexpected(word.as_bytes(), "`vertex` or `endloop`"));
        }
        corners.push(tokens.point()?);
    }
    expect(tokens, "endfacet")?;
    Ok(corners)
}

fn expect(tokens: &mut Tokens, wanted: &str) -> Result<(), IoError> {
    let word = tokens.word("a facet")?;
    if word.eq_ignore_ascii_case(wanted) {
        return Ok(());
    }
    Err(tokens.unexpected(word.as_bytes(), &format!("`{wanted}`")))
}

/// Merges corners with equal positions.
#[derive(Default)]
struct CornerMerger {
    raw: RawMesh,
    indices: HashMap<[u64; 3], i64>,
}

impl CornerMerger {
    fn add_face(&mut self, corners: &[Point]) {
        let RawMesh { vertices, polygons, .. } = &mut self.raw;
        polygons.push(corners.iter().map(|p| {
            // Adding zero makes -0 equal to 0.
            let key = [p.x, p.y, p.z].map(|x| (x + 0.0).to_bits());
            *self.indices.entry(key).or_insert_with(|| {
                vertices.push(*p);
                vertices.len() as i64 - 1
            })
        }));
    }
}

/// Writes binary STL, with the triangles' normals.
pub(super) fn write(writer: &mut dyn Write, mesh: &SurfaceMesh) -> io::Result<()> {
    let mut header = [b' '; HEADER];
    // Not `solid`, with which text begins.
    let title = b"binary STL, little-endian";
    header[..title.len()].copy_from_slice(title);
    writer.write_all(&header)?;
    let count = u32::try_from(mesh.triangles().len())
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "STL counts triangles with 32 bits"))?;
    writer.write_all(&count.to_le_bytes())?;
    let mut facet = Vec::with_capacity(FACET);
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let area = mesh.area_vector(t);
        // A triangle without area has no normal: zeros, which readers take for "unknown".
        let normal = area
            .try_normalize(0.0)
            .filter(|normal| normal.iter().all(|c| c.is_finite()));
        facet.clear();
        let normal = normal.unwrap_or_default();
        facet.extend(normal.iter().flat_map(|&c| (c as f32).to_le_bytes()));
        for &v in corners {
            for &exact in mesh.vertices()[v as usize].iter() {
                let single = exact as f32;
                if exact.is_finite() && single.is_infinite() {
                    let message = format!("vertex {v} has the coordinate {exact}, too large for single precision");
                    return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
                }
                facet.extend(single.to_le_bytes());
            }
        }
        facet.extend([0; 2]);
        writer.write_all(&facet)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        io::{
            Place,
            testing::{place_of, surface},
        },
        mesh::shapes,
    };

    fn binary(header: &str, triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
        let mut bytes = header.as_bytes().to_vec();
        bytes.resize(HEADER, b' ');
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for triangle in triangles {
            bytes.extend([0; 12]);
            bytes.extend(triangle.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    const TWO: [[[f32; 3]; 3]; 2] = [
        [[1., 0., 0.], [0., 1., 0.], [0., 0., 0.]],
        [[0., 1., 0.], [1., 0., 0.], [1., 1., 0.]],
    ];

    const TEXT: &str = "solid two words\n facet normal 0 0 1\n  outer loop\n   vertex 1 0 0\n   vertex 0 1 0\n   \
                        vertex 0 -0 0\n  endloop\n endfacet\nendsolid two words\nsolid b\nFACET NORMAL -1.#IND 0 0\n \
                        OUTER LOOP VERTEX 0 1 0 VERTEX 1 0 0 VERTEX 1 1 0 ENDLOOP ENDFACET ENDSOLID\n";

    #[test]
    fn equal_corners_become_one_vertex_in_order_of_appearance() {
        for bytes in [
            binary("made by hand", &TWO),
            binary("solid at the head of a binary file", &TWO),
            TEXT.as_bytes().to_vec(),
        ] {
            let mesh = surface("stl", &bytes).unwrap();
            let expected = [[1., 0., 0.], [0., 1., 0.], [0., 0., 0.], [1., 1., 0.]].map(Point::from);
            assert_eq!(mesh.vertices(), expected);
            assert_eq!(mesh.triangles(), [[0, 1, 2], [1, 0, 3]]);
        }
    }

    #[test]
    fn a_closed_mesh_comes_back_closed() {
        let torus = shapes::torus(2.0, 0.5, 12, 8);
        let corners = |t| torus.corners(t).map(|p| [p.x as f32, p.y as f32, p.z as f32]);
        let triangles: Vec<_> = (0..torus.triangles().len()).map(corners).collect();
        let read = surface("stl", &binary("", &triangles)).unwrap();
        assert_eq!(read.vertices().len(), torus.vertices().len());
        // Single precision moves each coordinate by 3e-8 of itself.
        assert!((read.volume() / torus.volume() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn trailing_bytes_of_a_binary_file_are_passed_over() {
        let mut bytes = binary("", &TWO);
        bytes.extend([7; 33]);
        assert_eq!(surface("stl", &bytes).unwrap().triangles().len(), 2);
    }

    #[test]
    fn text_keeps_double_precision_and_unusual_numbers() {
        let text = "solid\nfacet normal 0 0 1\nouter loop\nvertex 0.1 nan 0\nvertex inf 1 0\nvertex 0 0 1\nendloop\n\
                    endfacet\nendsolid\n";
        let mesh = surface("stl", text.as_bytes()).unwrap();
        assert!(mesh.vertices()[0].x == 0.1 && mesh.vertices()[0].y.is_nan() && mesh.vertices()[1].x.is_infinite());
    }

    #[test]
    fn faults_are_named() {
        let read = |text: &str| surface("stl", text.as_bytes());
        assert_eq!(place_of(read(&TEXT.replacen("vertex", "vertx", 1))), Place::Line(4));
        assert_eq!(
            place_of(read(&TEXT.replacen("vertex 1 0", "vertex 1 O", 1))),
            Place::Line(4)
        );
        assert_eq!(place_of(read("hello world")), Place::Line(1));
        assert!(matches!(
            read("solid a\nfacet normal 0 0 1\nouter loop"),
            Err(IoError::Truncated { .. })
        ));
        let unended = TEXT.replace("ENDSOLID", "");
        assert!(matches!(read(&unended), Err(IoError::Truncated { .. })));
        let two = TEXT.replacen("vertex 1 0 0", "", 1);
        assert!(matches!(
            read(&two),
            Err(IoError::FewCorners {
                face: 0,
                corners: 2,
                ..
            })
        ));
        assert!(matches!(read("solid a\nendsolid a\n"), Err(IoError::NoGeometry { .. })));

        let whole = binary("", &TWO);
        assert!(matches!(
            surface("stl", &whole[..70]),
            Err(IoError::Truncated { .. } | IoError::Malformed { .. })
        ));
        assert!(matches!(
            surface("stl", &whole[..150]),
            Err(IoError::CountExceedsFile { count: 2, .. })
        ));
        let mut absurd = whole.clone();
        absurd[HEADER..HEADER + 4].fill(0xff);
        assert!(matches!(
            surface("stl", &absurd),
            Err(IoError::CountExceedsFile { count: 0xffff_ffff, .. })
        ));
    }

    #[test]
    fn a_written_surface_has_the_same_triangles_in_single_precision() {
        let mesh = crate::mesh::shapes::bumpy_sphere(4);
        let mut bytes = Vec::new();
        write(&mut bytes, &mesh).unwrap();
        assert_eq!(bytes.len(), HEADER + 4 + FACET * mesh.triangles().len());
        let read = super::super::testing::surface("stl", &bytes).unwrap();
        assert_eq!(read.triangles().len(), mesh.triangles().len());
        for (t, (a, b)) in mesh.triangles().iter().zip(read.triangles()).enumerate() {
            for (&v, &w) in a.iter().zip(b) {
                let (exact, single) = (mesh.vertices()[v as usize], read.vertices()[w as usize]);
                assert!((exact - single).norm() <= 1e-7 * exact.coords.norm(), "triangle {t}");
            }
            let normal =
                |k: usize| f32::from_le_bytes(bytes[HEADER + 4 + FACET * t + 4 * k..][..4].try_into().unwrap());
            let expected = mesh.area_vector(t).normalize();
            assert!(
                (0..3).all(|k| (f64::from(normal(k)) - expected[k]).abs() < 1e-6),
                "triangle {t}"
            );
        }
        let far = crate::mesh::shapes::deformed(&mesh, |p| p * 1e300);
        assert!(
            write(&mut Vec::new(), &far)
                .unwrap_err()
                .to_string()
                .contains("single precision")
        );
    }
}
