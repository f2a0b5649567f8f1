//! Medit (INRIA) `.mesh`, in text.

use std::io::{self, Write};

use super::{
    CellGroup, Cells, IoError,
    input::{InputFile, TEXT_NUMBER, Tokens, parsed},
    raw_mesh::RawMesh,
};
use crate::Point;

/// Vertices, triangles, quadrilaterals, tetrahedra and hexahedra in file order, with the references (labels) of cells;
/// all other sections are skipped.
pub(super) fn parse(file: &InputFile) -> Result<RawMesh, IoError> {
    let mut tokens = file.tokens().without_comments();
    if tokens.word("the keyword MeshVersionFormatted")? != "MeshVersionFormatted" {
        return Err(tokens.malformed("the first word is not MeshVersionFormatted"));
    }
    tokens.integer("the version")?;

    let mut raw = RawMesh {
        base: 1,
        ..RawMesh::default()
    };
    while let Some(keyword) = tokens.next() {
        match keyword {
            b"Dimension" => {
                let dimension = tokens.integer("the dimension")?;
                if dimension != 3 {
                    return Err(file.unsupported(format!("a mesh of dimension {dimension}"), "save it with three"));
                }
            }
            b"Vertices" => {
                let count = tokens.count("vertices", 4 * TEXT_NUMBER)?;
                raw.vertices.reserve(count);
                for _ in 0..count {
                    raw.vertices.push(tokens.point()?);
                    tokens.float("the reference of a vertex")?;
                }
            }
            b"Triangles" => read_section(&mut tokens, "triangles", |t: [i64; 3], _| raw.polygons.push(t))?,
            b"Quadrilaterals" => read_section(&mut tokens, "quadrilaterals", |q: [i64; 4], _| raw.polygons.push(q))?,
            b"Tetrahedra" => read_labelled(&mut tokens, "tetrahedra", &mut raw.tets, &mut raw.labels[0])?,
            b"Hexahedra" => read_labelled(&mut tokens, "hexahedra", &mut raw.hexes, &mut raw.labels[1])?,
            b"Prisms" => skip_other_cells(&mut tokens, "prisms", &mut raw)?,
            b"Pyramids" => skip_other_cells(&mut tokens, "pyramids", &mut raw)?,
            b"End" => break,
            _ if is_keyword(keyword) => skip_section(&mut tokens),
            _ => return Err(tokens.unexpected(keyword, "a keyword")),
        }
    }
    Ok(raw)
}

/// Writes vertices with reference 0, and cells with their labels as references; coordinates read back to the same bits.
pub(super) fn write(writer: &mut dyn Write, points: &[Point], groups: &[CellGroup], comment: &str) -> io::Result<()> {
    writeln!(writer, "MeshVersionFormatted 2\nDimension 3")?;
    for line in comment.lines() {
        writeln!(writer, "# {}", line.replace(char::is_control, " "))?;
    }
    writeln!(writer, "Vertices\n{}", points.len())?;
    for p in points {
        writeln!(writer, "{:?} {:?} {:?} 0", p.x, p.y, p.z)?;
    }
    for group in groups {
        let section = match group.cells {
            Cells::Triangles(_) => "Triangles",
            Cells::Quads(_) => "Quadrilaterals",
            Cells::Tets(_) => "Tetrahedra",
            Cells::Hexes(_) => "Hexahedra",
        };
        writeln!(writer, "{section}\n{}", group.cells.count())?;
        for (cell, label) in group.cells.iter().zip(group.labels) {
            for &v in cell {
                write!(writer, "{} ", u64::from(v) + 1)?;
            }
            writeln!(writer, "{label}")?;
        }
    }
    writeln!(writer, "End")
}

/// Reads a section of elements with `N` corners and a reference.
fn read_section<const N: usize>(
    tokens: &mut Tokens,
    element: &str,
    mut add: impl FnMut([i64; N], f64),
) -> Result<(), IoError> {
    for _ in 0..tokens.count(element, (N + 1) * TEXT_NUMBER)? {
        let mut corners = [0; N];
        for corner in &mut corners {
            *corner = tokens.integer(element)?.saturating_sub(1);
        }
        let reference = tokens.float(element)?;
        add(corners, reference);
    }
    Ok(())
}

/// Reads cells and their references; one that is not an integer becomes `i64::MAX`, which no region may be.
fn read_labelled<const N: usize>(
    tokens: &mut Tokens,
    element: &str,
    cells: &mut Vec<[i64; N]>,
    labels: &mut Vec<i64>,
) -> Result<(), IoError> {
    read_section(tokens, element, |corners, reference| {
        cells.push(corners);
        labels.push(if reference.fract() == 0.0 {
            reference as i64
        } else {
            i64::MAX
        });
    })
}

fn skip_other_cells(tokens: &mut Tokens, kind: &str, raw: &mut RawMesh) -> Result<(), IoError> {
    let count = tokens.count(kind, TEXT_NUMBER)?;
    if count > 0 {
        raw.add_other_cells(kind, count);
    }
    skip_section(tokens);
    Ok(())
}

/// Skips to the next keyword.
fn skip_section(tokens: &mut Tokens) {
    while tokens.peek().is_some_and(|token| !is_keyword(token)) {
        tokens.next();
    }
}

