//! Images of the nodes of a mesh: lines `node x y z`, as the data of VOLMAP have them (Cherchi & Livesu 2023).

use std::path::Path;

use super::input::{InputFile, parsed};
use super::{IoError, read_bytes};
use crate::Point;

/// Reads the images of nodes: lines of a node's number, counted from 0, and its three coordinates, separated by blanks.
/// Empty lines and those that begin with `#` are skipped. In the order of the file; that nodes exist and are named once is
/// for [`BoundaryMap::of_nodes`](crate::boundary_map::BoundaryMap::of_nodes) to see.
///
/// # Errors
///
/// [`IoError::Read`], and [`IoError::Malformed`] with the line.
pub fn read_node_images(path: impl AsRef<Path>) -> Result<Vec<(u32, Point)>, IoError> {
    let path = path.as_ref();
    let bytes = read_bytes(path)?;
    let file = InputFile {
        path,
        format: "text of node images",
        bytes: &bytes,
    };
    let mut images = Vec::new();
    let mut offset = 0;
    for line in bytes.split(|&b| b == b'\n') {
        let mut words = line.split(|b| b.is_ascii_whitespace()).filter(|word| !word.is_empty());
        if let Some(first) = words.next().filter(|word| !word.starts_with(b"#")) {
            let wanted = || file.malformed(offset, "a line that is not a node, counted from 0, and its x, y and z");
            let node = parsed(first).ok_or_else(wanted)?;
            let mut coordinate = || words.next().and_then(parsed).ok_or_else(wanted);
            let image = Point::new(coordinate()?, coordinate()?, coordinate()?);
            if words.next().is_some() {
                return Err(wanted());
            }
            images.push((node, image));
        }
        offset += line.len() + 1;
    }
    Ok(images)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> Result<Vec<(u32, Point)>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("images.txt");
        std::fs::write(&path, text).unwrap();
        read_node_images(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn lines_are_nodes_and_coordinates() {
        let found = read(b"216 25.581395 100.000000 1e2\r\n\n# a comment\n  7\t-1 0.5 +3\n").unwrap();
        let expected = [
            (216, Point::new(25.581395, 100.0, 100.0)),
            (7, Point::new(-1.0, 0.5, 3.0)),
        ];
        assert_eq!(found, expected);
        assert_eq!(read(b"").unwrap(), []);
    }

    #[test]
    fn other_lines_are_refused_with_their_number() {
        for wrong in [
            "1 2 3",
            "1 2 3 4 5",
            "-1 2 3 4",
            "1.5 2 3 4",
            "v 2 3 4",
            "5000000000 1 2 3",
        ] {
            let error = read(format!("0 1 2 3\n{wrong}\n").as_bytes()).unwrap_err();
            assert!(error.contains("line 2") && error.contains("images.txt"), "{error}");
        }
    }
}
