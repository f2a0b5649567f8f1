//! Geomview's Object File Format, in text: `OFF`, `COFF`, `NOFF`, `STOFF` and their combinations.

use std::io::{self, Write};

use super::{
    IoError,
    contents::Contents,
    source::{Source, TEXT_NUMBER, Tokens, excerpt, parsed},
};
use crate::mesh::SurfaceMesh;

/// Vertices and faces in file order. Colours, normals and texture coordinates, which follow the coordinates on the
/// line of their vertex or the corners on that of their face, are passed over.
pub(super) fn parse(source: &Source) -> Result<Contents, IoError> {
    let mut tokens = source.tokens().without_comments();
    skip_keyword(source, &mut tokens)?;

    let vertices = tokens.count("vertices", 3 * TEXT_NUMBER)?;
    let faces = tokens.count("faces", TEXT_NUMBER)?;
    skip_count_of_edges(&mut tokens);
    let mut contents = Contents {
        vertices: Vec::with_capacity(vertices),
        ..Contents::default()
    };
    for _ in 0..vertices {
        contents.vertices.push(tokens.point()?);
        tokens.line();
    }
    let mut polygon = Vec::new();
    for _ in 0..faces {
        let corners = tokens.count("corners of a face", TEXT_NUMBER)?;
        polygon.clear();
        for _ in 0..corners {
            polygon.push(tokens.integer("the corners of a face")?);
        }
        tokens.line();
        contents.polygons.push(polygon.iter().copied());
    }
    Ok(contents)
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

/// Reads the keyword, which the format allows to be left out.
fn skip_keyword(source: &Source, tokens: &mut Tokens) -> Result<(), IoError> {
    let Some(first) = tokens.peek() else {
        return Err(source.truncated("the keyword OFF"));
    };
    if parsed::<u64>(first).is_some() {
        return Ok(());
    }
    tokens.next();
    let Some(prefix) = first.strip_suffix(b"OFF") else {
        return Err(tokens.malformed(format!("found `{}` where the keyword OFF was expected", excerpt(first))));
    };
    if prefix.iter().any(|b| matches!(b, b'4' | b'n')) {
        return Err(source.unsupported("vertices that are not three-dimensional", "save it as plain OFF"));
    }
    if !prefix.iter().all(|b| b"STCN".contains(b)) {
        return Err(tokens.malformed(format!("found `{}` where the keyword OFF was expected", excerpt(first))));
    }
    if tokens.peek().is_some_and(|next| next.eq_ignore_ascii_case(b"BINARY")) {
        return Err(source.unsupported("binary OFF data", "save it as OFF in text, or as PLY"));
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
