//! Arrays of numbers in a page: deflated, and base64 in an element of their own.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::DeflateEncoder;
use serde::Serialize;

/// The type of an array's entries, serialized as the name of JavaScript's typed array.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Entries {
    #[serde(rename = "Float32Array")]
    F32,
    #[serde(rename = "Float64Array")]
    F64,
    #[serde(rename = "Uint8Array")]
    U8,
    #[serde(rename = "Uint32Array")]
    U32,
}

/// An array as it stands in a page.
#[derive(Debug, Clone, Serialize)]
pub struct PackedArray {
    /// The name by which scripts ask for it.
    name: String,
    entries: Entries,
    length: usize,
    /// Its bytes, deflated, as base64.
    #[serde(skip)]
    text: String,
}

impl PackedArray {
    /// Numbers of single precision: enough for all that is drawn.
    pub fn floats(name: impl Into<String>, values: impl IntoIterator<Item = f64>) -> Self {
        let values = values.into_iter().map(|value| (value as f32).to_le_bytes());
        Self::packed(name.into(), Entries::F32, values.collect::<Vec<_>>().as_flattened())
    }

    /// Numbers of double precision.
    pub fn doubles(name: impl Into<String>, values: impl IntoIterator<Item = f64>) -> Self {
        let values = values.into_iter().map(f64::to_le_bytes);
        Self::packed(name.into(), Entries::F64, values.collect::<Vec<_>>().as_flattened())
    }

    /// Bytes, such as parts of colours.
    pub fn bytes(name: impl Into<String>, values: &[u8]) -> Self {
        Self::packed(name.into(), Entries::U8, values)
    }

    /// Indices.
    pub fn indices(name: impl Into<String>, values: impl IntoIterator<Item = u32>) -> Self {
        let values = values.into_iter().map(u32::to_le_bytes);
        Self::packed(name.into(), Entries::U32, values.collect::<Vec<_>>().as_flattened())
    }

    fn packed(name: String, entries: Entries, bytes: &[u8]) -> Self {
        let size = match entries {
            Entries::F64 => 8,
            Entries::F32 | Entries::U32 => 4,
            Entries::U8 => 1,
        };
        Self {
            name,
            entries,
            length: bytes.len() / size,
            text: deflated(bytes),
        }
    }

    /// The name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its bytes, deflated, as base64.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// Bytes, deflated without a header, as the browser's `DecompressionStream("deflate-raw")` reads them, in base64.
pub fn deflated(bytes: &[u8]) -> String {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
    // Writing to memory cannot fail.
    let packed = encoder.write_all(bytes).and_then(|()| encoder.finish());
    STANDARD.encode(packed.expect("deflating in memory"))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn an_array_is_unpacked_to_the_same_entries() {
        let values = [1.5, -2.0, 3.25e8, f64::NAN];
        let array = PackedArray::floats("x", values);
        assert_eq!((array.length, array.entries), (4, Entries::F32));
        let mut bytes = Vec::new();
        let packed = STANDARD.decode(array.text()).unwrap();
        flate2::read::DeflateDecoder::new(&packed[..])
            .read_to_end(&mut bytes)
            .unwrap();
        let found: Vec<f32> = bytes
            .as_chunks()
            .0
            .iter()
            .map(|bytes| f32::from_le_bytes(*bytes))
            .collect();
        assert_eq!(found[..3], [1.5, -2.0, 3.25e8]);
        assert!(found[3].is_nan());
        assert_eq!(PackedArray::indices("i", [7, 8]).length, 2);
        assert_eq!(PackedArray::doubles("d", values).length, 4);
    }
}
