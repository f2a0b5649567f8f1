//! Writing image data (`.vti`): values on a regular grid of points, compressed.

use std::path::Path;

use quick_xml::escape::escape;

use super::compress::write_bytes;
use crate::{
    Point,
    io::{IoError, atomic_write},
};

/// A regular grid of points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageGrid {
    /// The first point, of lowest coordinates.
    pub origin: Point,
    /// Distance between neighbours along every axis.
    pub spacing: f64,
    /// Points along x, y and z.
    pub size: [usize; 3],
}

/// Writes one array of bytes, `components` for each point of the grid: x varies fastest, then y, then z.
///
/// # Errors
///
/// [`IoError::ValueCount`] unless there are `components` bytes for each point and at least one point,
/// [`IoError::Write`].
pub fn write_vti(
    path: impl AsRef<Path>,
    grid: &ImageGrid,
    name: &str,
    components: usize,
    bytes: &[u8],
) -> Result<(), IoError> {
    let [width, height, depth] = grid.size;
    let points = width.checked_mul(height).and_then(|n| n.checked_mul(depth));
    let expected = points.and_then(|n| n.checked_mul(components)).filter(|&n| n > 0);
    if expected != Some(bytes.len()) {
        let expected = expected.unwrap_or_default();
        return Err(IoError::value_count(path.as_ref(), name, expected, bytes.len()));
    }
    let extent = format!("0 {} 0 {} 0 {}", width - 1, height - 1, depth - 1);
    let name = escape(name);
    let (origin, spacing) = (grid.origin, grid.spacing);
    atomic_write(path, |writer| {
        writeln!(
            writer,
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n<ImageData WholeExtent=\"{extent}\" \
             Origin=\"{:?} {:?} {:?}\" Spacing=\"{spacing:?} {spacing:?} {spacing:?}\">\n<Piece Extent=\"{extent}\">\n\
             <PointData Scalars=\"{name}\">",
            origin.x, origin.y, origin.z
        )?;
        write!(
            writer,
            "<DataArray type=\"UInt8\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">"
        )?;
        write_bytes(writer, bytes)?;
        writeln!(writer, "</DataArray>\n</PointData>\n</Piece>\n</ImageData>\n</VTKFile>")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_do_not_fill_the_grid_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("volume.vti");
        let mut grid = ImageGrid {
            origin: Point::origin(),
            spacing: 0.5,
            size: [2, 3, 4],
        };
        let refused = |grid: &ImageGrid, count: usize| write_vti(&path, grid, "rgb", 3, &vec![0; count]).is_err();
        assert!(!refused(&grid, 72) && refused(&grid, 71));
        grid.size = [usize::MAX, 2, 2];
        assert!(refused(&grid, 72));
        grid.size = [0, 3, 4];
        assert!(refused(&grid, 0));
    }
}
