//! STL, in text and binary.
//!
//! Own code: `stl_io` rounds text to single precision, takes a binary file that begins with `solid` for text, and its
//! errors name no place.

use std::collections::HashMap;

use super::{
    IoError, Place,
    contents::Contents,
    source::{ByteOrder, Scalar, Source, Tokens, excerpt},
};
use crate::Point;

const HEADER: usize = 80;
const FACET: usize = 50;

/// The facets of all solids in the file as one mesh. STL knows no vertices: corners with equal coordinates become one
/// vertex, in order of first appearance. Normals and attributes are passed over.
pub(super) fn parse(source: &Source) -> Result<Contents, IoError> {
    if is_text(source.bytes) {
        parse_text(source)
    } else {
        parse_binary(source)
    }
}

/// Whether the bytes are STL in text. Many binary files begin with `solid` too: a length that fits the binary count
/// exactly, or no facet after the first line, gives them away.
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

fn parse_binary(source: &Source) -> Result<Contents, IoError> {
    let Some(count) = binary_count(source.bytes) else {
        if source.bytes.iter().all(|b| b.is_ascii() && *b != 0) {
            let found = excerpt(source.bytes);
            return Err(source.malformed_at(Place::Line(1), format!("found `{found}` where `solid` was expected")));
        }
        return Err(source.truncated("the binary header"));
    };
    let facets = &source.bytes[HEADER + 4..];
    let count = source.checked_count(count, "triangles", FACET, facets.len())?;
    let mut corners = Corners::default();
    for facet in facets.chunks_exact(FACET).take(count) {
        let coordinate = |k: usize| Scalar::F32.float(&facet[12 + 4 * k..], ByteOrder::Little);
        let triangle = [0, 3, 6].map(|k| Point::new(coordinate(k), coordinate(k + 1), coordinate(k + 2)));
        corners.add_face(&triangle);
    }
    Ok(corners.contents)
}

fn parse_text(source: &Source) -> Result<Contents, IoError> {
    let mut tokens = source.tokens();
    let mut corners = Corners::default();
    let mut inside = false;
    loop {
        // Between solids the file may end; a solid without its end was cut off.
        if !inside && tokens.peek().is_none() {
            return Ok(corners.contents);
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
                return Err(tokens.malformed(format!(
                    "found `{}` where {wanted} was expected",
                    excerpt(word.as_bytes())
                )));
            }
        }
    }
}

/// The corners of a facet, from its normal to `endfacet`.
fn facet(tokens: &mut Tokens) -> Result<Vec<Point>, IoError> {
    expect(tokens, "normal")?;
    // Not read as numbers: degenerate facets come with normals such as `-1.#IND`.
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
            let found = excerpt(word.as_bytes());
            return Err(tokens.malformed(format!("found `{found}` where `vertex` or `endloop` was expected")));
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
    let found = excerpt(word.as_bytes());
    Err(tokens.malformed(format!("found `{found}` where `{wanted}` was expected")))
}

/// Gathers faces by the positions of their corners.
#[derive(Default)]
struct Corners {
    contents: Contents,
    known: HashMap<[u64; 3], i64>,
}

impl Corners {
    fn add_face(&mut self, corners: &[Point]) {
        let Contents { vertices, polygons, .. } = &mut self.contents;
        polygons.push(corners.iter().map(|p| {
            // Adding zero makes -0 equal to 0.
            let key = [p.x, p.y, p.z].map(|x| (x + 0.0).to_bits());
            *self.known.entry(key).or_insert_with(|| {
                vertices.push(*p);
                vertices.len() as i64 - 1
            })
        }));
    }
}
