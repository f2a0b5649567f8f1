//! Arrays compressed by zlib in independent blocks and written as inline base64: a header (number of blocks, their size,
//! the size of the last if it is not full, their compressed sizes, all as 64-bit integers) and the blocks, encoded
//! separately.

use std::io::{self, Write};

use base64::{Engine, engine::general_purpose::STANDARD, write::EncoderWriter};
use flate2::{Compression, write::ZlibEncoder};
use rayon::prelude::*;

/// Bytes of a block before it is compressed.
const BLOCK: usize = 1 << 20;
/// How hard zlib tries, from 1 to 9. Coordinates and indices get hardly smaller with more; colours of voxels do.
const MESH_LEVEL: u32 = 1;
const BYTES_LEVEL: u32 = 5;

/// Writes bytes. Blocks are compressed by all threads; the result does not depend on how many there are.
pub(super) fn write_bytes(writer: &mut dyn Write, bytes: &[u8]) -> io::Result<()> {
    write_blocks(writer, bytes.len(), &|k| [bytes[k]], BYTES_LEVEL)
}

/// Writes `count` coordinates, indices or values of a field, of `N` bytes each.
pub(super) fn write_values<const N: usize>(
    writer: &mut dyn Write,
    count: usize,
    value: &(dyn Fn(usize) -> [u8; N] + Sync),
) -> io::Result<()> {
    write_blocks(writer, count, value, MESH_LEVEL)
}

/// Writes `count` values of `N` bytes, of which at most a block at a time per thread is in memory uncompressed. `N` must
/// divide the size of a block.
fn write_blocks<const N: usize>(
    writer: &mut dyn Write,
    count: usize,
    value: &(dyn Fn(usize) -> [u8; N] + Sync),
    level: u32,
) -> io::Result<()> {
    let per_block = BLOCK / N;
    let compressed: Vec<Vec<u8>> = (0..count.div_ceil(per_block))
        .into_par_iter()
        .map(|block| {
            let values = block * per_block..count.min((block + 1) * per_block);
            let mut bytes = Vec::with_capacity(N * values.len());
            values.for_each(|k| bytes.extend_from_slice(&value(k)));
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(level));
            // Writing into memory does not fail.
            let _ = encoder.write_all(&bytes);
            encoder.finish().unwrap_or_default()
        })
        .collect();
    let sizes = [compressed.len(), BLOCK, count * N % BLOCK].into_iter();
    let sizes = sizes.chain(compressed.iter().map(Vec::len));
    let header: Vec<u8> = sizes.flat_map(|size| (size as u64).to_le_bytes()).collect();
    writer.write_all(STANDARD.encode(&header).as_bytes())?;
    let mut encoder = EncoderWriter::new(&mut *writer, &STANDARD);
    compressed.iter().try_for_each(|block| encoder.write_all(block))?;
    encoder.finish()?;
    Ok(())
}