/// Keywords are words; `nan` and `inf` are numbers.
fn is_keyword(token: &[u8]) -> bool {
    token[0].is_ascii_alphabetic() && parsed::<f64>(token).is_none()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{
        Place, SolidMesh,
        testing::{cells, place_of, solid, surface, tets},
    };
    use crate::mesh::CellList;

    const TETS: &str = "MeshVersionFormatted 2\n# a comment\nDimension\n3\nVertices\n5\n0 0 0 1\n1 0 0 1\n0 1 0 2\n\
                        0 0 1 0\nnan inf 1 0\nCorners 2\n1\n2\nNormals 1\n0 NaN inf\nTriangles\n1\n1 2 3 7\n\
                        Tetrahedra 2\n1 2 3 4 0\n2 1 3 4 9\nEnd\ngarbage\n";

    #[test]
    fn tets_of_both_orientations_are_read_as_they_are() {
        let mesh = tets("mesh", TETS.as_bytes()).unwrap();
        assert_eq!(mesh.tets(), [[0, 1, 2, 3], [1, 0, 2, 3]]);
        assert_eq!(mesh.vertices().len(), 5);
        assert!(mesh.vertices()[4].x.is_nan() && mesh.vertices()[4].y.is_infinite());
        assert!(matches!(solid("mesh", TETS.as_bytes()), Ok(SolidMesh::Cells(_))));
        assert!(matches!(
            surface("mesh", TETS.as_bytes()),
            Err(IoError::WrongKind { .. })
        ));
    }

    #[test]
    fn faces_alone_are_a_surface() {
        let text = TETS.split("Tetrahedra").next().unwrap().to_owned() + "Quadrilaterals\n1\n1 2 3 4 0\n";
        let mesh = surface("mesh", text.as_bytes()).unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
        assert!(matches!(solid("mesh", text.as_bytes()), Ok(SolidMesh::Surface(_))));
        assert!(matches!(tets("mesh", text.as_bytes()), Err(IoError::WrongKind { .. })));
    }

    #[test]
    fn other_cells_are_refused_by_name() {
        let text = TETS.replace("Tetrahedra 2\n1 2 3 4 0\n2 1 3 4 9", "Hexahedra\n1\n1 2 3 4 1 2 3 4 5");
        for message in [
            tets("mesh", text.as_bytes()).map(drop),
            surface("mesh", text.as_bytes()).map(drop),
        ] {
            let message = message.unwrap_err().to_string();
            assert!(message.contains("1 hexahedra"), "{message}");
        }
        let read = cells("mesh", text.as_bytes()).unwrap();
        assert_eq!(*read.cells(), CellList::Hexes(vec![[0, 1, 2, 3, 0, 1, 2, 3]]));
        assert_eq!(read.regions(), [5]);
        assert_eq!(cells("mesh", TETS.as_bytes()).unwrap().regions(), [0, 9]);
        for reference in ["4294967295", "7.5", "nan"] {
            let text = TETS.replace("2 1 3 4 9", &format!("2 1 3 4 {reference}"));
            assert!(tets("mesh", text.as_bytes()).is_ok());
            let refused = cells("mesh", text.as_bytes());
            assert!(
                matches!(refused, Err(IoError::Unsupported { .. })),
                "{reference}: {refused:?}"
            );
        }
        let text = TETS.replace("End", "Prisms 1\n1 2 3 1 2 3 0\nEnd");
        assert!(matches!(
            tets("mesh", text.as_bytes()),
            Err(IoError::Unsupported { .. })
        ));
        let none = TETS.replace("End", "Hexahedra 0\nEnd");
        assert_eq!(tets("mesh", none.as_bytes()).unwrap().tets().len(), 2);
    }

    #[test]
    fn faults_are_named() {
        let read = |from: &str, to: &str| {
            assert!(TETS.contains(from));
            solid("mesh", TETS.replace(from, to).as_bytes()).map(drop)
        };
        assert_eq!(place_of(read("MeshVersionFormatted", "Mesh")), Place::Line(1));
        assert_eq!(place_of(read("1 0 0 1\n", "1 ? 0 1\n")), Place::Line(8));
        assert_eq!(place_of(read("2 1 3 4 9\n", "2 1 3 4 9 9\n")), Place::Line(22));
        assert!(matches!(
            read("Dimension\n3", "Dimension 2"),
            Err(IoError::Unsupported { .. })
        ));
        assert!(matches!(
            read("2 1 3 4 9\nEnd\ngarbage\n", "2 1 3"),
            Err(IoError::Truncated { .. } | IoError::CountExceedsFile { .. })
        ));
        assert!(matches!(
            read("Tetrahedra 2", "Tetrahedra 20000000000"),
            Err(IoError::CountExceedsFile { .. })
        ));
        let missing = read("2 1 3 4 9", "2 1 3 6 9");
        let expected =
            "tetrahedron 1 (0-based) of `a.mesh` refers to vertex 6, but there are 5 vertices, counted from 1";
        assert_eq!(missing.unwrap_err().to_string(), expected);
        assert!(matches!(
            read("2 1 3 4 9", "2 1 3 0 9"),
            Err(IoError::IndexOutOfRange { vertex: 0, .. })
        ));
        let cloud = TETS.split("Triangles").next().unwrap();
        assert!(matches!(
            solid("mesh", cloud.as_bytes()),
            Err(IoError::NoGeometry { .. })
        ));
    }
}
