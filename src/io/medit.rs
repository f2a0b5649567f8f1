//! Medit (INRIA) `.mesh`, in text.

use std::io::{self, Write};

use super::{
    Cells, IoError,
    contents::Contents,
    source::{Source, TEXT_NUMBER, Tokens, excerpt, parsed},
};
use crate::Point;

/// Vertices, triangles, quadrilaterals and tetrahedra in file order; references (labels) and all other sections are
/// passed over.
pub(super) fn parse(source: &Source) -> Result<Contents, IoError> {
    let mut tokens = source.tokens().without_comments();
    if tokens.word("the keyword MeshVersionFormatted")? != "MeshVersionFormatted" {
        return Err(tokens.malformed("the first word is not MeshVersionFormatted"));
    }
    tokens.integer("the version")?;

    let mut contents = Contents {
        base: 1,
        ..Contents::default()
    };
    while let Some(keyword) = tokens.next() {
        match keyword {
            b"Dimension" => {
                let dimension = tokens.integer("the dimension")?;
                if dimension != 3 {
                    return Err(source.unsupported(format!("a mesh of dimension {dimension}"), "save it with three"));
                }
            }
            b"Vertices" => {
                let count = tokens.count("vertices", 4 * TEXT_NUMBER)?;
                contents.vertices.reserve(count);
                for _ in 0..count {
                    contents.vertices.push(tokens.point()?);
                    tokens.float("the reference of a vertex")?;
                }
            }
            b"Triangles" => each(&mut tokens, "triangles", |t: [i64; 3]| contents.polygons.push(t))?,
            b"Quadrilaterals" => each(&mut tokens, "quadrilaterals", |q: [i64; 4]| contents.polygons.push(q))?,
            b"Tetrahedra" => each(&mut tokens, "tetrahedra", |t| contents.tets.push(t))?,
            b"Hexahedra" => other_cells(&mut tokens, "hexahedra", &mut contents)?,
            b"Prisms" => other_cells(&mut tokens, "prisms", &mut contents)?,
            b"Pyramids" => other_cells(&mut tokens, "pyramids", &mut contents)?,
            b"End" => break,
            _ if is_keyword(keyword) => skip_section(&mut tokens),
            _ => {
                let found = excerpt(keyword);
                return Err(tokens.malformed(format!("found `{found}` where a keyword was expected")));
            }
        }
    }
    Ok(contents)
}

/// Writes vertices and cells with reference 0; coordinates read back to the same bits.
pub(super) fn write(writer: &mut dyn Write, points: &[Point], cells: Cells) -> io::Result<()> {
    writeln!(
        writer,
        "MeshVersionFormatted 2\nDimension 3\nVertices\n{}",
        points.len()
    )?;
    for p in points {
        writeln!(writer, "{:?} {:?} {:?} 0", p.x, p.y, p.z)?;
    }
    let section = match cells {
        Cells::Triangles(_) => "Triangles",
        Cells::Tets(_) => "Tetrahedra",
        Cells::Hexes(_) => "Hexahedra",
    };
    writeln!(writer, "{section}\n{}", cells.count())?;
    for cell in cells.iter() {
        for &v in cell {
            write!(writer, "{} ", u64::from(v) + 1)?;
        }
        writeln!(writer, "0")?;
    }
    writeln!(writer, "End")
}

/// Reads a section of elements with `N` corners and a reference.
fn each<const N: usize>(tokens: &mut Tokens, element: &str, mut add: impl FnMut([i64; N])) -> Result<(), IoError> {
    for _ in 0..tokens.count(element, (N + 1) * TEXT_NUMBER)? {
        let mut corners = [0; N];
        for corner in &mut corners {
            *corner = tokens.integer(element)?.saturating_sub(1);
        }
        tokens.float(element)?;
        add(corners);
    }
    Ok(())
}

fn other_cells(tokens: &mut Tokens, kind: &str, contents: &mut Contents) -> Result<(), IoError> {
    let count = tokens.count(kind, TEXT_NUMBER)?;
    if count > 0 {
        contents.add_other_cells(kind, count);
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
