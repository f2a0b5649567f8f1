//! Shared by the parsers: a file in memory with constructors of its errors, text tokens, binary numbers.

use std::{ops::Range, path::Path};

use super::{IoError, Place};
use crate::Point;

/// The bytes of a file that is parsed as `format`.
pub(super) struct InputFile<'a> {
    pub path: &'a Path,
    pub format: &'static str,
    pub bytes: &'a [u8],
}

impl<'a> InputFile<'a> {
    /// An error at the line that holds the byte at `offset`.
    pub fn malformed(&self, offset: usize, found: impl Into<String>) -> IoError {
        let before = &self.bytes[..offset.min(self.bytes.len())];
        self.malformed_at(Place::Line(1 + before.iter().filter(|&&b| b == b'\n').count()), found)
    }

    pub fn malformed_at(&self, place: Place, found: impl Into<String>) -> IoError {
        IoError::Malformed {
            path: self.path.to_owned(),
            format: self.format,
            place,
            found: found.into(),
        }
    }

    pub fn truncated(&self, within: impl Into<String>) -> IoError {
        IoError::Truncated {
            path: self.path.to_owned(),
            format: self.format,
            within: within.into(),
        }
    }

    pub fn unsupported(&self, found: impl Into<String>, remedy: &'static str) -> IoError {
        IoError::unsupported(self.path, found, remedy)
    }

    /// `count` as a size for allocation, if `available` bytes can hold that many elements of at least `least` bytes.
    pub fn checked_count(&self, count: u64, element: &str, least: usize, available: usize) -> Result<usize, IoError> {
        match usize::try_from(count) {
            Ok(n) if n.checked_mul(least).is_some_and(|bytes| bytes <= available) => Ok(n),
            _ => Err(IoError::CountExceedsFile {
                path: self.path.to_owned(),
                format: self.format,
                element: element.to_owned(),
                count,
                available,
            }),
        }
    }

    pub fn tokens(&'a self) -> Tokens<'a> {
        self.tokens_in(0..self.bytes.len())
    }

    pub fn tokens_in(&'a self, range: Range<usize>) -> Tokens<'a> {
        Tokens {
            file: self,
            position: range.start,
            end: range.end,
            start: range.start,
            skip_comments: false,
        }
    }
}

/// Fewest bytes of a number in text: a digit and a separator, which the last number may lack.
pub(super) const TEXT_NUMBER: usize = 2;

/// Reads words and numbers separated by white space, and blocks of bytes.
pub(super) struct Tokens<'a> {
    file: &'a InputFile<'a>,
    position: usize,
    end: usize,
    /// Start of the last token.
    start: usize,
    skip_comments: bool,
}

impl<'a> Tokens<'a> {
    /// Makes the tokens skip everything from `#` to the end of a line.
    pub fn without_comments(self) -> Self {
        Self {
            skip_comments: true,
            ..self
        }
    }

    pub fn position(&self) -> usize {
        self.position
    }

    /// The unread bytes.
    pub fn rest(&self) -> &'a [u8] {
        &self.file.bytes[self.position..self.end]
    }

    pub fn next(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        let rest = self.rest();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.start = self.position;
        self.position += length;
        (length > 0).then(|| &rest[..length])
    }

    pub fn peek(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        let position = self.position;
        let token = self.next();
        self.position = position;
        token
    }

    /// The next token as text, for keywords.
    pub fn word(&mut self, within: &str) -> Result<String, IoError> {
        let token = self.next().ok_or_else(|| self.file.truncated(within))?;
        Ok(String::from_utf8_lossy(token).into_owned())
    }

    pub fn float(&mut self, within: &str) -> Result<f64, IoError> {
        self.number(within, "a number")
    }

    pub fn integer(&mut self, within: &str) -> Result<i64, IoError> {
        self.number(within, "a whole number")
    }

    /// Three coordinates.
    pub fn point(&mut self) -> Result<Point, IoError> {
        let within = "the coordinates of a vertex";
        Ok(Point::new(
            self.float(within)?,
            self.float(within)?,
            self.float(within)?,
        ))
    }

    /// A count of elements, each of which takes at least `least` of the following bytes.
    pub fn count(&mut self, element: &str, least: usize) -> Result<usize, IoError> {
        let count: u64 = self.number(element, "a count")?;
        // The last number of a file needs no separator, hence one byte more than there is.
        self.file
            .checked_count(count, element, least, self.rest().len().saturating_add(1))
    }

