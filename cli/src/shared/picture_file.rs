//! Pictures in PNG and JPEG files, read by the crate `image`.

use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageDecoder};

use solidmap::io::IoError;
use solidmap::texture::{Picture, TextureError};

/// Why a picture cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The file is no PNG or JPEG picture, is truncated, or is too large.
    #[error("cannot read a picture from `{}`: {cause}; give a PNG or JPEG file", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        cause: String,
    },
    /// The picture has no pixels.
    #[error("`{}` cannot be used as a texture: {cause}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        cause: TextureError,
    },
}

/// Largest memory for decoding, in bytes: enough for 16384 × 16384 pixels.
const MOST_BYTES: u64 = 2 << 30;

/// Most pixels per byte of a file: eight of one bit per byte, which deflate packs 1032 to 1 at best.
const MOST_PIXELS: u64 = 8 * 1032;

/// Reads a PNG or JPEG picture, whatever its extension. Colours are taken as sRGB and rounded to 8 bits; grey becomes
/// red, green and blue, and transparency is ignored.
///
/// # Errors
///
/// When the file cannot be read, is no such picture, or has no pixels.
pub fn read_picture(path: impl AsRef<Path>) -> Result<Picture, PictureError> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|source| IoError::Read {
        path: path.to_owned(),
        source,
    })?;
    let unreadable = |cause: String| PictureError::Unreadable {
        path: path.to_owned(),
        cause: cause.escape_debug().to_string(),
    };
    let reader = image::ImageReader::new(BufReader::new(Cursor::new(&bytes)));
    let mut reader = reader.with_guessed_format().map_err(|e| unreadable(e.to_string()))?;
    if reader.format().is_none() {
        return Err(unreadable("its content is of no known format".into()));
    }
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MOST_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| unreadable(e.to_string()))?;
    let (width, height) = decoder.dimensions();
    let length = bytes.len() as u64;
    if u64::from(width) * u64::from(height) > length.saturating_mul(MOST_PIXELS) {
        return Err(unreadable(format!(
            "its header claims {width} × {height} pixels, which its {length} bytes cannot hold"
        )));
    }
    if decoder.total_bytes() > MOST_BYTES {
        return Err(unreadable(format!(
            "its {width} × {height} pixels take more than {MOST_BYTES} bytes"
        )));
    }
    let decoded = DynamicImage::from_decoder(decoder)
        .map_err(|e| unreadable(e.to_string()))?
        .into_rgb8();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let pixels = decoded.as_raw().as_chunks::<3>().0.to_vec();
    Picture::new(width, height, pixels).map_err(|cause| PictureError::Unusable {
        path: path.to_owned(),
        cause,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_pictures_are_read_and_broken_ones_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grey.dat");
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header().unwrap().write_image_data(&[7, 200]).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(read_picture(&path).unwrap().pixels(), [[7; 3], [200; 3]]);
        for length in 0..bytes.len() - 12 {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(
                matches!(read_picture(&path), Err(PictureError::Unreadable { .. })),
                "{length}"
            );
        }
        assert!(matches!(
            read_picture(folder.path().join("none.png")),
            Err(PictureError::Io(_))
        ));
    }
}
