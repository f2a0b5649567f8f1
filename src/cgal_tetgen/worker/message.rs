//! Messages between a process and its worker: a tag, a text, and two arrays, little-endian.

use std::io::{self, Read, Write};

/// A request or a reply.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Message {
    /// The operation of a request, or the result code of a reply.
    pub tag: u32,
    /// The error message of a reply.
    pub text: String,
    /// Options before coordinates.
    pub reals: Vec<f64>,
    /// Corners, or the id of a distance field.
    pub integers: Vec<u32>,
}

impl Message {
    /// Writes the message and flushes.
    pub fn write(&self, writer: &mut impl Write) -> io::Result<()> {
        writer.write_all(&self.tag.to_le_bytes())?;
        for length in [self.text.len(), self.reals.len(), self.integers.len()] {
            writer.write_all(&(length as u64).to_le_bytes())?;
        }
        writer.write_all(self.text.as_bytes())?;
        for chunk in self.reals.chunks(CHUNK) {
            writer.write_all(&chunk.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
        }
        for chunk in self.integers.chunks(CHUNK) {
            writer.write_all(&chunk.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
        }
        writer.flush()
    }

    /// Reads the next message. Memory grows with the data received, not with the lengths announced.
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
        let text = read_array(reader, text, 1)?;
        let reals = read_array(reader, reals, 8)?;
        let integers = read_array(reader, integers, 4)?;
        Ok(Self {
            tag: u32::from_le_bytes(tag),
            text: String::from_utf8_lossy(&text).into_owned(),
            reals: reals.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
            integers: integers.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect(),
        })
    }
}

/// Numbers converted to bytes at a time.
const CHUNK: usize = 1 << 16;

fn read_array(reader: &mut impl Read, count: u64, width: u64) -> io::Result<Vec<u8>> {
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

    fn message() -> Message {
        Message {
            tag: 7,
            text: "größer".into(),
            reals: vec![1.5, f64::NEG_INFINITY, -0.0, f64::MIN_POSITIVE],
            integers: vec![0, u32::MAX, 3],
        }
    }

    #[test]
    fn messages_arrive_as_they_were_sent() {
        let mut bytes = Vec::new();
        message().write(&mut bytes).unwrap();
        Message::default().write(&mut bytes).unwrap();
        let mut reader = &bytes[..];
        assert_eq!(Message::read(&mut reader).unwrap(), message());
        assert_eq!(Message::read(&mut reader).unwrap(), Message::default());
        assert!(Message::read(&mut reader).is_err());
    }

    #[test]
    fn a_message_cut_short_anywhere_is_an_error() {
        let mut bytes = Vec::new();
        message().write(&mut bytes).unwrap();
        for length in 0..bytes.len() {
            assert!(Message::read(&mut &bytes[..length]).is_err(), "{length}");
        }
        // A length larger than what follows, or than memory.
        for announced in [u64::MAX, 1 << 40] {
            let mut damaged = bytes.clone();
            damaged[12..20].copy_from_slice(&announced.to_le_bytes());
            assert!(Message::read(&mut &damaged[..]).is_err());
        }
    }
}