    /// The rest of the line, without its end.
    pub fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.start = self.position;
        self.position = (self.position + length + 1).min(self.end);
        rest[..length].trim_ascii_end()
    }

    /// The next `length` bytes.
    pub fn take(&mut self, length: usize, within: &str) -> Result<&'a [u8], IoError> {
        let taken = self.rest().get(..length).ok_or_else(|| self.file.truncated(within))?;
        self.position += length;
        Ok(taken)
    }

    /// An error at the line of the last token.
    pub fn malformed(&self, found: impl Into<String>) -> IoError {
        self.file.malformed(self.start, found)
    }

    /// An error at the line of the last token, for something found in the place of something else.
    pub fn unexpected(&self, found: &[u8], wanted: &str) -> IoError {
        self.malformed(format!("found `{}` where {wanted} was expected", excerpt(found)))
    }

    fn number<T: std::str::FromStr>(&mut self, within: &str, wanted: &str) -> Result<T, IoError> {
        let token = self.next().ok_or_else(|| self.file.truncated(within))?;
        parsed(token).ok_or_else(|| {
            let found = excerpt(token);
            self.malformed(format!("found `{found}` where {wanted} was expected, in {within}"))
        })
    }

    fn skip_space(&mut self) {
        loop {
            let rest = self.rest();
            let blank = rest.iter().position(|b| !b.is_ascii_whitespace());
            self.position += blank.unwrap_or(rest.len());
            if !self.skip_comments || self.rest().first() != Some(&b'#') {
                return;
            }
            self.line();
        }
    }
}

/// These bytes as a number, `nan` and `inf` included.
pub(super) fn parsed<T: std::str::FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// The beginning of `bytes` as printable text, for error messages.
pub(super) fn excerpt(bytes: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(4 * LONGEST)]);
    let mut shown: String = text.chars().take(LONGEST).flat_map(char::escape_debug).collect();
    if text.chars().count() > LONGEST {
        shown.push('…');
    }
    shown
}

/// A library's error message, which may quote the file: shortened, with control characters escaped.
pub(crate) fn printable(message: impl ToString) -> String {
    const LONGEST: usize = 300;
    let message = message.to_string();
    let escaped = |c: char| match c.is_control() {
        true => c.escape_debug().collect(),
        false => c.to_string(),
    };
    let mut shown: String = message.chars().take(LONGEST).map(escaped).collect();
    if message.chars().count() > LONGEST {
        shown.push('…');
    }
    shown
}

/// A type of number in a binary file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number in the first `size()` bytes.
    pub fn float(self, bytes: &[u8], order: ByteOrder) -> f64 {
        match self {
            Self::F32 => f64::from(f32::from_bits(order.bits(bytes, 4) as u32)),
            Self::F64 => f64::from_bits(order.bits(bytes, 8)),
            _ => self.integer(bytes, order) as f64,
        }
    }

    /// The number in the first `size()` bytes, truncated to an integer and saturated.
    pub fn integer(self, bytes: &[u8], order: ByteOrder) -> i64 {
        let bits = order.bits(bytes, self.size());
        match self {
            Self::I8 => i64::from(bits as i8),
            Self::I16 => i64::from(bits as i16),
            Self::I32 => i64::from(bits as i32),
            Self::U64 => i64::try_from(bits).unwrap_or(i64::MAX),
            Self::U8 | Self::U16 | Self::U32 | Self::I64 => bits as i64,
            Self::F32 | Self::F64 => self.float(bytes, order) as i64,
        }
    }
}

/// The byte order of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

impl ByteOrder {
    fn bits(self, bytes: &[u8], size: usize) -> u64 {
        let mut word = [0; 8];
        match self {
            Self::Little => {
                word[..size].copy_from_slice(&bytes[..size]);
                u64::from_le_bytes(word)
            }
            Self::Big => {
                word[8 - size..].copy_from_slice(&bytes[..size]);
                u64::from_be_bytes(word)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scalars_agree_with_the_standard_library_in_both_orders() {
        for value in [-2.5f64, f64::MAX, -0.0, 1e-310] {
            assert_eq!(
                Scalar::F64.float(&value.to_le_bytes(), ByteOrder::Little).to_bits(),
                value.to_bits()
            );
            assert_eq!(
                Scalar::F64.float(&value.to_be_bytes(), ByteOrder::Big).to_bits(),
                value.to_bits()
            );
        }
        assert_eq!(Scalar::F32.float(&1.5f32.to_be_bytes(), ByteOrder::Big), 1.5);
        assert_eq!(Scalar::I16.integer(&(-7i16).to_le_bytes(), ByteOrder::Little), -7);
        assert_eq!(
            Scalar::U32.integer(&u32::MAX.to_be_bytes(), ByteOrder::Big),
            i64::from(u32::MAX)
        );
        assert_eq!(Scalar::U64.integer(&u64::MAX.to_be_bytes(), ByteOrder::Big), i64::MAX);
        assert_eq!(
            Scalar::I64.integer(&i64::MIN.to_le_bytes(), ByteOrder::Little),
            i64::MIN
        );
        assert_eq!(Scalar::I8.float(&[0xff], ByteOrder::Little), -1.0);
        assert_eq!(Scalar::F64.integer(&f64::NAN.to_le_bytes(), ByteOrder::Little), 0);
    }
}
