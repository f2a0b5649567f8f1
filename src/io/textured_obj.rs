//! Texture coordinates and vertex colours of OBJ files.

use std::path::Path;

use super::input::{InputFile, excerpt, parsed};
use super::obj;
use super::raw_mesh::PolygonCuts;
use super::{IoError, read_bytes, read_mesh, read_surface};
use crate::mesh::SurfaceMesh;

/// A surface with texture coordinates and colours.
#[derive(Debug, Clone, PartialEq)]
pub struct TexturedSurface {
    /// The surface, as [`read_surface`] reads it.
    pub surface: SurfaceMesh,
    /// Texture coordinates of the corners of each triangle; a vertex on a seam has several. `None` when the file has
    /// none.
    pub uv: Option<Vec<[[f64; 2]; 3]>>,
    /// Red, green and blue of each vertex as the file has them, usually sRGB from 0 to 1. `None` when it has none.
    pub colours: Option<Vec<[f64; 3]>>,
}

/// Reads an OBJ file with the texture coordinates of its faces (`f v/vt`) and the colours of its vertices
/// (`v x y z r g b`). Material files are skipped. Files of other formats are read as
/// [`read_surface`] does, without colours.
///
/// # Errors
///
/// As [`read_surface`]; [`IoError::Malformed`] when some faces have texture coordinates or some vertices have colours,
/// and others not.
pub fn read_textured_surface(path: impl AsRef<Path>) -> Result<TexturedSurface, IoError> {
    let path = path.as_ref();
    if super::extension(path) != "obj" {
        return Ok(TexturedSurface {
            surface: read_surface(path)?,
            uv: None,
            colours: None,
        });
    }
    let bytes = read_bytes(path)?;
    let file = InputFile {
        path,
        format: "OBJ",
        bytes: &bytes,
    };
    let raw = read_mesh(path, "a surface")?;
    let cuts = raw.cuts_by_shape();
    Ok(TexturedSurface {
        surface: raw.into_surface_cut(path, &cuts)?,
        uv: uv_of_corners(&file, &cuts)?,
        colours: colours(&file)?,
    })
}

/// Reads the faces with texture coordinates as vertices, cut into the same triangles and checked in the same way.
fn uv_of_corners(file: &InputFile, cuts: &PolygonCuts) -> Result<Option<Vec<[[f64; 2]; 3]>>, IoError> {
    let Some(raw) = obj::parse_uv(file)? else {
        return Ok(None);
    };
    let layout = raw.into_surface_cut(file.path, cuts).map_err(for_texture_coordinates)?;
    let corners = (0..layout.triangles().len()).map(|t| layout.corners(t).map(|p| [p.x, p.y]));
    Ok(Some(corners.collect()))
}

/// The error, worded for texture coordinates.
fn for_texture_coordinates(mut error: IoError) -> IoError {
    if let IoError::IndexOutOfRange { element, .. } = &mut error {
        *element = "the texture (`vt`, not `v`) of face";
    }
    error
}

fn colours(file: &InputFile) -> Result<Option<Vec<[f64; 3]>>, IoError> {
    let mut colours = Vec::new();
    let mut vertices = 0;
    for (statement, offset) in obj::statements(file.bytes) {
        let code = statement.split(|&b| b == b'#').next().unwrap_or_default();
        let mut words = code.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        if words.next() != Some(b"v") {
            continue;
        }
        vertices += 1;
        let words: Vec<&[u8]> = words.skip(3).collect();
        // A single number is the weight of a rational curve's vertex.
        let [r, g, b, ..] = words[..] else { continue };
        let number = |word: &[u8]| {
            let found = || format!("found `{}`: a colour needs three numbers", excerpt(word));
            parsed::<f64>(word).ok_or_else(|| file.malformed(offset, found()))
        };
        colours.push([number(r)?, number(g)?, number(b)?]);
        if colours.len() < vertices {
            return Err(file.malformed(
                offset,
                "this vertex has a colour, but one before it has none; give it to all or none",
            ));
        }
    }
    if !colours.is_empty() && colours.len() < vertices {
        let coloured = colours.len();
        let found = format!("{coloured} of {vertices} vertices have a colour; give it to all or none");
        return Err(file.malformed(file.bytes.len(), found));
    }
    Ok((!colours.is_empty()).then_some(colours))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::io::Place;

    fn read(text: &str) -> Result<TexturedSurface, IoError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.obj");
        fs::write(&path, text).unwrap();
        read_textured_surface(path)
    }

    const FOUR: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";

    /// A quadrilateral is cut from its first corner; indices may count from the end; vertex 1 has two texture
    /// coordinates.
    #[test]
    fn every_corner_keeps_its_own_coordinates() {
        let text = format!(
            "{FOUR}vt 0.1 0.2\nvt 0.3 0.4 9\nvt 0.5\nf 1/1 2/2 3/3 4/-3/1\nvt 1.5 -2 # more\nf 3/4 2/4/7 1/2\n"
        );
        let read = read(&text).unwrap();
        assert_eq!(read.surface.triangles(), [[0, 1, 2], [0, 2, 3], [2, 1, 0]]);
        let [a, b, c, d] = [[0.1, 0.2], [0.3, 0.4], [0.5, 0.0], [1.5, -2.0]];
        assert_eq!(read.uv.unwrap(), [[a, b, c], [a, c, a], [d, d, b]]);
        assert_eq!(read.colours, None);
    }

    #[test]
    fn files_without_coordinates_have_none() {
        assert_eq!(read(&format!("{FOUR}f 1 2 3\n")).unwrap().uv, None);
        // Coordinates that no face uses.
        assert_eq!(read(&format!("{FOUR}vt 0 0\nf 1//1 2 3\n")).unwrap().uv, None);
    }

    #[test]
    fn missing_and_partial_coordinates_are_named() {
        let line = |result: Result<TexturedSurface, IoError>| match result {
            Err(IoError::Malformed {
                place: Place::Line(line),
                ..
            }) => line,
            other => panic!("{other:?}"),
        };
        assert_eq!(line(read(&format!("{FOUR}vt 0 0\nf 1/1 2/1 3/1\nf 1 2 4\n"))), 7);
        assert_eq!(line(read(&format!("{FOUR}vt 0 0\nf 1 2 4\nf 1/1 2/1 3/1\n"))), 6);
        assert_eq!(line(read(&format!("{FOUR}vt 0 x\nf 1/1 2/1 3/1\n"))), 5);
        let missing = read(&format!("{FOUR}vt 0 0\nf 1/1 2/2 3/1\n"));
        assert!(
            matches!(
                missing,
                Err(IoError::IndexOutOfRange {
                    vertex: 2,
                    vertices: 1,
                    ..
                })
            ),
            "{missing:?}"
        );
    }

    #[test]
    fn vertices_have_colours_all_or_none() {
        let text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 0.5 # blue\nf 1 2 3\n";
        assert_eq!(
            read(text).unwrap().colours.unwrap(),
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]]
        );
        assert_eq!(
            read("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n").unwrap().colours,
            None
        );
        assert!(read("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0 0 1\nf 1 2 3\n").is_err());
        assert!(read("v 0 0 0 1 0 0\nv 1 0 0 0 0 0\nv 0 1 0\nf 1 2 3\n").is_err());
        assert!(read("v 0 0 0 1 red 0\nv 1 0 0 0 0 0\nv 0 1 0 0 0 0\nf 1 2 3\n").is_err());
    }
}
