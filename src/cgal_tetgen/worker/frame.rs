//! What goes over the line between a process and its worker: a tag, a text, and two rows of numbers, little-endian.

use std::io::{self, Read, Write};

/// A request, or its answer.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frame {
    /// What is asked for, or the code of how it ended.
    pub tag: u32,
    /// Words of an error.
    pub text: String,
    /// Numbers: options before coordinates.
    pub reals: Vec<f64>,
    /// Corners, or the number of a field.
    pub integers: Vec<u32>,
}

impl Frame {
    /// Writes the frame and sends it off.
    pub fn write(&self, writer: &mut impl Write) -> io::Result<()> {
        writer.write_all(&self.tag.to_le_bytes())?;
        for length in [self.text.len(), self.reals.len(), self.integers.len()] {
            writer.write_all(&(length as u64).to_le_bytes())?;
        }
        writer.write_all(self.text.as_bytes())?;
        for chunk in self.reals.chunks(CHUNK) {
            let bytes: Vec<u8> = chunk.iter().flat_map(|x| x.to_le_bytes()).collect();
            writer.write_all(&bytes)?;
        }
        for chunk in self.integers.chunks(CHUNK) {
            let bytes: Vec<u8> = chunk.iter().flat_map(|x| x.to_le_bytes()).collect();
            writer.write_all(&bytes)?;
        }
        writer.flush()
    }

    /// The next frame. Memory grows with what arrives, not with what is announced.
    pub fn read(reader: &mut impl Read) -> io::Result<Self> {
        let mut tag = [0; 4];
        reader.read_exact(&mut tag)?;
        let mut lengths = [0u64; 3];
        for length in &mut lengths {
            let mut bytes = [0; 8];
            reader.read_exact(&mut bytes)?;
            *length = u64::from_le_bytes(bytes);
        }
        let [text, reals, integers] = lengths;
        let text = row(reader, text, 1)?;
        let reals = row(reader, reals, 8)?;
        let integers = row(reader, integers, 4)?;
        Ok(Self {
            tag: u32::from_le_bytes(tag),
            text: String::from_utf8_lossy(&text).into_owned(),
            reals: reals.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
            integers: integers.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect(),
        })
    }
}

/// Numbers turned to bytes at a time.
const CHUNK: usize = 1 << 16;

fn row(reader: &mut impl Read, count: u64, width: u64) -> io::Result<Vec<u8>> {
    let length = count.checked_mul(width).ok_or(io::ErrorKind::InvalidData)?;
    let mut bytes = Vec::new();
    reader.take(length).read_to_end(&mut bytes)?;
    if bytes.len() as u64 == length {
        Ok(bytes)
    } else {
        Err(io::ErrorKind::UnexpectedEof.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> Frame {
        Frame {
            tag: 7,
            text: "größer".into(),
            reals: vec![1.5, f64::NEG_INFINITY, -0.0, f64::MIN_POSITIVE],
            integers: vec![0, u32::MAX, 3],
        }
    }

    #[test]
    fn frames_arrive_as_they_were_sent() {
        let mut line = Vec::new();
        frame().write(&mut line).unwrap();
        Frame::default().write(&mut line).unwrap();
        let mut reader = &line[..];
        assert_eq!(Frame::read(&mut reader).unwrap(), frame());
        assert_eq!(Frame::read(&mut reader).unwrap(), Frame::default());
        assert!(Frame::read(&mut reader).is_err());
    }

    #[test]
    fn a_frame_cut_short_anywhere_is_an_error() {
        let mut line = Vec::new();
        frame().write(&mut line).unwrap();
        for length in 0..line.len() {
            assert!(Frame::read(&mut &line[..length]).is_err(), "{length}");
        }
        // An announcement of more than there is, or could be.
        for announced in [u64::MAX, 1 << 40] {
            let mut damaged = line.clone();
            damaged[12..20].copy_from_slice(&announced.to_le_bytes());
            assert!(Frame::read(&mut &damaged[..]).is_err());
        }
    }
}
