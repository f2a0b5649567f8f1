use super::DrawingError;
use super::canvas::Canvas;

/// The canvas as a PNG file of 8-bit sRGB.
pub(super) fn encode(canvas: &Canvas) -> Result<Vec<u8>, DrawingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, canvas.width() as u32, canvas.height() as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_compression(png::Compression::Balanced);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(canvas.pixels().as_flattened())?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
pub(super) fn decode(bytes: &[u8]) -> Canvas {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut data).unwrap();
    assert_eq!(
        (info.color_type, info.bit_depth),
        (png::ColorType::Rgb, png::BitDepth::Eight)
    );
    let mut canvas = Canvas::new(info.width as usize, info.height as usize, [0; 3]);
    for (pixel, rgb) in canvas.pixels_mut().iter_mut().zip(data.as_chunks::<3>().0) {
        *pixel = *rgb;
    }
    canvas
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_keeps_size_and_colours() {
        let mut canvas = Canvas::new(5, 3, [255, 255, 255]);
        canvas.set(4, 0, [1, 2, 3]);
        canvas.set(0, 2, [250, 0, 128]);
        let back = decode(&encode(&canvas).unwrap());
        assert_eq!((back.width(), back.height()), (5, 3));
        assert_eq!(back.pixels(), canvas.pixels());
    }
}
