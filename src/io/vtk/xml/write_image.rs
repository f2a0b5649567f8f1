//! Writing image data (`.vti`): values on a regular grid of points.
//!
//! The values are compressed by zlib in independent blocks and written as inline base64: a header (number of blocks,
//! their size, the size of the last, their compressed sizes, all as 64-bit integers) and the blocks, encoded
//! separately.

use std::io::Write;
use std::path::Path;

use base64::{Engine, engine::general_purpose::STANDARD, write::EncoderWriter};
use flate2::{Compression, write::ZlibEncoder};
use quick_xml::escape::escape;
use rayon::prelude::*;

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

/// Bytes of a block before it is compressed.
const BLOCK: usize = 1 << 20;

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
    let compressed: Vec<Vec<u8>> = bytes
        .par_chunks(BLOCK)
        .map(|block| {
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(5));
            // Writing into memory does not fail.
            let _ = encoder.write_all(block);
            encoder.finish().unwrap_or_default()
        })
        .collect();
    // The size of a last block that is not full, else 0.
    let sizes = [compressed.len(), BLOCK, bytes.len() % BLOCK].into_iter();
    let sizes = sizes.chain(compressed.iter().map(Vec::len));
    let header: Vec<u8> = sizes.flat_map(|size| (size as u64).to_le_bytes()).collect();
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
            "<DataArray type=\"UInt8\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">{}",
            STANDARD.encode(&header)
        )?;
        let mut encoder = EncoderWriter::new(&mut *writer, &STANDARD);
        compressed.iter().try_for_each(|block| encoder.write_all(block))?;
        encoder.finish()?;
        drop(encoder);
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
