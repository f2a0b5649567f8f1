//! Decoding and decompression of arrays.

use std::{borrow::Cow, collections::HashMap, io::Read};

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::read::ZlibDecoder;

use super::document::{Array, Document, Encoding, XmlPiece};
use crate::io::{
    Field, IoError, Place,
    input::{ByteOrder, Scalar, Tokens, excerpt},
};

/// Largest expansion of deflate: a match of 258 bytes takes two bits.
const MAX_DEFLATION: usize = 1032;

impl<'a> Document<'a> {
    /// The fields that every piece has, concatenated over the pieces.
    pub fn fields<'d>(&'d self, data: impl Fn(&'d XmlPiece<'a>) -> &'d Vec<Array<'a>>) -> Result<Vec<Field>, IoError> {
        let mut fields = Vec::new();
        let key = |array: &'d Array<'a>| (&*array.name, array.components);
        // The first of several arrays with one name is used.
        let of_pieces: Vec<HashMap<_, _>> = self
            .pieces
            .iter()
            .map(|piece| data(piece).iter().rev().map(|array| (key(array), array)).collect())
            .collect();
        for first in self.pieces.first().map(&data).into_iter().flatten() {
            let arrays: Option<Vec<&Array>> = of_pieces
                .iter()
                .map(|arrays| arrays.get(&key(first)).copied())
                .collect();
            let mut values = Vec::new();
            let Some(arrays) = arrays else { continue };
            for array in arrays {
                values.extend(self.floats(array)?);
            }
            fields.push(Field {
                name: first.name.to_string(),
                components: first.components,
                values,
            });
        }
        Ok(fields)
    }

    pub fn floats(&self, array: &Array) -> Result<Vec<f64>, IoError> {
        self.values(array, Scalar::float, Tokens::float)
    }

    pub fn integers(&self, array: &Array) -> Result<Vec<i64>, IoError> {
        self.values(array, Scalar::integer, Tokens::integer)
    }

    fn values<T>(
        &self,
        array: &Array,
        from_bytes: impl Fn(Scalar, &[u8], ByteOrder) -> T,
        from_text: impl Fn(&mut Tokens<'a>, &str) -> Result<T, IoError>,
    ) -> Result<Vec<T>, IoError> {
        if let Encoding::Text = array.encoding {
            let mut tokens = self.file.tokens_in(array.text.clone());
            let mut values = Vec::new();
            while tokens.peek().is_some() {
                values.push(from_text(&mut tokens, "a DataArray")?);
            }
            return Ok(values);
        }
        let bytes = self.decoded(array)?;
        self.spend_budget(bytes.len() / array.scalar.size() * size_of::<T>())?;
        let values = bytes.chunks_exact(array.scalar.size());
        Ok(values.map(|b| from_bytes(array.scalar, b, self.order)).collect())
    }

    /// The bytes of an array, decoded and decompressed.
    fn decoded(&self, array: &Array) -> Result<Cow<'a, [u8]>, IoError> {
        let invalid = |found: String| self.file.malformed_at(self.place(array), found);
        let cut_off = || {
            self.file
                .truncated(format!("the array `{}`", excerpt(array.name.as_bytes())))
        };
        let stored = match array.encoding {
            Encoding::Appended(offset) => {
                let (data, base64) = self.appended.ok_or_else(|| self.file.truncated("the appended data"))?;
                let data = data.get(offset..).ok_or_else(cut_off)?;
                if base64 {
                    let next = self.offsets.partition_point(|&next| next <= offset);
                    let next = self.offsets.get(next);
                    let length = next.map_or(data.len(), |next| data.len().min(next - offset));
                    self.spend_budget(length)?;
                    Cow::Owned(decode_base64(&data[..length]).map_err(invalid)?)
                } else {
                    Cow::Borrowed(data)
                }
            }
            _ => Cow::Owned(decode_base64(&self.file.bytes[array.text.clone()]).map_err(invalid)?),
        };
        // An empty array may lack even its length.
        if stored.is_empty() {
            return Ok(stored);
        }
        if self.compressed {
            return Ok(Cow::Owned(self.decompressed(&stored, cut_off, invalid)?));
        }
        let start = self.header.size();
        let length = self.length(&stored, 0).ok_or_else(cut_off)?;
        let range = start..start.checked_add(length).ok_or_else(cut_off)?;
        match stored {
            Cow::Borrowed(bytes) => bytes.get(range).map(Cow::Borrowed),
            Cow::Owned(mut bytes) => (range.end <= bytes.len()).then(|| {
                bytes.truncate(range.end);
                bytes.drain(..start);
                Cow::Owned(bytes)
            }),
        }
        .ok_or_else(cut_off)
    }

    /// A header (number of blocks, size of a block, size of the last or 0, compressed size of each), then the blocks.
    fn decompressed(
        &self,
        stored: &[u8],
        cut_off: impl Fn() -> IoError,
        invalid: impl Fn(String) -> IoError,
    ) -> Result<Vec<u8>, IoError> {
        let length = |k: usize| self.length(stored, k).ok_or_else(&cut_off);
        let (blocks, full, last) = (length(0)?, length(1)?, length(2)?);
        let begin = blocks.checked_add(3).and_then(|n| n.checked_mul(self.header.size()));
        let mut rest = begin.and_then(|begin| stored.get(begin..)).ok_or_else(&cut_off)?;
        let mut bytes = Vec::new();
        for block in 0..blocks {
            let (compressed, tail) = rest.split_at_checked(length(3 + block)?).ok_or_else(&cut_off)?;
            rest = tail;
            let expected = if block + 1 == blocks && last > 0 { last } else { full };
            let other = || {
                invalid(format!(
                    "a compressed block does not hold the {expected} bytes announced"
                ))
            };
            if expected > compressed.len().saturating_mul(MAX_DEFLATION) {
                return Err(other());
            }
            self.spend_budget(expected)?;
            let before = bytes.len();
            let mut decoder = ZlibDecoder::new(compressed).take(expected as u64 + 1);
            decoder
                .read_to_end(&mut bytes)
                .map_err(|error| invalid(format!("a compressed block cannot be read: {error}")))?;
            if bytes.len() - before != expected {
                return Err(other());
            }
        }
        Ok(bytes)
    }

    /// The `k`-th number of the header of binary data.
    fn length(&self, stored: &[u8], k: usize) -> Option<usize> {
        let size = self.header.size();
        let bytes = stored.get(k.checked_mul(size)?..)?.get(..size)?;
        usize::try_from(self.header.integer(bytes, self.order)).ok()
    }

    pub fn expect_length(&self, array: &Array, found: u64, expected: Option<u64>) -> Result<(), IoError> {
        if expected == Some(found) {
            return Ok(());
        }
        let wanted = expected.map_or_else(|| "too many".to_owned(), |n| n.to_string());
        let found = format!("the array holds {found} values, but its piece needs {wanted}");
        Err(self.file.malformed_at(self.place(array), found))
    }

    pub fn place(&self, array: &Array) -> Place {
        Place::Byte(array.text.start)
    }
}

/// Decodes base64 up to the first `<` or the end. Header and data may be encoded separately, with padding in the
/// middle.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let text = text.split(|&b| b == b'<').next().unwrap_or_default();
    let text: Vec<u8> = text.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let mut rest = text.as_slice();
    while !rest.is_empty() {
        let padding = rest.iter().position(|&b| b == b'=').unwrap_or(rest.len());
        let length = padding.max(1).next_multiple_of(4).min(rest.len());
        let (part, tail) = rest.split_at(length);
        STANDARD
            .decode_vec(part, &mut bytes)
            .map_err(|error| format!("base64: {error}"))?;
        rest = tail;
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_without_digits_is_refused() {
        assert_eq!(decode_base64(b" AAEC Aw== BA== <").unwrap(), [0, 1, 2, 3, 4]);
        assert!(decode_base64(b"====").is_err());
        assert!(decode_base64(b"AAEC=").is_err());
        assert!(decode_base64(b"AAE").is_err());
    }
}
